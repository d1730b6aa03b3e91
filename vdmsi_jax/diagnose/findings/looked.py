"""One plant, as far as it is told without the others."""

from collections.abc import Sequence
from dataclasses import dataclass

from ...config import PlantSpec
from ...data.record import Record
from ..answer.result import Detectable
from ..residual.of_plant import PlantLeft
from ..search.found import Search
from ..signals.runs import Runs
from .channels import units_of
from .detectability import detectable


@dataclass(frozen=True, eq=False)
class Looked:
    """A plant that was searched.

    Attributes:
        search: what was found.
        left: what its model leaves.
        detectable: what the logs would have shown.
    """

    search: Search
    left: PlantLeft
    detectable: tuple[Detectable, ...]

    @classmethod
    def on(cls, records: Sequence[Record], runs: Runs, spec: PlantSpec, search: Search) -> "Looked":
        """Look on, from what was found."""
        shown = detectable(search.stage, search.final, units_of(records, spec))
        return cls(search, PlantLeft.of(runs, spec, search), tuple(shown))
