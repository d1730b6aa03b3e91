"""The measured logs and the FIT that gain, offset, one lag and a delay reach on them.

The figures are those of the JSON beside each log, on the same samples; the README of the logs gives
them rounded. Run as a program this prints the table of what identification makes of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vdmsi_jax.config import load_config
from vdmsi_jax.data import read_log
from vdmsi_jax.identify import OrderGrid, identify

CONFIGS = Path(__file__).resolve().parents[1] / "configs" / "data"


@dataclass(frozen=True)
class Floor:
    """One channel pair of one log; `fit` in percent."""

    log: str
    config: str
    plant: str
    fit: float

    @property
    def name(self) -> str:
        return f"{self.log.removesuffix('.csv')}:{self.plant}"


def _of(log: str, config: str, **plants: float) -> list[Floor]:
    return [Floor(f"{log}.csv", f"{config}.toml", plant, fit) for plant, fit in plants.items()]


STARTS = Floor("f1tenth_mocap/runs.csv", "f1tenth_mocap_starts.toml", "powertrain", 92.6)
"""The mean over 15 runs, each of which the source fitted by itself; here one model serves all."""

FLOORS = (
    *_of("cascaded_tanks/estimation", "cascaded_tanks", tanks=74.5),
    *_of("cascaded_tanks/validation", "cascaded_tanks", tanks=70.5),
    *_of("ce109_hoop_motor/fixedStepSequence", "ce109_hoop_motor", motor=85.5),
    *_of("cpm_mucar/run_a", "cpm_mucar_run_a", powertrain=96.7, yaw=87.8, motor=87.4, servo=86.5),
    *_of("cpm_mucar/run_b", "cpm_mucar_run_b", motor=82.8, servo=88.8),
    *_of("f110_frictionmaps/ds1", "f110_frictionmaps", powertrain=60.7, yaw=66.8),
    *_of("f110_frictionmaps/ds3", "f110_frictionmaps", powertrain=42.4, yaw=85.6),
    *_of("f110_frictionmaps/ds5", "f110_frictionmaps", powertrain=46.6, yaw=75.2),
    *_of("genesis_sedan/inner2_slow", "genesis_sedan", yaw=96.7),
    *_of("genesis_sedan/cpg_slow_lap", "genesis_sedan", yaw=96.5),
    *_of("norlab_skidsteer/husky_unloaded", "norlab_husky", left=82.4, right=80.1),
    *_of(
        "norlab_skidsteer/steps_warthog_asphalt",
        "norlab_warthog",
        left=74.1,
        right=78.2,
        slip=83.0,
        yaw=69.7,
    ),
    *_of("silverbox/snls80mv", "silverbox", circuit=11.9),
    *_of("wiener_hammerstein/train_part1", "wiener_hammerstein", circuit=56.1),
    STARTS,
)


def identify_floor(floor: Floor, folder: Path, **orders: Sequence[int]) -> OrderGrid:
    """Identify the pair as the project's description of the log says; with `poles=...` fewer orders
    than it does."""
    config = load_config(CONFIGS / floor.config)
    log = read_log(folder / floor.log, config)
    return identify(log, floor.plant, options=config.identify, **orders)


def score(floor: Floor, grid: OrderGrid) -> float:
    """What stands against the floor: FIT of the chosen model on all samples."""
    if floor is not STARTS:
        return grid.best.fit
    of_runs = []
    for segment in grid.record.segments:
        y, residual = grid.record["v"][segment.samples], grid.best.residual[segment.samples]
        of_runs.append(100.0 * (1.0 - np.linalg.norm(residual) / np.linalg.norm(y - y.mean())))
    return float(np.mean(of_runs))


HEADER = f"{'log and plant':47} {'n':>6} {'chosen':>6} {'floor':>6} {'FIT':>7} {'held out':>9}"


def row(floor: Floor, grid: OrderGrid) -> str:
    return (
        f"{floor.name:47} {grid.record.n:6d} {grid.chosen:>6} {floor.fit:6.1f} "
        f"{score(floor, grid):7.2f} {grid.best.held_out_fit:9.2f}"
    )


if __name__ == "__main__":
    import sys

    import jax

    jax.config.update("jax_enable_x64", True)
    print(HEADER)
    for one in FLOORS:
        print(row(one, identify_floor(one, Path(sys.argv[1]))), flush=True)
