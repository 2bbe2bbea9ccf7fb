"""Command that runs a case many times, `jaxsph sweep`, and what such commands share."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.case.report import in_time
from jaxsph.cli.arguments import (
    CaseName,
    EndTime,
    Page,
    Quick,
    Quiet,
    Settings,
    Workers,
    each_once,
    load,
    values_of,
)
from jaxsph.cli.spacing import ErrorAt, OtherScheme, chosen_members, print_errors
from jaxsph.cli.terminal import INTERRUPTED, messages, print_notes, print_table, write_page
from jaxsph.errors import CaseError
from jaxsph.report.doubts import doubts_of_members
from jaxsph.report.labels import label_of

CLUSTER_TIMEOUT = 10
"""Time limit for connecting to a cluster's scheduler, s."""

Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers make the runs, e.g. tcp://host:8786."),
]
"""Option for the scheduler of a cluster."""


def sweep(
    case: CaseName,
    grid: Annotated[
        list[str],
        typer.Option(
            "--grid",
            metavar="KEY=VALUES",
            help="Values of one parameter: KEY=0.02,0.04 or KEY=first:last:count. Repeatable.",
        ),
    ],
    settings: Settings = None,
    quick: Quick = False,
    error_at: ErrorAt = None,
    other_scheme: OtherScheme = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="File; default: runs/<name of the case>_sweep.h5"),
    ] = None,
    t1: EndTime = None,
    workers: Workers = None,
    batch: Annotated[
        int | None,
        typer.Option(help="Number of runs in one batch; default: 8 on an accelerator, no batches on a CPU."),
    ] = None,
    scheduler: Scheduler = None,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Run a case for every combination of parameter values, or continue an interrupted sweep."""
    import jaxsph as js

    with messages(INTERRUPTED), cluster(scheduler) as executor:
        over = each_once((values_of(text) for text in grid), "--grid")
        if t1 is not None and "t1" in over:
            raise CaseError("--t1: t1 is also a parameter of --grid; give only one of the two")
        loaded = load(case, settings, quick, t1)
        places = chosen_members(loaded, over, error_at or (), scheduler, other_scheme)
        out = out if out is not None else Path("runs") / f"{loaded.name}_sweep.h5"
        if not quiet:
            _refuse_equal(loaded, over)
            note_members(loaded, over)
            announce(loaded, out, math.prod(map(len, over.values())), workers, scheduler)
        done = js.sweep(
            loaded, over, out, workers=workers, batch=batch, executor=executor, progress=not quiet
        )
        if not quiet:
            print_table(_sweep_rows(done))
            doubt(loaded, done)
        print_errors(done, places, out, workers, quiet, other_scheme)
        typer.echo(f"recorded in {out}")
        write_page(out, report, quiet)
        end_with_failures(done)


def _refuse_equal(loaded: Any, over: Mapping[str, Sequence[float]]) -> None:
    """Checks, before a run is timed, that the members differ. **Raises** CaseError if the lattice rounds two
    lengths to the same value."""
    from jaxsph.study.sweep import check_different

    for name, values in over.items():
        check_different([loaded.replace({name: value}) for value in values], [name])


def note_members(loaded: Any, over: Mapping[str, Sequence[float]]) -> None:
    """Prints the notices of a case, and of the case with each value of the parameters.

    **Raises** CaseError before the first run if a value is not allowed.
    """
    members = [loaded.replace({name: value}) for name, values in over.items() for value in values]
    if hasattr(loaded, "notices"):
        print_notes(notice for one in (loaded, *members) for notice in one.notices())


def doubt(loaded: Any, done: Any) -> None:
    """Prints the reasons to doubt results of a sweep's members."""
    ended = sorted(set(done.members) - set(done.failures))
    results = [{name: done[name][place] for name in done.results} for place in ended]
    known = [{name: value for name, value in one.items() if not math.isnan(value)} for one in results]
    print_notes(doubts_of_members(known, getattr(loaded, "waves", None) is not None))


def announce(
    loaded: Any,
    out: Path,
    runs: int,
    workers: int | None,
    scheduler: str | None,
    most: str = "",
) -> None:
    """Prints the number of runs and their expected time, estimated from a few steps of one run.

    Prints nothing if the file `out` exists, since the study then continues. `most`: words before a number
    that is an upper limit.
    """
    if out.exists():
        return
    import jaxsph as js
    from jaxsph.run.devices import available_cores

    counted = f"{most}1 run" if runs == 1 else f"{most}{runs} runs"
    if scheduler is not None:
        typer.echo(counted, err=True)
        return
    beside = min(runs, workers or available_cores())
    one = js.duration(loaded, devices=1)
    total = one.compilation + one.step * one.steps * math.ceil(runs / beside)
    each = "" if runs == 1 else f" each, {beside} at a time"
    time = in_time(one.step * one.steps)
    typer.echo(f"{counted} of about {time}{each}: {most}about {in_time(total)}", err=True)


def _sweep_rows(done: Any) -> list[tuple[str, str]]:
    """One row per member: parameter values and efficiency, or another result if there is no efficiency."""
    name = done.meanings.first(done.results) or "energy_residual_share"
    if name not in done.results:
        return []
    label = label_of(name, True, done.meanings.labels).text.strip()
    places = sorted(set(done.members) - set(done.failures))
    return [(done.words(place), f"{label} {done[name][place]:.4g}") for place in places]


def end_with_failures(done: Any, unknown: CaseError | None = None) -> None:
    """Prints the members that failed, and ends the command with exit code 1 if there are any.

    **Raises** the error `unknown` if it is given, after the failures are printed.
    """
    for place, text in done.failures.items():
        typer.echo(f"failed: {done.words(place)}: {text.splitlines()[0]}", err=True)
    if unknown is not None:
        raise unknown
    if done.failures:
        raise typer.Exit(1)


@contextlib.contextmanager
def cluster(address: str | None) -> Iterator[Any]:
    """Context with the executor of a Dask cluster, or None without an address. **Raises** CaseError if Dask
    is missing or no scheduler answers."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise CaseError('--scheduler needs Dask: run python -m pip install "jaxsph[cluster]"') from None
    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT)
    except (OSError, ValueError) as error:
        raise CaseError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}); start one as in "
            "docs/cluster.md"
        ) from None
    with client:
        yield client.get_executor(pure=False)
