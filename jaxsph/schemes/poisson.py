"""Pressure Poisson equation of the incompressible scheme: its solvers, and its free surface.
Equation numbers are those of Yeylaghi et al. 2016 unless another source is named."""

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
    """Way in which the pressure Poisson equation (9-12) is solved."""

    @abc.abstractmethod
    def solve(self, operator: Operator, b: Unknown, p: Unknown) -> tuple[Unknown, Scalar, Array]:
        """Pressure (Pa) with operator(pressure) = b, from the last step's p (Pa).

        Beside it the norm of its residual over that of b, and whether that is as little as promised.

        The operator is scaled by its diagonal, which is 1: p_i - sum A_ij p_j / sum A_ij. With bodies the
        unknowns are a pair: the pressures, and the bodies' accelerations in units of pressure.
        """


class Explicit(AbstractSolver):
    """Eq. 13-15 (Hosseini et al. 2007): the pressure of the neighbours is the last step's. Pressure waves
    then travel about a spacing per step and sweep. It promises no residual."""

    sweeps: int = eqx.field(static=True, default=1)

    def solve(self, operator, b, p):
        """See `AbstractSolver`."""

        def sweep(p):
            return jax.tree.map(lambda p, b, Ap: p + b - Ap, p, b, operator(p))

        p = steps(sweep, p, self.sweeps)
        return p, jnp.zeros((), b[0].dtype), jnp.array(True)


class BiCGStab(AbstractSolver):
    """Stabilised biconjugate gradients (van der Vorst 1992), begun from the last step's pressure.

    The walls' pressures are interpolated, so the matrix is not symmetric. Derivatives are those of the
    solution, whatever the iteration did: their linear equations are solved to the same tolerance, each over
    its own right-hand side.
    """

    tolerance: float = eqx.field(static=True, default=3e-3)
    """Residual over the right-hand side, both as norms."""
    iterations: int = eqx.field(static=True, default=200)

    def solve(self, operator, b, p):
        """See `AbstractSolver`."""
        # from the difference to the last pressure: in float32 the residual is then that of small numbers
        start = jax.lax.stop_gradient(p)
        rest = jax.tree.map(jnp.subtract, b, operator(start))
        # An unknown that is its own right-hand side tells the iteration the size of b. Of a tangent it is
        # zero, and there the right-hand side itself is the measure.
        size = jax.lax.stop_gradient(_norm(b))
        # Transposition wants every part of the right-hand side to depend on what is differentiated.
        nothing = sum(0.0 * jnp.ravel(a)[0] for a in jax.tree.leaves(rest))
        rest, size = jax.tree.map(lambda a: a + nothing, (rest, size))

        def extended(unknown):
            return operator(unknown[0]), unknown[1]

        def iterate(matvec, rhs):
            measure = jnp.where(rhs[1] > 0.0, rhs[1], _norm(rhs[0]))
            least = self.tolerance * measure

            def inner(x):
                return matvec((x, jnp.zeros_like(size)))[0]

            x, residual = _bicgstab(inner, rhs[0], least, self.iterations)
            return (x, rhs[1]), (
                residual / jnp.where(measure > 0.0, measure, 1.0),
                residual <= 1.001 * least,
            )  # but for the rounding of a square root

        (change, _), (residual, converged) = jax.lax.custom_linear_solve(
            extended, (rest, size), solve=iterate, transpose_solve=iterate, has_aux=True
        )
        return jax.tree.map(jnp.add, start, change), residual, converged


def _product(a: Unknown, b: Unknown) -> Scalar:
    """Scalar product of two unknowns."""
    return sum(jnp.vdot(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


def _norm(a: Unknown) -> Scalar:
    """Euclidean norm of an unknown."""
    return jnp.sqrt(_product(a, a))


def _plus(a: Unknown, factor: Scalar, b: Unknown) -> Unknown:
    """a + factor b."""
    return jax.tree.map(lambda x, y: x + factor * y, a, b)


def _bicgstab(operator: Operator, b: Unknown, least: Scalar, iterations: int) -> tuple[Unknown, Scalar]:
    """Solution of operator(x) = b from x = 0, and the norm of its residual, which is at most `least` unless
    the iterations ran out or broke down (van der Vorst 1992)."""
    zero, one = jax.tree.map(jnp.zeros_like, b), jnp.ones_like(least)
    least2 = least**2

    def goes_on(carry):
        _, r, *_, count = carry
        return (_product(r, r) > least2) & (count >= 0) & (count < iterations)

    def iterate(carry):
        x, r, p, v, rho, alpha, omega, count = carry
        rho_new = _product(b, r)
        beta = rho_new / rho * alpha / omega
        p = _plus(r, beta, _plus(p, -omega, v))
        v = operator(p)
        alpha = rho_new / _product(b, v)
        s = _plus(r, -alpha, v)
        early = _product(s, s) < least2
        t = operator(s)
        omega = _product(t, s) / _product(t, t)
        half = _plus(x, alpha, p)
        x, r = (
            jax.tree.map(lambda a, b: jnp.where(early, a, b), *both)
            for both in ((half, _plus(half, omega, s)), (s, _plus(s, -omega, t)))
        )
        broken = (rho_new == 0.0) | (alpha == 0.0) | (omega == 0.0)
        return x, r, p, v, rho_new, alpha, omega, jnp.where(broken, -1, count + 1)

    start = (zero, b, zero, zero, one, one, one, jnp.zeros((), jnp.int32))
    x, r, *_ = jax.lax.while_loop(goes_on, iterate, start)
    return x, _norm(r)


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
