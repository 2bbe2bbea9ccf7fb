"""Air of the chambers in a step: its force on the water, and pressures that meet every power take-off's law.

The pressure of the air is an unknown of the step as the water's is. Both enter linearly, so the air's is
eliminated: the response of the water to a unit of it (`Response`) gives the flow for every pressure, and
the law of the power take-off meets this line in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.slabs import Sources
from jaxsph.model.air import Air, AirCoupling, Pressed
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.state import Particles, Response, Tables
from jaxsph.schemes.step import Interval

__all__ = ["Met", "WaterLine", "couple_airs", "finish_airs", "meet_laws", "water_line"]

NEWTON = 8
"""Steps of Newton's method for laws that share water or ducts: each doubles the number of right digits, and a
step of time changes the first of them."""


class Met(NamedTuple):
    """Air over a step that meets every law, by the names of chambers and ducts."""

    chambers: dict[str, Pressed]
    ducts: dict[str, Pressed]


class WaterLine(NamedTuple):
    """Flows out of the chambers as linear functions of their pressures over a step."""

    flows: Mapping[str, Scalar]
    """Flow of every chamber at the step's end were all pressures zero, m3/s (m2/s in 2-D)."""
    compliance: Mapping[tuple[str, str], Scalar]
    """-dq/dP_a of the first chamber's flow by the second's pressure, m3/s/Pa (m2/s/Pa in 2-D)."""


def couple_airs(
    scheme: AbstractScheme, model: Model, water: Particles, sources: Sources, tables: Tables
) -> dict[str, AirCoupling]:
    """Couplings of the chambers' air to the water where it is, by the chamber's name."""
    return {c.name: c.coupling(scheme, water, sources, tables) for c in model.chambers}


def water_line(
    airs: Mapping[str, AirCoupling],
    responses: Mapping[str, Response],
    u: Float[Array, "N D"],
    before: Mapping[str, Scalar],
    dt: Scalar,
) -> WaterLine:
    """Flows over a step of dt (s) by the water's responses to the chambers' pressures.

    **Arguments**: `u`: velocities (m/s) at the step's end with the pressures `before` (Pa).
    """
    changes = {name: airs[name].push(responses[name].u, dt) for name in airs}
    compliance = {(a, b): -airs[a].flow(changes[b]) for a in airs for b in airs}
    flows = {a: air.flow(u) + sum(compliance[a, b] * before[b] for b in airs) for a, air in airs.items()}
    return WaterLine(flows, compliance)


def meet_laws(model: Model, parts: Mapping[str, Any], line: WaterLine, interval: Interval) -> Met:
    """Air of every chamber and duct that meets its law and the water's line at once.

    `parts`: states of the parts at the step's begin.
    """
    if not model.chambers:
        return Met({}, {})
    laws = _Laws(model, parts, line, interval.t, interval.dt)
    unknown = laws.begin()
    if len(unknown) > 1:  # of a chamber alone it is known
        unknown = jax.lax.fori_loop(0, NEWTON, lambda _, x: laws.nearer(x), unknown)
    return laws.met(unknown)


