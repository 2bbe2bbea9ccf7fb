"""Changes to a case during a run; the lattice, the state's arrays and the series are kept."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.air_sections import SMOOTH_LAWS, air_keys
from jaxsph.case.case import Case, any_name, inner
from jaxsph.case.geometry import Geometry
from jaxsph.case.section import NAME
from jaxsph.case.sections import BODY_KEYS
from jaxsph.errors import CaseError
from jaxsph.model.state import State, map_tallies
from jaxsph.output.run_file import RunFile
from jaxsph.problem.problem import Problem
from jaxsph.run.chunks import search_settings, with_settings
from jaxsph.run.recorder import Start, deciding_numbers, saved_state

CHANGEABLE = (
    "t1",
    "description",
    "tank.height",
    "output.sample_dt",
    "output.snapshot_dt",
    "output.periods",
    *air_keys(SMOOTH_LAWS),
    *(f"{body}.pto.{key}" for body in BODY_KEYS for key in ("damping", "coulomb")),
    *(f"link.{NAME}.{key}" for key in ("damping", "quadratic", "friction")),
    "sponge.strength",
    "fluid.nu",
    "scheme.alpha",
    "scheme.delta",
    "scheme.cfl",
    "scheme.speed",
    "scheme.solver",
    "scheme.tolerance",
    "scheme.relaxation",
    "scheme.shifting",
)
"""Keys of a case that `resume` may change. The tank's walls are rebuilt; particles, solids and exchanged
energies are kept. A new time step applies from the last sample on."""

REASONS = {
    "dx": "it is the spacing of the existing particles",
    "g": "the energies in the file were computed with it from the start",
    "precision": "the checkpoint's arrays have the previous precision",
    "fluid.c0": "the pressure of the water is stored as a density, which depends on the speed of sound",
    "fluid": "the particles' masses and pressures depend on it",
    "tank": "a change would move the walls around the water",
    "waves": "the paddle would jump",
    "air": "the air in the chamber depends on it",
    "chamber": "the energy that the chamber has exchanged depends on it",
    "duct": "the energy that the duct has exchanged depends on it",
    "device": "a change would move the walls around the water",
    "solid": "a change would move the walls around the water",
    "body": "a change would alter the position or the mass of a body on which the water acts",
    "bodies": "a change would alter the position or the mass of a body on which the water acts",
    "link": "the energy that the link has stored depends on it",
    "mooring": "the energy that the mooring has stored depends on it",
    "probes": "the series in the file are those of the present probes",
    "start": "it describes the initial state",
    "scheme": "the checkpoint's state belongs to the present scheme",
}
"""Reasons why a value cannot change during a run, by key or section."""


UNMOVED = ("t1", "description", "output.snapshot_dt", "output.periods")
"""Keys of `CHANGEABLE` that affect neither the motion of the water nor the times of the samples; if only such
keys change, averages do not restart."""


class Change(NamedTuple):
    """Validated change to a run's file, which `RunFile.amend` writes."""

    case_toml: str
    settings: dict[str, int]
    numbers: dict[str, list[float]]
    since: float
    checkpoint: dict[str, np.ndarray]


