"""A run: waves drive an oscillating water column; the readings are in one file and in `solution`.

The case is coarse and takes half a minute. The built-in case, without the changes, takes one to two minutes.
"""

import jaxsph as js

case = js.load_case("owc").replace(
    {
        "dx": 0.04,  # m, spacing of the particles
        "tank.length": 1.2,
        "device.wall_thickness": 0.04,
        "probes": {"gauges": [0.5]},
        "waves.ramp_periods": 0.5,
    }
)
for label, value in js.check(case):
    print(f"{label:24s} {value}")

solution = js.run(case, t1=6.0, out="runs/example.h5", overwrite=True)
for name in ("chamber_level", "P_a", "flow", "power_pto"):
    reading = solution.units[name]
    print(f"{name:14s} largest {solution[name].max():9.4g} {reading.units:8s} {reading.long_name}")
print(f"energy absorbed by the PTO: {solution.results['energy_pto']:.3g} J/m")
print("pictures: jaxsph plot runs/example.h5")
