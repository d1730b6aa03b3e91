"""The pose as a quadrature of known functions of time: the fast path."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from vdmsi_jax.models.commands import Commands
from vdmsi_jax.models.vehicle import Vehicle
from vdmsi_jax.simulate._nouns import (
    AbstractMethod,
    Responses,
    Start,
    Trajectory,
    respond,
    trajectory,
)

_SHORTEST = 1e-9  # of a sample, that a piece takes at least: both actuators may jump at one instant


class Quadrature(AbstractMethod):
    """Gauss-Legendre quadrature inside each sample, on the exact responses of the actuators.

    Speed and angle of a kinematic vehicle do not depend on its pose, so the heading and then the
    position are integrals of known smooth functions. A transport delay makes the command jump
    inside a sample: the sample is split there, so that no rule straddles a jump.

    Use it for everything smooth; the error is of the order 2 `nodes` in the sample period, and
    with three nodes nanometres after 40 s at 100 Hz. `RateLimited` has kinks inside samples and is
    exact under `Arcs` only (here a kink costs about a fiftieth of a millimetre). It is the method
    that takes every effect; an `ExtendedPlant` is as exact as its sub-steps.
    """

    nodes: int = eqx.field(static=True, default=3)

    def __check_init__(self):
        if self.nodes < 1:
            raise ValueError(f"give at least one node, not {self.nodes}")

    def __call__(self, vehicle: Vehicle, commands: Commands, start: Start) -> Trajectory:
        """The trajectory; arguments as in `simulate`."""
        responses = respond(vehicle, commands, start)
        edges = piece_edges(vehicle, commands.dt)
        lengths = jnp.diff(edges)
        at, weights, within = _rule(self.nodes)
        tau = (edges[:-1, None] + lengths[:, None] * at).reshape(-1)

        v = responses.powertrain.at(tau)[:-1] + responses.surplus
        delta, r = responses.steering.at(tau)[:-1], None
        if vehicle.effects:
            v, beta, curvature = vehicle.over_ground(v, delta)
            cosine, sine = jnp.cos(beta), jnp.sin(beta)
            if vehicle.acts_at("relaxed"):
                curvature, r = _relaxed(vehicle, responses, v, curvature, tau, commands.dt)
        else:
            cosine, sine, curvature = vehicle.bicycle.course(delta)
        turned = v * curvature @ _to_nodes(lengths, within)
        weights = (lengths[:, None] * weights).reshape(-1)
        heading = accumulate((v * curvature) @ weights, start.psi)
        psi = heading[:-1, None] + turned
        ahead, aside = jnp.cos(psi), jnp.sin(psi)
        x = accumulate((v * (ahead * cosine - aside * sine)) @ weights, start.x)
        y = accumulate((v * (aside * cosine + ahead * sine)) @ weights, start.y)
        return trajectory(vehicle, commands, responses, x, y, heading, r)


def _relaxed(
    vehicle: Vehicle,
    responses: Responses,
    v: Float[Array, "K J"],
    curvature: Float[Array, "K J"],
    tau: Float[Array, " J"],
    dt: Float[Array, ""],
) -> tuple[Float[Array, "K J"], Float[Array, " N"]]:
    """Curvature at the nodes and yaw rate at the rows, with the memory of the way, which goes from
    row to node to node to row."""
    speed, _, bend = vehicle.over_ground(responses.v, responses.delta)

    def in_time(rows: Array, nodes: Array) -> Array:
        return jnp.append(jnp.column_stack([rows[:-1], nodes]).reshape(-1), rows[-1])

    v, curvature = in_time(speed, v), in_time(bend, curvature)
    between = jnp.diff(tau, prepend=0.0, append=dt)
    steps = jnp.tile(jnp.roll(between, 1), speed.shape[0] - 1)
    steps = jnp.append(steps, between[-1]) + _SHORTEST * dt  # a floor would have no slope
    curvature = vehicle.relaxed(curvature, v, steps)
    every = tau.shape[0] + 1
    return curvature[:-1].reshape(-1, every)[:, 1:], speed * curvature[::every]


def piece_edges(vehicle: Vehicle, dt: Float[Array, ""]) -> Float[Array, " edges"]:
    """Instants within a sample, ascending from 0 to `dt`, between which all responses are
    smooth."""
    jumps = [plant.jump(dt) for plant in (vehicle.powertrain, vehicle.steering)]
    inner = [jump for jump in jumps if jump is not None]
    return jnp.stack([jnp.zeros_like(dt), *(jnp.sort(jnp.stack(inner)) if inner else []), dt])


def accumulate(increments: Float[Array, " K"], start: Float[Array, ""]) -> Float[Array, " N"]:
    """Running sum from `start`, the start included."""
    return jnp.concatenate([start[None], start + jnp.cumsum(increments)])


def _to_nodes(lengths: Array, within: np.ndarray) -> Float[Array, "PJ PJ"]:
    """Matrix from values at all nodes of a sample to their integral from the row to each node:
    all of the pieces before, and the part of its own."""
    pieces, nodes = lengths.shape[0], within.shape[0]
    weights = _rule(nodes)[1]
    whole = np.kron(np.triu(np.ones((pieces, pieces)), 1), np.outer(weights, np.ones(nodes)))
    part = np.kron(np.eye(pieces), within.T)
    return jnp.repeat(lengths, nodes)[:, None] * (whole + part)


def _rule(nodes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1], and the matrix of integrals from 0 to each node
    of the polynomial through the values at the nodes (that of the Gauss collocation method)."""
    at, weights = legendre.leggauss(nodes)
    basis = legendre.legvander(at, nodes - 1)
    integrals = np.stack(
        [legendre.legval(at, legendre.legint(row, lbnd=-1)) for row in np.eye(nodes)], axis=1
    )
    return 0.5 * (at + 1.0), 0.5 * weights, 0.5 * integrals @ np.linalg.inv(basis)
