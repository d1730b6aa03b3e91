"""The verb: from logs to the causes, the extended model, and the gain on data held out."""

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace

import jax
import numpy as np

from ..config import PlantSpec, VehicleGeometry, canonical_of
from ..data import check_excitation, uncommanded
from ..data.copies import without_copies
from ..data.mend import counted
from ..data.outliers import without_outliers
from ..data.record import Record, records_of
from ..data.session import in_session
from ..data.slow_sensors import between_their_samples
from ..errors import InputError
from ..geometry import refuse_no_geometry
from ..programs import make_room
from ..threads import AT_ONCE, one_for_blas
from .actuator.stage import Stage
from .answer.result import Diagnosis, Unexplained
from .body.search import search_body
from .findings.looked import Looked
from .findings.rounding import of_the_sensor
from .findings.verdict import Evidence
from .prepare import body_of, stage_of, stands
from .residual.elsewhere import breaks_where_judged, is_another, only_where_judged
from .search.found import Search
from .search.search import ActsInSteps, search
from .signals.contradictions import Contradiction, contradictions
from .signals.noise import KnownNoise
from .signals.runs import Runs, lay_out, slower
from .signals.stuck import without_stuck_speed

_OF_A_VEHICLE = ("v_cmd", "delta_cmd", "v", "delta", "r", "x", "y", "psi")


