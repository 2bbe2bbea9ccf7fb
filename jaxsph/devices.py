"""What acts on the water or is acted on by it: the piston wavemaker, the OWC chamber and its PTO.

Signs (in everything here): `P_a` is the gauge pressure of the chamber's air, positive when compressed;
`q` is the volume flow of air out of the chamber, positive when the water column rises; the PTO takes
P_a q from the water, which is never negative.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph import laws
from jaxsph._typing import Array, Components, Float, Int, Scalar, columns, dot, stacked
from jaxsph.pairs import Smoothing, pair_sum
from jaxsph.state import AbstractPTO, Particles
from jaxsph.waves import ActiveAbsorption, RegularWaves

__all__ = ["Chamber", "PhasedPTO", "PneumaticPTO", "PrescribedPressure", "Wavemaker", "column_depth"]


class PneumaticPTO(AbstractPTO):
    """Quadratic turbine or slot, P_a = K_dm^2 |q| q (Zhu et al. 2020, Eq. 13 with the signs above).

    The law is solved together with the water's own response over the step, q = q_free - compliance P_a,
    which has a closed form: so it is stable for every K_dm >= 0, exactly dissipative, smooth in K_dm, and
    tends to a closed chamber (q = 0) as K_dm grows.
    """

    K_dm: Scalar
    """Damping coefficient, kg^0.5 m^-2.5 (flow per unit width)."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del t
        # The root needs a positive argument for a finite derivative at q = 0: 1e-12 m2/s is no flow.
        size = jnp.abs(q_free) + 1e-12
        root = jnp.sqrt(1.0 + 4.0 * compliance * self.K_dm**2 * size)
        scaled = 2.0 * self.K_dm / (1.0 + root)  # first the ratio: K_dm^2 may be huge, this is not
        return scaled**2 * size * q_free


class PhasedPTO(AbstractPTO):
    """A quadratic turbine whose damping follows the waves' phase, by Fourier coefficients of its logarithm:

        ln(K_dm(t)/K_dm) = sum_n a_n cos(n omega t) + b_n sin(n omega t).

    It stays positive, so the turbine never drives the water.
    """

    K_dm: Scalar
    """Geometric mean of the damping over a wave period, kg^0.5 m^-2.5."""
    phase: Float[Array, " 2n"]
    """a_1, b_1, a_2, b_2, ..."""
    omega: Scalar
    """Angular frequency of the waves, rad/s."""

    def damping(self, t: Scalar) -> Scalar:
        """K_dm at the time t (s)."""
        n = 1 + jnp.arange(self.phase.shape[0] // 2)
        angle = n * self.omega * t
        a, b = self.phase[::2], self.phase[1::2]
        return self.K_dm * jnp.exp(jnp.sum(a * jnp.cos(angle) + b * jnp.sin(angle)))

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        return PneumaticPTO(self.damping(t)).pressure(q_free, compliance, t)


class PrescribedPressure(AbstractPTO):
    """Air pressure as a given function of time: P_a, reached within `ramp` seconds."""

    P_a: Scalar
    ramp: Scalar

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del q_free, compliance
        return self.P_a * jnp.clip(t / jnp.maximum(self.ramp, 1e-6), 0.0, 1.0)


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


class Wavemaker(eqx.Module):
    """A piston that makes regular waves, with or without active absorption (Eq. 22-23)."""

    waves: RegularWaves
    absorption: ActiveAbsorption | None
    gauge: Scalar
    """Distance (m) from the paddle's face at which the elevation is measured for absorption."""
    still: Scalar
    """Depth (m) that the gauge reads in still water."""

    def move(self, paddle: Float[Array, "4"], t: Scalar, dt: Scalar, elevation: Scalar) -> Float[Array, "4"]:
        """`State.paddle` at t + dt; `elevation` (m) is read at t."""
        if self.absorption is None:
            X, U = self.waves.paddle_displacement(t + dt), self.waves.paddle_velocity(t + dt)
            return jnp.stack([X, U, jnp.zeros_like(X), jnp.zeros_like(X)])
        # The filter makes up for the gauge standing in front of the paddle, and takes out its noise.
        expected = self.absorption.gauge_elevation(self.waves, t)
        lag = self.absorption.filter_time(self.waves)
        error = paddle[2] + dt / (lag + dt) * (expected - elevation - paddle[2])
        # Standing waves lower the mean level by a fraction of a millimetre: nothing to absorb, and the
        # paddle would creep for it.
        mean = paddle[3] + dt * self.absorption.drift_rate * (error - paddle[3])
        eta = self.absorption.gauge_elevation(self.waves, t + dt) - (error - mean)
        U = self.absorption.velocity(self.waves, paddle[0], t + dt, eta)
        return jnp.stack([paddle[0] + dt * U, U, error, mean])

    def elevation(self, x: Components, V: Float[Array, " N"], paddle: jax.Array, width: Scalar):
        """Elevation (m) at the gauge, over still water; V: volumes per metre of the tank's width, m2."""
        return column_depth(x, V, paddle[0] + self.gauge, width) - self.still


def column_depth(x: Components, V: Float[Array, " N"], at: Scalar, width: Scalar) -> Scalar:
    """Depth of water (m) at x = `at`: the volume of a column, averaged over a width.

    A cosine bell of half-width `width` weighs the particles, which is smooth in their positions and
    conserves volume. With a whole number of spacings as `width` a lattice reads the same wherever the
    gauge stands on it. A wave of wavenumber k is damped by 0.065 (k width)^2: 0.1 % at k width = 0.12.
    """
    s = (x[0] - at) / width
    bell = jnp.where(jnp.abs(s) < 1.0, 0.5 * (1.0 + jnp.cos(jnp.pi * s)), 0.0) / width
    return jnp.sum(V * bell)
