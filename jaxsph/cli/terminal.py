"""Output at the end of commands: tables, pages, and errors as messages and exit codes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import typer

from jaxsph.errors import ERROR_MARK, JaxsphError, SimulationError
from jaxsph.run import interrupt

INTERRUPTED = "interrupted; the same command continues where this one ended"
"""Message after Ctrl-C: studies keep the checkpoints of their members."""


def print_table(rows: list[tuple[str, str]]) -> None:
    """Prints labels and values in two columns."""
    width = max((len(label) for label, _ in rows), default=0)
    for label, value in rows:
        typer.echo(f"{label:<{width}}  {value}")


def print_notes(notes: Iterable[str]) -> None:
    """Prints each note for the user once, to the error stream."""
    for note in dict.fromkeys(notes):
        typer.echo(f"note: {note}", err=True)


def write_page(path: Path, wanted: bool, quiet: bool) -> None:
    """Writes the HTML page of a file next to that file, if `wanted`. If writing fails, only a note
    is printed."""
    if not wanted:
        return
    from jaxsph.report.page import report

    try:
        page = report(path)
    except JaxsphError as error:
        typer.echo(f"note: the page for a browser was not written: {error}", err=True)
        return
    if not quiet:
        typer.echo(f"page for a browser: {page}")


@contextlib.contextmanager
def messages(interrupted: str = "interrupted") -> Iterator[None]:
    """Turns errors that a user can act on into a message and an exit code: 2 for wrong input, 1 for a failed
    run.

    `interrupted`: message after Ctrl-C.
    """
    try:
        yield
    except JaxsphError as error:
        typer.echo(f"{ERROR_MARK}{error}", err=True)
        raise typer.Exit(1 if isinstance(error, SimulationError) else 2) from None
    except KeyboardInterrupt:
        typer.echo(f"jaxsph: {interrupted}", err=True)
        raise typer.Exit(interrupt.CODE) from None
