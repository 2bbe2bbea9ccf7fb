"""Air of the chambers in a step: its force on the water, and the pressures required by the power take-offs.

The pressures of air and water are both unknowns of a step. The water's equations are linear in both. The
water's response to a unit of air pressure (`Response`) therefore gives the flow out of a chamber as a linear
function of the air pressure. For a single chamber, this function and the law of the power take-off are solved
in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.parts import Part
from jaxsph.core.slabs import Sources
from jaxsph.model.air import Air, AirCoupling, Pressed
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.state import Particles, Pressures, Response, Tables
from jaxsph.schemes.bodies import BodiesCoupling, velocity_changes
from jaxsph.schemes.step import Interval

__all__ = [
    "CorrectedForAir",
    "Met",
    "WaterLine",
    "correct_for_air",
    "couple_airs",
    "finish_airs",
    "meet_laws",
    "on_bodies",
]

NEWTON = 8
"""Number of Newton iterations for laws that are coupled by the water or by ducts.

Each iteration doubles the number of correct digits. The iteration starts from the air of the previous step,
which may differ from the solution in the first digit.
"""


LEAST = 0.1
"""Smallest compliance of a chamber as a fraction of its value if the air moved only the particles at the
surface (-).

The fraction is 0.5 to 0.75 in an undisturbed chamber, and 0.25 when the water level falls to the edge of the
wall. Below this level the computed response of the disordered water can be negative, with which a turbine's
law has no solution.
"""


class Met(NamedTuple):
    """Pressures and flows of the air over a step that satisfy the laws of all chambers and ducts, by name."""

    chambers: dict[str, Pressed]
    ducts: dict[str, Pressed]


class WaterLine(NamedTuple):
    """Flows out of the chambers as linear functions of the chambers' pressures over a step."""

    flows: Mapping[str, Scalar]
    """Flow out of every chamber at the step's end if all pressures were zero, m3/s (m2/s in 2-D)."""
    compliance: Mapping[tuple[str, str], Scalar]
    """Decrease of chamber a's flow per unit pressure of chamber b, by (a, b), m3/s/Pa (m2/s/Pa in 2-D)."""
    limited: Scalar | float = 0.0
    """Number of particles moved by the air of chambers whose compliance is raised to its lower bound
    (`LEAST`)."""


@Part.AIR.scope()
def couple_airs(
    scheme: AbstractScheme,
    model: Model,
    water: Particles,
    sources: Sources,
    tables: Tables,
    parts: Mapping[str, Any],
) -> dict[str, AirCoupling]:
    """Couplings of the chambers' air to the water in its current position, by the chamber's name.

    `parts`: states of the parts by name.
    """
    return {c.name: c.coupling(scheme, water, sources, tables, parts) for c in model.chambers}


def on_bodies(
    airs: Mapping[str, AirCoupling], pressures: Mapping[str, Scalar]
) -> dict[str, Float[Array, " V"]]:
    """Forces of the air on the bodies that carry chambers, N, N m (per metre in 2-D), by the body's name.

    `pressures`: air pressures of the chambers, Pa, by the chamber's name.
    """
    forces: dict[str, Array] = {}
    for name, air in airs.items():
        for body, reaction in air.reaction.items():
            forces[body] = forces.get(body, 0.0) + pressures[name] * reaction
    return forces


def water_line(
    airs: Mapping[str, AirCoupling],
    responses: Mapping[str, Response],
    couplings: tuple[BodiesCoupling, ...],
    flows: Mapping[str, Scalar],
    before: Mapping[str, Scalar],
    dt: Scalar,
) -> WaterLine:
    """Flows out of the chambers over a step of dt (s), from the responses of water and bodies to the air.

    **Arguments**: `flows`: flows out of the chambers at the step's end if the chambers have the pressures
    `before` (Pa), m3/s (m2/s in 2-D).
    """
    compliance = {}
    for b in airs:
        u = airs[b].push(responses[b].u, dt)
        bodies = velocity_changes(couplings, responses[b].pressures.accelerations, dt)
        compliance |= {(a, b): -air.flow(u, bodies) for a, air in airs.items()}
    limited = jnp.zeros_like(dt)
    for a, air in airs.items():
        found, least = compliance[a, a], LEAST * dt * air.mobility()
        held = jnp.sum(air.index < len(responses[a].u))
        limited = limited + jnp.where(found < least, held, 0).astype(dt.dtype)
        compliance[a, a] = jnp.maximum(found, least)
    unpressed = {a: flows[a] + sum(compliance[a, b] * before[b] for b in airs) for a in airs}
    return WaterLine(unpressed, compliance, limited)


def meet_laws(model: Model, parts: Mapping[str, Any], line: WaterLine, interval: Interval) -> Met:
    """Air of every chamber and duct that satisfies both its law and the flow that the water allows.

    `parts`: states of the parts at the start of the step.
    """
    if not model.chambers:
        return Met({}, {})
    laws = _Laws(model, parts, line, interval.t, interval.dt)
    unknown = laws.begin()
    if len(unknown) > 1:  # for a single chamber the first value is the solution
        unknown = jax.lax.fori_loop(0, NEWTON, lambda _, x: laws.nearer(x), unknown)
    return laws.met(unknown)


