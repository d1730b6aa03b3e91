"""Logs in, records out."""

from .record import Record as Record
from .record import Segment as Segment
