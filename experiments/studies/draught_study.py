"""Efficiency as a function of wave period and draught.

The paper's text does not give the draught.
"""

from __future__ import annotations

from experiments.common import Report
from experiments.owc_tank import over_periods, study_case

DRAUGHTS = (0.12, 0.16, 0.20)
PERIODS = (1.0, 1.2, 1.4)


def main(dx: float = 0.02) -> None:
    """Runs or continues the nine members at the spacing dx (m)."""
    title = "Efficiency over period and draught: effect of the assumed draught"
    with Report(f"draught_study_{dx:g}", title, dx) as report:
        over_periods(report, study_case(dx, 12.0), "device.draught", "draught", DRAUGHTS, PERIODS)
