"""Running: `simulate`, pure and of fixed length, and `run`, the host driver around it.

The driver goes in chunks: after each it looks at the status, writes series, snapshot and checkpoint in
one atomic step, and goes on. A table that overflowed or went stale is regrown and the chunk replayed;
what cannot be mended stops the run with the last good checkpoint in the file.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from jaxsph import analysis, io, loop, waves
from jaxsph.case import Case, build, make_probes, steps_per_sample
from jaxsph.errors import CaseError, FileError, SimulationError
from jaxsph.state import AbstractProbe, Failure, Model, Solution, State, Work
from jaxsph.transforms import in_any_lane

__all__ = ["march", "restore", "resume", "run", "run_together", "shape", "simulate"]

REPLAYS = 6
"""Times that one chunk is replayed with larger tables before the run gives up."""

ENERGY = {
    "kinetic",
    "potential",
    "compression",
    "power_paddle",
    "power_sponge",
    "loss_viscous",
    "loss_diffusive",
    "power_contact",
    "power_projection",
}


def simulate(
    model: Model,
    state: State,
    *,
    n_steps: int,
    probes: Sequence[AbstractProbe] = (),
    sample_every: int | None = None,
) -> tuple[State, dict[str, jax.Array]]:
    """Advances a state by n_steps. Pure: may be jitted, vmapped and differentiated.

    **Arguments**: `sample_every`: steps between samples, a multiple of `model.search.rebuild_every`
    (the default); n_steps is a multiple of it.
    **Returns** the new state and every reading at the start of each sample interval, `[n_samples, ...]`,
    with "time" (s). Failures are bits in `state.status`, never exceptions: look at them.
    **Raises** ValueError for lengths that do not divide.
    """
    every = model.search.rebuild_every
    sample_every = every if sample_every is None else sample_every
    if n_steps % sample_every or sample_every % every:
        raise ValueError(
            f"n_steps = {n_steps} must be a multiple of sample_every = {sample_every}, and that of the "
            f"model's rebuild_every = {every}"
        )

    def read(s, tables):
        readings = {"time": model.time(s)}
        for probe in probes:
            readings |= probe.measure(model, s, tables)
        return readings

    def measure(s, tables):
        due = s.step % sample_every == 0
        blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(read, s, tables))
        readings = jax.lax.cond(in_any_lane(due), read, lambda s, tables: blank, s, tables)
        zero = Work.zero(model.dt.dtype)
        work = jax.tree.map(lambda a, b: jnp.where(due, a, b), zero, s.work)
        return eqx.tree_at(lambda a: a.work, s, work), readings

    state, readings = loop.blocks(
        functools.partial(model.scheme.prepare, model),
        measure,
        model.step,
        state,
        n_steps // every,
        every,
    )
    # the state's step decides which blocks are samples: one in every sample_every // every
    stride = sample_every // every
    return state, jax.tree.map(lambda a: a[::stride], readings)


# --------------------------------------------------------------------------- host driver


@functools.partial(jax.jit, static_argnames=("n_steps", "sample_every"))
def _chunk(model, state, probes, n_steps, sample_every):
    return simulate(model, state, n_steps=n_steps, probes=probes, sample_every=sample_every)


def run(
    case: Case,
    t1: float | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    progress: bool = True,
) -> Solution:
    """Builds a case and runs it to t1 (s; by default the case's), recording into the file `out`.

    **Returns** the series as numpy arrays with the last state and scalar results.
    **Raises** CaseError, FileError (the output exists), SimulationError (with what, where, when and
    what to change; the file then holds the last good checkpoint).
    """
    model, state = build(case)
    file = None
    if out is not None:
        file = io.RunFile.create(
            out, case.to_toml(), search_settings(model), _coordinates(case), overwrite=overwrite
        )
    return _drive(case, model, state, case.t1 if t1 is None else t1, file, progress)


def resume(path: str | Path, t1: float | None = None, progress: bool = True) -> Solution:
    """Goes on with a run's file from its last checkpoint, to t1 or the case's own end.

    The series are then bit for bit those of an uninterrupted run. **Raises** FileError, as `restore`.
    """
    file = io.RunFile.open(path)
    case, model, state = restore(path)
    return _drive(case, model, state, case.t1 if t1 is None else t1, file, progress)


def restore(path: str | Path, case: Case | None = None) -> tuple[Case, Model, State]:
    """Case, model and state of a file's last checkpoint.

    **Raises** FileError where the file is not a run's, holds no checkpoint, or belongs to another case
    than the one given.
    """
    file = io.RunFile.open(path)
    stored = Case.from_dict(_parse(file.case_toml))
    if case is not None and case != stored:
        raise FileError(
            f"{path}: was made by another case than the one given ({stored.name!r} against "
            f"{case.name!r}, or other values): resume without a case, or run the new one to a new file"
        )
    # the progress holds the settings of the last chunk, which may have been regrown since the first
    known = file.settings | {k: v for k, v in file.progress().items() if k in file.settings}
    model, state = build(stored, {k: int(v) for k, v in known.items()})
    saved = file.checkpoint()
    if not saved:
        raise FileError(f"{path}: holds no checkpoint yet: run the case again with --overwrite")
    return stored, model, _unflatten(state, saved, path)


def _parse(text: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(text)


def search_settings(model: Model) -> dict[str, int]:
    """What `build` needs to make the model's tables again."""
    s = model.search
    names = ("capacity", "node_capacity", "chamber_capacity", "rebuild_every")
    return {name: int(getattr(s, name)) for name in names}


def _coordinates(case: Case) -> dict[str, tuple[str, np.ndarray, str, str]]:
    found = {}
    if case.probes.gauges:
        x = np.asarray(case.probes.gauges)
        found["gauge_x"] = ("gauge", x, "m", "distance of the gauge from the paddle at rest")
    axes = "xz" if case.tank.width is None else "xyz"
    for given, what, names in (
        (case.probes.surface, "surface_point", axes[:-1]),
        (case.probes.pressure, "sensor", axes),
        (case.probes.velocity, "point", axes),
    ):
        if given:
            points = np.asarray(given)
            for axis, name in enumerate(names):
                found[f"{what}_{name}"] = (what, points[:, axis], "m", f"{name} of the {what}")
    return found


def _flatten(state: State) -> dict[str, np.ndarray]:
    leaves = jax.tree_util.tree_flatten_with_path(state)[0]
    return {jax.tree_util.keystr(path).lstrip("."): np.asarray(leaf) for path, leaf in leaves}


def _unflatten(like: State, saved: dict[str, np.ndarray], path: Any) -> State:
    leaves, tree = jax.tree_util.tree_flatten_with_path(like)
    found = []
    for key, leaf in leaves:
        name = jax.tree_util.keystr(key).lstrip(".")
        if name not in saved or saved[name].shape != leaf.shape or saved[name].dtype != leaf.dtype:
            raise FileError(
                f"{path}: the checkpoint does not fit the case ({name} is missing or of another "
                "shape): it was made by another version; run the case again"
            )
        found.append(jnp.asarray(saved[name]))
    return jax.tree_util.tree_unflatten(tree, found)


def steps_per_chunk(case: Case, sample_every: int) -> int:
    """Steps between two snapshots, a whole number of samples."""
    return max(1, int(round(case.output.snapshot_dt / case.output.sample_dt))) * sample_every


class _Recorder:
    """Keeps what one run reads: in memory, and after every chunk in its file."""

    def __init__(self, case: Case, model: Model, state: State, t1: float, file: io.RunFile | None) -> None:
        self.case, self.file = case, file
        self.sample_every = steps_per_sample(case, model)
        self.per_chunk = steps_per_chunk(case, self.sample_every)
        self.probes = make_probes(case, model, build(case, search_settings(model))[1])
        self.units = {"time": ("s", "time")}
        for probe in self.probes:
            self.units |= probe.describe()
        self.start = int(state.step)
        self.last = int(round(t1 / case.output.sample_dt)) * self.sample_every
        self._chunks: list[dict[str, np.ndarray]] = []
        self._began = time.perf_counter()

    def keep(self, model: Model, before: int, state: State, readings: dict[str, jax.Array]) -> dict:
        """Takes the readings of a chunk that began at the step `before`; returns them as recorded."""
        series = {k: np.asarray(v) for k, v in readings.items()}
        series["time"] = _exact_times(before, series["time"], self.case.output.sample_dt)
        self._chunks.append(series)
        if self.file is not None:
            seconds = time.perf_counter() - self._began
            _save(self.file, self.case, model, state, series, self.units, seconds)
        return series

    def finished(self, model: Model, state: State, beside: int = 1) -> Solution:
        """The whole run, its results written too; its time is shared by so many that ran beside it."""
        if self.file is not None:
            series = self.file.series()
        else:
            series = {k: np.concatenate([r[k] for r in self._chunks]) for k in self._chunks[0]}
        solution = Solution(series, self.units, model, state, self.case)
        seconds = (time.perf_counter() - self._began) / beside
        results = _results(self.case, solution, seconds, int(state.step) - self.start)
        if self.file is not None:
            self.file.finish(results)
        return eqx.tree_at(lambda s: s.results, solution, results, is_leaf=lambda x: x is None)


def _drive(
    case: Case, model: Model, state: State, t1: float, file: io.RunFile | None, progress: bool
) -> Solution:
    kept = _Recorder(case, model, state, t1, file)
    every, last = kept.sample_every, kept.last
    if last <= kept.start:
        raise CaseError(
            f"t1 = {t1:g} s: the run is already at {kept.start * float(model.dt):g} s; give a larger t1"
        )
    with tqdm(
        total=last, initial=kept.start, unit="step", disable=not progress, dynamic_ncols=True, smoothing=0.1
    ) as bar:
        while int(state.step) < last:
            before = int(state.step)
            n_steps = min(kept.per_chunk, last - before)
            advance = functools.partial(
                _chunk, state=state, probes=kept.probes, n_steps=n_steps, sample_every=every
            )
            model, state, readings = replayed(case.name, model, advance, every, bar.write)
            series = kept.keep(model, before, state, readings)
            bar.update(n_steps)
            t = int(state.step) * float(model.dt)
            speed = float(series["max_speed"][-1]) if "max_speed" in series else float("nan")
            bar.set_postfix_str(f"t = {t:.2f} s, max |u| = {speed:.2f} m/s, ok")
    return kept.finished(model, state)


@dataclass(eq=False)  # a lane is itself, whatever its arrays hold
class _Lane:
    """One of several runs that go side by side."""

    case: Case
    model: Model
    state: State
    kept: _Recorder
    failure: SimulationError | None = None

    @property
    def step(self) -> int:
        """Of the last checkpoint."""
        return int(self.state.step)


def shape(case: Case) -> Hashable:
    """Cases with equal ones can run together: nothing but the values of their arrays differs."""
    model, state = build(case)
    model = _with_settings(model, dict.fromkeys(search_settings(model), 0))
    sample_every = steps_per_sample(case, model)
    everything = (model, state, make_probes(case, model, state))
    arrays = [(np.shape(a), str(jnp.asarray(a).dtype)) for a in jax.tree.leaves(everything)]
    return jax.tree.structure(everything), tuple(arrays), sample_every, case.t1, case.output


def run_together(
    cases: Sequence[Case], outs: Sequence[str | Path], progress: bool = True
) -> list[Solution | SimulationError]:
    """Runs cases of one `shape` side by side, in one vmapped call per chunk, each into a file of its own.

    A file that has a checkpoint of its case is gone on with. **Returns** what `run` would, or what it would
    raise: a run that fails does not stop the others. **Raises** FileError, as `run` and `restore`.
    """
    lanes = [_begun(case, out) for case, out in zip(cases, outs, strict=True)]
    every = [search_settings(lane.model) for lane in lanes]
    joint = {k: (min if k == "rebuild_every" else max)(s[k] for s in every) for k in every[0]}
    like = _with_settings(lanes[0].model, joint)
    left = sum(lane.kept.last - lane.step for lane in lanes)
    bar = tqdm(total=left, unit="step", disable=not progress, dynamic_ncols=True, leave=False)
    with bar:
        while waiting := [k for k in lanes if k.failure is None and k.step < k.kept.last]:
            # after an interruption some may be a chunk ahead: they wait
            now = min(lane.step for lane in waiting)
            active = [lane for lane in waiting if lane.step == now]
            # a lane that waits, or failed, goes as a copy of one that runs: the shapes stay
            going = [lane if lane in active else active[0] for lane in lanes]
            kept = active[0].kept
            n_steps = min(kept.per_chunk, kept.last - now)
            advance = functools.partial(_lanes_advanced, going, n_steps)
            like, states, readings = _replayed(like, advance, kept.sample_every, bar.write)
            for k, lane in enumerate(lanes):
                if lane not in active:
                    continue
                state, read = jax.tree.map(lambda a, k=k: a[k], (states, readings))
                model = eqx.tree_at(lambda m: m.search, lane.model, like.search)
                if int(state.status.bits):
                    lane.failure = _explained(lane.case.name, model, state)
                    continue
                lane.kept.keep(model, now, state, read)
                lane.model, lane.state = model, state
            bar.update(n_steps * len(active))
            bar.set_postfix_str(f"{len(active)} runs, t = {(now + n_steps) * float(like.dt):.2f} s")
    return [lane.failure or lane.kept.finished(lane.model, lane.state, len(lanes)) for lane in lanes]


def _begun(case: Case, out: str | Path) -> _Lane:
    if Path(out).exists() and io.RunFile.open(out).checkpoint():
        case, model, state = restore(out, case)
        file = io.RunFile.open(out)
    else:
        model, state = build(case)
        file = io.RunFile.create(
            out, case.to_toml(), search_settings(model), _coordinates(case), overwrite=True
        )
    return _Lane(case, model, state, _Recorder(case, model, state, case.t1, file))


def _lanes_advanced(lanes: Sequence[_Lane], n_steps: int, like: Model) -> tuple[State, dict]:
    """A chunk of all lanes, with the tables of the model `like`."""
    models = [eqx.tree_at(lambda m: m.search, lane.model, like.search) for lane in lanes]
    together = [(model, lane.kept.probes) for model, lane in zip(models, lanes, strict=True)]
    structure = jax.tree.structure(together[0])
    rows = list(zip(*map(jax.tree.leaves, together), strict=True))
    # what all have in common is not made a batch of
    same = [all(np.array_equal(a, row[0]) for a in row[1:]) for row in rows]
    shared = [row[0] if one else None for row, one in zip(rows, same, strict=True)]
    own = [None if one else jnp.stack(row) for row, one in zip(rows, same, strict=True)]
    states = jax.tree.map(lambda *a: jnp.stack(a), *(lane.state for lane in lanes))
    return _chunk_of_lanes(own, shared, states, structure, n_steps, lanes[0].kept.sample_every)


@functools.partial(jax.jit, static_argnames=("structure", "n_steps", "sample_every"))
def _chunk_of_lanes(own, shared, states, structure, n_steps, sample_every):
    def lane(own, state):
        leaves = [a if b is None else b for a, b in zip(own, shared, strict=True)]
        model, probes = jax.tree.unflatten(structure, leaves)
        return simulate(model, state, n_steps=n_steps, probes=probes, sample_every=sample_every)

    return jax.vmap(lane)(own, states)


def _exact_times(step: int, like: np.ndarray, every: float) -> np.ndarray:
    """Sample times in float64: the loop's own are float32."""
    first = np.round(float(like[0]) / every) * every
    return first + np.arange(len(like)) * every


def march(
    model: Model,
    state: State,
    t1: float,
    sample_dt: float,
    probes: Sequence[AbstractProbe] = (),
    *,
    name: str = "assembled",
    progress: bool = False,
) -> Solution:
    """Runs what `case.assemble` gave to t1 (s) and samples it every `sample_dt` (s, as given there).

    Tables that overflow or go stale are regrown and the run replayed, as in `run`; the model returned holds
    the settings that it needed, and a further call goes on from the state returned. The first sample is
    the state given, the last one sample before t1.
    **Raises** ValueError where t1 is no sample after the state's time, SimulationError as `run`.
    """
    sample_every = int(round(sample_dt / float(model.dt)))
    last = int(round(t1 / sample_dt)) * sample_every
    start = int(state.step)
    if last <= start or start % sample_every:
        raise ValueError(f"t1 = {t1:g} s is not a sample after the state's {start * float(model.dt):g} s")
    bar = tqdm(total=last - start, unit="step", disable=not progress, dynamic_ncols=True)
    advance = functools.partial(
        _chunk, state=state, probes=tuple(probes), n_steps=last - start, sample_every=sample_every
    )
    model, state, readings = replayed(name, model, advance, sample_every, bar.write)
    bar.close()
    series = {k: np.asarray(v) for k, v in readings.items()}
    series["time"] = _exact_times(start, series["time"], sample_dt)
    units = {"time": ("s", "time")}
    for probe in probes:
        units |= probe.describe()
    return Solution(series, units, model, state)


def replayed(
    name: str,
    model: Model,
    advance: Callable[[Model], tuple[State, Any]],
    sample_every: int,
    say: Callable[[str], None],
) -> tuple[Model, State, Any]:
    """One chunk, `advance(model)` giving the new state and whatever else, with tables regrown and the chunk
    replayed for as often as it takes. Returns the model that it took, too. **Raises** SimulationError."""
    model, new, found = _replayed(model, advance, sample_every, say)
    if int(new.status.bits):
        raise _explained(name, model, new)
    return model, new, found


def _replayed(model, advance, sample_every, say):
    """As `replayed`, for one state or a batch of them, and with what could not be mended in the status."""
    for _ in range(REPLAYS):
        new, found = advance(model)
        failed = Failure(int(np.bitwise_or.reduce(np.ravel(new.status.bits))))
        changed = _mended(model, failed, sample_every)
        if changed is None:
            break
        what = ", ".join(f"{k} = {v}" for k, v in changed.items())
        say(f"tables regrown, chunk replayed: {what}")
        model = _with_settings(model, changed)
    return model, new, found


def _mended(model: Model, failed: Failure, sample_every: int) -> dict[str, int] | None:
    """Settings that would let the chunk pass, or None where no setting would."""
    s = search_settings(model)
    mend = {}
    if failed & Failure.NEIGHBOUR_OVERFLOW:
        mend |= {"capacity": int(s["capacity"] * 1.25) + 4}
        mend |= {"node_capacity": int(s["node_capacity"] * 1.25) + 4}
    if failed & Failure.CHAMBER_OVERFLOW:
        mend |= {"chamber_capacity": int(s["chamber_capacity"] * 1.5) + 16}
    # what follows from lost neighbours is not the case's fault: mend the tables first
    if not mend and failed & Failure.STALE_TABLE and s["rebuild_every"] > 1:
        smaller = [n for n in range(1, s["rebuild_every"]) if sample_every % n == 0]
        mend |= {"rebuild_every": smaller[-1]}
    return mend or None


def _with_settings(model: Model, settings: dict[str, int]) -> Model:
    search = model.search
    values = {name: getattr(search, name) for name in ("grid", "skin")} | search_settings(model) | settings
    return eqx.tree_at(lambda m: m.search, model, type(search)(**values))


def _explained(name: str, model: Model, state: State) -> SimulationError:
    """The first failure in words: what, where, when, and what to change."""
    section = model.scheme.section
    failed = Failure(int(state.status.bits))
    step = int(state.status.step)
    t = step * float(model.dt)
    where = tuple(float(a) for a in state.status.where)
    place = ", ".join(f"{a:.3f}" for a in where)
    if failed & Failure.THROUGH_WALL:
        what = "a particle has left the tank"
        remedy = f"raise tank.height if it went over the top; else try a smaller {section}.cfl or dx"
    elif failed & Failure.TOO_FAST and section == "isph":
        what = "a particle goes farther than half a smoothing length in a step"
        remedy = "raise isph.speed, or reduce isph.cfl"
    elif failed & Failure.TOO_FAST:
        what = "a particle is faster than a third of the speed of sound"
        remedy = "raise fluid.c0, or reduce the waves' height; a smaller scheme.cfl tells which"
    elif failed & Failure.NON_FINITE:
        what = "a value is no longer finite"
        remedy = f"reduce {section}.cfl, or raise " + (
            "scheme.alpha (0.01 to 0.05)" if section == "scheme" else "isph.speed"
        )
    else:
        what = f"the neighbour tables cannot be kept ({failed.name})"
        remedy = f"reduce {section}.cfl or dx"
    return SimulationError(
        f"case {name!r} stopped at t = {t:.4f} s (step {step}): {what}, near ({place}) m.\n"
        f"What to change: {remedy}.",
        step=step,
        time=t,
        where=where,
    )


def _save(file, case, model, state, series, units, seconds) -> None:
    p = state.particles
    order = np.argsort(np.asarray(p.id))
    snapshot = {
        "time": int(state.step) / steps_per_sample(case, model) * case.output.sample_dt,
        "step": int(state.step),
        "paddle": float(state.paddle[0]),
        "x": np.asarray(p.x)[order],
        "u": np.asarray(p.u)[order],
        "p": np.asarray(model.scheme.pressure(p))[order],
        "id": np.asarray(p.id)[order],
    }
    if state.body is not None:
        snapshot["body"] = np.asarray(state.body.pose)
    variables = {name: io.Variable(*units[name], dim=_second_dimension(name)) for name in series}
    file.append(
        series,
        variables,
        {n for n in series if n in ENERGY},
        snapshot,
        _flatten(state),
        search_settings(model) | {"wall_seconds": seconds},
    )


def _second_dimension(name: str) -> str | None:
    if name.startswith("velocity_"):
        return "point"
    if name.startswith("eta_"):
        return "surface_point"
    return {
        "eta": "gauge",
        "pressure": "sensor",
        "body_velocity": "motion",
        "body_force": "motion",
        "body_force_mean": "motion",
        "body_pressure": "body_sensor",
    }.get(name)


def _results(case: Case, solution: Solution, seconds: float, steps: int) -> dict[str, float]:
    """Scalars of a run: speed, energy balance, and the device's powers where there is one."""
    results = {
        "t_end": int(solution.state.step) * float(solution.model.dt),
        "steps": float(int(solution.state.step)),
        "wall_seconds": seconds,
        "particle_steps_per_second": steps * solution.state.particles.x.shape[0] / seconds,
    }
    if case.waves is None:
        budget = analysis.energy_budget(solution.series)
        return results | {f"energy_{k}": v for k, v in budget.items()}
    T, d = case.waves.T, float(solution.model.depth)
    t = solution.t
    periods = settled_periods(case, float(t[-1]))
    # Over whole periods: the paddle gives and takes back far more than the waves keep.
    over = analysis.whole_periods(t, T, periods) if periods >= 1 else slice(None)
    budget = analysis.energy_budget({k: v[over] for k, v in solution.series.items()})
    results |= {f"energy_{k}": v for k, v in budget.items()}
    if periods < 1:
        return results
    P_inc = float(waves.incident_power(case.waves.H, T, d, case.fluid.rho0, case.g))
    results |= {"periods": float(periods), "P_inc": P_inc}
    chamber = case.pto is not None and case.pto.K_dm is not None
    body = case.body is not None and case.body.pto is not None
    if "power_pto" in solution.series and (chamber or body):
        efficiency = analysis.efficiency(t, solution["power_pto"], T, P_inc, periods)
        results["P_owc" if chamber else "P_pto"] = efficiency.xi * P_inc
        if case.tank.width is None:
            results |= {"xi": efficiency.xi, "xi_scatter": float(np.std(efficiency.per_period))}
        else:  # power over power per width
            results["capture_width"] = efficiency.xi
    if "eta" in solution.series and len(case.probes.gauges) >= 4:
        x = np.asarray(case.probes.gauges)[1:4]
        found = analysis.reflection(solution["eta"][:, 1:4].T, x, t, T, d, periods=periods)
        results |= {
            "reflection": found.coefficient,
            "incident_height": 2 * found.incident,
        }
    return results


def settled_periods(case: Case, t1: float) -> int:
    """Whole periods at the end of a run to t1 (s) over which its results are averaged; below 1: none."""
    whole = int((t1 - _transient(case)) / case.waves.T + 1e-6)
    return min(case.output.periods, whole)


def _transient(case: Case) -> float:
    """Time for the ramp and for the wave's energy to reach the far end, s."""
    omega = 2 * np.pi / case.waves.T
    speed = float(waves.group_velocity(omega, case.tank.depth, case.g))
    return case.waves.ramp_periods * case.waves.T + case.tank.length / speed
