"""Sentences of the README and the documentation whose numbers are taken from the committed results.

`python -m experiments gallery` writes the present numbers into the pages; a test compares them.
"""

from __future__ import annotations

from pathlib import Path

from experiments.model_sentences import OF_MODELS, SLOPES
from experiments.prose import Results, Sentence, renewed
from experiments.quantities import (
    DISTANCES,
    HIGH,
    HYPERVISCOSITY,
    PROJECTION,
    ends,
    lost_in_filter,
    missing,
    of_owc,
    over_theory,
    share,
    spacings,
    too_low,
)

ROOT = Path(__file__).parents[1]
README, TUTORIAL = "README.md", "docs/tutorial.md"
METHOD, MEASURED = "docs/method.md", "docs/measurements.md"
WAVES = "docs/how-to/own-waves.md"
ISPH, WCSPH = "docs/theory/incompressible.md", "docs/theory/weakly-compressible.md"

PROSE = (
    # README
    Sentence(
        "RMS pressure error over rho g d | 1 % | {:.2f} %",
        lambda r: (r("hydrostatic", "2-D, dx = d/40, float32: RMS pressure error / rho g d"),),
        (README,),
    ),
    Sentence(
        "decay of the amplitude | 1 %; reported | {:+.1f} %; {:.4f} /s",
        lambda r: (
            r("incompressible", "standing wave, incompressible: period error"),
            max(
                r("incompressible", f"the same: decay of the amplitude, {scheme}")
                for scheme in ("weakly compressible", "incompressible")
            ),
        ),
        (README,),
    ),
    Sentence(
        "divided by the column's width | 0.043 | {:.3f}",
        lambda r: (
            r(
                "dam_break_front",
                "H/dx = 60: largest distance of the front from the envelope of the shifted measurements",
            ),
        ),
        (README,),
    ),
    Sentence(
        "(paper: 5.9, 6.1, 5.6 %) | {:.1f}, {:.1f}, {:.1f} %",
        lambda r: tuple(r("wave_tank_0.01_incompressible", f"MAE_a at {x}") for x in DISTANCES),
        (README,),
    ),
    Sentence(
        "energy not accounted for, as a share of the paddle's work | 2 % | {:.4f} %",
        lambda r: (share("owc_0.02", "not accounted for")(r),),
        (README,),
    ),
    Sentence(
        "(linear theory, without losses: {:.3f})",
        lambda r: (r("convergence", "linear theory, zeta = 0: xi"),),
        (README,),
    ),
    Sentence("| 5 and 2.5 % apart | {:.3f}, {:.3f} and {:.3f} |", spacings("xi"), (README,)),
    Sentence(
        "| 10 % | **{:.0f} to {:.0f} % too low** |", lambda r: too_low(r, "small_waves_0.01"), (README,)
    ),
    Sentence(
        "impulse of the force (in the laboratory: {:.1f} N s) | 20 % | {:.1f} N s",
        lambda r: (
            r("column_0.01", "impulse of the force to 1.145 s after the impact", column="theory"),
            r("column_0.01", "impulse of the force to 1.145 s after the impact"),
        ),
        (README,),
    ),
    # tutorial
    Sentence("The **hydrodynamic efficiency** is {:.2f}", lambda r: (r("owc_0.02", "xi"),), (TUTORIAL,)),
    Sentence(
        "{:.0f} % goes to the turbine and {:.0f} % to hyperviscosity",
        lambda r: (of_owc("pto")(r), of_owc("hyperviscosity")(r)),
        (TUTORIAL,),
    ),
    Sentence(
        "the efficiency is {:.3f}, {:.3f} and {:.3f} at dx = 0.02, 0.01 and 0.005 m",
        spacings("xi"),
        (TUTORIAL,),
    ),
    Sentence(
        "The efficiency at the coarsest spacing is {:.1f} % below that at the finest",
        lambda r: (100 * (1 - spacings("xi")(r)[0] / spacings("xi")(r)[-1]),),
        (TUTORIAL,),
    ),
    Sentence(
        "has its maximum near {:.0f}, with an efficiency of {:.2f}",
        lambda r: (
            r("best_damping_0.02", "best K_dm of the fitted sweep"),
            r("best_damping_0.02", "largest xi of the fitted sweep"),
        ),
        (TUTORIAL,),
    ),
    Sentence(
        "the search from 150 ends at {:.0f}, and the search from 2400 at {:.0f}",
        lambda r: tuple(r("best_damping_0.02", f"from K_dm = {start}: best K_dm") for start in (150, 2400)),
        (TUTORIAL,),
    ),
    Sentence(
        "the annual mean is {:.3f} ± {:.3f} W/m, which is {:.2f} of linear theory",
        lambda r: (
            power := r("annual_power_0.02", "annual mean power"),
            r("annual_power_0.02", "standard error of the annual mean power"),
            power / r("annual_power_0.02", "annual mean power", column="theory"),
        ),
        (TUTORIAL,),
    ),
    Sentence(
        "this ratio lies between {:.2f} and {:.2f}",
        lambda r: over_theory(r, "annual_power_0.02", "mean power, "),
        (TUTORIAL,),
    ),
    Sentence(
        "the standard error of the mean power in a single cell is {:.0f} to {:.0f} %",
        lambda r: (
            r("annual_power_0.02", "smallest standard error of a cell"),
            r("annual_power_0.02", "largest standard error of a cell"),
        ),
        (TUTORIAL,),
    ),
    Sentence(
        "the slope of the mean power is known to {:.0f} %",
        lambda r: (
            100
            * r("sea_slope_0.02", "1e4 times the standard error of the ensemble's slope")
            / r("sea_slope_0.02", "1e4 times the ensemble's slope"),
        ),
        (TUTORIAL,),
    ),
    # method
    Sentence(
        "has {:.2f} times the Gaussian's spurious stress in pure strain",
        lambda r: (r("lattice_stress", "2-D: stress in pure strain, polynomial over Gaussian"),),
        (METHOD,),
    ),
    Sentence(
        "loses {:.3f} of this amplitude per second ({:.3f} in a tank without walls); with the paper's "
        "mirror nodes it loses {:.3f}",
        lambda r: tuple(
            r("contact_line_0.04_0.01", f"{wall}: decay rate") for wall in ("images", "periodic", "mirror")
        ),
        (METHOD,),
    ),
    Sentence(
        "floats with a draught error of {:.1f} %",
        lambda r: (abs(r("floating", "box of 0.3 times the water's density: error of the draught")),),
        (METHOD,),
    ),
    Sentence(
        "For the OWC {:.4f} % of the paddle's work is not accounted for",
        lambda r: (abs(share("owc_0.02", "not accounted for")(r)),),
        (METHOD,),
    ),
    Sentence(
        "It dissipates {:.0f} % in the built-in case at dx = 0.02 m (`owc`), and {:.0f}, {:.0f} and {:.0f} % "
        "at",
        lambda r: (
            of_owc("hyperviscosity")(r),
            *spacings("energy lost by hyperviscosity, over the paddle's work")(r),
        ),
        (METHOD,),
    ),
    Sentence(
        "The projection** removes {:.1f} % in the built-in OWC (`owc`) and up to {:.0f} % in high waves",
        lambda r: (
            of_owc("projection")(r),
            share("high_waves", PROJECTION, HIGH.format(0.25))(r),
        ),
        (METHOD,),
    ),
    Sentence(
        "keeps moving at {:.2f} m/s, and at {:.3f} m/s beside a wall five spacings thick",
        lambda r: tuple(
            r("thin_wall", f"incompressible, wall {n} dx thick: largest speed at the end") for n in (1, 5)
        ),
        (METHOD,),
    ),
    Sentence(
        "the OWC's efficiency is {:.0f} to {:.0f} % below linear theory",
        lambda r: too_low(r, "small_waves_0.01", "small_waves_0.02"),
        (METHOD,),
    ),
    *(
        Sentence(
            f"| dx = {dx:g} m ({words}) | {{:.0f}} % | {{:.0f}} % | {{:.0f}} % | {{:.0f}} % |",
            of,
            (MEASURED,),
        )
        for dx, words, of in (
            (0.02, "waves 0.42 spacings high", missing("small_waves_0.02")),
            (0.01, "0.84 spacings", missing("small_waves_0.01")),
        )
    ),
    Sentence(
        "The projection now removes {:.1f} % of this work (`still_tank`)",
        lambda r: (
            r(
                "still_tank_0.02",
                "wave_tank, whole run: energy removed by the projection over the paddle's work",
            ),
        ),
        (MEASURED,),
    ),
    Sentence(
        "{:.2f} % of the air's work is not accounted for, and the mean level falls by {:.2f} % of the depth",
        lambda r: (
            r("vessel_0.01", "energy not accounted for / work of the air"),
            -r("vessel_0.01", "change of the mean level / depth"),
        ),
        (MEASURED,),
    ),
    Sentence(
        "particles keep moving at up to {:.2f} m/s at dx = 0.02 m",
        lambda r: (r("thin_wall", "incompressible, wall 1 dx thick: largest speed at the end"),),
        (MEASURED,),
    ),
    Sentence(
        "lose {:.0f} % in the projection and {:.0f} % to hyperviscosity. With `scheme.cfl` = 0.12 instead of "
        "0.25 they lose {:.0f} and {:.0f} %",
        lambda r: tuple(
            share("high_waves", term, HIGH.format(cfl))(r)
            for cfl in (0.25, 0.12)
            for term in (PROJECTION, HYPERVISCOSITY)
        ),
        (METHOD,),
    ),
    Sentence(
        "the period is {:.0f} % too long where a wave has 25 spacings",
        lambda r: (r("contact_line_0.04_0.01", "images: error of the period against linear theory"),),
        (METHOD,),
    ),
    Sentence(
        "Spurious velocities in still water reach {:.2f} % of sqrt(g d)",
        lambda r: (r("still_tank_0.02", "3-D, d/dx = 20, 10 s: largest speed after 3 s over sqrt(g d)"),),
        (METHOD,),
    ),
    Sentence(
        "The flap at dx = 0.04 m loses {:.0f} % in the projection and {:.0f} % to hyperviscosity",
        lambda r: (
            share("flap_3d_0.04", PROJECTION)(r),
            share("flap_3d_0.04", HYPERVISCOSITY)(r),
        ),
        (METHOD,),
    ),
    Sentence(
        "loses {:.1f} % of the wave height per wavelength where waves are four spacings high; incompressible "
        "water loses {:.1f} %",
        lambda r: (
            r("wave_tank_0.025", "decay of the amplitude per wavelength"),
            r("wave_tank_0.025_incompressible", "decay of the amplitude per wavelength"),
        ),
        (METHOD,),
    ),
    Sentence(
        "plate {:.1f} % of the paddle's work appears as spurious energy",
        lambda r: (-share("convergence", "not accounted for", "weakly compressible, 10 mm: ")(r),),
        (METHOD,),
    ),
    Sentence(
        "grow e-fold in {:.2f} s",
        lambda r: (
            r(
                "lattice_growth_0.02",
                "h = 1.2 dx: e-folding time of the difference between neighbours' slopes",
            ),
        ),
        (METHOD, SLOPES),
    ),
    Sentence(
        "| {:.3f}, {:.3f}, {:.3f} (standard errors {:.3f}, {:.3f}, {:.3f}): {:.1f} and {:.1f} % apart; "
        "linear theory without losses {:.3f} |",
        lambda r: (
            *spacings("xi")(r),
            *spacings("xi, standard error")(r),
            abs(r("convergence", "incompressible: change of xi from 20 to 10 mm")),
            abs(r("convergence", "incompressible: change of xi from 10 to 5 mm")),
            r("convergence", "linear theory, zeta = 0: xi"),
        ),
        (METHOD,),
    ),
    Sentence(
        "| {:.3f}, {:.3f}: {:.1f} % apart |",
        lambda r: (
            *spacings("xi", "weakly compressible")(r),
            abs(r("convergence", "weakly compressible: change of xi from 20 to 10 mm")),
        ),
        (METHOD,),
    ),
    Sentence(
        "| {:+.1f}, {:+.1f} % from linear theory | `heave` |",
        lambda r: tuple(
            r("heave_0.01", "the same: deviation from theory", f"incompressible: {what}")
            for what in ("period", "damping ratio over the first two swings")
        ),
        (METHOD,),
    ),
    Sentence(
        "| {:.1f} to {:.1f} % | `wave_tank --dx 0.02 --incompressible` |",
        lambda r: ends(r("wave_tank_0.02_incompressible", f"MAE_a at {x}") for x in DISTANCES),
        (METHOD,),
    ),
    Sentence(
        "| 0.01 m | {:+.1f} % | `vessel` |",
        lambda r: (100 * (r("vessel_0.01", "period") / r("vessel_0.01", "period", column="theory") - 1),),
        (METHOD,),
    ),
    Sentence(
        "the noise of the OWC is {:.1f}, {:.1f} and {:.1f} % at dx = 0.02, 0.01 and 0.005 m",
        lambda r: tuple(100 * value for value in spacings("noise")(r)),
        (METHOD,),
    ),
    Sentence(
        "the pressure arrives at t sqrt(g/H) = {:.2f}, and with the incompressible scheme at {:.2f}; the "
        "measured time is {:.2f}",
        lambda r: tuple(
            r("incompressible", "the same: arrival of the pressure at the disc, t sqrt(g/H)", after, column)
            for after, column in (
                ("standing wave, weakly compressible: period error", "here"),
                (
                    "dam break, H/dx = 26, 28, 30, 32, 34, incompressible, means: time of the front at 5 H "
                    "from the wall behind the column, t sqrt(g/H)",
                    "here",
                ),
                ("standing wave, weakly compressible: period error", "paper"),
            )
        ),
        (METHOD,),
    ),
    Sentence(
        "the OWC's efficiencies differ by {:.1f} %",
        lambda r: (
            abs(
                r("convergence", "incompressible minus weakly compressible, 10 mm: relative difference of xi")
            ),
        ),
        (METHOD,),
    ),
    # theory and guides
    Sentence(
        "{:.0f} % lost to hyperviscosity and {:.1f} % gained in the projection at dx = 0.02 m; "
        "{:.4f} % not accounted for",
        lambda r: (
            of_owc("hyperviscosity")(r),
            -of_owc("projection")(r),
            abs(share("owc_0.02", "not accounted for")(r)),
        ),
        (ISPH,),
    ),
    Sentence(
        "| {:.0f} % lost in the projection |", lambda r: (share("flap_3d_0.04", PROJECTION)(r),), (ISPH,)
    ),
    Sentence(
        "OWC in waves lower than a spacing, efficiency | {:.0f} to {:.0f} % below linear theory",
        lambda r: too_low(r, "small_waves_0.01", "small_waves_0.02"),
        (ISPH,),
    ),
    Sentence(
        "The efficiency is {:.1f} % lower than in a tank four wavelengths long, and the run takes "
        "{:.2f} times as long",
        lambda r: (
            100
            - 100
            * r("relaxation_zone_0.02", "OWC, zone, 1.5 wavelengths: xi")
            / r("relaxation_zone_0.02", "OWC, paddle, four wavelengths: xi"),
            r("relaxation_zone_0.02", "wall time with the zone over that with the paddle"),
        ),
        (WAVES,),
    ),
    Sentence("A filter removes {:.0f} to {:.0f} %", lost_in_filter, (METHOD,)),
    *OF_MODELS,
)
"""Sentences of the pages with numbers from the results."""


def pages() -> list[str]:
    """Paths of the pages that contain sentences of `PROSE`, relative to the project's folder."""
    return sorted({page for sentence in PROSE for page in sentence.pages})


def renew() -> None:
    """Writes the present numbers into all pages."""
    results = Results()
    for page in pages():
        path = ROOT / page
        path.write_text(renewed(page, path.read_text(encoding="utf-8"), results, PROSE), encoding="utf-8")
