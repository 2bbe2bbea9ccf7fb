"""Limits of results for spacing zero, for a run and for members of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.case.report import in_time
from jaxsph.cli.arguments import each_once, values_of
from jaxsph.cli.terminal import print_notes, print_table, write_page
from jaxsph.core.native.forms import advice
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import SweepFile
from jaxsph.report.labels import in_order, in_words, label_of, short, with_error_in_words

ErrorAt = Annotated[
    list[str] | None,
    typer.Option(
        "--error-at",
        metavar="KEY=VALUES",
        help="Run the members with these values also with half of their spacing, and give results without "
        "the error of the spacing. Repeatable.",
    ),
]


OtherScheme = Annotated[
    bool,
    typer.Option(
        "--other-scheme",
        help="With --error or --error-at: also run the case, or these members, with the other scheme at half "
        "of the spacing, and include the error due to the scheme.",
    ),
]


def run_with_error(
    loaded: Any, out: Path | None, refused: Mapping[str, bool], other_scheme: bool, report: bool, quiet: bool
) -> None:
    """Runs a case at two spacings, if asked also with the other scheme, prints the limits of its results, and
    writes a page.

    **Raises** CaseError if an option that is `refused` was given.
    """
    import jaxsph as js

    if given := [name for name, there in refused.items() if there]:
        raise CaseError(
            f"--error: omit {' and '.join(given)}; the runs are members of a sweep, each on one core, and "
            "the same command continues them"
        )
    out = out if out is not None else Path("runs") / f"{loaded.name}_error.h5"
    out.parent.mkdir(parents=True, exist_ok=True)
    if not quiet and isinstance(loaded, js.Case) and not out.exists():
        print_notes([*loaded.notices(), *filter(None, [advice()])])
        _announce(loaded, "the run", other_scheme)
    found = js.with_error(loaded, out, other_scheme=other_scheme, progress=not quiet)
    flat, own = loaded.dim == 2, found.runs.meanings.labels
    if first := found.runs.meanings.first(found.results):
        label = label_of(first, flat, own)
        answer = {"label": f"{label.text.strip()} without the error of the spacing", "unit": label.unit}
        answer |= {"value": with_error_in_words(found[first].value, found.error(first)), "expected": ""}
        note = "from runs at two spacings" + (" and with two schemes" if other_scheme else "")
        SweepFile(out).conclude(answer | {"note": note})
    if not quiet:
        print_table(limit_rows(found, flat))
    typer.echo(f"recorded in {out}")
    write_page(out, report, quiet)


def _announce(case: Any, runs: str, other_scheme: bool) -> None:
    """Prints how long the run of a case with half of the spacing takes, and the one with the other scheme;
    `runs`: the beginning of the text."""
    import jaxsph as js
    from jaxsph.study.spacing_error import FINER, with_other_scheme

    finer = case.replace({"dx": case.dx / FINER})
    others = {"half of the spacing": finer}
    others |= {"the other scheme": with_other_scheme(finer)} if other_scheme else {}
    for what, other in others.items():
        takes = in_time(js.duration(other, devices=1).total)
        typer.echo(f"{runs} with {what} takes about {takes}", err=True)


def limit_rows(found: Any, flat: bool) -> list[tuple[str, str]]:
    """Labels of results without energies of the whole run, their limits, and values at both spacings."""
    coarse, fine = (f"{dx:g} m" for dx in found.dx)
    own = found.runs.meanings.labels
    heads = f"{'limit':>18}  {f'dx = {fine}':>12} {coarse:>12}"
    rows = [("", f"{heads} {'other scheme':>14}" if found.other_scheme else heads)]
    for name in in_order(found.results, own):
        if name.startswith("whole_"):
            continue
        label, one = label_of(name, flat, own), found[name]
        values = f"{in_words(one.fine):>12} {in_words(one.coarse):>12}"
        if found.other_scheme:
            values += f" {in_words(found.other_scheme[name]) if name in found.other_scheme else '':>14}"
        answer = with_error_in_words(one.value, found.error(name))
        rows.append((short(label), f"{answer:>18}  {values} {label.unit}".rstrip()))
    return rows


def print_errors(
    done: Any,
    places: Sequence[tuple[int, ...]],
    out: Path,
    workers: int | None,
    quiet: bool,
    other_scheme: bool = False,
) -> None:
    """Runs members of a sweep at two spacings, if asked also with the other scheme, and prints the limit of
    the result that the sweep shows."""
    from jaxsph.study.spacing_error import errors_of_members, runs_of_member

    ended = [place for place in places if place not in done.failures]
    if not ended:
        return
    new = [place for place in ended if not runs_of_member(done, place, out).exists()]
    if new and not quiet:
        runs = f"each of {len(new)} runs" if new[1:] else "the run"
        _announce(done.case.replace(done.at(new[0])), runs, other_scheme)
    found = errors_of_members(
        done, ended, out, other_scheme=other_scheme, workers=workers, progress=not quiet
    )
    if not quiet:
        rows = []
        for place, one in found.items():
            name = one.runs.meanings.first(one.results)
            if name:
                text = label_of(name, True, one.runs.meanings.labels).text.strip()
                limit = with_error_in_words(one[name].value, one.error(name))
                rows.append((done.words(place), f"{text} without the error of the spacing {limit}"))
        print_table(rows)


def chosen_members(
    loaded: Any,
    over: Mapping[str, Sequence[float]],
    given: Sequence[str],
    scheduler: str | None,
    other_scheme: bool = False,
) -> list[tuple[int, ...]]:
    """Indices of the members that --error-at names; none without this option.

    **Raises** CaseError for values that the sweep does not have, for a sweep on a cluster, and for
    `other_scheme` without members, or for a case that this scheme cannot run.
    """
    import jaxsph as js
    from jaxsph.study.spacing_error import with_other_scheme

    if not given and other_scheme:
        raise CaseError("--other-scheme: needs --error-at, which names the members that it runs")
    if not given:
        return []
    if isinstance(loaded, js.Program):
        raise CaseError("--error-at: only the spacing of a case can be changed, and this is a program")
    if scheduler is not None:
        raise CaseError(
            "--error-at: omit --scheduler; the runs with half of the spacing use the cores of this machine"
        )
    values = each_once((values_of(text, "--error-at") for text in given), "--error-at")
    if other_scheme:
        with_other_scheme(loaded)
    try:
        return js.members_at(over, values)
    except CaseError as error:
        raise CaseError(f"--error-at {error}") from None
