"""`maximise`: gradient search for the parameter values of a case that maximise a result."""

from __future__ import annotations

import json
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import optax

from jaxsph.errors import CaseError, FileError
from jaxsph.output.hdf5 import tell_write_errors
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.problem.source import Source, identity
from jaxsph.problem.sources import source_of
from jaxsph.run.stored import stored_identity
from jaxsph.study.base import AbstractMethod, check_result, parameter_value
from jaxsph.study.derivative import derivative
from jaxsph.study.ensemble import Ensemble
from jaxsph.study.ownership import only_study, refuse_other


@dataclass(frozen=True)
class Maximum:
    """Best evaluation of a search, and all evaluations of the search."""

    case: Any
    """Case or program with the best values."""
    of: str
    value: float
    reason: str
    """Reason why the search ended."""
    history: list[dict[str, float]]
    """Evaluations: parameter values, the result, and "slope KEY" and "error KEY" for each parameter (in
    `search`, "error RESULT")."""

    @classmethod
    def of_best(
        cls, source: Source, names: Sequence[str], of: str, reason: str, history: list[dict[str, float]]
    ) -> Maximum:
        """The best of the evaluations of a search over the parameters `names`."""
        best = max(history, key=lambda found: found[of])
        return cls(source.replace({name: best[name] for name in names}), of, best[of], reason, history)


def best_parameters(path: str | Path) -> dict[str, float]:
    """Parameters of the best evaluation of a search, by name, from the file of the search.

    **Raises** FileError if the file is none of a search, or contains no evaluation.
    """
    return best_evaluation(path)[1]


def best_evaluation(path: str | Path) -> tuple[int, dict[str, float]]:
    """Number of the best evaluation of a search, from 0, and its parameters; otherwise as
    `best_parameters`."""
    stored = SweepFile(path).read()
    of = stored.about.get("of")
    found = {index: one["results"][of] for index, one in stored.members.items() if of in one["results"]}
    if "method" not in stored.about or not found:
        raise FileError(f"{path} is not the file of a search with evaluations; give one of jaxsph optimise")
    best = max(found, key=lambda index: found[index])
    return best, stored.place(best)


class Record(NamedTuple):
    """File of the evaluations of a search, with the folder of the files of its runs."""

    path: Path
    source: Source
    names: list[str]
    """Parameters that the search varies."""
    about: dict[str, Any]
    """Result and method of the search."""
    runs: str
    """End of the name of the folder."""

    @property
    def folder(self) -> Path:
        """Folder of the files of the runs."""
        return self.path.with_name(f"{self.path.name}.{self.runs}")

    def begin(self) -> list[dict[str, float]]:
        """Marks the folder as belonging to this search; returns the evaluations that the file contains.

        **Raises** FileError if the file or the folder belongs to another search.
        """
        now = identity(self.source.to_toml()) | {"parameters": self.names} | self.about
        known, file = [], SweepFile(self.path)
        if self.path.exists():
            stored = file.read()
            before = stored_identity(self.path, stored.case_toml, stored.version)
            before = before | {"parameters": [*stored.axes]} | stored.about
            refuse_other(self.path, "another search", before, now)
            known = [
                {name: float(values[i]) for name, values in stored.axes.items()} | member["results"]
                for i, member in sorted(stored.members.items())
            ]
        mark = self.folder / "search.json"
        if self.folder.exists() and any(self.folder.iterdir()):
            try:
                marked = json.loads(mark.read_text(encoding="utf-8"))
            except (OSError, ValueError):
                marked = {}
            refuse_other(self.folder, "evaluations of another search", marked, now)
        with tell_write_errors(self.folder):
            self.folder.mkdir(exist_ok=True)
            mark.write_text(json.dumps(now), encoding="utf-8")
        return known

    def write(self, history: Sequence[Mapping[str, float]]) -> None:
        """Writes all evaluations. **Raises** FileError if the file cannot be written."""
        axes = {name: np.array([found[name] for found in history]) for name in self.names}
        members = {
            i: {"results": {k: v for k, v in found.items() if k not in axes}, "series": {}, "failure": ""}
            for i, found in enumerate(history)
        }
        shape = (len(history),)
        SweepFile(self.path).write(self.source.to_toml(), axes, shape, members, Meanings(), self.about)


