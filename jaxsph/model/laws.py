"""Pure pair laws, the equation of state and body forces. A law sees one pair (`pairs.Pair`) and the fields
of its two particles; equation numbers are those of Zhu et al. 2020.

Fields: x (m), u (m/s), rho (kg/m3, the deviation from rho0), p (Pa), V (m3 per m of width in 2-D; a
negative sign marks a wall's source, which takes no part in the density diffusion), grad_rho (kg/m4).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from jaxsph.core.arrays import dot
from jaxsph.core.pairs import Fields, Pair, outer_upper

GUARD = 1.0e-3
"""Fraction of h^2 added to r^2 in denominators (0.1 % at r = h); the particle itself gives 0/GUARD."""


def volume(j: Fields) -> jax.Array:
    """Volume of a source, whatever the mark in its sign."""
    return jnp.abs(j["V"])


def water_volume(j: Fields) -> jax.Array:
    """Volume of a source in the water, zero for a wall's."""
    return jnp.maximum(j["V"], 0.0)


def pressure(rho: jax.Array, c0: jax.Array) -> jax.Array:
    """Linear equation of state, Eq. 1: p = c0^2 (rho - rho0), from the deviation."""
    return c0 * c0 * rho


def density_deviation(p: jax.Array, c0: jax.Array) -> jax.Array:
    """Inverse of `pressure`."""
    return p / (c0 * c0)


def moment_matrix(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """Upper triangle of sum (x_j - x_i) (x) grad W V_j: inverse of L in Eq. 9; trace is Eq. 15's."""
    w = -pair.F * water_volume(j)
    return outer_upper(pair.r, tuple(w * r for r in pair.r))


def density_gradient(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """sum (rho_j - rho_i) grad W V_j, to be renormalised by L (Eq. 9), kg/m4."""
    w = (j["rho"] - i["rho"]) * water_volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def surface_vector(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """sum grad W V_j, 1/m: zero inside the fluid, along the inward normal at a free surface."""
    w = volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def pressure_force(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """-sum (p_j + p_i) grad W V_j (Eq. 3 times rho_i), N/m3."""
    w = -(i["p"] + j["p"]) * volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def viscous_force(pair: Pair, i: Fields, j: Fields, guard: ArrayLike) -> tuple[jax.Array, ...]:
    """sum (u_j - u_i).(x_j - x_i)/r^2 grad W V_j: Eq. 4 and 6 without their coefficient, m/s2 per m2/s."""
    u = tuple(a - b for a, b in zip(i["u"], j["u"], strict=True))
    w = dot(u, pair.r) / (pair.r2 + guard) * volume(j) * pair.F
    return tuple(w * r for r in pair.r)


def laplacian(pair: Pair, i: Fields, j: Fields) -> tuple[jax.Array, ...]:
    """sum (u_i - u_j) (r.grad W)/r^2 V_j: half of lap u (Morris et al. 1997, Eq. 22), 1/(m s)."""
    w = volume(j) * pair.F
    return tuple(w * (a - b) for a, b in zip(i["u"], j["u"], strict=True))


def laplacian_weight(pair: Pair, j: Fields, guard: ArrayLike) -> jax.Array:
    """w_ij of sum w_ij (f_j - f_i) = lap f (Yeylaghi et al. 2016, Eq. 6 with one density, times it), 1/m2."""
    return -2.0 * volume(j) * pair.F * (pair.r2 / (pair.r2 + guard))


def divergence(pair: Pair, i: Fields, j: Fields) -> jax.Array:
    """sum (u_i - u_j).grad W V_j = -div u (Eq. 7 times 1/rho_i), 1/s."""
    u = tuple(a - b for a, b in zip(i["u"], j["u"], strict=True))
    return dot(u, pair.r) * volume(j) * pair.F


def density_diffusion(pair: Pair, i: Fields, j: Fields, guard: ArrayLike) -> jax.Array:
    """sum Psi_ij . grad W V_j (Eq. 8-9) without delta h c0, kg/m5. Antisymmetric in i and j."""
    gradient = tuple(a + b for a, b in zip(i["grad_rho"], j["grad_rho"], strict=True))
    # Psi . grad W with x_j - x_i = -r: both terms share r^2/(r^2 + guard) and cancel in a linear field.
    psi = -2.0 * (j["rho"] - i["rho"]) - dot(gradient, pair.r)
    return psi * (pair.r2 / (pair.r2 + guard)) * water_volume(j) * pair.F