class CorrectedForAir(NamedTuple):
    """Water and bodies after a step's air pressures have replaced the air pressures of the previous step."""

    met: Met
    """Air of chambers and ducts."""
    pressures: Pressures
    """Pressures of water and ghosts, and accelerations of the bodies."""
    u: Float[Array, "N D"]
    """Velocities of the water at the step's end, m/s."""
    pressed: Float[Array, "N D"]
    """Change of the velocities due to the change of the water pressure, m/s."""
    flows: dict[str, Scalar]
    """Flows out of the chambers at the step's end, m3/s (m2/s in 2-D)."""
    on_bodies: dict[str, Float[Array, " V"]]
    """Forces of the air on the bodies, N, N m (per metre in 2-D)."""
    limited: Scalar
    """See `WaterLine.limited`."""


@Part.AIR.scope()
def correct_for_air(
    model: Model,
    airs: Mapping[str, AirCoupling],
    responses: Mapping[str, Response],
    interval: Interval,
    couplings: tuple[BodiesCoupling, ...],
    started: Mapping[str, Float[Array, " V"]],
    pressures: Pressures,
    u: Float[Array, "N D"],
) -> CorrectedForAir:
    """Corrects a step, computed with the previous step's air pressures, so that the air satisfies its laws.

    **Arguments**: `started`: velocities of the bodies by name before the step's forces act, m/s, rad/s;
    `pressures` and velocities u (m/s) of the water with the air pressures of the previous step.
    """
    dt, before = interval.dt, {name: interval.before[name].P_a for name in airs}

    def flows(u: Float[Array, "N D"], pressures: Pressures) -> dict[str, Scalar]:
        changes = velocity_changes(couplings, pressures.accelerations, dt)
        moving = {name: started[name] + change for name, change in changes.items()}
        return {name: air.flow(u, moving) for name, air in airs.items()}

    line = water_line(airs, responses, couplings, flows(u, pressures), before, dt)
    met, pressed = meet_laws(model, interval.before, line, interval), jnp.zeros_like(u)
    for name, law in met.chambers.items():
        missing, response = law.P_a - before[name], responses[name]
        pressures = pressures.plus(missing, response.pressures)
        pressed = pressed + missing * response.u
        u = airs[name].push(u + missing * response.u, dt * missing)
    forces = on_bodies(airs, {name: law.P_a for name, law in met.chambers.items()})
    return CorrectedForAir(met, pressures, u, pressed, flows(u, pressures), forces, jnp.asarray(line.limited))


class _Laws(NamedTuple):
    """Equations of chambers and ducts that are coupled by the water, with an unknown flow for each.

    The unknown of a chamber is the flow out of the chamber if the pressure of this chamber alone were zero.
    The unknown of a duct is the flow through the duct if the pressure drop were zero, including the response
    of the water in both chambers. As functions of these unknowns, pressure and flow have bounded slopes,
    however steep a law is.
    """

    model: Model
    parts: Mapping[str, Any]
    line: WaterLine
    t: Scalar
    dt: Scalar

    def give(self, between: tuple[str, str]) -> Scalar:
        """Decrease of a duct's flow per unit pressure drop, m3/s/Pa (m2/s/Pa in 2-D), due to the water.

        The water columns at both ends of the duct act in series.
        """
        a, b = (self.line.compliance[end, end] for end in between)
        return a * b / (a + b)

    def begin(self) -> Array:
        """Initial guess of the unknown flows, chambers before ducts, from the air of the previous step."""
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
        """Decrease of a chamber's flow due to the pressures of other chambers (Pa), m3/s (m2/s in 2-D)."""
        held = [self.line.compliance[name, k.name] * P_a[k.name] for k in self.chambers if k.name != name]
        return sum(held, jnp.zeros_like(self.line.flows[name]))

    def met(self, unknown: Array) -> Met:
        """Air of chambers and ducts for given values of the unknown flows."""
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
        """Residuals of the equations, as flows, m3/s (m2/s in 2-D)."""
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
        """Unknown flows after one Newton iteration."""
        slopes = jax.jacfwd(self.missing)(unknown)
        return unknown - jnp.linalg.solve(slopes, self.missing(unknown))


def _ways(model: Model, chamber: str) -> list[tuple[str, float]]:
    """Names of a chamber's ducts, each with 1 if a positive flow in the duct leaves the chamber, else -1."""
    return [
        (duct.name, way)
        for duct in model.ducts
        for end, way in zip(duct.between, (1.0, -1.0), strict=True)
        if end == chamber
    ]


@Part.AIR.scope()
def finish_airs(
    model: Model,
    parts: Mapping[str, Any],
    met: Met,
    flows: Mapping[str, tuple[Scalar, Scalar]],
    dt: Scalar,
) -> tuple[dict[str, Air], dict[str, Scalar]]:
    """Air of chambers and ducts at a step's end, and energies (J, J/m in 2-D) taken from the water, by name.

    `flows`: flows out of every chamber at the start and the end of the step, m3/s (m2/s in 2-D), from the
    step's couplings.
    """
    airs, taken = {}, {}
    work = {duct.name: jnp.zeros_like(dt) for duct in model.ducts}
    for chamber in model.chambers:
        name, ways = chamber.name, _ways(model, chamber.name)
        airs[name], amounts, given = chamber.finish(parts[name], met.chambers[name], *flows[name], dt)
        taken |= amounts
        # in a closed chamber the mean flow into the ducts over the step differs from the flow at the end of
        # the step; divide the difference equally among the ducts
        off = (given.flow - met.chambers[name].ducted) / max(len(ways), 1)
        for duct, way in ways:
            work[duct] = work[duct] + dt * given.head * (way * met.ducts[duct].passed + off)
    for duct in model.ducts:
        airs[duct.name], amounts = duct.finish(parts[duct.name], met.ducts[duct.name], work[duct.name], dt)
        taken |= amounts
    return airs, taken
