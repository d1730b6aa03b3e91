"""Finished results made by hand, for tests of what shows them: nothing is fitted or simulated."""

import numpy as np

from vdmsi_jax.compare import Comparison, PoseErrors, Prediction, Score
from vdmsi_jax.config import PlantSpec, VehicleGeometry
from vdmsi_jax.data.record import Record
from vdmsi_jax.identify.result import Fit, OrderGrid
from vdmsi_jax.models.transfer_function import TransferFunction

DT = 0.01
STEERING = PlantSpec("steering", "delta_cmd", "delta")


def steps(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-0.5, 0.5, n // 150 + 1), 150)[:n]


def lag(u: np.ndarray, rate: float, delay: int) -> np.ndarray:
    """A first-order lag with a delay in samples, one sample at a time."""
    y, state = np.zeros(len(u)), u[0]
    for k in range(len(u)):
        y[k] = state
        state += (1.0 - np.exp(-rate * DT)) * (u[max(k - delay, 0)] - state)
    return y


def record(n: int = 3000) -> Record:
    """A drive with steering steps, whose path is that of a slow turn."""
    rng = np.random.default_rng(1)
    command = steps(n)
    t = np.arange(n) * DT
    heading = 0.25 * t + 0.3 * np.sin(0.3 * t)
    x, y = (np.cumsum(4.0 * f(heading)) * DT for f in (np.cos, np.sin))
    return Record.from_arrays(
        dt=DT,
        name="drive.csv",
        vehicle=VehicleGeometry(l_f=1.75, l_r=1.2),
        delta_cmd=command,
        delta=lag(command, 8.0, 6) + 0.01 * rng.standard_normal(n),
        v_cmd=np.full(n, 4.0),
        v=4.0 + 0.05 * rng.standard_normal(n),
        x=x,
        y=y,
        psi=heading,
    )


def fit(order: str, of: Record) -> Fit:
    """A fit of the right shapes; its numbers only look likely."""
    poles, zeros = int(order[1]), int(order[3])
    if zeros > poles:
        return Fit(order, STEERING, f"improper: {zeros} zeros exceed {poles} poles")
    rng = np.random.default_rng(10 * poles + zeros)
    den = np.poly(np.array([-8.0, -12 + 9j, -12 - 9j, -30, -60])[1 if poles == 2 else 0 :][:poles])
    den = den.real
    num = np.append(1e-3 * den[-1] / 8.0 ** np.arange(zeros, 0, -1), 0.98 * den[-1])
    names = (
        *(f"b{k}" for k in reversed(range(zeros + 1))),
        *(f"a{k}" for k in reversed(range(poles))),
        "delay",
        "offset",
    )
    values = np.array([*num, *den[1:], 0.06, 0.001])
    simulated = lag(of["delta_cmd"], 8.0, 6)
    residual = of["delta"] - simulated
    mse = float(np.mean(residual**2))
    score = 96.5 - 45.0 * (poles == 1 and zeros == 0) + 0.1 * rng.random() + 0.2 * poles
    return Fit(
        order,
        STEERING,
        "converged",
        model=TransferFunction(num, den, delay=0.06, offset=0.001),
        fit=score,
        mse=mse * (100 - score) / 4,
        held_out_fit=score - 0.4,
        held_out_mse=1.1 * mse,
        aic=-20000.0 - score,
        bic=-19900.0 - score,
        parameter_names=names,
        parameters=values,
        covariance=np.diag((0.03 * values) ** 2),
        predicted=simulated,
        held_out_predicted=np.where(held_out(of), simulated, np.nan),
        residual=residual,
        jacobian=rng.standard_normal((of.n, len(values))),
        warnings=("a pole and a zero nearly cancel at -8 rad/s",) if order == "P5Z5" else (),
    )


def held_out(of: Record) -> np.ndarray:
    mask = np.zeros(of.n, bool)
    mask[of.n * 3 // 8 : of.n // 2] = mask[of.n * 7 // 8 :] = True
    return mask


def order_grid() -> OrderGrid:
    log = record()
    orders = [f"P{poles}Z{zeros}" for poles in range(1, 6) for zeros in range(6)]
    fits = {order: fit(order, log) for order in orders}
    return OrderGrid(STEERING, log, held_out(log), fits, "P2Z1", "P3Z2", fit_loss=0.5)


def comparison() -> Comparison:
    log = record()

    def errors(size: float) -> PoseErrors:
        distance = size * log.t / log.t[-1]
        return PoseErrors(distance, 0.01 * distance)

    def prediction(name: str, size: float, delta: np.ndarray, score: float) -> Prediction:
        bend = size * log.t / log.t[-1]
        return Prediction(
            name,
            "successful",
            {"delta": delta, "x": log["x"] + bend, "y": log["y"], "psi": log["psi"]},
            {"delta": Score(score, 1e-4)},
            errors(size),
            errors(0.3 * size),
            {"max": 0.9 * size, "mean": 0.4 * size, "rmse": 0.5 * size},
        )

    return Comparison(
        log,
        {
            "VDM": prediction("VDM", 8.0, log["delta_cmd"], 41.0),
            "VDM-SI": prediction("VDM-SI", 1.5, lag(log["delta_cmd"], 8.0, 6), 96.7),
        },
        window=20.0,
    )
