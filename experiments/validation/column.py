"""Impact of a dam break on a tall square column, incompressible, 3-D: experiment of Yeh and Petroff.

The times of the measured velocity start at the arrival of the bore at the probe, and those of the force
approximately at the release. The velocities are therefore aligned at the arrival, and the forces at the
impact. Sources disagree on the position of the velocity probe, so the velocities at both published positions
are compared. `experiments/reference/README.md` has the sources.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, reference, solved

IMPULSE, LAST = 13.0, 1.5
"""Impulse of the measured force (N s), and time (s) in the measurement at which its integration ends."""
COMPARED = (0.1, 1.2)
"""Interval after the arrival of the bore in which velocities are compared, s."""
ARRIVED, HIT = 0.5, 5.0
"""Thresholds of velocity for the arrival of the bore (m/s) and of force for the impact (N)."""


def main(dx: float = 0.02) -> None:
    """Runs the built-in column with the spacing dx (m)."""
    case = js.load_case("dam_break_column").replace({"dx": dx})
    file = solved(case, f"column_{dx:g}")
    series, results = file.series(), file.results()
    t, u, force = series["time"], series["velocity_x"], series["body_force_mean"][:, 0]
    velocity, measured = reference("column_velocity.csv"), reference("column_force.csv")
    with Report(f"column_{dx:g}", "Dam break on a square column, incompressible, 3-D", dx) as report:
        report.seconds = results["wall_seconds"]
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot(*velocity.T, "k.", ms=3, label="measured")
        for k, point in enumerate(case.probes.velocity):
            since = t - t[np.argmax(u[:, k] > ARRIVED)]
            now = (velocity[:, 0] >= COMPARED[0]) & (velocity[:, 0] <= COMPARED[1])
            off = np.interp(velocity[now, 0], since, u[:, k]) - velocity[now, 1]
            rms = float(np.sqrt(np.mean(off**2)))
            report.row(
                f"velocity at x = {point[0]:g} m, {COMPARED[0]:g} to {COMPARED[1]:g} s after the arrival of "
                "the bore: RMS error",
                rms,
                "m/s",
                bar="under 0.25 at dx = 0.01 m",
                passes=rms < 0.25,
            )
            left.plot(since, u[:, k], lw=1, label=f"x = {point[0]:g} m")
        hit, hit_measured = t[np.argmax(force > HIT)], measured[np.argmax(measured[:, 1] > HIT), 0]
        span = LAST - hit_measured
        now = t <= hit + span
        impulse = float(np.trapezoid(force[now], t[now]))
        report.row(
            f"impulse of the force to {span:.4g} s after the impact",
            impulse,
            "N s",
            theory=IMPULSE,
            bar="within 20 %",
            passes=abs(impulse / IMPULSE - 1) < 0.2,
        )
        report.row("time from the release to the impact", float(hit), "s", theory=0.27)
        report.row("particle steps per second", results["particle_steps_per_second"], "1/s")
        left.set(xlabel="time from the bore's arrival, s", ylabel="u, m/s", xlim=(-0.1, 1.3))
        left.legend(fontsize="small")
        right.plot(measured[:, 0] - hit_measured, measured[:, 1], "k-", lw=0.8, label="measured")
        right.plot(t - hit, force, lw=0.8, label=f"dx = {dx:g} m")
        right.set(xlabel="time from the impact, s", ylabel="force, N", xlim=(-0.1, 1.3))
        right.legend(fontsize="small")
        report.picture(figure)
