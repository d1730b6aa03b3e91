"""The car as MuJoCo is told of it."""

import math

import numpy as np

from .car import GRAVITY, Car, Dimensions

STEP = 0.002
"""Time step of the engine, s."""

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
_NORMAL_TIME = 0.02  # s, time constant of a contact: the engine's own
_IMPEDANCE = 0.9  # of a contact; the engine's own begins there
_INVERSE_MASS = 0.0416  # 1/kg, at a tyre as the engine reckons it: from the creep in steady turns


def mjcf(car: Car) -> str:
    """The MJCF document of a car on a flat road.

    The body moves freely; each wheel hangs on a spring. The knuckles of the front wheels turn about
    kingpins and are tied to the angle of the linkage by Ackermann's geometry, the linkage to the
    servo, rigidly or with play. A tyre touches the road in one point and creeps in proportion to
    the force on it, up to its friction. A slope is a tilt of gravity.
    """
    d, c, k = car.dimensions, car.causes, car.controllers
    radius = d.wheel_radius * c.wheel_scale
    body_mass = d.mass - 4.0 * d.wheel_mass
    gx, gy, gz = _gravity(c.grade, c.bank)
    ixx, iyy = 0.3 * d.yaw_inertia, 0.9 * d.yaw_inertia
    corners = "\n".join(_corner(car, name, radius) for name in CORNERS)
    pairs = "\n".join(
        f'<pair geom1="{name}" geom2="road" condim="3" friction="{d.friction} {d.friction} 0 0 0" '
        f'solref="{_NORMAL_TIME} 1" solreffriction="{_creep(d, name)}" '
        f'solimp="{_IMPEDANCE} {_IMPEDANCE} 0.001"/>'
        for name in CORNERS
    )
    left, right = (" ".join(f"{a:.9g}" for a in knuckle_polynomial(car, s)) for s in (1.0, -1.0))
    half_gap = 0.5 * c.steering_play / k.steering_ratio
    play = (
        f'<tendon><fixed name="play" limited="true" range="{-half_gap} {half_gap}" '
        'solreflimit="0.006 1"><joint joint="linkage" coef="1"/><joint joint="servo" coef="-1"/>'
        "</fixed></tendon>"
        if c.steering_play > 0.0
        else ""
    )
    rigid = (
        ""
        if play
        else '<joint joint1="linkage" joint2="servo" polycoef="0 1 0 0 0" solref="0.006 1"/>'
    )
    return f"""<mujoco model="car">
<compiler angle="radian" autolimits="true"/>
<option timestep="{STEP}" gravity="{gx} {gy} {gz}" cone="elliptic" integrator="implicitfast"/>
<visual><global offwidth="1280" offheight="720"/><headlight ambient="0.5 0.5 0.5"/>
<map znear="0.05" zfar="300"/></visual>
<asset>
<texture name="sky" type="skybox" builtin="gradient" rgb1="0.75 0.85 0.95" rgb2="1 1 1" width="64"
 height="64"/>
<texture name="ground" type="2d" builtin="checker" rgb1="0.62 0.64 0.62" rgb2="0.66 0.68 0.66"
 width="256" height="256"/>
<material name="ground" texture="ground" texrepeat="0.5 0.5" texuniform="true" reflectance="0"/>
</asset>
<worldbody>
<light directional="true" castshadow="false" pos="0 0 40" dir="-0.3 0.2 -1" diffuse="0.6 0.6 0.6"/>
<geom name="road" type="plane" size="200 200 1" material="ground" contype="0" conaffinity="0"/>
<body name="car" pos="0 0 {d.cog_height}">
<freejoint name="free"/>
<inertial pos="{c.mass_shift} 0 0" mass="{body_mass}" diaginertia="{ixx} {iyy} {d.yaw_inertia}"/>
<geom type="box" pos="{0.5 * (d.l_f - d.l_r)} 0 0.05" size="{0.5 * d.wheelbase + 0.65}
 {0.5 * d.track + 0.1} 0.28" rgba="0.16 0.42 0.72 1" contype="0" conaffinity="0" mass="0"/>
<geom type="box" pos="{0.5 * (d.l_f - d.l_r) - 0.25} 0 0.6" size="1.05 {0.5 * d.track} 0.28"
 rgba="0.2 0.24 0.3 1" contype="0" conaffinity="0" mass="0"/>
<geom type="cylinder" pos="0 0 0.98" size="0.09 0.1" rgba="0.1 0.1 0.1 1" contype="0"
 conaffinity="0" mass="0"/>
{corners}
<body name="linkage" pos="{d.l_f} 0 0">
<joint name="linkage" type="hinge" axis="0 0 1" armature="0.5" damping="{k.steering_damping}"
 frictionloss="{c.steering_friction}"/>
<inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/></body>
<body name="servo" pos="{d.l_f} 0 0">
<joint name="servo" type="hinge" axis="0 0 1" armature="{k.steering_inertia}"/>
<inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/></body>
</body>
</worldbody>
<contact>{pairs}</contact>
<equality>{rigid}
<joint joint1="kingpin_front_left" joint2="linkage" polycoef="{left}" solref="0.006 1"/>
<joint joint1="kingpin_front_right" joint2="linkage" polycoef="{right}" solref="0.006 1"/>
</equality>
{play}
<actuator>
<motor name="drive_left" joint="axle_rear_left"/>
<motor name="drive_right" joint="axle_rear_right"/>
<motor name="servo" joint="servo"/>
</actuator>
</mujoco>
"""


