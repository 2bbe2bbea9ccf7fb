"""Border between a flume of coarse particles and a zone of fine particles, which overlap and drive each
other.

Each zone is a tank of its own with particles of one size. The zones overlap by a length of about one depth.
At its edge inside the other zone, a zone ends in a flexible vertical wall that moves with the other zone's
horizontal velocity, so that waves pass the border in both directions. A difference between the elevations of
the two zones leaves a zone through its edge like a wave through an absorbing paddle:

    U(z) = u_other(z) -+ b g/c (eta_own - eta_other),

with the upper sign at a zone's near end and b = 1 for full absorption. Otherwise the difference would slosh
in the overlap, where nothing else damps it. Overlapping zones that exchange velocities are a Schwarz method
for the pressure; an error of the exchange decays over the overlap like exp(-pi L/(2 d)).
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Int, Scalar, columns
from jaxsph.core.native.forms import true_indices
from jaxsph.core.parts import Part
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Entry, Exchange, Reading
from jaxsph.model.state import Particles, State
from jaxsph.parts.paddle import AbstractPaddle, column_depth

__all__ = [
    "Border",
    "BorderState",
    "Edge",
    "EdgeMotion",
    "FlumeEnd",
    "flume_of",
    "flumes",
    "with_flume",
    "zones",
]

FAR_END = "far_end"
"""Name of the flume's flexible end in the flume's model."""
REACH = 3.0
"""Radius within which particles contribute to a velocity at the edge, in widths of the Gaussian weight."""
WET = 0.6
"""Least part of the full sum of weights at which a height counts as under water (-)."""


class Water(eqx.Module):
    """Water of the other zone at an edge."""

    u: Float[Array, " K"]
    """Horizontal velocities at the edge's heights, m/s."""
    w: Float[Array, " K"]
    """Vertical velocities, m/s."""
    eta: Scalar
    """Elevation at the edge's gauge, m."""


class EdgeMotion(eqx.Module):
    """Motion of a zone's flexible edge, and the water of the other zone that the edge follows."""

    X: Float[Array, " K"]
    """Displacements from rest at the edge's heights, m."""
    U: Float[Array, " K"]
    """Velocities, m/s."""
    slow: Float[Array, " K"]
    """Slowly varying mean of the displacements, m."""
    water: Water
    """Water of the other zone, which the edge follows."""


