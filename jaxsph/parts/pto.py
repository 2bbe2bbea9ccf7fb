"""Power take-offs of a chamber's air: pressure against flow.

Signs: `P_a` is the gauge pressure of a chamber's air, positive when compressed; `q` is the volume flow of air
out of the chamber, positive when the water column rises; the PTO takes the power P_a q from the water, which
for a turbine is never negative.
"""

from __future__ import annotations

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractPTO

__all__ = ["PhasedPTO", "PneumaticPTO", "PrescribedPressure"]


class PneumaticPTO(AbstractPTO):
    """Quadratic turbine or slot, P_a = K_dm^2 |q| q (Zhu et al. 2020, Eq. 13 with the signs above).

    The law is solved in closed form together with the water's own response over the step, q = q_free -
    compliance P_a: so it is stable for every K_dm >= 0, exactly dissipative, smooth in K_dm, and tends to a
    closed chamber (q = 0) as K_dm grows.
    """

    K_dm: Scalar
    """Damping coefficient, kg^0.5 m^-2.5 (flow per unit width)."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del t
        # The root needs a positive argument for a finite derivative at q = 0: 1e-12 m2/s is no flow.
        size = jnp.abs(q_free) + 1e-12
        root = jnp.sqrt(1.0 + 4.0 * compliance * self.K_dm**2 * size)
        scaled = 2.0 * self.K_dm / (1.0 + root)  # the ratio first: it is small where K_dm^2 overflows
        return scaled**2 * size * q_free


class PhasedPTO(AbstractPTO):
    """Quadratic turbine whose damping follows the waves' phase, by Fourier coefficients of its logarithm.

        ln(K_dm(t)/K_dm) = sum_n a_n cos(n omega t) + b_n sin(n omega t).

    It stays positive, so the turbine never drives the water.
    """

    K_dm: Scalar
    """Geometric mean of the damping over a wave period, kg^0.5 m^-2.5."""
    phase: Float[Array, " 2n"]
    """Fourier coefficients a_1, b_1, a_2, b_2, ..."""
    omega: Scalar
    """Angular frequency of the waves, rad/s."""

    def damping(self, t: Scalar) -> Scalar:
        """Damping coefficient K_dm at the time t (s), kg^0.5 m^-2.5."""
        n = 1 + jnp.arange(self.phase.shape[0] // 2)
        angle = n * self.omega * t
        a, b = self.phase[::2], self.phase[1::2]
        return self.K_dm * jnp.exp(jnp.sum(a * jnp.cos(angle) + b * jnp.sin(angle)))

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        return PneumaticPTO(self.damping(t)).pressure(q_free, compliance, t)


class PrescribedPressure(AbstractPTO):
    """Air pressure given as a function of time: a linear rise to P_a, which then stays."""

    P_a: Scalar
    """Gauge pressure at the end of the rise, Pa."""
    ramp: Scalar
    """Duration of the rise, s."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del q_free, compliance
        return self.P_a * jnp.clip(t / jnp.maximum(self.ramp, 1e-6), 0.0, 1.0)
