"""Command line of the experiments: runs them by name, and compares them with the paper and with references.

    python -m experiments run NAME [OPTIONS]   runs one experiment; rows and pictures go to runs/results
    python -m experiments run NAME --help      shows its options; without a NAME lists the names
    python -m experiments table [NAME ...]     prints the committed rows; NAME may be the beginning of a name
    python -m experiments again [NAME ...]     repeats the named experiments, or all that have committed rows
    python -m experiments gallery              writes experiments/README.md, with a picture and a line for
                                               each experiment, and the numbers in the README and docs/

A row is flagged `MISSED` if its value is outside its limit, and `worse than the paper` if the paper's value
is nearer to the reference.
"""

from __future__ import annotations

import ast
import difflib
import importlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments import sentences
from experiments.common import COMMITTED, OWN, VERDICT, Report, shown

GALLERY = Path(__file__).parent / "README.md"
SAME = "the same"
"""Beginning of the name of a row that continues the row above it."""
FOLDERS = ("verification", "validation", "studies", "benchmarks")
INTRODUCTION = """# Experiments

Results of the experiments. `python -m experiments gallery` writes this page from the committed results;
`python -m experiments table` prints every row with its limit. A reference is a value of theory, or of the
measurement, the other program or the other run with which a result is compared.

The command of a section repeats the experiment, and writes its rows and picture into `runs/results`. Runs are
kept in `runs/`; an interrupted run is continued. With `--commit` appended, the command replaces the results
shown here. Each command is followed by the duration and the machine. The CPUs were shared with other
processes. A duration of 0.0 or 0.1 min does not include all runs.
"""

app = typer.Typer(
    help="Runs the experiments and prints their results.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command(
    # options that `run` does not define are passed to the experiment, including `--help`
    context_settings={
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
)
def run(
    context: typer.Context,
    name: Annotated[str, typer.Argument()] = "--help",
    commit: Annotated[bool, typer.Option("--commit", help="Write into experiments/results.")] = False,
) -> None:
    """Runs one experiment and writes rows and pictures into runs/results; without a NAME lists the names."""
    if name == "--help":
        _list()
        return
    command = parser(name)
    Report.folder = COMMITTED if commit else OWN
    Report.command = shlex.join(["python", "-m", "experiments", "run", name, *context.args])
    command(args=context.args, prog_name=f"python -m experiments run {name}")


@app.command()
def table(
    names: Annotated[list[str] | None, typer.Argument(help="Beginnings of names; default: all.")] = None,
    own: Annotated[bool, typer.Option("--own", help="Rows of your own runs, in runs/results.")] = False,
) -> None:
    """Prints the rows of the named experiments, and the number of rows that are outside their limits."""
    missed = total = 0
    for found in results(names, OWN if own else COMMITTED):
        print(f"\n{_heading(found)}\n  {found['command']}  ({found['seconds']:.0f} s; {found['machine']})")
        print(f"  {'':54s} {'paper':>12s} {'reference':>12s} {'here':>18s}  limit")
        for row in found["rows"]:
            total += 1
            missed += row["passes"] is False
            print(
                f"  {row['check']:54s} {shown(row['paper']):>12s} {shown(row['theory']):>12s} "
                f"{shown(row['here'], row['unit']):>18s}  {row['bar']:26s} {flag(row)}"
            )
    print(f"\n{total} rows, {missed} outside their limits")


@app.command()
def again(
    names: Annotated[list[str] | None, typer.Argument(help="Beginnings of names; default: all.")] = None,
    folder: Annotated[Path, typer.Option(help="Folder for runs and rows.")] = Path("runs/again"),
    commit: Annotated[
        bool, typer.Option("--commit", help="Copies rows and pictures to experiments/results.")
    ] = False,
) -> None:
    """Runs the experiments whose rows are committed, the shortest first, and lists those that failed.

    Each experiment is a separate process that works in --folder, so that no run of an older version is read.
    If called again, the command continues where it stopped. Remove the folder to start afresh.
    """
    made, failed = folder.resolve() / OWN, []
    folder.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join(filter(None, [str(GALLERY.parents[1]), os.environ.get("PYTHONPATH")]))
    wanted = [(found["seconds"], file, found["command"]) for file, found in _committed(names)]
    for seconds, file, command in sorted(wanted):
        if not (made / file).exists():
            print(f"\n{command}  ({seconds / 60:.0f} min the last time)", flush=True)
            _, *arguments = shlex.split(command)
            process = subprocess.run(
                [sys.executable, *arguments], cwd=folder, env={**os.environ, "PYTHONPATH": path}, check=False
            )
            failed += [command] if process.returncode else []
    for file in made.iterdir() if commit and made.exists() else ():
        shutil.copy(file, COMMITTED)
    for command in failed:
        print(f"failed: {command}", file=sys.stderr)
    raise typer.Exit(1 if failed else 0)


@app.command()
def gallery() -> None:
    """Writes experiments/README.md, and the numbers in the README and docs/, from the committed results."""
    GALLERY.write_text(gallery_text(), encoding="utf-8")
    sentences.renew()


def experiments() -> dict[str, Path]:
    """Paths of all experiment files in the four folders, by the names of the experiments."""
    here = Path(__file__).parent
    files = sorted(path for folder in FOLDERS for path in (here / folder).glob("*.py"))
    return {path.stem: path for path in files if path.stem != "__init__"}


def parser(name: str) -> Any:
    """Command that runs an experiment from the command line, with the options of its function `main`.

    **Raises** BadParameter if no experiment has this name.
    """
    known = experiments()
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        meant = f"did you mean {near[0]}?" if near else "python -m experiments run lists the names"
        raise typer.BadParameter(f"no experiment is called {name!r}: {meant}")
    module = importlib.import_module(f"experiments.{known[name].parent.name}.{name}")
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command()(module.main)
    return typer.main.get_command(alone)


def _list() -> None:
    """Prints the experiments by folder, each with the first line of its docstring."""
    folder = None
    for name, path in sorted(experiments().items(), key=lambda of: (FOLDERS.index(of[1].parent.name), of[0])):
        if path.parent.name != folder:
            folder = path.parent.name
            print(f"\n{folder}")
        first = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]
        print(f"  {name:17s} {first}")
    print("\npython -m experiments run NAME --help shows the options of an experiment.")


