"""Background pressure near a thin wall: hydrostatic pressure that is subtracted in the pair sums."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar


class Background(eqx.Module):
    """Hydrostatic pressure R near a wall, which is subtracted in the pair sums and replaced by a body force.

    The water on each side of a wall thinner than the kernel's support interacts with the water below the tip,
    but not with the water on the other side. After a small displacement of the particles, the sum of
    (p_i + p_j) grad W gives accelerations proportional to p that increase this displacement. Still water
    0.56 m deep therefore starts to move at the tip of a wall one spacing thick, at up to 0.05 m/s. The water
    stays nearly at rest with the background pressure (`python -m experiments run thin_wall`), or if the wall
    is as thick as the support. With (p_i - R_i) + (p_j - R_j) in the sum, and -grad R added, the pressure
    gradient is the same to second order in h, and the pressures that remain in the sum are small at the tip.

    The pair forces stay antisymmetric, and the exchange of kinetic and compression energy stays exact. The
    energy balance gains the term sum V R, which changes with the packing of the particles and is counted as
    compression energy.
    """

    x: Scalar
    """Position of the middle of the wall along the tank, m."""
    inner: Scalar
    """Horizontal distance from the middle of the wall up to which R has its full value, m."""
    outer: Scalar
    """Horizontal distance from the middle of the wall beyond which R is zero, m."""
    tip: Scalar
    """Level below which R has its full value, m."""
    top: Scalar
    """Level above which R is zero, m."""
    weight: Scalar
    """Specific weight of the water, rho0 g, Pa/m."""
    still: Scalar
    """Still water level minus the head that remains in the pair sums, m."""

    def _beside(self, x: Float[Array, " N"]) -> Float[Array, " N"]:
        """Factor (0 to 1) that multiplies R at the horizontal position x (m)."""
        return _smooth_step((self.outer - jnp.abs(x - self.x)) / (self.outer - self.inner))

    def _below(self, z: Float[Array, " N"]) -> Float[Array, " N"]:
        """R at the level z (m) near the wall, Pa."""
        return _smooth_step((self.top - z) / (self.top - self.tip)) * self.weight * (self.still - z)

    def pressure(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Background pressure R at x (m), Pa."""
        return self._beside(x[:, 0]) * self._below(x[:, -1])

    def force(self, x: Float[Array, "N D"], h: Scalar) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
        """Force per volume -grad R at x (m), x and z components, N/m3, smoothed like a kernel sum.

        A sum with the Gaussian kernel gives the gradient of R + h^2/4 lap R to second order in h.
        """
        a, a1, a2, a3 = _derivatives(self._beside, x[:, 0])
        b, b1, b2, b3 = _derivatives(self._below, x[:, -1])
        wide = 0.25 * h * h
        return -(a1 * b + wide * (a3 * b + a1 * b2)), -(a * b1 + wide * (a * b3 + a2 * b1))


def _smooth_step(s: Float[Array, " N"]) -> Float[Array, " N"]:
    """Smooth step from 0 at s = 0 to 1 at s = 1 (-), twice differentiable."""
    s = jnp.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def _derivatives(f: Callable, x: Float[Array, " N"]) -> tuple[Float[Array, " N"], ...]:
    """Values and first three derivatives of an elementwise function at x."""

    def slope(f):
        return lambda x: jax.jvp(f, (x,), (jnp.ones_like(x),))[1]

    return f(x), slope(f)(x), slope(slope(f))(x), slope(slope(slope(f)))(x)
