"""What acts on the water or is acted on by it: the piston wavemaker, the OWC chamber and its PTO.

Signs (in everything here): `P_a` is the gauge pressure of the chamber's air, positive when compressed;
`q` is the volume flow of air out of the chamber, positive when the water column rises; the PTO takes
P_a q from the water, which is never negative.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Int, Scalar, columns, dot, stacked
from jaxsph.core.pairs import Smoothing, pair_sum
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractPTO
from jaxsph.model.state import Particles


class Chamber(eqx.Module):
    """The water column under trapped air, and the power take-off that the air drives.

    The surface condition p = P_a enters the pressure gradient as (p_j - P_a chi_i) + (p_i - P_a chi_i),
    with a smooth weight chi of position that is 1 in the column and fades to 0 above the wall's tip. The
    constant drops out where the kernel is full and acts at the surface, so no particle has to be called
    a surface particle (a switch, in Eq. 15-16), and suction in the air puts no tension in the column.

    The flow is the matching sum, q = -2 sum_i chi_i V_i u_i.(sum_j grad W_ij V_j): the volume flux
    through the fading zone, averaged over it. With it P_a q is exactly the power that the air's force
    takes from the particles.
    """

    pto: AbstractPTO
    x0: Scalar
    """Inner face of the front wall, m."""
    x1: Scalar
    """Back wall, m."""
    fade_low: Scalar
    fade_high: Scalar
    """chi rises from 0 to 1 between these levels, m."""
    still: Scalar
    """Still water level, m."""

    @property
    def length(self) -> Scalar:
        """Chamber length, m."""
        return self.x1 - self.x0

    def weight(self, x: Components) -> Float[Array, " N"]:
        """chi."""
        s = jnp.clip((x[-1] - self.fade_low) / (self.fade_high - self.fade_low), 0.0, 1.0)
        # A hard cut at the wall's face cuts no particle: none is inside the wall.
        return jnp.where(x[0] > self.x0 - 1e-4, s * s * (3.0 - 2.0 * s), 0.0)

    def candidates(self, x: Float[Array, "N D"], margin: float, capacity: int) -> tuple:
        """Indices of the particles that may be weighted before the next search, and their number."""
        may = (x[:, 0] > self.x0 - margin) & (x[:, -1] > self.fade_low - margin)
        index = jnp.nonzero(may, size=capacity, fill_value=x.shape[0])[0]
        return index.astype(jnp.int32), jnp.sum(may)

    def grip(
        self,
        particles: Particles,
        sources: dict,
        table: Int[Array, "K N"],
        index: Int[Array, " C"],
        smoothing: Smoothing,
    ) -> tuple[Components, Float[Array, " C"]]:
        """(f_i, m_i): force on each candidate per unit of P_a (m2; q = -sum f_i.u_i), and its mass."""
        n = particles.x.shape[0]
        i = jnp.minimum(index, n - 1)
        x = columns(particles.x[i])
        s = pair_sum(laws.surface_vector, smoothing, {"x": x}, sources, table[:, i])
        V = jnp.where(index < n, jnp.abs(sources["V"][i]), 0.0)
        w = 2.0 * self.weight(x) * V
        return tuple(w * c for c in s), particles.m[i]

    def kick(
        self,
        u: Float[Array, "N D"],
        grip: Components,
        m: Float[Array, " C"],
        index: Int[Array, " C"],
        dt: Scalar,
        t: Scalar,
    ) -> tuple[Float[Array, "N D"], Scalar, Scalar, Scalar]:
        """Adds the air's force over dt to velocities that have had every other force.

        Returns the new velocities, P_a, the flow q before and after the kick.
        """
        n = u.shape[0]
        own = columns(u[jnp.minimum(index, n - 1)])
        q_free = -jnp.sum(dot(grip, own))
        compliance = dt * jnp.sum(dot(grip, grip) / m)
        P_a = self.pto.pressure(q_free, compliance, t)
        change = stacked([dt * P_a * c / m for c in grip])
        return u.at[index].add(change, mode="drop"), P_a, q_free, q_free - compliance * P_a

    def volume(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Volume of water in the chamber above the middle of the fading zone, m3 (m2 in 2-D)."""
        level = 0.5 * (self.fade_low + self.fade_high)
        s = jnp.clip((x[-1] - level) / (2.0 * smooth) + 0.5, 0.0, 1.0)
        inside = x[0] > self.x0 - 1e-4
        return jnp.sum(jnp.where(inside, V * s, 0.0))

    def level(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Mean elevation of the chamber's surface over still water, m."""
        bottom = 0.5 * (self.fade_low + self.fade_high)
        return bottom + self.volume(x, V, smooth) / self.length - self.still
