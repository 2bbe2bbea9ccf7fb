"""The slope of a result over a number of the case, with what is known of its error, and where it leads."""

from __future__ import annotations

import abc
import dataclasses
import functools
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from tqdm import tqdm

from jaxsph import analysis, waves
from jaxsph.case import Case, build, make_probes, steps_per_sample
from jaxsph.design import sweep
from jaxsph.driver import replayed, search_settings, settled_periods, simulate, steps_per_chunk
from jaxsph.errors import CaseError, DerivativeError, FileError
from jaxsph.io import SweepFile
from jaxsph.probes import BodyProbe, ChamberProbe
from jaxsph.state import Model, State
from jaxsph.tangents import TangentFilter

__all__ = ["Derivative", "Ensemble", "Exact", "Filtered", "Maximum", "derivative", "maximise"]

SMOOTH = (
    "pto.K_dm",
    "pto.P_a",
    "waves.H",
    "fluid.nu",
    "fluid.rho0",
    "scheme.alpha",
    "scheme.delta",
    "sponge.strength",
    "body.pto.damping",
    "body.pto.coulomb",
    "body.pto.spring",
)
"""Numbers on which a model depends smoothly, for methods through the loop. Lengths are not among them: they
move the lattice."""


@dataclass(frozen=True)
class Derivative:
    """A result, its slope over a number of the case, and how far the slope can be trusted."""

    parameter: str
    of: str
    value: float
    slope: float
    """d(of)/d(parameter)."""
    error: float | None
    """Standard error of the slope, or a filter's bias; None where the method has none to give."""
    reach: float
    """Change of the parameter for which the slope speaks, in the parameter's unit: an ensemble's spread, or
    what moves neighbouring particles a tenth of a spacing against each other."""
    method: AbstractMethod
    series: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Readings of the chamber, `[T]`, "time" among them; empty for an ensemble."""
    slopes: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Their slopes, and "grain": how far the particles' slopes of place differ from their neighbours', m per
    unit of the parameter."""
    members: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """An ensemble's values of the parameter and of the result; empty otherwise."""


class AbstractMethod(eqx.Module):
    """A way to a derivative."""

    @abc.abstractmethod
    def derivative(self, case: Case, parameter: str, of: str, progress: bool) -> Derivative:
        """See `derivative`."""


def derivative(
    case: Case,
    parameter: str,
    of: str = "xi",
    method: AbstractMethod | None = None,
    progress: bool = True,
) -> Derivative:
    """Value of a result at the end of a case, and its slope over one number of it.

    **Arguments**: `parameter`: a dotted name of a number, for methods through the loop one of `SMOOTH`; `of`:
    "xi", "P_owc" (W/m) or "energy_pto" (J/m from the start to t1). `method`: `Exact()`, for a fraction of a
    second; `Filtered()`, one run for whole wave periods, with a bias; `Ensemble()`, the default, many runs,
    with a standard error.
    **Raises** CaseError for a parameter or a result that the case or the method does not have,
    DerivativeError where the slope would not be one of the flow, SimulationError as `run`.
    """
    _number(case, parameter)
    _result(case, of)
    return (Ensemble() if method is None else method).derivative(case, parameter, of, progress)


def _number(case: Case, parameter: str) -> float:
    value = functools.reduce(lambda part, name: getattr(part, name, None), parameter.split("."), case)
    if value is None:
        case.replace({parameter: 1.0})  # says what else is meant, where there is no such number
        raise CaseError(f"{parameter} is not given in the case: a derivative needs a value to start from")
    if not isinstance(value, float):
        raise CaseError(f"{parameter} = {value!r}: must be a number that can vary a little, such as pto.K_dm")
    return value


def _result(case: Case, of: str) -> Callable[[np.ndarray, np.ndarray], float]:
    """The result as a functional of (t, power of the PTO); linear in the power."""
    column = case.pto is not None and case.pto.K_dm is not None
    if not column and (case.body is None or case.body.pto is None):
        raise CaseError(f"of = {of!r} needs a device with a damping: pto.K_dm, or a body with body.pto")
    if of == "energy_pto":
        # a reading is the mean since the one before it: none for the first
        return lambda t, power: float(np.sum(power) * case.output.sample_dt)
    if of not in ("xi", "P_owc"):
        raise CaseError(f"of = {of!r}: must be 'xi', 'P_owc' or 'energy_pto'")
    periods = settled_periods(case, case.t1 - case.output.sample_dt) if case.waves is not None else 0
    if periods < 1:
        raise CaseError(
            f"of = {of!r} needs a whole wave period after the transient: raise t1 = {case.t1:g} s"
        )
    P = 1.0 if of == "P_owc" else incident_power(case)
    return lambda t, power: analysis.efficiency(t, power, case.waves.T, P, periods).xi


