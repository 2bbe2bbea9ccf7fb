"""Elastic catenary in a vertical plane: forces at its ends, shape and energy, with exact derivatives.

The end forces follow from one scalar equation whose left-hand side increases with its unknown. The horizontal
force is H, and the vertical forces are V at the upper end and V - w L at the lower end. The unknowns p and q
are defined by V = H sinh(p + q) and V - w L = H sinh(p - q). The equations of the elastic catenary (Jonkman
2007) for the span l and the height h then become, with e = w L / (2 EA),

    h / L = tanh(p) (1 + e coth(q)),    l / L = (q + e) / (cosh(p) sinh(q)),

so that (h tanh(q) / (tanh(q) + e))^2 + (l sinh(q) / (q + e))^2 = L^2, which has one solution q. A catenary
that lies partly on the bed, without friction, also has only one unknown, H, because V follows from H and h:
with the tension T at the fairlead, (T + EA)^2 = (H + EA)^2 + 2 EA w h.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.roots import increasing_root

__all__ = ["AbstractCatenary", "EndForces", "GroundedCatenary", "HangingCatenary"]

STEEPEST = 30.0
"""Largest q (-); the ratio of the horizontal force to the line's weight is then 1e-13."""
SMALLEST = 1e-6
"""Smallest ratio of span or height to length for which the equations are solved (-)."""
STRAIN = 10.0
"""Largest strain that is considered (-)."""


class EndForces(NamedTuple):
    """Forces at the ends of a catenary, N (N/m in 2-D)."""

    across: Scalar
    """Horizontal force H, the same at both ends; not negative."""
    up: Scalar
    """Vertical force V on the upper end of the line, upwards."""
    below: Scalar
    """Vertical force on the line's lower end, downwards; zero if part of the line lies on the bed."""


class AbstractCatenary(eqx.Module):
    """Heavy elastic line between two points in still water, in static equilibrium.

    The span is the horizontal distance between the ends, and the height is the height of the fairlead above
    the anchor.
    """

    length: Scalar
    """Length L without tension, m."""
    weight: Scalar
    """Weight per length in water w, N/m (N/m per metre of width in 2-D); positive."""
    axial_stiffness: Scalar
    """Axial stiffness EA: tension per strain, N (N/m in 2-D)."""

    @abc.abstractmethod
    def end_forces(self, span: Scalar, height: Scalar) -> EndForces:
        """Forces at the ends for a span (m), not negative, and a height (m)."""

    @abc.abstractmethod
    def vertical(self, up: Scalar, below: Scalar) -> Scalar:
        """Vertical force (N) in the line at the unstretched distance `below` (m) from the fairlead, for the
        vertical force `up` (N) at the fairlead."""

    def energy(self, x: Scalar, z: Scalar) -> Scalar:
        """Elastic and potential energy (J; J/m in 2-D) with the fairlead at x and z (m) from the anchor.

        The derivatives of the energy with respect to x and z are the components of the force on the upper
        end. The second derivatives are the stiffness, a positive semi-definite matrix.
        """
        return _energy(x, z, self)

    def complementary(self, across: Scalar, up: Scalar) -> Scalar:
        """Legendre transform of the energy: H l + V h minus the energy, J (J/m in 2-D)."""
        L, w, EA = self.length, self.weight, self.axial_stiffness
        H = jnp.maximum(across, 1e-12 * w * L)
        low = self.vertical(up, L)

        def hung(V):
            return V * jnp.sqrt(H**2 + V**2) + H**2 * jnp.arcsinh(V / H)

        lying = L - (up - low) / w
        stretched = H**2 * L + (up**3 - low**3) / (3.0 * w)
        return (hung(up) - hung(low)) / (2.0 * w) + H * lying + stretched / (2.0 * EA)

    def shape(self, span: Scalar, height: Scalar, s: Float[Array, " K"]) -> Float[Array, "K 2"]:
        """Positions (m) relative to the anchor of points at the unstretched distances s (m) from the anchor.

        The span must not be negative. Slack that lies on the bed is spread evenly.
        """
        L, w, EA = self.length, self.weight, self.axial_stiffness
        force = self.end_forces(span, height)
        H = jnp.maximum(force.across, 1e-9 * w * L)
        lying = L - (force.up - force.below) / w
        V = jnp.where(s > lying, force.up - w * (L - s), force.below)
        T, T_low = jnp.sqrt(H**2 + V**2), jnp.sqrt(H**2 + force.below**2)
        x = H / w * (jnp.arcsinh(V / H) - jnp.arcsinh(force.below / H)) + H / EA * jnp.maximum(s - lying, 0.0)
        z = (T - T_low) / w + (V**2 - force.below**2) / (2.0 * w * EA)
        end = H / w * (jnp.arcsinh(force.up / H) - jnp.arcsinh(force.below / H)) + H / EA * (L - lying)
        on_bed = (span - end) * jnp.minimum(s, lying) / jnp.maximum(lying, 1e-9 * L)
        return jnp.stack([x + jnp.where(lying > 1e-6 * L, on_bed, 0.0), z], axis=-1)


