"""A plant with causes in it: a transfer function and a tuple of effects at its ports."""

import dataclasses
from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Bool, Float

from vdmsi_jax.effects.base import BODY, AbstractEffect, Effort, Signals, late, several
from vdmsi_jax.models.linear_plant import LinearPlant
from vdmsi_jax.models.observer_form import ahead_of, led, ramp_lag, slowness_of, steps_of
from vdmsi_jax.models.plant import AbstractPlant, AbstractTrace, PlantResponse
from vdmsi_jax.models.state_space import StateSpace, propagate
from vdmsi_jax.models.transfer_function import TransferFunction
from vdmsi_jax.parameters import floats

_TOGETHER = 5  # effects that are passed by at once
_FORCES = 2  # likewise of those inside the dynamics


class ExtendedTrace(AbstractTrace):
    """A response known at sub-steps, and linear between them."""

    y: Float[Array, " M"]  # at the sub-steps of all rows and at the end of the last
    h: Float[Array, ""]
    substeps: int = eqx.field(static=True)

    def rows(self) -> PlantResponse:
        """The response at the rows; its rate is the mean over the first sub-step. What the effects
        remember at the end is no state that another record could be started from."""
        now, then = self._pieces()
        return PlantResponse(now[:, 0], (then - now)[:, 0] / self.h, None)

    def at(self, tau: Float[Array, " J"]) -> Float[Array, "N J"]:
        """Response `tau` seconds after each row, `0 <= tau < dt`."""
        now, then = self._pieces()
        steps = tau / self.h
        whole = jnp.clip(jnp.floor(steps).astype(int), 0, self.substeps - 1)
        before = now[:, whole]
        return before + (steps - whole) * (then[:, whole] - before)

    def travelled(self) -> Float[Array, " N"]:
        """Integral of the response over the sample that follows each row."""
        now, then = self._pieces()
        return 0.5 * self.h * jnp.sum(now + then, axis=1)

    def _pieces(self) -> tuple[Float[Array, "N s"], Float[Array, "N s"]]:
        """The response at both ends of each sub-step."""
        return self.y[:-1].reshape(-1, self.substeps), self.y[1:].reshape(-1, self.substeps)


