"""Section 5.1: both actuators identified from the steps of figure 3."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..compare import identified
from ..config import IdentifyOptions
from ..data.record import Record
from ..identify import Fit, OrderGrid
from ..identify.vehicle import identify_vehicle
from ..model_file import Model

PAPER_OPTIONS = IdentifyOptions(delay=False, offset=False, held_out=0.25, split="blocks")
"""Eq. (2) as it stands: poles and zeros, neither a delay nor an offset."""

PAPER_ORDER = "P2Z2"
"""What the paper chose for both actuators."""


@dataclass(frozen=True)
class Identification:
    """Both order grids and the model made of the chosen orders.

    Attributes:
        grids: by plant, `powertrain` and `steering`.
        model: VDM-SI.
    """

    grids: Mapping[str, OrderGrid]
    model: Model

    def chosen(self, plant: str) -> Fit:
        """The fit that VDM-SI takes: the paper's rule."""
        return self.grids[plant].best


def identify_actuators(
    records: Sequence[Record], options: IdentifyOptions = PAPER_OPTIONS
) -> Identification:
    """Fit every order P1Z0 to P5Z5 to powertrain and steering.

    Args:
        records: the two experiments of figure 3.
        options: other orders, or a delay, than the paper's.

    Raises:
        InputError: an actuator was not moved.
    """
    grids = identify_vehicle(records, options=options)
    return Identification(grids, identified(grids))
