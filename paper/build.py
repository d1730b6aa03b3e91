"""Compile the report from the results in a folder: `python paper/build.py out/paper`."""

import sys
from pathlib import Path

from vdmsi_jax.report.pdf import build_pdf

if __name__ == "__main__":
    print(build_pdf(Path(sys.argv[1])))
