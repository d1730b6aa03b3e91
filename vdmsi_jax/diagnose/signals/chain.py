"""The chain rule of likelihoods: what the residuals upstream of a channel pass on to it.

Without it one disturbance of speed would count twice, in speed and in the pose. A residual is a
model's error where it is slow and noise where it is fast, and only the first is passed on whole, so
slow and fast parts have shares of their own.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from .windows import moving_mean

_TAPS = 2  # rows to each side at which an actuator's residual may act on the yaw rate
_SLOW = 2.0  # s, over which a residual counts as slow


@dataclass(frozen=True, eq=False)
class Chain:
    """The regressors of each channel of a body's stage, (columns, runs, N) each.

    Attributes:
        v, delta: responses of the actuators' models; `dv`, `ddelta`: what they leave.
        mask: by channel, samples that count.
        wheelbase: m.
        window: rows of a pose increment.
        dt: sample period, s.
    """

    v: Float[np.ndarray, "R N"]
    delta: Float[np.ndarray, "R N"]
    dv: Float[np.ndarray, "R N"]
    ddelta: Float[np.ndarray, "R N"]
    mask: dict[str, Bool[np.ndarray, "R N"]]
    wheelbase: float
    window: int
    dt: float

    @cached_property
    def still(self) -> dict[str, Float[np.ndarray, "_ R N"]]:
        """Those that no hypothesis changes: what the actuators' models leave."""
        angles = bands(self.v / self.wheelbase * self.ddelta, self.dt)
        speeds = bands(np.tan(self.delta) / self.wheelbase * self.dv, self.dt)
        slips = bands(self.v * self.ddelta, self.dt)
        found = {
            "r": [angles[0], speeds[0], *_taps(angles[1]), *_taps(speeds[1])],
            "psi": [self._summed(x) for x in (*angles, *speeds)],
            "forward": [self._summed(x) for x in bands(self.dv, self.dt)],
            "aside": [
                *(self._drifted(x) for x in angles),
                *(self._summed(x) for x in slips),
            ],
        }
        return {c: self._counted(c, found[c]) for c in self.mask}

    def moving(
        self, e: dict[str, Float[np.ndarray, "R N"]]
    ) -> dict[str, Float[np.ndarray, "_ R N"]]:
        """Those that a residual of the yaw rate makes; linear in it."""
        if "r" not in e:
            return {}
        turns = bands(e["r"], self.dt)
        found = {
            "psi": [self._summed(x) for x in turns],
            "aside": [self._drifted(x) for x in turns],
        }
        return {c: self._counted(c, found[c]) for c in found if c in e}

    def columns(
        self, e: dict[str, Float[np.ndarray, "R N"]]
    ) -> dict[str, Float[np.ndarray, "_ R N"]]:
        """All of them, the moving ones first."""
        moving = self.moving(e)
        return {
            c: np.concatenate([moving[c], self.still[c]]) if c in moving else self.still[c]
            for c in e
        }

    def _counted(self, channel: str, columns: list[np.ndarray]) -> np.ndarray:
        return np.where(self.mask[channel], np.stack(columns), 0.0)

    def _summed(self, x: np.ndarray) -> np.ndarray:
        """Integral over the window of a pose increment."""
        total = np.concatenate([np.zeros((len(x), 1)), np.cumsum(x, axis=1)], axis=1) * self.dt
        n = x.shape[1]
        beyond = np.repeat(total[:, -1:], min(self.window, n + 1) - 1, axis=1)
        return np.concatenate([total[:, self.window :], beyond], axis=1) - total[:, :n]

    def _drifted(self, turn: np.ndarray) -> np.ndarray:
        """Way aside over a window by a yaw rate too much."""
        return 0.5 * self.window * self.dt * self.v * self._summed(turn)


def bands(
    x: Float[np.ndarray, "R N"], dt: float
) -> tuple[Float[np.ndarray, "R N"], Float[np.ndarray, "R N"]]:
    """What is slow in a signal, its centred mean over some seconds, and the rest."""
    slow = moving_mean(x, _SLOW, dt)
    return slow, x - slow


def _taps(x: np.ndarray) -> list[np.ndarray]:
    return [np.roll(x, k, axis=1) for k in range(-_TAPS, _TAPS + 1)]


def regress(
    X: Float[np.ndarray, "columns samples"], e: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " columns"]:
    """Least-squares shares of the rows of `X` in `e`; none for rows that are zero, or where there
    is no sample."""
    if not X.shape[1]:
        return np.zeros(len(X))
    size = np.sqrt(np.mean(X**2, axis=1))
    scale = np.where(size > 0, size, 1.0)
    unit = X / scale[:, None]
    ridge = 1e-8 * X.shape[1] * np.eye(len(X))
    return np.linalg.solve(unit @ unit.T + ridge, unit @ e) / scale
