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


class EdgeMotion(eqx.Module):
    """Motion of a zone's flexible edge, and the water of the other zone that the edge follows."""

    X: Float[Array, " K"]
    """Displacements from rest at the edge's heights, m."""
    U: Float[Array, " K"]
    """Velocities, m/s."""
    slow: Float[Array, " K"]
    """Slowly varying mean of the displacements, m."""
    u: Float[Array, " K"]
    """Horizontal velocities of the other zone's water at the edge, m/s."""
    eta: Scalar
    """Elevation of the other zone's water beside the edge, m."""


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
        return EdgeMotion(zero, zero, zero, zero, jnp.zeros_like(self.face))

    def depth(self, water: Particles, V: Float[Array, " N"]) -> Scalar:
        """Depth of water at the edge's gauge, m, from particles with the volumes V (m2)."""
        return column_depth(columns(water.x), V, self.gauge, self.bell)

    def seen(
        self, motion: EdgeMotion, other: Particles, V: Float[Array, " N"]
    ) -> tuple[Float[Array, " K"], Scalar]:
        """Horizontal velocities (m/s) of the other zone's water at the edge, and its elevation (m) there.

        `V`: volumes of the other zone's particles, m2.
        """
        at = columns(jnp.stack([self.face + motion.X, self.heights], axis=1))
        reach, n = REACH * self.width, len(other.x)
        near = (other.x[:, 0] > jnp.min(at[0]) - reach) & (other.x[:, 0] < jnp.max(at[0]) + reach)
        rows = jnp.minimum(true_indices(near, self.most), n - 1)
        there = jnp.arange(self.most) < jnp.sum(near)
        chosen = jax.tree.map(lambda a: a[rows], (columns(other.x), other.u[:, 0], jnp.where(near, V, 0.0)))
        x, u, V_near = chosen
        found = _velocity(x, u, jnp.where(there, V_near, 0.0), at, self.width)
        # too many particles would be counted in part: the run must stop
        found = jnp.where(jnp.sum(near) > self.most, jnp.nan, found)
        return found, self.depth(other, V) - self.other_still

    def following(self, motion: EdgeMotion, u: Float[Array, " K"], eta: Scalar) -> EdgeMotion:
        """The motion with other velocities u (m/s) and another elevation eta (m) to follow."""
        return dataclasses.replace(motion, u=u, eta=eta)

    def moved(self, motion: EdgeMotion, water: Particles, V: Float[Array, " N"], dt: Scalar) -> EdgeMotion:
        """Motion at the end of a step of dt (s); `water`, `V`: the edge's own zone, volumes in m2."""
        higher = self.depth(water, V) - self.own_still - motion.eta
        # the mean over waves, because straightening within a wave would do work on it
        slow = motion.slow + dt * self.drift * (motion.X - motion.slow)
        straightening = 0.25 * self.drift * (slow - jnp.mean(slow))
        U = motion.u - self.side * self.gain * higher - straightening
        return EdgeMotion(motion.X + 0.5 * dt * (motion.U + U), U, slow, motion.u, motion.eta)

    def displacement(self, motion: EdgeMotion) -> Scalar:
        """Mean displacement, weighted with still water's pressure, m: its work is rho g d^2/2 times this."""
        weight = jnp.maximum(self.own_still - self.heights, 0.0)
        return jnp.sum(weight * motion.X) / jnp.sum(weight)

    def beside(self, values: Float[Array, " K"], x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Values at the edge beside points x (m), linear between the edge's heights."""
        return jnp.interp(x[:, -1], self.heights, values)


def _velocity(
    x: Components, u: Float[Array, " N"], V: Float[Array, " N"], at: Components, width: Scalar
) -> Float[Array, " K"]:
    """Horizontal velocity (m/s) of water at the points `at` (m), exact for a linear velocity.

    **Arguments**: positions x (m), horizontal velocities u (m/s) and volumes V (m2) of the particles.

    A plane is fitted with a Gaussian weight of the given `width` (m), which has no error in the interior of
    irrotational flow, where velocities are harmonic. Points above the surface have the velocity of the
    highest wet point.
    """
    away = [(x[None] - a[:, None]) / width for x, a in zip(x, at, strict=True)]
    r2 = sum(a * a for a in away)
    weight = jnp.where(r2 < REACH**2, jnp.exp(-r2), 0.0) * V
    terms = jnp.stack([jnp.ones_like(r2), *away])
    weighted = terms * weight
    moments, right = jnp.einsum("akn,bkn->kab", weighted, terms), weighted @ u
    full = moments[:, 0, 0]
    firm = 1e-6 * full[:, None, None] + 1e-6 * width**2
    fit = jnp.linalg.solve(moments + firm * jnp.eye(len(terms)), right.T[..., None])[:, 0, 0]
    wet = full > WET * jnp.pi * width**2
    top = jnp.max(jnp.where(wet, jnp.arange(len(full)), 0))
    return fit[jnp.minimum(jnp.arange(len(full)), top)]


class FlumeEnd(AbstractPaddle):
    """Flexible far end of the flume, which moves with the fine zone's water."""

    side: ClassVar[float] = -1.0
    edge: Edge
    """Edge of the flume."""
    rows: tuple[int, int] = eqx.field(static=True)
    face: float = eqx.field(static=True, kw_only=True)
    name: str = eqx.field(static=True, default=FAR_END, kw_only=True)

    def start(self, dtype: Any) -> EdgeMotion:
        """See `AbstractMovingSolid`."""
        del dtype
        return self.edge.start()

    def outline(self, far):
        """See `AbstractSolid`: nothing, since water is on both sides."""
        del far
        return np.zeros((0, 2))

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

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        return dataclasses.replace(old, X=0.5 * (old.X + new.X))

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        return dataclasses.replace(motion, U=after.U)

    def shift(self, motion, x):
        """See `AbstractPaddle`."""
        return self.edge.beside(motion.X, x)

    def speed(self, motion, x):
        """See `AbstractPaddle`."""
        return self.edge.beside(motion.U, x)


class BorderState(eqx.Module):
    """State of the border: the edge of the fine zone, and the flume in front of it."""

    edge: EdgeMotion
    """Motion of the fine zone's edge."""
    flume: State
    """State of the flume at the end of its present step."""
    before: tuple[Float[Array, " K"], Scalar]
    """Velocities (m/s) and elevation (m) of the flume's water at the edge, at the start of this step."""
    after: tuple[Float[Array, " K"], Scalar]
    """The same at the end of this step."""
    behind: tuple[Float[Array, " K"], Scalar]
    """Velocities (m/s) and elevation (m) of the fine zone's water at the flume's end, at the start of this
    step."""
    count: Int[Array, ""]
    """Number of the fine zone's steps since the start of the flume's step."""


class Border(AbstractPaddle):
    """Near end of the fine zone: a flexible wall that moves with the water of a flume, which it advances."""

    edge: Edge
    """Edge of the fine zone."""
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
        water = (still.u, still.eta)
        return BorderState(still, self.first, water, water, water, jnp.asarray(self.ratio, jnp.int32))

    def outline(self, far):
        """See `AbstractSolid`: nothing, since water is on both sides."""
        del far
        return np.zeros((0, 2))

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
        (u0, eta0), (u1, eta1) = motion.before, motion.after
        share = motion.count.astype(dt.dtype) / self.ratio
        # velocities at the end of this step, and the elevation at its start, when the edge's own is known
        u, eta = u0 + (share + 1.0 / self.ratio) * (u1 - u0), eta0 + share * (eta1 - eta0)
        edge = self.edge.moved(self.edge.following(motion.edge, u, eta), water, depth_volume, dt)
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
        ahead = 2.0 * behind[0] - motion.behind[0]
        flume = eqx.tree_at(lambda s: s.parts[end.name], flume, end.edge.following(own, ahead, behind[1]))

        def seen(flume: State) -> tuple[Float[Array, " K"], Scalar]:
            return self.edge.seen(motion.edge, flume.particles, scheme.volume(flume.particles))

        before, flume = seen(flume), model.step(flume, tables)
        return BorderState(motion.edge, flume, before, seen(flume), behind, jnp.zeros_like(motion.count))

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        return dataclasses.replace(new, edge=dataclasses.replace(old.edge, X=0.5 * (old.edge.X + new.edge.X)))

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        return dataclasses.replace(after, edge=dataclasses.replace(motion.edge, U=after.edge.U))

    def shift(self, motion, x):
        """See `AbstractPaddle`."""
        return self.edge.beside(motion.edge.X, x)

    def speed(self, motion, x):
        """See `AbstractPaddle`."""
        return self.edge.beside(motion.edge.U, x)


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
