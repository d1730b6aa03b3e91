"""The command line: `vdmsi diagnose`, `identify`, `simulate`, `sweep`, `reproduce`.

Each command reads its input before it imports what computes, so that bad input is refused at once.
"""

import contextlib
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NoReturn

from tyro.conf import Positional, arg

from . import __version__
from .errors import InputError
from .process import ahead, leave, prepare
from .usage import call_of

Logs = Annotated[tuple[Path, ...], Positional, arg(metavar="LOG...", help_behavior_hint="")]
File = Annotated[Path, arg(metavar="FILE")]
Folder = Annotated[Path, arg(metavar="DIR", help_behavior_hint="")]


def identify(
    logs: Logs,
    /,
    *,
    out: Folder,
    config: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None,
    report: bool = True,
    cache: bool = True,
) -> None:
    """Fit every order of every actuator to logs of one vehicle.

    Writes identify.json, which `vdmsi simulate` takes, and report.html.

    Args:
        logs: CSV or NPZ files, identified together.
        out: folder to write to.
        config: TOML file: vehicle, columns, units, plants, and which orders; the one that lies
            beside each log without one, else canonical columns.
        report: write report.html.
        cache: keep compiled programs for the next time.
    """
    from .config import load_config
    from .data.copies import without_copies
    from .data.read import options_of, read_logs
    from .files import output_folder

    settings = None if config is None else load_config(config)
    records, copies = without_copies(read_logs(logs, settings))
    options = options_of(logs, settings)
    output_folder(out)
    prepare(cache)

    from . import terminal
    from .data import uncommanded
    from .identify.vehicle import identified_and_refused
    from .report.files import write_identification

    with terminal.working("identifying"):
        grids, refused = identified_and_refused(records, options=options)
    write_identification(out, grids, records, refused, report=False)
    terminal.show_grids(grids)
    plants = [plant for record in records for plant in record.plants]
    told = [f"{name} was not identified: {why}" for name, why in refused.items()]
    for line in [*copies, *told, *uncommanded(records, plants)]:
        print(f"vdmsi: {line}", file=sys.stderr)
    if report:
        with terminal.working("drawing the report"):
            from .report.identification import identification_page
            from .report.page import write_page

            write_page(out, identification_page(grids, records, refused))
    terminal.tell_report(out, written=report)


def simulate(
    model: Annotated[Path, Positional, arg(metavar="MODEL")],
    logs: Logs,
    /,
    *,
    out: Folder,
    config: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None,
    window: Annotated[float, arg(metavar="SECONDS")] = 20.0,
    report: bool = True,
    cache: bool = True,
) -> None:
    """Simulate logs with and without the identified actuators, and score both.

    Writes simulation.json, trajectories as TUM files, and report.html.

    Args:
        model: an identify.json or model.json.
        logs: CSV or NPZ files, each simulated by itself.
        out: folder to write to.
        config: TOML file: vehicle, columns, units; without one that beside the log (its own name or
            vehicle.toml), and without that the canonical columns and the model's vehicle.
        window: length of the windows that start anew at the measured pose.
        report: write report.html.
        cache: keep compiled programs for the next time.
    """
    from .config import load_config
    from .data.read import read_logs
    from .files import output_folder

    if not window > 0.0:
        raise InputError("vdmsi simulate", "--window", f"{window} is no duration", "give seconds")
    settings = None if config is None else load_config(config)
    records = read_logs(logs, settings, in_step=False)
    output_folder(out)
    prepare(cache)

    from . import terminal
    from .compare import compare
    from .model_file import load_model
    from .report.files import write_comparisons

    loaded = load_model(model)
    for record in records:
        own, its = loaded.vehicle, record.vehicle
        if own is not None and its is not None and (own.l_f, own.l_r) != (its.l_f, its.l_r):
            told = f"driven by its own l_f and l_r, {its.l_f:g} and {its.l_r:g} m"
            than = f"not those of {model.name}, {own.l_f:g} and {own.l_r:g} m"
            print(f"vdmsi: {record.log}: {told}, {than}", file=sys.stderr)
    with terminal.working("simulating"):
        comparisons = [compare(record, loaded, window=window) for record in records]
    write_comparisons(out, comparisons, report=False)
    terminal.show_comparisons(comparisons)
    if report:
        with terminal.working("drawing the report"):
            from .report.page import write_page
            from .report.simulation import simulation_page

            write_page(out, simulation_page(comparisons))
    terminal.tell_report(out, written=report)


