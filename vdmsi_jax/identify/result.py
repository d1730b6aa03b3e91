"""What an identification returns: one `Fit` per order, and the `OrderGrid` of all of them."""

import importlib
from collections.abc import Iterator, KeysView, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vdmsi_jax.config import PlantSpec
from vdmsi_jax.data.record import Record
from vdmsi_jax.errors import InputError, nearest
from vdmsi_jax.models.transfer_function import TransferFunction

Floats = NDArray[np.float64]

LOW_FIT = 60.0
"""FIT, percent, below which the paper leaves a model out of its figures."""


@dataclass(frozen=True)
class Fit:
    """One identified model of one order, with everything needed to judge it.

    `FIT` is eq. (3) and `MSE` eq. (4) of Yan, Hsu & Wen (ION 2023), of the free-run simulation, in
    percent and in squared units of the output.

    **Attributes:**

    - `order`: "P2Z1" means two poles and one zero.
    - `model`: the transfer function with its delay and offset, or None where `status` says why not.
    - `fit`, `mse`, `aic`, `bic`: of the model, fitted on all samples of the record.
    - `held_out_fit`, `held_out_mse`: on the held-out samples, of a model that was fitted without
      them. It runs on through held-out blocks with nothing but the commands; only a run that is
      held out whole has its initial state estimated from itself.
    - `parameters`, `covariance` `(p, p)`: estimates and their covariance, in the order of
      `parameter_names` (`b1`, `b0`, `a1`, `a0`, `delay`, `offset`); coefficients of descending
      powers of s, the leading denominator coefficient being 1. Computed from the sandwich formula
      with the autocorrelation of the residual, so that they hold for coloured noise too.
    - `predicted`, `residual` `(n,)`: simulation and its error; NaN in `residual` where the output
      was filled in. `held_out_predicted` `(n,)`: what the model fitted without them makes of the
      held-out samples, NaN elsewhere.
    - `jacobian` `(n, p)`: sensitivity of the predicted output to the parameters, initial states
      projected out.
    - `warnings`: what is odd about poles and zeros (cancelling pairs, near-integrators, and so on);
      `supported` is False where the data cannot tell them from a smaller model, `sound` where a
      simulation goes wrong with them: it grows, or they are an alias of something slow.
    """

    order: str
    plant: PlantSpec
    status: str
    model: TransferFunction | None = None
    fit: float = float("nan")
    mse: float = float("nan")
    held_out_fit: float = float("nan")
    held_out_mse: float = float("nan")
    aic: float = float("nan")
    bic: float = float("nan")
    parameter_names: tuple[str, ...] = ()
    parameters: Floats = field(default_factory=lambda: np.zeros(0))
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    predicted: Floats = field(default_factory=lambda: np.zeros(0))
    held_out_predicted: Floats = field(default_factory=lambda: np.zeros(0))
    residual: Floats = field(default_factory=lambda: np.zeros(0))
    jacobian: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    warnings: tuple[str, ...] = ()
    supported: bool = True
    sound: bool = True

    def __repr__(self) -> str:
        if self.model is None:
            return f"<Fit {self.order} of {self.plant.name}: {self.status}>"
        held_out = f", held out {self.held_out_fit:.2f} %" if np.isfinite(self.held_out_fit) else ""
        told = f"FIT {self.fit:.2f} %{held_out}; {self.status}"
        return f"<Fit {self.order} of {self.plant.name}: {told}>"

    @property
    def ok(self) -> bool:
        """Whether there is a model."""
        return self.model is not None

    @property
    def n_poles(self) -> int:
        return int(self.order[1])

    @property
    def n_zeros(self) -> int:
        return int(self.order[3])

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in rad/s, shape `(n_poles,)`; empty without a model, fewer where a smaller order
        was no worse (`status`)."""
        return np.zeros(0, complex) if self.model is None else _roots(self.model.den)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """Zeros in rad/s, shape `(n_zeros,)`; empty without a model, fewer likewise."""
        return np.zeros(0, complex) if self.model is None else _roots(self.model.num)

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter, by name."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return dict(zip(self.parameter_names, deviation.tolist(), strict=True))

    def value(self, name: str) -> float:
        """The estimate of the parameter `name`. Raises InputError with the nearest name if there is
        none."""
        if not self.parameter_names:
            model_of(self)  # which says why there is none
        source = f"{self.order} of {self.plant.name}"
        return float(self.parameters[place_of(name, self.parameter_names, source)])

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Two-sided confidence interval of the parameter `name` (asymptotic normal); that of a
        delay ends at its bound, zero. Raises InputError of the name, as `value`, and of a `level`
        outside 0 to 1."""
        value, half = self.value(name), z_of(level) * self.std[name]
        low, high = value - half, value + half
        return max(low, 0.0) if name == "delay" else low, high


