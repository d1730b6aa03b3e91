"""What a diagnosis is: plain data for files, reports, pictures and people."""

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from ...data.record import Record
from ...model_file import Model

_FELT = 0.01  # of the mean translation error, below which a cause does nothing on the road

RESTS = "by the level at which it rests"
"""Form of an offset that is a plant's own, and no cause."""

Verdict = Literal["explained", "no_effect", "unexplained_structure"]


@dataclass(frozen=True)
class Estimate:
    """A parameter of a cause: value and standard deviation in `unit`, that of a finding with what
    is not known of the cause's form."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Gain:
    """What a cause is worth on data that no fit has seen (or, predicted, by the screen).

    Attributes:
        channel: the measured channel that it is worth most in.
        before, after: FIT (eq. 3, percent) without and with it.
        se: standard error of `after - before`, by blocks.
        mse_before, mse_after: mean squared errors, squared unit.
        held_out: whether no fit has seen the data.
        ate_before, ate_after: mean translation error on the held-out drive, m; None without a pose.
        typical: median over blocks of the share of the squared error that it takes, where seven in
            ten get better: one event that nothing explains may outweigh all that a cause explains.
    """

    channel: str
    before: float
    after: float
    se: float
    mse_before: float
    mse_after: float
    held_out: bool = True
    ate_before: float | None = None
    ate_after: float | None = None
    typical: float = 0.0

    @property
    def sureness(self) -> float:
        """By how many of its standard errors FIT rises."""
        return (self.after - self.before) / max(self.se, 1e-300)

    @property
    def cost(self) -> float:
        """Mean translation error that it takes away, m: below a hundredth of it, or without a path,
        zero."""
        if self.ate_before is None or self.ate_after is None:
            return 0.0
        cost = self.ate_before - self.ate_after
        return cost if cost > _FELT * self.ate_before else 0.0


@dataclass(frozen=True)
class Rival:
    """A cause that was tried in the place of a finding.

    Attributes:
        cause, where: as in the contract.
        deficit: how much worse it explains, in twice the log-likelihood; below the margin it cannot
            be told apart.
        indistinguishable: whether it cannot.
        channel: of a sensor's cause.
    """

    cause: str
    where: str
    deficit: float
    indistinguishable: bool
    channel: str | None = None


@dataclass(frozen=True)
class Finding:
    """A cause that the evidence supports.

    Attributes:
        cause: the word of the contract.
        where: `powertrain`, `steering`, `vehicle`, `sensor`, or `plant` for any other plant, which
            the channel of the gain tells.
        channel: for a sensor's cause, its channel.
        form: which of its forms fitted best, in words; empty where it has one.
        parameters: by name.
        statistic: twice the log-likelihood that it is worth.
        p_value: probability of so large a statistic without the cause (chi squared).
        gain: realised, on data held out.
        predicted_gain: the same by the first steps from the screen, before the cause was refitted
            under its own colour of noise; None where they led nowhere.
        share: of the held-out squared error of its channel that it takes away, 0 to 1; of a delay,
            or of the innovations if that is more.
        rivals: what else was tried, the closest first.
        separating_experiment: what to drive to tell it from its rivals; None if nothing is open.
        sentence: the finding in words.
    """

    cause: str
    where: str
    channel: str | None
    form: str
    parameters: Mapping[str, Estimate]
    statistic: float
    p_value: float
    gain: Gain
    predicted_gain: Gain | None
    share: float
    rivals: tuple[Rival, ...]
    separating_experiment: str | None
    sentence: str

    def __repr__(self) -> str:
        sizes = ", ".join(
            f"{name} {own.value:.4g} ± {own.std:.2g}" + (f" {own.unit}" if own.unit != "1" else "")
            for name, own in self.parameters.items()
            if math.isfinite(own.value)
        )
        form = f", {self.form}" if self.form else ""
        gain = f"FIT of {self.gain.channel} {self.gain.before:.1f} to {self.gain.after:.1f} %"
        return f"<Finding {self.cause} ({self.channel or self.where}{form}): {sizes}; {gain}>"

    @property
    def indistinguishable_from(self) -> tuple[str, ...]:
        """The causes that explain the data as well."""
        names = (rival.cause for rival in self.rivals if rival.indistinguishable)
        return tuple(dict.fromkeys(names))


@dataclass(frozen=True)
class Unexplained:
    """Structure that no cause of the library accounts for.

    Attributes:
        channel: where it is.
        fraction: of the residual's variance that is structure, 0 to 1.
        depends_on: what it depends on, such as `v_cmd`, `delta` or `t`.
        when: moments, (run, start s, stop s), in which it is concentrated.
        test: which test found it, in words.
        puzzling: whether it is so large that causes named beside it may only stand in for it.
        size: of a slow error, or of one that is small, of the response's spread; else infinite.
        of_form: whether a cause that was found would explain it, were its form a freer one.
        steady: whether it is a disturbance, such as wind: it does not go with what is asked.
        even: whether nothing so much as hints that a steady one is anything else.
        answered: whether a controller answers a steady one, so that it may be a load of any size.
        kind: of error, by the word of the test that found it; empty for most.
    """

    channel: str
    fraction: float
    depends_on: tuple[str, ...]
    when: tuple[tuple[str, float, float], ...] = ()
    test: str = ""
    puzzling: bool = False
    size: float = math.inf
    of_form: bool = False
    steady: bool = False
    even: bool = False
    answered: bool = False
    kind: str = ""


@dataclass(frozen=True)
class ChannelScore:
    """How a channel is explained on the held-out data.

    Attributes:
        fit: percent (eq. 3).
        mse: squared unit.
        noise_std: of its noise, in its unit.
        ceiling: FIT that no model can pass, because of the noise.
        noise_by: what tells that: its `own` residual, a `repeat` of commands, a `reference`, or
            its own residual where `brief` noise alone showed the causes.
    """

    fit: float
    mse: float
    noise_std: float
    ceiling: float
    noise_by: str = "own"


@dataclass(frozen=True)
class Budget:
    """Who is responsible for the error of a channel on the held-out data (or of the path).

    Attributes:
        name: the channel, or `translation`.
        unit: of the parts: squared unit of the channel, or m.
        total: mean squared error (mean translation error, m) of the baseline.
        parts: by cause (`cause (where)`), attributed by Shapley values, which do not depend on the
            order in which causes are put in.
        noise: what is noise.
        unexplained: what remains; total = sum of parts + noise + unexplained.
    """

    name: str
    unit: str
    total: float
    parts: Mapping[str, float]
    noise: float
    unexplained: float


@dataclass(frozen=True)
class Detectable:
    """The smallest size of a cause that these logs would have shown.

    Attributes:
        cause, where: as in the contract.
        parameter: its first parameter.
        smallest: its size at which the non-centrality is 32, in `unit`; infinite if the logs do not
            excite it.
        unit: of the size.
        inseparable: causes whose effects look alike in these logs (cosine above 0.95).
        manoeuvre: what to drive to see it better or to tell it apart; empty if nothing is open.
        channel: of a sensor.
    """

    cause: str
    where: str
    parameter: str
    smallest: float
    unit: str
    inseparable: tuple[str, ...] = ()
    manoeuvre: str = ""
    channel: str | None = None


@dataclass(frozen=True, eq=False)
class Response:
    """One measured channel beside its simulations, for pictures: all runs, (runs, N), padded.

    Attributes:
        name: of the plant or stage: `powertrain`, `steering`, `vehicle`, ...
        command, channel: names of the two channels.
        unit: of the channel; `command_unit` of the command.
        runs: names of the runs.
        dt: sample period, s.
        t: (runs, N) time since the start of each run, s.
        u, y: command and measurement.
        baseline, extended: simulated without and with the causes.
        innovations: whitened residual of the extended model, (runs, N).
        valid: samples that exist; `held_out`: those that no fit has seen.
    """

    name: str
    command: str
    channel: str
    unit: str
    runs: tuple[str, ...]
    dt: float
    t: Float[np.ndarray, "R N"]
    u: Float[np.ndarray, "R N"]
    y: Float[np.ndarray, "R N"]
    baseline: Float[np.ndarray, "R N"]
    extended: Float[np.ndarray, "R N"]
    innovations: Float[np.ndarray, "R N"]
    valid: Bool[np.ndarray, "R N"]
    held_out: Bool[np.ndarray, "R N"]
    command_unit: str = ""


@dataclass(frozen=True, eq=False)
class Path:
    """The held-out drive on the road, for pictures: poses (N, 3) in m and rad.

    Attributes:
        run: its name.
        t: time since its start, s.
        measured, baseline, extended: x, y, psi.
    """

    run: str
    t: Float[np.ndarray, " N"]
    measured: Float[np.ndarray, "N 3"]
    baseline: Float[np.ndarray, "N 3"]
    extended: Float[np.ndarray, "N 3"]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What the simulation gets wrong, why, and what the extension gains.

    Attributes:
        verdict: `no_effect`, `explained` or `unexplained_structure`.
        findings: causes that the evidence supports and that matter, the strongest first.
        minor: causes that are significant, but small, or not sure enough to be named.
        unexplained: structure that is left.
        disturbances: slow errors that are large and steady, and no fault of the model.
        baseline, model: identified plants without and with the causes.
        orders: by plant, the order of its baseline.
        channels: scores of the baseline; `extended` those of the model.
        ate: under `baseline` and `model`: mean, max and rmse of the translation error, m, on the
            held-out drive; None without a pose. Its plants start at rest at the measured response;
            in `compare` they start so that they meet the first 0.2 s, so that its errors differ.
        budget: who is responsible for what.
        detectable: what these logs would have shown.
        unseen: what could not be looked at, and why, a sentence each.
        responses: for pictures.
        paths: the held-out drives on the road, for pictures.
        records: the logs.
        held_out: what was held out, in words.
        summary: the whole answer in a few sentences; those of `unseen` go with it.
        contradictions: what the logs say against themselves, such as a heading that turns the other
            way, a sentence each with the mend; each is among `unexplained`, too.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    minor: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    disturbances: tuple[Unexplained, ...]
    baseline: Model
    model: Model
    orders: Mapping[str, str]
    channels: Mapping[str, ChannelScore]
    extended: Mapping[str, ChannelScore]
    ate: Mapping[str, Mapping[str, float]] | None
    budget: tuple[Budget, ...]
    detectable: tuple[Detectable, ...]
    unseen: tuple[str, ...]
    responses: tuple[Response, ...]
    paths: tuple[Path, ...]
    records: tuple[Record, ...]
    held_out: str
    summary: str
    contradictions: tuple[str, ...] = ()

    @property
    def levels(self) -> tuple[Finding, ...]:
        """Of the minor causes, the levels at which plants rest."""
        return tuple(f for f in self.minor if f.form == RESTS)

    @property
    def small(self) -> tuple[Finding, ...]:
        """Of the minor causes, the others."""
        return tuple(f for f in self.minor if f.form != RESTS)

    def __repr__(self) -> str:
        named = ", ".join(f"{f.cause} ({f.channel or f.where})" for f in self.findings)
        partly = "; not all was looked at, see unseen" if self.unseen else ""
        return f"<Diagnosis {self.verdict}: {named or 'no finding'}{partly}>"

    def plot(self) -> Any:
        """The whole answer as one figure: measured and simulated, residuals, gains, budget."""
        plots: Any = importlib.import_module(
            "vdmsi_jax.plots"
        )  # loaded when a picture is asked for
        return plots.diagnosis(self)

    def write(self, folder: str | PathLike[str], *, report: bool = True) -> None:
        """Write what `vdmsi diagnose` writes: `diagnosis.json`, `model.json` and, if asked,
        `report.html`.

        Args:
            folder: made if it is not there.
            report: whether to draw the report, too.

        Raises:
            InputError: the folder cannot be made or written to.
        """
        files: Any = importlib.import_module("vdmsi_jax.report.files")  # loaded when asked for
        files.write_diagnosis(folder, self, report=report)
