"""The report in print: the Typst sources of `paper/`, compiled with what `vdmsi reproduce` left."""

import importlib.util
import os
from pathlib import Path

from ..errors import InputError
from ..files import write_bytes

_PACKAGE = Path(__file__).resolve().parents[1]


def require_typst() -> None:
    """Refuse if Typst is not installed.

    Raises:
        InputError: it is not.
    """
    if importlib.util.find_spec("typst") is None:
        problem, mend = "Typst is not installed", 'pip install "vdmsi_jax[paper]", or leave it out'
        raise InputError("vdmsi reproduce", "--pdf", problem, mend)


def sources() -> Path:
    """The folder of `main.typ`: `paper/` of the repository, which an installed package carries."""
    for folder in (_PACKAGE / "paper", _PACKAGE.parent / "paper"):
        if (folder / "main.typ").is_file():
            return folder
    problem = "the Typst sources are not there"
    raise InputError(str(_PACKAGE), "paper", problem, "install the package anew")


def build_pdf(folder: Path) -> Path:
    """Compile the report.

    Args:
        folder: of `results.json` and `figures/`; the report becomes `report.pdf` in it.

    Returns:
        Where it is.

    Raises:
        InputError: Typst is not installed, refuses the sources, or there are no results.
    """
    require_typst()
    import typst

    folder, main = folder.resolve(), sources() / "main.typ"
    if not (folder / "results.json").is_file():
        mend = "make them with `vdmsi reproduce`"
        raise InputError(str(folder), "results.json", "there are no results here", mend)
    # Typst reads below one root only, and names files from there.
    root = Path(os.path.commonpath([folder, main.parent]))
    data = "/" + folder.relative_to(root).as_posix().removeprefix(".")
    try:
        content = typst.compile(
            str(main),
            root=str(root),
            sys_inputs={"data": data.rstrip("/")},
            ignore_system_fonts=True,  # the same type everywhere
        )
    except typst.TypstError as error:
        mend = "make the results anew with `vdmsi reproduce`"
        raise InputError(str(folder), "report.pdf", str(error), mend) from None
    return write_bytes(folder / "report.pdf", content)
