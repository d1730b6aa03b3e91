"""Logs of plants that are known, made by code of the tests' own: nothing of the package simulates.

The input is held between samples; between its jumps the states move by the matrix exponential, so
the response is exact at any sample period and any delay.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter, max_len_seq, tf2ss

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record, Segment

PLANT = PlantSpec("plant", "u_cmd", "out")
RESPONSE_UNITS = {"u_cmd": "1", "out": "1"}


@dataclass(frozen=True)
class Truth:
    """num/den in descending powers of s (den[0] = 1), a delay in s and an offset of the output."""

    num: tuple[float, ...]
    den: tuple[float, ...]
    delay: float = 0.0
    offset: float = 0.0

    @property
    def order(self) -> str:
        return f"P{len(self.den) - 1}Z{len(self.num) - 1}"

    @property
    def parameters(self) -> np.ndarray:
        """Numerator, then denominator without its leading one."""
        return np.array([*self.num, *self.den[1:]])


POWERTRAIN = Truth((0.0631, 2.21, 143.90), (1.0, 18.15, 143.20))  # Yan, Hsu & Wen 2023, table 2
RAO_GARNIER = Truth((-6400.0, 1600.0), (1.0, 5.0, 408.0, 416.0, 1600.0))


def response(truth: Truth, u: np.ndarray, dt: float, x0: np.ndarray | None = None) -> np.ndarray:
    """Exact output (n,) at the samples, each command already applied; at rest at u[0] if no x0."""
    A, B, C, D = tf2ss(truth.num, truth.den)
    n = len(A)
    whole = int(np.ceil(truth.delay / dt - 1e-12))
    late = max(whole * dt - truth.delay, 0.0)

    def held(time):
        both = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * time)
        return both[:n, :n], both[:n, n]

    Phi, _ = held(dt)
    Phi_late, by_late = held(late)
    _, by_early = held(dt - late)
    x = np.linalg.solve(A, -B[:, 0] * u[0]) if x0 is None else np.asarray(x0, float)
    early = np.concatenate([np.full(whole, u[0]), u])[: len(u)]
    following = np.append(early[1:], u[len(u) - whole] if 0 < whole < len(u) else u[-1])
    y = np.empty(len(u))
    for k in range(len(u)):
        y[k] = C[0] @ x + D[0, 0] * early[k]
        x = Phi @ x + Phi_late @ by_early * early[k] + by_late * following[k]
    return y + truth.offset


def free_responses(den, n: int, dt: float) -> np.ndarray:
    """Outputs (n, poles) from independent initial states, without input."""
    A = np.diag(np.ones(len(den) - 2), 1) + 0.0
    A[-1] = -np.asarray(den[:0:-1])
    Phi, row = expm(A * dt), np.eye(len(A))[0]
    rows = np.empty((n, len(A)))
    for k in range(n):
        rows[k] = row
        row = row @ Phi
    return rows


def steps(n: int, every: int, seed: int) -> np.ndarray:
    """Steps to random levels, as in the paper's figure 3."""
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, n // every + 1)
    return np.repeat(levels, every)[:n]


def prbs(n: int, clock: int, bits: int = 10) -> np.ndarray:
    """A maximum-length sequence of +-1, each chip held for `clock` samples."""
    chips = 2.0 * max_len_seq(bits, length=-(-n // clock))[0] - 1.0
    return np.repeat(chips, clock)[:n]


def white(n: int, std: float, seed: int) -> np.ndarray:
    return std * np.random.default_rng(seed).standard_normal(n)


def coloured(n: int, std: float, phi: float, seed: int) -> np.ndarray:
    """AR(1) noise of the standard deviation `std`, stationary from the first sample."""
    drive = white(n, std * np.sqrt(1.0 - phi**2), seed)
    drive[0] /= np.sqrt(1.0 - phi**2)
    return lfilter([1.0], [1.0, -phi], drive)


def log(u: np.ndarray, y: np.ndarray, dt: float, **more) -> Record:
    """A record of one run."""
    return Record.from_arrays(
        dt=dt, name="known", units=RESPONSE_UNITS, plants=(PLANT,), u_cmd=u, out=y, **more
    )


def cut(record: Record, edges: list[int], *, runs: bool = False) -> Record:
    """The record with gaps (or new runs) before the samples `edges`."""
    bounds = [0, *edges, record.n]
    return record.select(
        Segment(start, stop, f"run{i}" if runs else record.name)
        for i, (start, stop) in enumerate(zip(bounds[:-1], bounds[1:], strict=True))
    )