def diagnose(
    logs: Logs,
    /,
    *,
    out: Folder,
    config: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None,
    report: bool = True,
    cache: bool = True,
) -> None:
    """Say what the simulation gets wrong, why, and what an extended model gains.

    Writes diagnosis.json, model.json (the extended model with all that is significant, which `vdmsi
    simulate` takes), and report.html.

    Args:
        logs: CSV or NPZ files of one vehicle; of several, a third judges what the others
            taught: the last, unless its commands are not like theirs.
        out: folder to write to.
        config: TOML file: vehicle, columns, units, plants; the one that lies beside each log
            without one, else canonical columns.
        report: write report.html.
        cache: keep compiled programs for the next time.
    """
    from .config import load_config
    from .data.read import read_logs
    from .files import output_folder

    settings = None if config is None else load_config(config)
    records = read_logs(logs, settings)
    output_folder(out)
    prepare(cache)

    from . import terminal
    from .diagnose import diagnose as run
    from .report.files import write_diagnosis

    if report:
        ahead("vdmsi_jax.report.diagnosis")
    with terminal.working("diagnosing") as say:
        found = run(records, told=say)
    write_diagnosis(out, found, report=False)
    terminal.show_diagnosis(found)
    if report:
        with terminal.working("drawing the report"):
            from .report.diagnosis import diagnosis_page
            from .report.page import write_page

            write_page(out, diagnosis_page(found))
    terminal.tell_report(out, written=report)


def sweep(
    config: Annotated[Path, Positional, arg(metavar="CONFIG")],
    /,
    *,
    out: Folder,
    report: bool = True,
    cache: bool = True,
) -> None:
    """Identify every plant of many logs over a grid of orders.

    Writes sweep.json and report.html. Finished cells are kept in the output folder; run it again to
    go on where it was stopped.

    Args:
        config: TOML file with a [sweep] table, of logs and their configurations, and an [identify]
            table, of the orders.
        out: folder to write to and to take up again.
        report: write report.html.
        cache: keep compiled programs for the next time.
    """
    from .files import write_json
    from .sweep import SWEEP, plan, summarise

    cells = plan(config, out)
    prepare(cache)

    from . import terminal

    results = []
    with terminal.progress() as bar:
        task = bar.add_task("", total=len(cells))
        for cell in cells:
            bar.update(task, description=cell.name)
            results.append(cell.finish())
            bar.advance(task)
    rows = summarise(cells, results)
    write_json(out / "sweep.json", {"schema": SWEEP, "cells": rows})
    terminal.show_sweep(rows)
    if report:
        from .report.page import write_page
        from .report.sweep import sweep_page

        write_page(out, sweep_page(rows, results))
    terminal.tell_report(out, written=report)
    refused = [row["refused"] for row in rows if "refused" in row]
    for why, cells_alike in Counter(refused).items():
        print(f"vdmsi: {cells_alike} of {len(rows)} cells: {why}", file=sys.stderr)
    if refused:
        raise SystemExit(2)


