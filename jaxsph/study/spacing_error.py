"""`with_error`: results of a case with the errors of the particle spacing, from runs at two spacings, and of
the scheme, from a run with the other one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jaxsph.analysis.spacing import Limit, limit
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import SCHEMES
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import LIMIT, LIMIT_ERROR, SCHEME_ERROR, SweepFile
from jaxsph.problem.sources import source_of
from jaxsph.study.sweep import Sweep, sweep

FINER = 2
"""Ratio of the case's spacing to the finer one (-); lengths that are whole spacings of the case stay so."""
NUDGE = 1e-5
"""Relative change of the water's density between runs at one spacing (-). The change itself alters results by
about as much, but the particles soon move differently, as they do after any small change."""
OF_THE_RUN = ("t_end", "steps", "wall_seconds", "particle_steps_per_second")
"""Results that describe the run, and have no limit."""


@dataclass(frozen=True)
class WithError:
    """Results at a case's spacing and at half of it, and their limits for spacing zero."""

    dx: tuple[float, float]
    """Larger and smaller spacing, m."""
    results: dict[str, Limit]
    """Limit of each result that all runs have, by name."""
    runs: Sweep
    """All runs."""
    other_scheme: Mapping[str, float] = field(default_factory=dict)
    """Results at the smaller spacing with the other scheme, by name, if it was run."""

    def __getitem__(self, name: str) -> Limit:
        """Limit of a result. **Raises** CaseError for a result that not all runs have."""
        if name not in self.results:
            raise CaseError(f"no result {name!r} in all runs; use one of {', '.join(sorted(self.results))}")
        return self.results[name]

    def error_of_scheme(self, name: str) -> float:
        """Standard error of a result due to the scheme, of which the two schemes are samples; NaN if the
        result with the other scheme is not known."""
        return abs(self.other_scheme.get(name, np.nan) - self[name].fine) / math.sqrt(2.0)

    def error(self, name: str) -> float:
        """Error of a result due to its spacing and, if it is known, to the scheme."""
        return float(np.hypot(self[name].error, np.nan_to_num(self.error_of_scheme(name))))


def with_error(
    given: Any,
    out: str | Path,
    *,
    repeats: int = 3,
    other_scheme: bool = False,
    workers: int | None = None,
    progress: bool = True,
) -> WithError:
    """Runs a case `repeats` times at its spacing and once at half of it, and extrapolates all results.

    The limits and their errors are those of `analysis.spacing.limit`. Lengths that the lattice rounds are
    rounded at the case's spacing, and keep this value in all runs. The finer run takes about eight times
    as long as the case in two dimensions, and sixteen times in three. The runs at the case's spacing differ
    in the water's density by a hundred-thousandth, so that their scatter becomes visible.

    **Arguments**: `given`: a case; `out`: the file of all runs, a sweep, from which a repeated call
    continues; `repeats`: two or more; `other_scheme`: whether to run the case, at half of its spacing, also
    with the other scheme, in a file beside `out`; `workers`: number of runs at a time, by default one per
    core. **Raises** CaseError, also if a run fails; FileError, as `sweep`.
    """
    source = source_of(given)
    if not isinstance(source, Case):
        raise CaseError(f"{source.name}: only the spacing of a case can be changed, and this is a program")
    if repeats < 2:
        raise CaseError(f"repeats = {repeats}: must be 2 or more, as one run does not show the scatter")
    # with half of the spacing, a length may be rounded to another value
    source = source.replace(dict(Geometry.of(source).rounded))
    spacings = [source.dx / FINER, *[source.dx] * repeats]  # the longest run begins first
    densities = [source.fluid.rho0 * (1.0 + NUDGE * k) for k in (0, *range(repeats))]
    over = {"dx": spacings, "fluid.rho0": densities}
    other = with_other_scheme(source.replace({"dx": source.dx / FINER})) if other_scheme else None
    done = sweep(source, over, out, grid=False, workers=workers, progress=progress)
    for (k,), text in done.failures.items():
        raise CaseError(f"the run with dx = {spacings[k]:g} m failed: {text}")
    results = {name: values for name, values in done.results.items() if name not in OF_THE_RUN}
    known = {name: values for name, values in results.items() if np.all(np.isfinite(values))}
    found = {name: limit(np.asarray(spacings), values) for name, values in known.items()}
    others = {} if other is None else _one_run(other, Path(out), progress)
    return WithError((source.dx, source.dx / FINER), found, done, others)


