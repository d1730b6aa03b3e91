"""All plants of a vehicle from its logs, each from those logs that move it."""

from collections.abc import Iterator, Mapping, Sequence

from vdmsi_jax.config import IdentifyOptions, PlantSpec
from vdmsi_jax.data import check_excitation
from vdmsi_jax.data.record import Record
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
    several = [records] if isinstance(records, Record) else list(records)
    found = dict(each_plant(several, options=options))
    grids = {name: grid for name, grid in found.items() if isinstance(grid, OrderGrid)}
    if not grids:
        refused = {name: why for name, why in found.items() if isinstance(why, InputError)}
        raise none_identified(refused)
    return grids


def none_identified(refused: Mapping[str, InputError]) -> InputError:
    """What to say where every plant was refused: the reasons of all of them, each once."""
    first, *others = {str(why): why for why in refused.values()}.values()
    mend = "; ".join([first.mend, *map(str, others)])
    return InputError(first.source, first.place, first.problem, mend)


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