class _Laws(NamedTuple):
    """Equations of chambers and ducts that share water, with an unknown flow for each.

    That of a chamber is its flow were its own pressure zero; that of a duct is its flow were the drop along
    it zero while the chambers give way. With them every law is a function of bounded slope, however steep its
    pressure is over its flow, or its flow over its pressure.
    """

    model: Model
    parts: Mapping[str, Any]
    line: WaterLine
    t: Scalar
    dt: Scalar

    def give(self, between: tuple[str, str]) -> Scalar:
        """Compliance of the water at both ends of a duct, one behind the other."""
        a, b = (self.line.compliance[end, end] for end in between)
        return a * b / (a + b)

    def begin(self) -> Array:
        """Unknown flows, of the chambers and then of the ducts, by the air of the step before."""
        P_a = {c.name: self.parts[c.name].P_a for c in self.chambers}
        chambers = [self.line.flows[name] - self.others(name, P_a) for name in P_a]
        ducts = []
        for duct in self.model.ducts:
            air = self.parts[duct.name]
            ducts.append(air.q + self.give(duct.between) * air.P_a)
        return jnp.stack([*chambers, *ducts])

    @property
    def chambers(self):
        """Chambers of the model."""
        return self.model.chambers

    def others(self, name: str, P_a: Mapping[str, Scalar]) -> Scalar:
        """Flow out of a chamber that the pressures (Pa) of the others hold back."""
        held = [self.line.compliance[name, k.name] * P_a[k.name] for k in self.chambers if k.name != name]
        return sum(held, jnp.zeros_like(self.line.flows[name]))

    def met(self, unknown: Array) -> Met:
        """Air of chambers and ducts at the unknown flows."""
        of_chambers, of_ducts = unknown[: len(self.chambers)], unknown[len(self.chambers) :]
        ducts = {
            duct.name: duct.press(self.parts[duct.name], q, self.give(duct.between), self.t)
            for duct, q in zip(self.model.ducts, of_ducts, strict=True)
        }
        chambers = {}
        for chamber, q in zip(self.chambers, of_chambers, strict=True):
            name = chamber.name
            ducted = sum((way * ducts[d].passed for d, way in _ways(self.model, name)), jnp.zeros_like(q))
            compliance = self.line.compliance[name, name]
            chambers[name] = chamber.press(self.parts[name], q, compliance, ducted, self.t, self.dt)
        return Met(chambers, ducts)

    def missing(self, unknown: Array) -> Array:
        """Flows by which the equations are not met."""
        met = self.met(unknown)
        P_a = {name: pressed.P_a for name, pressed in met.chambers.items()}
        found = [
            q + self.others(c.name, P_a) - self.line.flows[c.name]
            for c, q in zip(self.chambers, unknown[: len(self.chambers)], strict=True)
        ]
        for duct in self.model.ducts:
            a, b = duct.between
            found.append(self.give(duct.between) * (met.ducts[duct.name].P_a - P_a[a] + P_a[b]))
        return jnp.stack(found)

    def nearer(self, unknown: Array) -> Array:
        """Unknown flows after a step of Newton's method."""
        slopes = jax.jacfwd(self.missing)(unknown)
        return unknown - jnp.linalg.solve(slopes, self.missing(unknown))


def _ways(model: Model, chamber: str) -> list[tuple[str, float]]:
    """Ducts of a chamber by their names, with 1 where flow out of it is positive, and -1."""
    return [
        (duct.name, way)
        for duct in model.ducts
        for end, way in zip(duct.between, (1.0, -1.0), strict=True)
        if end == chamber
    ]


def finish_airs(
    model: Model,
    parts: Mapping[str, Any],
    met: Met,
    flows: Mapping[str, tuple[Scalar, Scalar]],
    dt: Scalar,
) -> tuple[dict[str, Air], dict[str, Scalar]]:
    """Air of chambers and ducts at the end of a step, and the energies (J, J/m in 2-D) taken by name.

    `flows`: flows out of every chamber at the step's begin and end, by the coupling of the step.
    """
    airs, taken = {}, {}
    work = {duct.name: jnp.zeros_like(dt) for duct in model.ducts}
    for chamber in model.chambers:
        name, ways = chamber.name, _ways(model, chamber.name)
        airs[name], amounts, given = chamber.finish(parts[name], met.chambers[name], *flows[name], dt)
        taken |= amounts
        # of a closed chamber the ducts share what the mean over the step is off their flows at its end
        off = (given.flow - met.chambers[name].ducted) / max(len(ways), 1)
        for duct, way in ways:
            work[duct] = work[duct] + dt * given.head * (way * met.ducts[duct].passed + off)
    for duct in model.ducts:
        airs[duct.name], amounts = duct.finish(parts[duct.name], met.ducts[duct.name], work[duct.name], dt)
        taken |= amounts
    return airs, taken
