"""Free long waves in a group of two waves, made by a piston of first and of second order.

A group of two waves is accompanied by a bound long wave. A first-order piston also makes a free long wave,
which travels ahead at the speed of shallow water (Schaeffer 1996); a second-order piston does not. The tank
is so long that no reflection returns while the gauges are read, so neither sponge nor absorption is needed.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from jaxsph.waves import second_order

H = (0.06, 0.06)
T = (1.2, 1.8)
D = 0.5
LENGTH = 24.0
"""Length of the tank, m: free long waves reach its end after 11 s, and the last gauge again 7 s later."""
GAUGES = tuple(float(x) for x in np.arange(2.0, 8.01, 0.3))
GROUP = 1.0 / (1.0 / T[0] - 1.0 / T[1])
"""Period of the group, s. The front of the shorter wave reaches the last gauge after 7.3 s."""


def main(dx: float = 0.03) -> None:
    """Runs the same waves with paddle motions of both orders and reports the amplitudes of the long waves."""
    base = js.Case.from_dict(
        {
            "name": "wave_group",
            "dx": dx,
            "t1": round(12.6 + GROUP, 2),
            "tank": {"length": LENGTH, "depth": D},
            "scheme": {"kind": "incompressible"},
            "waves": {"kind": "bichromatic", "H": list(H), "T": list(T), "absorption": False},
            "probes": {"gauges": list(GAUGES)},
            "output": {"snapshot_dt": 2.0},
        }
    )
    theory = _theory()
    found, seconds = {}, 0.0
    for order, second in (("first", False), ("second", True)):
        file = solved(base.replace({"waves.second_order": second}), f"wave_group_{order}_{dx:g}")
        found[order] = long_waves(file.series())
        seconds += file.results()["wall_seconds"]
    with Report(f"wave_group_{dx:g}", "Long waves of a bichromatic wave group", dx) as report:
        report.seconds = seconds
        share = {}
        for order, (bound, free, back) in found.items():
            share[order] = abs(free) / abs(bound)
            report.row(
                f"{order} order: amplitude of the bound long wave",
                1e3 * abs(bound),
                "mm",
                theory=1e3 * theory["bound"],
            )
            report.row(f"{order} order: amplitude of the free long wave", 1e3 * abs(free), "mm")
            report.row(f"{order} order: amplitude of the returning free long wave", 1e3 * abs(back), "mm")
            report.row(
                f"{order} order: amplitude of the free long wave over that of the bound one", share[order]
            )
        ratio = share["second"] / share["first"]
        report.row(
            "amplitude of the free over that of the bound long wave: ratio with the paddle of second order "
            "over the ratio with that of first order",
            ratio,
            bar="at most a third",
            passes=ratio <= 1 / 3,
        )
        report.picture(_picture(found))


def long_waves(series: dict[str, np.ndarray]) -> tuple[complex, complex, complex]:
    """Complex amplitudes (m) of bound, free and returning free long wave at the paddle, over the last group.

    Three waves of known wavenumbers are fitted to the amplitudes at the group's frequency at all gauges.
    """
    A = _amplitudes(series)
    x = np.array(GAUGES)
    waves = np.array([_theory()["K"], _theory()["k"], -_theory()["k"]])
    basis = np.exp(-1j * waves * x[:, None])
    return tuple(np.linalg.lstsq(basis, A, rcond=None)[0])


def _amplitudes(series: dict[str, np.ndarray]) -> np.ndarray:
    """Complex amplitudes of the elevation at every gauge at the group's frequency, over the last group."""
    t, eta = series["time"], series["eta"]
    last = t > t[-1] - GROUP + 1e-6
    omega = 2.0 * np.pi * np.array([1.0 / GROUP, *(1.0 / p for p in T)])
    columns = [np.ones(last.sum())]
    for w in (*omega, 2 * omega[1], 2 * omega[2], omega[1] + omega[2]):
        columns += [np.cos(w * t[last]), np.sin(w * t[last])]
    fit = np.linalg.lstsq(np.stack(columns, axis=1), np.float64(eta[last]), rcond=None)[0]
    return fit[1] - 1j * fit[2]


def _theory() -> dict[str, float]:
    """Amplitude (m) and wavenumber (rad/m) of the bound long wave, and wavenumber of the free long wave."""
    a, omega = 0.5 * np.array(H) + 0j, 2.0 * np.pi / np.array(T)
    bound = second_order.second_order_elevation(a, omega, D)
    long = int(np.argmin(bound.omega))
    k = second_order.wavenumbers(bound.omega[long], D, 9.81)
    return {"bound": abs(bound.amplitude[long]), "K": float(bound.k[long]), "k": float(k)}


def _picture(found: dict[str, tuple[complex, complex, complex]]) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    x = np.linspace(0.0, 9.0, 300)
    K, k = _theory()["K"], _theory()["k"]
    for axis, (order, (bound, free, _)) in zip(axes, found.items(), strict=True):
        for wave, number, label in ((bound, K, "bound"), (free, k, "free")):
            axis.plot(x, 1e3 * np.real(wave * np.exp(-1j * number * x)), label=label)
        axis.set(xlabel="x, m", title=f"piston of {order} order")
        axis.axhline(0.0, color="0.8", lw=0.8)
        axis.legend()
    axes[0].set_ylabel("elevation of the long waves, mm")
    return figure
