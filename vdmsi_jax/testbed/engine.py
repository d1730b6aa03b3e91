"""The car in motion: MuJoCo, and the two controllers that follow the commands."""

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .car import Car
from .mjcf import STEP, mjcf

ROW = 0.01
"""Time between two commands, and two rows of a log: the paper's 100 Hz, s."""

_SETTLING = 1.0  # s that the car stands before it starts


class State(NamedTuple):
    """The truth about the car's reference point.

    Attributes:
        x, y, psi: position, m, and heading, rad, not wrapped.
        v: speed along the course, m/s; negative backwards.
        r: yaw rate, rad/s.
        delta: mean of the angles of the front wheels, rad.
    """

    x: float
    y: float
    psi: float
    v: float
    r: float
    delta: float


def load_mujoco() -> Any:
    """The module `mujoco`.

    Raises:
        InputError: it is not installed.
    """
    try:
        import mujoco
    except ImportError:
        mend = "pip install vdmsi_jax[mujoco], or use the logs that are shipped"
        raise InputError("vdmsi_jax.testbed", "", "MuJoCo is not installed", mend) from None
    return mujoco


class Engine:
    """One car, standing at the origin and heading along x, driven row by row.

    **Arguments:**

    - `car`: what drives.

    Raises InputError where MuJoCo is not installed.
    """

    def __init__(self, car: Car):
        self.car, self.mujoco = car, load_mujoco()
        self.model = self.mujoco.MjModel.from_xml_string(mjcf(car))
        self.data = self.mujoco.MjData(self.model)
        joint = {self.model.joint(i).name: self.model.joint(i) for i in range(self.model.njnt)}
        self._wheels = [int(joint[f"axle_rear_{s}"].dofadr[0]) for s in ("left", "right")]
        self._kingpins = [int(joint[f"kingpin_front_{s}"].qposadr[0]) for s in ("left", "right")]
        self._servo = int(joint["servo"].qposadr[0]), int(joint["servo"].dofadr[0])
        self._turns, self._heading = 0.0, 0.0
        self._missed = self._force = 0.0
        rows = round(car.causes.command_delay / ROW)
        self._underway = deque([(0.0, 0.0)] * rows)
        for _ in range(round(_SETTLING / ROW)):
            self._drive(0.0, 0.0)
        self.data.time = 0.0

    @property
    def state(self) -> State:
        """Where the car is and how it moves."""
        q, u = self.data.qpos, self.data.qvel
        psi = float(
            np.arctan2(2.0 * (q[3] * q[6] + q[4] * q[5]), 1.0 - 2.0 * (q[5] ** 2 + q[6] ** 2))
        )
        self._heading += float(np.remainder(psi - self._heading + np.pi, 2.0 * np.pi) - np.pi)
        ahead = u[0] * np.cos(psi) + u[1] * np.sin(psi)
        speed = float(np.copysign(np.hypot(u[0], u[1]), ahead))
        delta = float(np.mean(q[self._kingpins]))
        return State(float(q[0]), float(q[1]), self._heading, speed, float(u[5]), delta)

    def step(self, v_cmd: float, delta_cmd: float) -> State:
        """Hold both commands (m/s, rad at the road wheel) for a row, and say where that led."""
        self._underway.append((v_cmd, delta_cmd))
        self._drive(*self._underway.popleft())
        return self.state

    def _drive(self, v_cmd: float, delta_cmd: float) -> None:
        car, data, mj_step = self.car, self.data, self.mujoco.mj_step
        d, k, c = car.dimensions, car.controllers, car.causes
        limit = d.max_steering
        aim = min(max(delta_cmd, -limit), limit)
        left, right = self._wheels
        angle, rate = self._servo
        strongest = d.mass * min(d.max_acceleration, c.drive_acceleration)
        ctrl, qpos, qvel = data.ctrl, data.qpos, data.qvel
        for _ in range(round(ROW / STEP)):
            # the encoder's speed, by the radius that the car believes in
            speed = 0.5 * (qvel[left] + qvel[right]) * d.wheel_radius
            missing = v_cmd - speed
            wanted = d.mass * (k.speed_gain * missing + k.speed_integral * self._missed)
            force = min(max(wanted, -strongest), strongest)
            if force == wanted:
                self._missed += STEP * missing
            self._force += STEP / k.torque_lag * (force - self._force)
            ctrl[0] = ctrl[1] = 0.5 * self._force * d.wheel_radius
            turning = k.steering_gain * (aim - qpos[angle])
            turning = min(max(turning, -c.steering_rate), c.steering_rate)
            torque = k.steering_stiffness * (turning - qvel[rate])
            ctrl[2] = min(max(torque, -c.steering_torque), c.steering_torque)
            mj_step(self.model, data)


def states(rows: list[State]) -> Float[np.ndarray, "N 6"]:
    """The truth of many rows as one array, columns as in `State`."""
    return np.array(rows, float)