def reproduce(
    *,
    out: Folder,
    logs: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None,
    engine: bool = False,
    beyond: bool = False,
    pdf: bool = False,
    report: bool = True,
    cache: bool = True,
) -> None:
    """Make the experiments of the paper again, with a car on a physics engine.

    Writes results.json, figures/ and report.html, and report.pdf if asked.

    Args:
        out: folder to write to.
        logs: logs of an earlier run with --engine (its folder logs); those of the package without.
        engine: drive the car anew, by MuJoCo, and keep its logs in the folder logs.
        beyond: run the studies beyond the paper anew and keep them in beyond.json; without, those
            of the package are told, which were run before.
        pdf: write report.pdf, too, by Typst.
        report: write figures/ and report.html.
        cache: keep compiled programs for the next time.
    """
    from .files import output_folder, write_json, write_text

    if engine and logs is not None:
        problem = "is read from where --engine writes"
        raise InputError("vdmsi reproduce", "--logs", problem, "give one of both")
    if pdf and not report:
        problem = "the PDF shows the figures that come with the report"
        raise InputError("vdmsi reproduce", "--pdf", problem, "leave out --no-report")
    if pdf:
        from .report.pdf import require_typst

        require_typst()
    output_folder(out)
    prepare(cache)

    from . import terminal
    from .reproduce import SHIPPED
    from .reproduce import beyond as studies
    from .reproduce import reproduce as run
    from .reproduce.document import results_document
    from .reproduce.logs import looks

    folder = out / "logs" if engine else logs or SHIPPED
    source = (
        "Recorded by the physics engine in this run."
        if engine
        else (
            "From logs that were recorded by the physics engine before; what follows from them was "
            "computed in this run, the drives without sensors excepted."
        )
    )
    with terminal.working("reproducing") as say:
        found = run(folder, engine=engine, told=say)
        further = studies.beyond(told=say).document() if beyond else studies.recorded()
    if beyond:
        write_json(out / "beyond.json", further)
    told = "Computed in this run." if beyond else studies.RECORDED_SOURCE
    document = results_document(found, source=source, beyond=further, beyond_source=told)
    write_json(out / "results.json", document)
    terminal.show_reproduction(found)
    if report:
        with terminal.working("drawing the report"):
            from .report.beyond import beyond_figures, beyond_sections
            from .report.page import write_page
            from .report.reproduction import embedded, figure_file, figures, reproduction_page

            drawings = {one.trim.name: figures(one) for one in found}
            drawings["beyond"] = beyond_figures(document)
            output_folder(out / "figures")
            pictures = looks(folder)
            for course, picture in pictures.items():
                write_text(out / "figures" / figure_file("look", course), embedded(picture))
            for car, drawn in drawings.items():
                for name, drawing in drawn.items():
                    write_text(out / "figures" / figure_file(car, name), drawing.svg + "\n")
            more = beyond_sections(document, drawings["beyond"])
            page = reproduction_page(found, drawings, pictures, source=source, more=more)
            write_page(out, page)
    terminal.tell_report(out, written=report)
    if pdf:
        with terminal.working("typesetting the report"):
            from .report.pdf import build_pdf

            made = build_pdf(out)
        terminal.OUT.print(f"paper: {made}", soft_wrap=True)


COMMANDS = {
    "diagnose": diagnose,
    "identify": identify,
    "simulate": simulate,
    "sweep": sweep,
    "reproduce": reproduce,
}


def program() -> NoReturn:
    """Run what the command line asks for, and end the process with its exit code."""
    try:
        main()
    except SystemExit as leaving:
        leave(leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None))
    leave(0)


def main(arguments: list[str] | None = None) -> None:
    """Run a command and leave with its exit code: 0 when it finished, 2 for input that is refused,
    with one line on standard error."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        if arguments == ["--version"]:
            print(f"vdmsi {__version__}", flush=True)
            return
        try:
            with _plain_warnings():
                call_of(arguments, COMMANDS)()
        finally:
            sys.stdout.flush()  # here, where a reader that went away is looked after
    except InputError as refused:
        print(f"vdmsi: {refused}", file=sys.stderr)
        raise SystemExit(2) from None
    except BrokenPipeError:
        from .terminal import hush

        hush()  # what is buffered has nowhere to go
        raise SystemExit(1) from None
    except OSError as error:
        path = error.filename2 or error.filename or "the output"
        reason = error.strerror or str(error)
        mend = "name a path that can be read and written"
        print(f"vdmsi: {path}: {reason.lower()}; {mend}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


@contextlib.contextmanager
def _plain_warnings() -> Iterator[None]:
    """Warn users by a line of this program, without the place in the code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: print(f"vdmsi: {message}", file=sys.stderr)
        yield
