"""`vdmsi sweep`: cells that are kept, and configurations beside the logs."""

import json

import pytest

from commands import DEMO
from small_logs import drive, write_csv
from vdmsi_jax.errors import InputError
from vdmsi_jax.sweep import plan


def test_a_sweep_goes_on_where_it_was_stopped(here, tmp_path, settings):
    config = tmp_path / "sweep.toml"
    runs = [
        (DEMO / "powertrain_steps.csv", "powertrain"),
        (DEMO / "steering_steps.csv", "steering"),
    ]
    config.write_text(
        "[identify]\npoles = [1, 2]\nzeros = [0, 1, 2]\n[sweep]\nruns = [\n"
        + "".join(
            f'{{ log = "{log}", config = "{settings}", plants = ["{plant}"] }},\n'
            for log, plant in runs
        )
        + "]\n"
    )
    done = here("sweep", config, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    cells = sorted((tmp_path / "out" / "cells").iterdir())
    assert len(cells) == 2
    report = (tmp_path / "out" / "report.html").read_text()
    assert report.count("<svg ") == 1 and "P1Z2" in report and "steering_steps.csv" in report
    finished = {cell: cell.stat().st_mtime_ns for cell in cells}
    summary = (tmp_path / "out" / "sweep.json").read_text()

    cells[0].unlink()  # as if the sweep had been stopped before it
    cells[1].write_text(cells[1].read_text())
    kept = cells[1].stat().st_mtime_ns
    done = here("sweep", config, "--out", tmp_path / "out")
    assert done.returncode == 0
    assert cells[0].stat().st_mtime_ns != finished[cells[0]]
    assert cells[1].stat().st_mtime_ns == kept, "a finished cell was made again"
    assert (tmp_path / "out" / "sweep.json").read_text() == summary

    config.write_text(config.read_text().replace("[identify]", "[identify]\nfit_loss = 30.0"))
    assert here("sweep", config, "--out", tmp_path / "out").returncode == 0
    assert json.loads(cells[0].read_text())["chosen"] == "P1Z0", "a changed cell was kept"


def test_a_log_of_one_actuator_is_one_cell(here, tmp_path):
    some = {name: drive()[name] for name in ("t", "v_cmd", "v")}
    log = write_csv(tmp_path / "log.csv", some)
    text = f'[identify]\npoles = [1]\nzeros = [0]\n[sweep]\nruns = [{{ log = "{log}" }}]\n'
    (tmp_path / "sweep.toml").write_text(text)
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr
    (cell,) = (tmp_path / "out" / "cells").iterdir()
    assert json.loads(cell.read_text())["plant"] == "powertrain"


def test_cells_of_a_sweep_have_files_of_their_own(here, tmp_path):
    """Whatever plants are called, and where logs of one name lie in folders of one name."""
    logs = []
    for folder in ("a/day", "b/day"):
        (tmp_path / folder).mkdir(parents=True)
        logs.append(write_csv(tmp_path / folder / "run.csv", drive()))
        logs[-1].write_text(logs[-1].read_text() + f"2.0,1.0,0.1,{1.0 + len(logs) / 10},0.1\n")
    plants = ["left/right", "n" * 300]
    named = "".join(
        f'[[plants]]\nname = "{name}"\ninput = "v_cmd"\noutput = "v"\n' for name in plants
    )
    (tmp_path / "plants.toml").write_text(named)
    runs = "".join(f'{{ log = "{log}", config = "plants.toml" }},' for log in logs)
    (tmp_path / "sweep.toml").write_text(
        f"[identify]\npoles = [1]\nzeros = [0]\n[sweep]\nruns = [{runs}]\n"
    )
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr
    cells = sorted((tmp_path / "out" / "cells").iterdir())
    assert len(cells) == 4
    assert {json.loads(cell.read_text())["plant"] for cell in cells} == set(plants)
    for cell in cells:  # what someone else has put there
        cell.write_text(json.dumps([1] if cell == cells[0] else {"key": "none"}))
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr


def test_a_refused_log_does_not_stop_a_sweep(here, tmp_path, settings):
    (tmp_path / "bad.csv").write_text("t,v_cmd,v,delta_cmd,delta\n0,1,oops,0,0\n")
    (tmp_path / "worse.csv").write_text("t,v_cmd,v\n0,worse,1\n")
    config = tmp_path / "sweep.toml"
    good = DEMO / "steering_steps.csv"
    config.write_text(
        "[identify]\npoles = [1, 2]\nzeros = [0, 1, 2]\n[sweep]\nruns = [\n"
        f'{{ log = "bad.csv", config = "{settings}", plants = ["powertrain", "steering"] }},\n'
        f'{{ log = "worse.csv", config = "{settings}", plants = ["powertrain"] }},\n'
        f'{{ log = "{good}", config = "{settings}", plants = ["steering"] }}]\n'
    )
    done = here("sweep", config, "--out", tmp_path / "out")
    assert done.returncode == 2
    each = done.stderr.splitlines()  # every reason once
    assert len(each) == 2 and "2 of 4 cells" in each[0] and "bad.csv" in each[0]
    assert "1 of 4 cells" in each[1] and "worse.csv" in each[1]
    rows = json.loads((tmp_path / "out" / "sweep.json").read_text())["cells"]
    assert all("refused" in row for row in rows[:3]) and rows[3]["fit"] > 80.0


def test_a_configuration_beside_the_log_says_which_orders(here, tmp_path, settings):
    (tmp_path / "log.csv").write_bytes((DEMO / "steering_steps.csv").read_bytes())
    vehicle = settings.read_text().split("[identify]")[0]
    (tmp_path / "vehicle.toml").write_text(vehicle + "[identify]\npoles = [1]\nzeros = [0]\n")
    (tmp_path / "sweep.toml").write_text('[sweep]\nruns = [{ log = "log.csv" }]\n')
    done = here("identify", tmp_path / "log.csv", "--out", tmp_path / "out", "--no-report")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "identify.json").read_text())
    assert list(found["plants"]["steering"]["orders"]) == ["P1Z0"]
    done = here("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "swept", "--no-report")
    (cell,) = (tmp_path / "swept" / "cells").glob("*steering.json")
    assert list(json.loads(cell.read_text())["orders"]) == ["P1Z0"]


@pytest.mark.parametrize("table", ["[select]\nwhere = 't > 5'", "[units]\nv = 'km/h'"])
def test_a_sweep_refuses_what_it_would_not_read(tmp_path, table):
    log = write_csv(tmp_path / "log.csv", drive())
    (tmp_path / "sweep.toml").write_text(f'{table}\n[sweep]\nruns = [{{ log = "{log}" }}]\n')
    with pytest.raises(InputError, match="config = "):
        plan(tmp_path / "sweep.toml", tmp_path / "out")


def test_a_log_that_changed_since_it_was_planned_is_no_old_result(tmp_path):
    log = write_csv(tmp_path / "log.csv", drive())
    (tmp_path / "vehicle.toml").write_text("[vehicle]\nl_f = 1.75\nl_r = 1.2\n")
    (tmp_path / "sweep.toml").write_text(f'[sweep]\nruns = [{{ log = "{log}" }}]\n')
    planned = plan(tmp_path / "sweep.toml", tmp_path / "out")
    write_csv(log, drive() | {"v": [0.5 * x for x in drive()["v"]]})
    assert "has changed since the sweep was planned" in planned[0].finish()["refused"]
    log.rename(tmp_path / "gone.csv")
    assert "cannot be read" in planned[0].finish()["refused"]
    (tmp_path / "gone.csv").rename(log)
    assert planned[0].key != plan(tmp_path / "sweep.toml", tmp_path / "out")[0].key
