"""Command for power matrices: `jaxsph matrix`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.cli.arguments import (
    CaseName,
    EndTime,
    Page,
    Quick,
    Quiet,
    Scale,
    Settings,
    Table,
    load,
    table_of,
    values_of,
)
from jaxsph.cli.spacing import ErrorAt, OtherScheme, chosen_members, print_errors
from jaxsph.cli.studies import Scheduler, announce, cluster, doubt, end_with_failures, note_members
from jaxsph.cli.terminal import INTERRUPTED, messages, print_table, write_page
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import SweepFile
from jaxsph.report.froude import factor
from jaxsph.report.labels import with_error_in_words

Heights = Annotated[
    str,
    typer.Option(
        "--hs", metavar="VALUES", help="Significant wave heights, m: 0.02,0.04 or first:last:count."
    ),
]
Periods = Annotated[
    str, typer.Option("--tp", metavar="VALUES", help="Peak periods, s: 1.2,1.4 or first:last:count.")
]

Seeds = Annotated[int, typer.Option(help="Number of random seas per sea state; more seas reduce the error.")]


def matrix(
    case: CaseName,
    heights: Heights,
    periods: Periods,
    seeds: Seeds = 1,
    table: Table = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Fast model of the device, or a search with one, for sea states of --table without runs.",
        ),
    ] = None,
    scale: Scale = 1.0,
    error_at: ErrorAt = None,
    other_scheme: OtherScheme = False,
    settings: Settings = None,
    quick: Quick = False,
    t1: EndTime = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="File; default: runs/<name of the case>_matrix.h5"),
    ] = None,
    scheduler: Scheduler = None,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Compute a power matrix: mean power for every wave height and period, and the mean over a scatter
    table."""
    import jaxsph as js
    from jaxsph.study.matrix import matrix_of, members_of

    with messages(INTERRUPTED), cluster(scheduler) as executor:
        loaded = load(case, settings, quick, t1)
        scatter = table_of(table, scale)
        Hs, Tp = (
            values_of(f"{name}={text}", f"--{name}")[1] for name, text in (("hs", heights), ("tp", periods))
        )
        over = members_of(loaded, Hs, Tp, seeds)
        fast = _model(model, loaded, scatter)
        if scatter is not None and fast is None:
            scatter.check_within(Hs, Tp)
        places = chosen_members(loaded, over, error_at or (), scheduler, other_scheme)
        out = out if out is not None else Path("runs") / f"{loaded.name}_matrix.h5"
        if not quiet:
            note_members(loaded, {"waves.Hs": Hs, "waves.Tp": Tp})
            announce(loaded, out, len(Hs) * len(Tp) * seeds, None, scheduler)
        done = js.power_matrix(loaded, Hs, Tp, out, seeds=seeds, executor=executor, progress=not quiet)
        print_errors(done.sweep, places, out, None, quiet, other_scheme)
        if places:
            done = matrix_of(js.read_sweep(out))
        unknown = _print_matrix(done, scatter, fast, scale, out)
        typer.echo(f"recorded in {out}")
        if not quiet:
            doubt(loaded, done.sweep)
            from jaxsph.output.plot.matrix import plot_matrix

            typer.echo(f"picture: {plot_matrix(done, out.with_name(out.stem + '_plots'))}")
        write_page(out, report, quiet)
        end_with_failures(done.sweep, unknown)


def _model(path: Path | None, case: Any, scatter: Any) -> Any:
    """Fast model from its file, for the device of a case; None without a file.

    **Raises** CaseError, before any run, for a model without a table, or one that does not suit the case or
    the table.
    """
    from jaxsph.study.fast_model import FastModel
    from jaxsph.study.matrix import powers_of_model

    if path is None:
        return None
    if scatter is None:
        raise CaseError(f"--model {path}: needs --table, as the model is for sea states without runs")
    model = FastModel.read(path).moved(case)
    powers_of_model(model, scatter.used.Hs, scatter.used.Tp)
    return model


def _print_matrix(done: Any, scatter: Any, fast: Any, scale: float, out: Path) -> CaseError | None:
    """Prints the power of each sea state, and the mean over the scatter table if there is one.

    The other arguments are those of `_year`. **Returns** the error if this mean is unknown, so that
    everything else can be printed and written first.
    """
    rows, unknown = _matrix_rows(done), None
    if scatter is not None:
        try:
            rows += _year(done, scatter, fast, scale, out)
        except CaseError as found:
            unknown = found
    print_table(rows)
    return unknown


def _year(done: Any, scatter: Any, fast: Any, scale: float, out: Path) -> list[tuple[str, str]]:
    """Labels and values of the mean power over a scatter table, its errors by origin, and the energy.

    The mean power is also stored in the file `out` of the matrix as its main result. `fast`: the fast model,
    or None; `scale`: lengths of the table over those of the case. **Raises** CaseError as
    `PowerMatrix.annual`.
    """
    over, hours = scatter.period
    mean = done.annual(scatter, fast)
    theory = done.annual_linear(scatter) if fast is None else float(fast.linear.annual(scatter))
    linear = "" if math.isnan(theory) else f"{theory:.3g}"
    full = factor(done.unit, scale)
    # at the scale of the case and of the table, and the energy at the latter
    value, at_scale, energy = (
        with_error_in_words(times * mean.value, times * mean.error)
        for times in (1.0, full, full * hours * 1e-6)
    )
    answer = {"label": f"mean power over the {over}", "value": value}
    SweepFile(out).conclude(answer | {"unit": done.unit, "expected": linear, "note": ""})
    rows = [(f"mean over the {over}", f"{value} {done.unit}{linear and f'; linear theory {linear}'}")]
    origins = {
        "  error due to the random seas": mean.waves,
        "  error in sea states without runs": mean.between,
        "  error due to the spacing": mean.spacing,
        "  error due to the scheme": mean.scheme,
    }
    rows += [(label, f"{error:.1g} {done.unit}") for label, error in origins.items() if error > 0.0]
    rows += [(f"the same at {scale:g} times the lengths", f"{at_scale} {done.unit}")] if scale != 1.0 else []
    return [*rows, (f"energy in {hours:,.0f} h", f"{energy} {done.unit.replace('W', 'MWh')}")]


def _matrix_rows(done: Any) -> list[tuple[str, str]]:
    """One row per sea state, with its mean power."""
    unit, rows = done.unit, []
    for i, height in enumerate(done.Hs):
        for j, period in enumerate(done.Tp):
            linear = done.linear[i, j]
            theory = "" if linear != linear else f"; linear theory {linear:.3g}"  # NaN: no theory
            error = "" if math.isnan(done.error[i, j]) else f" +- {done.error[i, j]:.1g}"
            xi = "" if math.isnan(done.xi[i, j]) else f" (xi {done.xi[i, j]:.3g})"
            known = f"{done.P[i, j]:.3g}{error} {unit}{xi}"
            value = "no mean power" if math.isnan(done.P[i, j]) else known
            rows.append((f"Hs = {height:g} m, Tp = {period:g} s", f"{value}{theory}"))
    return rows
