"""Components of a time step: fields of the ghosts, motion of the walls, drift, and the energy ledger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, columns, dot
from jaxsph.core.parts import Part
from jaxsph.core.slabs import Sources
from jaxsph.model import laws
from jaxsph.model.forces import FORCES
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.meaning import Exchange
from jaxsph.model.state import Particles, State, Tables, Tally
from jaxsph.solids.filling import NodeFit

__all__ = [
    "Changes",
    "GhostFields",
    "Interval",
    "at_rest",
    "book",
    "damp",
    "drift",
    "exchanged",
    "force_work",
    "move_walls",
    "wall_work",
]


class GhostFields(NamedTuple):
    """Fields of all ghosts at one time."""

    x: Float[Array, "G D"]
    """Positions, m."""
    nodes: Float[Array, "G D"]
    """Interpolation nodes, m."""
    p: Float[Array, " G"]
    """Gauge pressure, Pa."""
    u: Float[Array, "G D"]
    """Velocity in the continuity equation, m/s."""
    u_shear: Float[Array, "G D"]
    """Velocity in the viscous force, m/s.

    At a no-slip wall this velocity differs from `u`; in the continuity equation it would act like a motion
    of the wall.
    """
    V: Float[Array, " G"]
    """Volume, m3 (m2 in 2-D); zero for a ghost whose node is dry."""
    fit: NodeFit
    """Interpolation coefficients at the nodes."""
    water: Sources
    """Fields of the water, from which the values of the ghosts are interpolated."""

    def seeing(self, tables: Tables, **changed: Any) -> GhostFields:
        """Ghosts interpolated from water with new values of the fields in `changed`, given by name."""
        water = self.water
        for name, field in changed.items():
            water = water.changing(name, field)
        return self._replace(water=tables.fluid.slabs.fetch(water))


class Interval(NamedTuple):
    """Time interval of a step or of a part of a step, and the motion of the walls over the interval."""

    before: Mapping[str, Any]
    """States of the parts by name at the interval's beginning."""
    after: Mapping[str, Any]
    """States of the parts by name, with the moving walls advanced to the interval's end."""
    t: Scalar
    """Time at the interval's beginning, s."""
    dt: Scalar
    """Length of the interval, s."""

    @property
    def middle(self) -> Scalar:
        """Time in the middle of the interval, s."""
        return self.t + 0.5 * self.dt


class Changes(NamedTuple):
    """Velocities at the end of a step, and their changes within the step."""

    u: Float[Array, "N D"]
    """Velocity at the end of the step, m/s."""
    sheared: Float[Array, "N D"]
    """Change of velocity due to viscosity, m/s."""
    pressed: Float[Array, "N D"]
    """Change of velocity due to the pressure, m/s."""
    touched: Float[Array, "N D"]
    """Change of velocity due to contact with solids, m/s."""
    damped: dict[str, Float[Array, "N D"]]
    """Change of velocity due to each damper, by name, m/s."""


def drift(p: Particles, dx: Float[Array, "N D"]) -> Particles:
    """Particles moved by dx (m); the rounding error of x is kept for the next move (Kahan summation)."""
    dx = dx + p.x_carry
    x = p.x + dx
    return eqx.tree_at(lambda a: (a.x, a.x_carry), p, (x, dx - (x - p.x)))


def book(ledger: Mapping[str, Tally], amounts: Mapping[str, Scalar]) -> dict[str, Tally]:
    """Adds the `amounts` of a step, energies (J, J/m in 2-D) or counts of particles, to tallies by name."""
    return {name: tally.add(amounts[name]) if name in amounts else tally for name, tally in ledger.items()}


def force_work(model: Model, before: Particles, after: Particles, interval: Interval) -> dict[str, Scalar]:
    """Energy that the body forces give to the water over an interval, J (J/m in 2-D), by ledger name.

    **Arguments**: the particles `before` and `after` the interval.
    """
    if not model.forces:
        return {}
    x, u = 0.5 * (before.x + after.x), 0.5 * (before.u + after.u)
    given = [f.given(after.m, x, u, interval.middle, interval.dt) for f in model.forces]
    return {FORCES: sum(given, jnp.zeros_like(interval.dt))}


@Part.WALLS.scope()
def move_walls(scheme: AbstractScheme, model: Model, state: State, dt: Scalar) -> Interval:
    """Interval of dt (s) from a state, with the moving walls advanced to its end."""
    V = scheme.volume(state.particles) / model.walls.width
    t = model.time(state)
    moved = {w.name: w.move(state.parts[w.name], state.particles, V, t, dt) for w in model.moving}
    return Interval(state.parts, {**state.parts, **moved}, t, dt)


def at_rest(model: Model, state: State) -> Interval:
    """Interval of one time step from a state, in which the walls keep their positions and velocities."""
    return Interval(state.parts, state.parts, model.time(state), model.dt)


def damp(
    model: Model, p: Particles, u: jax.Array, interval: Interval
) -> tuple[Float[Array, "N D"], dict[str, Float[Array, "N D"]]]:
    """Velocities (m/s) after all dampers have acted for a step, and their changes (m/s) by damper."""
    changes = {}
    for damper in model.dampers:
        damped = damper.damp(p.x, u, interval.t + interval.dt, interval.dt)
        changes[damper.name], u = damped - u, damped
    return u, changes


def exchanged(
    model: Model, p: Particles, mean: Float[Array, "N D"], changes: Mapping[str, Float[Array, "N D"]]
) -> dict[str, Scalar]:
    """Energies (J; J/m in 2-D) exchanged with the dampers, by name.

    The energies are positive if taken from the water. For a damper whose ledger entry is `Exchange.GIVEN`,
    they are positive if given to the water. **Arguments**: `mean`: mean of the velocities (m/s) before and
    after all changes whose energies must add up, including changes that are not due to dampers; `changes`:
    changes of the velocities (m/s) due to each damper.
    """
    found = {}
    for damper in model.dampers:
        gained = jnp.sum(p.m * dot(columns(mean), columns(changes[damper.name])))
        given = damper.entries()[damper.name].exchange is Exchange.GIVEN
        found[damper.name] = gained if given else -gained
    return found


@Part.WALLS.scope()
def wall_work(
    scheme: AbstractScheme,
    model: Model,
    parts: Sequence[Mapping[str, Any]],
    tables: Tables,
    ghosts: GhostFields,
    dt: Scalar,
) -> dict[str, Scalar]:
    """Work of every moving wall on the water in a step of dt (s), by the wall's name, J (J/m in 2-D).

    The work is minus dt times the water's force on the wall times the wall's velocity, the mean of its
    velocities in the given states of the parts.
    """
    work = {}
    for wall in model.moving:
        rows = slice(*wall.rows)
        targets = {"x": columns(ghosts.x[rows]), "p": ghosts.p[rows]}
        table = tables.around[wall.name]
        force = table.sum(laws.pressure_force, scheme.smoothing, targets, ghosts.water)
        velocities = [wall.velocity(one[wall.name], ghosts.x[rows]) for one in parts]
        velocity = sum(velocities, jnp.zeros_like(ghosts.x[rows])) / len(parts)
        work[wall.name] = -dt * jnp.sum(dot(columns(velocity), force) * ghosts.V[rows])
    return work
