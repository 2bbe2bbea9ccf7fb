"""A body force of your own: the inertial force on water in a shaken tank.

jaxsph run examples/own_force.py:shaken --set amplitude=0.5
"""

import jax.numpy as jnp

import jaxsph as js


class Shaking(js.AbstractForce):
    amplitude: jnp.ndarray  # of the tank's acceleration, m/s2
    omega: jnp.ndarray  # rad/s

    def acceleration(self, x, t):
        return jnp.zeros_like(x).at[:, 0].set(-self.amplitude * jnp.sin(self.omega * t))


def shaken(amplitude: float = 0.3, omega: float = 4.0, dx: float = 0.05, t1: float = 0.5) -> js.Problem:
    case = js.load_case("hydrostatic").replace({"dx": dx, "scheme.kind": "incompressible"})
    force = Shaking(jnp.float32(amplitude), jnp.float32(omega))
    return case.replace({"probes.gauges": [0.1]}).problem().with_parts(forces=[force], t1=t1)


if __name__ == "__main__":
    solution = js.run(js.Program(shaken, {}), out="runs/own_force.h5", overwrite=True)
    print(f"the tank's motion transfers {solution['power_paddle'].sum() * 0.01:.3f} J/m to the water")
