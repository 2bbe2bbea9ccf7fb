"""Kernels of least false stress on a lattice that does not buckle under pressure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jaxsph.core.kernels import Polynomial, power_integral
from jaxsph.core.lattice import deformed, false_stress, lattice_points, shear_stiffness, shear_waves

__all__ = ["least_stress"]

SAMPLES = 300
"""Number of random deformations."""
ROUNDING = 1e-6
"""Stiffness that passes for zero (-), in the precision of the kernels' slopes."""
MOST_CUTS = 20
"""Rounds in which modes that would buckle become constraints: two or three are the rule."""


def least_stress(dim: int, support: float, lowest: int = 3, terms: int = 7) -> Polynomial:
    """Polynomial kernel on whose lattice deformations meet the least false stress, and none grows by itself.

    False stress, slope and stiffness are linear in the shares of the powers: the sum of the stress's squares,
    over random deformations and over pure strain, is least for shares that sum to one, and with which the
    kernel decreases outwards and no transverse wave of displacements has a negative stiffness
    (`LatticeStress`).
    **Arguments**: the number of dimensions; the radius of the support over the spacing; the lowest power of
    1 - (r/R)^2 and the number of powers.
    **Returns**: the kernel; its smoothing length over the spacing is `support / kernel.reach`.
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
        # by its own word the search also fails where it is at the best shares to the last digits
        if abs(shares.sum() - 1.0) > ROUNDING or np.any(cuts @ shares < -ROUNDING):
            break
        values, modes = np.linalg.eigh(np.einsum("p,pkab->kab", shares, stiffness))
        wave, mode = np.nonzero(values < -ROUNDING)
        if not wave.size:
            return Polynomial.of(dim, [float(share) for share in shares], lowest)
        worst = modes[wave, :, mode]
        cuts = np.concatenate([cuts, np.einsum("ma,pmab,mb->mp", worst, stiffness[:, wave], worst)])
    raise ValueError(
        f"no kernel of {terms} powers from {lowest} on and a support of {support:g} spacings decreases and"
        f" leaves a lattice in {dim} dimensions stable: allow more powers or another support"
    )


def _slopes(lowest: int, terms: int, dim: int) -> NDArray[np.float64]:
    """Slopes that the powers give a kernel inwards, from its edge to its centre, `[100, terms]` (-)."""
    left = np.linspace(0.0, 1.0, 100)[:, None]  # 1 - (r/R)^2, of which all powers share the lowest
    powers = np.arange(lowest, lowest + terms)
    return powers / [power_integral(int(n), dim) for n in powers] * left ** (powers - lowest)


def _least_squares(gram: NDArray[np.float64], cuts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares of least stress that sum to one and whose product with no cut is negative."""
    n, scale = len(gram), 1.0 / np.trace(gram)
    found = optimize.minimize(
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
