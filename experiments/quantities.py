"""Values of the committed results that occur in several sentences of the documentation."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from experiments.prose import Results

PROJECTION, HYPERVISCOSITY = "lost in the projection", "lost by hyperviscosity"
"""Terms of the energy budget."""
HIGH = "dx = 0.04 m, cfl = {}, relaxation = 1.5: "
"""Beginning of the rows of a run of `high_waves`, by its Courant number."""
DISTANCES = ("0.5 wavelengths", "1 wavelength", "2 wavelengths")
"""Distances of the gauges from the paddle in `wave_tank`."""
SPACINGS = (20, 10, 5)
"""Spacings of the convergence study, mm."""


def of_owc(name: str) -> Callable[[Results], float]:
    """Energy `name` of the built-in OWC, % of the paddle's work."""
    return lambda r: 100 * r("owc_0.02", f"energy: {name}") / r("owc_0.02", "energy: paddle")


def share(name: str, term: str, run: str = "") -> Callable[[Results], float]:
    """Term of the energy budget in the results `name`, % of the paddle's work.

    `run`: beginning of the name of the row.
    """
    return lambda r: r(name, f"{run}energy {term}, over the paddle's work")


def spacings(what: str, kind: str = "incompressible") -> Callable[[Results], tuple[float, ...]]:
    """Values `what` of the convergence study at three spacings, or at two for the weakly compressible
    scheme."""
    present = SPACINGS if kind == "incompressible" else SPACINGS[:2]
    return lambda r: tuple(r("convergence", f"{kind}, {mm} mm: {what}") for mm in present)


def over_theory(r: Results, name: str, beginning: str) -> tuple[float, float]:
    """Smallest and largest ratio to theory (-) among the rows whose checks begin with `beginning`."""
    return ends(row["here"] / row["theory"] for row in r.rows(name, beginning))


def too_low(r: Results, *names: str) -> tuple[float, float]:
    """Smallest and largest shortfall of efficiencies in low waves below linear theory, % of theory."""
    return ends(100 * (1 - ratio) for name in names for ratio in over_theory(r, name, "xi at "))


def missing(name: str) -> Callable[[Results], tuple[float, ...]]:
    """Shortfalls of the efficiency at K_dm = 960 in low waves below linear theory, %, longest waves first."""
    return lambda r: tuple(
        100 * (1 - row["here"] / row["theory"]) for row in reversed(list(r.rows(name, "xi at K_dm = 960")))
    )


def lost_in_filter(r: Results) -> tuple[float, float]:
    """Smallest and largest share of the water's response that the filter of derivatives removes, per cent."""
    return ends(
        100
        * r("filter_study_0.02", f"K_dm = {damping}: share of the water's response that the filter removes")
        for damping in ("257", "534.66", "1300")
    )


def ends(values: Iterable[float]) -> tuple[float, float]:
    """The smallest and the largest value."""
    found = list(values)
    return min(found), max(found)