def incident_power(case: Case) -> float:
    """Mean power of the case's waves, W/m: what xi is relative to."""
    return float(waves.incident_power(case.waves.H, case.waves.T, case.tank.depth, case.fluid.rho0, case.g))


# --------------------------------------------------------------------------- through the loop


class _ThroughLoop(AbstractMethod):
    """Forward mode through every step."""

    @abc.abstractmethod
    def _prepared(self, model: Model) -> Model:
        """The model to differentiate."""

    @abc.abstractmethod
    def _check(self, parameter: str, value: float, t: float, reach: float) -> None:
        """Raises DerivativeError where at the time t the slopes are not worth going on."""

    @abc.abstractmethod
    def _error(self, parameter: str, case: Case, value: float, slope: float) -> float | None:
        """What is known of the slope's error."""

    def derivative(self, case, parameter, of, progress):
        """See `derivative`."""
        if parameter not in SMOOTH:
            raise CaseError(
                f"{parameter}: the loop does not depend smoothly on it (on {', '.join(SMOOTH)} it does); "
                "take method=js.Ensemble(), which builds every member anew"
            )
        result = _result(case, of)
        model, state = build(case)
        d_model, d_state = _seed(case, parameter, model, state)
        model = self._prepared(model)
        probes = tuple(p for p in make_probes(case, model, state) if isinstance(p, ChamberProbe | BodyProbe))
        sample_every = steps_per_sample(case, model)
        last = int(round(case.t1 / case.output.sample_dt)) * sample_every
        chunk = steps_per_chunk(case, sample_every)
        readings, slopes, grains = [], [], []
        bar = tqdm(total=last, unit="step", disable=not progress, dynamic_ncols=True)
        with bar:
            while int(state.step) < last:
                n_steps = min(chunk, last - int(state.step))
                advance = functools.partial(
                    _pushed,
                    state=state,
                    d_model=d_model,
                    d_state=d_state,
                    probes=probes,
                    n_steps=n_steps,
                    sample_every=sample_every,
                )
                model, state, (d_state, read, slope) = replayed(
                    case.name, model, advance, sample_every, bar.write
                )
                readings.append({k: np.asarray(v) for k, v in read.items()})
                slopes.append({k: np.asarray(v) for k, v in slope.items()})
                t = float(model.time(state))
                unlike = grain(np.asarray(state.particles.x), np.asarray(d_state.particles.x), case.dx)
                grains.append(np.full(len(slopes[-1]["time"]), unlike))
                reach = 0.1 * case.dx / unlike if unlike > 0 else np.inf if unlike == 0 else 0.0
                self._check(parameter, _number(case, parameter), t, reach)
                bar.update(n_steps)
        series = {k: np.concatenate([r[k] for r in readings]) for k in readings[0]}
        series["time"] = np.arange(len(series["time"])) * case.output.sample_dt
        slope = {k: np.concatenate([s[k] for s in slopes]) for k in slopes[0] if k != "time"}
        slope["grain"] = np.concatenate(grains)
        t, power = series["time"], series["power_pto"]
        value = result(t, power)
        total = result(t, slope["power_pto"])
        if of == "xi":
            ahead, behind, step = _beside(case, parameter)
            P_inc = incident_power(case)
            total -= value * (incident_power(ahead) - incident_power(behind)) / (2 * step) / P_inc
        error = self._error(parameter, case, value, total)
        return Derivative(parameter, of, value, total, error, reach, self, series, slope)