def with_other_scheme(case: Case) -> Case:
    """The case with the other of the two schemes, whose keys have their defaults.

    **Raises** CaseError if this scheme cannot run the case.
    """
    (kind,) = SCHEMES.keys() - {case.scheme.kind}
    try:
        return case.replace({"scheme": {"kind": kind}})
    except CaseError as error:
        raise CaseError(f"the {kind.replace('_', ' ')} scheme cannot run this case: {error}") from None


def _one_run(case: Case, out: Path, progress: bool) -> dict[str, float]:
    """Finite results of a case, in a file beside `out`. **Raises** CaseError if the run fails."""
    path, over = out.with_name(f"{out.stem}_other_scheme.h5"), {"fluid.rho0": [case.fluid.rho0]}
    done = sweep(case, over, path, grid=False, progress=progress)
    for text in done.failures.values():
        raise CaseError(f"the run with the {case.scheme.kind.replace('_', ' ')} scheme failed: {text}")
    found = {name: float(values[0]) for name, values in done.results.items() if name not in OF_THE_RUN}
    return {name: value for name, value in found.items() if np.isfinite(value)}


def members_at(
    axes: Mapping[str, Sequence[float]], values: Mapping[str, Sequence[float]]
) -> list[tuple[int, ...]]:
    """Indices of the members of a grid over the parameters in `axes` that have some of the given `values` of
    each named parameter.

    **Raises** CaseError for a parameter or a value that the sweep does not have.
    """
    chosen = {name: list(range(len(there))) for name, there in axes.items()}
    for name, wanted in values.items():
        if name not in axes:
            raise CaseError(f"{name}: not a parameter of the sweep; use one of {', '.join(axes)}")
        there, chosen[name] = np.asarray(axes[name], float), []
        for value in wanted:
            found = np.flatnonzero(np.isclose(there, value, rtol=1e-6, atol=0.0))
            if not found.size:
                known = ", ".join(f"{one:g}" for one in there)
                raise CaseError(f"{name} = {value:g}: no member has this value; use one of {known}")
            chosen[name] += [int(k) for k in found if k not in chosen[name]]
    return list(itertools.product(*chosen.values()))


def errors_of_members(
    done: Sweep,
    places: Sequence[tuple[int, ...]],
    out: str | Path,
    *,
    repeats: int = 3,
    other_scheme: bool = False,
    workers: int | None = None,
    progress: bool = True,
) -> dict[tuple[int, ...], WithError]:
    """Limits of the results of some members of a sweep for spacing zero, by the members' indices.

    The limits are stored in the sweep's file as results of the members: "limit xi" and "limit error xi", for
    example, and errors due to the scheme as "scheme error xi".

    **Arguments**: `done`: a sweep of a case; `places`: indices of members, see `members_at`; `out`:
    the sweep's file, beside which the runs of member k have the file `<out>_error_<k>.h5`; the others as in
    `with_error`. **Raises** CaseError, FileError as `with_error`.
    """
    if not isinstance(done.case, Case):
        raise CaseError("this is a sweep of a program; only the spacing of a case can be changed")
    file, found = SweepFile(Path(out).resolve()), {}
    for place in places:
        case, runs = done.case.replace(done.at(place)), runs_of_member(done, place, file.path)
        one = with_error(
            case, runs, repeats=repeats, other_scheme=other_scheme, workers=workers, progress=progress
        )
        found[place] = one
        limits = {LIMIT + name: limit.value for name, limit in one.results.items()}
        limits |= {LIMIT_ERROR + name: limit.error for name, limit in one.results.items()}
        of_scheme = {SCHEME_ERROR + name: one.error_of_scheme(name) for name in one.results}
        limits |= {name: error for name, error in of_scheme.items() if np.isfinite(error)}
        file.add_results(_index(done, place), limits)
    return found


def runs_of_member(done: Sweep, place: tuple[int, ...], out: Path) -> Path:
    """File of the runs that state the error of a member, beside the sweep's file `out`."""
    return out.with_name(f"{out.stem}_error_{_index(done, place)}.h5")


def _index(done: Sweep, place: tuple[int, ...]) -> int:
    """Flat index of a member."""
    return int(np.ravel_multi_index(place, next(iter(done.results.values())).shape))