class Edge(eqx.Module):
    """Flexible vertical edge of a zone: where it measures the water, and how it follows the other zone."""

    face: Scalar
    """Position x of the edge at rest, m."""
    heights: Float[Array, " K"]
    """Heights above the bed at which the edge's displacement is known, m; it is linear between them."""
    width: Scalar
    """Width of the Gaussian weight with which velocities are measured, m."""
    gauge: Scalar
    """Position x at which the elevations of both zones are measured, m."""
    bell: Scalar
    """Half-width of the column of water that such a gauge measures, m."""
    own_still: Scalar
    """Depth that the gauge reads in the edge's own zone in still water, m."""
    other_still: Scalar
    """Depth that the gauge reads in the other zone in still water, m."""
    gain: Scalar
    """Velocity of the edge per metre of difference between the elevations, b g/c, 1/s."""
    drift: Scalar
    """Rate at which `EdgeMotion.slow` follows the displacements, 1/s. The edge straightens at a quarter of
    this rate, because the waves' drift would otherwise shear it without end."""
    most: int = eqx.field(static=True)
    """Largest number of the other zone's particles near the edge."""
    side: float = eqx.field(static=True)
    """Direction from the edge into its own zone: 1 along x, -1 against x."""

    def start(self) -> EdgeMotion:
        """Motion of the edge at rest."""
        zero = jnp.zeros_like(self.heights)
        return EdgeMotion(zero, zero, zero, Water(zero, zero, jnp.zeros_like(self.face)))

    def depth(self, water: Particles, V: Float[Array, " N"]) -> Scalar:
        """Depth of water at the edge's gauge, m, from particles with the volumes V (m2)."""
        return column_depth(columns(water.x), V, self.gauge, self.bell)

    def seen(self, motion: EdgeMotion, other: Particles, V: Float[Array, " N"]) -> Water:
        """The other zone's water at the edge; `V`: volumes of its particles, m2."""
        at = columns(jnp.stack([self.face + motion.X, self.heights], axis=1))
        reach, n = REACH * self.width, len(other.x)
        near = (other.x[:, 0] > jnp.min(at[0]) - reach) & (other.x[:, 0] < jnp.max(at[0]) + reach)
        rows = jnp.minimum(true_indices(near, self.most), n - 1)
        there = jnp.arange(self.most) < jnp.sum(near)
        chosen = jax.tree.map(lambda a: a[rows], (columns(other.x), other.u, jnp.where(near, V, 0.0)))
        x, u, V_near = chosen
        found = _velocity(x, u, jnp.where(there, V_near, 0.0), at, self.width)
        # too many particles would be counted in part: the run must stop
        found = jnp.where(jnp.sum(near) > self.most, jnp.nan, found)
        return Water(found[:, 0], found[:, 1], self.depth(other, V) - self.other_still)

    def moved(self, motion: EdgeMotion, water: Particles, V: Float[Array, " N"], dt: Scalar) -> EdgeMotion:
        """Motion at the end of a step of dt (s); `water`, `V`: the edge's own zone, volumes in m2.

        The edge is a line of the same water, X_t = U - w X_z: waves lift an edge that leans.
        """
        other = motion.water
        higher = self.depth(water, V) - self.own_still - other.eta
        # the mean over waves, because straightening within a wave would do work on it
        slow = motion.slow + dt * self.drift * (motion.X - motion.slow)
        straightening = 0.25 * self.drift * (slow - jnp.mean(slow))
        U = other.u - self.side * self.gain * higher - straightening
        lifted = jnp.interp(self.heights - dt * other.w, self.heights, motion.X)
        return EdgeMotion(lifted + 0.5 * dt * (motion.U + U), U, slow, other)

    def displacement(self, motion: EdgeMotion) -> Scalar:
        """Mean displacement, weighted with still water's pressure, m: its work is rho g d^2/2 times this."""
        weight = jnp.maximum(self.own_still - self.heights, 0.0)
        return jnp.sum(weight * motion.X) / jnp.sum(weight)

    def beside(self, values: Float[Array, " K"], x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Values at the edge beside points x (m), linear between the edge's heights."""
        return jnp.interp(x[:, -1], self.heights, values)


def _velocity(
    x: Components, u: Float[Array, "N D"], V: Float[Array, " N"], at: Components, width: Scalar
) -> Float[Array, "K D"]:
    """Velocities (m/s) of water at the points `at` (m), exact if they are linear in x.

    **Arguments**: positions x (m), velocities u (m/s) and volumes V (m2) of the particles.

    A plane is fitted with a Gaussian weight of the given `width` (m), which has no error in the interior of
    irrotational flow, where velocities are harmonic. Points above the surface have the velocity of the
    highest wet point.
    """
    away = [(x[None] - a[:, None]) / width for x, a in zip(x, at, strict=True)]
    r2 = sum(a * a for a in away)
    weight = jnp.where(r2 < REACH**2, jnp.exp(-r2), 0.0) * V
    terms = jnp.stack([jnp.ones_like(r2), *away])
    weighted = terms * weight
    moments = jnp.einsum("akn,bkn->kab", weighted, terms)
    right = jnp.moveaxis(weighted @ u, 0, 1)
    full = moments[:, 0, 0]
    firm = 1e-6 * full[:, None, None] + 1e-6 * width**2
    fit = jnp.linalg.solve(moments + firm * jnp.eye(len(terms)), right)[:, 0]
    wet = full > WET * jnp.pi * width**2
    top = jnp.max(jnp.where(wet, jnp.arange(len(full)), 0))
    return fit[jnp.minimum(jnp.arange(len(full)), top)]


class AbstractEdgeWall(AbstractPaddle):
    """Flexible wall at the edge of a zone, which moves with the water of the other zone."""

    edge: eqx.AbstractVar[Edge]
    """Edge of the zone."""

    @abc.abstractmethod
    def line(self, motion: Any) -> EdgeMotion:
        """Motion of the edge in a state of the wall."""

    @abc.abstractmethod
    def with_line(self, motion: Any, line: EdgeMotion) -> Any:
        """State of the wall with another motion of the edge."""

    def outline(self, far):
        """See `AbstractSolid`: nothing, since water is on both sides."""
        del far
        return np.zeros((0, 2))

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        old, X = self.line(old), 0.5 * (self.line(old).X + self.line(new).X)
        return self.with_line(new, dataclasses.replace(old, X=X))

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        old, new = self.line(motion), self.line(after)
        return self.with_line(after, dataclasses.replace(old, U=new.U, water=new.water))

    def shift(self, motion, x):
        """See `AbstractPaddle`."""
        return self.edge.beside(self.line(motion).X, x)

    def speed(self, motion, x):
        """See `AbstractPaddle`."""
        return self.edge.beside(self.line(motion).U, x)

    def velocity(self, motion, x):
        """See `AbstractMovingSolid`: also along the edge, which leans, so that the pressure does work."""
        line = self.line(motion)
        return jnp.stack([self.edge.beside(a, x) for a in (line.U, line.water.w)], axis=1)


class FlumeEnd(AbstractEdgeWall):
    """Flexible far end of the flume, which moves with the fine zone's water."""

    side: ClassVar[float] = -1.0
    edge: Edge
    rows: tuple[int, int] = eqx.field(static=True)
    face: float = eqx.field(static=True, kw_only=True)
    name: str = eqx.field(static=True, default=FAR_END, kw_only=True)

    def start(self, dtype: Any) -> EdgeMotion:
        """See `AbstractMovingSolid`."""
        del dtype
        return self.edge.start()

    def line(self, motion):
        """See `AbstractEdgeWall`."""
        return motion

    def with_line(self, motion, line):
        """See `AbstractEdgeWall`."""
        del motion
        return line

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry("work of the fine zone's water on the flume's", Exchange.GIVEN)}

    def readings(self, dim):
        """See `AbstractPart`."""
        (reading,) = super().readings(dim).values()
        return {self.name: reading._replace(long_name="displacement of the flume's far end")}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        return {self.name: self.edge.displacement(state)}

    def move(self, motion, water, depth_volume, t, dt):
        """See `AbstractWall`."""
        del t
        return self.edge.moved(motion, water, depth_volume, dt)