class Exact(_ThroughLoop):
    """The derivative of the program itself.

    It is the flow's for as long as neighbouring particles agree on it. Then, within a fraction of a second,
    it becomes that of the particles' own chaotic paths, and speaks of smaller and smaller changes: the run
    stops when a change of the parameter by the share `least` would, by these slopes, move neighbours a tenth
    of a spacing against each other.
    """

    least: float = eqx.field(static=True, default=0.01)

    def _prepared(self, model):
        return model

    def _check(self, parameter, value, t, reach):
        if not reach > self.least * abs(value):  # NaN too
            raise DerivativeError(
                f"the exact derivative over {parameter} is lost to the paths of single particles: at "
                f"t = {t:.2f} s it speaks of changes below {reach:.1g} only.\n"
                "What to change: an earlier t1, method=js.Filtered() or js.Ensemble()"
            )

    def _error(self, parameter, case, value, slope):
        return None


class Filtered(_ThroughLoop):
    """The derivative with the particles' own paths averaged out of it as it goes (`TangentFilter`): one run
    for some ten wave periods, and about half of the water's response lost.

    A result changes with K_dm directly, by 2/K_dm of itself, and because the water moves otherwise; near the
    best damping the two nearly cancel. The filter leaves the first alone and takes a share `lost` of the
    second, and that share is the error that a slope over K_dm is given.
    """

    filter: TangentFilter = eqx.field(default_factory=TangentFilter)
    lost: float = eqx.field(static=True, default=0.7)
    """Measured in the OWC at dx = 0.02 m: 0.33 to 0.67 (`python -m experiments.filter_study`)."""

    def _prepared(self, model):
        return dataclasses.replace(model, tangents=self.filter)

    def _check(self, parameter, value, t, reach):
        if not reach > 0.0:
            raise DerivativeError(
                f"the filtered derivative over {parameter} is no longer finite at t = {t:.2f} s.\n"
                "What to change: a filter of lower order or shorter interval"
            )

    def _error(self, parameter, case, value, slope):
        if parameter != "pto.K_dm":
            return None
        return self.lost * abs(slope - 2.0 * value / case.pto.K_dm)


@functools.partial(jax.jit, static_argnames=("n_steps", "sample_every"))
def _pushed(model, state, d_model, d_state, probes, n_steps, sample_every):
    """`simulate` and its derivative along (d_model, d_state): (state, (d_state, readings, d_readings))."""
    varying, fixed = eqx.partition((model, state), eqx.is_inexact_array)
    # the structure of a model tells its tables' sizes, which may have grown since the seed
    seeds = jax.tree.unflatten(jax.tree.structure(varying), jax.tree.leaves((d_model, d_state)))

    def advance(varying):
        new, readings = simulate(
            *eqx.combine(varying, fixed), n_steps=n_steps, probes=probes, sample_every=sample_every
        )
        floats, others = eqx.partition(new, eqx.is_inexact_array)
        return (floats, readings), others

    (floats, readings), (d_state, d_readings), others = jax.jvp(advance, (varying,), (seeds,), has_aux=True)
    return eqx.combine(floats, others), (d_state, readings, d_readings)


def _beside(case: Case, parameter: str) -> tuple[Case, Case, float]:
    """The case with a little more and a little less of the parameter, and by how much."""
    value = _number(case, parameter)
    # what builds make of a number is smooth: the square of the share is lost, or a rounding over it
    share = 1e-4 if case.precision == "float64" else 1e-2
    step = share * value if value else share
    return case.replace({parameter: value + step}), case.replace({parameter: value - step}), step


