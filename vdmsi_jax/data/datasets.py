"""Public measured logs that the toolkit is tried on: where they come from, and where they lie on
this machine.

The logs are not part of the project. They are found in the folder that the environment variable
`VDMSI_DATA` names, else in `../shared/data` from the project's root or from the working directory.
The project's description of each, `configs/data/*.toml`, says what its columns mean.
"""

import os
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, nearest

_ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Dataset:
    """A public set of measured logs.

    Attributes:
        name: its folder.
        machine: what was measured.
        logs: file -> configuration (in `configs/data`) that describes it.
        repository: where its owners published it.
        commit: the version that was taken.
        licence: under which it may be used.
    """

    name: str
    machine: str
    logs: dict[str, str]
    repository: str
    commit: str
    licence: str


DATASETS = {
    dataset.name: dataset
    for dataset in (
        Dataset(
            "cpm_mucar",
            "1:18 Ackermann car of the CPM Lab",
            {"run_a.csv": "cpm_mucar_run_a.toml", "run_b.csv": "cpm_mucar_run_b.toml"},
            "https://github.com/embedded-software-laboratory/cpm_lab",
            "bbab3e4b5fcef5b6eaea42a6cba73d2fe0569fdb",
            "MIT",
        ),
        Dataset(
            "f110_frictionmaps",
            "1:10 race car",
            dict.fromkeys(("ds1.csv", "ds3.csv", "ds5.csv"), "f110_frictionmaps.toml"),
            "https://github.com/AhmadAmine998/FrictionMaps",
            "6a1b907d68999067960553bcec18fbf70b30bf4e",
            "MIT",
        ),
        Dataset(
            "f1tenth_mocap",
            "1:10 car under motion capture, 41 runs",
            {"runs.csv": "f1tenth_mocap.toml"},
            "https://github.com/nikhilushinde/AutoKoopman",
            "3897268a9545555f8010b2b7ed913645fb87fc13",
            "CC0-1.0",
        ),
        Dataset(
            "genesis_sedan",
            "full-size sedan",
            dict.fromkeys(("cpg_slow_lap.csv", "inner2_slow.csv"), "genesis_sedan.toml"),
            "https://github.com/MPC-Berkeley/genesis_path_follower",
            "7f62ff6d1d16bcfef317181575305811b9460e8a",
            "MIT",
        ),
        Dataset(
            "norlab_skidsteer",
            "skid-steer robots Husky and Warthog",
            {
                "husky_unloaded.csv": "norlab_husky.toml",
                "steps_warthog_asphalt.csv": "norlab_warthog.toml",
            },
            "https://github.com/norlab-ulaval/doughnut_calib",
            "1d6d210fa3d2f01c5571c1fcf4a5f43dfefe36a2 (Husky), "
            "39b3f2e6be0f19a37dd7f579d375693eb2a60170 (Warthog)",
            "BSD-3-Clause",
        ),
        Dataset(
            "ce109_hoop_motor",
            "DC motor of a ball-and-hoop bench",
            {"fixedStepSequence.csv": "ce109_hoop_motor.toml"},
            "https://github.com/helonayala/sysid",
            "3802c648c330b802ef18a8cae1dd55a4910978e1",
            "Unlicense",
        ),
        Dataset(
            "bam_servo",
            "position servos with a pendulum",
            dict.fromkeys(
                ("sts3250_kp32_sin_sin.csv", "xl330_kp100_sin_sin.csv", "xl330_kp400_sin_sin.csv"),
                "bam_servo.toml",
            ),
            "https://github.com/Rhoban/bam",
            "b53408c590cb4d65f90abd25fe062ddd00505a93 (STS3250), "
            "af2260462471ff45ac18af159b1327ea51d8db15 (XL330)",
            "Apache-2.0",
        ),
        Dataset(
            "cascaded_tanks",
            "two cascaded water tanks",
            dict.fromkeys(("estimation.csv", "validation.csv"), "cascaded_tanks.toml"),
            "https://github.com/forgi86/dynonet",
            "0bdf70605da2570cca526659b3b21e6356e7bb48",
            "MIT",
        ),
        Dataset(
            "wiener_hammerstein",
            "circuit: filter, diode limiter, filter",
            {"train_part1.csv": "wiener_hammerstein.toml"},
            "https://github.com/forgi86/sysid-neural-estimator",
            "7473be56be61b53f4e035db6c41cf4efbdc8cff3",
            "MIT",
        ),
        Dataset(
            "silverbox",
            "circuit like a mass on a hardening spring",
            {"snls80mv.csv": "silverbox.toml"},
            "https://github.com/biaslab/nsi-silverbox",
            "728f07e4539d4f7da76a4778b52a756260b488ac",
            "MIT",
        ),
    )
}
"""The sets by name."""


def data_folder() -> Path | None:
    """The folder that holds the sets on this machine, or None if there is none."""
    named = os.environ.get("VDMSI_DATA")
    candidates = (
        [Path(named)]
        if named
        else [_ROOT.parent / "shared" / "data", Path.cwd().parent / "shared" / "data"]
    )
    return next((folder for folder in candidates if folder.is_dir()), None)


def find_log(log: str, beside: Path) -> Path:
    """The log that a sweep names: a path from the folder `beside`, or from that of the data sets.

    Raises:
        InputError: it is in neither.
    """
    folders = [beside, *filter(None, [data_folder()])]
    for folder in folders:
        if (folder / log).is_file():
            return folder / log
    mend = f"it was looked for in {' and '.join(map(str, folders))}; VDMSI_DATA may name another"
    raise InputError(log, "", "there is no such log", mend)


def locate(dataset: str, log: str) -> tuple[Path, Path]:
    """A log of a set on this machine, and the configuration that describes it.

    Args:
        dataset: name of the set, a key of `DATASETS`.
        log: name of the file in it.

    Returns:
        The paths of the log and of its configuration.

    Raises:
        InputError: there is no such set or log, or it is not on this machine; the message says
            where to get it.
    """
    if dataset not in DATASETS:
        raise InputError("data sets", dataset, "there is no such set", nearest(dataset, DATASETS))
    found = DATASETS[dataset]
    if log not in found.logs:
        raise InputError(
            "data sets", f"{dataset}/{log}", "there is no such log", nearest(log, found.logs)
        )
    folder = data_folder()
    path = (folder or Path("../shared/data")) / dataset / log
    if not path.is_file():
        mend = (
            f"get it from {found.repository} at commit {found.commit} (licence {found.licence}), "
            f"put it there, or set VDMSI_DATA to the folder that holds {dataset}/"
        )
        raise InputError(str(path), "", "the log is not on this machine", mend)
    config = _ROOT / "configs" / "data" / found.logs[log]
    if not config.is_file():
        mend = "clone the repository, which has those of all these sets"
        raise InputError(str(config), "", "its configuration is not installed", mend)
    return path, config
