"""Regularisation of the particles: hyperviscosity against velocity noise, separation against clumping."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, dot, real, stack
from jaxsph.core.fits import moments, monomials, polynomials
from jaxsph.core.pairs import Fields, Pair, Smoothing
from jaxsph.core.slabs import Sources
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.meaning import Entry
from jaxsph.model.state import Particles, Tables

__all__ = [
    "HYPERVISCOSITY",
    "PAIR",
    "SEPARATION",
    "WHOLE",
    "Regularisation",
    "Regularised",
    "lattice_sum",
    "regularisations",
]

HYPERVISCOSITY = 1.0
"""Default strength of the hyperviscosity, in units of sqrt(g/h) (-): see `Regularisation`.

In the OWC case at dx = 0.02 m, half this strength left a sixth more noise in the water, and dissipated 11 %
instead of 12 % of the paddle's work (measured with an earlier version of the scheme).
"""

SEPARATION = 3.0
"""Default strength of the separation, in units of sqrt(g/h) (-): see `Regularisation`."""

PAIR = 0.6
"""Distance, in spacings, below which two particles count as clumped. In waves particles stay much farther
apart."""


WHOLE = 0.5 * PAIR
"""Displacement, in spacings, by which two coincident particles must each move to be `PAIR` apart."""


THIN = {2: 0.3, 3: 0.15}
"""Limit of the sum of weights, below which polynomials are of first degree, by number of dimensions (-).

The sum is 1 in a lattice. In two dimensions it is 0.6 at a surface, 0.35 or more where a surface meets a
wall, and 0.20 to 0.26 in a row of particles. In three dimensions it is 0.24 or more where a surface meets two
walls, and 0.05 to 0.09 in a row. In spray and thin sheets a second-degree polynomial fits the few neighbours
exactly, so hyperviscosity would have no effect. Without this limit, dam-break runs failed at impact.
"""
FADE = 0.1
"""Width of the transition below `THIN`, as a sum of weights (-)."""


class Regularised(NamedTuple):
    """Result of a regularisation, for the time since the previous regularisation."""

    u: Float[Array, "N D"]
    """Velocities after the regularisation, m/s."""
    moved: Float[Array, "N D"]
    """Displacements in addition to those due to the velocities, m."""
    lost: dict[str, Scalar]
    """Energies that the water loses, by their names in the ledger, J (J/m in 2-D)."""


class Terms(NamedTuple):
    """Pair sums of a regularisation."""

    jump: Components
    """Weighted sum of the differences between the residuals of the two particles' polynomials, m/s."""
    apart: Components
    """Weighted sum of the unit vectors away from neighbours that are too near (-)."""


