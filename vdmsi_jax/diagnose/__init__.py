"""Name the cause: what a simulation gets wrong, why, and what an extended model gains."""

from .diagnose import diagnose as diagnose
from .noise import KnownNoise as KnownNoise
from .result import Diagnosis as Diagnosis
from .result import Finding as Finding