class ExtendedPlant(AbstractPlant):
    """An actuator with what a linear one lacks: play, friction, limits, a road that rises.

    Use it for a cause that a diagnosis found, or to try one out; without effects it is the transfer
    function itself, only slower. It is not linear in general, so `simulate` takes it by
    `Quadrature`. The port `sensor` of its effects plays no part: what a sensor adds does not move
    the vehicle. Effects of body and road are refused (ValueError): a `Vehicle` takes them.

    Attributes:
        plant: the linear part. Its delay acts on the command before the effects at the port `held`,
            exactly where it is a multiple of a sub-step; its offset acts last.
        effects: one or several, in the order in which they act, that of
            `vdmsi_jax.effects.ACTUATOR`.
        leads: see `Signals.leads`, s and s^2.
        substeps: steps a row, for effects with memory.
        told: what the other actuator and the speed do, a value each row; its `slowness`, `leads`,
            `h` and `substeps` are not read, since they are the plant's own. `None` where there is
            nothing to tell; the simulation of a vehicle tells its actuators by itself.
    """

    plant: TransferFunction
    effects: tuple[AbstractEffect, ...] = eqx.field(converter=several)
    leads: Float[Array, "2"] = eqx.field(converter=floats, default=(0.0, 0.0))
    substeps: int = eqx.field(static=True, default=4)
    told: Signals | None = None

    def __check_init__(self):
        if self.substeps < 1:
            raise ValueError(f"give at least one sub-step a row, not {self.substeps}")
        for effect in self.effects:
            if frozenset() < effect.ports <= BODY:
                problem = f"{type(effect).__name__} acts on no actuator"
                raise ValueError(f"{problem}; give it to the effects of a Vehicle")

    def hearing(self, told: Signals | None) -> "ExtendedPlant":
        """The same plant, told what goes on around it."""
        return dataclasses.replace(self, told=told)

    def trace(
        self,
        u: Float[ArrayLike, " N"],
        dt: Float[ArrayLike, ""],
        x0: Float[Array, "*n"] | None = None,
    ) -> ExtendedTrace:
        """The motion under the commands `u`, held for `dt` seconds each.

        Args:
            u: commands; before the record the command was `u[0]`.
            dt: sample period, s.
            x0: state of the linear part at the first row; `None` for a start at rest.

        Raises:
            ValueError: what the plant was told has another number of rows, or `x0` another number
                of states.
        """
        u, dt = jnp.asarray(u, float), jnp.asarray(dt, float)
        linear, rows = self.plant.to_plant(), u.shape[0]
        if x0 is not None and x0.shape != linear.rest.shape:
            raise ValueError(f"the plant has states {linear.rest.shape}, and x0 has {x0.shape}")
        at_rest = linear.initial_state(jnp.ones(()), rows * dt)
        signals = self._signals(rows, dt)
        u = jnp.append(u, u[-1])  # one row more, where the last sample ends
        held = _at_substeps(self.effects, u, signals)
        if linear.delay is not None:
            held = late(held, linear.delay / signals.h)
        held = _through("held", self.effects, held, signals, None)
        y = _moved(linear.system, at_rest, self.effects, held, signals, start=x0)
        y = _through("output", self.effects, y, signals, None)
        y = _through("measured", self.effects, y, _by_substeps(signals), None)
        y = linear.shift(y)[: rows * self.substeps + 1]
        return ExtendedTrace(y, signals.h, self.substeps)

    def jump(self, dt: Float[ArrayLike, ""]) -> None:
        """The response is read between sub-steps, which straddle a jump without telling."""
        return None

    def to_plant(self, order: int | None = None) -> LinearPlant:
        """The linear part, where that is all. Raises ValueError if there are effects."""
        if self.effects:
            problem = "a plant with effects is not linear; simulate it with the method Quadrature()"
            raise ValueError(problem)
        return self.plant.to_plant(order)

    def _signals(self, rows: int, dt: Array) -> Signals:
        """What the effects look at, at the rows and one sample after the last."""
        nothing = jnp.zeros(rows)
        told = surroundings(nothing, nothing, dt) if self.told is None else self.told
        if told.t.shape[0] != rows:
            problem = f"the plant was told {told.t.shape[0]} rows and has {rows} commands"
            raise ValueError(f"{problem}; give `hearing` one value for each command")
        system = self.plant.to_plant().system
        pace = system.A[0, 1] if system.B.shape[0] > 1 else jnp.ones(())  # 1/s
        a = -system.A[:, 0] / pace
        b = system.B / pace + system.D * a
        leads = self.leads * pace ** jnp.arange(1.0, 3.0)
        return Signals(
            t=jnp.append(told.t, told.t[-1] + dt),
            v=jnp.append(told.v, told.v[-1]),
            other=jnp.append(told.other, told.other[-1]),
            distance=jnp.append(told.distance, told.distance[-1] + abs(told.v[-1]) * dt),
            slowness=slowness_of(a, b, pace, leads),
            leads=leads,
            h=dt / self.substeps,
            substeps=self.substeps,
            begun=told.begun,
        )


def surroundings(
    v: Float[Array, " N"],
    other: Float[Array, " N"],
    dt: Float[ArrayLike, ""],
    since: Float[ArrayLike, ""] = 0.0,
    session: Float[ArrayLike, ""] = 0.0,
    way: Float[ArrayLike, ""] = 0.0,
) -> Signals:
    """What an actuator of a vehicle is told.

    Args:
        v: speed at the rows, m/s.
        other: command of the other actuator.
        dt: sample period, s.
        since: time of the first row since the run began, s.
        session: time of the session at which the run began, s.
        way: travelled since the run began at the first row, m.
    """
    dt = jnp.asarray(dt, float)
    t = jnp.asarray(since, float) + dt * jnp.arange(v.shape[0])
    way = jnp.asarray(way, float) + jnp.append(0.0, jnp.cumsum(jnp.abs(v[:-1])) * dt)
    one, none, began = jnp.ones(()), jnp.zeros(2), jnp.asarray(session, float)[None]
    return Signals(t, v, other, way, one, none, dt, 1, begun=began)


def _by_substeps(signals: Signals) -> Signals:
    """The same signals at the sub-steps, each its own row: time goes on, the others are held."""
    s = signals.substeps
    within = signals.h * jnp.arange(s)
    held = {name: jnp.repeat(getattr(signals, name), s) for name in ("v", "other", "distance")}
    t = (signals.t[:, None] + within).reshape(-1)
    return dataclasses.replace(signals, t=t, **held, substeps=1)


