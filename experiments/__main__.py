"""Every check in one table, from the committed results: paper, theory, here.

    python -m experiments [NAME ...]

A row is flagged MISSED where it is outside its bar, and `worse` where the paper's own error is smaller.
"""

from __future__ import annotations

import json
from typing import Annotated

import typer

from experiments.common import RESULTS, VERDICT, shown


def main(
    names: Annotated[list[str] | None, typer.Argument(help="all by default")] = None,
):
    """Prints the rows of the experiments asked for, and how many miss their bars."""
    missed = total = 0
    for path in sorted(RESULTS.glob("*.json")):
        if names and not any(path.stem.startswith(name) for name in names):
            continue
        found = json.loads(path.read_text(encoding="utf-8"))
        dx = "" if found["dx"] is None else f", dx = {found['dx']:g} m"
        print(f"\n{found['title']}{dx}\n  {found['command']}  ({found['seconds']:.0f} s; {found['machine']})")
        print(f"  {'':54s} {'paper':>12s} {'theory':>12s} {'here':>18s}  bar")
        for row in found["rows"]:
            total += 1
            missed += row["passes"] is False
            flag = " ".join(filter(None, [VERDICT[row["passes"]], _worse(row)]))
            print(
                f"  {row['check']:54s} {shown(row['paper']):>12s} {shown(row['theory']):>12s} "
                f"{shown(row['here'], row['unit']):>18s}  {row['bar']:26s} {flag}"
            )
    print(f"\n{total} rows, {missed} outside their bars")


def _worse(row: dict) -> str:
    """'worse' where the paper's value is nearer to theory than the one here."""
    values = [row[k] for k in ("here", "paper", "theory")]
    if not all(isinstance(v, float) for v in values):
        return ""
    here, paper, theory = values
    return "worse than the paper" if abs(here - theory) > abs(paper - theory) else ""


if __name__ == "__main__":
    typer.run(main)
