"""Advances a run by chunks, resizes the neighbour tables, and describes failures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from jaxsph.core.pairs import SPARE
from jaxsph.core.programs import forget_programs
from jaxsph.core.search.base import SPREADS_ON, needed_capacity
from jaxsph.core.search.tables import NARROW
from jaxsph.core.slabs import Slabs
from jaxsph.errors import SimulationError
from jaxsph.model.interfaces import Model
from jaxsph.model.state import Failure, State, Status
from jaxsph.parts.border import flumes, with_flume, zones
from jaxsph.problem.trouble import Remedies, Trouble

REPLAYS = 6
"""Largest number of attempts at one chunk, with other settings of the tables each time."""
EARLY = 20
"""Number of steps from the start during which a particle inside a wall is attributed to the set-up."""
FASTER = 1.25
"""Safety factor on the largest speed so far (-), for choosing fewer steps between searches after a stale
table."""
REPLAYED = "neighbour tables changed, chunk replayed"
"""Beginning of the notice of a replay."""


def search_settings(model: Model) -> dict[str, int]:
    """Sizes of a model's neighbour tables and number of steps between searches, by name."""
    s = model.search
    names = ("capacity", "node_capacity", "chamber_capacity", "rebuild_every")
    return {name: int(getattr(s, name)) for name in names}


def slab_sizes(model: Model) -> dict[str, int]:
    """Sizes of a model's slabs, by name; not stored, since a run may be resumed on any number of devices."""
    return {name: int(getattr(model.search.slabs, name)) for name in ("halo", "points")}


def sample_times(like: np.ndarray, every: float) -> np.ndarray:
    """Times of samples (s) in float64, from the float32 times of the loop."""
    first = np.round(float(like[0]) / every) * every
    return first + np.arange(len(like)) * every


def advance_chunk(
    model: Model,
    advance: Callable[[Model], tuple[State, Any]],
    say: Callable[[str], None],
    name: str,
    remedies: Remedies,
) -> tuple[Model, State, Any]:
    """Advances a run by one chunk, and replays the chunk if neighbour tables were too small or stale.

    **Arguments**: `advance(model)` returns the new state and other results; `say` reports a replay; `name`,
    `remedies`: name of the problem and its remedies, for the error. **Returns** the model with the
    settings of the tables that the chunk needed, and the results of `advance`. **Raises** SimulationError for
    a failure that other settings do not remedy.
    """
    model, new, found = replay_chunk(model, advance, say)
    for zone, its in zones(model, new):
        if int(its.status.bits):
            raise failure_error(zone, its, name, remedies)
    return model, new, found


def replay_chunk(
    model: Model, advance: Callable[[Model], tuple[State, Any]], say: Callable[[str], None]
) -> tuple[Model, State, Any]:
    """Advances a state or a batch as `advance_chunk` does; failures that remain are kept in the status."""
    forget_programs()
    for _ in range(REPLAYS):
        new, found = advance(model)
        changed = better_settings(model, new.status)
        if changed is not None:
            model = with_settings(model, changed)
        else:
            flume, its = zones(model, new)[-1]
            changed = better_settings(flume, its.status)
            if changed is None:
                break
            model = with_flume(model, with_settings(flume, changed))
        say(f"{REPLAYED}: {', '.join(f'{k} = {v}' for k, v in changed.items())}")
    return model, new, found


def better_settings(model: Model, status: Status) -> dict[str, int] | None:
    """Settings of the neighbour tables with which a failed chunk may succeed; None if no setting can help.

    The settings follow from the sizes that the chunk needed according to `status`, which may be the status of
    a batch. A reserve is added, because the step is compiled again after every change.
    """
    now = search_settings(model) | slab_sizes(model)
    failed = Failure(int(np.bitwise_or.reduce(np.ravel(status.bits))))
    if failed & (Failure.NEIGHBOUR_OVERFLOW | Failure.CHAMBER_OVERFLOW):
        needed = {name: int(np.max(most)) for name, most in status.most.items()}
        if needed["halo"] >= NARROW:
            return None
        spare = dict.fromkeys(needed, SPARE) | {"points": SPREADS_ON}
        grown = {k: needed_capacity(most, spare[k]) for k, most in needed.items() if most > now[k]}
        return grown or None
    # missing neighbours can cause any other failure: correct the tables first
    if failed & Failure.STALE_TABLE and now["rebuild_every"] > 1:
        step = FASTER * float(np.sqrt(np.max(status.speed2))) * float(np.max(model.dt))
        # divisors, so that particles are regularised at the same steps as before
        smaller = [n for n in range(1, now["rebuild_every"]) if now["rebuild_every"] % n == 0]
        enough = [n for n in smaller if n * step <= 0.5 * model.search.skin]
        return {"rebuild_every": max(enough, default=1)}
    return None


