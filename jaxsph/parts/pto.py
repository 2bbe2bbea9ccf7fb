"""Power take-offs of a chamber's air: laws between pressure and flow.

Signs: `P_a` is the gauge pressure of a chamber's air, positive when compressed; `q` is the volume flow of air
out of the chamber, at the density of the ambient air, positive when the water column rises. The PTO absorbs
the power P_a q from incompressible air, and `head` times q from compressible air (`parts.air`). For a turbine
this power is never negative. In 2-D flows and powers are per metre of width.

A law is solved in closed form together with the response of water and air over the step, q = q_free -
compliance P_a, and is therefore stable for any damping coefficient.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.air import AbstractPTO, Air
from jaxsph.model.meaning import Entry
from jaxsph.model.state import Tally

__all__ = [
    "AbstractTurbine",
    "CharacteristicCurve",
    "ClosedPTO",
    "Constriction",
    "ControlledPTO",
    "LinearTurbine",
    "PhasedPTO",
    "PneumaticPTO",
    "PrescribedPressure",
    "ReliefValve",
    "orifice_damping",
]


class AbstractTurbine(AbstractPTO):
    """Power take-off whose law gives the flow for a pressure as well as the pressure for a flow."""

    @abc.abstractmethod
    def flow(self, P_a: Scalar) -> Scalar:
        """Flow through the turbine at the gauge pressure P_a (Pa), m3/s (m2/s in 2-D)."""


class PneumaticPTO(AbstractTurbine):
    """Quadratic turbine or slot, P_a = K_dm^2 |q| q (Zhu et al. 2020, Eq. 13 with the signs above).

    The law is exactly dissipative, smooth in K_dm, and tends to a closed chamber (q = 0) as K_dm grows.
    """

    K_dm: Scalar
    """Damping coefficient, kg^0.5 m^-2.5 (kg^0.5 m^-3.5 in 3-D)."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del t
        # 1e-12, a negligible flow, keeps the derivative finite at q = 0.
        size = jnp.abs(q_free) + 1e-12
        root = jnp.sqrt(1.0 + 4.0 * compliance * self.K_dm**2 * size)
        scaled = 2.0 * self.K_dm / (1.0 + root)  # divided before it is squared: K_dm^2 may be very large
        return scaled**2 * size * q_free

    def flow(self, P_a):
        """See `AbstractTurbine`."""
        return jnp.sign(P_a) * jnp.sqrt(jnp.abs(P_a)) / jnp.maximum(self.K_dm, 1e-12)


class Constriction(PneumaticPTO):
    """Constriction in a duct, where energy is lost: the pressure drop is P_a = K_dm^2 |q| q."""

    def entries(self, whose):
        """See `AbstractPTO`."""
        return {"duct": Entry(f"loss in the constriction of the {whose}")}


def orifice_damping(area: float, discharge: float, density: float = 1.2) -> float:
    """Damping coefficient K_dm of an orifice, kg^0.5 m^-2.5 (kg^0.5 m^-3.5 in 3-D).

    The coefficient is sqrt(density / 2) / (discharge * area), because Bernoulli's law gives
    P_a = (density / 2) (q / (discharge * area))^2. **Arguments**: `area`, m2 per metre of the chamber's width
    (m2 in 3-D); `discharge`: discharge coefficient (-), about 0.6 for a sharp edge; `density`:
    density of air, kg/m3.
    """
    return float(np.sqrt(0.5 * density) / (discharge * area))


class LinearTurbine(AbstractTurbine):
    """Linear turbine, for example a Wells turbine: P_a = resistance q."""

    resistance: Scalar
    """Resistance, Pa s/m2 (Pa s/m3 in 3-D)."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del t
        return self.resistance * q_free / (1.0 + self.resistance * compliance)

    def flow(self, P_a):
        """See `AbstractTurbine`."""
        return P_a / jnp.maximum(self.resistance, 1e-12)


class CharacteristicCurve(AbstractTurbine):
    """Turbine with a characteristic curve, given by points of flow and pressure joined by straight lines.

    Beyond its ends the curve is extrapolated linearly. A rising curve through (0, 0) never drives the water.
    """

    q: Float[Array, " n"]
    """Flows, m2/s (m3/s in 3-D), in ascending order."""
    P_a: Float[Array, " n"]
    """Gauge pressures at these flows, Pa, in ascending order."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`: q + compliance P_a rises along the curve and equals q_free at one point."""
        del t
        return _on_lines(q_free, self.q + compliance * self.P_a, self.P_a)

    def flow(self, P_a):
        """See `AbstractTurbine`."""
        return _on_lines(P_a, self.P_a, self.q)


def _on_lines(x: Scalar, nodes: Float[Array, " n"], values: Float[Array, " n"]) -> Scalar:
    """Value at x, interpolated linearly from `values` at ascending `nodes` and extrapolated beyond the first
    and the last node."""
    i = jnp.clip(jnp.searchsorted(nodes, x) - 1, 0, nodes.shape[0] - 2)
    share = (x - nodes[i]) / (nodes[i + 1] - nodes[i])
    return values[i] + share * (values[i + 1] - values[i])


