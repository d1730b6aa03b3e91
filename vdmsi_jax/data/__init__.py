"""Logs in, records out: formats, units, repairs and resampling. Everything above this package works
on `Record`."""

from .datasets import DATASETS as DATASETS
from .datasets import Dataset as Dataset
from .datasets import data_folder as data_folder
from .datasets import find_log as find_log
from .datasets import locate as locate
from .excitation import check_excitation as check_excitation
from .excitation import uncommanded as uncommanded
from .read import read_log as read_log
from .read import read_logs as read_logs
from .record import Record as Record
from .segment import Segment as Segment
