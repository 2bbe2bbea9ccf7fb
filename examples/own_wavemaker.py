"""A wavemaker of your own: a piston that pushes once and makes one hump, in the place of regular waves.

A motion that is a function of time says its displacement; its velocity follows from it.
"""

import dataclasses

import jax.numpy as jnp

import jaxsph as js


class Push(js.AbstractGivenMotion):
    stroke: jnp.ndarray  # m
    duration: jnp.ndarray  # s

    def displacement(self, t):
        s = jnp.clip(t / self.duration, 0.0, 1.0)
        return self.stroke * s * s * (3.0 - 2.0 * s)


case = js.load_case("owc").replace(
    {"dx": 0.04, "tank.length": 1.2, "device.wall_thickness": 0.04, "probes": {"gauges": [0.5]}}
)
model, state = js.build(case)
paddle = dataclasses.replace(model.moving[0], motion=Push(jnp.float32(0.05), jnp.float32(0.6)))
model = dataclasses.replace(model, moving=(paddle,))
probes = js.make_probes(case, model, state)
solution = js.march(model, state, 1.2, case.output.sample_dt, probes)
crest = solution["eta"][:, 0].argmax()
print(f"paddle at {1e3 * solution['paddle'][-1]:.1f} mm")
print(f"crest of {1e3 * solution['eta'][crest, 0]:.1f} mm at the gauge at t = {solution.t[crest]:.2f} s")
