"""The rules of the house, read from the source: they hold for code that is not written yet."""

import ast
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import vdmsi_jax
from vdmsi_jax.effects import ACTUATOR, SENSOR, VEHICLE

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "vdmsi_jax"
MODULES = sorted(PACKAGE.rglob("*.py"))

LAYERS = (
    {"errors", "units", "decode", "files", "parameters", "programs", "shown", "threads"},
    {"geometry"},
    {"config"},
    {"data"},
    {"models", "effects", "model_file"},
    {"metrics", "scenarios", "control", "first_look"},
    {"simulate", "testbed"},
    {"identify"},
    {"bands", "compare", "correlation", "sweep", "diagnose", "fusion"},
    {"reproduce"},
    {"plots"},
    {"report", "terminal", "process", "usage"},
    {"cli"},
    {"__main__"},
)
"""Rooms of the package from the ground up; a room may use those below it and on its own floor."""

DIAGNOSE = ("answer", "signals", "actuator", "search", "body", "residual", "findings")
"""Rooms of `diagnose` from the ground up; what stands beside them may use all of them."""

LONGEST_FILE = 450

KNOWS_EFFECTS = {
    "effects": "the registry and the effects themselves",
    "diagnose": "which causes imitate each other, and what each is asked for, is its subject",
}
"""Rooms that may name single effects, and why; all others take what the registry has."""

SAYS_CAUSES = {
    "reproduce/drawn.py": "the truth of made-up vehicles is a choice of causes, as a test's is",
    "plots/beyond.py": "writes beside bars what `reproduce/drawn.py` calls its parts",
    "testbed/car.py": "a bank, a yaw inertia and a late sensor are parts of that car, no effects",
}
"""Files outside these rooms in which words of causes stand, and why."""

HOMONYMS = {"offset"}
"""Words of causes that are parameters of every transfer function, too."""


def floor(room: str) -> int:
    for level, rooms in enumerate(LAYERS):
        if room in rooms:
            return level
    raise AssertionError(f"vdmsi_jax/{room} stands on no floor: add it to LAYERS")


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path):
    """Dotted names that a file imports anywhere, relative ones resolved, with their lines."""
    inside = ("vdmsi_jax", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            above = inside[: len(inside) - node.level + 1] if node.level else ()
            base = [*above, *(node.module or "").split(".")] if node.module else list(above)
            for alias in node.names:
                yield ".".join([*base, alias.name]), node.lineno


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_downward_only(path):
    if room_of(path) == "__init__":
        pytest.skip("the public names come from everywhere")
    here = floor(room_of(path))
    upward = [
        f"{path.name}:{line} imports {name}"
        for name, line in imports(path)
        if name.startswith("vdmsi_jax.") and name != "vdmsi_jax.__version__"
        if floor(name.split(".")[1]) > here
    ]
    assert not upward


@pytest.mark.parametrize("room", DIAGNOSE)
def test_rooms_of_the_diagnosis_import_downward_only(room):
    above = {f"vdmsi_jax.diagnose.{other}" for other in DIAGNOSE[DIAGNOSE.index(room) + 1 :]}
    above |= {"vdmsi_jax.diagnose.prepare", "vdmsi_jax.diagnose.diagnose"}
    paths = sorted((PACKAGE / "diagnose" / room).glob("*.py"))
    upward = [
        f"{path.name}:{line} imports {name}"
        for path in paths
        for name, line in imports(path)
        if any(f"{name}.".startswith(f"{other}.") for other in above)
    ]
    assert len(paths) > 1
    assert not upward


def test_every_room_of_the_diagnosis_has_its_floor():
    rooms = {path.parent.name for path in (PACKAGE / "diagnose").glob("*/__init__.py")}
    assert rooms == set(DIAGNOSE)


def test_the_public_names_come_from_below_the_plots():
    homes = {name.split(".")[1] for name, _ in imports(PACKAGE / "__init__.py") if "_jax." in name}
    assert all(floor(home) < floor("plots") for home in homes)


def test_every_public_name_stands_for_type_checkers_too():
    seen = {
        name.rsplit(".", 1)[1] for name, _ in imports(PACKAGE / "__init__.py") if "_jax." in name
    }
    assert seen == set(vdmsi_jax.__all__)


def test_what_completes_the_package_are_its_public_names_alone():
    assert set(dir(vdmsi_jax)) == {*vdmsi_jax.__all__, "__version__"}
    assert {"Quadrature", "Arcs", "Solver", "Prepare"} <= set(vdmsi_jax.__all__)


def test_a_verb_stays_the_verb_when_its_module_is_imported():
    for name in vdmsi_jax.__all__:
        assert not inspect.ismodule(getattr(vdmsi_jax, name)), name
    for verb in ("identify", "simulate", "compare"):
        importlib.import_module(f"vdmsi_jax.{verb}")
        assert callable(getattr(vdmsi_jax, verb))


def test_only_plots_imports_matplotlib():
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in MODULES
        for name, line in imports(path)
        if room_of(path) != "plots" and name.split(".")[0] in ("matplotlib", "mpl_toolkits")
    ]
    assert not found


