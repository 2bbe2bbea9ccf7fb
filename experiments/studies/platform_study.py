"""Efficiency as a function of the wave period and of the height of a platform under the OWC.

The paper's text does not give the height. Linear theory is valid for a flat bed only.
"""

from __future__ import annotations

from experiments.common import Report
from experiments.owc_tank import over_periods, study_case

HEIGHTS = (0.0, 0.08, 0.16)
LENGTH = 0.5
"""Length of the platform from the end wall, m: the chamber, the front wall, and 2.7 chamber lengths in
front of it."""
PERIODS = (1.0, 1.2, 1.4)


def main(dx: float = 0.02) -> None:
    """Runs or continues the nine members at the spacing dx (m)."""
    title = "Efficiency over period and height of a platform: effect of the assumed height"
    case = study_case(dx, 12.0).replace({"device.platform_length": LENGTH, "device.platform_height": 0.0})
    with Report(f"platform_study_{dx:g}", title, dx) as report:
        over_periods(report, case, "device.platform_height", "platform height", HEIGHTS, PERIODS)
