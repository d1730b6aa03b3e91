"""Does a controller make the command of what is measured?

Its commands then follow what no model knows: the noise of the row, and every load that it answers.
Commands that are planned follow nothing, so that innovations of the response tell of commands
before them alone.
"""

import numpy as np
from jaxtyping import Bool, Float

from ...data.noise import white_noise_std
from ..signals.colour import autoregression, whiten
from .hypothesis import Refit, residual
from .stage import Stage

_ROWS = 10  # by which a command may follow
_SURE = 60.0  # twice the log-likelihood that commands behind the innovations tell, from which on
# a controller may answer
_ANSWERS = ((0.02, 10.0), (0.1, 3.0))  # share of the innovations that they tell, and times what the
# commands before tell, which a wrong model leaves: open loops with structure left had up to 0.07
# and 3, closed ones from 0.05 and 39, or 0.16 and 4.4 on
_TREMBLES = (1e-3, 0.05)  # of a command's range, between which the noise lies that a controller
# makes of its sensor's: of seven of exams 1.4e-3 to 4.4e-3, of 60 planned commands up to 1e-4, and
# 1e-3 where rows are uneven
_JUMP = 4.0  # usual steps, beyond which one counts as no more: set-points jump


def is_answered(stage: Stage, fit: Refit) -> bool:
    """Whether a controller answers what a fit leaves."""
    white = whiten(residual(stage, fit.y)[None], fit.colour[None])[0]
    return answered(stage.u, white, stage.mask, fit.colour.size)


def trembles(u: Float[np.ndarray, "R N"], mask: Bool[np.ndarray, "R N"]) -> bool:
    """Whether a command trembles from row to row: a controller answers a sensor then, be it not the
    one that is logged, whose noise the innovations would tell."""
    rows = [row[use] for row, use in zip(u, mask, strict=True) if use.any()]
    low, high = np.quantile(u[mask], (0.02, 0.98))
    least, most = _TREMBLES
    return bool(least * (high - low) < white_noise_std(rows) < most * (high - low))


def answered(
    u: Float[np.ndarray, "R N"],
    innovations: Float[np.ndarray, "R N"],
    mask: Bool[np.ndarray, "R N"],
    order: int,
) -> bool:
    """Whether the command follows the innovations of the response.

    Args:
        u: the command.
        innovations: what no past of the response tells of it, and no model.
        mask: samples that count.
        order: of the autoregression that tells what is new in the command.

    Source: Sims, Money, income, and causality (1972); Caines and Chan, Feedback between stationary
    stochastic processes (1975).
    """
    moved = np.where(mask, u - u[mask].mean(), 0.0)
    news = whiten(moved[None], autoregression(moved[None], mask, order))[0]
    usual = float(np.median(np.abs(news[mask])))
    news = np.clip(news, -_JUMP * usual, _JUMP * usual)
    told = [_told(news, innovations, mask, k) for k in range(-_ROWS, _ROWS + 1)]
    before, behind = sum(told[:_ROWS]), sum(told[_ROWS:])
    plain = any(behind > share and behind > more * before for share, more in _ANSWERS)
    return bool(plain and behind * mask.sum() > _SURE)


def _told(news, innovations, mask, later: int) -> float:
    """Square of the correlation of innovations with what is new in a command so many rows later."""
    kept, moved = mask.copy(), np.roll(news, -later, axis=1)
    if later:
        kept[:, slice(-later, None) if later > 0 else slice(-later)] = False
    x, y = moved[kept], innovations[kept]
    return float(x @ y) ** 2 / max(float((x @ x) * (y @ y)), 1e-300)
