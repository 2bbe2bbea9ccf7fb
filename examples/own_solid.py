"""A solid of your own: an elliptical plunger that heaves in the surface and makes waves to both sides."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxsph as js


class Ellipse(js.AbstractShape):
    centre: tuple = eqx.field(static=True)  # m
    axes: tuple = eqx.field(static=True)  # half of its width and of its height, m

    def distance(self, x):  # to first order: the implicit function over its gradient
        s = (x - jnp.asarray(self.centre, x.dtype)) / jnp.asarray(self.axes, x.dtype)
        f, slope = (jnp.sqrt(jnp.sum(a**2, axis=1) + 1e-12) for a in (s, s / jnp.asarray(self.axes, x.dtype)))
        return (f - 1.0) * f / slope

    def bounds(self):  # its area, its particles and its picture follow from its distance between these
        return np.subtract(self.centre, self.axes), np.add(self.centre, self.axes)


class Heave(js.AbstractPath):
    def pose(self, t):  # surge, heave, pitch
        return jnp.stack([0.0 * t, -0.02 * jnp.sin(2.0 * jnp.pi * t), 0.0 * t])


dx, depth, shape = 0.04, 0.4, Ellipse((0.8, 0.4), (0.24, 0.12))
scheme, solid = js.ISPH.of(dx, speed=2.0, dim=2), dict(filling=js.DummyParticles(), shapes=[shape])
walls = js.Ghosts.build(js.Box((0.0, 0.0), (1.6, 0.72)), dx, scheme.smoothing, js.FreeSlip(), **solid)
plunger = js.DrivenSolid(shape=shape, path=Heave(), pivot=jnp.array(shape.centre), rows=walls.dummies[0])
x, volume = js.still_water(walls, depth, dx, [shape])
still = dict(p=9810.0 * (depth - x[:, 1]), volume=volume, g=(0.0, -9.81), dx=dx, sample_dt=0.02)
model, state = js.assemble(x, 0.0 * x, scheme=scheme, walls=walls, moving=[plunger], **still)
solution = js.march(model, state, 1.0, 0.02, js.default_probes(model, state, 0.02))
print(f"the plunger gave {solution['power_paddle'].sum() * 0.02:.3f} J/m to the water in a period")
