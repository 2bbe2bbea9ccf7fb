"""Water entry of a wedge with a deadrise angle of 30 degrees: pressure, force, and speed in free fall.

At constant speed V, without gravity, and until the jet reaches the chines, the flow is self-similar: the
pressure depends on z/(Vt) only, and the force grows as rho V^3 t (Zhao and Faltinsen 1993).
`experiments/reference/README.md` has the sources.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, reference, solved

V, RHO = 6.15, 1000.0
CP, FORCE = 6.927, 14.139
"""Largest 2p/(rho V^2) (Iafrati 2013, table 1), and F/(rho V^3 t) on both faces (Zhao and Faltinsen 1993)."""
WINDOW = (0.009, 0.0145)
"""Interval from an immersion of eleven spacings of 5 mm until the jet is near the chine, s."""
FALL = {0.0045: 6.06, 0.0155: 5.10}
"""Speed (m/s) in free fall by time (s), from the quasi-similarity balance of momentum."""
FACE = np.linspace(0.02, 0.98, 49)


def wedge_case(dx: float, constant: bool) -> js.Case:
    """The built-in wedge with sensors along its right face; `constant`: constant speed, almost no gravity."""
    case = js.load_case("wedge_entry")
    (x0, z0), (x1, z1) = case.body.polygon[0], case.body.polygon[1]
    sensors = [[x0 + s * (x1 - x0), z0 + s * (z1 - z0)] for s in FACE]
    changes = {"dx": dx, "body.sensors": sensors}
    if constant:
        changes |= {"body.free": [], "g": 1.0e-3, "t1": 0.015}
    return case.replace(changes)


def main(dx: float = 0.005) -> None:
    """Runs the wedge at constant speed and in free fall."""
    fixed = solved(wedge_case(dx, True), f"wedge_constant_{dx:g}").series()
    free = solved(wedge_case(dx, False), f"wedge_entry_{dx:g}").series()
    t = fixed["time"]
    now = (t >= WINDOW[0]) & (t <= WINDOW[1])
    force = fixed["body_force"][:, 1]
    # a line through the origin, because in the first instants only individual particles are hit
    slope = float(np.sum(force[now] * t[now]) / np.sum(t[now] ** 2) / (RHO * V**3))
    Cp = fixed["body_pressure"] / (0.5 * RHO * V**2)
    height = FACE * 0.1443
    z = (height[None, :] - V * t[:, None]) / np.maximum(V * t[:, None], 1e-9)
    peak = float(np.mean(Cp[now].max(axis=1)))
    exact = reference("wedge_similarity_pressure.csv")
    grid = np.linspace(-0.9, 0.3, 25)
    mean = np.mean([np.interp(grid, z[k], Cp[k]) for k in np.flatnonzero(now)], axis=0)
    off = float(np.sqrt(np.mean((mean - np.interp(grid, exact[:, 0], exact[:, 1])) ** 2)))
    with Report(f"wedge_{dx:g}", "Water entry of a wedge with a deadrise angle of 30 degrees", dx) as report:
        report.row(
            "constant speed: largest 2p/(rho V²)",
            peak,
            theory=CP,
            bar="within 10 %",
            passes=abs(peak / CP - 1) < 0.1,
        )
        report.row(
            "constant speed: F/(rho V³ t)",
            slope,
            theory=FORCE,
            bar="within 10 %",
            passes=abs(slope / FORCE - 1) < 0.1,
        )
        report.row("2p/(rho V²) from z/(Vt) = -0.9 to 0.3: RMS deviation from the similarity solution", off)
        for at, theory in FALL.items():
            speed = -float(np.interp(at, free["time"], free["body_velocity"][:, 1]))
            report.row(f"free fall: speed at {1000 * at:g} ms", speed, "m/s", theory=theory)
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        for k in np.flatnonzero(now)[:: max(1, int(now.sum()) // 5)]:
            left.plot(z[k], Cp[k], lw=0.8, label=f"{1000 * t[k]:.1f} ms")
        left.plot(exact[:, 0], exact[:, 1], "k--", lw=1, label="similarity")
        left.set(xlabel="z/(Vt)", ylabel="2p/(rho V²)", xlim=(-1, 1), ylim=(-0.5, 9))
        left.legend(fontsize="small")
        right.plot(1000 * t, force / 1000, label="constant speed")
        right.plot(1000 * free["time"], free["body_force"][:, 1] / 1000, label="free fall")
        right.plot(1000 * t, FORCE * RHO * V**3 * t / 1000, "k--", lw=1, label="similarity")
        right.set(xlabel="t, ms", ylabel="force, kN/m", ylim=(0, 60))
        right.legend(fontsize="small")
        report.picture(figure)