class Regularisation(eqx.Module):
    """Hyperviscosity, which damps the velocity noise of particles, and separation of clumped particles.

    **Hyperviscosity** damps the part of the velocity that a local polynomial of second degree does not fit.
    Around every particle i, the polynomial P_i is fitted to the velocity differences u_j - u_i of the
    neighbours by least squares, with weights w_ij proportional to V_j (1 - |r_ij|^2/R^2)^2, whose sum over a
    lattice is 1; R is the radius of the support. The velocities change along the negative gradient of the
    weighted sum of squared residuals, du_i/dt = hyperviscosity sqrt(g/h) sum_j w_ij (e_ij - e_ji), where
    e_ij = u_j - u_i - P_i(x_j - x_i) is the residual at the neighbour. The kinetic energy therefore never
    grows, and velocities up to second degree in space are not damped, not even beside walls and surfaces.
    Disorder of the particles adds noise to their velocities that varies from one particle to the next. Noise
    with a wavelength of two spacings decays at a rate of 1.3 to 1.6 times hyperviscosity sqrt(g/h); with
    dx = 0.02 m it falls by a factor of e in less than 0.05 s. The damping of a wave with wavenumber k is much
    weaker, because it is proportional to (kh)^6. An artificial viscosity, whose damping is proportional to
    (kh)^2, damps both noise and waves. In spray and thin sheets, where the weights add up to less than
    `THIN`, the polynomial is of first degree.

    **Separation** moves apart particles that an impact has brought closer than 0.6 spacings:
    dr_i/dt = separation sqrt(g/h) dx sum_j (V_j/dx^D) (1 - |r_ij|/(0.6 dx)) r_ij/|r_ij|, r_ij = x_i - x_j.
    Every particle keeps its velocity. Particles farther apart are not affected, whether in a wave or at a
    surface. Separation therefore cannot lift a surface.

    Both methods conserve the momentum of every pair. The ledger contains the energies that they dissipate;
    separation dissipates only potential energy. Without gravity the rate sqrt(g/h) is zero, and neither
    method has an effect.
    """

    hyperviscosity: Scalar = eqx.field(converter=real)
    """Strength of the hyperviscosity, in units of sqrt(g/h) (-)."""
    separation: Scalar = eqx.field(converter=real)
    """Strength of the separation, in units of sqrt(g/h) (-)."""

    def entries(self) -> dict[str, Entry]:
        """Energies that the regularisation dissipates, by their names in the ledger."""
        return {
            "hyperviscosity": Entry("energy lost by hyperviscosity"),
            "separation": Entry("energy lost by separation of clumped particles"),
        }

    @staticmethod
    def law(unit: Scalar, dx: Scalar, radius: Scalar, pair: Pair, i: Fields, j: Fields) -> Terms:
        """Terms of one pair of water particles; the terms of walls are zero.

        **Arguments**: `unit`: result of `lattice_sum`; `dx`: spacing, m; `radius`: radius of the support, m,
        by which the polynomials' coordinates are divided; `i`, `j`: fields "u", "fit" (`fits.polynomials`)
        and "V". "V" is the mass divided by rho0; with this choice the terms of a pair conserve momentum.
        """
        w = laws.water_volume(j) * weight(pair.r2, radius) / unit
        there = monomials(tuple(-r / radius for r in pair.r))
        back = monomials(tuple(r / radius for r in pair.r))
        fields = zip(i["u"], j["u"], i["fit"], j["fit"], strict=True)
        jump = tuple(w * (2.0 * (b - a) - dot(P, there) + dot(Q, back)) for a, b, P, Q in fields)
        # the guard avoids 0/0 at r = 0, where the direction is undefined
        r = jnp.sqrt(pair.r2 + (1e-6 * dx) ** 2)
        # particles without mass (copies that fill up a slab) are not separated, since they would jump away
        size = jnp.where(i["V"] > 0.0, laws.water_volume(j), 0.0) / dx ** len(pair.r)
        near = size * jnp.maximum(1.0 - r / (PAIR * dx), 0.0) / r
        return Terms(jump, tuple(near * component for component in pair.r))

    def apply(
        self, scheme: AbstractScheme, model: Model, p: Particles, tables: Tables, t: Scalar
    ) -> Regularised:
        """Velocities (m/s) and displacements (m) after the interval t (s) between two regularisations,
        computed with two pair sums.

        Even for a large t, noise and clumping are at most removed, not reversed.
        """
        smoothing, dim = scheme.smoothing, p.x.shape[1]
        radius, unit = smoothing.radius, lattice_sum(smoothing, model.dx, dim)
        own = {"x": columns(p.x), "V": p.m / scheme.rho0, "u": columns(p.u)}

        def equations(pair: Pair, i: Fields, j: Fields):
            w = laws.water_volume(j) * weight(pair.r2, radius) / unit
            d = tuple(-r / radius for r in pair.r)
            basis = monomials(d)
            changes = (w * (b - a) for a, b in zip(i["u"], j["u"], strict=True))
            return w, moments(w, d), tuple(tuple(change * m for m in basis) for change in changes)

        total, summed, differences = tables.fluid.sum(equations, smoothing, own, Sources(own, {}))
        thin = jnp.clip((THIN[dim] - total) / FADE, 0.0, 1.0)
        own = own | {"fit": polynomials(summed, differences, dim, thin)}
        law = functools.partial(self.law, unit, model.dx, radius)
        terms = tables.fluid.sum(law, smoothing, own, Sources(own, {}))
        rate = smoothing.gravity_rate(model.g)
        smoothed = -jnp.expm1(-self.hyperviscosity * rate * t) * stack(terms.jump)
        share = -WHOLE * jnp.expm1(-self.separation * rate * t / WHOLE) * model.dx
        moved = share * stack(terms.apart)
        # Separated particles keep their velocities. If the velocities changed with the local gradient, a pair
        # that gravity presses together repeatedly in a thin sheet would gain energy without bound.
        lost = {
            "hyperviscosity": kinetic_loss(p, p.u, smoothed),
            "separation": jnp.sum(p.m * (moved @ model.g)),
        }
        return Regularised(p.u + smoothed, moved, lost)


def regularisations(
    hyperviscosity: float, separation: float, leaf: Callable[[float], Scalar]
) -> tuple[Regularisation, ...]:
    """Tuple of one regularisation with the given strengths; empty if both strengths are zero.

    `leaf` converts a number to an array in the scheme's precision.
    """
    if not (hyperviscosity or separation):
        return ()
    return (Regularisation(leaf(hyperviscosity), leaf(separation)),)


def kinetic_loss(p: Particles, u: Float[Array, "N D"], change: Float[Array, "N D"]) -> Scalar:
    """Kinetic energy lost through a change (m/s) of the velocities u (m/s), J (J/m in 2-D)."""
    return -jnp.sum(p.m * dot(columns(u + 0.5 * change), columns(change)))


def weight(r2: jax.Array, radius: Scalar) -> jax.Array:
    """Weight (-) of a neighbour at the squared distance r2 (m2) in the support of the given radius (m)."""
    return jnp.maximum(1.0 - r2 / radius**2, 0.0) ** 2


def lattice_sum(smoothing: Smoothing, dx: Scalar, dim: int) -> Scalar:
    """Sum of V times `weight` over the neighbours of a particle in a square or cubic lattice, m^dim."""
    axis = np.arange(-6.0, 7.0)  # every support ends within six spacings
    r2 = np.sum([a**2 for a in np.meshgrid(*(axis,) * dim)], axis=0).ravel()
    return jnp.sum(weight(dx * dx * jnp.asarray(r2[r2 > 0], dx.dtype), smoothing.radius)) * dx**dim
