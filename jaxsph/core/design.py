"""Design of kernels that minimise the spurious stress of a particle lattice and keep the lattice stable."""

from __future__ import annotations

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.core.kernels import Polynomial, power_integral
from jaxsph.core.lattice import deformed, false_stress, lattice_points, shear_stiffness, shear_waves

__all__ = ["least_stress"]

SAMPLES = 300
"""Number of random deformations."""
ROUNDING = 1e-6
"""Tolerance of the constraints (-). The kernels' slopes have rounding errors of this order."""
MOST_CUTS = 20
"""Largest number of optimisation rounds (-). Each round adds the buckling modes as constraints for the next
round; usually two or three rounds suffice."""


def least_stress(dim: int, support: float, lowest: int = 3, terms: int = 7) -> Polynomial:
    """Polynomial kernel with the least spurious stress among those that keep a lattice stable.

    The lattice is square in two dimensions and cubic in three. Spurious stress, slope and stiffness are
    linear in the shares of the powers of 1 - (r/R)^2. The shares minimise the mean square of the spurious
    stress under random deformations plus the mean square under pure strain. The minimisation has three
    constraints: the shares sum to one, the kernel decreases outwards, and no transverse displacement wave has
    a negative stiffness (`LatticeStress`).
    **Arguments**: `dim`: number of dimensions; `support`: ratio of the support radius to the spacing;
    `lowest`: lowest power; `terms`: number of powers. **Raises** ValueError if no kernel meets the
    constraints.
    **Returns**: the kernel. The ratio of its smoothing length to the spacing is `support / kernel.reach`.
    """
    powers = [Polynomial.of(dim, (1.0,), n) for n in range(lowest, lowest + terms)]
    lengths = [support / power.reach for power in powers]
    points = lattice_points("cubic", dim, support)
    gram = np.zeros((terms, terms))
    for lattices in deformed(points, SAMPLES):
        stress = [false_stress(power, h, lattices).ravel() for power, h in zip(powers, lengths, strict=True)]
        gram += np.inner(stress, stress) / len(lattices)
    waves = shear_waves("cubic", dim)
    stiffness = np.array(
        [shear_stiffness(power, h, points, waves) for power, h in zip(powers, lengths, strict=True)]
    )

    cuts = _slopes(lowest, terms, dim)
    for _ in range(MOST_CUTS):
        shares = _least_squares(gram, cuts)
        # SLSQP may report failure although it has reached the optimum to rounding error: check the result
        if abs(shares.sum() - 1.0) > ROUNDING or np.any(cuts @ shares < -ROUNDING):
            break
        values, modes = np.linalg.eigh(np.einsum("p,pkab->kab", shares, stiffness))
        wave, mode = np.nonzero(values < -ROUNDING)
        if not wave.size:
            return Polynomial.of(dim, [float(share) for share in shares], lowest)
        worst = modes[wave, :, mode]
        cuts = np.concatenate([cuts, np.einsum("ma,pmab,mb->mp", worst, stiffness[:, wave], worst)])
    raise ValueError(
        f"no kernel with terms = {terms}, lowest = {lowest} and support = {support:g} spacings decreases"
        f" outwards and keeps a lattice in {dim} dimensions stable: increase terms or change support"
    )


def _slopes(lowest: int, terms: int, dim: int) -> NDArray[np.float64]:
    """Slopes (-) of the normalised powers towards the centre, `[100, terms]`, at 100 points from the edge of
    the support to its centre, without a positive factor that all powers have in common."""
    left = np.linspace(0.0, 1.0, 100)[:, None]  # 1 - (r/R)^2; its power lowest - 1 is omitted
    powers = np.arange(lowest, lowest + terms)
    return powers / [power_integral(int(n), dim) for n in powers] * left ** (powers - lowest)


def _least_squares(gram: NDArray[np.float64], cuts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares of the powers (-) with the least mean square of the spurious stress. They sum to one, and no
    component of `cuts @ shares` is negative."""
    n, scale = len(gram), 1.0 / np.trace(gram)
    found = scipy.optimize.minimize(
        lambda shares: scale * shares @ gram @ shares,
        np.full(n, 1.0 / n),
        jac=lambda shares: 2.0 * scale * gram @ shares,
        constraints=[
            {"type": "eq", "fun": lambda shares: shares.sum() - 1.0, "jac": np.ones_like},
            {"type": "ineq", "fun": lambda shares: 1e3 * cuts @ shares, "jac": lambda _: 1e3 * cuts},
        ],
        method="SLSQP",
        options={"maxiter": 1000, "ftol": 1e-18},
    )
    return found.x
