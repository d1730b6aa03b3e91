"""Whether the error of a path goes with the heading: that of a compass beside iron does.

Such an error is slow, so that noise with a colour can imitate it and no innovation shows it: what
the same harmonics explain of runs that were not fitted tells it.
"""

import numpy as np
from jaxtyping import Bool, Float

from ..answer.result import Unexplained

_SHARE = 0.4  # of the squared error, fitted and not, from which on it is told
_LEAST = 0.02  # rad of heading, below which it is not
_FEW = 200  # samples, of either part


def by_heading(
    aside: Float[np.ndarray, "R N"],
    forward: Float[np.ndarray, "R N"],
    turned: Float[np.ndarray, "R N"],
    psi: Float[np.ndarray, "R N"],
    masks: tuple[Bool[np.ndarray, "R N"], Bool[np.ndarray, "R N"]],
) -> list[Unexplained]:
    """An error of the way aside that goes with the first two harmonics of the heading, as the
    deviation of a compass does (semicircular by hard iron, quadrantal by soft iron); empty if none.

    Args:
        aside: what a model leaves of the way aside over a window, m.
        forward, turned: the way forward, m, and the change of heading, rad, over it.
        psi: measured heading, rad.
        masks: samples that were fitted, and those that were not.

    Source: Bowditch, The American Practical Navigator (2017), chapter 6, deviation.
    """
    if min(use.sum() for use in masks) < _FEW:
        return []
    plain = np.stack([np.ones_like(forward), forward, turned, forward * turned])
    waves = forward * np.stack([np.sin(psi), np.cos(psi), np.sin(2.0 * psi), np.cos(2.0 * psi)])
    left = []
    for X in (plain, np.concatenate([plain, waves])):
        weights = np.linalg.lstsq(X[:, masks[0]].T, aside[masks[0]], rcond=None)[0]
        left.append(aside - np.tensordot(weights, X, 1))
    shares = [1.0 - np.mean(left[1][use] ** 2) / np.mean(left[0][use] ** 2) for use in masks]
    share, use = float(min(shares)), masks[0]
    explained = np.mean((left[0][use] - left[1][use]) ** 2) / np.mean(forward[use] ** 2)
    if not share > _SHARE or explained < _LEAST**2:
        return []
    words = f"a heading whose error goes with the heading, {np.sqrt(explained):.2g} rad, would "
    return [Unexplained("psi", share, ("psi",), (), words + "explain the way aside")]
