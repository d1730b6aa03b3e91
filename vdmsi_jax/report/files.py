"""What the commands leave in a folder, for Python too: the results as JSON, and the page that shows
them."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..data.record import Record
from ..errors import InputError
from ..files import output_folder, write_json

if TYPE_CHECKING:  # each of the three does without what the others take to import
    from ..compare import Comparison
    from ..diagnose import Diagnosis
    from ..identify.result import OrderGrid


def write_diagnosis(
    folder: str | PathLike[str], diagnosis: "Diagnosis", *, report: bool = True
) -> Path:
    """Write `diagnosis.json`, `model.json` and, if asked, `report.html`.

    Args:
        folder: made if it is not there.
        diagnosis: what `diagnose` returned.
        report: whether to draw the page, too.

    Returns:
        The folder.

    Raises:
        InputError: the folder cannot be made or written to.
    """
    from ..diagnose.answer.document import diagnosis_document
    from ..model_file import save_model

    folder = output_folder(folder)
    write_json(folder / "diagnosis.json", diagnosis_document(diagnosis))
    save_model(folder / "model.json", diagnosis.model)
    if report:
        from .diagnosis import diagnosis_page
        from .page import write_page

        write_page(folder, diagnosis_page(diagnosis))
    return folder


def write_identification(
    folder: str | PathLike[str],
    grids: Mapping[str, "OrderGrid"],
    records: Sequence[Record] | None = None,
    refused: Mapping[str, InputError] | None = None,
    *,
    report: bool = True,
) -> Path:
    """Write `identify.json`, which `load_model` takes, and, if asked, `report.html`.

    Args:
        folder: made if it is not there.
        grids: by the plants' names, as `identify_vehicle` returns them.
        records: what was identified from; the records of the grids, if none are given.
        refused: by the plants' names, why those without a grid were not identified.
        report: whether to draw the page, too.

    Returns:
        The folder.

    Raises:
        InputError: the folder cannot be made or written to.
    """
    from ..identify.document import identify_document

    folder = output_folder(folder)
    if records is None:
        records = list({id(grid.record): grid.record for grid in grids.values()}.values())
    write_json(folder / "identify.json", identify_document(grids, records, refused))
    if report:
        from .identification import identification_page
        from .page import write_page

        write_page(folder, identification_page(grids, records, refused))
    return folder


def write_comparisons(
    folder: str | PathLike[str], comparisons: Sequence["Comparison"], *, report: bool = True
) -> Path:
    """Write `simulation.json`, the trajectories as TUM files and, if asked, `report.html`.

    Args:
        folder: made if it is not there.
        comparisons: what `compare` returned, one for each log.
        report: whether to draw the page, too.

    Returns:
        The folder.

    Raises:
        InputError: the folder cannot be made or written to.
    """
    from ..compare import simulation_document, write_trajectories

    folder = output_folder(folder)
    write_json(folder / "simulation.json", simulation_document(comparisons))
    for comparison in comparisons:
        write_trajectories(folder, comparison)
    if report:
        from .page import write_page
        from .simulation import simulation_page

        write_page(folder, simulation_page(comparisons))
    return folder
