"""Commands for fast models: `jaxsph calibrate` and `jaxsph predict`."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.cli.arguments import (
    CaseName,
    EndTime,
    Quick,
    Quiet,
    Scale,
    Settings,
    Table,
    Workers,
    each_once,
    load,
    table_of,
    values_of,
)
from jaxsph.cli.studies import Scheduler, announce, cluster
from jaxsph.cli.terminal import INTERRUPTED, messages, print_notes, print_table
from jaxsph.errors import CaseError, FileError

MOST = 40
"""Largest number of predictions that are printed; more are only written to a file."""


def calibrate(
    case: CaseName,
    settings: Settings = None,
    quick: Quick = False,
    runs: Annotated[
        list[str] | None,
        typer.Option(
            "--runs",
            metavar="KEY=VALUES",
            help="Values of waves.H, waves.T or a damping (pto.K_dm), one per run; all lists must be equally "
            "long. "
            "Default: five runs around the case. Repeatable.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="File; default: runs/<name of the case>_model.json"),
    ] = None,
    t1: EndTime = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Fit a fast model of an oscillating water column or of bodies to a few runs; repeated, continue."""
    import jaxsph as js
    from jaxsph.study.fast_model import check, members_around, runs_of

    with messages(INTERRUPTED), cluster(scheduler) as executor:
        loaded = load(case, settings, quick, t1)
        over = each_once((values_of(text, "--runs") for text in runs or ()), "--runs")
        over = over or members_around(loaded)
        check(loaded, over)
        out = out if out is not None else Path("runs") / f"{loaded.name}_model.json"
        out.parent.mkdir(parents=True, exist_ok=True)
        if not quiet:
            announce(loaded, runs_of(out), len(next(iter(over.values()))), workers, scheduler)
        model = js.calibrate(loaded, out, over=over, workers=workers, executor=executor, progress=not quiet)
        if not quiet:
            print_table(_summary(model))
        typer.echo(f"recorded in {out}")


def _summary(model: Any) -> list[tuple[str, str]]:
    """Labels and values: what was found, and how well the model predicts each run that was left out."""
    rows = model.theory.found(model.added, model.added_error)
    rows.append(("predictions of runs that were left out", ""))
    for one in model.runs:
        text = ", ".join(
            f"{_quantity(model, name, one.left_out[name])} (run {one.results[name]:.3g})"
            for name in one.results
        )
        rows.append(("  " + ", ".join(f"{key} = {value:g}" for key, value in one.changes.items()), text))
    errors = ", ".join(f"{name} {value:.1%}" for name, value in model.error.items())
    return [*rows, ("error of such a prediction", errors)]


def _quantity(model: Any, name: str, value: float) -> str:
    """Name and value of a result, with its unit."""
    return f"{name} {value:.3g} {model.theory.predictable[name].unit}".rstrip()


def predict(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL", help="File of a fast model, or of a search with one.", show_default=False
        ),
    ],
    grid: Annotated[
        list[str] | None,
        typer.Option(
            "--grid",
            metavar="KEY=VALUES",
            help="Values of one parameter: KEY=0.02,0.04 or KEY=first:last:count. Repeatable.",
        ),
    ] = None,
    table: Table = None,
    scale: Scale = 1.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="CSV file for all predictions.")
    ] = None,
) -> None:
    """Predict powers, motions, pressure and flow with a fast model, for every combination of values.

    waves.H and waves.T are the height and period of regular waves; waves.Hs and waves.Tp, given together,
    those of a sea.
    """
    import jax
    import jax.numpy as jnp
    import numpy as np

    from jaxsph.study.fast_model import FastModel

    with messages(INTERRUPTED):
        fast = FastModel.read(model)
        over = each_once((values_of(text) for text in grid or ()), "--grid")
        members = list(itertools.product(*over.values()))
        if len(members) > MOST and out is None:
            raise CaseError(f"--grid: {len(members)} predictions; give --out FILE to write more than {MOST}")
        changes = {
            key: jnp.asarray(values, float)
            for key, values in zip(over, zip(*members, strict=True), strict=True)
        }
        scatter = table_of(table, scale)
        every = jax.jit(jax.vmap(lambda here: _answers(fast, scatter, here), axis_size=len(members)))
        found = every(changes)
        # in the order of the model, which JAX sorts
        values = {name: np.asarray(found[name]) for name in fast.theory.predictable if name in found}
        if out is not None:
            _write(out, fast, over, members, values)
        if len(members) <= MOST:
            print_table(_predictions(fast, over, members, values))
        print_notes(_doubts(members, values[fast.theory.power], scatter))
        if out is not None:
            typer.echo(f"recorded in {out}")


def _answers(fast: Any, scatter: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """Predictions by name; with a scatter table only the mean power over its seas."""
    if scatter is not None:
        return {fast.theory.power: fast.annual(scatter, changes)}
    return fast.results(changes)


def _predictions(fast: Any, over: Any, members: list[Any], values: Any) -> list[tuple[str, str]]:
    """Labels and values of predictions, with their errors."""
    rows, errors, known = [], fast.error, fast.theory.predictable
    for k, member in enumerate(members):
        label = ", ".join(f"{key} = {value:g}" for key, value in zip(over, member, strict=True))
        texts = []
        for name, of in values.items():
            error = errors[known[name].like] * of[k]
            texts.append(f"{name} = {of[k]:.4g} +- {error:.2g} {known[name].unit}".rstrip())
        rows.append((label or "the case", "; ".join(texts)))
    return rows


def _doubts(members: list[Any], power: Any, scatter: Any) -> list[str]:
    """Note on predictions that the model does not make."""
    missing = sum(not value == value for value in power)
    if not missing:
        return []
    site = "" if scatter is None else "; if the table is that of a site at full scale, give --scale"
    return [
        f"{missing} of {len(members)} predictions are nan: a period, or a length of the device, is outside "
        f"the range of the model{site}"
    ]


def _write(out: Path, fast: Any, over: Any, members: list[Any], values: Any) -> None:
    """Writes predictions to a CSV file. **Raises** FileError if it cannot be written."""
    try:
        with out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            units = {name: fast.theory.predictable[name].unit for name in values}
            writer.writerow([*over, *(f"{name} ({unit})" if unit else name for name, unit in units.items())])
            for k, member in enumerate(members):
                writer.writerow([*member, *(f"{of[k]:.6g}" for of in values.values())])
    except OSError as error:
        raise FileError(f"{out}: the predictions cannot be written: {error.strerror}") from None
