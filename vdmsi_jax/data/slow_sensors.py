"""Sensors that are slower than the log, as a satellite receiver is: cells at their own rate."""

from dataclasses import replace

import numpy as np

from ..config import CANONICAL
from .record import Record

_LATEST = 2.0  # times the usual distance of its samples, beyond which one is missing


def between_their_samples(record: Record) -> tuple[Record, dict[str, float]]:
    """The record with what lies between the samples of a slow sensor as if it were measured, on the
    straight line from one to the next, and their usual distance, s, by channel. What a filter takes
    for the colour of noise needs samples in every row; a response goes smoothly from one to the
    next. Commands stay as they are, and so does what is missing for longer.
    """
    inputs = {plant.input for plant in record.plants} | {"v_cmd", "delta_cmd"}
    answers = {*CANONICAL, *(plant.output for plant in record.plants)} - inputs
    channels, filled, found = dict(record.channels), dict(record.filled), {}
    for name in [name for name in record.filled if name in answers]:
        at = [np.flatnonzero(record.measured(name)[s.samples]) + s.start for s in record.segments]
        steps = np.concatenate([np.diff(own) for own in at])
        usual = float(np.median(steps)) if steps.size else 1.0
        if usual <= 1.0:
            continue
        values, missing = record[name].copy(), record.filled[name].copy()
        for own in at:
            for first, last in zip(own[:-1], own[1:], strict=True):
                if last - first <= _LATEST * usual:
                    values[first:last] = np.interp(np.arange(first, last), own, record[name][own])
                    missing[first:last] = False
        each = float(np.mean(steps[steps <= _LATEST * usual]))
        channels[name], filled[name], found[name] = values, missing, each * record.dt
    return (replace(record, channels=channels, filled=filled), found) if found else (record, {})
