"""A damper of your own: a porous screen, whose drag is proportional to the square of the water's speed.

jaxsph run examples/own_damper.py:screened --set drag=20
"""

import equinox as eqx
import jax.numpy as jnp

import jaxsph as js


class Screen(js.AbstractDamper):
    x0: jnp.ndarray  # m
    x1: jnp.ndarray  # m
    drag: jnp.ndarray  # 1/m
    name: str = eqx.field(static=True, default="screen", kw_only=True)

    def entries(self):
        return {self.name: js.Entry(f"energy absorbed by the {self.name}")}

    def damp(self, x, u, t, dt):  # exact solution of du/dt = -drag |u| u over the step
        inside = (x[:, 0] > self.x0) & (x[:, 0] < self.x1)
        speed = jnp.sqrt(jnp.sum(u**2, axis=1) + 1e-12)
        return u / (1.0 + jnp.where(inside, self.drag * speed * dt, 0.0))[:, None]


def screened(drag: float = 10.0, t1: float = 0.5) -> js.Problem:
    changes = {"dx": 0.05, "start.amplitude": 0.05, "scheme.kind": "incompressible"}
    problem = js.load_case("hydrostatic").replace(changes).problem()
    screen = Screen(jnp.float32(0.4), jnp.float32(0.6), jnp.float32(drag))
    return problem.with_parts(dampers=[screen], t1=t1)


if __name__ == "__main__":
    solution = js.run(js.Program(screened, {}), out="runs/own_damper.h5", overwrite=True)
    print(f"the screen absorbs {solution['power_screen'].sum() * 0.01:.3f} J/m")
