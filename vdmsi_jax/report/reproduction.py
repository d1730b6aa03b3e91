"""The report of `vdmsi reproduce`: the paper's tables and figures, with this project's numbers."""

import base64
import dataclasses
import itertools
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from .. import plots
from ..reproduce import Experiments
from ..reproduce.identification import PAPER_ORDER
from ..reproduce.open_loop import STATISTICS, gain
from ..reproduce.published import TABLE_2, TABLE_3
from ..testbed import UNITS
from .page import Block, Bullets, Page, Picture, Section, Table, Text, Tiles
from .text import number, percent, roots


class Drawing(NamedTuple):
    """A figure as SVG and the sentence under it."""

    svg: str
    caption: str


def figures(one: Experiments) -> dict[str, Drawing]:
    """Every figure of one car, by name, in the paper's order."""
    grids, name = one.identification.grids, one.trim.name
    powertrain, steering = grids["powertrain"], grids["steering"]
    drawn: dict[str, tuple[Callable[[], Any], str]] = {
        "figure_3": (
            lambda: plots.step_inputs(powertrain.record, steering.record),
            "Figure 3. Steps that excite both actuators, and what the lidar made of the answer.",
        ),
        "figure_4": (
            lambda: plots.order_grid(powertrain),
            "Figure 4. Candidate models of the powertrain.",
        ),
        "figure_5": (
            lambda: plots.order_grid(steering),
            "Figure 5. Candidate models of the steering.",
        ),
        "figure_6": (
            lambda: plots.courses(one),
            "Figure 6. Designed tracks, and the car that was driven along them by its sensors.",
        ),
        "figure_7": (
            lambda: plots.navigation(one),
            "Figure 7. Error of navigation without sensors from the entrance of the bend on.",
        ),
        "navigated": (
            lambda: plots.navigated(one),
            "Where the car went when a model was the only source of its pose.",
        ),
        "vdm_rules": (
            lambda: plots.vdm_rules(one),
            "VDM from rest by four rules for the speed that it makes of its command.",
        ),
    }
    for course, found in one.open_loop.items():
        drawn[f"open_loop_{course}"] = (
            lambda found=found: plots.open_loop(found),
            f"{found.course.title}: where the models think the car went, given its commands alone.",
        )
    return {
        key: Drawing(plots.to_svg(draw(), f"{name}-{key}".replace("_", "-")), caption)
        for key, (draw, caption) in drawn.items()
    }


def reproduction_page(
    experiments: Sequence[Experiments],
    drawings: Mapping[str, Mapping[str, Drawing]],
    looks: Mapping[str, bytes],
    *,
    source: str,
    more: Sequence[Section] = (),
) -> Page:
    """The paper's section 5, car by car.

    Args:
        experiments: one per car.
        drawings: of each car, by its name: what `figures` made.
        looks: PNG pictures of the car on its tracks, by the course's name.
        source: where the logs came from.
        more: what lies beyond the paper.
    """
    return Page(
        title="The paper's experiments on a car that no model knows",
        lead="Yan, Hsu and Wen (ION 2023), section 5, with MuJoCo in Gazebo's place",
        sections=[
            Section("In short", [_tiles(experiments), Text(source)]),
            Section("The test vehicle", _vehicle(experiments, looks)),
            *(
                section
                for one in experiments
                for section in _car(one, drawings[one.trim.name], alone=len(experiments) == 1)
            ),
            *more,
        ],
    )


def _tiles(experiments: Sequence[Experiments]) -> Tiles:
    items = []
    for one in experiments:
        for course, found in one.open_loop.items():
            vdm, si = (found.estimates[model].ate["mean"] for model in ("VDM", "VDM-SI"))
            runs = one.closed_loop[course]
            before, after = (runs[m].error[runs[m].at_exit] for m in ("VDM", "VDM-SI"))
            fallen = gain(float(before), float(after))
            items.append(
                (
                    f"{one.trim.name} car, {found.course.title}: VDM-SI against VDM",
                    f"{_percent(-gain(vdm, si))}",
                    f"mean ATE, from {number(vdm, 3)} to {number(si, 3)} m; without sensors "
                    f"{_percent(-fallen)} at the end of the bend",
                )
            )
    return Tiles(items)


