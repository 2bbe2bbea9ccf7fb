"""Section 5.2: efficiency over damping and wave height, 35 runs."""

from __future__ import annotations

import numpy as np
import typer

from experiments.studies import CHAMBER, damping_coefficient, study_case, swept

B_STAR = (30.51, 67.37, 86.09, 121.96, 162.81, 197.62, 263.20)
H_STAR = (0.16, 0.31, 0.47, 0.63, 0.78)


def main(dx: float = 0.02) -> None:
    """Runs or goes on with the study at the spacing dx."""
    case = study_case(dx).replace({"device.wall_thickness": 0.01})
    over = {
        "pto.K_dm": [round(damping_coefficient(b), 2) for b in B_STAR],
        "waves.H": [round(h * CHAMBER, 5) for h in H_STAR],
    }
    study = swept(case, over, f"damping_study_{dx:g}")
    print(np.round(study["xi"], 3))


if __name__ == "__main__":
    typer.run(main)
