"""What a user gives as a vehicle and as commands, made ready to be simulated."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from vdmsi_jax.data.record import Record
from vdmsi_jax.model_file import Model
from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.vehicle import Vehicle


def as_vehicle(given: Vehicle | Model) -> Vehicle:
    """A vehicle; of a model the one that it describes.

    Raises:
        TypeError: it is neither.
        InputError: the model lacks the geometry.
    """
    if isinstance(given, Model):
        return given.to_vehicle()
    if not isinstance(given, Vehicle):
        mend = "give a Vehicle or a Model"
        if isinstance(given, Sequence):
            mend = "give one, or simulate_many those that stack_vehicles makes one of"
        raise TypeError(f"{_kind(given)} is no vehicle; {mend}")
    if given.powertrain is None or given.steering is None:  # `eqx.tree_at` left it so
        given = dataclasses.replace(given)
    return jax.tree.map(_array, given)


def _array(leaf: Any) -> Any:
    """A number that `eqx.tree_at` put into a vehicle as an array: as it is, each other one would be
    another program."""
    plain = eqx.is_array_like(leaf) and not eqx.is_array(leaf)
    return jnp.asarray(leaf, float) if plain else leaf


def as_commands(given: Commands | Record, *, many: bool = False) -> Commands:
    """Commands; of a record its own.

    Args:
        given: by a user.
        many: whether they may have a leading axis.

    Raises:
        TypeError: it is neither, as a track is.
        ValueError: they are those of many drives, where one is asked for.
        InputError: the record has gaps or lacks a command.
    """
    if isinstance(given, Record):
        return Commands.of(given)
    if not isinstance(given, Commands):
        mend = "give Commands or a Record; a track has some: track.commands(bicycle, speed=...)"
        if isinstance(given, Sequence):
            mend = (
                "give one, or simulate_many those of equal length as one Commands, whose v_cmd and "
                "delta_cmd have a leading axis"
            )
        raise TypeError(f"{_kind(given)} is no record of commands; {mend}")
    if not many and given.v_cmd.ndim > 1:
        problem = f"commands of shape {given.v_cmd.shape} are those of many drives"
        raise ValueError(f"{problem}; use simulate_many, or jax.vmap")
    return given


def refuse_other(name: str, given: Any, kind: type, mend: str) -> None:
    """Refuse an argument that is of another kind.

    Raises:
        TypeError: it is, as the class in place of an object of it.
    """
    if not isinstance(given, kind):
        raise TypeError(f"{name} = {given!r} is none; give {mend}")


def _kind(given: Any) -> str:
    return type(given).__name__
