"""Pressure Poisson equation of the incompressible scheme: solvers and free-surface conditions.

Equation numbers refer to Yeylaghi et al. 2016 unless another source is named.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Int, Scalar
from jaxsph.core.loop import steps
from jaxsph.core.parts import ITERATION

Unknown = Any
"""Unknown of the equation: the water's pressures (Pa), and the bodies' accelerations scaled to pressures."""


Operator = Callable[[Unknown], Unknown]
"""Linear map from unknowns to unknowns."""


class AbstractSolver(eqx.Module):
    """Solver of the pressure Poisson equation (Eq. 9-12)."""

    @abc.abstractmethod
    def solve(self, operator: Operator, b: Unknown, p: Unknown) -> tuple[Unknown, Scalar, Array]:
        """Solves operator(pressure) = b for the pressure (Pa), starting from the last step's pressure p (Pa).

        The operator is scaled to a diagonal of 1: p_i - sum_j w_ij p_j / a_i, with the diagonal a_i of the
        unscaled matrix (`Poisson`). An unknown is a pair: the pressures, and the bodies' accelerations scaled
        to pressures.

        **Returns** the solution, the ratio of the residual's norm to the norm of b, and whether this ratio is
        within the solver's tolerance.
        """

    def tightened(self, factor: float) -> AbstractSolver:
        """Solver with a tolerance smaller by the `factor`; the same solver if it has no tolerance."""
        del factor
        return self


class Explicit(AbstractSolver):
    """Explicit solver that uses the neighbours' pressures of the last step (Eq. 13-15; Hosseini et al. 2007).

    With this solver pressure waves travel about one spacing per sweep. The residual is not computed.
    """

    sweeps: int = eqx.field(static=True, default=1)
    """Number of sweeps in a step; each sweep starts from the result of the previous one."""

    def solve(self, operator, b, p):
        """See `AbstractSolver.solve`."""

        def sweep(p):
            return jax.tree.map(lambda p, b, Ap: p + b - Ap, p, b, operator(p))

        p = steps(sweep, p, self.sweeps)
        return p, jnp.zeros((), b[0].dtype), jnp.array(True)


class BiCGStab(AbstractSolver):
    """Stabilised biconjugate gradient solver (van der Vorst 1992) that starts from the last step's pressure.

    The matrix is not symmetric because the walls' pressures are interpolated. The solution is differentiated,
    not the iteration: each derivative follows from a linear equation, which is solved to the same tolerance
    and starts from the derivative of the last step's pressure.
    """

    tolerance: float = eqx.field(static=True, default=3e-3)
    """Largest ratio of the norm of the residual to the norm of the right-hand side (-)."""
    iterations: int = eqx.field(static=True, default=1000)
    """Largest number of iterations.

    The required number grows with the depth of the water in spacings. For a box that sinks in water 105
    spacings deep, most steps need 4 to 20 iterations, and the slowest step needs about 200.
    """

    def tightened(self, factor):
        """See `AbstractSolver.tightened`."""
        return BiCGStab(self.tolerance / factor, self.iterations)

    def solve(self, operator, b, p):
        """See `AbstractSolver.solve`."""
        # solve for the change since the last step: the change is smaller than the pressure, and so are its
        # rounding errors in float32
        rest = jax.tree.map(jnp.subtract, b, operator(p))
        # A second unknown, equal to its right-hand side b, carries the norm of b to the iteration.
        # Transposition requires every part of the right-hand side to depend on the differentiated inputs.
        nothing = sum(0.0 * jnp.ravel(a)[0] for a in jax.tree.leaves(rest))
        rest, whole = jax.tree.map(lambda a: a + nothing, (rest, b))
        none = jax.tree.map(jnp.zeros_like, b)

        def extended(unknown):
            return operator(unknown[0]), unknown[1]

        def iterate(product, rhs):
            norm = _norm(rhs[1])
            measure = jnp.where(norm > 0.0, norm, _norm(rhs[0]))
            least = self.tolerance * measure

            x, residual = _bicgstab(product, rhs[0], least, self.iterations)
            return (x, rhs[1]), (
                residual / jnp.where(measure > 0.0, measure, 1.0),
                residual <= 1.001 * least,
            )  # the factor 1.001 allows for the rounding of a square root

        (change, _), (residual, converged) = jax.lax.custom_linear_solve(
            extended,
            (rest, whole),
            solve=lambda _, rhs: iterate(operator, rhs),
            transpose_solve=lambda matvec, rhs: iterate(lambda x: matvec((x, none))[0], rhs),
            has_aux=True,
        )
        return jax.tree.map(jnp.add, p, change), residual, converged


CYCLE = 50
"""Number of iterations after which the stabilised biconjugate gradient solver restarts.