class HangingCatenary(AbstractCatenary):
    """Catenary that hangs freely between its ends."""

    def vertical(self, up, below):
        """See `AbstractCatenary`."""
        return up - self.weight * below

    def end_forces(self, span, height):
        """See `AbstractCatenary`."""
        W, e = self.weight * self.length, 0.5 * self.weight * self.length / self.axial_stiffness
        x, h = jnp.maximum(span / self.length, SMALLEST), height / self.length
        low, high = jnp.log(0.05 * e / STRAIN), jnp.log(STEEPEST * jnp.ones_like(e))
        q = jnp.exp(increasing_root(_hanging, low, high, (x, h, e)))
        sinh_q, tanh_q = jnp.sinh(q), jnp.tanh(q)
        # compute 1 / cosh(p) from the span, because 1 - tanh(p)^2 suffers from cancellation in steep lines
        sech_p, tanh_p = x * sinh_q / (q + e), h * tanh_q / (tanh_q + e)
        up = 0.5 * W * (1.0 + tanh_p / tanh_q)
        return EndForces(0.5 * W * sech_p / sinh_q, up, up - W)


class GroundedCatenary(AbstractCatenary):
    """Catenary whose anchor is on a horizontal bed; part of the line may lie on the bed, without friction."""

    def vertical(self, up, below):
        """See `AbstractCatenary`."""
        return jnp.maximum(up - self.weight * below, 0.0)

    def end_forces(self, span, height):
        """See `AbstractCatenary`."""
        height = jnp.maximum(height, SMALLEST * self.length)
        hanging = HangingCatenary(self.length, self.weight, self.axial_stiffness).end_forces(span, height)
        W, k = self.weight * self.length, self.axial_stiffness / (self.weight * self.length)
        x, h = span / self.length, height / self.length
        low, high = jnp.log(1e-7 * jnp.ones_like(k)), jnp.log(1.0 + STRAIN * k)
        H = jnp.exp(increasing_root(_grounded, low, high, (x, h, k)))
        # with no horizontal force the line hangs straight down, and its remainder lies on the bed
        H = jnp.where(_grounded(low, (x, h, k)) < 0.0, H, 0.0)
        V = _lifted(H, h, k)
        off_bed = hanging.below > 0.0
        up, across = jnp.where(off_bed, hanging.up, W * V), jnp.where(off_bed, hanging.across, W * H)
        return EndForces(across, up, jnp.where(off_bed, hanging.below, 0.0))


def _hanging(y: Scalar, parameters: tuple[Scalar, Scalar, Scalar]) -> Scalar:
    """Residual of the equation for q = exp(y) (-): half the logarithm of (left-hand side / L^2)."""
    x, h, e = parameters
    q = jnp.exp(y)
    return 0.5 * jnp.log((h * jnp.tanh(q) / (jnp.tanh(q) + e)) ** 2 + (x * jnp.sinh(q) / (q + e)) ** 2)


def _grounded(y: Scalar, parameters: tuple[Scalar, Scalar, Scalar]) -> Scalar:
    """Span of a line with the horizontal force exp(y), minus the given span x (-).

    Spans are divided by the line's length, and forces by the line's weight.
    """
    x, h, k = parameters
    H = jnp.exp(y)
    V = _lifted(H, h, k)
    return (1.0 - x) - V + H * jnp.arcsinh(V / H) + H / k


def _lifted(H: Scalar, h: Scalar, k: Scalar) -> Scalar:
    """Ratio of the vertical force at the fairlead to the weight of a line that lies partly on the bed (-).

    The height h is divided by the line's length, and the horizontal force H by the line's weight.
    """
    # the tension minus H, in a form without squares of k, which may overflow
    twice = 2.0 * h * k / (H + k)
    more = twice / (1.0 + jnp.sqrt(1.0 + twice / (H + k)))
    return jnp.sqrt(more * (2.0 * H + more))


@jax.custom_jvp
def _energy(x: Scalar, z: Scalar, line: AbstractCatenary) -> Scalar:
    """Energy (J) of a catenary whose fairlead is at x and z (m) from the anchor."""
    span = _span(x, line)
    force = line.end_forces(span, z)
    return force.across * span + force.up * z - line.complementary(force.across, force.up)


@_energy.defjvp
def _energy_jvp(primals, tangents):
    """Derivative of the energy at fixed end forces. This derivative is exact, because the energy is
    stationary with respect to the end forces."""
    x, z, line = primals
    span = _span(x, line)
    force = line.end_forces(span, z)
    by_line = jax.jvp(lambda one: one.complementary(force.across, force.up), (line,), (tangents[2],))[1]
    by_place = force.across * x / span * tangents[0] + force.up * tangents[1]
    return _energy(x, z, line), by_place - by_line


def _span(x: Scalar, line: AbstractCatenary) -> Scalar:
    """Horizontal distance between the ends, m; smooth in x where one end is vertically above the other."""
    return jnp.sqrt(x**2 + (SMALLEST * line.length) ** 2)