def _seed(case: Case, parameter: str, model: Model, state: State) -> tuple[Any, Any]:
    """Slopes of the floats of model and initial state over the parameter, by differences of two builds.

    The time step counts as constant: it only ever jumps, to divide the sampling interval.
    """
    ahead, behind, step = _beside(case, parameter)
    settings = search_settings(model)
    floats = eqx.filter((model, state), eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(floats)
    beside = [
        jax.tree.leaves(eqx.filter(build(near, settings), eqx.is_inexact_array)) for near in (ahead, behind)
    ]
    shapes = [[leaf.shape for leaf in one] for one in (leaves, *beside)]
    if not shapes[0] == shapes[1] == shapes[2]:
        raise CaseError(f"{parameter} changes the number of ghosts here: compare runs with js.sweep")
    slopes = [(a - b) / (2 * step) for a, b in zip(*beside, strict=True)]
    d_model, d_state = jax.tree.unflatten(structure, slopes)
    return eqx.tree_at(lambda m: m.dt, d_model, 0.0 * d_model.dt), d_state


def grain(x: np.ndarray, dx: np.ndarray, spacing: float) -> float:
    """Root mean square of what a field `[N, D]` at x differs from straight lines through it, in cells of
    four spacings (m): zero for a flow's field, the field's own size where neighbours have nothing in common.
    """
    cells = np.unique(np.floor(x / (4 * spacing)).astype(int), axis=0, return_inverse=True)[1].ravel()
    rest = 0.0
    for cell in range(cells.max() + 1):
        here = cells == cell
        A = np.hstack([np.ones((here.sum(), 1)), x[here]])
        rest += np.sum((dx[here] - A @ np.linalg.lstsq(A, dx[here], rcond=None)[0]) ** 2)
    return float(np.sqrt(rest / len(x)))


# --------------------------------------------------------------------------- over many runs


class Ensemble(AbstractMethod):
    """The slope of a parabola through the results of several runs around the case's value.

    Each member is a whole run with its own chaotic particles, so the scatter about the parabola is the error
    to reckon with, and a wide enough spread the remedy. `out` keeps the members in a file that resumes.
    """

    spread: float = eqx.field(static=True, default=0.3)
    """Members lie evenly within this share of the value, on both sides."""
    members: int = eqx.field(static=True, default=9)
    out: str | Path | None = eqx.field(static=True, default=None)
    workers: int | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        """Refuses what gives no slope, or one without an error."""
        if not 0.0 < self.spread < 1.0 or self.members < 4:
            raise CaseError(
                f"spread = {self.spread:g} must lie between 0 and 1, and members = {self.members} be four "
                "or more"
            )

    def derivative(self, case, parameter, of, progress):
        """See `derivative`."""
        value = _number(case, parameter)
        if value == 0.0:
            raise CaseError(f"{parameter} = 0: an ensemble spreads by a share of the value")
        offsets = self.spread * np.linspace(-1.0, 1.0, self.members)
        values = [float(v) for v in value * (1.0 + offsets)]
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "members.h5" if self.out is None else Path(self.out)
            done = sweep(case, {parameter: values}, out, workers=self.workers, progress=progress)
        if of == "energy_pto":
            # the sweep's own result of that name is of the last whole periods only
            energy = _result(case, of)
            series = [done.members.get((i,), {}) for i in range(len(values))]
            found = np.array(
                [energy(s["time"], s["power_pto"]) if "power_pto" in s else np.nan for s in series]
            )
            found[[place[0] for place in done.failures]] = np.nan
        else:
            found = done[of]
        known = np.isfinite(found)
        if known.sum() < 4:
            first = next(iter(done.failures.values()), "the members have no such result")
            raise DerivativeError(f"only {known.sum()} of {self.members} members gave {of}: {first}")
        fit = parabola(offsets[known], found[known])
        members = {parameter: np.asarray(values), of: found}
        scale = 1.0 / value
        return Derivative(
            parameter,
            of,
            fit.value,
            fit.slope * scale,
            fit.error * abs(scale),
            self.spread * abs(value),
            self,
            members=members,
        )


@dataclass(frozen=True)
class Parabola:
    """y = value + slope x + curvature x^2/2 through points, and the standard error of its slope."""

    value: float
    slope: float
    error: float
    curvature: float


def parabola(x: np.ndarray, y: np.ndarray) -> Parabola:
    """Least squares of points of equal, unknown error; with four points or more that is known too."""
    A = np.stack([np.ones_like(x), x, 0.5 * x**2], axis=1)
    found, *_ = np.linalg.lstsq(A, y, rcond=None)
    variance = np.sum((y - A @ found) ** 2) / (len(x) - 3)
    covariance = variance * np.linalg.inv(A.T @ A)
    return Parabola(float(found[0]), float(found[1]), float(np.sqrt(covariance[1, 1])), float(found[2]))


# --------------------------------------------------------------------------- towards a maximum


@dataclass(frozen=True)
class Maximum:
    """The best case that was seen, and the way to it."""

    case: Case
    """The case with the best values."""
    of: str
    value: float
    reason: str
    """Why the search ended."""
    history: list[dict[str, float]]
    """Every evaluation: the parameters, the result, and "slope KEY" and "error KEY" of each parameter."""


def maximise(
    case: Case,
    over: Mapping[str, tuple[float, float]],
    out: str | Path,
    of: str = "xi",
    method: AbstractMethod | None = None,
    optimiser: optax.GradientTransformation | None = None,
    evaluations: int = 10,
    progress: bool = True,
) -> Maximum:
    """Climbs along slopes to the largest result, from the case's own values.

    **Arguments**: `over`: (lowest, highest) of every parameter, lengths of the device too, above zero: the
    search is in their logarithms. `out`: the file of the evaluations; called again, the search goes on from
    them, and an ensemble's unfinished members from beside it, in `<out>.evaluations`. `method`: as in
    `derivative`; `optimiser`: any of optax (by default Adam, whose first steps are a factor of 1.8, the last
    ones of 1.1).
    **Returns** the best evaluation. The search ends where every slope is within its error, or points out of
    the bounds.
    **Raises** as `derivative`; FileError where `out` is of another search.
    """
    names = [*over]
    for name, (low, high) in over.items():
        value = _number(case, name)
        if not 0.0 < low < high or not low <= value <= high:
            raise CaseError(
                f"{name} from {low:g} to {high:g}: must be positive and in order, and hold the case's own "
                f"value, {value:g}"
            )
    file = SweepFile(out)
    known = _known_evaluations(file, case, names)
    folder = file.path.with_name(f"{file.path.name}.evaluations")
    method = Ensemble() if method is None else method
    if optimiser is None:
        optimiser = optax.adam(optax.exponential_decay(0.6, 1, 0.82), b1=0.5)
    bounds = np.log([over[name] for name in names])
    z = np.log([_number(case, name) for name in names])
    memory = optimiser.init(jnp.asarray(z))
    history: list[dict[str, float]] = []
    reason = f"{evaluations} evaluations"
    for k in range(evaluations):
        here = {name: float(np.exp(a)) for name, a in zip(names, z, strict=True)}
        if k < len(known) and all(np.isclose(known[k][name], here[name], rtol=1e-6) for name in names):
            found = known[k]
        else:
            known = known[:k]
            found = _evaluated(case.replace(here), here, of, method, folder / f"{k:02d}", progress)
        history.append(found)
        if k >= len(known):
            _write_evaluations(file, case, names, history)
        slopes = np.array([found[f"slope {name}"] * here[name] for name in names])
        errors = np.array([found[f"error {name}"] * here[name] for name in names])
        outward = np.where(slopes > 0, z >= bounds[:, 1] - 1e-9, z <= bounds[:, 0] + 1e-9)
        if np.all(outward | (np.abs(slopes) <= errors)):
            reason = "at the bounds" if outward.all() else "every slope is within its error"
            break
        # a slope out of the bounds asks for nothing
        step, memory = optimiser.update(jnp.asarray(np.where(outward, 0.0, -slopes)), memory, jnp.asarray(z))
        z = np.clip(z + np.asarray(step), bounds[:, 0], bounds[:, 1])
    best = max(history, key=lambda found: found[of])
    shutil.rmtree(folder, ignore_errors=True)
    return Maximum(case.replace({name: best[name] for name in names}), of, best[of], reason, history)


def _evaluated(
    case: Case, here: dict[str, float], of: str, method: AbstractMethod, stem: Path, progress: bool
) -> dict[str, float]:
    found = dict(here)
    for name in here:
        kept = method
        if isinstance(method, Ensemble) and method.out is None:
            kept = dataclasses.replace(method, out=stem.with_name(f"{stem.name}_{name}.h5"))
        one = derivative(case, name, of, kept, progress)
        found |= {of: one.value, f"slope {name}": one.slope, f"error {name}": one.error or 0.0}
    return found


def _known_evaluations(file: SweepFile, case: Case, names: Sequence[str]) -> list[dict[str, float]]:
    if not file.path.exists():
        return []
    stored = file.read()
    if stored.case_toml != case.to_toml() or [*stored.axes] != [*names]:
        raise FileError(
            f"{file.path}: holds a search from another case or over other parameters, and nothing was "
            "changed; give another name, or remove it"
        )
    return [
        {name: float(values[i]) for name, values in stored.axes.items()} | member["results"]
        for i, member in sorted(stored.members.items())
    ]


def _write_evaluations(file: SweepFile, case: Case, names: Sequence[str], history: list[dict]) -> None:
    axes = {name: np.array([found[name] for found in history]) for name in names}
    members = {
        i: {"results": {k: v for k, v in found.items() if k not in names}, "series": {}, "failure": ""}
        for i, found in enumerate(history)
    }
    file.write(case.to_toml(), axes, (len(history),), members, {})