def with_settings(model: Model, settings: dict[str, int]) -> Model:
    """Returns the model with some of its `search_settings` and `slab_sizes` changed."""
    search = model.search
    values = {name: getattr(search, name) for name in ("grid", "method", "skin", "regularise_every")}
    values |= {name: settings.get(name, size) for name, size in search_settings(model).items()}
    sizes = {name: settings.get(name, size) for name, size in slab_sizes(model).items()}
    values["slabs"] = Slabs(search.slabs.devices, **sizes)
    if settings.keys() & {"capacity", "node_capacity"}:
        values["method"] = search.method.grown()
    return eqx.tree_at(lambda m: m.search, model, type(search)(**values))


def with_settings_of(model: Model, other: Model) -> Model:
    """Returns the model with the `search_settings` of another one, also those of its flume."""
    if flumes(model):
        zones = (flumes(one)[0].flume for one in (model, other))
        model = with_flume(model, with_settings_of(*zones))
    return with_settings(model, search_settings(other))


def failure_error(model: Model, state: State, name: str, remedies: Remedies) -> SimulationError:
    """Error for a run's first failure: kind, place (m) and time (s) of the failure, and what to change.

    **Arguments**: `name`, `remedies`: name of the problem, and its remedies.
    """
    step = int(state.status.step)
    t = float(model.t0) + step * float(model.dt)
    where = tuple(float(a) for a in state.status.where)
    place = ", ".join(f"{a:.3f}" for a in where)
    what, cause = _cause(model, state)
    if isinstance(cause, Trouble):
        top = float(model.walls.high[-1])
        higher = f"{max(1.25 * top, where[-1] + 0.25 * top):.3g}"
        cause = remedies.get(cause, cause.value).replace("{higher}", higher)
    return SimulationError(
        f"case {name!r} stopped at t = {t:.4f} s (step {step}): {what}, near ({place}) m.\n"
        f"What to change: {cause}.",
        step=step,
        time=t,
        where=where,
    )


def _cause(model: Model, state: State) -> tuple[str, Trouble | str]:
    """Description of the failure, and the `Trouble` whose remedy applies, or the remedy itself."""
    status = state.status
    failed = Failure(int(status.bits))
    if failed & Failure.TOUCHING:
        body = _nearest_body(model, state)
        return f"the body {body!r} is too near to the bed, a wall or another solid", Trouble.TOUCHING
    top = float(model.walls.high[-1])
    if failed & Failure.THROUGH_WALL and float(status.where[-1]) >= top:
        return f"a particle has left the tank over its rim, which is {top:g} m high", Trouble.OVER_RIM
    if failed & Failure.THROUGH_WALL:
        if int(status.step) <= EARLY:
            return f"a particle was inside a wall within the first {EARLY} steps", (
                "correct the set-up, which is the likely cause; near this point water, walls and bodies must "
                "neither overlap nor leave a gap narrower than the spacing"
            )
        return "a particle has gone through a wall", Trouble.THROUGH_WALL
    if failed & Failure.TOO_FAST:
        return model.scheme.too_fast, Trouble.TOO_FAST
    if failed & Failure.NON_FINITE:
        return "a value is no longer finite", Trouble.NOT_FINITE
    if failed & Failure.NOT_CONVERGED:
        residual = float(status.residual)
        what = f"a linear solution for the pressure did not converge (relative residual {residual:.2g})"
        return what, Trouble.NOT_CONVERGED
    if int(status.most["halo"]) >= NARROW:
        return (
            f"{model.search.slabs.count} devices are too many: a slab is narrower than the search radius",
            "continue with fewer devices: jaxsph resume FILE --devices N",
        )
    if failed & Failure.NEIGHBOUR_OVERFLOW and better_settings(model, status) is None:
        # the table of images is the only one whose required size is not counted and which does not grow
        return "water at a wall is too dense for the table of mirror images", Trouble.TOO_DENSE
    if failed & Failure.STALE_TABLE:
        # the tables are already rebuilt at every step, but a particle leaves their reach within one step
        return "a particle leaves the reach of its neighbour table in a single step", Trouble.TOO_FAST
    return f"the neighbour tables keep overflowing ({failed.name})", Trouble.NO_TABLES


def _nearest_body(model: Model, state: State) -> str:
    """Name of the body whose surface is nearest to the place of the first failure."""
    where = state.status.where[None]
    return min(
        model.bodies, key=lambda body: abs(float(body.distance(state.parts[body.name], where)[0]))
    ).name
