"""System identification of vehicle actuators, and the vehicle simulation that uses it.

The public names stand below. Each is imported when it is first asked for, so that the command line
starts without waiting for jax.
"""

import importlib
import sys
import types
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .compare import Comparison as Comparison
    from .compare import compare as compare
    from .compare import identified as identified
    from .config import Config as Config
    from .config import IdentifyOptions as IdentifyOptions
    from .config import PlantSpec as PlantSpec
    from .config import Prepare as Prepare
    from .config import VehicleGeometry as VehicleGeometry
    from .config import load_config as load_config
    from .data.read import read_log as read_log
    from .data.read import read_logs as read_logs
    from .data.record import Record as Record
    from .data.segment import Segment as Segment
    from .diagnose import Diagnosis as Diagnosis
    from .diagnose import Finding as Finding
    from .diagnose import KnownNoise as KnownNoise
    from .diagnose import diagnose as diagnose
    from .errors import InputError as InputError
    from .fusion import Fused as Fused
    from .fusion import GaussMarkov as GaussMarkov
    from .fusion import ModelError as ModelError
    from .fusion import PoseSensor as PoseSensor
    from .fusion import fuse as fuse
    from .identify.acceleration import SpeedResponse as SpeedResponse
    from .identify.acceleration import speed_response as speed_response
    from .identify.identify import identify as identify
    from .identify.online import Forgetting as Forgetting
    from .identify.online import Tracking as Tracking
    from .identify.online import identify_online as identify_online
    from .identify.result import Fit as Fit
    from .identify.result import OrderGrid as OrderGrid
    from .identify.vehicle import identify_vehicle as identify_vehicle
    from .metrics import ate as ate
    from .metrics import fit as fit
    from .metrics import mse as mse
    from .model_file import Model as Model
    from .model_file import Plant as Plant
    from .model_file import load_model as load_model
    from .model_file import save_model as save_model
    from .models.bicycle import Bicycle as Bicycle
    from .models.extended_plant import ExtendedPlant as ExtendedPlant
    from .models.transfer_function import TransferFunction as TransferFunction
    from .models.vehicle import SpeedInput as SpeedInput
    from .models.vehicle import Vehicle as Vehicle
    from .models.vehicle import stack_vehicles as stack_vehicles
    from .simulate import Arcs as Arcs
    from .simulate import Commands as Commands
    from .simulate import Quadrature as Quadrature
    from .simulate import Solver as Solver
    from .simulate import Start as Start
    from .simulate import Trajectory as Trajectory
    from .simulate import simulate as simulate
    from .simulate import simulate_many as simulate_many

__version__ = "0.1.0"

_HOMES = {
    "compare": ("Comparison", "compare", "identified"),
    "config": (
        "Config",
        "IdentifyOptions",
        "PlantSpec",
        "Prepare",
        "VehicleGeometry",
        "load_config",
    ),
    "data.read": ("read_log", "read_logs"),
    "data.record": ("Record",),
    "data.segment": ("Segment",),
    "diagnose": ("Diagnosis", "Finding", "KnownNoise", "diagnose"),
    "errors": ("InputError",),
    "fusion": ("Fused", "GaussMarkov", "ModelError", "PoseSensor", "fuse"),
    "identify.acceleration": ("SpeedResponse", "speed_response"),
    "identify.identify": ("identify",),
    "identify.online": ("Forgetting", "Tracking", "identify_online"),
    "identify.result": ("Fit", "OrderGrid"),
    "identify.vehicle": ("identify_vehicle",),
    "metrics": ("ate", "fit", "mse"),
    "model_file": ("Model", "Plant", "load_model", "save_model"),
    "models.bicycle": ("Bicycle",),
    "models.extended_plant": ("ExtendedPlant",),
    "models.transfer_function": ("TransferFunction",),
    "models.vehicle": ("SpeedInput", "Vehicle", "stack_vehicles"),
    "simulate": (
        "Arcs",
        "Commands",
        "Quadrature",
        "Solver",
        "Start",
        "Trajectory",
        "simulate",
        "simulate_many",
    ),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = tuple(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted({"__version__", *_HOME})


class _Package(types.ModuleType):
    """The package keeps the verb where a module has the same name: `vdmsi_jax.simulate` is the
    function, although importing `vdmsi_jax.simulate` makes Python bind the module to that name."""

    def __setattr__(self, name, value):
        if not (name in _HOME and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
