"""What the test vehicle is made of, and what may be wrong with it."""

import math
from dataclasses import dataclass, field, fields

from ..config import VehicleGeometry
from ..errors import InputError

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Dimensions:
    """The car as it was designed: the paper's table 1 where it says something, and a compact car.

    Attributes:
        l_f, l_r: centre of gravity to front and rear axle, m (table 1).
        track: distance between the wheels of an axle, m.
        cog_height: centre of gravity over the road, m.
        wheel_radius: m.
        mass: with the wheels, kg.
        yaw_inertia: of the body without wheels, kg m².
        wheel_mass: of one wheel, kg.
        trail: how far a front tyre touches the road behind its kingpin, m.
        suspension: stiffness at each wheel, N/m.
        suspension_damping: at each wheel, N s/m.
        friction: of the tyres on the road.
        creep: sideways and lengthways slip of a tyre per force on it, (m/s)/N; of a tyre that
            carries a quarter of the car, and inversely as the load that it was made for.
        front_creep: slip of a front tyre over that; more than 1 understeers.
        max_steering: of the road wheel, rad. Table 1 says 1.7, at which no car can roll; 0.7 here.
        max_acceleration: m/s² (table 1); it limits the drive's torque.
    """

    l_f: float = 1.75
    l_r: float = 1.20
    track: float = 1.5
    cog_height: float = 0.5
    wheel_radius: float = 0.31
    mass: float = 1356.0
    yaw_inertia: float = 1900.0
    wheel_mass: float = 18.0
    trail: float = 0.02
    suspension: float = 40_000.0
    suspension_damping: float = 3_500.0
    friction: float = 0.9
    creep: float = 6e-5
    front_creep: float = 1.1
    max_steering: float = 0.7
    max_acceleration: float = 4.5

    @property
    def wheelbase(self) -> float:
        """Distance between the axles, m."""
        return self.l_f + self.l_r

    @property
    def geometry(self) -> VehicleGeometry:
        """What a log's configuration says of the car; its pose is that of the centre of gravity."""
        return VehicleGeometry(self.l_f, self.l_r)


@dataclass(frozen=True)
class Controllers:
    """How the car follows its commands; what makes it differ from the plain VDM.

    The drive is a PI controller of the speed that the rear wheels turn with, whose torque follows
    with a lag. The steering is a servo: a velocity proportional to the angle that is missing, held
    by a torque.

    Attributes:
        speed_gain: acceleration asked for per missing speed, 1/s.
        speed_integral: and per its integral, 1/s².
        torque_lag: s.
        steering_gain: rate per missing angle, 1/s.
        steering_stiffness: torque per missing rate, N m s/rad.
        steering_ratio: road-wheel angle over what the command means by it. The paper's steering
            answers with 0.91 of its command (table 2, plateau of the step response).
        steering_inertia: of the servo, seen at the kingpin, kg m².
        steering_damping: of the linkage, N m s/rad.
    """

    speed_gain: float = 4.0
    speed_integral: float = 2.0
    torque_lag: float = 0.06
    steering_gain: float = 8.0
    steering_stiffness: float = 1500.0
    steering_ratio: float = 0.93
    steering_inertia: float = 3.0
    steering_damping: float = 20.0


@dataclass(frozen=True)
class Causes:
    """Physical switches, all off: what a diagnosis may have to name.

    Attributes:
        steering_friction: dry friction in the steering linkage, N m.
        steering_play: full width of the gap between servo and linkage, rad at the road wheel.
        steering_torque: greatest torque of the servo, N m.
        steering_rate: greatest rate of the servo, rad/s at the road wheel.
        steering_offset: angle of the road wheels at a straight servo, rad.
        drive_acceleration: greatest acceleration that the drive has torque for, m/s².
        grade: slope of the road, rising along the world's x (tangent).
        bank: slope of the road, rising along the world's y (tangent).
        mass_shift: how far the centre of gravity sits ahead of where the log believes it, m.
        wheel_scale: true over believed wheel radius.
        command_delay: s by which both commands arrive late.
        sensor_delay: s by which a pose is stamped too late in the log.
    """

    steering_friction: float = 0.0
    steering_play: float = 0.0
    steering_torque: float = math.inf
    steering_rate: float = math.inf
    steering_offset: float = 0.0
    drive_acceleration: float = math.inf
    grade: float = 0.0
    bank: float = 0.0
    mass_shift: float = 0.0
    wheel_scale: float = 1.0
    command_delay: float = 0.0
    sensor_delay: float = 0.0

    def __post_init__(self):
        signed = {"steering_offset", "grade", "bank", "mass_shift"}
        for own in fields(self):
            value = getattr(self, own.name)
            if math.isnan(value) or (own.name not in signed and value < 0.0):
                problem = f"{value} is no size"
                raise InputError("Causes", own.name, problem, "give a number, zero or more")


@dataclass(frozen=True)
class PoseSensor:
    """A lidar that is matched to a map: poses of the centre of gravity.

    Attributes:
        rate: scans per second; a whole fraction of the rows of a log.
        latency: s until a pose is known to whoever steers.
        place_noise: standard deviation of x and of y, m.
        heading_noise: rad.
    """

    rate: float = 50.0
    latency: float = 0.05
    place_noise: float = 0.005
    heading_noise: float = 0.001


@dataclass(frozen=True)
class Car:
    """A whole test vehicle: dimensions, controllers, what is wrong, and what is measured of it."""

    dimensions: Dimensions = field(default_factory=Dimensions)
    controllers: Controllers = field(default_factory=Controllers)
    causes: Causes = field(default_factory=Causes)
    sensor: PoseSensor = field(default_factory=PoseSensor)


UNITS = {
    **dict.fromkeys(("l_f", "l_r", "track", "cog_height", "wheel_radius", "trail"), "m"),
    **dict.fromkeys(("mass", "wheel_mass"), "kg"),
    "yaw_inertia": "kg m^2",
    "suspension": "N/m",
    "suspension_damping": "N s/m",
    "friction": "1",
    "creep": "(m/s)/N",
    "front_creep": "1",
    "max_steering": "rad",
    "max_acceleration": "m/s^2",
    "speed_gain": "1/s",
    "speed_integral": "1/s^2",
    "torque_lag": "s",
    "steering_gain": "1/s",
    "steering_stiffness": "N m s/rad",
    "steering_ratio": "1",
    "steering_inertia": "kg m^2",
    "steering_damping": "N m s/rad",
    "steering_friction": "N m",
    "steering_play": "rad",
    "steering_torque": "N m",
    "steering_rate": "rad/s",
    "steering_offset": "rad",
    "drive_acceleration": "m/s^2",
    "grade": "1",
    "bank": "1",
    "mass_shift": "m",
    "wheel_scale": "1",
    "command_delay": "s",
    "sensor_delay": "s",
    "rate": "Hz",
    "latency": "s",
    "place_noise": "m",
    "heading_noise": "rad",
}
"""The unit of every number of a car."""