class PhasedPTO(AbstractPTO):
    """Quadratic turbine whose damping varies with the phase of the waves.

    The logarithm of the damping is a Fourier series,

        ln(K_dm(t)/K_dm) = sum_n a_n cos(n omega t) + b_n sin(n omega t).

    The damping stays positive, so that the turbine never drives the water.
    """

    K_dm: Scalar
    """Geometric mean of the damping over a wave period, kg^0.5 m^-2.5 (kg^0.5 m^-3.5 in 3-D)."""
    phase: Float[Array, " 2n"]
    """Fourier coefficients a_1, b_1, a_2, b_2, ... (-)."""
    omega: Scalar
    """Angular frequency of the waves, rad/s."""

    def damping(self, t: Scalar) -> Scalar:
        """Damping coefficient K_dm at the time t (s), kg^0.5 m^-2.5 (kg^0.5 m^-3.5 in 3-D)."""
        n = 1 + jnp.arange(self.phase.shape[0] // 2)
        angle = n * self.omega * t
        a, b = self.phase[::2], self.phase[1::2]
        return self.K_dm * jnp.exp(jnp.sum(a * jnp.cos(angle) + b * jnp.sin(angle)))

    def at(self, air, t):
        """See `AbstractPTO`: the turbine with the damping at t."""
        del air
        return PneumaticPTO(self.damping(t))

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        return PneumaticPTO(self.damping(t)).pressure(q_free, compliance, t)


class ControlledPTO(AbstractPTO):
    """Power take-off set in every step by a function of the chamber's state.

    `control(air, t)` returns the power take-off for the step, for example a turbine with different damping.
    The arguments of `control` are the chamber's `air` at the beginning of the step (pressure `air.P_a`, flow
    `air.q`, volume `air.driven.total` displaced by the rise of the water) and the time t (s).
    """

    control: jax.tree_util.Partial
    """Control function, bound to the parameters with respect to which it can be differentiated."""

    @classmethod
    def of(cls, control: Callable[..., AbstractPTO], *parameters: Any) -> ControlledPTO:
        """Builds the power take-off from `control(*parameters, air, t)`; `parameters` are trees of arrays."""
        return cls(jax.tree_util.Partial(control, *parameters))

    def entries(self, whose):
        """See `AbstractPTO`; returns the ledger entries of the power take-off that `control` selects
        for air at rest."""
        return self._at_rest(0.0).entries(whose)

    def at(self, air, t):
        """See `AbstractPTO`."""
        return self.control(air, t).at(air, t)

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`; the control is evaluated for air at rest."""
        return self._at_rest(t).pressure(q_free, compliance, t)

    def _at_rest(self, t: Scalar | float) -> AbstractPTO:
        """Power take-off for air at rest."""
        dtype = jnp.result_type(float)
        zero = jnp.zeros((), dtype)
        return self.at(Air(zero, zero, Tally.zero(dtype)), jnp.asarray(t, dtype))


class ReliefValve(AbstractPTO):
    """Relief valve in parallel with a turbine; the valve keeps the air pressure between two limits.

    The valve releases or admits air at the rate that keeps the pressure within these limits. The ledger has
    separate entries for the energy of the valve's flow and the energy of the turbine.
    """

    turbine: AbstractTurbine | PhasedPTO
    """Turbine in parallel with the valve; the turbine for a step (`at`) must be an `AbstractTurbine`."""
    over: Scalar
    """Upper limit of the gauge pressure, Pa; inf for no limit."""
    under: Scalar
    """Upper limit of the suction, Pa, a positive number; inf for no limit."""

    def entries(self, whose):
        """See `AbstractPTO`."""
        return {**self.turbine.entries(whose), "relief": Entry(f"relief valve of the {whose}")}

    def at(self, air, t):
        """See `AbstractPTO`."""
        return ReliefValve(_turbine(self.turbine.at(air, t)), self.over, self.under)

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        return jnp.clip(self.turbine.pressure(q_free, compliance, t), -self.under, self.over)

    def flows(self, P_a, q):
        """See `AbstractPTO`: at a limiting pressure the valve passes the flow that exceeds the turbine's
        flow."""
        # An infinite limit is never reached, and any finite number in its place keeps derivatives finite.
        over, under = (jnp.where(jnp.isfinite(limit), limit, 1.0) for limit in (self.over, self.under))
        turbine = _turbine(self.turbine)
        out = jnp.maximum(q - turbine.flow(over), 0.0)
        into = jnp.minimum(q - turbine.flow(-under), 0.0)
        relieved = jnp.where(P_a >= self.over, out, jnp.where(P_a <= -self.under, into, 0.0))
        (name,) = self.turbine.entries("")
        return {name: q - relieved, "relief": relieved}


def _turbine(pto: AbstractPTO) -> AbstractTurbine:
    """Turbine in parallel with a valve. **Raises** TypeError unless `pto` is an `AbstractTurbine`."""
    if not isinstance(pto, AbstractTurbine):
        raise TypeError(
            f"turbine = {type(pto).__name__} cannot be in parallel with a relief valve: "
            "use an AbstractTurbine, for example PneumaticPTO or LinearTurbine"
        )
    return pto


class ClosedPTO(AbstractPTO):
    """Power take-off of a chamber without an opening to the ambient air: no air flows through it.

    The air that the water displaces leaves through ducts or is compressed.
    """

    def entries(self, whose):
        """See `AbstractPTO`: there are no entries."""
        del whose
        return {}

    def flows(self, P_a, q):
        """See `AbstractPTO`."""
        del P_a, q
        return {}

    def divided(self, mean, ducted):
        """See `AbstractPTO`: the whole flow goes into the ducts."""
        del ducted
        return jnp.zeros_like(mean), mean

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`: the pressure that stops the flow."""
        del t
        return q_free / compliance


class PrescribedPressure(AbstractPTO):
    """Power take-off that prescribes the pressure: a linear rise to `P_a` over `ramp`, then a constant."""

    P_a: Scalar
    """Gauge pressure at the end of the rise, Pa."""
    ramp: Scalar
    """Duration of the rise, s."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del q_free, compliance
        return self.P_a * jnp.clip(t / jnp.maximum(self.ramp, 1e-6), 0.0, 1.0)
