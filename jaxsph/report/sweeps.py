"""Contents of a page about a sweep, a power matrix or a search: results over the parameters, and members."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np

from jaxsph.case.case import Case
from jaxsph.case.linear import linear_owc, linear_sea, sea_is_linear
from jaxsph.case.linear_bodies import has_free_bodies, linear_motions
from jaxsph.errors import CaseError
from jaxsph.model.meaning import Group
from jaxsph.output.sweep_file import LIMIT, LIMIT_ERROR, OF_ERRORS, StoredSweep, SweepFile, over_members
from jaxsph.report.content import case_of, coarse_warning, panels
from jaxsph.report.doubts import doubts_of_members
from jaxsph.report.labels import in_order, in_words, is_flat, label_of, with_error_in_words
from jaxsph.report.pack import Pack
from jaxsph.study.matrix import SEA_AXES, of_the_sea

MOST_LINEAR = 100
"""Number of members above which linear theory is not evaluated."""
FIRST = ("P_owc", "xi", "P_pto", "capture_width")
"""Results to show first, in order of preference. "P_owc" is used only for a power matrix. A result that a
problem itself defines comes directly after "xi"."""


def sweep_content(sweep: SweepFile, pack: Pack) -> dict[str, Any]:
    """Contents of a page about a sweep, ended or not. **Raises** FileError if the sweep cannot be read."""
    stored = sweep.read()
    keys = tomllib.loads(stored.case_toml)
    flat = is_flat(keys)
    results = over_members(stored.members, stored.shape)
    search = "method" in stored.about
    matrix = [*stored.axes] == SEA_AXES
    members = [_member(stored, index, flat, pack) for index in sorted(stored.members)]
    if matrix:
        for one in members:
            one["results"] = {name: float(value) for name, value in of_the_sea(one["results"]).items()}
    waiting = int(np.prod(stored.shape)) - len(members)
    failed = [one for one in members if one["failure"]]
    warnings = coarse_warning(keys)
    warnings += [f"{one['place']}: failed: {one['failure'].splitlines()[0]}" for one in failed]
    if waiting:
        has = "has" if waiting == 1 else "have"
        warnings.insert(0, f"{waiting} of {waiting + len(members)} members {has} not ended yet.")
    case = case_of(keys)
    warnings += doubts_of_members(
        [one["results"] for one in members if not one["failure"]], bool(keys.get("waves"))
    )
    warnings += [] if case is None else case.notices()
    ordered = in_order(results, stored.meanings.labels)
    shown = [name for name in ordered if not name.startswith(("slope ", "error ", *OF_ERRORS))]
    own = stored.meanings.first(shown)
    first = next(
        (n for n in (*FIRST[not matrix : 2], own, *FIRST[2:]) if n in shown), shown[0] if shown else ""
    )
    return {
        "name": str(keys.get("name", sweep.path.stem)),
        "file": sweep.path.name,
        "kind": "matrix" if matrix else "search" if search else "sweep",
        "axes": [{"name": name, "values": np.asarray(v, float).tolist()} for name, v in stored.axes.items()],
        "grid": tuple(len(v) for v in stored.axes.values()) == stored.shape,
        "members": members,
        "counted": _counted(len(members) - len(failed), len(failed)),
        "first": first,
        "choices": [{"name": n, **label_of(n, flat, stored.meanings.labels)._asdict()} for n in shown],
        "warnings": warnings,
        "answer": stored.answer or (None if search or matrix else _largest(members, first, flat, stored)),
        "case": stored.case_toml,
    }


def _largest(
    members: list[dict[str, Any]], first: str, flat: bool, stored: StoredSweep
) -> dict[str, str] | None:
    """Largest value of the result that is shown first, and the member that has it; None if no member has it,
    or if it only concerns the numerics."""
    there = [one for one in members if first in one["results"]]
    label = label_of(first, flat, stored.meanings.labels)
    if not there or label.group == Group.NUMERICS:
        return None
    best = max(there, key=lambda one: one["results"][first])
    theory = best["linear"].get(first)
    return {
        "label": f"largest {label.text.strip()}",
        "value": in_words(best["results"][first]),
        "unit": f"{label.unit} at {best['place']}".strip(),
        "expected": "" if theory is None else in_words(theory),
        "note": "",
    }


def _counted(ended: int, failed: int) -> str:
    """Numbers of the members that have ended with results, and of those that have failed, in words."""
    words = "1 member that has ended" if ended == 1 else f"{ended} members that have ended"
    return f"{words}, {failed} that {'has' if failed == 1 else 'have'} failed" if failed else words


def _member(stored: StoredSweep, index: int, flat: bool, pack: Pack) -> dict[str, Any]:
    """Member of a sweep: its parameter values, results and series."""
    one = stored.members[index]
    at = stored.place(index)
    every = {name: float(value) for name, value in one["results"].items()}
    results = {name: value for name, value in every.items() if not name.startswith(OF_ERRORS)}
    limits = {n: (every[LIMIT + n], every[LIMIT_ERROR + n]) for n in results if LIMIT + n in every}
    rows = [
        {
            "label": label_of(n, flat, stored.meanings.labels).text.strip(),
            "value": in_words(results[n]),
            "limit": with_error_in_words(*limits[n]) if n in limits else "",
            "unit": label_of(n, flat, stored.meanings.labels).unit,
        }
        for n in in_order(results, stored.meanings.labels)
    ]
    return {
        "index": index,
        "at": list(at.values()),
        "place": ", ".join(f"{name} = {value:.4g}" for name, value in at.items()),
        "results": results,
        "limits": limits,
        "linear": _linear(stored, at),
        "rows": rows,
        "failure": one["failure"],
        "panels": panels(one["series"], stored.meanings.variables, {}, pack),
    }


def _linear(stored: StoredSweep, at: dict[str, float]) -> dict[str, float]:
    """Results of a member by linear theory: efficiency, absorbed power, and amplitudes of bodies; empty if
    theory does not cover the case."""
    if int(np.prod(stored.shape)) > MOST_LINEAR:
        return {}
    try:
        whole = {name: int(v) if float(v).is_integer() else v for name, v in at.items()}
        case = Case.from_dict(tomllib.loads(stored.case_toml)).replace(whole)
        if has_free_bodies(case):
            return linear_motions(case).results
        found = linear_sea(case) if sea_is_linear(case) else linear_owc(case)
    except CaseError:
        return {}
    return {"xi": float(found.xi), "P_owc": float(found.P_owc)}
