"""A power take-off of your own: a linear turbine that works while water rises; air enters freely otherwise.

`pressure` returns the gauge pressure P_a of the air. It receives the flow q_free at P_a = 0 and the
compliance -dq/dP_a of the step: q = q_free - compliance P_a. Solving this equation and the turbine's law
together is stable for every c.
jaxsph run examples/own_pto.py:one_way --set c=2e4
"""

import dataclasses

import jax.numpy as jnp
import numpy as np

import jaxsph as js


class OneWayTurbine(js.AbstractPTO):
    c: jnp.ndarray  # Pa s/m2

    def pressure(self, q_free, compliance, t):
        return self.c * jnp.maximum(q_free, 0.0) / (1.0 + self.c * compliance)


def one_way(c: float = 1.0e4, t1: float = 2.4) -> js.Problem:
    owc = {"dx": 0.04, "tank.length": 1.2, "device.wall_thickness": 0.04, "waves.ramp_periods": 0.5}
    problem = js.load_case("owc").replace({**owc, "probes": {"gauges": [0.5]}, "output.periods": 1}).problem()
    (chamber,) = problem.model.chambers
    return problem.with_parts(
        chambers=[dataclasses.replace(chamber, pto=OneWayTurbine(jnp.float32(c)))], t1=t1
    )


if __name__ == "__main__":
    solution = js.run(js.Program(one_way, {"c": 1.0e4}), out="runs/own_pto.h5", overwrite=True)
    P_a, flow = solution["P_a"], solution["flow"]
    print(f"largest pressure {P_a.max():.1f} Pa, largest flow {1e3 * flow.max():.2f} l/s per metre")
    rising = flow > 0.0
    c = np.sum(P_a[rising] * flow[rising]) / np.sum(flow[rising] ** 2)
    print(f"lowest pressure {P_a.min():.1f} Pa; P_a / flow while the water rises = {c:.4g} Pa s/m2")