def model_of(fit: Fit) -> TransferFunction:
    """The model of a fit. Raises InputError, with the reason, where there is none."""
    if fit.model is None:
        mend = "choose an order that has a model"
        raise InputError(fit.plant.name, fit.order, fit.status, mend)
    return fit.model


def place_of(name: str, names: Sequence[str], source: str) -> int:
    """The place of a parameter among those of `source`. Raises InputError if it has none."""
    if name not in names:
        raise InputError(source, name, "there is no such parameter", nearest(str(name), names))
    return names.index(name)


def z_of(level: float) -> float:
    """Standard deviations from the middle to either end of a normal interval. Raises InputError
    unless `level` lies between 0 and 1."""
    if not 0.0 < level < 1.0:
        raise InputError("interval", "level", f"{level} is no share", "give 0.95 for 95 %")
    return NormalDist().inv_cdf(0.5 + level / 2)


@dataclass(frozen=True)
class OrderGrid:
    """All orders fitted to one plant: `grid["P2Z1"]`, `grid.best`, `grid.table()`; iterating over
    it gives the orders.

    `held_out` `(n,)` tells the samples of `record` that gave the held-out scores. `chosen` is the
    paper's rule: the smallest order (poles + zeros, then poles) whose FIT is within `fit_loss`
    points of the best that the data support. `chosen_by_bic` has the least BIC. They may differ;
    both are told. `note` says what was looked at where that is not all.
    """

    plant: PlantSpec
    record: Record
    held_out: NDArray[np.bool_]
    fits: Mapping[str, Fit]
    chosen: str
    chosen_by_bic: str
    fit_loss: float
    note: str = ""

    def __repr__(self) -> str:
        fitted = sum(fit.ok for fit in self.fits.values())
        best = f"{self.chosen} (FIT {self.best.fit:.2f} %), by BIC {self.chosen_by_bic}"
        many = "1 order" if fitted == 1 else f"{fitted} orders"
        return f"<OrderGrid of {self.plant.name}: {many} fitted, chosen {best}>"

    def __iter__(self) -> Iterator[str]:
        return iter(self.fits)

    def __len__(self) -> int:
        return len(self.fits)

    def __contains__(self, order: object) -> bool:
        return order in self.fits

    def keys(self) -> KeysView[str]:
        """The orders."""
        return self.fits.keys()

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.fits)

    def __getitem__(self, order: str) -> Fit:
        if order not in self.fits:
            raise KeyError(f"{order!r} is not in the grid; {nearest(str(order), self.fits)}")
        return self.fits[order]

    @property
    def best(self) -> Fit:
        """The fit of the chosen order (the paper's rule)."""
        return self.fits[self.chosen]

    @property
    def left_out(self) -> list[Fit]:
        """Orders whose FIT is better than the chosen one's by more than `fit_loss` points, and that
        are left out since the data do not support them; the best first."""
        least = self.best.fit + self.fit_loss
        unsupported = [f for f in self.fits.values() if f.fit > least and not f.supported]
        return sorted(unsupported, key=lambda fit: -fit.fit)

    def table(self) -> list[dict[str, object]]:
        """One row per order, improper ones included with their reason."""
        return [
            {
                "order": f.order,
                "fit": f.fit,
                "mse": f.mse,
                "held_out_fit": f.held_out_fit,
                "aic": f.aic,
                "bic": f.bic,
                "supported": f.supported,
                "status": f.status,
            }
            for f in self.fits.values()
        ]

    def write(self, folder: str | PathLike[str], *, report: bool = True) -> None:
        """Write what `vdmsi identify` writes of a plant: `identify.json`, which `load_model` takes,
        and, if asked, `report.html`. The grids of several plants go into one folder by
        `vdmsi_jax.report.files.write_identification`.

        **Arguments:**

        - `folder`: made if it is not there.
        - `report`: whether to draw the report, too.

        **Raises:** `InputError` if the folder cannot be made or written to.
        """
        files: Any = importlib.import_module("vdmsi_jax.report.files")  # loaded when asked for
        files.write_identification(folder, {self.plant.name: self}, report=report)


def _roots(coefficients: ArrayLike) -> NDArray[np.complex128]:
    """Roots, without compiling a program for each order as `TransferFunction.poles` does."""
    return np.roots(np.asarray(coefficients)).astype(complex)
