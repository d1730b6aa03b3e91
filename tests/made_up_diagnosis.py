"""Finished diagnoses made by hand, for tests of what shows them: nothing is fitted.

The signals come from loops written here, so that pictures of them look like those of real ones.
"""

import numpy as np

from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data.record import Record
from vdmsi_jax.diagnose.answer.result import (
    Budget,
    ChannelScore,
    Detectable,
    Diagnosis,
    Estimate,
    Finding,
    Gain,
    Path,
    Response,
    Rival,
    Unexplained,
)
from vdmsi_jax.model_file import Model, Plant
from vdmsi_jax.models.transfer_function import TransferFunction

DT = 0.02
LENGTHS = (3000, 2600, 3000)  # of the runs; the last is held out
GAP, DELAY = 0.062, 0.18  # rad of backlash; s of delay
NOISE = {"v": 0.03, "delta": 0.006, "r": 0.01}
GEOMETRY = VehicleGeometry(l_f=1.75, l_r=1.2)
STEERING = PlantSpec("steering", "delta_cmd", "delta")
POWERTRAIN = PlantSpec("powertrain", "v_cmd", "v")
MOTOR = PlantSpec("motor", "voltage", "speed")


def lag(u: np.ndarray, rate: float, delay: float = 0.0) -> np.ndarray:
    """A first-order lag behind a delay, one sample at a time."""
    late = np.concatenate([np.full(round(delay / DT), u[0]), u])[: len(u)]
    y, state = np.zeros(len(u)), late[0]
    for k in range(len(u)):
        y[k] = state
        state += (1.0 - np.exp(-rate * DT)) * (late[k] - state)
    return y


def play(u: np.ndarray, gap: float) -> np.ndarray:
    """Backlash of full width `gap`."""
    y, at = np.zeros(len(u)), u[0]
    for k, value in enumerate(u):
        at = min(max(at, value - gap / 2), value + gap / 2)
        y[k] = at
    return y