def results(names: list[str] | None = None, folder: Path = COMMITTED) -> list[dict[str, Any]]:
    """Results in a folder, of experiments whose names begin with one of the given names."""
    return [found for _, found in _committed(names, folder)]


def _committed(names: list[str] | None, folder: Path = COMMITTED) -> list[tuple[str, dict[str, Any]]]:
    """Pairs of file name and results, of experiments whose names begin with one of the given names."""
    paths = sorted(folder.glob("*.json"))
    chosen = [p for p in paths if not names or any(p.stem.startswith(name) for name in names)]
    return [(path.name, json.loads(path.read_text(encoding="utf-8"))) for path in chosen]


def flag(row: dict[str, Any]) -> str:
    """Verdict on a row, with a note if the paper's value is nearer to the reference than the value here."""
    values = [row[key] for key in ("here", "paper", "theory")]
    worse = ""
    if all(isinstance(value, float) for value in values):
        here, paper, theory = values
        worse = "worse than the paper" if abs(here - theory) > abs(paper - theory) else ""
    return " ".join(filter(None, [VERDICT[row["passes"]], worse]))


def gallery_text(folder: Path = COMMITTED) -> str:
    """The gallery as Markdown, from the results in a folder."""
    parts = [INTRODUCTION]
    for found in results(folder=folder):
        parts.append(f"## {_heading(found)}\n")
        parts.append(f"`{found['command']}` ({found['seconds'] / 60:.1f} min; {found['machine']})\n")
        parts.append("; ".join(_line(row) for row in _main_rows(found["rows"])) + ".\n")
        parts += [f"![{found['title']}](results/{picture})\n" for picture in found["pictures"][:1]]
    return "\n".join(parts)


def _main_rows(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of an experiment in the gallery: the first four with a limit, or else the first two.

    If a row "the same: ..." continues a row that is left out, "the same" is replaced by the name of that row.
    """
    limited = [k for k, row in enumerate(rows) if row["passes"] is not None][:4]
    chosen = limited or [k for k, _ in enumerate(rows[:2])]
    found = []
    for k in chosen:
        above = [i for i in range(k) if not rows[i]["check"].startswith(SAME)]
        row = rows[k]
        if row["check"].startswith(SAME) and above and above[-1] not in chosen:
            row = row | {"check": rows[above[-1]]["check"] + row["check"].removeprefix(SAME)}
        found.append(row)
    return found


def _heading(found: dict[str, Any]) -> str:
    return found["title"] + ("" if found["dx"] is None else f", dx = {found['dx']:g} m")


def _line(row: dict[str, Any]) -> str:
    names = {"theory": "reference", "paper": "paper"}
    beside = ", ".join(f"{names[key]} {shown(row[key])}" for key in names if row[key] is not None)
    missed = " **(missed)**" if row["passes"] is False else ""
    return f"{row['check']} {shown(row['here'], row['unit'])}" + (f" ({beside})" if beside else "") + missed


if __name__ == "__main__":
    app()