def test_plots_never_touch_the_global_state_of_pyplot():
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in MODULES
        for name, line in imports(path)
        if name.startswith("matplotlib.pyplot") or name == "pylab"
    ]
    assert not found


def classes():
    for info in pkgutil.walk_packages(vdmsi_jax.__path__, "vdmsi_jax."):
        module = importlib.import_module(info.name)
        for _, cls in inspect.getmembers(module, inspect.isclass):
            if cls.__module__ == module.__name__:
                yield cls


def test_no_concrete_class_is_subclassed():
    concrete = [
        f"{cls.__qualname__} subclasses {base.__qualname__}"
        for cls in classes()
        for base in cls.__mro__[1:]
        if base.__module__.startswith("vdmsi_jax")
        and not inspect.isabstract(base)
        and not getattr(base, "_is_protocol", False)
    ]
    assert not concrete


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_only_the_registry_and_the_diagnosis_name_effects(path):
    """A cause that is added to the registry is known everywhere: no other room lists them."""
    if room_of(path) in KNOWS_EFFECTS:
        return
    effects = [*ACTUATOR, *VEHICLE, *SENSOR]
    causes = {effect.cause for effect in effects} - HOMONYMS
    names = {type(effect).__name__ for effect in effects}
    homes = {type(effect).__module__.rsplit(".", 1)[1] for effect in effects}
    found = [
        f"line {line} imports {name}"
        for name, line in imports(path)
        if name.startswith("vdmsi_jax.effects.") and set(name.split(".")[2:]) & (names | homes)
    ]
    found += [
        f"line {node.lineno} says {node.value!r}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and node.value in causes
    ]
    assert bool(found) == (str(path.relative_to(PACKAGE)) in SAYS_CAUSES), found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_file_is_one_concept(path):
    assert len(path.read_text().splitlines()) <= LONGEST_FILE


def test_importing_the_package_changes_nothing_and_prints_nothing():
    program = """
import pkgutil, importlib, jax
before = dict(jax.config.values)
import vdmsi_jax
for info in pkgutil.walk_packages(vdmsi_jax.__path__, "vdmsi_jax."):
    importlib.import_module(info.name)
changed = {name for name, value in before.items() if jax.config.values[name] != value}
assert not changed, changed
"""
    done = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:vdmsi_jax", "-c", program],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def readme_tree() -> list[str]:
    """Paths of the README's tree, folders with a slash at their end."""
    text = (ROOT / "README.md").read_text()
    block = re.search(r"```text\n(vdmsi_jax/.*?)```", text, re.S)
    assert block, "the README has no tree"
    paths, folders = [], []
    for line in block.group(1).splitlines():
        entry = re.match(r"( *)(\S+)", line)
        if entry is None:
            continue
        depth = len(entry.group(1)) // 2
        folders = folders[:depth]
        paths.append("".join(folders) + entry.group(2))
        if entry.group(2).endswith("/"):
            folders.append(entry.group(2))
    return paths


def test_the_tree_in_the_readme_matches_the_disk():
    tree = readme_tree()
    missing = [path for path in tree if not (ROOT / path).exists()]
    assert not missing, f"in the README, not on disk: {missing}"
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    hidden = {".gitignore", "README.md", "CHANGELOG.md", "LICENSE", "Makefile", "pyproject.toml"}
    for path in tracked:
        parts = path.split("/")
        top = parts[0] + ("/" if len(parts) > 1 else "")
        shown = [top]
        if top == "vdmsi_jax/":
            inner = parts[1] + ("/" if len(parts) > 2 else "")
            shown = [] if inner == "__init__.py" else [top + inner]
        for entry in shown:
            assert entry in tree or entry in hidden, f"{entry} is not in the README's tree"
