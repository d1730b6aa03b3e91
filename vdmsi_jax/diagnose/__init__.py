"""Name the cause: what a simulation gets wrong, why, and what an extended model gains."""

from .answer.result import Diagnosis as Diagnosis
from .answer.result import Finding as Finding
from .diagnose import diagnose as diagnose
from .signals.noise import KnownNoise as KnownNoise
