"""Section 5.1: efficiency over the wave's period for front walls of four thicknesses, 24 runs."""

from __future__ import annotations

import numpy as np
import typer

from experiments.studies import study_case, swept

THICKNESS = (0.01, 0.02, 0.03, 0.04)
PERIODS = (0.8, 1.0, 1.2, 1.4, 1.6, 1.8)


def main(dx: float = 0.02) -> None:
    """Runs or goes on with the study at the spacing dx."""
    over = {"device.wall_thickness": list(THICKNESS), "waves.T": list(PERIODS)}
    study = swept(study_case(dx), over, f"wall_study_{dx:g}")
    print(np.round(study["xi"], 3))


if __name__ == "__main__":
    typer.run(main)