def _vehicle(experiments: Sequence[Experiments], looks: Mapping[str, bytes]) -> list[Block]:
    car = experiments[0].trim.car
    d = car.dimensions
    parts = (car.dimensions, car.controllers, car.sensor)
    rows = [
        [own.name, number(getattr(part, own.name)), UNITS[own.name]]
        for part in parts
        for own in dataclasses.fields(part)
    ]
    blocks: list[Block] = [
        Text(
            "Four wheels on springs with tyres in contact with the road, kingpins tied by "
            "Ackermann's geometry, a speed controller and a steering servo. A lidar gives its "
            "pose; speed and yaw rate are derivatives of that, and the steering angle follows from "
            "both, as in the paper. There is no Gazebo and no Autoware here."
        ),
        Table(
            ["l_f (m)", "l_r (m)", "greatest angle (rad)", "greatest acceleration (m/s²)"],
            [[number(d.l_f), number(d.l_r), number(d.max_steering), number(d.max_acceleration)]],
            caption="Table 1. Key parameters. The paper prints 1.7 rad, at which no car can roll.",
        ),
        Table(["", "value", "unit"], rows, caption="Every parameter of the car", folded=True),
    ]
    for course, picture in looks.items():
        title = experiments[0].open_loop[course].course.title
        blocks.append(Picture(embedded(picture), f"The car before, in and after the {title}."))
    causes = [
        f"{one.trim.name}: {one.trim.title}"
        + "".join(
            f"; {own.name.replace('_', ' ')} {number(getattr(one.trim.car.causes, own.name))} "
            f"{UNITS[own.name]}"
            for own in dataclasses.fields(one.trim.car.causes)
            if getattr(one.trim.car.causes, own.name) != own.default
        )
        for one in experiments
    ]
    return [*blocks, Text("The cars:"), Bullets(causes)]


def _car(one: Experiments, drawings: Mapping[str, Drawing], *, alone: bool) -> list[Section]:
    of = "" if alone else f", {one.trim.name} car"
    shown = {key: Picture(own.svg, own.caption) for key, own in drawings.items()}
    tracks = [shown[f"open_loop_{course}"] for course in one.open_loop]
    return [
        Section(
            f"System identification{of}",
            [
                shown["figure_3"],
                shown["figure_4"],
                shown["figure_5"],
                _orders(one),
                _parameters(one),
                *_oddities(one),
            ],
        ),
        Section(f"What the diagnosis named{of}", [Text(one.diagnosis.summary)]),
        Section(f"Open loop{of}", [shown["figure_6"], _table_3(one), *tracks]),
        Section(
            f"Speed from a velocity command{of}",
            [
                Text(
                    "Eq. (1) takes an acceleration, and a velocity command gives none. VDM in "
                    "table 3 takes the command as its speed; the other rules differ from it where "
                    "the command jumps. An acceleration that is cut to what the vehicle can do "
                    "loses for good the speed that was cut off."
                ),
                shown["vdm_rules"],
            ],
        ),
        Section(
            f"Navigation without sensors{of}",
            [shown["figure_7"], _navigation(one), shown["navigated"]],
        ),
    ]


def _orders(one: Experiments) -> Table:
    rows = [
        [name, order, how, percent(grid[order].fit), number(grid[order].mse)]
        for name, grid in one.identification.grids.items()
        for order, how in (
            (grid.chosen, "the paper's rule"),
            (grid.chosen_by_bic, "BIC"),
            (PAPER_ORDER, "the paper's choice"),
        )
    ]
    return Table(
        ["plant", "order", "chosen by", "FIT", "MSE"],
        rows,
        caption="The paper's rule is the smallest order that is within 0.5 points of the best FIT; "
        "the first of each plant goes into VDM-SI.",
    )


