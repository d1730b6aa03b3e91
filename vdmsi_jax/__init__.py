"""System identification of vehicle actuators, and the vehicle simulation that uses it.

The public names stand below. Each is imported when it is first asked for, so that the command line
starts without waiting for jax.
"""

import importlib
import sys
import types
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from .config import Config as Config
    from .config import IdentifyOptions as IdentifyOptions
    from .config import PlantSpec as PlantSpec
    from .config import VehicleGeometry as VehicleGeometry
    from .config import load_config as load_config
    from .data.record import Record as Record
    from .data.record import Segment as Segment
    from .errors import InputError as InputError
    from .identify.result import Fit as Fit
    from .identify.result import OrderGrid as OrderGrid

_HOMES = {
    "config": ("Config", "IdentifyOptions", "PlantSpec", "VehicleGeometry", "load_config"),
    "data.record": ("Record", "Segment"),
    "errors": ("InputError",),
    "identify.result": ("Fit", "OrderGrid"),
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
    return [*globals(), *_HOME]


class _Package(types.ModuleType):
    """The package keeps the verb where a module has the same name: `vdmsi_jax.simulate` is the
    function, although importing `vdmsi_jax.simulate` makes Python bind the module to that name."""

    def __setattr__(self, name, value):
        if not (name in _HOME and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
