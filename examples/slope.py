"""A slope: the energy that the turbine absorbs and its derivative with respect to the damping, through the
time loop.

The derivative is exact to round-off. After about one simulated second it follows individual particles
instead of the flow, and is valid only for ever smaller changes of the damping. For efficiencies in settled
waves use `js.derivative(case, "pto.K_dm")`, a fit to several runs.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

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
solution = js.run(case, t1=3.6, progress=False)
model, state = solution.model, solution.state


def absorbed(K_dm):  # energy that the PTO absorbs in the next 180 steps, J/m: a pure function
    changed = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, model, K_dm)
    new, _ = js.simulate(changed, state, n_steps=180)
    return new.ledger["pto"].total - state.ledger["pto"].total


absorbed = jax.jit(absorbed)
for K_dm in jnp.array([150.0, 300.0, 600.0]):
    energy, slope = jax.jvp(absorbed, (K_dm,), (jnp.ones_like(K_dm),))
    print(f"K_dm = {K_dm:5.1f}   energy {energy:.4g} J/m   slope {slope:+.3g}")
