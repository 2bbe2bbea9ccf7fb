"""A solid of your own: a plunger that heaves at the surface along a given path and makes waves on both sides.

jaxsph run examples/own_solid.py:plunger --set stroke=0.01
"""

import jax.numpy as jnp

import jaxsph as js


class Heave(js.AbstractPath):
    stroke: jnp.ndarray  # m

    def pose(self, t):  # surge and heave, m; pitch, rad
        return jnp.stack([0.0 * t, -self.stroke * jnp.sin(2.0 * jnp.pi * t), 0.0 * t])


def plunger(stroke: float = 0.02, t1: float = 1.0, dx: float = 0.04) -> js.Problem:
    shape, tank = js.Block((0.6, 0.28), (1.0, 0.52)), js.Box((0.0, 0.0), (1.6, 0.72))
    scheme, solid = js.ISPH.of(dx, speed=2.0, dim=2), dict(filling=js.DummyParticles(), shapes=[shape])
    walls = js.Ghosts.build(tank, dx, scheme.smoothing, js.FreeSlip(), **solid)
    own = dict(shape=shape, pivot=jnp.array([0.8, 0.4]), rows=walls.dummies[0])
    moving = [js.DrivenSolid(path=Heave(jnp.float32(stroke)), **own)]
    x, volume = js.still_water(walls, 0.4, dx, [shape])
    still = dict(p=9810.0 * (0.4 - x[:, 1]), volume=volume, g=(0.0, -9.81), dx=dx, sample_dt=0.02)
    model, state = js.assemble(x, 0.0 * x, scheme=scheme, walls=walls, moving=moving, **still)
    return js.Problem(model, state, sample_dt=0.02, t1=t1)


if __name__ == "__main__":
    solution = js.run(js.Program(plunger, {}), out="runs/own_solid.h5", overwrite=True)
    print(f"the plunger transferred {solution['power_paddle'].sum() * 0.02:.3f} J/m to the water in a period")