def diagnose(
    records: Record | Sequence[Record],
    vehicle: VehicleGeometry | None = None,
    *,
    noise: Mapping[str, KnownNoise] | None = None,
    told: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Say what the simulation of a vehicle, or of any plant, gets wrong, and why.

    Args:
        records: logs of one vehicle. Of several, a third judges and the others are fitted: the
            last, unless their commands do not cover it; of a single one, stretches of it judge.
        vehicle: geometry, where the records have none.
        noise: of responses of plants by channel, where it was seen elsewhere, say at rest. Without,
            runs with the same commands tell it, and where there are none, the residual does.
        told: is called with what is being done.

    Raises:
        InputError: no record, different sample periods, nothing that answers to a command, or noise
            of a channel that no plant has.

    Works in double precision, whatever the setting of JAX outside: paths are differenced here.
    """
    make_room()
    with _computing(), one_for_blas():
        return _diagnose(records, vehicle, noise or {}, told)


@contextmanager
def _computing() -> Iterator[None]:
    """Double precision, and trials that may leave every range: both are a thread's own."""
    with jax.enable_x64(True), np.errstate(all="ignore"):
        yield


def _diagnose(
    records: Record | Sequence[Record],
    vehicle: VehicleGeometry | None,
    noise: Mapping[str, KnownNoise],
    told: Callable[[str], None] | None,
) -> Diagnosis:
    several, copies = without_copies(_alike(records_of(records), vehicle))
    several, alone = _among_their_like(several)
    several, slow = _at_their_rate(several)
    several, dead = _alive(several)
    unshared = _unshared(several)
    if plants_of(several):
        several = _without(several, {c for _, own in _lacking(several) for c in own})
    several, stuck = without_stuck_speed(several)
    against = [*stuck, *contradictions(several, plants_of(several))]
    several = _without(several, {c for one in against for c in one.leave})
    if not any(record.session for record in several):
        several = in_session(several)
    found = _by_rows(several, noise, told or (lambda _: None))
    unseen = (*copies, *alone, *slow, *dead, *unshared, *found.unseen)
    return _contradicted(replace(found, unseen=unseen), against)


def _by_rows(
    several: Sequence[Record], noise: Mapping[str, KnownNoise], say: Callable[[str], None]
) -> Diagnosis:
    """The diagnosis of a vehicle's records by longer rows, which reach further; where a command
    acts in steps, by the logs' own, which alone can tell them."""
    rows = [slower(record) for record in several]
    try:
        return _looked_into(rows, noise, say)
    except ActsInSteps:
        say("a command may act in steps: looking at every row")
        found = _looked_into(several, noise, say)
    if any(f.cause == "quantization" and f.where != "sensor" for f in found.findings + found.minor):
        return found
    say("it acts in none: looking at longer rows again")
    return _looked_into(rows, noise, say, may_step=False)


def _contradicted(found: Diagnosis, against: Sequence[Contradiction]) -> Diagnosis:
    """The diagnosis of logs that contradict themselves, which it says before all else."""
    if not against:
        return found
    said = tuple(one.said for one in against)
    open_ = (Unexplained(c.channel, 1.0, c.by, test=c.said.rstrip(".")) for c in against)
    return replace(
        found,
        verdict="unexplained_structure",
        contradictions=said,
        unexplained=(*open_, *found.unexplained),
        summary=" ".join([*said, found.summary]),
    )


def _looked_into(
    several: Sequence[Record],
    noise: Mapping[str, KnownNoise],
    say: Callable[[str], None],
    may_step: bool = True,
) -> Diagnosis:
    """The diagnosis of records as they are; where it leaves structure that the parts that judge
    alone show, of other parts. `may_step`: as in `search`."""
    plants = plants_of(several)
    outputs = [spec.output for spec in plants]
    for channel in set(noise) - set(outputs):
        problem = f"noise of {channel}, which is the response of no plant"
        raise InputError("noise", channel, problem, f"give it for {' or '.join(outputs)}")
    for channel, known in noise.items():
        if not isinstance(known, KnownNoise):
            mend = "give KnownNoise.reference(samples, dt)"
            raise InputError("noise", channel, f"{known!r} is no KnownNoise", mend)
    runs = lay_out(several)
    evidence = _evidence(several, runs, plants, noise, say, may_step)
    found, searches = evidence.diagnosis(), evidence.searches.values()

    def by_parts(others: bool) -> Diagnosis:
        parts = lay_out(several, whole=False, others=others)
        return _evidence(several, parts, plants, noise, say, may_step).diagnosis()

    if not runs.whole() and any(map(breaks_where_judged, searches)):
        say("something changes in a part that judges: fitting other parts")
        other = by_parts(others=True)
        found = other if _changes(other) >= max(_changes(found), 1) else found
    elif any(map(is_another, searches)):
        say("what judges shows what the others do not: fitting other parts")
        other = by_parts(others=not runs.whole())
        found = max(found, other, key=lambda d: len(d.findings))
    elif runs.whole() and only_where_judged(found, runs.judging()):
        say("only logs that no fit has seen show structure: fitting a part of each")
        for others in (False, True):
            again = by_parts(others)
            if again.verdict != found.verdict:
                found = again
                break
    return found


def _changes(found: Diagnosis) -> int:
    """How many changes of regime are named."""
    return sum(f.cause == "regime_change" for f in found.findings)


def _evidence(
    several: Sequence[Record],
    runs: Runs,
    plants: Sequence[PlantSpec],
    noise: Mapping[str, KnownNoise],
    say: Callable[[str], None],
    may_step: bool,
) -> Evidence:
    """What the searches find where these parts of the logs are held out."""
    say(f"looking into the {' and the '.join(spec.name for spec in plants)}")

    def look(spec: PlantSpec) -> Search | InputError:
        try:
            with _computing():
                stage = _stage(runs, several, spec, noise.get(spec.output))
                found = search(stage, may_step)
                rounds = of_the_sensor(found, runs.records, spec.output)
                return search(stage.but(rounds), may_step) if rounds else found
        except InputError as why:
            return why

    def look_on(spec: PlantSpec, found: Search) -> Looked:
        with _computing():
            return Looked.on(several, runs, spec, found)

    with ThreadPoolExecutor(AT_ONCE) as pool:  # one whitens while the other simulates
        looking, looking_on = {pool.submit(look, spec): spec for spec in plants}, {}
        for done in as_completed(looking):
            own = done.result()
            if isinstance(own, Search):
                looking_on[looking[done]] = pool.submit(look_on, looking[done], own)
        looked = {spec: done.result() for done, spec in looking.items()}
        searches = {spec: found for spec, found in looked.items() if isinstance(found, Search)}
        refused = {spec: why for spec, why in looked.items() if isinstance(why, InputError)}
        unseen = [f"The {spec.name} was not looked at: {why}" for spec, why in refused.items()]
        unseen += uncommanded(several, plants) + _left_out(several, runs)
        say("looking into the body, the road and the sensors")
        body = body_of(runs, {spec.output: found for spec, found in searches.items()})
        bodily = None if body is None else search_body(body)
        if bodily is None and (several[0].vehicle is not None or _shows_a_body(several)):
            unseen.append(_why_no_body(several))
    if not searches and bodily is None:
        names = ", ".join(record.source for record in several)
        if refused:
            first = next(iter(refused.values()))
            raise InputError(names, first.place, first.problem, first.mend)
        mend = "name commands and responses in [columns], and pair them in [[plants]]"
        none = [] if plants else ["no command with its response was logged"]
        why = [*_unshared(several), *none, *unseen][0].rstrip(".")
        raise InputError(names, "plants", why, mend)
    say("judging on the data held out")
    told = {spec: looking_on[spec].result() for spec in searches}
    return Evidence(several, runs, told, bodily, tuple(unseen))


def _alike(records: list[Record], vehicle: VehicleGeometry | None) -> list[Record]:
    if not records:
        raise InputError("records", "", "there is no record to diagnose", "give at least one")
    refuse_no_geometry(vehicle, "diagnose")
    first = records[0]
    told = next((record for record in records if record.vehicle is not None), None)
    if told is not None:
        vehicle = told.vehicle
    for record in records:
        if told is not None and record.vehicle not in (None, told.vehicle):
            problem = f"another vehicle than that of {told.log}"
            raise InputError(record.source, "vehicle", problem, "diagnose each vehicle by itself")
        if not np.isclose(record.dt, first.dt, rtol=1e-6):
            problem = f"sampled every {record.dt:g} s, but {first.log} every {first.dt:g} s"
            raise InputError(record.source, "dt", problem, "set the same [prepare] dt for all logs")
    return [replace(r, vehicle=r.vehicle or vehicle) for r in records]


def _among_their_like(records: list[Record]) -> tuple[list[Record], list[str]]:
    """The records without outliers of their sensors, which no cause of a library makes, and what is
    left out."""
    pairs = [without_outliers(record) for record in records]
    told = [
        f"{record.log}: {counted(number, 'sample')} of {channel} far from those before and after, "
        f"as outliers of a sensor are: left out."
        for record, counts in pairs
        for channel, number in counts.items()
    ]
    return [record for record, _ in pairs], told


def _at_their_rate(records: list[Record]) -> tuple[list[Record], list[str]]:
    """The records with lines between the samples of sensors slower than they, and what is said."""
    pairs = [between_their_samples(record) for record in records]
    names = dict.fromkeys(channel for _, slow in pairs for channel in slow)
    told = []
    for name in names:
        steps = sorted({f"{slow[name]:.3g}" for _, slow in pairs if name in slow}, key=float)
        told.append(
            f"{name} was measured every {' to '.join(steps[:1] + steps[1:][-1:])} s, and is taken "
            f"to go straight from one sample to the next."
        )
    return [record for record, _ in pairs], told


def _alive(records: list[Record]) -> tuple[list[Record], list[str]]:
    """The records without the yaw rate or the pose of a sensor that never moved, which would be
    blamed on the vehicle, and what is left out."""
    told, gone = [], set[str]()
    responses = {plant.output for plant in plants_of(records)}  # `y` may be one
    for sensor in (("r",), ("x", "y", "psi")):
        known = [[r[c] for c in sensor if c in r and c not in responses] for r in records]
        if any(known) and all(np.ptp(x) == 0.0 for own in known for x in own):
            gone |= set(sensor) - responses
            said = " and ".join(sensor)
            never = "never changes" if len(sensor) == 1 else "never change"
            told.append(f"{said} {never}, as of a sensor that is dead: left out.")
    return _without(records, gone), told


def _without(records: list[Record], gone: Set[str]) -> list[Record]:
    """The records without some channels."""

    def kept(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {c: x for c, x in values.items() if c not in gone}

    if not gone:
        return records
    return [replace(r, channels=kept(r.channels), filled=kept(r.filled)) for r in records]


def _lacking(records: Sequence[Record]) -> list[tuple[str, list[str]]]:
    """Records and the channels that they lack and others have: they are left aside in all, since
    half of a speed would tell that a vehicle stood."""
    plants = [c for r in records for p in r.plants for c in (p.input, p.output)]
    every = dict.fromkeys(c for c in (*_OF_A_VEHICLE, *plants) if any(c in r for r in records))
    lacking = [(r.log, [c for c in every if c not in r]) for r in records]
    return [(name, missing) for name, missing in lacking if missing]


def _unshared(records: Sequence[Record]) -> list[str]:
    """Which records lack channels that others have, in words."""
    return [
        f"{name} lacks {', '.join(missing)}: not looked at in any log."
        for name, missing in _lacking(records)
    ]


def _left_out(records: Sequence[Record], runs: Runs) -> list[str]:
    """Records that are not among those laid side by side, in words."""
    out = [r.log for r in records if not any(r is kept for kept in runs.records)]
    if not out:
        return []
    names = ", ".join(out[:3]) + (f" and {len(out) - 3} more" if len(out) > 3 else "")
    why = "much shorter than the others, or more than are looked at"
    return [f"Not looked at: {names}, which {'is' if len(out) == 1 else 'are'} {why}."]


def plants_of(records: Sequence[Record]) -> list[PlantSpec]:
    """The plants to look at: one for each of a vehicle's speed and angle, and all that are none of
    a vehicle's."""
    plants = list({p.name: p for r in records for p in r.plants}.values())
    channels = set.intersection(*(set(r.channels) for r in records))
    plants = [p for p in plants if p.input in channels and p.output in channels]
    vehicle = records[0].vehicle is not None
    if vehicle and "delta_cmd" in channels and {"r", "v"} <= channels:
        if not any(p.output == "delta" for p in plants):
            plants.append(PlantSpec("steering", "delta_cmd", "delta"))
    taken: dict[str, PlantSpec] = {}
    ours = canonical_of(plants, records[0].vehicle)
    for plant in plants:
        if not vehicle or plant.output not in ours:
            taken.setdefault(plant.name, plant)
        elif plant.output in ("v", "delta"):
            taken.setdefault(plant.output, plant)
    return list(taken.values())


def _stage(
    runs: Runs, records: Sequence[Record], spec: PlantSpec, noise: KnownNoise | None = None
) -> Stage:
    if spec.output in records[0]:
        moved, refused = 0, None
        for record in records:
            try:
                check_excitation(record, spec)
                moved += 1
            except InputError as why:
                refused = why
        if not moved and refused is not None:
            raise refused
    if all(spec.output in r and np.array_equal(r[spec.input], r[spec.output]) for r in records):
        problem = f"{spec.output} is {spec.input} in every sample, an echo and no measurement"
        mend = "name the column that was measured"
        raise InputError(records[0].source, spec.output, problem, mend)
    return stage_of(runs, spec, noise)


def _shows_a_body(records: Sequence[Record]) -> bool:
    """Whether a yaw rate or a pose was logged, which no plant has as its own."""
    own = {channel for plant in plants_of(records) for channel in (plant.input, plant.output)}
    return any(c in record and c not in own for record in records for c in ("r", "x", "y", "psi"))


def _why_no_body(records: Sequence[Record]) -> str:
    if records[0].vehicle is None:
        return "Without a [vehicle] there is no body to look at: yaw rate and pose were left aside."
    if all("v" in record for record in records) and stands(records):
        return (
            "The vehicle stands in these logs: of the body, the road and the sensors none is seen."
        )
    return (
        "The body, the road and the sensors could not be looked at: that needs a speed and a "
        "steering angle, and beside them a yaw rate or a pose, for a few seconds without a gap."
    )
