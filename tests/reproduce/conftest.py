"""The experiments with one car from the shipped logs, with few orders and a made-up diagnosis, so
that they take seconds."""

import dataclasses

import pytest

import made_up_diagnosis
from vdmsi_jax.reproduce import COURSES, SHIPPED, TRIMS, Experiments
from vdmsi_jax.reproduce.closed_loop import judge
from vdmsi_jax.reproduce.identification import PAPER_OPTIONS, identify_actuators
from vdmsi_jax.reproduce.logs import STEPS, read_logs, read_run, run_file, start_name
from vdmsi_jax.reproduce.open_loop import open_loop
from vdmsi_jax.reproduce.reproduce import KEYS

FEW = dataclasses.replace(PAPER_OPTIONS, poles=(1, 2), zeros=(0, 1, 2), held_out=0.0)


@pytest.fixture(scope="session")
def logs():
    return read_logs(SHIPPED / "worn")


@pytest.fixture(scope="session")
def one(logs):
    """The worn car, its extended model being VDM-SI again."""
    trim = next(trim for trim in TRIMS if trim.name == "worn")
    found = identify_actuators([logs[name] for name in STEPS], FEW)
    vehicles = {"VDM": found.model.to_vehicle(dynamics=False), "VDM-SI": found.model.to_vehicle()}
    vehicles["extended"] = vehicles["VDM-SI"]
    opened = {
        c.name: open_loop(c, logs[c.name], logs[start_name(c)], vehicles, 4.5) for c in COURSES
    }
    closed = {
        c.name: {m: judge(m, c, read_run(run_file(SHIPPED / "worn", c, KEYS[m]))) for m in vehicles}
        for c in COURSES
    }
    diagnosis = next(iter(made_up_diagnosis.ALL.values()))()
    return Experiments(trim, found, diagnosis, opened, closed)
