"""How far a simulation is from a measurement: per channel, and on the road.

Everything up to the relative error is JAX, so an error can be differentiated with respect to the
parameters of the vehicle that made it. Poses are arrays of the columns x (m), y (m), psi (rad).
"""

import enum
import io
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .files import write_text


class Alignment(enum.Enum):
    """How an estimated path is laid on the true one before they are compared."""

    NONE = "as it is"
    START = "moved and turned so that the first poses coincide, as in the paper"
    SE2 = "moved and turned for the least squared distance (Umeyama 1991 without scale)"


def fit(y: Float[ArrayLike, " N"], y_hat: Float[ArrayLike, " N"]) -> Float[Array, ""]:
    """FIT of eq. (3), percent: 100 is perfect, 0 no better than the mean of `y`, and there is no
    lower bound. `-inf` where `y` does not vary."""
    y, y_hat = jnp.asarray(y, float), jnp.asarray(y_hat, float)
    return 100.0 * (1.0 - jnp.linalg.norm(y - y_hat) / jnp.linalg.norm(y - jnp.mean(y)))


def mse(y: Float[ArrayLike, " N"], y_hat: Float[ArrayLike, " N"]) -> Float[Array, ""]:
    """Mean squared error of eq. (4), in the squared unit of the channel."""
    return jnp.mean((jnp.asarray(y, float) - jnp.asarray(y_hat, float)) ** 2)


def aligned(
    truth: Float[ArrayLike, "N 3"], estimate: Float[ArrayLike, "N 3"], alignment: Alignment
) -> Float[Array, "N 3"]:
    """The poses of `estimate`, moved and turned as a whole.

    Raises:
        ValueError: the arrays are not poses of one length.
    """
    truth, estimate = jnp.asarray(truth, float), jnp.asarray(estimate, float)
    if truth.ndim != 2 or truth.shape[1] != 3 or truth.shape != estimate.shape:
        raise ValueError(
            "truth and estimate need one shape (N, 3) of columns x, y, psi; "
            f"got {truth.shape} and {estimate.shape}"
        )
    if alignment is Alignment.NONE:
        return estimate
    if alignment is Alignment.START:
        centre, target = estimate[0, :2], truth[0, :2]
        turn = truth[0, 2] - estimate[0, 2]
    else:
        centre, target = jnp.mean(estimate[:, :2], 0), jnp.mean(truth[:, :2], 0)
        p, q = estimate[:, :2] - centre, truth[:, :2] - target
        turn = turn_between(p, q)
    c, s = jnp.cos(turn), jnp.sin(turn)
    position = (estimate[:, :2] - centre) @ jnp.array([[c, s], [-s, c]]) + target
    return jnp.concatenate([position, estimate[:, 2:] + turn], axis=1)


def turn_between(p, q, xp=jnp):
    """The angle about the origin, rad, that brings the positions `p`, (N, 2), closest to `q`, in
    squares (Horn, J. Opt. Soc. Am. A 4, 1987, in the plane)."""
    return xp.arctan2(xp.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), xp.sum(p * q))


def translation_error(
    truth: Float[ArrayLike, "N 3"], estimate: Float[ArrayLike, "N 3"], alignment: Alignment
) -> Float[Array, " N"]:
    """Distance between both positions at each row, m. Its derivative is zero where they
    coincide."""
    apart = jnp.asarray(truth, float) - aligned(truth, estimate, alignment)
    squared = jnp.sum(apart[:, :2] ** 2, axis=1)
    met = squared == 0.0  # at an anchored start the distance is at its kink
    return jnp.where(met, 0.0, jnp.sqrt(jnp.where(met, 1.0, squared)))


def ate(
    truth: Float[ArrayLike, "N 3"],
    estimate: Float[ArrayLike, "N 3"],
    alignment: Alignment = Alignment.START,
) -> dict[str, Float[Array, ""]]:
    """Absolute translation error as in the paper's table 3: `max`, `mean` and `rmse`, m."""
    error = translation_error(truth, estimate, alignment)
    return {
        "max": jnp.max(error),
        "mean": jnp.mean(error),
        "rmse": jnp.sqrt(jnp.mean(error**2)),
    }


def spread(errors: Float[np.ndarray, " N"]) -> dict[str, float]:
    """`max`, `mean` and `rmse` of the sizes of errors, in their unit, as plain numbers."""
    size = np.abs(errors)
    rmse = np.sqrt(np.mean(size**2))
    return {"max": float(size.max()), "mean": float(size.mean()), "rmse": float(rmse)}


