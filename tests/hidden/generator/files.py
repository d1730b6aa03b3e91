"""A drive as the files that a user would have."""

from pathlib import Path

import numpy as np

from .cases import Drive

_PLANT = """[columns]
command = "u"
response = "y"

[[plants]]
name = "plant"
input = "command"
output = "response"
"""


def write(drive: Drive, folder: Path | str) -> list[Path]:
    """Write run_1.csv, run_2.csv, ... (SI) and vehicle.toml into `folder`; the paths of the logs.

    A single plant's vehicle.toml names its columns u and y instead of a vehicle.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, run in enumerate(drive.runs, start=1):
        paths.append(folder / f"run_{number}.csv")
        rows = np.column_stack(list(run.values()))
        np.savetxt(paths[-1], rows, fmt="%.9g", delimiter=",", header=",".join(run), comments="")
    told = _PLANT
    if drive.geometry:
        l_f, l_r = drive.geometry
        told = f"[vehicle]\nl_f = {l_f}  # m\nl_r = {l_r}  # m\n"
    (folder / "vehicle.toml").write_text(told)
    return paths
