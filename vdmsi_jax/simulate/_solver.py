"""Eq. (5) and (6) as they stand, by a diffrax solver: the oracle, and the path for everything
else."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from vdmsi_jax.models.bicycle import BicycleState
from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.linear_plant import LinearPlant
from vdmsi_jax.models.vehicle import SpeedInput, Vehicle
from vdmsi_jax.simulate._nouns import (
    RESULTS,
    AbstractMethod,
    Start,
    Trajectory,
    finite_or,
    yaw_rate,
)
from vdmsi_jax.simulate._quadrature import piece_edges


class _State(NamedTuple):
    """What is integrated: the bicycle, and the states of both plants."""

    bicycle: BicycleState
    powertrain: Float[Array, " n"]
    steering: Float[Array, " m"]


class _Held(NamedTuple):
    """The commands that act on the plants now, or in each piece of each sample."""

    v_cmd: Array
    delta_cmd: Array


class _Model(eqx.Module):
    """Eq. (5) of both plants and eq. (6), while the commands are held."""

    vehicle: Vehicle
    powertrain: LinearPlant
    steering: LinearPlant

    def derivative(self, t: Any, state: _State, held: _Held) -> _State:
        """The vector field."""
        v, a, delta = self.inputs(state, held)
        return _State(
            self.motion(state.bicycle._replace(v=v), a, delta),
            _flow(self.powertrain, state.powertrain, held.v_cmd),
            _flow(self.steering, state.steering, held.delta_cmd),
        )

    def motion(self, bicycle: BicycleState, a: Array, delta: Array) -> BicycleState:
        """Eq. (6), or what effects of the vehicle make of it."""
        if not self.vehicle.effects:
            return self.vehicle.bicycle.derivatives(bicycle, a, delta)
        v, beta, curvature = self.vehicle.over_ground(bicycle.v, delta)
        course = bicycle.psi + beta
        return BicycleState(v * jnp.cos(course), v * jnp.sin(course), v * curvature, a)

    def inputs(self, state: _State, held: _Held) -> tuple[Array, Array, Array]:
        """Speed, acceleration and road-wheel angle."""
        flow = _flow(self.powertrain, state.powertrain, held.v_cmd)
        a = self.powertrain.system.C @ flow
        v = _output(self.powertrain, state.powertrain, held.v_cmd)
        if self.vehicle.speed_input is SpeedInput.ACCELERATION:
            v = state.bicycle.v
        return v, a, _output(self.steering, state.steering, held.delta_cmd)

    def start(self, start: Start, held: _Held, duration: Array) -> _State:
        """The state at the first row."""
        powertrain, steering = start.powertrain, start.steering
        if powertrain is None:
            powertrain = self.powertrain.initial_state(held.v_cmd, duration)
        if steering is None:
            steering = self.steering.initial_state(held.delta_cmd, duration)
        v = _output(self.powertrain, powertrain, held.v_cmd) if start.v is None else start.v
        return _State(BicycleState(start.x, start.y, start.psi, v), powertrain, steering)

    def jumped(self, state: _State, before: _Held, now: _Held) -> _State:
        """The state after a jump of the commands: a feed-through makes the speed jump with them."""
        v = state.bicycle.v + self.powertrain.system.D * (now.v_cmd - before.v_cmd)
        return state._replace(bicycle=state.bicycle._replace(v=v))

    def channels(self, state: _State, held: _Held) -> tuple[Array, ...]:
        """x, y, psi, v, delta, r and a."""
        v, a, delta = self.inputs(state, held)
        x, y, psi, _ = state.bicycle
        return x, y, psi, v, delta, yaw_rate(self.vehicle, v, delta), a

    def acting(self, commands: Commands, edges: Float[Array, " edges"]) -> _Held:
        """The commands `(N, pieces)` in the middle of each piece, looked up by its time."""
        middle = 0.5 * (edges[1:] + edges[:-1])
        rows = jnp.arange(commands.v_cmd.shape[0])
        told = []
        for plant, u in (
            (self.powertrain, commands.v_cmd),
            (self.steering, commands.delta_cmd),
        ):
            since = middle if plant.delay is None else middle - plant.delay
            late = jnp.floor(since / commands.dt).astype(int)
            told.append(u[jnp.clip(rows[:, None] + late, 0, rows.shape[0] - 1)])
        return _Held(*told)


def _flow(plant: LinearPlant, x: Array, u: Array) -> Array:
    return plant.system.A @ x + plant.system.B * u


def _output(plant: LinearPlant, x: Array, u: Array) -> Array:
    return plant.shift(plant.system.C @ x + plant.system.D * u)


def _controller(
    given: diffrax.AbstractStepSizeController | None,
) -> diffrax.AbstractStepSizeController:
    return diffrax.PIDController(rtol=1e-10, atol=1e-10) if given is None else given


class Solver(AbstractMethod):
    """One diffrax solve per sample, with the held commands as its arguments.

    No solve straddles an instant at which a command jumps: a sample with a delayed jump inside is
    solved in pieces. Nothing here is exact or shared with the fast path except the plants'
    coefficients; it checks that path, and takes whatever has no quadrature. Several times slower.

    Attributes:
        solver: any diffrax solver for ordinary differential equations.
        controller: `None` for a step-size control of 1e-10 relative and absolute.
        adjoint: `diffrax.RecursiveCheckpointAdjoint()` for reverse mode, `diffrax.ForwardMode()`
            for forward mode, `diffrax.DirectAdjoint()` for both.
        max_steps: of one solve; when they do not suffice, as for a very stiff plant, the status of
            the trajectory says so.
    """

    solver: diffrax.AbstractSolver = diffrax.Tsit5()
    controller: diffrax.AbstractStepSizeController = eqx.field(converter=_controller, default=None)
    adjoint: diffrax.AbstractAdjoint = diffrax.RecursiveCheckpointAdjoint()
    max_steps: int = eqx.field(static=True, default=256)

    def __call__(self, vehicle: Vehicle, commands: Commands, start: Start) -> Trajectory:
        """The trajectory; arguments as in `simulate`.

        Raises:
            ValueError: a plant is not linear, or an effect remembers the way.
        """
        if vehicle.acts_at("relaxed"):
            raise ValueError("Solver takes no effect that remembers the way; use Quadrature()")
        model = _Model(vehicle, vehicle.powertrain.to_plant(), vehicle.steering.to_plant())
        edges = piece_edges(vehicle, commands.dt)
        held = model.acting(commands, edges)
        rows = commands.v_cmd.shape[0]

        def over_a_piece(state: _State, span: Array, now: _Held) -> tuple[_State, Any]:
            solution = diffrax.diffeqsolve(
                diffrax.ODETerm(model.derivative),
                self.solver,
                t0=jnp.zeros_like(span),
                t1=span,
                dt0=span,
                y0=state,
                args=now,
                stepsize_controller=self.controller,
                adjoint=self.adjoint,
                max_steps=self.max_steps,
                throw=False,
            )
            ended = jax.tree.map(lambda leaf: leaf[-1], solution.ys)
            return ended, RESULTS.promote(solution.result)

        def over_a_sample(carry: tuple, told: _Held) -> tuple[tuple, tuple[Array, ...]]:
            state, before, status = carry
            row = None
            for piece in range(edges.shape[0] - 1):
                now = _Held(told.v_cmd[piece], told.delta_cmd[piece])
                state = model.jumped(state, before, now)
                row = model.channels(state, now) if row is None else row
                state, result = over_a_piece(state, edges[piece + 1] - edges[piece], now)
                status = RESULTS.where(status == RESULTS.successful, result, status)
                before = now
            assert row is not None
            return (state, before, status), row

        first = _Held(held.v_cmd[0, 0], held.delta_cmd[0, 0])
        begin = model.start(start, first, rows * commands.dt)
        (_, _, status), channels = lax.scan(over_a_sample, (begin, first, RESULTS.successful), held)
        t = commands.t0 + commands.dt * jnp.arange(rows)
        return Trajectory(t, *channels, status=finite_or(status, channels))
