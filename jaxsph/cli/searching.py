"""Commands for slopes and searches: `jaxsph slope` and `optimise`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.cli.arguments import (
    CaseName,
    EndTime,
    Method,
    Page,
    Quick,
    Quiet,
    Scale,
    Settings,
    Spread,
    Table,
    Way,
    bounds_of,
    each_once,
    load,
    table_of,
    values_of,
)
from jaxsph.cli.studies import announce, note_members
from jaxsph.cli.terminal import INTERRUPTED, messages, print_table, write_page
from jaxsph.errors import CaseError
from jaxsph.study.base import check_result
from jaxsph.study.search import PerCost, checked, runs_of_search

Costs = Annotated[
    list[str] | None,
    typer.Option(
        "--cost",
        metavar="KEY=PRICE",
        help="Price per unit of a parameter, or fixed=PRICE, for --method model: maximises the result "
        "over the cost. Repeatable.",
    ),
]
"""Option for the cost of a device in a search."""


def slope(  # its arguments are the options of the command
    case: CaseName,
    over: Annotated[str, typer.Option("--over", metavar="KEY", help="Parameter to vary, e.g. pto.K_dm.")],
    of: Annotated[
        str,
        typer.Option(
            "--of", help="Result: xi, P_owc or energy_pto; for an ensemble, any result, e.g. amplitude_P_a."
        ),
    ] = "xi",
    method: Method = Way.ensemble,
    members: Annotated[
        int,
        typer.Option(
            help="Number of runs around the case's value; a parabola is fitted to them, or with "
            "--method model to their differences from the model."
        ),
    ] = 9,
    spread: Spread = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Fast model (jaxsph calibrate) for --method model; by default five more runs calibrate one.",
        ),
    ] = None,
    settings: Settings = None,
    quick: Quick = False,
    t1: EndTime = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="File; default: runs/<name of the case>_<KEY>.h5"),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Compute the slope of a result with respect to one parameter of the case, with its error."""
    import jaxsph as js

    several = method in (Way.ensemble, Way.model)
    with messages(INTERRUPTED if several else "interrupted"):
        loaded = load(case, settings, quick, t1)
        out = out if out is not None else Path("runs") / f"{loaded.name}_{over}.h5"
        if not quiet:
            note_members(loaded, {})
        found = js.derivative(loaded, over, of, method.of(spread, members, out, model), progress=not quiet)
        error = "" if found.error is None else f" +- {found.error:.2g}"
        print_table(
            [
                *((f"{of} at {key} = {value:.4g}", f"{there:.4g}") for key, value, there in _runs(found)),
                ("method", method.value),
                (of, f"{found.value:.4g}"),
                (f"d {of} / d {over}", f"{found.slope:.4g}{error}{_missing_runs(found)}"),
                ("valid for changes up to", f"{found.reach:.3g}"),
            ]
        )
        if several:
            typer.echo(f"recorded in {out}")


