"""The path that a model drives, for the translation error that a cause costs."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...metrics import spread, turn_between
from ..actuator.hypothesis import Hypothesis, Refit, responses
from ..answer.result import Path
from ..body.fit import theta_of
from ..body.search import BodySearch
from ..search.found import Search
from ..signals.runs import Runs
from .naming import Named

_RUINED = 4.0  # times the error: wheels that spin made it 11 times, right names of three exams 2.2


class Road:
    """Open-loop drives of the held-out runs, begun at the measured pose; where no heading was
    measured, each turned about its start so that it errs least.

    Args:
        runs: the logs side by side.
        searches: by measured channel (`v`, `delta`).
        bodily: what was found in the body.
        angle: (runs, N) measured road-wheel angle, for where no steering was identified.
    """

    def __init__(
        self, runs: Runs, searches: Mapping[str, Search], bodily: BodySearch, angle: np.ndarray
    ):
        self.runs, self.searches, self.bodily = runs, searches, bodily
        self.measured = {"v": runs.channel("v"), "delta": angle}
        whole = [
            (i, 0, b - a) for i, (a, b) in enumerate(zip(runs.starts, runs.stops, strict=True))
        ]
        held = [(i, a, b) for i, spans in enumerate(runs.judged) for a, b in spans]
        self.drives = [(i, a, min(b, whole[i][2])) for i, a, b in held] or whole
        self.pose = np.stack([runs.channel(c) for c in ("x", "y", "psi")], axis=-1)
        self.pose[..., 2] = np.unwrap(self.pose[..., 2], axis=1)
        self.headed = bool(runs.seen("psi").any())
        self.baseline = self._drive(
            {c: s.baseline.y for c, s in searches.items()}, bodily.plain.theta
        )
        self.extended = self._drive({c: s.final.y for c, s in searches.items()}, bodily.final.theta)
        self.baseline_mean, self.extended_mean = map(self.mean, (self.baseline, self.extended))

    def _drive(self, responses: Mapping[str, np.ndarray], theta: np.ndarray) -> np.ndarray:
        """(runs, N, 3) poses; each begins at the measured pose where its held-out part begins."""
        v, delta = (responses.get(c, self.measured[c]) for c in ("v", "delta"))
        _, x, y, psi = self.bodily.body.travel(theta, v, delta)
        found = np.full(self.pose.shape, np.nan)
        for i, a, b in self.drives:
            dx, dy = x[i, a:b] - x[i, a], y[i, a:b] - y[i, a]
            if self.headed:
                turn = self.pose[i, a, 2] - psi[i, a]
            else:
                way = self.pose[i, a:b, :2] - self.pose[i, a, :2]
                turn = turn_between(np.stack([dx, dy], axis=1), way, np)
            c, s = np.cos(turn), np.sin(turn)
            found[i, a:b, 0] = self.pose[i, a, 0] + c * dx - s * dy
            found[i, a:b, 1] = self.pose[i, a, 1] + s * dx + c * dy
            found[i, a:b, 2] = psi[i, a:b] + turn
        return found

    def errors(self, poses: np.ndarray) -> np.ndarray:
        """Translation errors of the held-out drives, m, one after another."""
        parts = []
        for i, a, b in self.drives:
            span = slice(a, b)
            parts.append(np.hypot(*(poses[i, span, :2] - self.pose[i, span, :2]).T))
        return np.concatenate(parts)

    def mean(self, poses: np.ndarray) -> float:
        """Mean translation error, m."""
        return float(np.mean(self.errors(poses)))

    @property
    def ruined(self) -> bool:
        """Whether the path errs so much more with all causes than with none, that those of the body
        make up for each other, and for what they are not."""
        return self.extended_mean > _RUINED * self.baseline_mean

    def ate(self) -> dict[str, dict[str, float]]:
        """Max, mean and rmse of baseline and model."""
        both = {"baseline": self.baseline, "model": self.extended}
        return {name: spread(self.errors(poses)) for name, poses in both.items()}

    def without(self, cause: Named, less: Refit | None = None) -> float:
        """Mean translation error of the model without a cause, m: its actuator refitted without it,
        or `less`."""
        responses = {c: s.final.y for c, s in self.searches.items()}
        theta = self.bodily.final.theta
        if cause.search is not None and cause.finding is not None:
            channel = next(c for c, s in self.searches.items() if s is cause.search)
            responses[channel] = (less or cause.search.usable_without(cause.finding)).y
        if cause.body is not None:
            theta = cause.body.less.theta
        return self.mean(self._drive(responses, theta))

    def with_only(self, causes: list[Named]) -> float:
        """Mean translation error of the final model with only some of its causes on, m."""
        responses = {}
        bodily = {c.body.number for c in causes if c.body is not None}
        for channel, own in self.searches.items():
            kept = tuple(
                c.finding.number for c in causes if c.search is own and c.finding is not None
            )
            responses[channel] = only(own, kept)
        return self.mean(self._drive(responses, theta_of(self.bodily.final, bodily)))

    def floor(self) -> float:
        """Mean translation error of the final body on the measured speed and angle, m."""
        return self.mean(self._drive({}, self.bodily.final.theta))

    def paths(self) -> list[Path]:
        """The held-out drives, for pictures."""
        made = []
        for i, a, b in self.drives:
            span = slice(a, b)
            t = self.runs.time()[i, span]
            poses = (p[i, span] for p in (self.pose, self.baseline, self.extended))
            made.append(Path(self.runs.names[i], t, *poses))
        return made


def only(search: Search, kept: tuple[int, ...]) -> np.ndarray:
    """Response of the final model of an actuator with only some of its causes on."""
    h: Hypothesis = search.final.hypothesis
    if set(kept) == set(h.active):
        return search.final.y
    theta = h.theta.copy()
    for number in h.active:
        if number not in kept:
            index = list(search.stage.slots[number].index)
            theta[index] = search.stage.off[index]
    left = replace(h, active=tuple(k for k in h.active if k in kept), theta=theta)
    return responses(search.stage, [left])[0]
