"""A sweep: the same waves with three dampings of the turbine, one run per core, in one file.

If this script is run again, it reads the finished runs from the file and makes only the missing ones.
"""

import jaxsph as js

case = js.load_case("owc").replace(
    {
        "dx": 0.04,  # m, spacing of the particles
        "tank.length": 1.2,
        "device.wall_thickness": 0.04,
        "probes": {"gauges": [0.5]},
        "waves.ramp_periods": 0.5,
        "t1": 3.6,
    }
)
found = js.sweep(case, {"pto.K_dm": [150.0, 300.0, 600.0]}, "runs/example_sweep.h5")
for K_dm, xi in zip(found.axes["pto.K_dm"], found["xi"], strict=True):
    print(f"K_dm = {K_dm:6.1f}   efficiency {xi:.3f}")
for place, message in found.failures.items():
    print(f"run {place} failed: {message}")
print("pictures: jaxsph plot runs/example_sweep.h5")
