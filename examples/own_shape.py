"""A shape of your own: an elliptical float, released above its equilibrium.

jaxsph run examples/own_shape.py:bob --set density=600
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxsph as js


class Ellipse(js.AbstractShape):
    centre: tuple = eqx.field(static=True)  # m
    axes: tuple = eqx.field(static=True)  # half the width and half the height, m

    def distance(self, x):  # to first order: implicit function divided by its gradient
        axes = jnp.asarray(self.axes, x.dtype)
        s = (x - jnp.asarray(self.centre, x.dtype)) / axes
        f, slope = (jnp.sqrt(jnp.sum(a**2, axis=1) + 1e-12) for a in (s, s / axes))
        return (f - 1.0) * f / slope

    def bounds(self):  # area, particles and picture are derived from `distance` within these bounds
        return np.subtract(self.centre, self.axes), np.add(self.centre, self.axes)


def bob(density: float = 500.0, t1: float = 0.5, dx: float = 0.04) -> js.Problem:
    shape, tank = Ellipse((0.8, 0.44), (0.24, 0.12)), js.Box((0.0, 0.0), (1.6, 0.72))
    scheme, solid = js.ISPH.of(dx, speed=2.0, dim=2), dict(filling=js.DummyParticles(), shapes=[shape])
    walls = js.Ghosts.build(tank, dx, scheme.smoothing, js.FreeSlip(), **solid)
    bodies = [js.RigidBody.of(shape, walls.dummies[0], ("heave",), density=density)]
    x, volume = js.still_water(walls, 0.4, dx, [shape])
    still = dict(p=9810.0 * (0.4 - x[:, 1]), volume=volume, g=(0.0, -9.81), dx=dx, sample_dt=0.02)
    model, state = js.assemble(x, 0.0 * x, scheme=scheme, walls=walls, bodies=bodies, **still)
    return js.Problem(model, state, sample_dt=0.02, t1=t1)


if __name__ == "__main__":
    solution = js.run(js.Program(bob, {}), out="runs/own_shape.h5", overwrite=True)
    print(f"the float sinks by {-1e3 * solution['heave'].min():.1f} mm")
