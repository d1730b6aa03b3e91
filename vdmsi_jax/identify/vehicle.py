"""All plants of a vehicle from its logs, each from those logs that move it."""

from collections.abc import Iterator, Sequence

from vdmsi_jax.config import IdentifyOptions, PlantSpec
from vdmsi_jax.data import check_excitation
from vdmsi_jax.data.record import Record, records_of
from vdmsi_jax.errors import InputError
from vdmsi_jax.identify.identify import identify
from vdmsi_jax.identify.result import OrderGrid


def identify_vehicle(
    records: Record | Sequence[Record], *, options: IdentifyOptions | None = None
) -> dict[str, OrderGrid]:
    """Identify every plant that the records name, each from the records in which it is excited.

    A run of speed steps with the wheel straight and one of steering steps at constant speed can so
    be given together. A plant that no record moves is left out.

    **Arguments:**

    - `records`: one record or several of one vehicle.
    - `options`: as in `identify`.

    **Raises:** `InputError` if nothing can be identified.
    """
    return identified_and_refused(records_of(records), options=options)[0]


def identified_and_refused(
    records: Sequence[Record], *, options: IdentifyOptions | None = None
) -> tuple[dict[str, OrderGrid], dict[str, InputError]]:
    """The grids of the plants that the records name, and why others have none, by their names.

    **Raises:** `InputError` if nothing can be identified, with the reasons of all plants, each
    once.
    """
    grids, refused = {}, {}
    for name, found in each_plant(records, options=options):
        (refused if isinstance(found, InputError) else grids)[name] = found
    if not grids:
        first, *others = {str(why): why for why in refused.values()}.values()
        mend = "; ".join([first.mend, *map(str, others)])
        raise InputError(first.source, first.place, first.problem, mend)
    return grids, refused


def each_plant(
    records: Sequence[Record], *, options: IdentifyOptions | None = None
) -> Iterator[tuple[str, OrderGrid | InputError]]:
    """The plants that the records name, one after another, each with its grid or why there is none.

    **Raises:** `InputError` if the records name no plant.
    """
    plants = {plant.name: plant for record in records for plant in record.plants}
    if not plants:
        names = ", ".join(record.source for record in records)
        mend = "name commands and responses in [columns], and pair them in [[plants]]"
        raise InputError(names, "plants", "no command with its response was logged", mend)
    for name, plant in plants.items():
        try:
            yield name, identify(_excited(records, plant), plant, options=options)
        except InputError as why:
            yield name, why


def _excited(records: Sequence[Record], plant: PlantSpec) -> list[Record]:
    """The records from which something can be learnt about the plant."""
    chosen, refused = [], []
    for record in records:
        try:
            check_excitation(record, plant)
            chosen.append(record)
        except InputError as why:
            refused.append(why)
    if not chosen:
        raise refused[0]
    return chosen
