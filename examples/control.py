"""A turbine controlled by the chamber's state, with compressible air; derivative with respect to the gain.

The control closes the turbine as pressure or suction grows. The absorbed energy is a differentiable function
of the gain.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

import jaxsph as js


def closing(gain, air, t):  # turbine of the next step, from the state `air` of the chamber at the time t
    return js.PneumaticPTO(300.0 * jnp.exp(gain * jnp.tanh((air.P_a / 100.0) ** 2)))


case = js.load_case("owc").replace(
    {
        "dx": 0.04,  # m, spacing of the particles
        "tank.length": 1.2,
        "device.wall_thickness": 0.04,
        "probes": {"gauges": [0.5]},
        "waves.ramp_periods": 0.5,
        "air.volume": 0.2,  # m2 per metre of width
    }
)
model, state = js.build(case)
model = eqx.tree_at(lambda m: m.chambers[0].pto, model, js.ControlledPTO.of(closing, jnp.float32(0.5)))
probes = js.make_probes(case, model, state)
solution = js.march(model, state, 2.4, case.output.sample_dt, probes)
print(f"largest pressure {solution['P_a'].max():.1f} Pa, energy {solution.state.ledger['pto'].total:.3f} J/m")


def energy(gain):  # energy that the turbine absorbs in the next 0.1 s, J/m
    controlled = js.ControlledPTO.of(closing, gain)
    changed = eqx.tree_at(lambda m: m.chambers[0].pto, solution.model, controlled)
    new, _ = js.simulate(changed, solution.state, n_steps=20)
    return new.ledger["pto"].total - solution.state.ledger["pto"].total


value, slope = jax.jit(jax.value_and_grad(energy))(jnp.float32(0.5))
print(f"energy of the next 0.1 s: {value:.4f} J/m, slope with respect to the gain {slope:.4f} J/m")
