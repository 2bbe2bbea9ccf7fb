"""A probe of your own: the steepest slope of the surface, and a result computed from its readings.

jaxsph run examples/own_probe.py:steep --set amplitude=0.05
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxsph as js


class Steepness(js.AbstractProbe):
    gauge: js.WaveGauge
    apart: float = eqx.field(static=True)  # m

    def measure(self, model, state, tables):  # every sample, inside the compiled loop
        eta = self.gauge.measure(model, state, tables)["eta"]
        return {"steepness": jnp.max(jnp.abs(jnp.diff(eta))) / self.apart}

    def describe(self):
        return {"steepness": js.Reading("1", "steepest slope of the surface")}


def steep(amplitude: float = 0.03, t1: float = 0.5) -> js.Problem:
    changes = {"dx": 0.05, "start.amplitude": amplitude, "scheme.kind": "incompressible"}
    problem = js.load_case("hydrostatic").replace(changes).problem()
    at = jnp.linspace(0.1, 0.9, 9)
    probe = Steepness(js.WaveGauge(at, jnp.ones(9)), apart=0.1)
    result = js.Result(steepest, {"steepest": js.Label("steepest slope in the run")})
    return problem.with_parts(probes=[probe], results=[result], t1=t1)


def steepest(record: js.Record) -> dict:
    return {"steepest": np.max(record["steepness"])}


if __name__ == "__main__":
    solution = js.run(js.Program(steep, {}), out="runs/own_probe.h5", overwrite=True)
    print(f"steepest slope {solution.results['steepest']:.3f}")
