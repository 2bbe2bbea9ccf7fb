"""A slope: how the absorbed energy changes with the damping, by differentiating the run itself.

An exact slope is right to round-off, but after a second or so it follows single particles and speaks of ever
smaller changes: `reach` says of how large ones. For efficiencies of settled waves take `js.Ensemble()`.
"""

import jaxsph as js

case = js.load_case("owc").replace(
    {
        "dx": 0.04,  # m, the spacing of the particles
        "tank.length": 1.2,
        "device.wall_thickness": 0.04,
        "probes": {"gauges": [0.5]},
        "waves.ramp_periods": 0.5,
        "t1": 1.2,
    }
)
found = js.derivative(case, "pto.K_dm", "energy_pto", js.Exact(), progress=False)
print(f"energy taken by the PTO until {case.t1:g} s: {found.value:.4g} J/m")
print(f"its slope over K_dm = {case.pto.K_dm:g}: {found.slope:+.3g}, for changes up to {found.reach:.2g}")
