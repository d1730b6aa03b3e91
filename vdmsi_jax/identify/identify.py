"""The entry: records in, an order grid out."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from vdmsi_jax.config import IdentifyOptions, PlantSpec
from vdmsi_jax.data import check_excitation
from vdmsi_jax.data.copies import without_copies
from vdmsi_jax.data.record import Record, records_of
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify.most_moved import most_moved
from vdmsi_jax.identify.orders import order_grid
from vdmsi_jax.identify.result import OrderGrid
from vdmsi_jax.programs import make_room
from vdmsi_jax.threads import one_for_blas

_MOST = 200_000  # samples that are looked at; more would take minutes, and memory
_HELD_OUT = 0.25  # share of the samples, where nothing is said of it


def identify(
    records: Record | Sequence[Record],
    plant: str | PlantSpec,
    *,
    options: IdentifyOptions | None = None,
    **overrides: Any,
) -> OrderGrid:
    """Fit all orders PxZy to one plant of one or several logs of the same vehicle.

    Coefficients, delay, offset and the initial state of every segment minimise the simulation error
    (output error). Each order is fitted from several starts and from the orders that it contains.

    **Arguments:**

    - `records`: one record or several.
    - `plant`: "powertrain", "steering", the name of a plant of the configuration, or a `PlantSpec`.
    - `options`: what to fit and what to hold out; `overrides` replace single fields of it:
      `identify(log, "steering", poles=(1, 2), delay=False, held_out=0.0)`; one number of poles or
      zeros may stand alone. Where nothing is said of it, a quarter is held out: whole runs if there
      are three or more, blocks of each run otherwise.

    **Raises:** `InputError` where the channels are missing, do not move, or are too short.

    Of more than 200 000 samples those are looked at in which the command moves most; the record of
    the result holds these, and its `note` tells so.

    Works in the precision of JAX: in float32 (the default of JAX) a warning tells what it costs.
    A record that holds what another one holds is left out, with a warning. Nothing is held out,
    with a warning, where the rest would show no change of the command, and with a `note` where
    nobody asked for it and the log is too short.
    """
    several, copies = without_copies(records_of(records))
    for copy in copies:
        warnings.warn(copy, stacklevel=2)
    record = several[0] if len(several) == 1 else Record.concatenate(several)
    for name in overrides.keys() & {"poles", "zeros"}:
        given = overrides[name]
        if hasattr(given, "__index__") and np.ndim(given) == 0:  # one number
            overrides[name] = (given,)
    options = replace(options or IdentifyOptions(), **overrides)
    spec = plant if isinstance(plant, PlantSpec) else record.plant(plant)
    check_excitation(record, spec)
    record, note = _within_reach(record, spec)
    if jnp.zeros(()).dtype != jnp.float64:
        warnings.warn(
            "identifying in float32: orders above P2 lose digits and may not converge; "
            'call jax.config.update("jax_enable_x64", True) first',
            stacklevel=2,
        )
    make_room()
    held_out, short = _held_out(record, options)
    if held_out.any() and np.ptp(record[spec.input][~held_out]) == 0.0:
        warnings.warn(
            f"the command of {spec.name} changes only in what would be held out of {record.log}: "
            f"nothing is held out",
            stacklevel=2,
        )
        held_out = np.zeros(record.n, bool)
    with one_for_blas():
        return replace(order_grid(record, held_out, spec, options), note=note or short)


def _within_reach(record: Record, plant: PlantSpec) -> tuple[Record, str]:
    """The record, or of a very long one as much as is looked at, and what to say of that."""
    part, index = most_moved(record, plant, _MOST)
    if len(index) == record.n:
        return record, ""
    return part, (
        f"identified on {len(index)} of {record.n} samples, in the {len(part.segments)} stretches "
        f"in which {plant.input} moves most"
    )


def _held_out(record: Record, options: IdentifyOptions) -> tuple[NDArray[np.bool_], str]:
    """Which samples (n,) the held-out scores are for, and what to say where there are none."""
    mask = np.zeros(record.n, bool)
    share = _HELD_OUT if options.held_out is None else options.held_out
    split = options.split or ("run" if len(record.runs) >= 3 else "blocks")
    if share > 0:
        rows = replace(record, channels={"row": np.arange(record.n, dtype=float)}, filled={})
        try:
            hidden = rows.split(share, by=split)[1]
        except InputError as short:
            if options.held_out is not None or options.split is not None:
                raise
            return mask, f"nothing is held out: {short.problem}"
        mask[hidden["row"].astype(int)] = True
    return mask, ""
