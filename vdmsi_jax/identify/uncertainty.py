"""How sure the estimates are: covariance under coloured noise, roots, and what the data support."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vdmsi_jax.identify.result import Floats

_LONGEST_AR = 30
_SMALLEST = 1e-12  # relative singular value below which a direction counts as unsupported
_SUPPORT = 2.0  # standard deviations
_CANCELLED = 0.02  # distance of a pole and a zero, relative to the pole, that makes no difference


def autocovariance(residual: Floats, segments: list[slice], lags: int) -> Floats:
    """Autocovariance (lags + 1,) of a residual of zero mean, pooled over segments."""
    total = np.zeros(lags + 1)
    n = 0
    for segment in segments:
        e = residual[segment]
        size = 1 << int(np.ceil(np.log2(2 * len(e))))
        spectrum = np.abs(np.fft.rfft(e, size)) ** 2
        c = np.fft.irfft(spectrum, size)[: lags + 1]
        total[: len(c)] += c
        n += len(e)
    return total / n


def ar_model(covariance: Floats, n: int) -> tuple[Floats, float]:
    """Autoregressive model of a residual, its order chosen by BIC (Levinson-Durbin recursion).

    Returns the coefficients of e[t] = sum_i phi[i] e[t-1-i] + w[t], none if it is white, and the
    variance of w.
    """
    phi, variance = np.zeros(0), float(covariance[0])
    best, least = (phi, variance), n * np.log(max(variance, 1e-300))
    for order in range(1, len(covariance)):
        if variance <= 0:
            break
        reflection = (
            covariance[order] - phi @ covariance[order - 1 : 0 : -1][: order - 1]
        ) / variance
        phi = np.append(phi - reflection * phi[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = n * np.log(max(variance, 1e-300)) + order * np.log(n)
        if criterion < least:
            best, least = (phi, variance), criterion
    return best


def parameter_covariance(
    jacobian: Floats, residual: Floats, segments: list[slice], degrees_lost: int
) -> Floats:
    """Covariance of least-squares estimates when the noise is coloured.

    (J'J)^-1 J' S J (J'J)^-1 with the covariance S of an autoregressive model of the residual; the
    plain s^2 (J'J)^-1 where the residual is white (Soderstrom & Stoica, System Identification,
    1989, ch. 7 and complement C7.4).

    **Arguments:** `jacobian` `(n, p)`, `residual` `(n,)`; `segments` of these rows that follow each
    other in time; `degrees_lost`, the number of fitted parameters, initial states included.
    """
    n, p = jacobian.shape
    if p == 0:
        return np.zeros((0, 0))
    norm = np.linalg.norm(jacobian, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    Q, R = np.linalg.qr(jacobian / norm)  # the decomposition of R is that of the whole, and small
    U, s, Vt = np.linalg.svd(R)
    U = Q @ U
    inverse = Vt.T / np.maximum(s, _SMALLEST * s[0])
    correction = n / max(n - degrees_lost, 1)
    lags = min(_LONGEST_AR, max(n // 10, 1))
    phi, variance = ar_model(autocovariance(residual, segments, lags), n)
    if len(phi) == 0:
        middle = variance * np.eye(p)
    else:
        middle = np.zeros((p, p))
        longest = max(s.stop - s.start for s in segments)
        size = 1 << int(np.ceil(np.log2(2 * longest)))
        spectrum = variance / np.abs(np.fft.rfft(np.append(1.0, -phi), size)) ** 2
        for segment in segments:
            # circular convolution over twice the length: the end of a segment meets zeros
            coloured = np.fft.irfft(
                np.fft.rfft(U[segment], size, axis=0) * spectrum[:, None], size, axis=0
            )
            middle += U[segment].T @ coloured[: segment.stop - segment.start]
    covariance = correction * inverse @ middle @ inverse.T
    return covariance / norm[:, None] / norm[None, :]


def root_sensitivity(coefficients: Floats, roots: NDArray) -> NDArray[np.complex128]:
    """Derivative (roots, coefficients) of roots by coefficients of descending powers."""
    roots = np.asarray(roots, complex)
    slope = np.polyval(np.polyder(coefficients), roots)
    powers = roots[:, None] ** np.arange(len(coefficients) - 1, -1, -1)[None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        return -(powers / slope[:, None]).astype(complex)


def deviation(gradient: NDArray, covariance: Floats) -> Floats:
    """Standard deviation of complex quantities with the given gradients (q, p)."""
    variance = np.einsum("qi,ij,qj->q", np.conj(gradient), covariance, gradient).real
    return np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class Remark:
    """One thing about a model's poles and zeros; `unsupported` if the data cannot tell it from a
    smaller model, `unsound` if a simulation of it goes wrong: it grows, or is an alias."""

    message: str
    unsupported: bool
    unsound: bool = False


def support_remarks(
    num: Floats, den: Floats, covariance: Floats, *, dt: float, duration: float
) -> tuple[Remark, ...]:
    """What of the poles and zeros the data do not support, and what else is odd about them.

    **Arguments:** `num`, `den` in descending powers of s, den[0] = 1; `covariance` of
    (num, den[1:]) in this order; sampling period and duration in s.
    """
    poles, zeros = np.roots(den).astype(complex), np.roots(num).astype(complex)
    m = len(num)
    of_pole = np.zeros((len(poles), len(covariance)), complex)
    of_pole[:, m:] = np.nan_to_num(root_sensitivity(den, poles)[:, 1:])
    of_zero = np.zeros((len(zeros), len(covariance)), complex)
    of_zero[:, :m] = np.nan_to_num(root_sensitivity(num, zeros))
    remarks = _cancellations(poles, zeros, of_pole, of_zero, covariance)
    for pole, std in zip(poles, deviation(of_pole, covariance), strict=True):
        name = f"pole {_text(pole)} (± {std:.2g}) rad/s"
        if pole.imag < 0:
            continue
        if abs(pole) <= max(_SUPPORT * std, 0.1 / duration) and abs(pole) * duration < 10:
            told = "cannot be told from an integrator: the static gain is not known from"
            remarks.append(Remark(f"{name} {told} {duration:.3g} s", True))
        elif pole.real > 0:
            within = " within its uncertainty" if pole.real <= _SUPPORT * std else ""
            remarks.append(
                Remark(f"{name} is unstable{within}", True, bool(pole.real * duration > 1.0))
            )
        elif pole.imag * dt > np.pi:
            remarks.append(Remark(f"{name} swings faster than the sampling can show", True, True))
        elif abs(pole) * dt > np.pi:
            remarks.append(Remark(f"{name} is faster than the sampling can show", True))
    for zero, std in zip(zeros, deviation(of_zero, covariance), strict=True):
        name = f"zero {_text(zero)} (± {std:.2g}) rad/s"
        if zero.imag < 0 or zero.real <= 0:
            continue
        if zero.real <= _SUPPORT * std or abs(zero) * dt > np.pi:
            told = "lies on the right, which the data do not support: its sign is within the noise"
        else:
            slow = zero.real * duration <= 1.0
            told = "in the end" if slow else "at first"
            told = f"is non-minimum-phase: a step is answered the wrong way {told}"
        remarks.append(Remark(f"{name} {told}", False))
    return tuple(remarks)


def _cancellations(
    poles: NDArray, zeros: NDArray, of_pole: NDArray, of_zero: NDArray, covariance: Floats
) -> list[Remark]:
    """Poles and zeros that lie closer together than the data can tell."""
    remarks, free = [], list(range(len(zeros)))
    for i, pole in enumerate(poles):
        if pole.imag < 0 or not free:
            continue
        j = min(free, key=lambda j: abs(zeros[j] - pole))
        distance = abs(zeros[j] - pole)
        spread = float(deviation((of_pole[i] - of_zero[j])[None], covariance)[0])
        if distance <= max(_SUPPORT * spread, _CANCELLED * abs(pole)):
            free.remove(j)
            pair = f"pole {_text(pole)} and zero {_text(zeros[j])} rad/s nearly cancel"
            apart = f"{distance:.2g} apart, ± {spread:.2g}"
            remarks.append(Remark(f"{pair} ({apart}): the data do not support the pair", True))
    return remarks


def _text(root: complex) -> str:
    if abs(root.imag) <= 1e-9 * abs(root):
        return f"{root.real:.3g}"
    return f"{root.real:.3g} ± {abs(root.imag):.3g}j"
