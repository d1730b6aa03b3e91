"""Causes of the body, the road and the sensors as the contract names them."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...effects.bank import STEEPEST
from ...effects.yaw_offset import YawOffset
from ..answer.result import Estimate, Rival
from ..body.body import ASKEW, CAUSES, INDEX, Body, BodyCause
from ..body.lane import BodyFit
from ..body.search import BodySearch
from ..search.found import MARGIN
from .naming import CLEAR, Named, one_each

SEEN_BY_POSE = frozenset({"bank", "speed_scale"})
"""Causes that may stand in for others where no pose is, and that a pose tells from these."""

_LEANS = 0.1  # slope to a side, beyond which no road leans all the way


def of_body(search: BodySearch) -> list[Named]:
    """The causes of the body, the road and the sensors. What fails on data held out is no rival."""
    found = []
    failed = {f.finding.number for f in search.failed}
    for finding in search.findings:
        cause = CAUSES[finding.number]
        index = INDEX[finding.number]
        std = _stds(search.final)
        parameters = {
            name: Estimate(float(search.final.theta[i]), std.get(i, math.nan), unit)
            for name, i, unit in zip(cause.names, index, cause.units, strict=True)
        }
        rivals = [
            Rival(CAUSES[k].cause, CAUSES[k].where, lack, lack < MARGIN, CAUSES[k].channel)
            for k, lack in finding.others
            if k not in failed and CAUSES[k].told != cause.told
        ]
        named = Named(
            *cause.told,
            _told_otherwise(cause, parameters, search.body),
            parameters,
            finding.gain,
            len(index),
            one_each(rivals),
            body=finding,
        )  # fmt: skip
        if "aside" in search.body.measured:
            named = as_offset(named)
        elif finding.number == ASKEW:
            named = or_bank(named)
        if "forward" not in search.body.measured:
            named = or_wheels(named)
        found.append(named)
    return found


def or_bank(cause: Named) -> Named:
    """An offset of the wheels that a road which leans to one side could make as well, where no pose
    tells whether the vehicle slips down it."""
    if abs(cause.parameters["bias"].value) > STEEPEST * _LEANS:
        return cause
    return replace(cause, rivals=(Rival("bank", cause.where, 0.0, True), *cause.rivals))


def or_wheels(cause: Named) -> Named:
    """Another wheelbase that wheels of another size could make as well, where no pose tells how far
    the vehicle has come: the yaw rate has the speed over the base."""
    if cause.cause != "geometry_scale":
        return cause
    return replace(cause, rivals=(Rival("speed_scale", cause.where, 0.0, True), *cause.rivals))


def as_offset(cause: Named) -> Named:
    """A bank that only turns the wheels, as an offset of the wheels does, is told as that one: its
    slope is not told from nothing."""
    if cause.cause != "bank":
        return cause
    offset = next((r for r in cause.rivals if r.cause == "offset" and r.indistinguishable), None)
    if cause.body is not None and not dict(cause.body.others).get(ASKEW, MARGIN) < MARGIN:
        offset = None  # or one of the yaw rate
    slope, pull = cause.parameters["slope"], cause.parameters["pull"]
    if offset is None or abs(slope.value) > CLEAR * slope.std:
        return cause
    rivals = (Rival("bank", cause.where, 0.0, True), *(r for r in cause.rivals if r is not offset))
    return replace(cause, cause="offset", parameters={"bias": pull}, rivals=rivals)


def _told_otherwise(cause: BodyCause, parameters: Mapping[str, Estimate], body: Body) -> str:
    """Which form a cause of the body has, and how else it is measured: understeer by the lateral
    acceleration, since `L / R (1 + K v^2) = L / R + K L a` (Gillespie, Fundamentals of Vehicle
    Dynamics, 1992)."""
    if isinstance(cause.effect, YawOffset):
        return "of the yaw rate"
    if cause.cause != "understeer":
        return ""
    per_acceleration = parameters["gradient"].value * float(body.bicycle.wheelbase)
    return f"of {per_acceleration:.2g} rad per m/s^2"


def _stds(fit: BodyFit) -> dict[int, float]:
    return {
        i: float(np.sqrt(max(fit.covariance[k, k], 0.0)))
        for k, i in enumerate(fit.free)
        if k < len(fit.covariance)
    }
