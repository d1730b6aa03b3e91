"""Pure pursuit: the steering angle that brings a vehicle back to its path.

Coulter, *Implementation of the Pure Pursuit Path Tracking Algorithm*, CMU-RI-TR-92-01, 1992.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

_BEYOND = 1e3  # m, by which a path goes on straight at its end


class PurePursuit(eqx.Module):
    """Steer the rear axle along the arc through a goal point that runs ahead on the path.

    The goal is where the path, from its point nearest to the rear axle on, leaves the circle of the
    lookahead distance around it; the arc that is tangent to the body and meets the goal has the
    curvature `2 sin(alpha) / lookahead`, with `alpha` the bearing of the goal. From farther away
    than the lookahead distance the goal is the nearest point.

    It keeps no state, and is as well called with NumPy numbers as under `jit`, `vmap` and `grad`.
    Since the nearest point is sought on the whole path, give a path that crosses itself in parts.

    Attributes:
        path: points of the path in driving order, none twice, m. Beyond its end the path goes on
            straight.
        wheelbase: distance between the axles, m.
        rear_to_reference: how far the point whose pose is given lies ahead of the rear axle, m:
            `l_r` for the centre of gravity.
        lookahead_time: s of driving to look ahead.
        lookahead_min: m to look ahead at least.
        limit: greatest angle that is asked for, rad.
    """

    path: Float[Array, "M 2"] = eqx.field(converter=jnp.asarray)
    wheelbase: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    rear_to_reference: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)
    lookahead_time: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.7)
    lookahead_min: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=2.5)
    limit: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.6)

    def __check_init__(self):
        if self.path.ndim != 2 or self.path.shape[0] < 2 or self.path.shape[1] != 2:
            raise ValueError(f"a path has shape (M, 2) with M of 2 or more, not {self.path.shape}")

    def __call__(self, pose: Float[ArrayLike, "3"], v: Float[ArrayLike, ""]) -> Float[Array, ""]:
        """Steering command, road-wheel angle in rad, at a pose (x and y in m, psi in rad) of the
        reference point and a speed in m/s."""
        pose = jnp.asarray(pose)
        heading = jnp.stack([jnp.cos(pose[2]), jnp.sin(pose[2])])
        rear = pose[:2] - self.rear_to_reference * heading
        lookahead = jnp.maximum(self.lookahead_time * jnp.asarray(v), self.lookahead_min)
        way = self.goal(rear, lookahead) - rear
        across = heading[0] * way[1] - heading[1] * way[0]
        # sin(alpha) is across / |way|, and |way| the lookahead unless the path is farther away
        curvature = 2.0 * across / jnp.maximum(way @ way, 1e-12)
        return jnp.clip(jnp.arctan(self.wheelbase * curvature), -self.limit, self.limit)

    def goal(
        self, point: Float[ArrayLike, "2"], lookahead: Float[ArrayLike, ""]
    ) -> Float[Array, "2"]:
        """The point of the path to head for from `point` (m), `lookahead` metres away."""
        point, lookahead = jnp.asarray(point), jnp.asarray(lookahead)
        begin, side, length, foot = self._nearest(point)
        away = jnp.linalg.norm(begin + side * length[:, None] - point, axis=1)
        distance = jnp.sum((begin + side * foot[:, None] - point) ** 2, axis=1)
        near = jnp.argmin(distance)
        index = jnp.arange(begin.shape[0])
        leaving = jnp.argmax((index >= near) & (away >= lookahead))
        to_begin = begin[leaving] - point
        along = -to_begin @ side[leaving]
        apart = to_begin @ to_begin - along**2
        reach = along + jnp.sqrt(jnp.maximum(lookahead**2 - apart, 1e-24))
        least = jnp.where(leaving == near, foot[near], 0.0)
        return begin[leaving] + jnp.clip(reach, least, length[leaving]) * side[leaving]

    def progress(self, point: Float[ArrayLike, "2"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Distance along the path of the point nearest to `point`, and how far `point` lies to the
        left of the path there, m."""
        point = jnp.asarray(point)
        begin, side, length, foot = self._nearest(point)
        off = point - begin - side * foot[:, None]
        near = jnp.argmin(jnp.sum(off**2, axis=1))
        before = jnp.cumsum(length)[near] - length[near]
        left = side[near, 0] * off[near, 1] - side[near, 1] * off[near, 0]
        return before + foot[near], left

    def _nearest(self, point: Array) -> tuple[Array, Array, Array, Array]:
        """Of every side of the path, its begin, direction, length, and how far from its begin it is
        nearest to `point`."""
        last = self.path[-1] - self.path[-2]
        beyond = self.path[-1] + _BEYOND * last / jnp.linalg.norm(last)
        vertices = jnp.concatenate([self.path, beyond[None]])
        begin, way = vertices[:-1], jnp.diff(vertices, axis=0)
        length = jnp.linalg.norm(way, axis=1)
        side = way / length[:, None]
        foot = jnp.clip(jnp.sum((point - begin) * side, axis=1), 0.0, length)
        return begin, side, length, foot
