"""A power take-off of your own: a linear turbine that works while the water rises, and lets air in freely.

A law says the air's pressure from the flow q that there would be without it, and from how much a pressure
lowers that flow in the step: q = q_free - compliance P_a. Solved together the turbine is stable for every c.
"""

import equinox as eqx
import jax.numpy as jnp

import jaxsph as js


class OneWayTurbine(js.AbstractPTO):
    c: jnp.ndarray  # Pa s/m2

    def pressure(self, q_free, compliance, t):
        return self.c * jnp.maximum(q_free, 0.0) / (1.0 + self.c * compliance)


case = js.load_case("owc").replace(
    {
        "dx": 0.04,  # m, the spacing of the particles
        "tank.length": 1.2,
        "device.wall_thickness": 0.04,
        "probes": {"gauges": [0.5]},
        "waves.ramp_periods": 0.5,
    }
)
model, state = js.build(case)
model = eqx.tree_at(lambda m: m.chambers[0].pto, model, OneWayTurbine(jnp.float32(1.0e4)))
probes = js.make_probes(case, model, state)
solution = js.march(model, state, 2.4, case.output.sample_dt, probes)
P_a, flow = solution["P_a"], solution["flow"]
print(f"largest pressure {P_a.max():.1f} Pa, largest flow {1e3 * flow.max():.2f} l/s per metre")
rising = flow > 0.0
c = (P_a[rising] @ flow[rising]) / (flow[rising] @ flow[rising])
print(f"least pressure {P_a.min():.1f} Pa; P_a / flow while the water rises = {c:.4g} Pa s/m2")
