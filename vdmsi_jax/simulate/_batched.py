"""Which arrays of vehicles, commands and starts have a leading axis, one entry for each lane."""

import dataclasses
from typing import Any, get_args

import jax
from jax.tree_util import GetAttrKey, SequenceKey

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate._nouns import Start


def batched(vehicles: Vehicle, commands: Commands, start: Start) -> tuple[Any, Any, Any]:
    """For every array of the three whether it has more dimensions than that of a single one.

    What does not say how many that has (a number of somebody's own plant, say) is batched where
    the geometry is.
    """

    def of_vehicle(path: tuple, leaf: Any) -> bool:
        single = _annotated(vehicles, path)
        return vehicles.bicycle.l_f.ndim > 0 if single is None else leaf.ndim > single

    def of_drive(path: tuple, leaf: Any) -> bool:
        return leaf.ndim > (path[-1].name in ("v_cmd", "delta_cmd", "powertrain", "steering"))

    own = jax.tree.map_with_path(of_vehicle, vehicles)
    return own, *(jax.tree.map_with_path(of_drive, part) for part in (commands, start))


def _annotated(module: Any, path: tuple) -> int | None:
    """Dimensions of an array in a module by the annotation of its field; None where that is
    open."""
    *way, last = path
    for key in way:
        if isinstance(key, GetAttrKey):
            module = getattr(module, key.name)
        elif isinstance(key, SequenceKey):
            module = module[key.idx]
        else:
            return None
    if not isinstance(last, GetAttrKey):
        return None
    kind = next(field.type for field in dataclasses.fields(module) if field.name == last.name)
    told = [getattr(own, "dim_str", None) for own in (kind, *get_args(kind))]
    dims = [shape.split() for shape in told if shape is not None]
    if len(dims) != 1 or any("*" in dim or "..." in dim for dim in dims[0]):
        return None
    return len(dims[0])
