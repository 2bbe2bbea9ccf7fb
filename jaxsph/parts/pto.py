"""Power take-offs of a chamber's air: pressure against flow.

Signs: `P_a` is the gauge pressure of a chamber's air, positive when compressed; `q` is the volume flow of air
out of the chamber, at the density of the ambient air, positive when the water column rises; the PTO takes
P_a q, which for a turbine is never negative.

A law is solved in closed form together with the response of water and air over the step, q = q_free -
compliance P_a: so it is stable for every damping.
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
    """Power take-off whose pressure follows from the flow, and the flow from the pressure."""

    @abc.abstractmethod
    def flow(self, P_a: Scalar) -> Scalar:
        """Flow through the turbine at the gauge pressure P_a (Pa), m2/s."""


class PneumaticPTO(AbstractTurbine):
    """Quadratic turbine or slot, P_a = K_dm^2 |q| q (Zhu et al. 2020, Eq. 13 with the signs above).

    It is exactly dissipative, smooth in K_dm, and tends to a closed chamber (q = 0) as K_dm grows.
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

    def flow(self, P_a):
        """See `AbstractTurbine`."""
        return jnp.sign(P_a) * jnp.sqrt(jnp.abs(P_a)) / jnp.maximum(self.K_dm, 1e-12)


class Constriction(PneumaticPTO):
    """Narrow place in a duct, whose energy is lost: P_a = K_dm^2 |q| q."""

    def entries(self, whose):
        """See `AbstractPTO`."""
        return {"duct": Entry(f"loss in the duct {whose}")}


def orifice_damping(area: float, discharge: float, density: float = 1.2) -> float:
    """Damping coefficient K_dm (kg^0.5 m^-2.5) of an orifice, sqrt(density / 2) / (discharge area).

    From Bernoulli's P_a = (density / 2) (q / (discharge area))^2. **Arguments**: `area`, m2 per metre of the
    chamber's width; `discharge`: coefficient of discharge (-), about 0.6 of a sharp edge; `density` of air,
    kg/m3.
    """
    return float(np.sqrt(0.5 * density) / (discharge * area))


class LinearTurbine(AbstractTurbine):
    """Linear turbine, such as of Wells' type: P_a = resistance q."""

    resistance: Scalar
    """Resistance, Pa s/m2 (flow per unit width)."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del t
        return self.resistance * q_free / (1.0 + self.resistance * compliance)

    def flow(self, P_a):
        """See `AbstractTurbine`."""
        return P_a / jnp.maximum(self.resistance, 1e-12)


class CharacteristicCurve(AbstractTurbine):
    """Turbine of a given characteristic curve: points of flow and pressure, and straight lines between them.

    Beyond its ends the curve goes on as it ends. Through (0, 0) and rising it never drives the water.
    """

    q: Float[Array, " n"]
    """Flows, m2/s, rising."""
    P_a: Float[Array, " n"]
    """Gauge pressures at these flows, Pa, rising."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`: q + compliance P_a rises along the curve, so that one place has q_free."""
        del t
        return _on_lines(q_free, self.q + compliance * self.P_a, self.P_a)

    def flow(self, P_a):
        """See `AbstractTurbine`."""
        return _on_lines(P_a, self.P_a, self.q)


def _on_lines(x: Scalar, nodes: Float[Array, " n"], values: Float[Array, " n"]) -> Scalar:
    """Value at x on the straight lines through `values` at the rising `nodes`, and on beyond their ends."""
    i = jnp.clip(jnp.searchsorted(nodes, x) - 1, 0, nodes.shape[0] - 2)
    share = (x - nodes[i]) / (nodes[i + 1] - nodes[i])
    return values[i] + share * (values[i + 1] - values[i])


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

    def at(self, air, t):
        """See `AbstractPTO`: the turbine of the moment t."""
        del air
        return PneumaticPTO(self.damping(t))

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        return PneumaticPTO(self.damping(t)).pressure(q_free, compliance, t)


class ControlledPTO(AbstractPTO):
    """Power take-off that a function of the chamber's state sets anew in every step.

    `control(own, t)` returns the power take-off of the step, such as a turbine of another damping, from the
    chamber's `own` air at the step's begin (pressure `air.P_a`, flow `air.q`, volume `air.driven.total` that
    the water has risen by) and the time t (s).
    """

    control: jax.tree_util.Partial
    """The function, with the parameters that derivatives are taken over."""

    @classmethod
    def of(cls, control: Callable[..., AbstractPTO], *parameters: Any) -> ControlledPTO:
        """Builds the power take-off of `control(*parameters, own, t)`; `parameters` are trees of arrays."""
        return cls(jax.tree_util.Partial(control, *parameters))

    def entries(self, whose):
        """See `AbstractPTO`: those of the power take-off that the function returns for air at rest."""
        return self._at_rest(0.0).entries(whose)

    def at(self, air, t):
        """See `AbstractPTO`."""
        return self.control(air, t).at(air, t)

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`: of a chamber whose air is at rest."""
        return self._at_rest(t).pressure(q_free, compliance, t)

    def _at_rest(self, t: Scalar | float) -> AbstractPTO:
        """Power take-off for air at rest."""
        dtype = jnp.result_type(float)
        zero = jnp.zeros((), dtype)
        return self.at(Air(zero, zero, Tally.zero(dtype)), jnp.asarray(t, dtype))


class ReliefValve(AbstractPTO):
    """Valve beside a turbine that holds the air between two pressures.

    It lets out, or in, as much as that needs; what the valve takes is booked apart from the turbine's.
    """

    turbine: AbstractTurbine | PhasedPTO
    """Turbine beside the valve, in every step an `AbstractTurbine`."""
    over: Scalar
    """Gauge pressure that the air does not go over, Pa; inf for none."""
    under: Scalar
    """Suction that the air does not go beyond, Pa, as a positive number; inf for none."""

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
        """See `AbstractPTO`: the valve passes what the turbine does not pass at the valve's pressure."""
        # A limit that is not there is never reached: any finite number in its place keeps slopes finite.
        over, under = (jnp.where(jnp.isfinite(limit), limit, 1.0) for limit in (self.over, self.under))
        turbine = _turbine(self.turbine)
        out = jnp.maximum(q - turbine.flow(over), 0.0)
        into = jnp.minimum(q - turbine.flow(-under), 0.0)
        relieved = jnp.where(P_a >= self.over, out, jnp.where(P_a <= -self.under, into, 0.0))
        (name,) = self.turbine.entries("")
        return {name: q - relieved, "relief": relieved}


def _turbine(pto: AbstractPTO) -> AbstractTurbine:
    """Power take-off beside a valve. **Raises** TypeError where its flow does not follow from pressure."""
    if not isinstance(pto, AbstractTurbine):
        raise TypeError(f"turbine = {type(pto).__name__}: beside a valve it must be an AbstractTurbine")
    return pto


class ClosedPTO(AbstractPTO):
    """No opening to the ambient air: what moves the air leaves through ducts, or compresses it."""

    def entries(self, whose):
        """See `AbstractPTO`: none."""
        del whose
        return {}

    def flows(self, P_a, q):
        """See `AbstractPTO`."""
        del P_a, q
        return {}

    def divided(self, mean, ducted):
        """See `AbstractPTO`: all goes into the ducts."""
        del ducted
        return jnp.zeros_like(mean), mean

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`: the pressure that stops the flow."""
        del t
        return q_free / compliance


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