def optimise(  # its arguments are the options of the command
    case: CaseName,
    over: Annotated[
        list[str], typer.Option("--over", metavar="KEY=LOW:HIGH", help="Parameter to optimise; repeatable.")
    ],
    of: Annotated[
        str,
        typer.Option(
            "--of",
            help="Result to maximise: xi, P_owc, energy_pto; for ensembles, any result, e.g. amplitude_P_a.",
        ),
    ] = "xi",
    method: Method = Way.ensemble,
    members: Annotated[int, typer.Option(help="Number of runs for every slope.")] = 9,
    spread: Spread = None,
    evaluations: Annotated[int, typer.Option(help="Largest number of points or devices that are run.")] = 10,
    table: Table = None,
    scale: Scale = 1.0,
    cost: Costs = None,
    settings: Settings = None,
    quick: Quick = False,
    t1: EndTime = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="File; default: runs/<name of the case>_optimum.h5"),
    ] = None,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Search for the parameter values that maximise a result, or continue an interrupted search."""
    import jaxsph as js

    with messages(INTERRUPTED):
        loaded = load(case, settings, quick, t1)
        out = out if out is not None else Path("runs") / f"{loaded.name}_optimum.h5"
        bounds = each_once((bounds_of(text) for text in over), "--over")
        scatter = table_of(table, scale)
        aim = _aim("P_owc" if scatter and method is not Way.model else of, cost, method)
        if not quiet:
            note_members(loaded, bounds)
            _check_search(loaded, bounds, aim, scatter, method)
            runs = {Way.ensemble: evaluations * members, Way.model: runs_of_search(evaluations)}
            if method in runs:
                announce(loaded, out, runs[method], None, None, "at most ")
        limits = {"evaluations": evaluations, "progress": not quiet}
        if method is Way.model:
            found = js.search(loaded, bounds, out, of=aim, table=scatter, **limits)
        else:
            way = method.of(spread, members)
            way = way if scatter is None else js.OverSeas(scatter, way)
            found = js.maximise(loaded, bounds, out, str(aim), way, **limits)
        _print_search(found, list(bounds))
        typer.echo(f"recorded in {out}")
        write_page(out, report, quiet)


def _print_search(found: Any, keys: Sequence[str]) -> None:
    """Prints the evaluations of a search, and the best."""
    print_table([_evaluation(here, found.of, keys) for here in found.history])
    highest = max(found.history, key=lambda here: here[found.of])
    best = ", ".join(f"{key} = {highest[key]:.4g}" for key in keys)
    typer.echo(f"best: {found.of} = {found.value:.4g} at {best} ({found.reason})")


def _aim(of: str, cost: Sequence[str] | None, method: Way) -> str | PerCost:
    """What a search maximises, from the options. **Raises** CaseError for prices that are not single numbers,
    and for a method other than that of a model."""
    if not cost:
        return of
    if method is not Way.model:
        raise CaseError(f"--cost needs --method model, not {method.value}")
    given = each_once((values_of(text, "--cost") for text in cost), "--cost")
    for key, values in given.items():
        if len(values) != 1:
            raise CaseError(f"--cost {key}: give one price, not {len(values)}")
    prices = {key: float(value) for key, (value,) in given.items()}
    return PerCost(of, prices.pop("fixed", 0.0), prices)


def _check_search(
    loaded: Any, bounds: Mapping[str, Any], of: str | PerCost, scatter: Any, method: Way
) -> None:
    """**Raises** CaseError, before a run is timed, for a search that its method refuses."""
    if method is Way.model:
        checked(loaded, bounds, of, scatter)
    elif method is Way.ensemble and scatter is None:
        check_result(loaded.problem(), str(of))


def _runs(found: Any) -> list[tuple[str, float, float]]:
    """Parameter, its value and the result of every run of an ensemble; empty for other methods."""
    values, results = (found.members.get(name, ()) for name in (found.parameter, found.of))
    return [(found.parameter, *pair) for pair in zip(values, results, strict=True)]


def _missing_runs(found: Any) -> str:
    """Text in brackets after a slope: from how many runs it is, and why the others are missing; empty if
    none is missing."""
    known = [math.isfinite(value) for value in found.members.get(found.of, ())]
    if all(known):
        return ""
    why = [
        f"member {k} failed: {found.failures[k].splitlines()[0]}"
        if k in found.failures
        else f"member {k} gave no {found.of}"
        for k, one in enumerate(known)
        if not one
    ]
    return f" ({sum(known)} of {len(known)} runs; {'; '.join(why)})"


def _evaluation(here: Mapping[str, float], of: str, keys: Sequence[str]) -> tuple[str, str]:
    """Texts for one evaluation of a search: parameter values, and the result with its slopes or error."""
    place = ", ".join(f"{key} = {here[key]:.4g}" for key in keys)
    if (error := here.get(f"error {of}")) is not None:
        before = f" (the model promised {here[name]:.4g})" if (name := f"promised {of}") in here else ""
        return f"{of} at {place}", f"{here[of]:.4g} +- {error:.2g}{before}"
    slopes = "".join(f", slope {here[f'slope {key}']:.3g} +- {here[f'error {key}']:.2g}" for key in keys)
    return f"{of} at {place}", f"{here[of]:.4g}{slopes}"
