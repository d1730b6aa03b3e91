"""Transfer functions to and from `scipy.signal` and python-control, which are imported only here,
and only when asked for."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from vdmsi_jax.models.transfer_function import TransferFunction


def coefficients_from_scipy(system: Any) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of a continuous `scipy.signal` system (any of its three forms).

    Raises:
        ValueError: `system` is discrete, or has several inputs or outputs.
    """
    if system.dt is not None:
        raise ValueError(f"the system is discrete (dt = {system.dt}); give a continuous one")
    rational = system.to_tf()
    return _vector(rational.num), _vector(rational.den)


def coefficients_from_control(system: Any) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of a continuous python-control system (transfer function or state
    space).

    Raises:
        ValueError: `system` is discrete, or has several inputs or outputs.
    """
    import control

    if not system.isctime():
        raise ValueError(f"the system is discrete (dt = {system.dt}); give a continuous one")
    if not system.issiso():
        raise ValueError(
            f"the system has {system.ninputs} inputs and {system.noutputs} outputs; "
            "give one pair, system[i, j]"
        )
    rational: Any = control.tf(system)
    return _vector(rational.num[0][0]), _vector(rational.den[0][0])


def to_scipy(model: "TransferFunction") -> Any:
    """`scipy.signal.TransferFunction` of the dynamics.

    Raises:
        ValueError: the model has a delay or an offset, which scipy cannot hold.
    """
    import scipy.signal

    return scipy.signal.TransferFunction(*_bare(model, "scipy.signal"))


def to_control(model: "TransferFunction") -> Any:
    """`control.TransferFunction` of the dynamics.

    Raises:
        ValueError: the model has a delay or an offset, which python-control cannot hold.
    """
    import control

    return control.TransferFunction(*_bare(model, "python-control"))


def _bare(model: "TransferFunction", package: str) -> tuple[np.ndarray, np.ndarray]:
    if model.delay is not None or model.offset is not None:
        raise ValueError(
            f"{package} holds neither delay nor offset; "
            "give TransferFunction(model.num, model.den) to leave them out"
        )
    return np.asarray(model.num), np.asarray(model.den)


def _vector(coefficients: Any) -> np.ndarray:
    """Coefficients without the leading zeros that stand for a lower degree."""
    vector = np.squeeze(np.asarray(coefficients, float))
    if vector.ndim > 1:
        raise ValueError(f"the system has several outputs (coefficients {vector.shape}); give one")
    trimmed = np.trim_zeros(np.atleast_1d(vector), "f")
    return trimmed if trimmed.size else np.zeros(1)