def heading_error(
    truth: Float[ArrayLike, "N 3"],
    estimate: Float[ArrayLike, "N 3"],
    alignment: Alignment = Alignment.START,
) -> Float[Array, " N"]:
    """Heading of the estimate less the true one at each row, wrapped to ±pi, rad."""
    apart = aligned(truth, estimate, alignment)[:, 2] - jnp.asarray(truth, float)[:, 2]
    return jnp.arctan2(jnp.sin(apart), jnp.cos(apart))


def relative_pose_error(
    truth: Float[ArrayLike, "N 3"],
    estimate: Float[ArrayLike, "N 3"],
    *,
    distance: float,
    overlapping: bool = True,
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Error of the motion over each stretch of `distance` metres of the true path.

    Unlike the absolute error it needs no alignment and does not grow with what went before.

    Args:
        truth, estimate: poses at the same rows.
        distance: length of a stretch along the true path, m; it ends at the first row beyond it.
        overlapping: a stretch from every row; otherwise each begins where the last one ended (as in
            evo).

    Returns:
        Distance between the two end points seen from the start of the stretch, m, and error of the
        change of heading, wrapped, rad.

    Raises:
        ValueError: `distance` is not positive, or the path is shorter.
    """
    truth, estimate = np.asarray(truth, float), np.asarray(estimate, float)
    steps = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    begin, end = _stretches(steps, distance, overlapping)
    if begin.size == 0:
        raise ValueError(
            f"no stretch of {distance} m in a path of {steps.sum():.3g} m; give a distance between"
        )
    true_motion, motion = (_relative(poses, begin, end) for poses in (truth, estimate))
    apart = motion - true_motion
    turn = np.arctan2(np.sin(apart[:, 2]), np.cos(apart[:, 2]))
    return np.hypot(apart[:, 0], apart[:, 1]), turn


def _stretches(
    steps: np.ndarray, distance: float, overlapping: bool
) -> tuple[np.ndarray, np.ndarray]:
    if not distance > 0.0:
        return np.zeros(0, int), np.zeros(0, int)
    if overlapping:
        travelled = np.concatenate([[0.0], np.cumsum(steps)])
        begin = np.arange(travelled.size)
        end = np.searchsorted(travelled, travelled + distance * (1.0 - 1e-12))
        inside = end < travelled.size
        return begin[inside], end[inside]
    marks, gone = [0], 0.0
    for row, step in enumerate(steps, start=1):
        gone += step
        if gone >= distance:
            marks.append(row)
            gone = 0.0
    return np.array(marks[:-1], int), np.array(marks[1:], int)


def _relative(poses: np.ndarray, begin: np.ndarray, end: np.ndarray) -> Float[np.ndarray, "M 3"]:
    """Poses at `end` seen from those at `begin`."""
    dx, dy, turn = (poses[end] - poses[begin]).T
    c, s = np.cos(poses[begin, 2]), np.sin(poses[begin, 2])
    return np.stack([c * dx + s * dy, c * dy - s * dx, turn], axis=1)


def write_tum(path: str | Path, t: Float[ArrayLike, " N"], poses: Float[ArrayLike, "N 3"]) -> None:
    """Write poses as a TUM trajectory: `t x y z qx qy qz qw`, separated by blanks, without loss.

    The file is written whole or not at all.
    """
    t, poses = np.asarray(t, float), np.asarray(poses, float)
    x, y, psi = poses.T
    zero = np.zeros_like(t)
    table = np.stack([t, x, y, zero, zero, zero, np.sin(psi / 2), np.cos(psi / 2)], axis=1)
    lines = io.StringIO()
    np.savetxt(lines, table, fmt="%.17g")
    write_text(path, lines.getvalue())


def read_tum(path: str | Path) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "N 3"]]:
    """Read a TUM trajectory of planar motion: times (s), and poses with psi within ±pi.

    Raises:
        ValueError: a row has not eight numbers.
    """
    table = np.loadtxt(path, ndmin=2)
    if table.shape[1] != 8:
        raise ValueError(
            f"{path}: a TUM row is 't x y z qx qy qz qw', not {table.shape[1]} numbers"
        )
    t, x, y, _, qx, qy, qz, qw = table.T
    psi = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return t, np.stack([x, y, psi], axis=1)
