"""Commands that run a case: `jaxsph run` and `jaxsph resume`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.cli.arguments import (
    CaseName,
    Changes,
    Devices,
    EndTime,
    Page,
    Pictures,
    Process,
    Program,
    Quick,
    Quiet,
    RunName,
    Settings,
    load,
    match_precision,
    setting_of,
)
from jaxsph.cli.spacing import OtherScheme, run_with_error
from jaxsph.cli.terminal import INTERRUPTED, messages, print_notes, print_table, write_page
from jaxsph.core.native.forms import advice
from jaxsph.errors import CaseError, JaxsphError, SimulationError
from jaxsph.output.run_file import RunFile
from jaxsph.report.doubts import doubts
from jaxsph.report.labels import in_order, in_words, label_of, short
from jaxsph.run import interrupt


def run(
    case: CaseName,
    settings: Settings = None,
    t1: EndTime = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Output file; default: runs/<name of the case>.h5"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE if it exists.")] = False,
    quick: Quick = False,
    error: Annotated[
        bool,
        typer.Option(
            "--error",
            help="Also run the case with half of its spacing, and give results without the error of the "
            "spacing; FILE is a sweep of all runs, by default runs/<name of the case>_error.h5.",
        ),
    ] = False,
    other_scheme: OtherScheme = False,
    devices: Devices = None,
    process: Process = None,
    plot: Pictures = True,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Run a case and record it in one HDF5 file."""
    import jaxsph as js

    if error:
        refused = {
            "--overwrite": overwrite,
            "--devices": devices is not None,
            "--process": process is not None,
        }
        with messages(INTERRUPTED):
            run_with_error(load(case, settings, quick, t1), out, refused, other_scheme, report, quiet)
        return
    with messages():
        if other_scheme:
            raise CaseError("--other-scheme: needs --error, which gives results with their errors")
        is_first = _find(devices, process)
        loaded = load(case, settings, quick)
        out = out if out is not None else Path("runs") / f"{loaded.name}.h5"
        quiet = quiet or not is_first
        if t1 is not None and not isinstance(loaded, js.Program):
            loaded = loaded.replace({"t1": t1})  # so that `resume` ends there too
        if not quiet:
            notices = [] if isinstance(loaded, js.Program) else loaded.notices()
            print_notes([*notices, *filter(None, [advice()])])
        with _resumable(out, case):
            solution = js.run(
                loaded, t1=t1, out=out, overwrite=overwrite, progress=not quiet, devices=devices
            )
        if is_first:
            waves = getattr(loaded, "waves", None) is not None
            _report(solution, out, waves, (plot and not quick, report), quiet)
            if quick and not quiet:
                typer.echo(f"this was a COARSE run for a first look; for reliable numbers: jaxsph run {case}")


def resume(
    file: RunName,
    program: Program = None,
    settings: Changes = None,
    t1: EndTime = None,
    devices: Devices = None,
    process: Process = None,
    plot: Pictures = True,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Continue a run from its last checkpoint."""
    import jaxsph as js

    with messages():
        is_first = _find(devices, process)
        quiet = quiet or not is_first
        stored = RunFile.open(file).case_keys()
        match_precision(stored.get("precision"))
        changes = dict(setting_of(text) for text in settings or [])
        # a function may have arguments without defaults
        given = None if program is None else load(program, None, stored=stored.get("arguments", {}))
        with _resumable(file, program or ""):
            solution = js.resume(
                file, t1=t1, progress=not quiet, changes=changes, devices=devices, given=given
            )
        if is_first:
            _report(solution, file, bool(stored.get("waves")), (plot, report), quiet)


def _find(devices: int | None, process: str | None) -> bool:
    """Joins the processes of a run and sets the number of devices; call it before JAX is first used.

    **Returns** whether this process is the first. **Raises** CaseError if processes or devices are missing.
    """
    import jax

    from jaxsph.run.devices import find_devices
    from jaxsph.run.processes import join

    if process is not None:
        join(process)
    find_devices(devices)
    return jax.process_index() == 0


def _report(solution: Any, path: Path, waves: bool, wanted: tuple[bool, bool], quiet: bool) -> None:
    """Prints the results and the doubts about them, and writes pictures and a page if their flags in `wanted`
    are set."""
    if not quiet:
        results, flat = solution.results or {}, len(solution.model.g) == 2
        print_table(_rows(results, flat, solution.labels))
        print_notes([*solution.notices, *(doubt.text for doubt in doubts(results, waves))])
        typer.echo(f"recorded in {path}")
    pictures, page = wanted
    if pictures:
        from jaxsph.output.plot.pictures import plot_run

        written = plot_run(path)
        if written and not quiet:
            typer.echo(f"{len(written)} pictures in {written[0].parent}")
    write_page(path, page, quiet)


def _rows(results: dict[str, float], flat: bool, own: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Labels and values of results without energies of the whole run; empty rows separate the groups.

    `flat`: whether the run is two-dimensional, with results for bodies and energies per metre of width.
    """
    rows, group = [], None
    for name in in_order(results, own):
        if name.startswith("whole_"):
            continue
        label = label_of(name, flat, own)
        if group not in (None, label.group):
            rows.append(("", ""))
        group = label.group
        rows.append((short(label), f"{in_words(results[name]):>10} {label.unit}".rstrip()))
    return rows


@contextlib.contextmanager
def _resumable(path: Path, program: str) -> Iterator[None]:
    """Context that tells the user how to continue a run that was interrupted or has failed.

    `program`: name with which the run was started; if it is FILE.py:FUNCTION, the message repeats it.
    """
    resume = f"jaxsph resume {path}" + (f" --program {program}" if ".py" in program else "")

    def words() -> str:
        return f"\njaxsph: interrupted. {_what_is_left(path, resume)}"

    with interrupt.end_at_once(words):
        try:
            yield
        except KeyboardInterrupt:
            typer.echo(words(), err=True)
            raise typer.Exit(interrupt.CODE) from None
        except SimulationError as error:
            text = f"{error}\n{_what_is_left(path, resume)}".replace("jaxsph resume FILE", resume)
            raise SimulationError(text, error.step, error.time, error.where) from None


def _what_is_left(path: Path, resume: str) -> str:
    """Message on how to continue a run that was stopped."""
    with contextlib.suppress(JaxsphError):
        if RunFile.open(path).has_checkpoint():
            return f"{path} is complete up to its last checkpoint; continue with: {resume}"
    return f"There is no checkpoint yet; start again with --overwrite ({path})"