def coloured(n: int, std: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of a standard deviation `std` that remembers a little of itself."""
    white = rng.standard_normal(n)
    return std * lag(white, 40.0) / lag(white, 40.0).std() if std else np.zeros(n)


def whitened(e: np.ndarray) -> np.ndarray:
    """What `coloured` noise does not remember."""
    return e - np.exp(-40.0 * DT) * np.concatenate([[0.0], e[:-1]])


def steps(n: int, every: int, low: float, high: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(low, high, n // every + 1), every)[:n]


def chirp(n: int, seed: int) -> np.ndarray:
    t = np.arange(n) * DT
    return (
        0.12 * np.sin(0.9 * t + 0.6 * seed)
        + 0.06 * np.sin(2.9 * t)
        + steps(n, 400, -0.1, 0.1, seed)
    )


def pose(v: np.ndarray, delta: np.ndarray) -> np.ndarray:
    psi = np.cumsum(v * np.tan(delta) / GEOMETRY.wheelbase) * DT
    return np.stack([np.cumsum(v * np.cos(psi)) * DT, np.cumsum(v * np.sin(psi)) * DT, psi], axis=1)


def fit(y: np.ndarray, simulated: np.ndarray) -> float:
    return float(100.0 * (1.0 - np.linalg.norm(y - simulated) / np.linalg.norm(y - y.mean())))


def padded(arrays: list[np.ndarray]) -> np.ndarray:
    width = max(map(len, arrays))
    return np.stack([np.pad(a, (0, width - len(a)), mode="edge") for a in arrays])


def response(spec: PlantSpec, unit: str, runs: list[dict], held_out: bool = True) -> Response:
    """Of runs given as dictionaries of u, y, baseline, extended, innovations."""
    t = [np.arange(len(run["u"])) * DT for run in runs]
    valid = padded([np.ones(len(times), bool) for times in t])
    for row, times in zip(valid, t, strict=True):
        row[len(times) :] = False
    judged = valid.copy()
    judged[:-1] = False
    columns = ("u", "y", "baseline", "extended", "innovations")
    command_unit = {"voltage": "V", "v_cmd": "m/s", "delta_cmd": "rad"}[spec.input]
    arrays = {name: padded([run[name] for run in runs]) for name in columns}
    names = tuple(f"run_{i + 1}.csv" for i in range(len(runs)))
    return Response(
        spec.name, spec.input, spec.output, unit, names, DT, padded(t),
        **arrays, valid=valid, held_out=judged & held_out, command_unit=command_unit,
    )  # fmt: skip


def score(of: Response, which: str) -> ChannelScore:
    mask = of.held_out if of.held_out.any() else of.valid
    y, simulated, noise = of.y[mask], getattr(of, which)[mask], NOISE.get(of.channel, 0.4)
    ceiling = 100.0 * (1.0 - noise / y.std())
    return ChannelScore(fit(y, simulated), float(np.mean((y - simulated) ** 2)), noise, ceiling)


def model(*specs: PlantSpec, vehicle: VehicleGeometry | None = None) -> Model:
    plants = {
        spec.name: Plant(spec, TransferFunction([7.9], [1.0, 8.0], delay=0.02, offset=0.001))
        for spec in specs
    }
    return Model(plants, vehicle)


def gain(before: ChannelScore, after: ChannelScore, channel: str, **more) -> Gain:
    return Gain(channel, before.fit, after.fit, 0.35, before.mse, after.mse, **more)


def drives(noise: bool = True) -> list[dict[str, np.ndarray]]:
    """What was commanded and measured in each run: backlash in the steering, a delay in the
    powertrain."""
    rng = np.random.default_rng(3)
    runs = []
    for i, n in enumerate(LENGTHS):
        u, w = chirp(n, i), lag(steps(n, 300, 2.0, 7.0, 10 + i), 3.0)
        delta, v = play(lag(u, 8.0), GAP), lag(w, 1.5, DELAY)
        e, f = (coloured(n, NOISE[c] * noise, rng) for c in ("delta", "v"))
        runs.append({"delta_cmd": u, "v_cmd": w, "delta": delta + e, "v": v + f, "e": e, "f": f})
    return runs


def records(
    runs: list[dict[str, np.ndarray]], *names: str, path: bool = True
) -> tuple[Record, ...]:
    made = []
    for i, run in enumerate(runs):
        channels = {name: run[name] for name in names}
        if path:
            channels |= dict(zip(("x", "y", "psi"), pose(run["v"], run["delta"]).T, strict=True))
        made.append(
            Record.from_arrays(dt=DT, name=f"run_{i + 1}.csv", vehicle=GEOMETRY, **channels)
        )
    return tuple(made)


def explained() -> Diagnosis:
    """Backlash that has a look-alike and a delay that has none; a minor third cause, and a path."""
    runs = drives()
    steering = response(STEERING, "rad", [
        {"u": r["delta_cmd"], "y": r["delta"], "baseline": lag(r["delta_cmd"], 6.5, 0.04),
         "extended": r["delta"] - r["e"], "innovations": whitened(r["e"])}
        for r in runs
    ])  # fmt: skip
    powertrain = response(POWERTRAIN, "m/s", [
        {"u": r["v_cmd"], "y": r["v"], "baseline": lag(r["v_cmd"], 1.3),
         "extended": r["v"] - r["f"], "innovations": whitened(r["f"])}
        for r in runs
    ])  # fmt: skip
    both = {"v": powertrain, "delta": steering}
    before = {name: score(of, "baseline") for name, of in both.items()}
    after = {name: score(of, "extended") for name, of in both.items()}
    last = runs[-1]
    poses = [
        pose(*(of if isinstance(of, np.ndarray) else of[-1] for of in pair))
        for pair in (
            (last["v"], last["delta"]),
            (powertrain.baseline[-1], steering.baseline[-1]),
            (powertrain.extended[-1], steering.extended[-1]),
        )
    ]
    apart = [np.hypot(*(estimate - poses[0])[:, :2].T) for estimate in poses[1:]]
    ate = {
        name: {"max": e.max(), "mean": e.mean(), "rmse": np.sqrt(np.mean(e**2))}
        for name, e in zip(("baseline", "model"), apart, strict=True)
    }
    start, end = (ate[name]["mean"] for name in ("baseline", "model"))
    middle = end + 0.25 * (start - end)
    backlash = Finding(
        "backlash", "steering", None, "",
        {"gap": Estimate(GAP, 0.0011, "rad")}, 4210.0, 0.0,
        gain(before["delta"], after["delta"], "delta", ate_before=start, ate_after=middle),
        gain(before["delta"], after["delta"], "delta", held_out=False), 0.97,
        (
            Rival("coulomb_friction", "steering", 1.8, True),
            Rival("dead_zone", "steering", 640.0, False),
            Rival("transport_delay", "steering", 1190.0, False),
        ),
        "a steering chirp of 0.5 to 6 Hz for 20 s",
        f"Steering: backlash of {GAP:.3f} ± 0.001 rad, or Coulomb friction, which this log cannot "
        f"tell apart from it. It costs {start - middle:.2f} m of the {start:.2f} m of error on "
        "held-out driving. A dead zone is ruled out.",
    )  # fmt: skip
    delay = Finding(
        "transport_delay", "powertrain", None, "", {"delay": Estimate(DELAY, 0.004, "s")},
        912.0, 2.4e-199,
        gain(before["v"], after["v"], "v", ate_before=middle, ate_after=end), None, 0.93,
        (Rival("resonance", "powertrain", 88.0, False),), None,
        f"Powertrain: a delay of {DELAY:.2f} ± 0.004 s. It costs {middle - end:.2f} m on the road.",
    )  # fmt: skip
    lagging = Finding(
        "sensor_lag", "sensor", "v", "", {"time_constant": Estimate(0.006, np.nan, "s")},
        31.0, 2.6e-8, Gain("v", 97.10, 97.12, 0.02, 9.3e-4, 9.2e-4), None, 0.004, (), None,
        "Speed sensor: a lag of 0.006 s. It costs next to nothing.",
    )  # fmt: skip
    return Diagnosis(
        verdict="explained",
        findings=(backlash, delay),
        minor=(lagging,),
        unexplained=(),
        disturbances=(),
        baseline=model(STEERING, POWERTRAIN, vehicle=GEOMETRY),
        model=model(STEERING, POWERTRAIN, vehicle=GEOMETRY),
        orders={"steering": "P1Z0", "powertrain": "P1Z0"},
        channels=before,
        extended=after,
        ate=ate,
        budget=(
            *(
                Budget(
                    channel, f"({of.unit})^2" if "/" in of.unit else f"{of.unit}^2",
                    before[channel].mse,
                    {name: part * (before[channel].mse - NOISE[channel] ** 2) for name, part in
                     (("backlash (steering)", own), ("transport_delay (powertrain)", 0.97 - own))},
                    NOISE[channel] ** 2, 0.03 * (before[channel].mse - NOISE[channel] ** 2),
                )
                for channel, of, own in (("delta", steering, 0.99), ("v", powertrain, 0.0))
            ),
            Budget(
                "translation", "m", start,
                {"backlash (steering)": start - middle,
                 "transport_delay (powertrain)": middle - end},
                0.8 * end, 0.2 * end,
            ),
        ),
        detectable=(
            Detectable("backlash", "steering", "gap", 0.0015, "rad", ("coulomb_friction",),
                       "a steering chirp of 0.5 to 6 Hz for 20 s"),
            Detectable("transport_delay", "powertrain", "delay", 0.011, "s"),
            Detectable("saturation", "steering", "upper", float("inf"), "rad", (),
                       "an amplitude sweep of the steering up to its stop"),
        ),
        unseen=("No yaw rate is logged, so understeer and tyre relaxation were looked for in the "
                "path alone.",),
        responses=(steering, powertrain),
        paths=(Path("run_3.csv", np.arange(len(poses[0])) * DT, *poses),),
        records=records(runs, "v_cmd", "delta_cmd", "v", "delta"),
        held_out="run_3.csv, 60 s, which no fit has seen",
        summary=f"Two causes explain the error to the noise. {backlash.sentence} {delay.sentence}",
    )  # fmt: skip


def no_effect() -> Diagnosis:
    """A steering log without a pose that holds nothing but noise."""
    runs = drives()
    for run in runs:
        run["delta"] = lag(run["delta_cmd"], 8.0) + run["e"]
    steering = response(STEERING, "rad", [
        {"u": r["delta_cmd"], "y": r["delta"], "baseline": r["delta"] - r["e"],
         "extended": r["delta"] - r["e"],
         "innovations": np.random.default_rng(len(r["e"])).standard_normal(len(r["e"]))}
        for r in runs
    ])  # fmt: skip
    scores = {"delta": score(steering, "baseline")}
    return Diagnosis(
        verdict="no_effect",
        findings=(),
        minor=(),
        unexplained=(),
        disturbances=(),
        baseline=model(STEERING),
        model=model(STEERING),
        orders={"steering": "P1Z0"},
        channels=scores,
        extended=scores,
        ate=None,
        budget=(),
        detectable=(Detectable("dead_zone", "steering", "half_width", 0.002, "rad"),),
        unseen=("No pose is logged, so nothing can be said of the path.",),
        responses=(steering,),
        paths=(),
        records=records(runs, "delta_cmd", "delta", path=False),
        held_out="run_3.csv, 60 s",
        summary="The baseline explains the steering to the noise. No cause was found.",
    )


def unexplained() -> Diagnosis:
    """A speed that drops out now and then, which no cause of the library does."""
    runs = drives()
    for run in runs:
        run["out"] = np.zeros(len(run["v"]))
        for start in (700, 1500, 2200):
            run["out"][start : start + 60] = -0.5
        run["v"] = lag(run["v_cmd"], 1.5) + run["f"] + run["out"]
    powertrain = response(POWERTRAIN, "m/s", [
        {"u": r["v_cmd"], "y": r["v"], "baseline": r["v"] - r["f"] - r["out"],
         "extended": r["v"] - r["f"] - r["out"],
         "innovations": whitened(r["f"] + r["out"])}
        for r in runs
    ])  # fmt: skip
    scores = {"v": score(powertrain, "baseline")}
    left = Unexplained(
        "v", 0.61, ("t",), (("run_3.csv", 14.0, 15.2), ("run_3.csv", 30.0, 31.2)),
        "the energy of windows of 1 s",
    )  # fmt: skip
    return Diagnosis(
        verdict="unexplained_structure",
        findings=(),
        minor=(),
        unexplained=(left,),
        disturbances=(),
        baseline=model(POWERTRAIN),
        model=model(POWERTRAIN),
        orders={},
        channels=scores,
        extended=scores,
        ate=None,
        budget=(Budget("v", "(m/s)^2", scores["v"].mse, {}, NOISE["v"] ** 2,
                       scores["v"].mse - NOISE["v"] ** 2),),
        detectable=(),
        unseen=(),
        responses=(powertrain,),
        paths=(),
        records=records(runs, "v_cmd", "v", path=False),
        held_out="run_3.csv, 60 s",
        summary="The speed leaves the model in short windows, which no cause of the library does.",
    )  # fmt: skip


def siso() -> Diagnosis:
    """A motor with a command and a response of its own names, saturated on one side; all samples
    were seen by the fit."""
    u = steps(4000, 120, -9.0, 9.0, 5)
    e = coloured(4000, 0.4, np.random.default_rng(8))
    extended, baseline = lag(6.0 * np.minimum(u, 5.0), 4.0), lag(5.3 * u, 3.6)
    motor = response(MOTOR, "rad/s", [{
        "u": u, "y": extended + e, "baseline": baseline, "extended": extended,
        "innovations": np.concatenate([np.full(30, np.nan), whitened(e)[30:]]),
    }], held_out=False)  # fmt: skip
    before, after = score(motor, "baseline"), score(motor, "extended")
    saturation = Finding(
        "saturation", "plant", None, "of the command",
        {"upper": Estimate(5.0, 0.02, "V"), "lower": Estimate(-np.inf, np.inf, "V")},
        900.0, 1e-190, gain(before, after, "speed", held_out=False), None, 0.98, (), None,
        "Motor: the command saturates at 5.00 ± 0.02 V.",
    )  # fmt: skip
    record = Record.from_arrays(
        dt=DT, name="motor.csv", plants=[MOTOR], units={"voltage": "V", "speed": "rad/s"},
        voltage=u, speed=extended + e,
    )  # fmt: skip
    return Diagnosis(
        verdict="explained",
        findings=(saturation,),
        minor=(),
        unexplained=(),
        disturbances=(),
        baseline=model(MOTOR),
        model=model(MOTOR),
        orders={"motor": "P1Z0"},
        channels={"speed": before},
        extended={"speed": after},
        ate=None,
        budget=(Budget("speed", "(rad/s)^2", before.mse,
                       {"saturation (plant)": 1.03 * before.mse - 0.16}, 0.16,
                       -0.03 * before.mse),),
        detectable=(Detectable("backlash", "plant", "gap", 0.3, "rad/s"),),
        unseen=("There is one run of 80 s only, so the gain could not be confirmed elsewhere.",),
        responses=(motor,),
        paths=(),
        records=(record,),
        held_out="nothing",
        summary=saturation.sentence,
    )  # fmt: skip


ALL = {"explained": explained, "no_effect": no_effect, "unexplained": unexplained, "siso": siso}
