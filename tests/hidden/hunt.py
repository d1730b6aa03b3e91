"""The hunt: hide a cause in a made-up log, ask for it, and count what comes back.

    python tests/hidden/hunt.py --out FOLDER [--plan full|small|tiny] [--seconds N] [--part K/N]

One line for each case is appended to FOLDER/results.jsonl, and a rerun does only what is missing:
those of docs/hunt are kept with the code, so that another machine goes on with them.
At its end, and whenever it is stopped, it writes FOLDER/hunt.md and two pictures from all lines
there are; `--seconds 0` does only that. Parts K of N may run side by side, into one folder.
"""

import argparse
import hashlib
import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hidden import hunt_report  # noqa: E402
from hidden.hunt_case import examined, made  # noqa: E402
from hidden.hunt_plan import PLANS, Task, plan  # noqa: E402

AT_ONCE = 16  # cases that are generated in one loop: as fast a case as more, and done sooner
RESULTS = "results.jsonl"


def main(arguments: Sequence[str] | None = None) -> int:
    options = _options(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / RESULTS
    tasks = plan(options.plan)
    done = {line["key"] for line in read(file)}
    own = tasks[options.part[0] - 1 :: options.part[1]]
    missing = [task for task in own if task.key not in done]
    tell(f"{options.plan} plan: {len(tasks)} cases, {len(missing)} of them to be done here")
    try:
        if missing and options.seconds != 0:
            hunt(missing, file, options.seconds)
    except KeyboardInterrupt:
        tell("stopped; the report holds what was done")
    keys = {task.key for task in tasks}
    lines = [line for line in read(file) if line["key"] in keys]
    hunt_report.write(lines, options.out, options.plan, len(tasks))
    tell(f"{len(lines)} of {len(tasks)} cases are in {options.out / 'hunt.md'}")
    return 0


def hunt(tasks: Sequence[Task], file: Path, seconds: float | None) -> None:
    """Examine the tasks in their order, until time is up."""
    keep_programs()
    from vdmsi_jax import diagnose

    began, version, counted, crashed = time.monotonic(), code_version(), 0, 0
    for ready in _batches(tasks):
        for task, *drives in ready:
            line = examined(task, *drives, diagnose) | {"code": version}
            append(file, line)
            counted += 1
            crashed += "error" in line
            spent = time.monotonic() - began
            left = spent / counted * (len(tasks) - counted)
            said = line.get("error") or brief(line)
            tell(
                f"[{counted}/{len(tasks)}, {crashed} crashed, {_hours(left)} to go] "
                f"{task.key} ({line['seconds']:.1f} s): {said}"
            )
            if seconds is not None and spent > seconds:
                tell(f"{seconds:g} s are over; the same command goes on")
                return


def _batches(tasks: Sequence[Task]) -> Iterator[list]:
    """Drives, a few at a time, those of one vehicle after each other: they share programs."""
    for first in range(0, len(tasks), AT_ONCE):
        batch = tasks[first : first + AT_ONCE]
        yield made(sorted(batch, key=lambda task: (task.plant, task.case.seed)))


def brief(line: dict) -> str:
    """What was said, in a few words."""
    told = [f"{f['cause']}@{f['channel'] or f['where']}" for f in line["findings"]]
    return f"{line['verdict']}: {', '.join(told) or 'nothing'} (lambda0 {line['lambda0']:.0f})"


def read(file: Path) -> list[dict]:
    """The lines of a file of results, the last of each key; a line that was cut short is none."""
    lines = {}
    for row in file.read_text().splitlines() if file.exists() else ():
        try:
            line = json.loads(row)
        except json.JSONDecodeError:
            continue
        lines[line["key"]] = line
    return list(lines.values())


def append(file: Path, line: dict) -> None:
    """Append a line, its numbers with six digits, in one write, so that processes that share the
    file do not mix theirs; it does not continue one that was cut short."""
    short = json.loads(json.dumps(line), parse_float=lambda digits: float(f"{float(digits):.6g}"))
    row = json.dumps(short) + "\n"
    handle = os.open(file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        size = os.fstat(handle).st_size
        if size and os.pread(handle, 1, size - 1) != b"\n":
            row = "\n" + row
        os.write(handle, row.encode())
        os.fsync(handle)
    finally:
        os.close(handle)


def code_version() -> str:
    """A word for the package's code as it is on disk, to tell which lines belong together."""
    package = Path(__file__).resolve().parents[2] / "vdmsi_jax"
    sources = b"".join(path.read_bytes() for path in sorted(package.rglob("*.py")))
    return hashlib.sha1(sources).hexdigest()[:10]


def tell(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


def keep_programs() -> None:
    """Double precision, and compiled programs kept from one process to the next."""
    import jax

    jax.config.update("jax_enable_x64", True)
    cache = os.environ.get("JAX_COMPILATION_CACHE_DIR") or Path(tempfile.gettempdir()) / "hunt_xla"
    jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    warnings.filterwarnings("ignore")


def _hours(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def part(words: str) -> tuple[int, int]:
    """K and N of `K/N`."""
    number, _, of = words.partition("/")
    if not (of.isdigit() and number.isdigit() and 1 <= int(number) <= int(of)):
        raise argparse.ArgumentTypeError(f"{words!r} is no part such as 1/2")
    return int(number), int(of)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of results and report")
    parser.add_argument("--plan", choices=PLANS, default="full")
    parser.add_argument("--seconds", type=float, help="stop after about so many; 0: report only")
    parser.add_argument(
        "--part", type=part, default=(1, 1), help="K/N: every Nth case from the Kth"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
