"""What the plain VDM may make of a velocity command, which says nothing about acceleration.

Eq. (1) takes an acceleration. The paper does not say how its VDM comes by one; there are four
sensible rules, and where the command jumps they decide the VDM's error.
"""

import enum

import numpy as np

from ..config import VehicleGeometry
from ..data.record import Record
from ..metrics import Alignment, ate
from ..models.bicycle import Bicycle
from ..models.commands import Commands
from ..models.following import RateLimited
from ..models.vehicle import SpeedInput, Vehicle
from ..simulate import Start, Trajectory, simulate


class Rule(enum.Enum):
    """How VDM gets its speed; the value is the sentence that tells it."""

    VELOCITY = "the speed is the command, at once"
    DIFFERENCE = "a is the difference of the command over a sample, integrated from the true speed"
    LIMITED_DIFFERENCE = "that difference, cut to the maximum acceleration before it is integrated"
    RATE_LIMITED = "the speed approaches the command with the maximum acceleration"


def vdm(
    rule: Rule, commands: Commands, geometry: VehicleGeometry, start: Start, acceleration: float
) -> Trajectory:
    """Simulate the plain VDM by one of the rules.

    Args:
        rule: how the speed follows the command.
        commands: of the drive.
        geometry: of the vehicle.
        start: pose and speed at the first row.
        acceleration: greatest of the vehicle, m/s² (table 1).
    """
    bicycle = Bicycle(geometry.l_f, geometry.l_r)
    v0 = 0.0 if start.v is None else float(start.v)
    if rule is Rule.VELOCITY:
        return simulate(Vehicle(bicycle, speed_input=SpeedInput.VELOCITY), commands, start)
    if rule is Rule.DIFFERENCE:
        return simulate(Vehicle(bicycle), commands, start)
    if rule is Rule.RATE_LIMITED:
        begun = Start(start.x, start.y, start.psi, powertrain=np.array([v0]))
        vehicle = Vehicle(bicycle, RateLimited(acceleration), speed_input=SpeedInput.VELOCITY)
        return simulate(vehicle, commands, begun)
    reach = acceleration * float(commands.dt)
    gained = np.clip(np.diff(np.asarray(commands.v_cmd)), -reach, reach)
    v = v0 + np.concatenate([[0.0], np.cumsum(gained)])
    told = Commands(v, commands.delta_cmd, commands.dt)
    return simulate(Vehicle(bicycle, speed_input=SpeedInput.VELOCITY), told, start)


def rules(record: Record, acceleration: float) -> dict[Rule, dict[str, float]]:
    """ATE (max, mean, rmse, m) of the VDM by each rule on a drive whose pose and speed are known at
    its first row."""
    poses = np.stack([record[c] for c in ("x", "y", "psi")], axis=1)
    start = Start(*poses[0], v=record["v"][0])
    assert record.vehicle is not None
    commands, found = Commands.of(record), {}
    for rule in Rule:
        path = vdm(rule, commands, record.vehicle, start, acceleration).poses
        found[rule] = {k: float(v) for k, v in ate(poses, np.asarray(path), Alignment.NONE).items()}
    return found