def knuckle_polynomial(car: Car, side: float) -> np.ndarray:
    """Angle of a front wheel over that of the linkage, coefficients ascending, (5,).

    Ackermann's geometry, `cot` of the wheel's angle less `cot` of the middle's is half the track
    over the wheelbase (Rajamani 2012), fitted where the car can steer.

    Args:
        car: the car.
        side: 1 for the left wheel, -1 for the right one.
    """
    d, k = car.dimensions, car.controllers
    linkage = np.linspace(-1.1, 1.1, 221) * d.max_steering
    middle = np.tan(k.steering_ratio * linkage + car.causes.steering_offset)
    wheel = np.arctan(d.wheelbase * middle / (d.wheelbase - side * 0.5 * d.track * middle))
    return np.polynomial.polynomial.polyfit(linkage, wheel, 4)


def _corner(car: Car, name: str, radius: float) -> str:
    d: Dimensions = car.dimensions
    front, left = name.startswith("front"), name.endswith("left")
    x, y = (d.l_f if front else -d.l_r), (0.5 if left else -0.5) * d.track
    share = (d.l_r if front else d.l_f) / d.wheelbase
    load = 0.5 * (d.mass - 4.0 * d.wheel_mass) * GRAVITY * share
    spin, tilt = 0.5 * d.wheel_mass * radius**2, 0.3 * d.wheel_mass * radius**2
    kingpin = (
        f'<joint name="kingpin_{name}" type="hinge" axis="0 0 1" pos="{d.trail} 0 0" '
        'armature="0.2"/>'
        if front
        else ""
    )
    return f"""<body name="hub_{name}" pos="{x} {y} {radius - d.cog_height}">
<joint name="spring_{name}" type="slide" axis="0 0 1" stiffness="{d.suspension}"
 springref="{-load / d.suspension}" damping="{d.suspension_damping}"/>{kingpin}
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
<body name="wheel_{name}">
<joint name="axle_{name}" type="hinge" axis="0 1 0" damping="0.5"/>
<inertial pos="0 0 0" mass="{d.wheel_mass - 1.0}" diaginertia="{tilt} {spin} {tilt}"/>
<geom name="{name}" type="sphere" size="{radius}" rgba="0 0 0 0" contype="0" conaffinity="0"/>
<geom type="cylinder" size="{radius} 0.1" euler="{0.5 * math.pi} 0 0" rgba="0.08 0.08 0.08 1"
 contype="0" conaffinity="0"/>
<geom type="box" size="{0.7 * radius} 0.11 0.03" rgba="0.8 0.8 0.8 1" contype="0" conaffinity="0"/>
</body></body>"""


def _gravity(grade: float, bank: float) -> tuple[float, float, float]:
    """Gravity in the frame of a road with these slopes, m/s²."""
    size = GRAVITY / math.sqrt(1.0 + grade**2 + bank**2)
    return -grade * size, -bank * size, -size


def _creep(d: Dimensions, corner: str) -> str:
    """`solreffriction` for which a tyre slips as `Dimensions.creep` says.

    A friction constraint of the engine settles where `b v = R f`, with `R` an inverse mass times
    `(1 - d) / d` and `b = 2 / (d time_constant)` (MuJoCo documentation, Computation).
    """
    share = 2.0 * (d.l_r if corner.startswith("front") else d.l_f) / d.wheelbase
    creep = d.creep / share * (d.front_creep if corner.startswith("front") else 1.0)
    time_constant = 2.0 * creep / (_INVERSE_MASS * (1.0 - _IMPEDANCE))
    return f"{max(time_constant, 2.0 * STEP):.6g} 1"
