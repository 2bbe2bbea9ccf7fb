"""Fickian shifting, which keeps particles evenly distributed."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, real, stack
from jaxsph.core.pairs import Pair
from jaxsph.core.slabs import Sources
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.state import Tables


class Shifting(eqx.Module):
    """Fickian shifting of particles, down the gradient of their concentration.

    Source: Lind et al. 2012, with the sum of Sun et al. 2017, Eq. 6, which also prevents particles from
    pairing: dr_i = -strength h U dt sum_j (1 + 0.2 (W_ij/W(dx))^4) grad W_ij V_j, at most U dt/2, where U is
    the largest speed. Shifting fades out near a free surface, where the support is not full and the
    concentration gradient is due to the surface. Velocities and densities stay with their particles.
    Therefore angular momentum is not conserved, and a free surface creeps outwards. Use shifting where
    pressures are negative (`python -m experiments run rotating_square`), not where all pressures are positive
    (`python -m experiments run oscillating_drop`).

    A flow that stretches the lattice needs shifting. Without shifting the lattice breaks up, and the energy
    of the Taylor-Green vortex at Re = 100 decays 2.4 times as fast as in the exact solution
    (`python -m experiments run taylor_green`).
    """

    strength: Scalar = eqx.field(converter=real)
    """Strength of the shifting (-).

    A strength of 12 keeps the particles ordered in the tests with exact solutions; with a strength of 3 some
    energy is still lost. Shifting is a diffusion, which is stable while strength times U is below c0.
    """

    def displacement(
        self,
        scheme: AbstractScheme,
        model: Model,
        u: Float[Array, "N D"],
        sources: Sources,
        tables: Tables,
        dt: Scalar,
    ) -> Float[Array, "N D"]:
        """Displacement of each particle by shifting in a step of dt (s), m."""
        dim = u.shape[1]
        h, kernel = scheme.smoothing.h, scheme.smoothing.kernel
        W_dx = kernel.value(model.dx**2, h, dim)

        def law(pair: Pair, i, j):
            w = laws.volume(j) * pair.F
            crowded = w * (1.0 + 0.2 * (pair.W / W_dx) ** 4)
            return tuple(crowded * r for r in pair.r), -w * pair.r2

        gradient, trace = tables.fluid.sum(law, scheme.smoothing, sources.water, sources)
        speed = jnp.sqrt(jnp.max(jnp.sum(u**2, axis=1)))
        # the trace is dim within a few per cent for a full support, and dim/2 for half a support
        inside = jnp.clip((trace / dim - 0.8) / 0.15, 0.0, 1.0)
        move = self.strength * h * stack(gradient) * inside[:, None]
        # the guard keeps the derivative finite at zero
        size = jnp.sqrt(jnp.sum(move**2, axis=1, keepdims=True) + 1e-12)
        return -speed * dt * move * jnp.minimum(1.0, 0.5 / size)
