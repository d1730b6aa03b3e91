"""Run every notebook from top to bottom and keep the executed copies in out/notebooks."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).resolve().parent


def execute(path: Path) -> nbformat.NotebookNode:
    """The notebook with its outputs; raises `nbclient.exceptions.CellExecutionError`."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(HERE)}}
    ).execute()
    return notebook


if __name__ == "__main__":
    out = HERE.parent / "out" / "notebooks"
    out.mkdir(parents=True, exist_ok=True)
    for path in sorted(HERE.glob("*.ipynb")):
        print(f"running {path.name}", file=sys.stderr)
        nbformat.write(execute(path), out / path.name)
    print(f"executed notebooks are in {out}")