def amend(file: RunFile, start: Start, changes: Mapping[str, Any]) -> tuple[Start, Change]:
    """Changes values of a case from the checkpoint on; returns the new start and the change for the file.

    **Raises** CaseError for a value that cannot change during a run.
    """
    before = start.source
    if not isinstance(before, Case):
        raise CaseError(
            f"{', '.join(changes)}: only the values of a case can change during a run, not those of the "
            f"problem {before.name!r}; start a new run with other values"
        )
    case = amended_case(before, changes)
    problem = case.problem()
    model, initial = problem.model, problem.state
    old_every, every = start.problem.sample_every, problem.sample_every
    old_dt, dt = start.problem.sample_dt, problem.sample_dt
    t = int(start.state.step) / old_every * old_dt
    samples = t / dt
    if abs(samples - round(samples)) > 1e-6 * max(samples, 1.0):
        raise CaseError(
            f"output.sample_dt = {dt:g} s: must divide the {t:g} s that the run has reached into a whole "
            "number of intervals"
        )
    known, found = search_settings(start.model), search_settings(model)
    model = with_settings(
        model, {k: v if k == "rebuild_every" else max(v, known[k]) for k, v in found.items()}
    )
    state = _carry_over(start.state, initial)
    # a probe divides the energies since the last sample by the new sampling interval: scale them
    parts, ledger = map_tallies(lambda tally: tally.over(dt / old_dt), (state.parts, state.ledger))
    limits = map_tallies(lambda tally: tally.over(every / old_every), state.limits)
    # the state counts steps, so convert the time to steps of the new length
    step = jnp.asarray(round(samples) * every, state.step.dtype)
    state = eqx.tree_at(lambda s: (s.step, s.parts, s.ledger, s.limits), state, (step, parts, ledger, limits))
    _check_readings(start.problem, problem)
    restarts = any(_value(before, k) != _value(case, k) for k in set(changes) - set(UNMOVED))
    change = Change(
        _told(file.case_toml, before, case, changes, t),
        search_settings(model),
        deciding_numbers(model, initial),
        t if restarts else file.since,
        saved_state(state),
    )
    return Start(case, problem, model, state), change


def _check_readings(before: Problem, now: Problem) -> None:
    """**Raises** CaseError if the series of the changed case differ from the file's series."""
    old, new = set(before.units), set(now.units)
    if old != new:
        raise CaseError(
            f"the changed case does not record the same series as the run ({', '.join(sorted(old ^ new))}): "
            "start a new run with --set"
        )


def amended_case(case: Case, changes: Mapping[str, Any]) -> Case:
    """Returns the case with changed values. **Raises** CaseError for keys that a run must keep."""
    for key in changes:
        if any_name(key) not in CHANGEABLE:
            _refuse_unknown(case, key, changes[key])
            reason = REASONS.get(
                key, REASONS.get(key.partition(".")[0], "the run depends on it from the start")
            )
            raise CaseError(
                f"{key} cannot change during a run: {reason}. Start a new run with --set, or "
                f"change one of {', '.join(CHANGEABLE)}"
            )
    new = case.replace(dict(changes))
    _check_laws(case, new)
    height, before = Geometry.of(new).height, Geometry.of(case).height
    if "tank.height" in changes and not height > before:
        raise CaseError(
            f"tank.height = {changes['tank.height']!r}: must be higher than the {before:g} m of the run, "
            "because water may reach that height"
        )
    return new


def _check_laws(case: Case, new: Case) -> None:
    """**Raises** CaseError if the entries of a power take-off in the energy budget would change."""
    before, after = case.ptos, new.ptos
    for key in before.keys() & after.keys():
        if before[key].is_turbine != after[key].is_turbine:
            raise CaseError(
                f"{key} cannot change between a turbine and a prescribed pressure during a run: start a new "
                "run with --set"
            )
        if before[key].has_relief != after[key].has_relief:
            raise CaseError(
                f"{key}.relief cannot be added or removed during a run, because the valve has an entry in "
                "the energy budget: start a new run with --set"
            )


def _refuse_unknown(case: Case, key: str, value: Any) -> None:
    """**Raises** CaseError, which suggests the nearest key, if a case has no such key."""
    try:
        case.replace({key: value})
    except CaseError as error:
        if str(error).startswith("unknown key"):
            raise


def _carry_over(state: State, initial: State) -> State:
    """Returns the state of the run. **Raises** CaseError if the amended case needs different state arrays."""
    old, new = (jax.tree.map(jnp.shape, one) for one in (state, initial))
    if jax.tree.structure(state) != jax.tree.structure(initial) or old != new:
        raise CaseError("the changed case needs different state arrays: start a new run with --set")
    return state


def _told(text: str, before: Case, case: Case, changes: Mapping[str, Any], t: float) -> str:
    """Text of the case, headed by comments that give every change and the time of the change."""
    notes = [line for line in text.splitlines() if line.startswith("# since t = ")]
    for key in changes:
        old, new = _value(before, key), _value(case, key)
        notes.append(f"# since t = {t:.6g} s: {key} = {new!r} (before: {old!r})")
    return "\n".join([*notes, case.to_toml()])


def _value(case: Case, key: str) -> Any:
    return functools.reduce(inner, key.split("."), case)