def respond(
    system: StateSpace,
    rest: Float[Array, " n"],
    effects: tuple[AbstractEffect, ...],
    u: Float[Array, " N"],
    signals: Signals,
    on: Bool[Array, " effects"] | None = None,
    steps: tuple[Float[Array, "n n"], Float[Array, "n 2"]] | None = None,
    start: Float[Array, " n"] | None = None,
) -> Float[Array, " N"]:
    """What is measured at the rows of a plant with effects, started at rest under its first
    command.

    Args:
        system: the dynamics in observer form: the first state, and a feed-through, are the output.
        rest: state at rest per unit of a constant command.
        effects: in the order in which they act.
        u: commands at the rows.
        signals: what else the effects look at.
        on: which effects may be on; the work of the others is left out when the program runs. All
            where it is None.
        steps: `steps_of` the system, where they are known.
        start: state at the first row; at rest under the first command if None.
    """
    y = fine_response(system, rest, effects, u, signals, on, steps, start)[:: signals.substeps]
    return _through("measured", effects, y, signals, on)


def fine_response(
    system: StateSpace,
    rest: Float[Array, " n"],
    effects: tuple[AbstractEffect, ...],
    u: Float[Array, " N"],
    signals: Signals,
    on: Bool[Array, " effects"] | None = None,
    steps: tuple[Float[Array, "n n"], Float[Array, "n 2"]] | None = None,
    start: Float[Array, " n"] | None = None,
) -> Float[Array, " M"]:
    """`respond` at the sub-steps, the rows among them."""
    held = _through("held", effects, _at_substeps(effects, u, signals, on), signals, on)
    y = _moved(system, rest, effects, held, signals, on, start, steps)
    y = _through("output", effects, y, signals, on)
    return _through("sensor", effects, y, signals, on)


def _at_substeps(
    effects: tuple[AbstractEffect, ...],
    u: Float[Array, " N"],
    signals: Signals,
    on: Bool[Array, " effects"] | None = None,
) -> Float[Array, " M"]:
    """The commands behind the effects at the rows, held."""
    u = _through("command", effects, u, signals, on)
    return jnp.repeat(u, signals.substeps, total_repeat_length=u.shape[0] * signals.substeps)


def _moved(
    system: StateSpace,
    rest: Float[Array, " n"],
    effects: tuple[AbstractEffect, ...],
    held: Float[Array, " M"],
    signals: Signals,
    on: Bool[Array, " effects"] | None = None,
    start: Float[Array, " n"] | None = None,
    steps: tuple[Float[Array, "n n"], Float[Array, "n 2"]] | None = None,
) -> Float[Array, " M"]:
    """What the dynamics and the forces inside them make of the held command."""
    forced = [i for i, e in enumerate(effects) if "effort" in e.ports]
    loaded = [i for i, e in enumerate(effects) if "load" in e.ports]
    forces = tuple(effects[i] for i in forced)

    if steps is None:
        steps = steps_of(system, signals.leads, signals.h)

    def moved(forces: tuple[AbstractEffect, ...], which: Array | None, held: Array) -> Array:
        load = _load(effects, held, signals, on)
        return _dynamics(system, steps, rest, forces, held, signals, start, load, which)

    def free(held: Array) -> Array:
        first = rest * held[0] if start is None else start
        moving = propagate(steps[0], steps[1][:, 0], first, held)
        return moving.read(system.C[:, None])[:, 0] + system.D * held

    def pushed(held: Array) -> Array:  # linear in the command and in the load
        load = _load(effects, held, signals, on)
        under = rest if start is None else jnp.zeros_like(rest)
        first = load[0] * (under - ahead_of(system, signals.leads))
        lowered = propagate(steps[0], steps[1][:, 1], first, load)
        return free(held) - lowered.read(system.C[:, None])[:, 0]

    if on is None:  # bit for bit the same with forces that are off as without any
        return moved(forces, None, held)
    smooth = free
    if loaded:
        smooth = partial(lax.cond, jnp.any(on[np.array(loaded)]), pushed, free)
    if not forces:
        return smooth(held)
    # to ask in every sub-step which forces are on takes longer than all that most of them do, so
    # that those of one part have a loop of their own
    which = on[np.array(forced)]
    parts = [slice(k, k + _FORCES) for k in range(0, len(forces), _FORCES)]
    asked = jnp.stack([jnp.any(which[part]) for part in parts])
    alone = [partial(moved, forces[part], None) for part in parts]
    ways = [smooth, *alone, partial(moved, forces, which)]
    one, more = 1 + jnp.argmax(asked), len(ways) - 1
    number = jnp.sum(asked)
    return lax.switch(jnp.where(number > 1, more, jnp.where(number > 0, one, 0)), ways, held)


