"""Compares a run on several devices with the same run on one; prints the largest differences as JSON.

This is a separate program, because the number of devices must be set before JAX is first used.

python tests/sharing.py CASE DEVICES STEPS KEY=VALUE...      readings, energies and particles
python tests/sharing.py CASE DEVICES STEPS --slopes KEY=...  slopes of the PTO's energy, by K_dm
"""

import json
import sys

import jax

jax.config.update("jax_num_cpu_devices", 8)

import equinox as eqx  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

import jaxsph as js  # noqa: E402
from jaxsph.case.probes import make_probes  # noqa: E402
from jaxsph.cli.arguments import setting_of  # noqa: E402
from jaxsph.run.devices import gather, share  # noqa: E402


def found(case, devices, steps):
    """Readings by name, and the particles in the order of their ids."""
    model, state = js.build(case)
    probes, count = make_probes(case, model, state), len(state.particles.id)
    model, state = share(model, state, devices)
    run = jax.jit(lambda m, s: js.simulate(m, s, n_steps=steps, probes=probes))
    state, readings = run(model, state)
    p = gather(state, count).particles
    order = np.argsort(np.asarray(p.id))
    values = {f"reading {k}": np.asarray(v) for k, v in readings.items()}
    values |= {name: np.asarray(getattr(p, name))[order] for name in ("x", "u", "rho", "p", "m")}
    values |= {f"energy {k}": np.asarray(v.total) for k, v in state.ledger.items()}
    return values | {"failures": np.asarray(state.status.bits)}


def slopes(case, devices, steps):
    """Slope of the energy that the PTO absorbs with respect to K_dm, by forward and reverse mode."""
    model, state = share(*js.build(case), devices)

    def absorbed(K_dm):
        changed = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, model, K_dm)
        return js.simulate(changed, state, n_steps=steps)[0].ledger["pto"].total

    K_dm = jnp.asarray(model.chambers[0].pto.K_dm)
    value, forward = jax.jit(lambda K: jax.jvp(absorbed, (K,), (jnp.ones_like(K),)))(K_dm)
    return {"value": value, "forward": forward, "reverse": jax.jit(jax.grad(absorbed))(K_dm)}


def main(name, devices, steps, *settings):
    what = slopes if "--slopes" in settings else found
    settings = dict(setting_of(text) for text in settings if text != "--slopes")
    case = js.load_case(name).replace(settings)
    if case.precision == "float64":
        jax.config.update("jax_enable_x64", True)
    one, many = (what(case, n, int(steps)) for n in (1, int(devices)))
    sizes = {k: float(np.max(np.abs(v), initial=0.0)) for k, v in one.items()}
    apart = {k: float(np.max(np.abs(many[k] - v), initial=0.0)) for k, v in one.items()}
    print(json.dumps({k: [apart[k], sizes[k]] for k in one}))


if __name__ == "__main__":
    main(*sys.argv[1:])
