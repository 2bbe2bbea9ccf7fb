"""A scheme of your own: weakly compressible water with Tait's equation of state instead of a linear one.

jaxsph run examples/own_scheme.py:tait --set c0=60
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxsph as js

GAMMA = 7.0


class Tait(js.DeltaSPH):
    def pressure(self, p):  # Pa, from the deviation of the density
        return self.rho0 * self.c0**2 / GAMMA * jnp.expm1(GAMMA * jnp.log1p(p.rho / self.rho0))

    def with_pressure(self, p, pressure):  # the inverse; masses change so that volumes stay the same
        rho = self.rho0 * jnp.expm1(jnp.log1p(GAMMA * pressure / (self.rho0 * self.c0**2)) / GAMMA)
        m = p.m / (self.rho0 + p.rho) * (self.rho0 + rho)
        return eqx.tree_at(lambda a: (a.rho, a.m), p, (rho, m))


def tait(c0: float = 40.0, t1: float = 0.3) -> js.Problem:
    changes = {"dx": 0.05, "start.amplitude": 0.03, "fluid.c0": c0}
    problem = js.load_case("hydrostatic").replace(changes).problem()
    scheme = Tait(**vars(problem.model.scheme))
    squeezed = js.Result(compressed, {"squeezed": js.Label("largest compression energy", "J/m")})
    return problem.with_parts(scheme=scheme, results=[squeezed], t1=t1)


def compressed(record: js.Record) -> dict:
    return {"squeezed": np.max(record["compression"])}


if __name__ == "__main__":
    solution = js.run(js.Program(tait, {}), out="runs/own_scheme.h5", overwrite=True)
    print(f"largest compression energy {solution.results['squeezed']:.3f} J/m")