def _load(
    effects: tuple[AbstractEffect, ...],
    held: Float[Array, " M"],
    signals: Signals,
    on: Bool[Array, " effects"] | None,
) -> Float[Array, " M"]:
    """The forces that no motion changes."""
    total = jnp.zeros_like(held)
    for i, effect in enumerate(effects):
        if "load" in effect.ports:
            act = effect.load
            if on is None:
                total = total + act(signals)
            else:
                total = lax.cond(on[i], lambda x, act=act: x + act(signals), lambda x: x, total)
    return total


def _through(
    port: str,
    effects: tuple[AbstractEffect, ...],
    x: Float[Array, " M"],
    signals: Signals,
    on: Bool[Array, " effects"] | None,
) -> Float[Array, " M"]:
    """A signal behind the effects at its port. A choice that passes a signal on copies it, so that
    those that are off are passed by together, a few at a time."""
    acting = [i for i, effect in enumerate(effects) if port in effect.ports]
    for i in acting if on is None else ():
        x = getattr(effects[i], port)(x, signals)

    def through(some: list[int], x: Array) -> Array:
        if len(some) == 1:
            return getattr(effects[some[0]], port)(x, signals)
        size = 1 if len(some) <= _TOGETHER else _TOGETHER
        for start in range(0, len(some), size):
            x = chosen(some[start : start + size], x)
        return x

    def chosen(some: list[int], x: Array) -> Array:
        assert on is not None
        return lax.cond(jnp.any(on[np.array(some)]), partial(through, some), lambda x: x, x)

    return x if on is None or not acting else chosen(acting, x)


def _dynamics(
    system: StateSpace,
    steps: tuple[Float[Array, "n n"], Float[Array, "n 2"]],
    rest: Array,
    inside: tuple[AbstractEffect, ...],
    u: Float[Array, " M"],
    signals: Signals,
    x0: Float[Array, " n"] | None = None,
    load: Float[Array, " M"] | None = None,
    on: Bool[Array, " inside"] | None = None,
) -> Float[Array, " M"]:
    """The output at the start of each sub-step, with forces inside. The states are moved on by one
    sum of products, since a step costs by its pieces: scalars, each moved by its own, took a
    quarter more.

    Args:
        steps: of the system over a sub-step, for the command and for a force.
        x0: state at the start; at rest under the first command if None.
        load: forces that no motion changes; none of any kind act if None.
        on: which of those `inside` may be on, as in `respond`.
    """
    Ad, Bd, Fd = steps[0], steps[1][:, 0], steps[1][:, 1]
    gain = system.C @ system.A @ Bd + system.C @ system.B
    hold = system.C @ system.A @ Fd + system.C @ led(system.B, signals.leads)
    hold = jnp.where(jnp.abs(hold) > 1e-12, hold, 1e-12)
    level, slowness, h = rest[0] + system.D, signals.slowness, signals.h
    lag = ramp_lag(system, rest)
    ahead = jnp.vstack([Ad, system.C @ system.A @ Ad])  # to the states, and the output's rate
    driven = jnp.append(Bd, gain)

    def spend(forces: tuple, u: Array, y: Array, stuck: Array, rate: Array, total: Array) -> tuple:
        for effect in forces:
            spent = effect.effort(Effort(u, y, rate, hold, stuck, level, slowness, lag, h))
            rate, total = rate - hold * spent, total + spent
        return rate, total

    def step(carry: tuple, now: tuple[Array, Array | None]) -> tuple[tuple, Array]:
        (x, stuck), (u, push) = carry, now
        y = x[0] + system.D * u
        moved = jnp.sum(ahead * x, axis=1) + driven * u
        x, rate = moved[:-1], moved[-1]
        if push is None:
            return (x, stuck), y
        rate = rate - hold * push
        total = push
        for k in range(0, len(inside), _FORCES):
            part = slice(k, k + _FORCES)
            act = partial(spend, inside[part], u, y, stuck)
            if on is None:
                rate, total = act(rate, total)
            else:  # far more work than to ask
                rate, total = lax.cond(jnp.any(on[part]), act, lambda *x: x, rate, total)
        stuck = jnp.where(jnp.abs(rate) < 1e-9 * jnp.abs(hold), 1.0, 0.0)
        return (x - Fd * total, stuck), y

    first = rest * u[0] if x0 is None else x0
    if load is not None:  # at rest under the force, too, which `x0` has as part of the command
        under = rest if x0 is None else jnp.zeros_like(rest)
        first = first - load[0] * (under - ahead_of(system, signals.leads))
    return lax.scan(step, (first, jnp.zeros(())), (u, load))[1]