The OWC needs 2 to 7 iterations per step with dx = 0.02 m. With dx = 0.005 m and without restarts, one step
in 5,500 stagnated: the residual after 200 iterations was still 1.1 times the tolerance.
"""


def _product(a: Unknown, b: Unknown) -> Scalar:
    """Scalar product of two unknowns."""
    first, *rest = (jnp.vdot(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))
    return sum(rest, start=first)


def _norm(a: Unknown) -> Scalar:
    """Euclidean norm of an unknown."""
    return jnp.sqrt(_product(a, a))


def _plus(a: Unknown, factor: Scalar | float, b: Unknown) -> Unknown:
    """Sum a + factor b of two unknowns."""
    return jax.tree.map(lambda x, y: x + factor * y, a, b)


def _bicgstab(operator: Operator, b: Unknown, least: Scalar, iterations: int) -> tuple[Unknown, Scalar]:
    """Solution of operator(x) = b with the initial guess x = 0, and the norm of its residual.

    The residual is at most `least`, unless `iterations` were not enough. After a breakdown, and after every
    `CYCLE` iterations, the iteration restarts from the solution found so far.
    """

    def goes_on(carry):
        _, r, spent = carry
        return (_product(r, r) > least**2) & (spent < iterations)

    def cycle(carry):
        x, r, spent = carry
        change, r, count = _cycle(operator, r, least, min(CYCLE, iterations))
        x = _plus(x, 1.0, change)
        # in float32 the recursive residual drifts away from the true one
        solved = _product(r, r) <= least**2
        r = jax.lax.cond(solved, lambda: r, lambda: _plus(b, -1.0, operator(x)))
        return x, r, spent + jnp.maximum(count, 1)

    start = (jax.tree.map(jnp.zeros_like, b), b, jnp.zeros((), jnp.int32))
    x, r, _ = jax.lax.while_loop(goes_on, cycle, start)
    return x, _norm(r)


def _cycle(
    operator: Operator, b: Unknown, least: Scalar, iterations: int
) -> tuple[Unknown, Unknown, Int[Array, ""]]:
    """Approximate solution of operator(x) = b with the initial guess x = 0, its residual, and the number of
    iterations.

    The iteration ends at the residual `least`, after `iterations`, or at a breakdown (van der Vorst 1992).
    """
    zero, one = jax.tree.map(jnp.zeros_like, b), jnp.ones_like(least)
    least2, size2 = least**2, _product(b, b)

    def goes_on(carry):
        *_, r2, count, broken = carry
        return (r2 > least2) & ~broken & (count < iterations)

    @jax.named_scope(ITERATION)
    def iterate(carry):
        x, r, p, v, rho, last, alpha, omega, before2, count, _ = carry
        p = _plus(r, rho / last * alpha / omega, _plus(p, -omega, v))
        v = operator(p)
        alpha = rho / _product(b, v)
        s = _plus(r, -alpha, v)
        t = operator(s)
        # Compute all products at once, and the products of the new residual s - omega t by expansion, because
        # with several devices every sum makes the devices wait for each other.
        s2, ts, t2, bs, bt = (_product(*pair) for pair in ((s, s), (t, s), (t, t), (b, s), (b, t)))
        early = s2 < least2
        omega = ts / t2
        r2 = jnp.where(early, s2, s2 - omega * ts)
        half = _plus(x, alpha, p)
        # after a division by a vanishing product, keep the previous solution
        lost = ~jnp.isfinite(r2)
        r2 = jnp.where(lost, before2, r2)
        x, r = (
            jax.tree.map(lambda a, b, c: jnp.where(lost, c, jnp.where(early, a, b)), *three)
            for three in ((half, _plus(half, omega, s), x), (s, _plus(s, -omega, t), r))
        )
        broken = lost | (rho == 0.0) | (alpha == 0.0) | (omega == 0.0)
        return x, r, p, v, bs - omega * bt, rho, alpha, omega, r2, count + 1, broken

    none = jnp.zeros((), jnp.int32)
    start = (zero, b, zero, zero, size2, one, one, one, size2, none, jnp.zeros((), bool))
    x, r, *_, count, _ = jax.lax.while_loop(goes_on, iterate, start)
    return x, r, count


class AbstractSurface(eqx.Module):
    """Free-surface condition of the pressure Poisson equation."""

    @abc.abstractmethod
    def free(self, filled: Float[Array, " N"]) -> Float[Array, " N"]:
        """Mask of particles: 1 where the pressure is solved for, 0 where the pressure is set to zero.

        `filled`: ratio of the kernel sum V W to its value in a full lattice (-).
        """

    @abc.abstractmethod
    def missing(self, filled: Float[Array, " N"]) -> Float[Array, " N"]:
        """Increase of the diagonal per unit of the missing neighbours' weights (-).

        `filled`: ratio of the kernel sum V W to its value in a full lattice (-).
        """


class SurfaceParticles(AbstractSurface):
    """Free-surface condition of zero pressure at particles whose kernel is not full (Eq. 23-24)."""

    threshold: Scalar | float = 0.9
    """A particle whose kernel sum is at most this fraction of a full kernel's sum is a surface
    particle (-)."""

    def free(self, filled):
        """See `AbstractSurface.free`."""
        return (filled > self.threshold).astype(filled.dtype)

    def missing(self, filled):
        """See `AbstractSurface.missing`."""
        return jnp.zeros_like(filled)


class EmptyNeighbours(AbstractSurface):
    """Free-surface condition that gives the missing neighbours of a particle i the pressure -gain p_i.

    Nair and Tomar 2014 use a gain of 0.
    """

    gain: Scalar | float = 1.0
    """Minus the ratio of a missing neighbour's pressure to the particle's pressure (-)."""
    low: Scalar | float = 0.7
    """Fraction of a full kernel's sum below which the missing neighbours have their full weight (-)."""
    high: Scalar | float = 0.85
    """Fraction of a full kernel's sum above which no neighbour is regarded as missing (-)."""

    def free(self, filled):
        """See `AbstractSurface.free`."""
        return jnp.ones_like(filled)

    def missing(self, filled):
        """See `AbstractSurface.missing`."""
        s = jnp.clip((self.high - filled) / (self.high - self.low), 0.0, 1.0)
        return (1.0 + self.gain) * s * s * (3.0 - 2.0 * s)
