"""Clumping of particles after the impact of a dam break: share of particles that nearly coincide."""

from __future__ import annotations

import numpy as np
import scipy  # which imports its subpackages on first use

import jaxsph as js
from experiments.common import Report, solved

NEAR = 0.3
"""Distance, in spacings, below which two particles count as a pair (-)."""
BETWEEN = 0.05
"""Time between snapshots, s."""


def main(t1: float = 2.0) -> None:
    """Runs the built-in dam break to t1 (s) in both schemes, and counts the pairs in its snapshots."""
    dx = js.load_case("dam_break").dx
    with Report("pairing", "Pairs of particles after the impact of a dam break", dx) as report:
        for kind in ("incompressible", "weakly_compressible"):
            changes = {"scheme.kind": kind, "output.snapshot_dt": BETWEEN}
            case = js.load_case("dam_break").replace(changes)
            run = solved(case, f"pairing_{kind}", t1)
            shares = [share(run.snapshot(k)["x"], dx) for k in range(run.snapshot_count)]
            words = kind.replace("_", " ")
            report.row(f"{words}: snapshots", len(shares))
            report.row(f"{words}: snapshots with pairs", int(np.count_nonzero(shares)))
            report.row(
                f"{words}: largest share of particles nearer than {NEAR:g} dx to another",
                100.0 * max(shares),
                "%",
                theory=0.0,
                bar="none",
                passes=max(shares) == 0.0,
            )


def share(x: np.ndarray, dx: float) -> float:
    """Share of the particles at x (m) that are nearer than `NEAR` spacings to another one (-)."""
    distance, _ = scipy.spatial.KDTree(x).query(x, k=2)
    return float(np.mean(distance[:, 1] < NEAR * dx))
