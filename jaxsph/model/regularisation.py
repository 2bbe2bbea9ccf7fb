"""Regularisation of the particles: hyperviscosity against their noise, separation against their pairing."""

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
"""Strength of the hyperviscosity by default: the rate at which noise decays, over sqrt(g/h).

With 0.3 the flow beside the OWC is half again as noisy; with 3 the vortices at its lip lose more, and the OWC
a tenth of its efficiency (dx = 0.02 m).
"""

SEPARATION = 3.0
"""Strength of the separation by default: the rate at which pairs part, over sqrt(g/h)."""

PAIR = 0.6
"""Distance in spacings below which two particles are a pair: well below what waves bring about."""


WHOLE = 0.5 * PAIR
"""Displacement in spacings that takes two particles in one place to the distance of no pair."""


class Regularised(NamedTuple):
    """Changes that a regularisation makes, for the time since the last."""

    u: Float[Array, "N D"]
    """Velocities after it, m/s."""
    moved: Float[Array, "N D"]
    """Displacements beside the drift, m."""
    lost: dict[str, Scalar]
    """Energies that the water loses by it, by their names in the ledger, J (J/m in 2-D)."""


class Terms(NamedTuple):
    """Sums over pairs of a regularisation."""

    jump: Components
    """Sum of the velocities' jumps, m/s."""
    apart: Components
    """Sum of the directions from too near neighbours, in spacings (-)."""
    carried: Components
    """Change of velocity along `apart` by its gradient, in spacings, 1/s."""


class Regularisation(eqx.Module):
    """Hyperviscosity, which takes the noise of particles out of the velocity, and separation of their pairs.

    **Hyperviscosity** is a diffusion of velocity that velocities of second degree in space do not feel:
    du_i/dt = hyperviscosity sqrt(g/h) sum_j w_ij (u_j - u_i - (grad u_i + grad u_j)/2 . (x_j - x_i)), with
    weights w_ij in proportion to V_j W_ij^2 whose sum over a lattice is 1. It is to velocities what the
    diffusion of delta-SPH (Antuono et al. 2012) is to the density. Disorder of the particles gives their
    velocities a part that changes from one to the next. That part decays at this rate, in 0.05 s for
    dx = 0.02 m, while a wave k is damped in proportion to (kh)^4: an artificial viscosity, in proportion to
    (kh)^2, damps both. Where there are too few neighbours for a gradient, in spray and thin sheets, the sum
    fades out (`pairs.correctable`).

    **Separation** moves particles nearer than 0.6 spacings apart, as impacts bring them:
    dr_i/dt = separation sqrt(g/h) dx sum_j (V_j/dx^D) (1 - r_ij/(0.6 dx)) r_ij/|r_ij|, and carries their
    velocities along, u_i += (grad u_i + grad u_j)/2 . dr_ij. Particles farther apart do not feel it, neither
    in a wave nor at a surface: it cannot lift one.

    Both exchange momentum between pairs and lose none; their energies are booked. Without gravity the rate is
    zero, and both are off.
    """

    hyperviscosity: Scalar = eqx.field(converter=real)
    """Rate at which noise decays, over sqrt(g/h) (-)."""
    separation: Scalar = eqx.field(converter=real)
    """Rate at which pairs part, over sqrt(g/h) (-)."""

    def entries(self) -> dict[str, Entry]:
        """Energies that the regularisation takes, by their names in the ledger."""
        return {
            "hyperviscosity": Entry("energy lost by hyperviscosity"),
            "separation": Entry("energy lost where pairs of particles part"),
        }

    @staticmethod
    def law(unit: Scalar, dx: Scalar, pair: Pair, i: Fields, j: Fields) -> Terms:
        """Terms of one pair; walls take no part.

        **Arguments**: `unit`: `lattice_sum`; spacing `dx` (m); fields "u", "grad_u", "trust", and "V", the
        mass over rho0, with which pairs exchange momentum and lose none.
        """
        w = i["trust"] * j["trust"] * laws.water_volume(j) * pair.W**2 / unit
        jump = tuple(w * jump for jump in laws.velocity_jump(pair, i, j))
        # the guard is for the particle itself, which has no direction
        r = jnp.sqrt(pair.r2 + (1e-6 * dx) ** 2)
        # a particle without mass has nothing to be parted from: a copy that fills a slab would leap away
        size = jnp.where(i["V"] > 0.0, laws.water_volume(j), 0.0) / dx ** len(pair.r)
        near = size * jnp.maximum(1.0 - r / (PAIR * dx), 0.0) / r
        apart = tuple(near * component for component in pair.r)
        both = zip(i["grad_u"], j["grad_u"], strict=True)
        mean = (tuple(0.5 * (a + b) for a, b in zip(*gradients, strict=True)) for gradients in both)
        return Terms(jump, apart, tuple(dot(gradient, apart) for gradient in mean))

    def apply(
        self, scheme: AbstractScheme, model: Model, p: Particles, tables: Tables, t: Scalar
    ) -> Regularised:
        """Velocities (m/s) and displacements (m) after the time t (s), by two sums over pairs.

        t is that between two regularisations: whatever it is, noise and pairs are at most undone.
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
    """Regularisation of the given strengths as a scheme holds it: one, or none where both are zero.

    `leaf` makes an array of a number, in the scheme's precision.
    """
    if not (hyperviscosity or separation):
        return ()
    return (Regularisation(leaf(hyperviscosity), leaf(separation)),)


def kinetic_loss(p: Particles, u: Float[Array, "N D"], change: Float[Array, "N D"]) -> Scalar:
    """Kinetic energy lost by a change (m/s) of the velocities u (m/s), J (J/m in 2-D)."""
    return -jnp.sum(p.m * jnp.sum((u + 0.5 * change) * change, axis=1))


def lattice_sum(smoothing: Smoothing, dx: Scalar, dim: int) -> Scalar:
    """Sum of V W^2 over the neighbours of a particle of a square lattice, 1/m^dim, itself left out."""
    axis = np.arange(-6.0, 7.0)  # beyond six spacings the square of every kernel is as good as zero
    r2 = np.sum([a**2 for a in np.meshgrid(*(axis,) * dim)], axis=0).ravel()
    r2 = dx * dx * jnp.asarray(r2[r2 > 0], dx.dtype)
    W = jnp.where(r2 < smoothing.radius**2, smoothing.kernel.value(r2, smoothing.h, dim), 0.0)
    return jnp.sum(W**2) * dx**dim
