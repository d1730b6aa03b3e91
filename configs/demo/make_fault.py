"""Make the demo of `vdmsi diagnose`: three drives of a vehicle whose steering has play.

    python configs/demo/make_fault.py

They come from the generator of the hidden tests (`tests/hidden/generator`: plain NumPy at 1 kHz,
which shares no code with the toolkit) and are written to `configs/demo/fault`. It prints the truth.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from hidden.generator import Case, generate, write  # noqa: E402


def main() -> None:
    """Write the logs and tell what is hidden in them."""
    case = Case((("backlash", "steering"),), "middle", seed=7, duration=40.0)
    (drive,) = generate([case])
    for path in write(drive, ROOT / "configs" / "demo" / "fault"):
        print(path.relative_to(ROOT))
    for cause in drive.truth.causes:
        print(cause.word, cause.where, cause.parameters)


if __name__ == "__main__":
    main()
