"""A viscosity of your own: a shear-thinning liquid, less viscous at higher shear rates.

jaxsph run examples/own_viscosity.py:thick --set nu=0.02
"""

import dataclasses

import jax.numpy as jnp

import jaxsph as js


class Thinning(js.AbstractViscosity):
    nu: jnp.ndarray  # at low shear rates, m2/s
    rate: jnp.ndarray  # shear rate that halves the viscosity, 1/s

    def coefficient(self, h, c0, dim):
        return 2.0 * self.nu

    def kinematic(self, h, c0, dim):
        return self.nu

    def shear(self, pair, i, j, guard):  # viscosity nu / (1 + shear rate / self.rate)
        plain = js.LaplacianViscosity(self.nu).shear(pair, i, j, guard)
        jump = sum((b - a) ** 2 for a, b in zip(i["u"], j["u"], strict=True))
        rate = jnp.sqrt(jump / (pair.r2 + guard) + 1e-12)
        return tuple(component / (1.0 + rate / self.rate) for component in plain)


def thick(nu: float = 0.01, rate: float = 1.0, t1: float = 0.5) -> js.Problem:
    changes = {"dx": 0.05, "start.amplitude": 0.05, "scheme.kind": "incompressible"}
    problem = js.load_case("hydrostatic").replace(changes).problem()
    law = Thinning(jnp.float32(nu), jnp.float32(rate))
    return problem.with_parts(scheme=dataclasses.replace(problem.model.scheme, viscosity=law), t1=t1)


if __name__ == "__main__":
    solution = js.run(js.Program(thick, {}), out="runs/own_viscosity.h5", overwrite=True)
    print(f"kinetic energy at the end {solution['kinetic'][-1]:.2f} J/m")
