"""The `jaxsph` command, assembled from the other modules' subcommands in the order in which the help lists
them."""

from __future__ import annotations

from typing import Annotated

import typer

from jaxsph.cli import calibration, cases, coefficients, matrix, running, searching, showing, studies
from jaxsph.output.hdf5 import version as installed_version

app = typer.Typer(
    name="jaxsph",
    help="Simulate wave energy converters with smoothed particle hydrodynamics (SPH). "
    "Start with: jaxsph run owc --quick",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"jaxsph {installed_version()}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Options that belong to no command; typer calls this before every command."""


_COMMANDS = {
    "run": running.run,
    "sweep": studies.sweep,
    "matrix": matrix.matrix,
    "coefficients": coefficients.coefficients,
    "calibrate": calibration.calibrate,
    "predict": calibration.predict,
    "slope": searching.slope,
    "optimise": searching.optimise,
    "resume": running.resume,
    "plot": showing.plot,
    "export": showing.export,
    "report": showing.write_report,
    "watch": showing.watch,
    "check": cases.check,
    "profile": cases.profile,
    "show": cases.show,
    "new": cases.new,
    "cases": cases.cases,
}

for _name, _command in _COMMANDS.items():
    app.command(_name)(_command)