def maximise(
    given: Any,
    over: Mapping[str, tuple[float, float]],
    out: str | Path,
    of: str = "xi",
    method: AbstractMethod | None = None,
    optimiser: optax.GradientTransformation | None = None,
    evaluations: int = 10,
    progress: bool = True,
) -> Maximum:
    """Maximises a result of a case, or of a function that returns a `Problem`, by a gradient search.

    The search begins at the parameter values of the case or function.

    **Arguments**: `over`: bounds (lowest, highest) of every parameter, which may be a length of the device.
    The bounds must be positive, because the search uses logarithms. `out`: the file of the evaluations; a
    repeated call continues from it, and from an ensemble's unfinished members in `<out>.evaluations`.
    `method`: as in `derivative`; `optimiser`: any optimiser of optax (by default Adam, which changes a
    parameter by a factor of at most about 1.8 in the first step and 1.1 in the tenth).
    **Returns** the best evaluation. The search ends after `evaluations` evaluations, or when every slope is
    zero within its error or points out of the bounds.
    **Raises** the errors of `derivative`; FileError if `out` or `<out>.evaluations` belongs to a search with
    another case, result, scatter table or method, or if another process runs a study with this output.
    """
    if evaluations < 1:
        raise CaseError(f"evaluations = {evaluations}: must be 1 or more")
    source = source_of(given)
    check_bounds(source, over)
    check_result(source.problem(), of)
    method = Ensemble() if method is None else method
    with only_study(Path(out)):
        record = Record(Path(out), source, [*over], {"of": of} | method.identity(), "evaluations")
        return _climb(source, over, record, of, method, optimiser, evaluations, progress)


def _climb(
    source: Source,
    over: Mapping[str, tuple[float, float]],
    record: Record,
    of: str,
    method: AbstractMethod,
    optimiser: optax.GradientTransformation | None,
    evaluations: int,
    progress: bool,
) -> Maximum:
    names, known = record.names, record.begin()
    if optimiser is None:
        optimiser = optax.adam(optax.exponential_decay(0.6, 1, 0.82), b1=0.5)
    bounds = np.log([over[name] for name in names])
    z = np.log([parameter_value(source, name) for name in names])
    memory = optimiser.init(jnp.asarray(z))
    history: list[dict[str, float]] = []
    reason = f"the limit of {evaluations} evaluations was reached"
    for k in range(evaluations):
        here = {name: float(np.exp(a)) for name, a in zip(names, z, strict=True)}
        if k < len(known) and all(np.isclose(known[k][name], here[name], rtol=1e-6) for name in names):
            found = known[k]
        else:
            known = known[:k]
            found = _evaluate(source.replace(here), here, of, method, record.folder / f"{k:02d}", progress)
        history.append(found)
        if k >= len(known):
            record.write(history)
        slopes = np.array([found[f"slope {name}"] * here[name] for name in names])
        errors = np.array([found[f"error {name}"] * here[name] for name in names])
        outward = np.where(slopes > 0, z >= bounds[:, 1] - 1e-9, z <= bounds[:, 0] + 1e-9)
        zero = np.abs(slopes) <= errors
        if np.all(outward | zero):
            reason = _reason(outward, zero)
            break
        # a slope that points out of the bounds does not move its parameter
        step, memory = optimiser.update(jnp.asarray(np.where(outward, 0.0, -slopes)), memory, jnp.asarray(z))
        z = np.clip(z + np.asarray(step), bounds[:, 0], bounds[:, 1])
    shutil.rmtree(record.folder, ignore_errors=True)
    return Maximum.of_best(source, names, of, reason, history)


def _reason(outward: np.ndarray, zero: np.ndarray) -> str:
    """Reason why a search ended whose slopes all point out of the bounds or are zero within their errors."""
    if outward.all():
        return "at the bounds"
    if zero.all():
        return "no slope differs from zero by more than its error"
    return "every parameter is at a bound or has a slope of zero within its error"


def check_bounds(
    source: Source, over: Mapping[str, tuple[float, float]], signed: Collection[str] = ()
) -> None:
    """**Raises** CaseError for no bounds, or bounds that are not ascending or exclude the source's value.

    The bounds must be positive, except those of parameters in `signed`.
    """
    if not over:
        raise CaseError("a search needs at least one parameter, with its bounds")
    for name, (low, high) in over.items():
        value, least = parameter_value(source, name), -np.inf if name in signed else 0.0
        if not least < low < high < np.inf or not low <= value <= high:
            kind = "finite" if name in signed else "positive"
            raise CaseError(
                f"{name} from {low:g} to {high:g}: bounds must be {kind}, ascending and contain the case's "
                f"value, {value:g}"
            )


def _evaluate(
    source: Source, here: dict[str, float], of: str, method: AbstractMethod, stem: Path, progress: bool
) -> dict[str, float]:
    found = dict(here)
    for name in here:
        kept = method.kept(stem.with_name(f"{stem.name}_{name}.h5"))
        one = derivative(source, name, of, kept, progress)
        found |= {of: one.value, f"slope {name}": one.slope, f"error {name}": one.error or 0.0}
    return found