def _parameters(one: Experiments) -> Table:
    rows = []
    for name, grid in one.identification.grids.items():
        for order in dict.fromkeys((grid.chosen, PAPER_ORDER)):
            fit = grid[order]
            for parameter in fit.parameter_names:
                low, high = fit.interval(parameter)
                printed = TABLE_2[name].get(parameter) if order == PAPER_ORDER else None
                rows.append(
                    [name, order, parameter, number(fit.value(parameter))]
                    + [f"{number(low)} to {number(high)}"]
                    + ["" if printed is None else number(printed)]
                )
    return Table(
        ["plant", "order", "parameter", "estimate", "95 % interval", "paper, on its vehicle"],
        rows,
        caption="Table 2. Estimated parameters; the leading one of the denominator is 1.",
    )


def _oddities(one: Experiments) -> list[Block]:
    said = [
        f"{name} {order}: poles {roots(grid[order].poles)}; zeros {roots(grid[order].zeros)}"
        + "".join(f"; {warning}" for warning in grid[order].warnings)
        for name, grid in one.identification.grids.items()
        for order in dict.fromkeys((grid.chosen, PAPER_ORDER))
    ]
    return [Text("Poles and zeros (rad/s)", kind="caption"), Bullets(said)]


def _table_3(one: Experiments) -> Table:
    models = list(next(iter(one.open_loop.values())).estimates)
    rows = []
    for course, found in one.open_loop.items():
        for which, said in (("ate", "from the bend on"), ("from_rest", "from rest")):
            for statistic in STATISTICS:
                errors = [getattr(found.estimates[m], which)[statistic] for m in models]
                printed = TABLE_3[course] if which == "ate" else {}
                fallen = [_percent(gain(*pair)) for pair in itertools.pairwise(errors)]
                rows.append(
                    [found.course.title, said, statistic, *(number(e, 3) for e in errors), *fallen]
                    + [" / ".join(number(printed[m][statistic]) for m in printed) or "–"]
                )
    return Table(
        ["scenario", "", "ATE (m)", *models, "VDM-SI takes off VDM"]
        + ["extended takes off VDM-SI"] * (len(models) > 2)
        + ["paper, VDM / VDM-SI"],
        rows,
        strong=[i for i, row in enumerate(rows) if row[2] == "mean"],
        caption="Table 3. Translation errors of the models beside the lidar. From the bend on as "
        "in the paper, paths laid on the measured pose at its entrance.",
    )


def _navigation(one: Experiments) -> Table:
    rows = []
    for course, runs in one.closed_loop.items():
        first = runs["VDM"]
        for name, run in runs.items():
            error = float(run.error[run.at_exit])
            fallen = gain(float(first.error[first.at_exit]), error)
            rows.append(
                [one.open_loop[course].course.title, name, number(error, 3)]
                + ["" if name == "VDM" else _percent(fallen)]
                + [number(float(run.error[-1]), 3), number(float(abs(run.deviation).max()), 3)]
            )
    return Table(
        ["scenario", "source of pose", "error at the end of the bend (m)", "less than VDM"]
        + ["error at the end (m)", "farthest off the track (m)"],
        rows,
        caption="The car drives on by pure pursuit of the pose that the model believes.",
    )


def _percent(value: float) -> str:
    return f"{value:.1f} %".replace("-", "−")


def embedded(png: bytes) -> str:
    """A PNG picture as an SVG element."""
    width, height = struct.unpack(">II", png[16:24])
    data = base64.b64encode(png).decode()
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
        f'<image width="{width}" height="{height}" href="data:image/png;base64,{data}"/></svg>'
    )


def figure_file(car: str, figure: str) -> str:
    """Name of the file that holds a figure."""
    return f"{car}_{figure}.svg"
