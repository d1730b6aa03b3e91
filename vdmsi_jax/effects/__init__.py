"""The causes that the project knows: one file each, one line of the registry each."""

from vdmsi_jax.effects.backlash import (
    Backlash,
    CoastingBacklash,
    FollowedBacklash,
    LoadedBacklash,
)
from vdmsi_jax.effects.bank import Bank
from vdmsi_jax.effects.base import FORCES as FORCES
from vdmsi_jax.effects.base import AbstractEffect as AbstractEffect
from vdmsi_jax.effects.base import Effort as Effort
from vdmsi_jax.effects.base import Scales as Scales
from vdmsi_jax.effects.base import Signals as Signals
from vdmsi_jax.effects.coulomb_friction import CoulombFriction
from vdmsi_jax.effects.cross_coupling import CrossCoupling
from vdmsi_jax.effects.dead_zone import DeadZone, LateDeadZone
from vdmsi_jax.effects.drag import Drag
from vdmsi_jax.effects.gain_asymmetry import GainAsymmetry
from vdmsi_jax.effects.gain_drift import GainDrift
from vdmsi_jax.effects.gain_nonlinearity import (
    BentResponse,
    GainNonlinearity,
    PowerLaw,
    Stiffening,
)
from vdmsi_jax.effects.geometry_scale import GeometryScale
from vdmsi_jax.effects.misalignment import Misalignment
from vdmsi_jax.effects.offset import Offset
from vdmsi_jax.effects.periodic_disturbance import PeriodicDisturbance
from vdmsi_jax.effects.quantization import Quantization
from vdmsi_jax.effects.rate_limit import RateLimit
from vdmsi_jax.effects.regime_change import RegimeChange
from vdmsi_jax.effects.resonance import Resonance
from vdmsi_jax.effects.road_grade import RoadGrade
from vdmsi_jax.effects.saturation import EndStop, LateSaturation, RoundSaturation, Saturation
from vdmsi_jax.effects.sensor import SensorBias, SensorDelay, SensorLag
from vdmsi_jax.effects.speed_dependent_gain import SpeedDependentGain
from vdmsi_jax.effects.speed_scale import SpeedScale
from vdmsi_jax.effects.transport_delay import TransportDelay
from vdmsi_jax.effects.tyre_relaxation import TyreRelaxation
from vdmsi_jax.effects.understeer import Understeer
from vdmsi_jax.effects.yaw_inertia import YawInertia
from vdmsi_jax.effects.yaw_offset import YawOffset

ACTUATOR: tuple[AbstractEffect, ...] = (
    GainNonlinearity(by="sign"),
    GainNonlinearity(by="skew"),
    SpeedDependentGain(at="command"),
    CrossCoupling(by="signed"),
    CrossCoupling(by="size"),
    CrossCoupling(by="square"),
    CrossCoupling(by="slowed"),
    CrossCoupling(by="cornering"),
    CrossCoupling(by="speed"),
    CrossCoupling(by="acceleration"),
    Quantization(by="nearest"),
    Quantization(by="floor"),
    Quantization(by="truncation"),
    DeadZone(),
    GainAsymmetry(by="command"),  # of what comes through: a valve's overlap is the same both ways
    LateDeadZone(),
    Backlash(at="command"),
    Saturation(at="command"),
    RoundSaturation(),
    LateSaturation(),
    GainDrift(over="run"),  # of what is left of a command, whose limits are the sender's
    GainDrift(over="session"),
    RegimeChange(over="run"),
    RegimeChange(over="session"),
    TransportDelay(),
    RateLimit(at="command"),
    Resonance(),
    RoadGrade(),
    GainAsymmetry(by="effort"),
    Drag(),
    RateLimit(at="drive"),
    RateLimit(at="response"),
    CoulombFriction(against="rate"),
    CoulombFriction(against="response"),
    Stiffening(),
    GainAsymmetry(by="stiffness"),
    PowerLaw(),
    EndStop(),
    BentResponse(),
    Saturation(at="response"),
    Backlash(at="response"),
    LoadedBacklash(),
    CoastingBacklash(),
    FollowedBacklash(),
    PeriodicDisturbance(),
    Offset(by="itself"),
    Offset(by="travel"),
    SpeedDependentGain(at="response"),
)
"""Every cause and form that an actuator may have, off, in the order in which they act."""

VEHICLE: tuple[AbstractEffect, ...] = (
    SpeedScale(),
    Misalignment(),
    Bank(),
    GeometryScale(),
    Understeer(),
    TyreRelaxation(),
    YawOffset(),
    YawInertia(),
)
"""Every cause that the body and the road may have, off, in the order in which they act."""

SENSOR: tuple[AbstractEffect, ...] = (SensorLag(), SensorDelay(), SensorBias())
"""Every cause that a sensor may have, off, in the order in which they act."""
