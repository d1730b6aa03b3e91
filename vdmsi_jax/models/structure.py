"""What a plant's own poles and zeros give away, before any data is asked.

Order selection absorbs effects that are no actuator dynamics into poles and zeros that nobody would
build: the paper's steering model has a pole at -6.7e-9 and a zero at +0.0212 rad/s, and drifts
away from a held command. Such things are noticed here from the model and the length of the record
alone; whether the data support them is for the identification to weigh with its covariance.
"""

import enum
from dataclasses import dataclass

import numpy as np

from vdmsi_jax.models.transfer_function import TransferFunction

CANCELLATION = 0.05  # distance of a pole and a zero, relative to the farther from the origin
INTEGRATOR = 0.1  # a pole moves so little within the record (its modulus times the duration)


class Kind(enum.Enum):
    """What is odd about a pole, a zero, or a pair of them."""

    NEAR_CANCELLATION = "near-cancelling pole and zero"
    SLOW_PAIR = "pole and zero slower than the record"
    NEAR_INTEGRATOR = "near-integrator"
    UNSTABLE = "unstable pole"
    NON_MINIMUM_PHASE = "non-minimum-phase zero"


@dataclass(frozen=True)
class Note:
    """One oddity of a plant's structure.

    Attributes:
        kind: what it is.
        message: one sentence that says what it means for the user.
        pole: the pole concerned, rad/s.
        zero: the zero concerned, rad/s.
    """

    kind: Kind
    message: str
    pole: complex | None = None
    zero: complex | None = None


def structure_notes(model: TransferFunction, *, duration: float) -> tuple[Note, ...]:
    """All oddities of `model`, judged on the horizon of a record of `duration` seconds.

    A conjugate pair is told once. Padding, delay and offset play no part.

    Raises:
        ValueError: `duration` is not positive.
    """
    if not duration > 0.0:
        raise ValueError(f"duration is the length of the record in s, more than 0, not {duration}")
    poles, zeros = _upper_half(model.poles()), _upper_half(model.zeros())
    notes: list[Note] = []
    for pole, zero in _nearest_pairs(poles, zeros):
        size = max(abs(pole), abs(zero))
        if abs(pole - zero) <= CANCELLATION * size:
            share = f"{abs(pole - zero) / size:.1%}" if size else "0 %"
            message = f"pole {_text(pole)} and zero {_text(zero)} cancel within {share}"
            notes.append(Note(Kind.NEAR_CANCELLATION, f"{message}: a lower order", pole, zero))
        elif size * duration <= 1.0:
            message = (
                f"pole {_text(pole)} and zero {_text(zero)} nearly cancel at the origin: they act "
                f"as a drift over the {duration:g} s, not as dynamics of an actuator"
            )
            notes.append(Note(Kind.SLOW_PAIR, message, pole, zero))
    for pole in poles:
        if abs(pole) * duration <= INTEGRATOR:
            message = f"pole {_text(pole)} integrates over the {duration:g} s: no gain at rest"
            notes.append(Note(Kind.NEAR_INTEGRATOR, message, pole=pole))
        elif pole.real > 0.0:
            message = f"pole {_text(pole)} is unstable: it grows {_growth(pole, duration)}"
            notes.append(Note(Kind.UNSTABLE, message, pole=pole))
    for zero in zeros:
        if zero.real > 0.0:
            message = f"zero {_text(zero)} lies on the right: a step is answered the wrong way"
            slow = zero.real * duration <= 1.0
            when = "in the end" if slow else "at first"
            notes.append(Note(Kind.NON_MINIMUM_PHASE, f"{message} {when}", zero=zero))
    return tuple(notes)


def plateau_gain(model: TransferFunction, *, duration: float) -> float:
    """Gain at which a held command settles before anything slower than the record acts.

    The gain at rest of the plant without its poles and zeros whose modulus times `duration` is
    below one. It equals the DC gain where there are none, and is infinite or zero where slow poles
    and slow zeros are not equally many.
    """
    poles, zeros = np.asarray(model.poles()), np.asarray(model.zeros())
    slow_poles, slow_zeros = np.abs(poles) * duration <= 1.0, np.abs(zeros) * duration <= 1.0
    surplus = int(slow_poles.sum()) - int(slow_zeros.sum())
    gain = float(model.num[0])
    gain *= float(np.real(np.prod(-zeros[~slow_zeros]) / np.prod(-poles[~slow_poles])))
    return gain if surplus == 0 else (np.copysign(np.inf, gain) if surplus > 0 else 0.0)


def _upper_half(roots: object) -> list[complex]:
    """Finite roots, each conjugate pair by its upper one."""
    return [complex(r) for r in np.asarray(roots) if np.isfinite(r) and r.imag >= 0.0]


def _nearest_pairs(poles: list[complex], zeros: list[complex]) -> list[tuple[complex, complex]]:
    """Poles and zeros matched one to one, the nearest first; real ones only with real ones."""
    candidates = sorted(
        (abs(pole - zero), i, j)
        for i, pole in enumerate(poles)
        for j, zero in enumerate(zeros)
        if (pole.imag == 0.0) == (zero.imag == 0.0)
    )
    pairs, used_poles, used_zeros = [], set(), set()
    for _, i, j in candidates:
        if i not in used_poles and j not in used_zeros:
            used_poles.add(i)
            used_zeros.add(j)
            pairs.append((poles[i], zeros[j]))
    return pairs


def _text(root: complex) -> str:
    """A root (or its conjugate pair) as a reader writes it."""
    return f"{root.real:.3g}" if root.imag == 0.0 else f"{root.real:.3g}±{root.imag:.3g}j"


def _growth(pole: complex, duration: float) -> str:
    exponent = pole.real * duration / np.log(10.0)
    return f"by 10^{exponent:.0f} over the {duration:g} s" if exponent > 1 else "slowly"
