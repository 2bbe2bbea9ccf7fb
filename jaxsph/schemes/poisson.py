"""Incompressible SPH by projection (Yeylaghi et al. 2016, Eq. 7-17; Cummins and Rudman 1999), 2-D and 3-D.
Equation numbers are those of Yeylaghi et al. unless another source is named."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.loop import steps

Unknown = Any


Operator = Callable[[Unknown], Unknown]


class AbstractSolver(eqx.Module):
    """How the pressure Poisson equation (9-12) is solved."""

    @abc.abstractmethod
    def solve(self, operator: Operator, b: Unknown, p: Unknown) -> Unknown:
        """Pressure (Pa) with operator(pressure) = b, from the last step's p (Pa).

        The operator is scaled by its diagonal, which is 1: p_i - sum A_ij p_j / sum A_ij. With a body the
        unknowns are a pair: the pressures, and the body's accelerations in units of pressure.
        """


class Explicit(AbstractSolver):
    """Eq. 13-15 (Hosseini et al. 2007): the pressure of the neighbours is the last step's. Pressure waves
    then travel about a spacing per step and sweep."""

    sweeps: int = eqx.field(static=True, default=1)

    def solve(self, operator, b, p):
        """See `AbstractSolver`."""

        def sweep(p):
            return jax.tree.map(lambda p, b, Ap: p + b - Ap, p, b, operator(p))

        return steps(sweep, p, self.sweeps)


class BiCGStab(AbstractSolver):
    """Stabilised biconjugate gradients (van der Vorst 1992), begun from the last step's pressure.

    The walls' pressures are interpolated, so the matrix is not symmetric. Derivatives are those of the
    solution, whatever the iteration did.
    """

    tolerance: float = eqx.field(static=True, default=3e-3)
    """Residual over the right-hand side, both as norms."""
    iterations: int = eqx.field(static=True, default=200)

    def solve(self, operator, b, p):
        """See `AbstractSolver`."""
        solve = jax.scipy.sparse.linalg.bicgstab
        # from the difference to the last pressure: in float32 the residual is then that of small numbers
        start = jax.lax.stop_gradient(p)
        rest = jax.tree.map(jnp.subtract, b, operator(start))
        size = jnp.sqrt(sum(jnp.vdot(a, a) for a in jax.tree.leaves(jax.lax.stop_gradient(b))))
        change, _ = solve(operator, rest, tol=0.0, atol=self.tolerance * size, maxiter=self.iterations)
        return jax.tree.map(jnp.add, start, change)


class AbstractSurface(eqx.Module):
    """What the Poisson equation is told of a free surface."""

    @abc.abstractmethod
    def free(self, filled: Float[Array, " N"]) -> Float[Array, " N"]:
        """1 for particles whose pressure is solved for, 0 where it is zero.

        `filled`: sum V W over that of a full kernel.
        """

    @abc.abstractmethod
    def missing(self, filled: Float[Array, " N"]) -> Float[Array, " N"]:
        """What the diagonal gains for every unit of the weights that are missing from it."""


class SurfaceParticles(AbstractSurface):
    """p = 0 for particles whose kernel is not full (Eq. 23-24)."""

    threshold: Scalar | float = 0.9
    """Share of a full kernel's sum up to which a particle is at the surface."""

    def free(self, filled):
        """See `AbstractSurface`."""
        return (filled > self.threshold).astype(filled.dtype)

    def missing(self, filled):
        """See `AbstractSurface`."""
        return jnp.zeros_like(filled)


class EmptyNeighbours(AbstractSurface):
    """Where neighbours are missing the pressure is -gain p_i (Nair and Tomar 2014 have 0)."""

    gain: Scalar | float = 1.0
    low: Scalar | float = 0.7
    high: Scalar | float = 0.85
    """Share of a full kernel's sum below which neighbours are missing, and above which none is."""

    def free(self, filled):
        """See `AbstractSurface`."""
        return jnp.ones_like(filled)

    def missing(self, filled):
        """See `AbstractSurface`."""
        s = jnp.clip((self.high - filled) / (self.high - self.low), 0.0, 1.0)
        return (1.0 + self.gain) * s * s * (3.0 - 2.0 * s)
