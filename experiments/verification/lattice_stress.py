"""Spurious stress of a strained and of a randomly distorted lattice, for every kernel.

The kernels are chosen by this measure; see `jaxsph.core.lattice`.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.common import Report
from jaxsph.core.design import least_stress
from jaxsph.core.kernels import AbstractKernel, Gaussian, Polynomial, Semicircle, WendlandC2
from jaxsph.core.lattice import lattice_stress
from jaxsph.schemes.kernels import POLYNOMIAL, SEMICIRCLE, SUPPORT, usual_length

LATTICE = {"cubic": {2: "square", 3: "cubic"}, "close": {2: "triangular", 3: "body-centred"}}
BEFORE = {2: (Gaussian(), 1.2), 3: (WendlandC2(), 1.5)}
"""Earlier default kernels with their smoothing lengths divided by dx, by number of dimensions."""
BAR = {2: 0.3, 3: 0.1}


def main() -> None:
    """Measures all kernels on all lattices, and semicircle and polynomial for several support radii."""
    with Report("lattice_stress", "Spurious stress of a strained lattice over its pressure") as report:
        figure = Figure(figsize=(9, 3.8), layout="constrained")
        for dim, axis in zip((2, 3), figure.subplots(1, 2), strict=True):
            for lattice, names in LATTICE.items():
                for label, kernel, h in kernels(dim):
                    found = lattice_stress(kernel, h, dim, lattice)
                    what = f"{names[dim]}, {label}"
                    report.row(f"{what}: neighbours", found.neighbours)
                    report.row(
                        f"{what}: largest stress in pure strain up to 0.25", found.strained, theory=0.0
                    )
                    report.row(
                        f"{what}: RMS stress in random distortions (standard deviation 0.12)",
                        found.distorted,
                        theory=0.0,
                    )
                    if lattice == "cubic":
                        report.row(
                            f"{what}: smoothing length of the Gaussian with the same second moment",
                            found.width,
                            "dx",
                        )
                        report.row(f"{what}: smallest value of the Fourier transform", found.transform)
                        report.row(f"{what}: smallest stiffness against shear waves", found.stiffness)
            of_old = lattice_stress(*BEFORE[dim], dim)
            for label, kernel in (("semicircle", SEMICIRCLE[dim]), ("polynomial", POLYNOMIAL[dim])):
                chosen = lattice_stress(kernel, usual_length(kernel, dim), dim)
                for name, words in (("strained", "pure strain"), ("distorted", "random distortions")):
                    ratio = getattr(chosen, name) / getattr(of_old, name)
                    before = type(BEFORE[dim][0]).__name__
                    report.row(
                        f"{dim}-D: stress in {words}, {label} over {before}",
                        ratio,
                        bar=f"< {BAR[dim]:g}",
                        passes=ratio < BAR[dim],
                    )
            over_support(axis, dim)
        report.picture(figure)


def kernels(dim: int) -> list[tuple[str, AbstractKernel, float]]:
    """Kernels with names and smoothing lengths divided by dx."""
    semicircle, polynomial = SEMICIRCLE[dim], POLYNOMIAL[dim]
    return [
        ("Gaussian, h = 1.2 dx, support 4.2 dx", Gaussian(), 1.2),
        ("Gaussian, h = dx, support 3.5 dx", Gaussian(), 1.0),
        ("Wendland C2, support 3 dx", WendlandC2(), 1.5),
        ("Wendland C2, support 4 dx", WendlandC2(), 2.0),
        (
            f"semicircle, beta = {semicircle.beta:g}, support {SUPPORT[Semicircle][dim]:g} dx",
            semicircle,
            usual_length(semicircle, dim),
        ),
        (
            f"polynomial, support {SUPPORT[Polynomial][dim]:g} dx",
            polynomial,
            usual_length(polynomial, dim),
        ),
    ]


def over_support(axis, dim: int) -> None:
    """Draws stress over support radius, for semicircles of several steepnesses and for the polynomial."""

    def distorted(kernel: AbstractKernel, R: float) -> float:
        return lattice_stress(kernel, R / kernel.reach, dim).distorted

    support = np.arange(2.6, 3.65, 0.1)
    for k, beta in enumerate((12.0, 13.0, 14.0, 15.0, 16.0)):
        kernel = Semicircle.of(dim, beta)
        stress = [distorted(kernel, R) for R in support]
        axis.semilogy(support, stress, "o-", ms=3, color=f"C{k}", label=f"beta = {beta:g}")
    stress = [distorted(least_stress(dim, R), R) for R in support]
    axis.semilogy(support, stress, "k.-", label="stable polynomial")
    kernel, h = BEFORE[dim]
    before = lattice_stress(kernel, h, dim).distorted
    axis.axhline(before, color="0.5", lw=1, label=f"{type(kernel).__name__} to {kernel.reach * h:.3g} dx")
    axis.set(xlabel="support, dx", ylabel="spurious stress over p, RMS", title=f"{dim}-D")
    axis.legend(fontsize="small")
