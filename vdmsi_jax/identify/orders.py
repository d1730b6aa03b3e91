"""The order grid: all PxZy fitted to one plant, judged on held-out data, and one of them chosen."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from vdmsi_jax import metrics
from vdmsi_jax.config import IdentifyOptions, PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.errors import InputError
from vdmsi_jax.first_look import first_look
from vdmsi_jax.identify.acceleration import measures_acceleration, speed_of
from vdmsi_jax.identify.layout import Samples, Scale, lay_out
from vdmsi_jax.identify.most_moved import most_moved
from vdmsi_jax.identify.response import N_LINEAR, N_MAX
from vdmsi_jax.identify.result import Fit, Floats, OrderGrid
from vdmsi_jax.identify.search import Point, Search, simulate_points
from vdmsi_jax.identify.uncertainty import parameter_covariance, support_remarks
from vdmsi_jax.models.transfer_function import TransferFunction, improper_reason

_LOOKED = 20_000  # samples that the search looks at; of more, it settles on all what some taught
_LONGEST_DELAY = 0.1  # of the record, where the user states no bound
_ANSWERS = 6.0  # standard errors of a response from none, below which delay and poles may only have
# been picked to answer noise
_DRIFT = 3.0  # points of FIT for which an unsupported order is taken
_GROWN = 10.0  # points of FIT for which an unsound order is taken
_ENOUGH = 0.7  # of the samples, that must answer to commands of their own segment
_AT_ITS_BOUND = 0.5  # samples, by which a delay may miss its bound and is at it
_SAME_AS = "no better than what it contains: "


def order_grid(
    record: Record, held_out: NDArray[np.bool_], plant: PlantSpec, options: IdentifyOptions
) -> OrderGrid:
    """Fit every order of `options` to one plant of a record.

    Each order is fitted without the samples of the mask `held_out` (n,) and scored on them; then,
    from there, on all samples, which gives the model. Where there is a delay to find, all samples
    are looked over for other delays, too, since their loss may be least at another one.
    """
    proper = [(n, m) for n in options.poles for m in options.zeros if m <= n]
    if not proper:
        problem = f"no proper order: zeros {list(options.zeros)} exceed poles {list(options.poles)}"
        raise InputError(record.source, "[identify] zeros", problem, "allow fewer zeros")
    longest = _longest_delay(record, options)
    measured = record.measured(plant.output)
    _refuse_too_short(record, plant, measured & ~held_out, max(n for n, _ in proper))
    scale, delays = _scale(record, plant, measured & ~held_out, longest)
    measured = measured & _answered(record, measured & ~held_out, delays if longest else ())
    samples, where = lay_out(record, plant, scale, measured & ~held_out)
    bounds = {"longest_delay": float(longest) or None, "offset": options.offset}
    part, index = most_moved(record, plant, _LOOKED)
    some = samples
    if len(index) < record.n:
        some, _ = lay_out(part, plant, scale, (measured & ~held_out)[index])
    search = Search(some, proper, **bounds)
    found = search.run(delays if longest else (0.0,))
    if some is not samples:
        search = Search(samples, proper, **bounds)
        found = search.polish(found.values())
    scores = {}
    if held_out.any():
        seen = np.array([not held_out[s.start : s.stop].all() for s in record.segments])
        for_free = measured & ~(held_out & np.repeat(seen, [len(s) for s in record.segments]))
        judging, _ = lay_out(record, plant, scale, for_free)
        predictions = _simulated(judging, where, found, seen, options)
        y, hidden = record[plant.output], measured & held_out
        for order, (_, predicted, _) in predictions.items():
            predicted = np.where(held_out, predicted * scale.y, np.nan)
            scores[order] = _Score(
                float(metrics.fit(y[hidden], predicted[hidden])),
                float(metrics.mse(y[hidden], predicted[hidden])),
                predicted,
            )
        samples, _ = lay_out(record, plant, scale, measured)
        _, delays = _scale(record, plant, measured, longest)
        search = Search(samples, proper, **bounds)
        again = search.settle if len(index) == record.n else search.polish
        found = again(found.values())
    if longest and len(index) == record.n:
        found = search.look_elsewhere(found.values(), delays)
    every = np.ones(len(record.segments), bool)
    details = _simulated(samples, where, found, every, options)
    told = record, plant, options, scale, measured, longest
    fits = {
        order: _fit(*told, point, details[order], scores.get(order))
        for order, point in found.items()
    }
    fits = _never_falling(fits)
    grid = {
        f"P{n}Z{m}": fits[n, m]
        if (n, m) in fits
        else Fit(f"P{n}Z{m}", plant, improper_reason(n, m) or "", supported=False)
        for n in options.poles
        for m in options.zeros
    }
    chosen, by_bic = choose(grid, options.fit_loss)
    return OrderGrid(plant, record, held_out, grid, chosen, by_bic, options.fit_loss)


def _refuse_too_short(
    record: Record, plant: PlantSpec, counts: NDArray[np.bool_], poles: int
) -> None:
    """Refuse a record with fewer samples than an order with so many poles has unknowns: its
    coefficients, a delay, an offset, and where each segment starts."""
    unknown = 2 * poles + 3 + poles * len(record.segments)
    if counts.sum() <= unknown:
        problem = f"{int(counts.sum())} samples to fit, and up to {unknown} unknowns"
        mend = "give a longer log, or fewer [identify] poles"
        raise InputError(record.source, plant.output, problem, mend)


def choose(fits: Mapping[str, Fit], fit_loss: float) -> tuple[str, str]:
    """The order by the paper's rule, and by BIC.

    The paper takes the smallest order whose FIT is hardly below the best (Yan et al. 2023, sec.
    5.1); size is the number of parameters, fewer poles first. Orders with poles that the data do
    not support (`Fit.supported`: drifts, cancelling pairs, the paper's own steering model) stand
    back unless they fit better by more than `_DRIFT` points, as they do for a true integrator. One
    whose simulation goes wrong (`Fit.sound`: it grows, or is an alias) is none of either unless it
    fits better than all others by more than `_GROWN` points, as it does for a plant that grows.
    """
    usable = [fit for fit in fits.values() if fit.ok]
    most = max(fit.fit for fit in usable)
    sound = [fit for fit in usable if fit.sound and fit.fit >= most - _GROWN]
    usable = [fit for fit in usable if fit.sound] if sound else usable
    by_bic = min(usable, key=lambda fit: (fit.bic, fit.status.startswith(_SAME_AS)))  # not a copy
    best = max(usable, key=lambda fit: fit.fit)
    supported = [fit for fit in usable if fit.supported and fit.fit >= best.fit - _DRIFT]
    usable = supported or usable
    best = max(usable, key=lambda fit: fit.fit)
    near = [fit for fit in usable if fit.fit >= best.fit - fit_loss]
    return min(near, key=lambda fit: (fit.n_poles + fit.n_zeros, fit.n_poles)).order, by_bic.order


def _bridged(values: Floats, use: NDArray[np.bool_]) -> Floats:
    """Values, straight lines where they do not count."""
    at = np.arange(values.size)
    return np.interp(at, at[use], values[use]) if use.any() else values


def _answered(
    record: Record, counts: NDArray[np.bool_], delays: Sequence[float]
) -> NDArray[np.bool_]:
    """Samples that answer to commands that were logged: behind a gap those of the time before it
    act as long as the delay lasts, and are not known. All, where little would be left."""
    late = math.ceil(max(delays, default=0.0)) + 1
    known, begun = np.ones(record.n, bool), set[str]()
    for segment in record.segments:
        if segment.run in begun and delays:
            known[segment.start : min(segment.start + late, segment.stop)] = False
        begun.add(segment.run)
    enough = (counts & known).sum() > _ENOUGH * counts.sum()
    return known if enough else np.ones(record.n, bool)


def _scale(
    record: Record, plant: PlantSpec, counts: NDArray[np.bool_], longest_delay: int
) -> tuple[Scale, tuple[float, ...]]:
    """Scales of the signals, and delays (in samples) to start from, by the samples in `counts`."""
    parts = [segment.samples for segment in record.segments]
    u, y = record[plant.input], record[plant.output]
    answers = [y[part] for part in parts]
    used = [counts[part] for part in parts]
    if measures_acceleration(plant):  # a sum, in which a sample that does not count would go on
        answers = [speed_of(_bridged(*pair)) for pair in zip(answers, used, strict=True)]
    look = first_look([u[part] for part in parts], answers, used, longest_delay)
    scale = Scale(
        float(np.std(u)) or 1.0,
        (float(np.std(y[counts])) or 1.0) * math.sqrt(counts.sum()),
        look.lag * record.dt,
        record.dt,
    )
    return scale, tuple(map(float, look.delays))


def _longest_delay(record: Record, options: IdentifyOptions) -> int:
    """Upper bound of the delay in samples; 0 where the delay is not a parameter."""
    if options.delay is False:
        return 0
    longest = max(len(segment) for segment in record.segments)
    if options.delay is True:
        return max(int(_LONGEST_DELAY * longest), 1)
    return max(int(min(options.delay / record.dt, longest)), 1)


class _Score(NamedTuple):
    """Score of the fit that did not see the held-out samples, and its prediction (n,) there."""

    fit: float
    mse: float
    predicted: Floats


def _simulated(
    samples: Samples,
    where: NDArray[np.int64],
    found: dict[tuple[int, int], Point],
    fitted: NDArray[np.bool_],
    options: IdentifyOptions,
) -> dict[tuple[int, int], tuple[Floats, Floats, Floats]]:
    """Linear parameters, prediction (n,) and sensitivities (n, 13) of every order, scaled."""
    weights = np.zeros(samples.n_segments)
    weights[: len(fitted)] = fitted
    details = simulate_points(
        samples,
        jnp.asarray(weights, samples.u.dtype),
        list(found.values()),
        delay=options.delay is not False,
        offset=options.offset,
    )
    inside = where >= 0
    rows = np.argsort(where[inside])
    return {
        order: (
            np.asarray(detail.beta, float),
            np.asarray(detail.predicted, float)[inside][rows],
            np.asarray(detail.sensitivities, float)[inside][rows],
        )
        for order, detail in zip(found, details, strict=True)
    }


def _fit(
    record: Record,
    plant: PlantSpec,
    options: IdentifyOptions,
    scale: Scale,
    counted: NDArray[np.bool_],
    longest: int,
    point: Point,
    simulated: tuple[Floats, Floats, Floats],
    score: _Score | None,
) -> Fit:
    """The result for one order: parameters in units, their covariance, criteria, warnings. What the
    fit did not see behind a gap counts in none of them."""
    n, m = point.order
    has_delay = options.delay is not False
    beta, predicted, sensitivities = simulated
    names = [f"b{i}" for i in range(m, -1, -1)] + [f"a{i}" for i in range(n - 1, -1, -1)]
    names += ["delay"] * has_delay + ["offset"] * options.offset
    # the scaled parameters are a ascending, delay, b ascending, offset
    columns = [N_MAX + 1 + i for i in range(m, -1, -1)] + list(range(n - 1, -1, -1))
    columns += [N_MAX] * has_delay + [N_MAX + 1 + N_LINEAR - 1] * options.offset
    keep = [True] * (n + m + 1) + [has_delay, options.offset]
    units = scale.to_units(n, m)[keep]
    parameters = np.concatenate([point.a, [point.d], beta])[columns] * units
    value = dict(zip(names, parameters.tolist(), strict=True))

    y, predicted = record[plant.output], predicted * scale.y
    jacobian = sensitivities[:, columns] * scale.y / units
    lost = len(parameters) + n * len(record.segments)
    sensible = np.array([not (name == "delay" and n == m) for name in names])
    covariance = np.zeros((len(names), len(names)))

    def spread(slopes: Floats) -> Floats:
        """Covariance of what has these slopes."""
        left = np.where(counted, y - predicted, 0.0)
        stretches = [slice(s.start, s.stop) for s in record.segments]
        return parameter_covariance(np.where(counted[:, None], slopes, 0.0), left, stretches, lost)

    covariance[np.ix_(sensible, sensible)] = spread(jacobian[:, sensible])
    # a feed-through shows a delay to the sample, and has no slope over it
    covariance[~sensible, ~sensible] = record.dt**2 / 12
    num, den = parameters[: m + 1], np.append(1.0, parameters[m + 1 : m + 1 + n])
    remarks = support_remarks(
        num,
        den,
        covariance[: n + m + 1, : n + m + 1],
        dt=record.dt,
        duration=max(len(segment) for segment in record.segments) * record.dt,
    )
    warnings = [remark.message for remark in remarks]
    if has_delay and point.d > longest - _AT_ITS_BOUND:
        most = f"{longest * record.dt:g} s"
        warnings.append(
            f"the delay is as long as it may be, {most}: allow more by [identify] delay"
        )
    moved = predicted - np.mean(predicted[counted])
    size = math.sqrt(float(spread(moved[:, None])[0, 0]))  # of a factor of all that it does
    if size > 1.0 / _ANSWERS:
        told = f"{1.0 / size:.1f} standard errors from nothing"
        warnings.append(
            f"the response may be nothing but noise: what follows the command is {told}"
        )
    mse = float(metrics.mse(y[counted], predicted[counted]))
    likelihood = counted.sum() * math.log(max(mse, 1e-300))
    return Fit(
        order=f"P{n}Z{m}",
        plant=plant,
        status="converged" if point.converged else "rounds exhausted: the search still gained",
        model=TransferFunction(num, den, delay=value.get("delay"), offset=value.get("offset")),
        fit=float(metrics.fit(y[counted], predicted[counted])),
        mse=mse,
        held_out_fit=score.fit if score else math.nan,
        held_out_mse=score.mse if score else math.nan,
        aic=likelihood + 2 * lost,
        bic=likelihood + math.log(counted.sum()) * lost,
        parameter_names=tuple(names),
        parameters=parameters,
        covariance=covariance,
        predicted=predicted,
        held_out_predicted=score.predicted if score else np.zeros(0),
        residual=np.where(counted, y - predicted, np.nan),
        jacobian=jacobian,
        warnings=tuple(warnings),
        supported=not any(remark.unsupported for remark in remarks),
        sound=not any(remark.unsound for remark in remarks),
    )


def _never_falling(fits: dict[tuple[int, int], Fit]) -> dict[tuple[int, int], Fit]:
    """Let an order that ended below one that it contains be that one, and say so.

    PxZy lies in PxZ(y+1) (no leading coefficient), in P(x+1)Z(y+1) (a cancelling pair) and, unless
    it has a feed-through, in P(x+1)Zy (a pole too fast to see).
    """
    result: dict[tuple[int, int], Fit] = {}
    for n, m in sorted(fits):
        inside = [(n, m - 1), (n - 1, m - 1)] + [(n - 1, m)] * (m < n - 1)
        best = max((result[k] for k in inside if k in result), key=lambda f: f.fit, default=None)
        own = fits[n, m]
        if best is None or best.fit <= own.fit:
            result[n, m] = own
            continue
        basis = (
            best.status.removeprefix(_SAME_AS) if best.status.startswith(_SAME_AS) else best.order
        )
        result[n, m] = replace(best, order=own.order, status=f"{_SAME_AS}{basis}", supported=False)
    return result
