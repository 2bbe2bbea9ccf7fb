"""Command for added mass, damping and excitation of a case's bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from jaxsph.cli.arguments import CaseName, Quick, Quiet, Settings, Workers, load
from jaxsph.cli.studies import announce, cluster
from jaxsph.cli.terminal import INTERRUPTED, messages, print_notes, print_table

FAR_OFF = 0.1
"""Ratio of a damping coefficient's standard deviation to its value above which the command prints a note."""


Amplitude = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Amplitude of the prescribed motions, m (for pitch, at the farthest wet point); default: a "
        "tenth of the draught, but at least half a spacing.",
    ),
]


OutFile = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="File: .nc for Capytaine's layout, .h5 for WEC-Sim's; default: runs/<case>_coefficients.nc",
    ),
]


def coefficients(  # its arguments are the options of the command
    case: CaseName,
    period: Annotated[list[float], typer.Option("--period", metavar="S", help="Wave period, s. Repeatable.")],
    body: Annotated[
        list[str] | None,
        typer.Option("--body", metavar="NAME", help="Body that moves; default: all."),
    ] = None,
    motion: Annotated[
        list[str] | None,
        typer.Option(
            "--motion",
            help="surge, heave or pitch; default: all in which a body is free or is carried by another body. "
            "Repeatable.",
        ),
    ] = None,
    amplitude: Amplitude = None,
    height: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Height of the waves on the held bodies, m; default: waves.H of regular waves, otherwise "
            "twice the default amplitude.",
        ),
    ] = None,
    cycles: Annotated[int, typer.Option(help="Number of periods that are averaged.")] = 5,
    settings: Settings = None,
    quick: Quick = False,
    out: OutFile = None,
    workers: Workers = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers run the members.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Compute added mass, damping and wave excitation of bodies, or continue an interrupted study."""
    import jaxsph as js

    with messages(INTERRUPTED), cluster(scheduler) as executor:
        loaded = load(case, settings, quick)
        motions = _asked(loaded, body, motion)
        forcing = js.Forcing(amplitude, height, cycles)
        out = out if out is not None else Path("runs") / f"{loaded.name}_coefficients.nc"
        if not quiet:
            _forecast(loaded, period, out, motions, forcing, workers, scheduler)
        options = {"workers": workers, "executor": executor, "progress": not quiet}
        found = js.coefficients(loaded, period, out, motions=motions, forcing=forcing, **options)
        if not quiet:
            print_table(_rows(found))
            print_notes(_doubts(loaded, found))
        typer.echo(f"recorded in {out}")
        for run, text in found.failures.items():
            typer.echo(f"failed: {run}: {text.splitlines()[0]}", err=True)
        if found.failures:
            raise typer.Exit(1)


def _asked(loaded: Any, bodies: list[str] | None, motions: list[str] | None) -> Any:
    """Argument `motions` of `js.coefficients` from the options of the command."""
    from jaxsph.case.held import find_modes

    if not bodies:
        return motions or None
    free = find_modes(loaded)
    return {name: motions or [mode.motion for mode in free if mode.body == name] for name in bodies}


def _forecast(
    loaded: Any,
    periods: list[float],
    out: Path,
    motions: Any,
    forcing: Any,
    workers: int | None,
    scheduler: str | None,
) -> None:
    """Prints the number of runs and their expected time. **Raises** CaseError if the study is impossible."""
    from jaxsph.case.held import find_modes
    from jaxsph.study.coefficients import check_study, runs_of

    modes = find_modes(loaded, motions)
    members = check_study(loaded, periods, out, modes, forcing)
    middle = sorted(members, key=lambda one: one.t1)[len(members) // 2]
    announce(middle, runs_of(out), len(members), workers, scheduler)


UNITS = {
    "surge": ("kg/m", "N s/m2", "N/m2"),
    "heave": ("kg/m", "N s/m2", "N/m2"),
    "pitch": ("kg m", "N s", "N/m"),
}
"""Units of added mass, damping and excitation per metre of width, for each motion."""


def _rows(found: Any) -> list[tuple[str, str]]:
    """Rows of the table, one for every mode and period: the diagonal of the matrices, and the excitation."""
    rows, several = [], len(found.bodies) > 1
    for i, mode in enumerate(found.modes):
        a, b, x = UNITS[mode.motion]
        for w, omega in enumerate(found.omega):
            X = found.X[w, i]
            values = (
                f"A = {found.A[w, i, i]:.4g} +- {found.A_spread[w, i, i]:.2g} {a}",
                f"B = {found.B[w, i, i]:.4g} +- {found.B_spread[w, i, i]:.2g} {b}",
                f"|X| = {abs(X):.4g} +- {found.X_spread[w, i]:.2g} {x}, phase {np.angle(X):.3f} rad",
            )
            if found.linear is not None:
                A, B, Y = found.linear.A[w, i, i], found.linear.B[w, i, i], found.linear.X[w, i]
                theory = f"A = {A:.4g}, B = {B:.4g}, |X| = {abs(Y):.4g}, phase {np.angle(Y):.3f} rad"
                values = (*values, f"linear theory: {theory}")
            name = f"{mode.motion} of {mode.body}" if several else mode.motion
            rows.append((f"{name}, T = {2.0 * np.pi / omega:.4g} s", "; ".join(values)))
    return rows


def _doubts(loaded: Any, found: Any) -> list[str]:
    """Notes on the coefficients: their convention, large spreads, and a tank without a sponge."""
    notes = [
        "values are per metre of width; +- is the standard deviation from period to period",
        f"in waves with the elevation a cos(omega t) at x = {found.x:g} m, the force is "
        "a |X| cos(omega t + phase)",
    ]
    if loaded.sponge is None:
        notes.append(
            "there is no sponge, so the coefficients include the reflection from the tank's far end: add a "
            "sponge to reduce this reflection"
        )
    size = np.abs(found.B.diagonal(axis1=1, axis2=2))
    wide = found.B_spread.diagonal(axis1=1, axis2=2) > FAR_OFF * size
    if np.any(wide):
        w, i = np.argwhere(wide)[0]
        notes.append(
            f"the damping of {found.modes[i].body} in {found.modes[i].motion} at T = "
            f"{2.0 * np.pi / found.omega[w]:.4g} s varies by {found.B_spread[w, i, i] / size[w, i]:.0%} from "
            "period to period: use a larger amplitude, more cycles or a smaller dx"
        )
    return notes
