"""How far a simulation is from a measurement: per channel, and on the road.

Everything up to the relative error can be differentiated with respect to the parameters of the
vehicle that made it: JAX arrays give JAX arrays. Of NumPy's alone NumPy makes the errors, which
compiles nothing for each new length. Poses are arrays of the columns x (m), y (m), psi (rad).
"""

import enum
import io
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .files import write_text

Anything = Array | np.ndarray
Scalar = Float[Array, ""] | Float[np.ndarray, ""] | np.floating


class Alignment(enum.Enum):
    """How an estimated path is laid on the true one before they are compared."""

    NONE = "as it is"
    START = "moved and turned so that the first poses coincide, as in the paper"
    SE2 = "moved and turned for the least squared distance (Umeyama 1991 without scale)"


def _arrays(*given: Any) -> tuple[Any, ...]:
    """What computes with such arrays, and these as its own."""
    xp = jnp if any(isinstance(one, jax.Array) for one in given) else np
    return xp, *(xp.asarray(one, float) for one in given)


def _root(squared: Any, xp: Any) -> Any:
    """The square root, whose derivative is zero at zero, where it has a kink."""
    nought = squared == 0.0
    return xp.where(nought, 0.0, xp.sqrt(xp.where(nought, 1.0, squared)))


def fit(y: Float[ArrayLike, " N"], y_hat: Float[ArrayLike, " N"]) -> Scalar:
    """FIT of eq. (3), percent: 100 is perfect, 0 no better than the mean of `y`, and there is no
    lower bound. `-inf` where `y` does not vary. Its derivative is zero where it is perfect."""
    xp, told, model = _arrays(y, y_hat)
    still = xp.all(told == told[:1])
    spread = xp.where(still, 1.0, _root(xp.sum((told - xp.mean(told)) ** 2), xp))
    left = _root(xp.sum((told - model) ** 2), xp)
    return xp.where(still, -xp.inf, 100.0 * (1.0 - left / spread))


def mse(y: Float[ArrayLike, " N"], y_hat: Float[ArrayLike, " N"]) -> Scalar:
    """Mean squared error of eq. (4), in the squared unit of the channel."""
    xp, told, model = _arrays(y, y_hat)
    return xp.mean((told - model) ** 2)


def aligned(
    truth: Float[ArrayLike, "N 3"], estimate: Float[ArrayLike, "N 3"], alignment: Alignment
) -> Float[Anything, "N 3"]:
    """The poses of `estimate`, moved and turned as a whole.

    Raises:
        ValueError: the arrays are not poses of one length.
    """
    xp, true, own = _arrays(truth, estimate)
    if true.ndim != 2 or true.shape[1] != 3 or true.shape != own.shape:
        raise ValueError(
            "truth and estimate need one shape (N, 3) of columns x, y, psi; "
            f"got {true.shape} and {own.shape}"
        )
    if alignment is Alignment.NONE:
        return own
    if alignment is Alignment.START:
        centre, target = own[0, :2], true[0, :2]
        turn = true[0, 2] - own[0, 2]
    else:
        centre, target = xp.mean(own[:, :2], 0), xp.mean(true[:, :2], 0)
        p, q = own[:, :2] - centre, true[:, :2] - target
        turn = turn_between(p, q, xp)
    c, s = xp.cos(turn), xp.sin(turn)
    position = (own[:, :2] - centre) @ xp.array([[c, s], [-s, c]]) + target
    return xp.concatenate([position, own[:, 2:] + turn], axis=1)


def turn_between(p, q, xp=jnp):
    """The angle about the origin, rad, that brings the positions `p`, (N, 2), closest to `q`, in
    squares (Horn, J. Opt. Soc. Am. A 4, 1987, in the plane)."""
    return xp.arctan2(xp.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), xp.sum(p * q))


def translation_error(
    truth: Float[ArrayLike, "N 3"], estimate: Float[ArrayLike, "N 3"], alignment: Alignment
) -> Float[Anything, " N"]:
    """Distance between both positions at each row, m. Its derivative is zero where they
    coincide, as at an anchored start."""
    xp, true, own = _arrays(truth, estimate)
    apart = true - aligned(true, own, alignment)
    return _root(xp.sum(apart[:, :2] ** 2, axis=1), xp)


def ate(
    truth: Float[ArrayLike, "N 3"],
    estimate: Float[ArrayLike, "N 3"],
    alignment: Alignment = Alignment.START,
) -> dict[str, Scalar]:
    """Absolute translation error as in the paper's table 3: `max`, `mean` and `rmse`, m."""
    xp, error = _arrays(translation_error(truth, estimate, alignment))
    return {"max": xp.max(error), "mean": xp.mean(error), "rmse": _root(xp.mean(error**2), xp)}


def spread(errors: Float[np.ndarray, " N"]) -> dict[str, float]:
    """`max`, `mean` and `rmse` of the sizes of errors, in their unit, as plain numbers."""
    size = np.abs(errors)
    rmse = np.sqrt(np.mean(size**2))
    return {"max": float(size.max()), "mean": float(size.mean()), "rmse": float(rmse)}


def heading_error(
    truth: Float[ArrayLike, "N 3"],
    estimate: Float[ArrayLike, "N 3"],
    alignment: Alignment = Alignment.START,
) -> Float[Anything, " N"]:
    """Heading of the estimate less the true one at each row, wrapped to ±pi, rad."""
    xp, true, own = _arrays(truth, estimate)
    apart = (aligned(true, own, alignment) - true)[:, 2]
    return xp.arctan2(xp.sin(apart), xp.cos(apart))


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
