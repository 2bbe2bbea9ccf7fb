"""Commands that show a run or a sweep: `jaxsph plot`, `export`, `report` and `watch`."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from jaxsph.cli.arguments import RunName
from jaxsph.cli.terminal import messages
from jaxsph.errors import CaseError
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import SweepFile
from jaxsph.output.vtk import export_vtkhdf
from jaxsph.run import interrupt


def plot(
    file: RunName,
    folder: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder; default: beside FILE, runs/owc_plots for runs/owc.h5."),
    ] = None,
    animation: Annotated[
        bool, typer.Option("--animation/--no-animation", help="Animate the snapshots.")
    ] = True,
    vtk: Annotated[
        Path | None, typer.Option("--vtk", metavar="FILE", help="Also export for ParaView.")
    ] = None,
    linear: Annotated[
        bool, typer.Option("--linear", help="Draw what linear theory expects of the chamber.")
    ] = False,
) -> None:
    """Make pictures of a run or a sweep, finished or not, and export a run's particles."""
    import jaxsph as js
    from jaxsph.output.plot.pictures import plot_run
    from jaxsph.output.plot.sweeps import plot_sweep

    with messages():
        interrupt.raise_again()
        if SweepFile(file).is_one():
            for path in plot_sweep(file, folder):
                typer.echo(path)
            return
        opened = RunFile.open(file)
        if linear and "program" in opened.case_keys():
            raise CaseError(f"--linear: {file} is of a program, whose linear theory is not known")
        expected = js.linear_owc(js.Case.from_dict(opened.case_keys())) if linear else None
        for path in plot_run(opened, folder=folder, animation=animation, linear=expected):
            typer.echo(path)
        if vtk is not None:
            typer.echo(export_vtkhdf(opened, vtk))


def write_report(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Files of runs or sweeps, shown side by side.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Default: the first FILE with .html.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace FILE also where it is no page of jaxsph.")
    ] = False,
    show: Annotated[bool, typer.Option("--show", help="Open it in the browser.")] = False,
) -> None:
    """Write a page for the browser: results, charts, and the particles played back, in one file."""
    from jaxsph.report.page import report

    with messages():
        interrupt.raise_again()
        page = report(files, out, overwrite)
        typer.echo(f"{page} ({page.stat().st_size / 1e6:.1f} MB)")
        if show:
            typer.launch(str(page))


def export(
    file: RunName,
    csv: Annotated[bool, typer.Option("--csv", help="CSV files beside FILE (the default).")] = False,
    xlsx: Annotated[bool, typer.Option("--xlsx", help="A workbook beside FILE.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="TABLE", help="Another name, in .csv or .xlsx.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace tables that exist.")] = False,
) -> None:
    """Write the results and readings of a run, or the members of a sweep, as tables for a spreadsheet."""
    import jaxsph as js

    with messages():
        if csv + xlsx + (out is not None) > 1:
            raise CaseError("--csv, --xlsx and --out: give one of them")
        out = out if out is not None else Path(file).with_suffix(".xlsx" if xlsx else ".csv")
        for written in js.export(file, out, overwrite=overwrite):
            typer.echo(f"table: {written}")


def watch(
    file: RunName,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; default: one that is free.")] = 0,
    show: Annotated[bool, typer.Option("--show", help="Open it in the browser.")] = False,
) -> None:
    """Show a run that goes on in the browser, renewed after every chunk, until Ctrl-C."""
    import threading

    from jaxsph.report.watch import Watch

    with messages():
        interrupt.raise_again()
        with Watch(file, port) as served:
            typer.echo(f"{served.address} (end it with Ctrl-C)")
            if show:
                typer.launch(served.address)
            with contextlib.suppress(KeyboardInterrupt):
                threading.Event().wait()
