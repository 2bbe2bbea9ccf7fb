"""One chunk of a run, replayed with larger tables for as long as it takes, and failures in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from jaxsph.case.case import Case
from jaxsph.errors import SimulationError
from jaxsph.model.interfaces import Model
from jaxsph.model.state import Failure, State

REPLAYS = 6
"""Times that one chunk is replayed with larger tables before the run gives up."""


def search_settings(model: Model) -> dict[str, int]:
    """What `build` needs to make the model's tables again."""
    s = model.search
    names = ("capacity", "node_capacity", "chamber_capacity", "rebuild_every")
    return {name: int(getattr(s, name)) for name in names}


def steps_per_chunk(case: Case, sample_every: int) -> int:
    """Steps between two snapshots, a whole number of samples."""
    return max(1, int(round(case.output.snapshot_dt / case.output.sample_dt))) * sample_every


def sample_times(like: np.ndarray, every: float) -> np.ndarray:
    """Times of samples (s) in float64, from the loop's own, which are float32."""
    first = np.round(float(like[0]) / every) * every
    return first + np.arange(len(like)) * every


def advance_chunk(
    name: str,
    model: Model,
    advance: Callable[[Model], tuple[State, Any]],
    sample_every: int,
    say: Callable[[str], None],
) -> tuple[Model, State, Any]:
    """One chunk, `advance(model)` giving the new state and whatever else, with tables regrown and the chunk
    replayed for as often as it takes. Returns the model that it took, too. **Raises** SimulationError."""
    model, new, found = replay_chunk(model, advance, sample_every, say)
    if int(new.status.bits):
        raise failure_error(name, model, new)
    return model, new, found


def replay_chunk(
    model: Model, advance: Callable[[Model], tuple[State, Any]], sample_every: int, say: Callable[[str], None]
) -> tuple[Model, State, Any]:
    """As `advance_chunk`, for one state or a batch; what no larger table mends stays in the status."""
    for _ in range(REPLAYS):
        new, found = advance(model)
        failed = Failure(int(np.bitwise_or.reduce(np.ravel(new.status.bits))))
        changed = larger_tables(model, failed, sample_every)
        if changed is None:
            break
        what = ", ".join(f"{k} = {v}" for k, v in changed.items())
        say(f"tables regrown, chunk replayed: {what}")
        model = with_settings(model, changed)
    return model, new, found


def larger_tables(model: Model, failed: Failure, sample_every: int) -> dict[str, int] | None:
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


def with_settings(model: Model, settings: dict[str, int]) -> Model:
    """The model with some of its `search_settings` changed."""
    search = model.search
    values = {name: getattr(search, name) for name in ("grid", "method", "skin")}
    values |= search_settings(model) | settings
    if settings.keys() & {"capacity", "node_capacity"}:
        values["method"] = search.method.grown()
    return eqx.tree_at(lambda m: m.search, model, type(search)(**values))


def failure_error(name: str, model: Model, state: State) -> SimulationError:
    """The first failure in words: what, where, when, and what to change."""
    failed = Failure(int(state.status.bits))
    step = int(state.status.step)
    t = step * float(model.dt)
    where = tuple(float(a) for a in state.status.where)
    place = ", ".join(f"{a:.3f}" for a in where)
    top = float(model.walls.high[-1])
    if failed & Failure.THROUGH_WALL and where[-1] >= top:
        what = f"a particle has left over the rim of the tank, which is {top:g} m high"
        remedy = (
            f"raise tank.height and go on: jaxsph resume FILE --set tank.height={_higher(top, where[-1])}"
        )
    elif failed & Failure.THROUGH_WALL:
        what = "a particle has gone through a wall"
        remedy = "a smaller scheme.cfl or dx"
    elif failed & Failure.TOO_FAST:
        what, remedy = model.scheme.too_fast
    elif failed & Failure.NON_FINITE:
        what, remedy = "a value is no longer finite", model.scheme.steadier
    else:
        what = f"the neighbour tables cannot be kept ({failed.name})"
        remedy = "reduce scheme.cfl or dx"
    return SimulationError(
        f"case {name!r} stopped at t = {t:.4f} s (step {step}): {what}, near ({place}) m.\n"
        f"What to change: {remedy}.",
        step=step,
        time=t,
        where=where,
    )


def _higher(top: float, z: float) -> str:
    """A height of the tank (m) that leaves room over what has reached z (m)."""
    return f"{max(1.25 * top, z + 0.25 * top):.3g}"
