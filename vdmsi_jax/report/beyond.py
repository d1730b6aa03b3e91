"""What `vdmsi reproduce` tells beyond the paper: drawn vehicles, the steering model, the future
works."""

from collections.abc import Mapping
from typing import Any

from .. import plots
from ..plots.beyond import PARTS, SCENARIOS
from .page import Bullets, Picture, Section, Table, Text
from .reproduction import Drawing
from .text import number

MODELS = ("VDM", "VDM-SI", "extended")


def beyond_figures(document: Mapping[str, Any]) -> dict[str, Drawing]:
    """Every figure, by name.

    Args:
        document: the contents of `results.json`, with `beyond` in it.
    """
    own = document["beyond"]
    count = own["population"]["vehicles"]
    drawn = {
        "distribution": (
            plots.distribution(own["population"], document["paper"]["table_3"]),
            f"Table 3 over {count} drawn vehicles. Above, a dot for each vehicle; below, medians "
            "and the middle 95 %.",
        ),
        "budget": (
            plots.shares(own["population"]),
            "Error budget: what each part of the vehicle adds to VDM's mean error, as the mean "
            "over all orders in which the parts may come (Shapley values); mean over "
            f"{own['population']['budgeted']} vehicles, with the middle 95 %.",
        ),
        "online": (
            plots.tracking(own["online"]),
            "Identification during the drive. The gain of the paper's powertrain falls by a fifth.",
        ),
        "outages": (
            plots.outages(own["outages"]),
            "Vehicle model and pose sensor in one filter, after outages of the sensor.",
        ),
        "steering": (
            plots.steering_explained(own["steering_model"]),
            "What the paper's steering model may have been fitting.",
        ),
    }
    return {
        key: Drawing(plots.to_svg(figure, f"beyond-{key}"), caption)
        for key, (figure, caption) in drawn.items()
    }


def beyond_sections(
    document: Mapping[str, Any], drawings: Mapping[str, Drawing]
) -> tuple[Section, ...]:
    """The studies as sections of the page.

    Args:
        document: the contents of `results.json`.
        drawings: what `beyond_figures` made.
    """
    own = document["beyond"]
    shown = {key: Picture(one.svg, one.caption) for key, one in drawings.items()}
    p, online, imu = own["population"], own["online"], own["imu"]
    return (
        Section(
            "Table 3 as a distribution",
            [
                Text(own["source"], kind="note"),
                Text(
                    f"{p['vehicles']} vehicles are drawn with actuators and causes of their own; "
                    f"{p['with_causes']} have a cause that no transfer function can hold. Each is "
                    "identified from its own noisy logs and driven along both courses."
                ),
                shown["distribution"],
                _distribution(p),
                _causes(p),
            ],
        ),
        Section("Error budget", [shown["budget"]]),
        Section(
            "What the paper's steering model was fitting",
            [
                Text(
                    "Table 2 gives the steering an integrator and a zero at "
                    f"{number(own['steering_model']['paper_zero'], 3)} rad/s: an angle that is "
                    "held creeps back, and on through zero. A sound steering measured with one "
                    "plain fault makes the paper's order P2Z2 look so:"
                ),
                Bullets([_explanation(row) for row in own["steering_model"]["explanations"]]),
                shown["steering"],
            ],
        ),
        Section(
            "Future works",
            [
                Text(
                    "Error of all coefficients by the recursion after 20 s, over that of the "
                    f"offline fit: {number(online['ratio'], 3)}. After the change, nine of ten "
                    f"drives know the gain to 5 % within {number(online['recovered'], 3)} s."
                ),
                shown["online"],
                Text(
                    "Error of the powertrain's parameters identified by an IMU "
                    f"{number(100.0 * imu['imu'], 2)} %, by the derivative of the speed "
                    f"{number(100.0 * imu['derivative_of_speed'], 2)} %, by the speed "
                    f"{number(100.0 * imu['speed'], 2)} %."
                ),
                shown["outages"],
                _outages(own["outages"]),
            ],
        ),
    )


def _spread(own: Mapping[str, float], digits: int = 3) -> str:
    low, high = (number(own[key], digits) for key in ("low", "high"))
    return f"{number(own['median'], digits)} ({low} to {high})"


def _distribution(population: Mapping[str, Any]) -> Table:
    gains = ("VDM-SI over VDM", "extended over VDM-SI")
    rows = [
        [SCENARIOS[row["scenario"]], row["statistic"]]
        + [_spread(row[model]) for model in MODELS]
        + [_spread(row[key]) for key in gains]
        for row in population["ate"]
    ]
    rows += [
        [SCENARIOS[row["scenario"]], "without sensors, at the end of the bend"]
        + [_spread(row[model]) for model in MODELS]
        + [_spread(row["VDM-SI over VDM"]), ""]
        for row in population["at_exit"]
    ]
    return Table(
        ["scenario", "error (m)", *MODELS, "VDM-SI takes off VDM (%)"]
        + ["extended takes off VDM-SI (%)"],
        rows,
        caption="Medians, and between which the middle 95 % of the vehicles lie. The last column "
        "is of the vehicles with a cause.",
    )


def _causes(population: Mapping[str, Any]) -> Table:
    rows = [
        [SCENARIOS[row["scenario"]], str(row["causes"]), str(row["vehicles"])]
        + [_spread(row["VDM-SI over VDM"])]
        for row in population["by_causes"]
    ]
    return Table(
        ["scenario", "causes", "vehicles", "VDM-SI takes off VDM's mean error (%)"],
        rows,
        caption=f"By how many causes a vehicle has of {', '.join(list(PARTS)[3:])}".replace(
            "_", " "
        ),
    )


def _explanation(row: Mapping[str, Any]) -> str:
    return (
        f"{row['fault']} of {number(row['size'], 2)} {row['unit']}, steps {row['excitation']}: "
        f"slow zero {_spread(row['slow_zero'])} rad/s, slow pole {_spread(row['slow_pole'], 2)} "
        f"rad/s, FIT {number(row['fit_p2z2']['median'], 3)} % (P1Z1: "
        f"{number(row['fit_p1z1']['median'], 3)} %)"
    )


def _outages(rows: Any) -> Table:
    models = ("VDM", "VDM-SI")
    return Table(
        ["outage (s)", *(f"error by {m} (m)" for m in models), *(f"NEES by {m}" for m in models)],
        [
            [number(row["seconds"]), *(number(row["error"][m], 3) for m in models)]
            + [number(row["nees"][m], 3) for m in models]
            for row in rows
        ],
        caption="Median error at the end of the outage, and the mean NEES of the pose there.",
    )
