"""The verb: one vehicle or many, one record of commands or many, with the same code."""

import equinox as eqx
import jax
from jax import lax

from vdmsi_jax.data.record import Record
from vdmsi_jax.model_file import Model
from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate._arcs import Arcs, no_arcs
from vdmsi_jax.simulate._batched import batched
from vdmsi_jax.simulate._given import as_commands, as_vehicle, refuse_other
from vdmsi_jax.simulate._nouns import AbstractMethod, Start, Trajectory
from vdmsi_jax.simulate._quadrature import Quadrature


def simulate(
    vehicle: Vehicle | Model,
    commands: Commands | Record,
    start: Start | None = None,
    *,
    method: AbstractMethod | None = None,
) -> Trajectory:
    """Drive `vehicle` by `commands` and say where it goes.

    Compiled at the first call for a length of record and a kind of vehicle. Pure: it runs under
    `jax.vmap`, and has both modes of differentiation with respect to every number in its arguments
    (with `Solver`, those that its adjoint has).

    Args:
        vehicle: VDM, VDM-SI, or one with effects; a model is the vehicle that it describes.
        commands: held between the rows; a record without gaps gives its own.
        start: state at the first row; at the origin, heading along x, if `None`.
        method: `Quadrature()`, `Arcs()` or `Solver()`; `None` for the fastest that suits,
            which is `Arcs` where the steering is followed at once (and no effect bends the arcs)
            and `Quadrature` otherwise (with its error where a response has kinks, as under a
            `RateLimited` steering).

    Returns:
        The trajectory at the rows. A failure does not raise; it stands in its `status`.

    Raises:
        ValueError: the method does not suit the vehicle, or the commands are those of many drives.
        TypeError: what is given as vehicle, commands (as a track), start or method is none.
        InputError: the record has gaps or lacks a command, or the model lacks the geometry.
    """
    vehicle, commands = as_vehicle(vehicle), as_commands(commands)
    start = _started(start, method)
    if method is None:
        method = Arcs() if no_arcs(vehicle) is None else Quadrature()
    return _run(vehicle, commands, start, method)


def _started(start: Start | None, method: AbstractMethod | None) -> Start:
    """The start, once it and the method are what they are taken for."""
    start = Start() if start is None else start
    refuse_other("start", start, Start, "Start(x, y, psi), or None for the origin")
    if method is not None:
        refuse_other("method", method, AbstractMethod, "Quadrature(), Arcs(), Solver() or None")
    return start


@eqx.filter_jit
def _run(vehicle: Vehicle, commands: Commands, start: Start, method: AbstractMethod) -> Trajectory:
    return method(vehicle, commands, start)


def simulate_many(
    vehicles: Vehicle | Model,
    commands: Commands | Record,
    start: Start | None = None,
    *,
    method: AbstractMethod | None = None,
    batch_size: int | None = None,
) -> Trajectory:
    """`simulate` over many vehicles, many records of commands, or both pairwise.

    Whatever has a leading axis is batched, the rest is shared: vehicles by `stack_vehicles` or
    `eqx.filter_vmap`, or a single number of one (`eqx.tree_at` puts K of them there), commands of
    the shape `(K, N)` whose `dt` and the like have none or `(K,)`, starts of the shape `(K,)`.
    Batches of `batch_size` keep the memory small, and on a CPU are faster than one `jax.vmap` over
    thousands.

    Args:
        vehicles: one or K; a model is the one vehicle that it describes.
        commands: one record or K, of equal length; a `Record` is one.
        start: one or K.
        method: as in `simulate`.
        batch_size: lanes at once; without it 50 on a CPU and 10 000 on an accelerator
            (`benchmarks/accelerator.py`).

    Returns:
        Trajectories with a leading axis of K.

    Raises:
        ValueError: nothing is batched, or batches differ in length.
        TypeError, InputError: as in `simulate`, and of lists, which have to be stacked.
    """
    parts = as_vehicle(vehicles), as_commands(commands, many=True), _started(start, method)
    return _run_many(*parts, method, batch_size)


@eqx.filter_jit
def _run_many(
    vehicles: Vehicle,
    commands: Commands,
    start: Start,
    method: AbstractMethod | None,
    batch_size: int | None,
) -> Trajectory:
    parts = (vehicles, commands, start)
    arrays, static = eqx.partition(parts, eqx.is_array)
    mapped, shared = eqx.partition(arrays, batched(*arrays))
    lengths = {leaf.shape[0] for leaf in jax.tree.leaves(mapped)}
    if not lengths:
        mend = "stack_vehicles, give K records of commands, or use simulate"
        raise ValueError(f"nothing has a leading axis, and so no batch length; {mend}")
    if len(lengths) != 1:
        raise ValueError(f"vehicles, commands and start need one batch length; got {lengths}")

    def one(lane: tuple) -> Trajectory:
        return simulate(*eqx.combine(lane, shared, static), method=method)

    if batch_size is None:
        batch_size = 50 if jax.default_backend() == "cpu" else 10_000
    return lax.map(one, mapped, batch_size=batch_size)
