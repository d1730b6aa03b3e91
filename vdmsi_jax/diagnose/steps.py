"""Commands that act in steps: a first look, at the rate of the log.

A command that is rounded before it acts is the command and an error that repeats with each step, a
Fourier series in the command: `sin(2 pi u / step)` and its overtones. What a linear regression of
the response leaves is set against the first of these, filtered as the command is, for a fine ladder
of steps. The likelihood over the step is too ragged for the few sizes that a screen tries, and rows
that are averaged over several of the log's hide what rounds each of them.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from ..config import PlantSpec
from ..data.record import Record

_PAST, _TAPS = 8, 30  # rows of the response and of the command that a row is predicted by
_LONGEST = 4000  # rows that are looked at
_COARSEST, _FINEST = 6.0, 200.0  # steps in the command's range
_APART = 0.25  # of a turn of phase over that range, between two steps that are tried
_SURE = 60.0  # of a chi-squared variable with two degrees of freedom
_ALONE = 4.0  # times what nine in ten other steps have, that it stands out beyond that


def step_of_command(records: Sequence[Record], plant: PlantSpec) -> float:
    """The step that a command seems to be rounded to before it acts; 0 where none shows.

    Args:
        records: logs with the command and the response of the plant.
        plant: which.
    """
    if not all(plant.input in r and plant.output in r for r in records):
        return 0.0
    pieces = [
        (r[plant.input][s.samples], r[plant.output][s.samples])
        for r in records
        for s in r.segments
        if r.measured(plant.output)[s.samples].all()
    ]
    u, y = max(pieces, key=lambda piece: piece[0].size, default=(np.zeros(0), np.zeros(0)))
    u, y = u[:_LONGEST], y[:_LONGEST]
    reach = float(np.ptp(u)) if u.size else 0.0
    if u.size < 10 * (_PAST + _TAPS) or not reach > 0.0:
        return 0.0
    taps, left = _regression(u, y)
    variance = float(np.mean(left**2))
    if not variance > 1e-24 * float(np.var(y)):
        return 0.0
    turns = np.arange(_COARSEST, _FINEST, _APART) / reach
    told = _told(u, taps, left, turns) / variance
    k = int(np.argmax(told))
    if told[k] < _SURE + _ALONE * float(np.quantile(told, 0.9)):
        return 0.0
    near = turns[k] + np.linspace(-_APART, _APART, 41) / reach
    return float(1.0 / near[np.argmax(_told(u, taps, left, near))])


def _regression(
    u: Float[np.ndarray, " N"], y: Float[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, " taps"], Float[np.ndarray, " M"]]:
    """Weights of the last commands in a row's response, beside those of the last responses, and
    what such a prediction leaves."""
    rows = np.arange(_TAPS, y.size)
    past = [y[rows - i] for i in range(1, _PAST + 1)]
    given = [u[rows - i] for i in range(_TAPS)]
    columns = np.stack([*given, *past, np.ones(rows.size)], axis=1)
    found, *_ = np.linalg.lstsq(columns, y[rows], rcond=1e-10)
    return found[:_TAPS], y[rows] - columns @ found


def _told(
    u: Float[np.ndarray, " N"],
    taps: Float[np.ndarray, " taps"],
    left: Float[np.ndarray, " M"],
    turns: Float[np.ndarray, " F"],
) -> Float[np.ndarray, " F"]:
    """Square that each of the steps 1 / turns explains."""
    found = []
    for some in np.array_split(turns, max(turns.size // 64, 1)):
        wave: Complex[np.ndarray, "f N"] = np.exp(2j * np.pi * some[:, None] * u)
        answer = sum(
            weight * wave[:, _TAPS - i : u.size - i] for i, weight in enumerate(taps.tolist())
        )
        parts = np.stack([np.real(answer), np.imag(answer)])
        parts = parts - parts.mean(axis=-1, keepdims=True)
        gram = np.einsum("ifn,jfn->fij", parts, parts) + 1e-300 * np.eye(2)
        along = np.einsum("ifn,n->fi", parts, left)
        found.append(np.sum(along * np.linalg.solve(gram, along[..., None])[..., 0], axis=1))
    return np.concatenate(found)
