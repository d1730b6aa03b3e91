"""Whether logs can tell something of an actuator."""

from collections.abc import Sequence

import numpy as np

from ..config import DEFAULT_PLANTS, PlantSpec
from ..errors import InputError
from .record import Record


def check_excitation(record: Record, plant: PlantSpec) -> None:
    """Refuse a record from which nothing can be learnt about a plant.

    Args:
        record: the record.
        plant: which channel answers to which.

    Raises:
        InputError: a channel is not there, the command never changes, or the response is zero or
            constant throughout.
    """
    command, response = record[plant.input], record[plant.output]
    if np.ptp(command) <= 1e-12 * np.abs(command).max():
        problem = f"the command of {plant.name} is {command[0]:g} in all {record.n} samples"
        mend = "record a run in which it changes, or name another input"
        raise InputError(record.source, plant.input, problem, mend)
    if not response.any():
        problem = f"the response of {plant.name} is zero in all {record.n} samples"
        mend = "check that the sensor was logged, or name another output"
        raise InputError(record.source, plant.output, problem, mend)
    if np.ptp(response) <= 1e-12 * np.abs(response).max():
        problem = f"the response of {plant.name} is {response[0]:g} in all {record.n} samples"
        mend = "check the sensor, or name another output"
        raise InputError(record.source, plant.output, problem, mend)


def uncommanded(records: Sequence[Record], plants: Sequence[PlantSpec]) -> list[str]:
    """Actuators of which the response was logged and the command was not, in words."""
    asked = {plant.output for plant in plants}
    return [
        f"The {own.name} was not looked at: {own.output} was logged, and its command {own.input} "
        "was not, or by another name: give its column in [columns]."
        for own in DEFAULT_PLANTS
        if own.output not in asked
        and all(own.output in r and own.input not in r for r in records)
        and records[0].vehicle is not None
    ]
