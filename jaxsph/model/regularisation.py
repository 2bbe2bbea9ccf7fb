"""Regularisation of the particles: hyperviscosity against velocity noise, separation against clumping."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, dot, real, stack
from jaxsph.core.pairs import (
    Fields,
    Pair,
    Smoothing,
    correctable,
    symmetric_inverse,
    symmetric_product,
)
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
"""Default strength of the hyperviscosity (-): ratio of the decay rate of velocity noise to sqrt(g/h).

In the OWC case at dx = 0.02 m, a strength of 0.3 instead of 1 leaves 1.5 times as much noise in the flow
beside the OWC. With a strength of 3, the vortices at the OWC's lip lose more energy, and the OWC's efficiency
falls by a tenth.
"""

SEPARATION = 3.0
"""Default strength of the separation (-): ratio of the rate at which clumped particles separate to
sqrt(g/h)."""

PAIR = 0.6
"""Distance in spacings below which two particles are clumped. In waves particles stay much farther apart."""


WHOLE = 0.5 * PAIR
"""Displacement, in spacings, by which two coincident particles must each move to be `PAIR` apart."""


class Regularised(NamedTuple):
    """Result of a regularisation, for the time since the previous regularisation."""

    u: Float[Array, "N D"]
    """Velocities after the regularisation, m/s."""
    moved: Float[Array, "N D"]
    """Displacements in addition to the drift, m."""
    lost: dict[str, Scalar]
    """Energies that the water loses, by their names in the ledger, J (J/m in 2-D)."""


class Terms(NamedTuple):
    """Pair sums of a regularisation."""

    jump: Components
    """Weighted sum of the velocity jumps (`laws.velocity_jump`), m/s."""
    apart: Components
    """Weighted sum of the unit vectors away from neighbours that are too near (-)."""
    carried: Components
    """Velocity gradient times `apart`, 1/s."""


class Regularisation(eqx.Module):
    """Hyperviscosity, which damps the velocity noise of particles, and separation of clumped particles.

    **Hyperviscosity** is a velocity diffusion that vanishes for velocities up to second degree in space:
    du_i/dt = hyperviscosity sqrt(g/h) sum_j w_ij (u_j - u_i - (grad u_i + grad u_j)/2 . (x_j - x_i)), with
    weights w_ij proportional to V_j W_ij^2, whose sum over a lattice is 1. This diffusion has the form of the
    density diffusion in delta-SPH (Antuono et al. 2012). Disorder of the particles adds noise to their
    velocities that varies from one particle to the next. The noise decays at the rate hyperviscosity
    sqrt(g/h), within 0.05 s for dx = 0.02 m. The damping of a wave with wavenumber k is much weaker, because
    it is proportional to (kh)^4. An artificial viscosity, whose damping is proportional to (kh)^2, damps both
    noise and waves. In spray and thin sheets, where particles have too few neighbours for a gradient, the sum
    fades out (`pairs.correctable`).

    **Separation** moves apart particles that an impact has brought closer than 0.6 spacings:
    dr_i/dt = separation sqrt(g/h) dx sum_j (V_j/dx^D) (1 - r_ij/(0.6 dx)) r_ij/|r_ij|. The velocities change
    with the displacement, u_i += (grad u_i + grad u_j)/2 . dr_ij. Particles farther apart are not affected,
    either in a wave or at a surface. Separation therefore cannot lift a surface.

    Hyperviscosity and separation conserve the momentum of every pair, and the ledger contains the energies
    that they take. Without gravity the rate sqrt(g/h) is zero, and both have no effect.
    """

    hyperviscosity: Scalar = eqx.field(converter=real)
    """Ratio of the decay rate of velocity noise to sqrt(g/h) (-)."""
    separation: Scalar = eqx.field(converter=real)
    """Ratio of the rate at which clumped particles separate to sqrt(g/h) (-)."""

    def entries(self) -> dict[str, Entry]:
        """Energies that the regularisation takes, by their names in the ledger."""
        return {
            "hyperviscosity": Entry("energy lost by hyperviscosity"),
            "separation": Entry("energy lost by separation of clumped particles"),
        }

    @staticmethod
    def law(unit: Scalar, dx: Scalar, pair: Pair, i: Fields, j: Fields) -> Terms:
        """Terms of one pair of water particles; the terms of walls are zero.

        **Arguments**: `unit`: result of `lattice_sum`; `dx`: spacing, m; `i`, `j`: fields "u", "grad_u",
        "trust" (`pairs.correctable`), and "V", the mass divided by rho0, with which pairs conserve momentum.
        """
        w = i["trust"] * j["trust"] * laws.water_volume(j) * pair.W**2 / unit
        jump = tuple(w * jump for jump in laws.velocity_jump(pair, i, j))
        # the guard is for r = 0, where the direction is undefined
        r = jnp.sqrt(pair.r2 + (1e-6 * dx) ** 2)
        # particles without mass (copies that fill up a slab) are not separated, since they would jump away
        size = jnp.where(i["V"] > 0.0, laws.water_volume(j), 0.0) / dx ** len(pair.r)
        near = size * jnp.maximum(1.0 - r / (PAIR * dx), 0.0) / r
        apart = tuple(near * component for component in pair.r)
        both = zip(i["grad_u"], j["grad_u"], strict=True)
        mean = (tuple(0.5 * (a + b) for a, b in zip(*gradients, strict=True)) for gradients in both)
        return Terms(jump, apart, tuple(dot(gradient, apart) for gradient in mean))

    def apply(
        self, scheme: AbstractScheme, model: Model, p: Particles, tables: Tables, t: Scalar
    ) -> Regularised:
        """Velocities (m/s) and displacements (m) after the time t (s), by two pair sums.

        t is the time between two regularisations. Noise and clumping are at most removed, however large t is.
        """
        smoothing, dim = scheme.smoothing, p.x.shape[1]
        own = {"x": columns(p.x), "V": p.m / scheme.rho0, "u": columns(p.u)}

        def gradient(pair: Pair, i: Fields, j: Fields):
            return laws.moment_matrix(pair, i, j), laws.velocity_gradient(pair, i, j)

        of_water = tables.fluid.of_water()
        M, G = of_water.sum(gradient, smoothing, own, Sources(own, {}))
        L = symmetric_inverse(M)
        grad_u = tuple(symmetric_product(L, row) for row in G)
        own = own | {"grad_u": grad_u, "trust": correctable(M)}
        law = functools.partial(self.law, lattice_sum(smoothing, model.dx, dim), model.dx)
        terms = of_water.sum(law, smoothing, own, Sources(own, {}))
        rate = smoothing.gravity_rate(model.g)
        smoothed = -jnp.expm1(-self.hyperviscosity * rate * t) * stack(terms.jump)
        share = -WHOLE * jnp.expm1(-self.separation * rate * t / WHOLE) * model.dx
        moved, carried = share * stack(terms.apart), share * stack(terms.carried)
        lifted = -jnp.sum(p.m * (moved @ model.g))
        lost = {
            "hyperviscosity": kinetic_loss(p, p.u, smoothed),
            "separation": kinetic_loss(p, p.u + smoothed, carried) - lifted,
        }
        return Regularised(p.u + smoothed + carried, moved, lost)


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
    """Kinetic energy lost by a change (m/s) of the velocities u (m/s), J (J/m in 2-D)."""
    return -jnp.sum(p.m * jnp.sum((u + 0.5 * change) * change, axis=1))


def lattice_sum(smoothing: Smoothing, dx: Scalar, dim: int) -> Scalar:
    """Sum of V W^2 over the neighbours of a particle in a square or cubic lattice, 1/m^dim."""
    axis = np.arange(-6.0, 7.0)  # beyond six spacings the square of every kernel is negligible
    r2 = np.sum([a**2 for a in np.meshgrid(*(axis,) * dim)], axis=0).ravel()
    r2 = dx * dx * jnp.asarray(r2[r2 > 0], dx.dtype)
    W = jnp.where(r2 < smoothing.radius**2, smoothing.kernel.value(r2, smoothing.h, dim), 0.0)
    return jnp.sum(W**2) * dx**dim
