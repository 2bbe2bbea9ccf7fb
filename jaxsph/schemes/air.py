"""Air of the chambers in a step: its force on the water, and pressures that meet every power take-off's law.

The pressure of the air is an unknown of the step as the water's is. Both enter linearly, so the air's is
eliminated: the response of the water to a unit of it (`Response`) gives the flow for every pressure, and
the law of the power take-off meets this line in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.slabs import Sources
from jaxsph.model.air import AirCoupling, Pressed
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.state import Particles, Response, State, Tables
from jaxsph.schemes.step import Interval

__all__ = ["couple_airs", "meet_laws"]

SWEEPS = 12
"""Sweeps over several chambers that share water.

The pressure of one changes the flow of another by less than half of what it does to its own, even where only
a plate is between them, so that every sweep takes three quarters off the error: 12 reach float32's.
"""


def couple_airs(
    scheme: AbstractScheme, model: Model, water: Particles, sources: Sources, tables: Tables
) -> dict[str, AirCoupling]:
    """Couplings of the chambers' air to the water where it is, by the chamber's name."""
    return {c.name: c.coupling(scheme, water, sources, tables) for c in model.chambers}


def meet_laws(
    model: Model,
    state: State,
    airs: Mapping[str, AirCoupling],
    responses: Mapping[str, Response],
    u: Float[Array, "N D"],
    interval: Interval,
) -> dict[str, tuple[Scalar, Pressed]]:
    """Change of every chamber's pressure (Pa) from that of the step before, and its air, by its name.

    With these changes, and the water's responses to them, flows and pressures meet all laws at once.
    **Arguments**: `u`: velocities (m/s) at the end of the step with the air's pressures of the step before.
    """
    names, t, dt = tuple(airs), interval.t, interval.dt
    changes = {name: airs[name].push(responses[name].u, dt) for name in names}
    # -dq/dP_a of the chamber `a` by the pressure of `b`, m2/s/Pa
    compliance = {(a, b): -airs[a].flow(changes[b]) for a in names for b in names}
    flows = {name: air.flow(u) for name, air in airs.items()}
    before = {name: state.own[name].P_a for name in names}
    missing = {name: 0.0 * before[name] for name in names}
    laws: dict[str, Pressed] = {}
    for _ in range(SWEEPS if len(names) > 1 else 1):
        for chamber in model.chambers:
            a = chamber.name
            others = sum(compliance[a, b] * missing[b] for b in names if b != a)
            q_free = flows[a] - others + compliance[a, a] * before[a]
            laws[a] = chamber.press(state.own[a], q_free, compliance[a, a], t, dt)
            missing[a] = laws[a].P_a - before[a]
    return {name: (missing[name], laws[name]) for name in names}
