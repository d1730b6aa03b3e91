"""What a comparison is."""

import importlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..config import POSE
from ..data.record import Record
from ..metrics import spread

SUCCESSFUL = "successful"


def has_pose(channels: Collection[str]) -> bool:
    """Whether a pose is among them."""
    return set(POSE) <= set(channels)


class Score(NamedTuple):
    """FIT (eq. 3, percent) and MSE (eq. 4, squared unit) of one channel."""

    fit: float
    mse: float


@dataclass(frozen=True)
class PoseErrors:
    """How far predicted poses lie from the measured ones.

    Attributes:
        translation: distance at every sample, m; NaN where there is no prediction.
        heading: predicted minus measured heading at every sample, rad, wrapped.
    """

    translation: Float[np.ndarray, " N"]
    heading: Float[np.ndarray, " N"]

    @property
    def ate(self) -> Mapping[str, float]:
        """Max, mean and rmse of `translation`, m."""
        return spread(self.translation)

    @property
    def turned(self) -> Mapping[str, float]:
        """Max, mean and rmse of the size of `heading`, rad."""
        return spread(self.heading)


class RelativeErrors(NamedTuple):
    """Errors of the motion over every stretch of `distance` metres of the measured path: max, mean
    and rmse of the position at its end, m, and of the change of heading, rad."""

    distance: float
    translation: Mapping[str, float]
    heading: Mapping[str, float]


@dataclass(frozen=True)
class Prediction:
    """What one model says about a record, given its commands and its pose at each start.

    Attributes:
        name: what the model is called: VDM, VDM-SI, extended.
        status: what the simulation says of itself.
        channels: predicted samples of each channel, (N,); `x`, `y`, `psi` are the whole run's.
        scores: per channel that was measured.
        whole: errors of the run, anchored at the first measured pose of each segment.
        windows: errors when anchored anew at the measured pose every `Comparison.window` seconds.
        aligned: max, mean, rmse, m, of the run after the best rigid motion of each segment onto the
            measured path.
        relative: errors of the motion over stretches of the measured path that no gap parts.
    """

    name: str
    status: str
    channels: Mapping[str, Float[np.ndarray, " N"]]
    scores: Mapping[str, Score]
    whole: PoseErrors | None = None
    windows: PoseErrors | None = None
    aligned: Mapping[str, float] | None = None
    relative: RelativeErrors | None = None

    def __str__(self) -> str:
        fits = [f"FIT of {name} {score.fit:.1f} %" for name, score in self.scores.items()]
        error = [] if self.whole is None else [f"mean error {self.whole.ate['mean']:.3g} m"]
        told = ", ".join([*fits, *error]) or "nothing measured to compare with"
        return f"{self.name}: {told if self.ok else self.status}"

    def __repr__(self) -> str:
        return f"<Prediction {self}>"

    @property
    def ok(self) -> bool:
        """Whether the simulation succeeded."""
        return self.status == SUCCESSFUL

    @property
    def has_path(self) -> bool:
        """Whether it says where the vehicle went."""
        return self.ok and has_pose(self.channels)


@dataclass(frozen=True)
class Comparison:
    """The predictions of several models on one record.

    Attributes:
        record: the measurement.
        predictions: by the models' names, in the order to be shown.
        window: length of the windows of `Prediction.windows`, s.
        floor: the bicycle on the measured speed and angle, with what the last model says of body
            and road: the error that no model of the actuators can take away. None where a path or a
            response was not measured.
        with_measured: of the last model, by `v` and `delta`, the motion with that response as it
            was measured and the other as predicted: where that is nearer to the measured path, the
            actuator's model is what is wrong. Empty where `floor` is None or that model fails.
    """

    record: Record
    predictions: Mapping[str, Prediction]
    window: float
    floor: Prediction | None = None
    with_measured: Mapping[str, Prediction] = field(default_factory=dict)

    def __repr__(self) -> str:
        return (
            f"<Comparison on {self.record.name}: {'; '.join(map(str, self.predictions.values()))}>"
        )

    @property
    def stretch(self) -> str:
        """What `Prediction.whole` begins anew at the measured pose: the run, or each of the
        stretches that gaps leave of it."""
        return "whole run" if len(self.record.segments) == 1 else "each stretch"

    @property
    def lacking(self) -> str:
        """What to say of a log that measured nothing of what is predicted; empty where it did."""
        predictions = self.predictions.values()
        if any(p.scores or p.whole is not None for p in predictions):
            return ""
        path = any(p.has_path for p in predictions)
        made = "paths are predicted from the origin, and" if path else "nothing is predicted, and"
        return f"the log has no response of the model's: {made} nothing is compared"

    def write(self, folder: str | PathLike[str], *, report: bool = True) -> None:
        """Write what `vdmsi simulate` writes of a log: `simulation.json`, the trajectories as TUM
        files and, if asked, `report.html`. Several comparisons go into one folder by
        `vdmsi_jax.report.files.write_comparisons`.

        Args:
            folder: made if it is not there.
            report: whether to draw the report, too.

        Raises:
            InputError: the folder cannot be made or written to.
        """
        files: Any = importlib.import_module("vdmsi_jax.report.files")  # loaded when asked for
        files.write_comparisons(folder, [self], report=report)