class BorderState(eqx.Module):
    """State of the border: the edge of the fine zone, and the flume in front of it."""

    edge: EdgeMotion
    """Motion of the fine zone's edge."""
    flume: State
    """State of the flume at the end of its present step."""
    before: Water
    """Water of the flume at the edge, at the start of this step."""
    after: Water
    """The same at the end of this step."""
    behind: Water
    """Water of the fine zone at the flume's end, at the start of this step."""
    count: Int[Array, ""]
    """Number of the fine zone's steps since the start of the flume's step."""


class Border(AbstractEdgeWall):
    """Near end of the fine zone: a flexible wall that moves with the water of a flume, which it advances."""

    edge: Edge
    flume: Model
    """Model of the flume, with a `FlumeEnd` and, in waves, a wavemaker."""
    first: State
    """State of the flume at t = 0."""
    rows: tuple[int, int] = eqx.field(static=True)
    ratio: int = eqx.field(static=True)
    """Ratio of the flume's time step to the fine zone's, a whole number."""
    face: float = eqx.field(static=True, kw_only=True)
    name: str = eqx.field(static=True, default="border", kw_only=True)

    def start(self, dtype: Any) -> BorderState:
        """See `AbstractMovingSolid`."""
        del dtype
        still = self.edge.start()
        water = still.water
        return BorderState(still, self.first, water, water, water, jnp.asarray(self.ratio, jnp.int32))

    def line(self, motion):
        """See `AbstractEdgeWall`."""
        return motion.edge

    def with_line(self, motion, line):
        """See `AbstractEdgeWall`."""
        return dataclasses.replace(motion, edge=line)

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry("work of the flume's water on the fine zone's", Exchange.GIVEN)}

    def pose(self, motion):
        """See `AbstractMovingSolid`: the mean displacement over the height."""
        X = jnp.mean(motion.edge.X)
        return jnp.stack([X, 0.0 * X, 0.0 * X]), jnp.zeros(2)

    def _ends(self) -> tuple[AbstractPaddle, ...]:
        return tuple(wall for wall in self.flume.moving if isinstance(wall, AbstractPaddle))

    def readings(self, dim):
        """See `AbstractPart`."""
        found = {self.name: Reading("m", "displacement of the border, weighted with still water's pressure")}
        for end in self._ends():
            found |= end.readings(dim)
            what = (
                f"power that the {end.name.replace('_', ' ')} gives to the flume, mean since the last sample"
            )
            found[f"flume_{end.name}"] = Reading("W m-1", what)
        return found

    def read(self, state, sampled):
        """See `AbstractPart`."""
        found = {self.name: self.edge.displacement(state.edge)}
        for end in self._ends():
            found |= end.read(state.flume.parts[end.name], sampled)
            found[f"flume_{end.name}"] = state.flume.ledger[end.name].recent / sampled.interval
        return found

    def move(self, motion, water, depth_volume, t, dt):
        """See `AbstractWall`. When the fine zone reaches the end of the flume's step, the flume makes its
        next step, driven by the fine zone's present water."""
        del t
        due = motion.count >= self.ratio

        def advanced(m: BorderState) -> BorderState:
            return self._advanced(m, water, depth_volume)

        motion = jax.lax.cond(due, advanced, lambda m: m, motion)
        share = motion.count.astype(dt.dtype) / self.ratio
        # velocities at the end of this step, and the elevation at its start, when the edge's own is known
        other = _between(motion.before, motion.after, share + 1.0 / self.ratio, share)
        edge = dataclasses.replace(motion.edge, water=other)
        edge = self.edge.moved(edge, water, depth_volume, dt)
        return BorderState(edge, motion.flume, motion.before, motion.after, motion.behind, motion.count + 1)

    @Part.WALLS.scope()
    def _advanced(self, motion: BorderState, water: Particles, V: Float[Array, " N"]) -> BorderState:
        """The border after a step of the flume."""
        model, scheme = self.flume, self.flume.scheme
        flume, tables = scheme.prepare(model, motion.flume)
        flume = scheme.regularise(model, flume, tables)
        end = next(wall for wall in model.moving if isinstance(wall, FlumeEnd))
        own = flume.parts[end.name]
        # The end moves with the water's velocity at the end of the step. A velocity that lags by a step would
        # do work on standing waves, whose pressure and velocity are a quarter of a period apart.
        behind = end.edge.seen(own, water, V)
        ahead = _between(motion.behind, behind, 2.0, 1.0)
        flume = eqx.tree_at(lambda s: s.parts[end.name].water, flume, ahead)

        def seen(flume: State) -> Water:
            return self.edge.seen(motion.edge, flume.particles, scheme.volume(flume.particles))

        before, flume = seen(flume), model.step(flume, tables)
        return BorderState(motion.edge, flume, before, seen(flume), behind, jnp.zeros_like(motion.count))


def _between(old: Water, new: Water, share: Any, share_of_eta: Any) -> Water:
    """Water at these shares (-) of the time from `old` to `new`, which also extrapolate."""
    shares = Water(share, share, share_of_eta)
    return jax.tree.map(lambda a, b, s: a + s * (b - a), old, new, shares)


def flumes(model: Model) -> tuple[Border, ...]:
    """Borders of a model: one if the model has a flume, none otherwise."""
    return tuple(wall for wall in model.moving if isinstance(wall, Border))


def flume_of(model: Model, state: State) -> tuple[Model, State]:
    """Model of the flume, and its state within a state of the whole model."""
    (border,) = flumes(model)
    return border.flume, state.parts[border.name].flume


def zones(model: Model, state: State) -> tuple[tuple[Model, State], ...]:
    """The model and its state, and those of its flume, if it has one."""
    return (model, state), *(flume_of(model, state) for _ in flumes(model))


def with_flume(model: Model, flume: Model) -> Model:
    """The model with another model of its flume."""
    (border,) = flumes(model)
    changed = dataclasses.replace(border, flume=flume)
    moving = tuple(changed if wall is border else wall for wall in model.moving)
    return eqx.tree_at(lambda m: m.moving, model, moving)
