"""Small logs on disk, for the tests of reading."""

from pathlib import Path

import numpy as np


def write_csv(path: Path, columns: dict, delimiter: str = ",") -> Path:
    """Write columns (numbers or texts) as CSV with all their digits."""
    rows = zip(*columns.values(), strict=True)
    cells = [[x if isinstance(x, str) else repr(float(x)) for x in row] for row in rows]
    lines = [delimiter.join(row) for row in [list(columns), *cells]]
    path.write_text("\n".join(lines) + "\n")
    return path


def drive(n: int = 200, dt: float = 0.01) -> dict:
    """A small canonical log: speed and steering steps, and their responses."""
    t = dt * np.arange(n)
    v_cmd = np.where(t % 1.0 < 0.5, 1.0, 2.0)
    delta_cmd = np.where(t % 0.6 < 0.3, 0.1, -0.1)
    return {
        "t": t,
        "v_cmd": v_cmd,
        "delta_cmd": delta_cmd,
        "v": 1.0 + 0.1 * np.sin(7 * t),
        "delta": 0.1 * np.sin(3 * t),
    }
