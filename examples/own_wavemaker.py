"""A wavemaker of your own: a piston that pushes once and makes a single hump instead of regular waves.

A prescribed motion defines the displacement as a function of time; the velocity is its time derivative.
jaxsph run examples/own_wavemaker.py:hump --set stroke=0.03
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


def hump(stroke: float = 0.05, duration: float = 0.6, t1: float = 1.2) -> js.Problem:
    owc = {"dx": 0.04, "tank.length": 1.2, "device.wall_thickness": 0.04, "probes": {"gauges": [0.5]}}
    problem = js.load_case("owc").replace(owc).problem()
    motion = Push(jnp.float32(stroke), jnp.float32(duration))
    return problem.with_parts(moving=[dataclasses.replace(problem.model.moving[0], motion=motion)], t1=t1)


if __name__ == "__main__":
    solution = js.run(js.Program(hump, {}), out="runs/own_wavemaker.h5", overwrite=True)
    crest = solution["eta"][:, 0].argmax()
    print(f"paddle at {1e3 * solution['paddle'][-1]:.1f} mm")
    print(f"crest of {1e3 * solution['eta'][crest, 0]:.1f} mm at the gauge at t = {solution.t[crest]:.2f} s")
