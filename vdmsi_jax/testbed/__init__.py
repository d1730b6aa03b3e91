"""A car on a physics engine, which no model of this project knows: MuJoCo in the place of Gazebo.

The package imports without MuJoCo (extra `[mujoco]`); driving the car needs it.
"""

from .car import UNITS as UNITS
from .car import Car as Car
from .car import Causes as Causes
from .car import Controllers as Controllers
from .car import Dimensions as Dimensions
from .car import PoseSensor as PoseSensor
from .drive import Drive as Drive
from .drive import Driver as Driver
from .drive import Sighting as Sighting
from .drive import drive as drive
from .drive import replay as replay
from .drive import vehicle_toml as vehicle_toml
from .drive import write_log as write_log
from .engine import ROW as ROW
