"""Logs with a hidden cause, by plain NumPy at 1 ms: shares nothing with the package it tests."""

from .cases import Case as Case
from .cases import Drive as Drive
from .cases import Truth as Truth
from .cases import generate as generate
from .cases import siso as siso
from .causes import CATALOGUE as CATALOGUE
from .causes import OUTSIDE as OUTSIDE
from .causes import SIZES as SIZES
from .causes import CauseTruth as CauseTruth
from .files import write as write
