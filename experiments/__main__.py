"""Every check in one table, from the committed results: paper, theory, here.

    python -m experiments [NAME ...]      prints the rows of those whose names begin so; all by default
    python -m experiments --gallery       writes experiments/README.md: a picture and a line for each

A row is flagged MISSED where it is outside its bar, and `worse than the paper` where the paper's own value
is nearer to theory.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.common import RESULTS, VERDICT, shown

GALLERY = Path(__file__).parent / "README.md"
INTRODUCTION = """# Experiments

What was measured, made from the committed results by `python -m experiments --gallery`;
`python -m experiments` prints every row with theory, paper and bar. Each section's command makes its own
again: runs are kept in `runs/` and go on where they were interrupted. Times are of processes that share two
cores with others.
"""


def main(
    names: Annotated[list[str] | None, typer.Argument(help="all by default")] = None,
    gallery: Annotated[bool, typer.Option("--gallery", help="Write experiments/README.md.")] = False,
) -> None:
    """Prints the rows of the experiments asked for, and how many miss their bars; or writes the gallery."""
    if gallery:
        GALLERY.write_text(gallery_text(), encoding="utf-8")
        return
    missed = total = 0
    for found in results(names):
        print(f"\n{_heading(found)}\n  {found['command']}  ({found['seconds']:.0f} s; {found['machine']})")
        print(f"  {'':54s} {'paper':>12s} {'theory':>12s} {'here':>18s}  bar")
        for row in found["rows"]:
            total += 1
            missed += row["passes"] is False
            print(
                f"  {row['check']:54s} {shown(row['paper']):>12s} {shown(row['theory']):>12s} "
                f"{shown(row['here'], row['unit']):>18s}  {row['bar']:26s} {flag(row)}"
            )
    print(f"\n{total} rows, {missed} outside their bars")


def results(names: list[str] | None = None) -> list[dict[str, Any]]:
    """The committed results of the experiments whose names begin with one of those given."""
    paths = sorted(RESULTS.glob("*.json"))
    chosen = [p for p in paths if not names or any(p.stem.startswith(name) for name in names)]
    return [json.loads(path.read_text(encoding="utf-8")) for path in chosen]


def flag(row: dict[str, Any]) -> str:
    """Verdict on a row, and whether the paper's value is nearer to theory than the one here."""
    values = [row[key] for key in ("here", "paper", "theory")]
    worse = ""
    if all(isinstance(value, float) for value in values):
        here, paper, theory = values
        worse = "worse than the paper" if abs(here - theory) > abs(paper - theory) else ""
    return " ".join(filter(None, [VERDICT[row["passes"]], worse]))


def gallery_text() -> str:
    """The gallery as Markdown."""
    parts = [INTRODUCTION]
    for found in results():
        rows = [row for row in found["rows"] if row["passes"] is not None] or found["rows"][:2]
        parts.append(f"## {_heading(found)}\n")
        parts.append(f"`{found['command']}` ({found['seconds'] / 60:.1f} min; {found['machine']})\n")
        parts.append("; ".join(_line(row) for row in rows[:4]) + ".\n")
        parts += [f"![{found['title']}](results/{picture})\n" for picture in found["pictures"][:1]]
    return "\n".join(parts)


def _heading(found: dict[str, Any]) -> str:
    return found["title"] + ("" if found["dx"] is None else f", dx = {found['dx']:g} m")


def _line(row: dict[str, Any]) -> str:
    beside = ", ".join(f"{key} {shown(row[key])}" for key in ("theory", "paper") if row[key] is not None)
    missed = " **(missed)**" if row["passes"] is False else ""
    return f"{row['check']} {shown(row['here'], row['unit'])}" + (f" ({beside})" if beside else "") + missed


if __name__ == "__main__":
    typer.run(main)
