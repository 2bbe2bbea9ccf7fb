"""Pair laws and the linear equation of state.

A law returns the term of one pair (`pairs.Pair`) from the fields of its two particles. The formulas below are
written as sums over j, which the pair loop computes from the terms. Equation numbers refer to Zhu
et al. 2020.

Fields: x (m), u (m/s), rho (kg/m3, the deviation from rho0), p (Pa), V (m3; m2 in 2-D), grad_rho (kg/m4).
A negative V marks a source in a wall. Such sources are excluded from the gradient and the diffusion of the
density.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from jaxsph.core.arrays import dot
from jaxsph.core.pairs import Fields, Pair, outer_upper

GUARD = 1.0e-3
"""Fraction of h^2 that is added to r^2 in denominators (-). The addition increases r^2 by 0.1 % at r = h and
avoids 0/0 at r = 0."""


def volume(j: Fields) -> jax.Array:
    """Volume of a source j, m3 (m2 in 2-D), without the sign that marks walls."""
    return jnp.abs(j["V"])


def water_volume(j: Fields) -> jax.Array:
    """Volume of the source particle j if it is water, m3 (m2 in 2-D); zero if it belongs to a wall."""
    # unlike that of a maximum, the derivative needs no division
    return jnp.where(j["V"] < 0.0, 0.0, j["V"])


def pressure(rho: jax.Array, c0: jax.Array) -> jax.Array:
    """Pressure p = c0^2 (rho - rho0), Pa, from the density's deviation (kg/m3): equation of state, Eq. 1."""
    return c0 * c0 * rho


def density_deviation(p: jax.Array, c0: jax.Array) -> jax.Array:
    """Deviation of the density rho - rho0 = p / c0^2, kg/m3, from the pressure (Pa): Eq. 1 inverted."""
    return p / (c0 * c0)


def moment_matrix(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """Moment matrix sum (x_j - x_i) (x) grad W V_j (-), upper triangle.

    The inverse of the matrix is L of Eq. 9, and the trace of the matrix is the divergence of position of
    Eq. 15.
    """
    w = -pair.F * water_volume(j)
    return outer_upper(pair.r, tuple(w * r for r in pair.r))


def density_gradient(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """Density gradient sum (rho_j - rho_i) grad W V_j, kg/m4, to be renormalised by L (Eq. 9)."""
    w = (j["rho"] - i["rho"]) * water_volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def surface_vector(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """Surface vector sum grad W V_j, 1/m: zero inside the fluid, along the inward normal at a surface."""
    w = volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def pressure_force(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """Pressure force per volume -sum (p_j + p_i) grad W V_j, N/m3 (Eq. 3 times rho_i)."""
    w = -(i["p"] + j["p"]) * volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def viscous_force(pair: Pair, i: Fields, j: Fields, guard: ArrayLike) -> tuple[jax.Array, ...]:
    """Viscous sum (u_j - u_i).(x_j - x_i)/r^2 grad W V_j, 1/(m s): Eq. 4 and 6 without their coefficient."""
    u = tuple(a - b for a, b in zip(i["u"], j["u"], strict=True))
    w = dot(u, pair.r) / (pair.r2 + guard) * volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def laplacian(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """Half of the velocity's Laplacian, sum (u_i - u_j) (r.grad W)/r^2 V_j, 1/(m s).

    Source: Morris et al. 1997, Eq. 22.
    """
    w = volume(j) * pair.F
    return tuple(w * (a - b) for a, b in zip(i["u"], j["u"], strict=True))


def laplacian_weight(pair: Pair, j: Fields, guard: ArrayLike) -> jax.Array:
    """Weight w_ij of the Laplacian lap f = sum w_ij (f_j - f_i), 1/m2.

    Source: Yeylaghi et al. 2016, Eq. 6, for uniform density, multiplied by that density.
    """
    return -2.0 * volume(j) * pair.F * (pair.r2 / (pair.r2 + guard))


def divergence(pair: Pair, i: Fields, j: Fields) -> jax.Array:
    """Negative divergence of the velocity, -div u = sum (u_i - u_j).grad W V_j, 1/s (Eq. 7 divided by
    rho_i)."""
    u = tuple(a - b for a, b in zip(i["u"], j["u"], strict=True))
    return dot(u, pair.r) * volume(j) * pair.F


def density_diffusion(pair: Pair, i: Fields, j: Fields, guard: ArrayLike) -> jax.Array:
    """Density diffusion sum Psi_ij . grad W V_j, kg/m5: Eq. 8-9 without delta h c0; antisymmetric."""
    gradient = tuple(a + b for a, b in zip(i["grad_rho"], j["grad_rho"], strict=True))
    # Psi . grad W with x_j - x_i = -r: both terms share r^2/(r^2 + guard) and cancel in a linear field.
    psi = -2.0 * (j["rho"] - i["rho"]) - dot(gradient, pair.r)
    return psi * (pair.r2 / (pair.r2 + guard)) * water_volume(j) * pair.F
