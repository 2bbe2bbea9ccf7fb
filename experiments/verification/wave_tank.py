"""Wave tank of the paper's section 4.1 (T = 1.2 s, H = 0.1 m, d = 0.5 m) against second-order theory."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from jaxsph import analysis
from jaxsph.waves import theory

PAPER = {0.5: (5.9, 1.5), 1.0: (6.1, 1.3), 2.0: (5.6, 1.9), 6.0: (6.3, 1.8)}
"""The paper's MAE_a and MAE_p (%) at dx = 0.01 m, by distance from the paddle in wavelengths (section 4.1;
the value at 6 wavelengths is from the longer tank of Appendix A)."""


def main(dx: float = 0.01, wavelengths: int = 4, incompressible: bool = False) -> None:
    """Runs a tank of `wavelengths` with the spacing dx (m), and reports errors, mean level, decay and
    reflection.

    The sponge fills the last wavelength. With eight wavelengths this is the tank of Appendix A.
    """
    case = js.load_case("wave_tank").replace({"dx": dx})
    T, d = case.waves.T, case.tank.depth
    wavelength = float(theory.wavelength(T, d))
    speed = float(theory.group_velocity(2 * np.pi / T, d))
    if wavelengths != 4:
        far = [float(np.round(at * wavelength, 3)) for at in PAPER if 2 < at < wavelengths - 1]
        changes = {
            "tank.length": round(case.tank.length / 4 * wavelengths, 3),
            "probes.gauges": [*case.probes.gauges, *far],
            # record as many settled periods as in the short tank, after group and front reach the last gauge
            "t1": round(
                case.t1 + (wavelengths - 4) * wavelength / speed + front(max(far, default=0.0), T, d), 1
            ),
        }
        case = case.replace(changes)
    # gauges a fifth of a wavelength apart separate the decay from the reflection by the sponge
    along = np.arange(0.5, wavelengths - 1.2, 0.2) * wavelength
    case = case.replace({"probes.gauges": [*case.probes.gauges, *(float(np.round(at, 3)) for at in along)]})
    suffix = "" if wavelengths == 4 else f"_{wavelengths}"
    if incompressible:
        case, suffix = case.replace({"scheme.kind": "incompressible"}), f"{suffix}_incompressible"
    file = solved(case, f"wave_tank_{dx:g}{suffix}")
    series, results = file.series(), file.results()
    title = (
        f"Wave tank of {wavelengths} wavelengths against second-order Stokes theory"
        + ", incompressible" * incompressible
    )
    with Report(f"wave_tank_{dx:g}{suffix}", title, dx) as report:
        report.seconds = results["wall_seconds"]
        report.picture(against_stokes(report, case, series, wavelengths, (5.0, 2.0)))
        report.row("reflection by the sponge", 100 * results["reflection"], "%", theory=0.0)
        share = "energy not accounted for, over the paddle's work or the largest kinetic energy"
        report.row(share, 100 * results["energy_residual_share"], "%", theory=0.0)
        report.row("wall time per simulated second", results["wall_seconds"] / results["t_end"], "s")


def against_stokes(
    report: Report,
    case: js.Case,
    series: dict[str, np.ndarray],
    wavelengths: float,
    bars: tuple[float, float] | None,
    label: str = "",
) -> Figure:
    """Reports the errors along a tank of `wavelengths` and the decay, and returns a figure of the elevations.

    `bars`: largest allowed MAE_a and MAE_p against second order, %, or None; `label`: beginning of the rows'
    names.
    """
    H, T, d = case.waves.H, case.waves.T, case.tank.depth
    wavelength = float(theory.wavelength(T, d))
    speed = float(theory.group_velocity(2 * np.pi / T, d))
    t, x, eta = series["time"], np.asarray(case.probes.gauges), series["eta"]
    means, shown, k3 = [], [], float(theory.stokes3_wavenumber(H, T, d))
    for at in [at for at in PAPER if at < wavelengths - 1]:
        i = int(np.argmin(abs(x - at * wavelength)))
        distance = f"{at:g} wavelength" + "s" * (at != 1.0)
        window = settled(t, x[i] / speed + front(x[i], T, d), T, case.waves.ramp_periods)
        record = t[window], eta[window, i]
        reference = np.asarray(theory.stokes2_elevation(x[i], t[window], H, T, d))
        # waves of finite height are longer, which second-order theory neglects
        longer = np.asarray(theory.stokes2_profile(k3 * x[i] - 2 * np.pi / T * t[window], H, k3, d))
        for expected, than in ((reference, ""), (longer, " against theory with the third-order wavelength")):
            errors = _errors(*record, expected, H, T)
            for k, name in enumerate(("MAE_a", "MAE_p")):
                bar = None if than or bars is None else bars[k]
                report.row(
                    f"{label}{name} at {distance}{than}",
                    errors[k],
                    "%",
                    theory=0.0,
                    paper=None if than else PAPER[at][k],
                    bar="" if bar is None else f"< {bar:g} %",
                    passes=None if bar is None else errors[k] < bar,
                )
        means.append(np.mean(eta[window, i]))
        shown.append((f"{label}{distance}", t, eta[:, i], t[window], reference))
    report.row(f"{label}mean level", 1e3 * np.mean(means), "mm")
    window = settled(t, x.max() / speed + front(x.max(), T, d), T, case.waves.ramp_periods)
    amplitude = np.array([analysis.fundamental(t[window], level, T) for level in eta[window].T])
    decay = analysis.decay_per_wavelength(x, amplitude, wavelength)
    report.row(f"{label}decay of the amplitude per wavelength", 100 * decay, "%", theory=0.0)
    order = np.argsort(x)
    phase = np.unwrap(np.angle(amplitude[order]))
    k = abs(np.polyfit(x[order], phase, 1)[0])
    report.row(f"{label}wavelength over that of third-order theory", k3 / k, theory=1.0)
    return _picture(shown)


def _errors(t: np.ndarray, eta: np.ndarray, reference: np.ndarray, H: float, T: float) -> tuple[float, float]:
    """MAE_a and MAE_p (%) of an elevation against the reference (m), at the same times (s)."""
    both = t, eta, t, reference
    height = analysis.mae_amplitude(*both, H / 2, T, window=5)
    return 100 * height, 100 * analysis.mae_phase(*both, T, window=5)


def _picture(gauges: list[tuple]) -> Figure:
    """Figure of the elevation at every gauge, with the theory over the compared periods."""
    figure = Figure(figsize=(8, 1.8 * len(gauges)), layout="constrained")
    axes = figure.subplots(len(gauges), sharex=True, squeeze=False)[:, 0]
    for axis, (label, t, eta, t_theory, expected) in zip(axes, gauges, strict=True):
        axis.plot(t, 1e3 * eta, label="SPH")
        axis.plot(t_theory, 1e3 * expected, "k--", lw=1, label="Stokes, second order")
        axis.set(ylabel="eta, mm", title=label)
    axes[0].legend(loc="upper left", fontsize="small")
    axes[-1].set_xlabel("t, s")
    return figure


def front(x: float, T: float, d: float) -> float:
    """Time (s) that the front of the waves, lengthened by dispersion, takes to pass the position x (m).

    Waves of different frequencies travel at different speeds: after the distance x a sharp front takes
    sqrt(2 pi x |dS/domega|) to pass, with S the inverse of the group velocity.
    """
    slower, faster = (1.0 / float(theory.group_velocity(2 * np.pi / T * by, d)) for by in (0.99, 1.01))
    return float(np.sqrt(2 * np.pi * x * abs(faster - slower) / (0.02 * 2 * np.pi / T)))


def settled(t: np.ndarray, delay: float, T: float, ramp: float, most: int = 5) -> np.ndarray:
    """Mask of up to `most` whole periods after the ramp and the delay (s) of a gauge."""
    start = ramp * T + delay
    periods = min(most, int((t[-1] - start) / T))
    return (t >= start) & (t < start + periods * T)
