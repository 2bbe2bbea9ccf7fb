"""Commands that show a run or a sweep: `jaxsph plot`, `export`, `report` and `watch`."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from jaxsph.cli.arguments import RunName
from jaxsph.cli.terminal import messages
from jaxsph.errors import CaseError, FileError
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import SweepFile
from jaxsph.output.vtk import export_vtkhdf
from jaxsph.run import interrupt


def plot(
    file: RunName,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the pictures; default: next to FILE, such as runs/owc_plots for runs/owc.h5.",
        ),
    ] = None,
    animation: Annotated[
        bool, typer.Option("--animation/--no-animation", help="Animate the snapshots.")
    ] = True,
    vtk: Annotated[
        Path | None,
        typer.Option("--vtk", metavar="FILE", help="Also export the particles to this file, for ParaView."),
    ] = None,
    linear: Annotated[
        bool, typer.Option("--linear", help="Add linear theory to the picture of the chamber.")
    ] = False,
) -> None:
    """Draw pictures of a run or a sweep, finished or not, and export the particles of a run."""
    import jaxsph as js
    from jaxsph.output.plot.pictures import plot_run
    from jaxsph.output.plot.sweeps import plot_sweep

    with messages():
        interrupt.raise_again()
        if SweepFile(file).is_one():
            for option, given in (("--vtk", vtk is not None), ("--linear", linear)):
                if given:
                    raise FileError(
                        f"{option}: {file} contains a sweep, and this option is for runs; omit {option}, or "
                        "give the file of a run"
                    )
            for path in plot_sweep(file, folder):
                typer.echo(path)
            return
        opened = RunFile.open(file)
        if linear and "program" in opened.case_keys():
            raise CaseError(
                f"--linear: {file} was made by a Python program; linear theory is available only for cases; "
                "omit --linear"
            )
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
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Page to write; default: named after the first FILE."
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the page even if it was not written by jaxsph.")
    ] = False,
    show: Annotated[bool, typer.Option("--show", help="Open the page in the browser.")] = False,
) -> None:
    """Write one HTML page for the browser, with results, charts and playback of the particles."""
    from jaxsph.report.page import report

    with messages():
        interrupt.raise_again()
        page = report(files, out, overwrite)
        typer.echo(f"{page} ({page.stat().st_size / 1e6:.1f} MB)")
        if show:
            typer.launch(str(page))


def export(
    file: RunName,
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV files next to FILE (default).")] = False,
    xlsx: Annotated[bool, typer.Option("--xlsx", help="Write an Excel workbook next to FILE.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="TABLE",
            help="Table to write, .csv or .xlsx; .mat or .nc for a power matrix.",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing tables.")] = False,
    scale: Annotated[
        float,
        typer.Option(
            "--scale",
            metavar="N",
            help="Write the values at N times the lengths of the run, by Froude's law.",
        ),
    ] = 1.0,
) -> None:
    """Write the results and readings of a run, the members of a sweep, or a power matrix, as tables."""
    import jaxsph as js

    with messages():
        suffixes = [suffix for suffix, given in ((".csv", csv), (".xlsx", xlsx)) if given]
        if len(suffixes) > 1 or (out is not None and suffixes not in ([], [out.suffix])):
            raise CaseError(
                "--csv, --xlsx and --out: give only one of them, or --out with a name that ends in the same "
                "format"
            )
        out = out if out is not None else Path(file).with_suffix(".xlsx" if xlsx else ".csv")
        for written in js.export(file, out, overwrite=overwrite, scale=scale):
            typer.echo(f"table: {written}")
        if scale != 1.0 and RunFile.open(file).case_keys().get("air", {}).get("volume"):
            typer.echo(
                "note: the air is compressible; the values hold only if the run's air.volume or air.pressure "
                "follows docs/how-to/scale.md",
                err=True,
            )


def watch(
    file: RunName,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; default: any free port.")] = 0,
    show: Annotated[bool, typer.Option("--show", help="Open the page in the browser.")] = False,
) -> None:
    """Show a run in progress in the browser, updated at every checkpoint; end with Ctrl-C."""
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
