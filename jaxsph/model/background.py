"""Background pressure beside a thin wall: still water's pressure, taken out of the pair sums."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar


class Background(eqx.Module):
    """Still water's pressure R(z) below a level, taken out of the pair sums and put back as a body force.

    Water on both sides of a wall thinner than the kernel couples with the water below the tip, but not
    with itself. The sum (p_i + p_j) grad W then answers small displacements with accelerations that
    point outwards, in proportion to p: at rest, particles at the tip of a wall of one spacing gain speed
    without end (`python -m experiments run thin_wall`), where a wall as thick as the kernel reaches stays
    quiet. With (p_i - R_i) + (p_j - R_j) in the sum and -grad R beside it the gradient is the same
    to second order, and the sum sees little pressure at the tip.

    Pairs stay antisymmetric, and the exchange with the compression energy stays exact: the budget gains
    one term, sum V R, which changes as particles pack (it is counted with the compression energy).
    """

    x: Scalar
    """Position of the middle of the wall along the tank, m."""
    inner: Scalar
    """Horizontal distance from the wall up to which R is whole, m."""
    outer: Scalar
    """Horizontal distance from the wall beyond which R is zero, m."""
    tip: Scalar
    """Level below which R is whole, m."""
    top: Scalar
    """Level above which R is zero, m."""
    weight: Scalar
    """Specific weight of the water, rho0 g, Pa/m."""
    still: Scalar
    """Still water level less the head that is left in the pair sums, m."""

    def _beside(self, x: Float[Array, " N"]) -> Float[Array, " N"]:
        """Share of R at the distance of x (m) from the wall, 0 to 1."""
        return _smooth_step((self.outer - jnp.abs(x - self.x)) / (self.outer - self.inner))

    def _below(self, z: Float[Array, " N"]) -> Float[Array, " N"]:
        """R at the level z (m) beside the wall, Pa."""
        return _smooth_step((self.top - z) / (self.top - self.tip)) * self.weight * (self.still - z)

    def pressure(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Background pressure R at x (m), Pa."""
        return self._beside(x[:, 0]) * self._below(x[:, -1])

    def force(self, x: Float[Array, "N D"], h: Scalar) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
        """Force per volume -grad R at x (m), its x and z components, N/m3, smoothed as a kernel sum smooths.

        A sum over the Gaussian kernel gives the gradient of R + h^2/4 lap R to second order in h.
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
    """An elementwise function and its first three derivatives."""

    def slope(f):
        return lambda x: jax.jvp(f, (x,), (jnp.ones_like(x),))[1]

    return f(x), slope(f)(x), slope(slope(f))(x), slope(slope(slope(f)))(x)
