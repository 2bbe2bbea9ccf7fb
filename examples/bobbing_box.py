"""A problem of your own: a box released above its equilibrium bobs.

The arguments of `box` are the keys of `--set` and `--grid`.
jaxsph run examples/bobbing_box.py:box --set density=400
jaxsph sweep examples/bobbing_box.py:box --grid density=300,400,500
"""

import numpy as np

import jaxsph as js

DEPTH, SIDE = 0.4, 0.24  # depth of the water and side of the box, m


def box(dx: float = 0.04, density: float = 500.0, lift: float = 0.04) -> js.Problem:
    bottom = round((DEPTH - SIDE * density / 1000.0 + lift) / dx) * dx
    shape = js.Block((0.76, bottom), (0.76 + SIDE, bottom + SIDE))
    scheme, water = js.ISPH.of(dx, speed=2.0, dim=2), js.Box((0.0, 0.0), (1.76, 0.8))
    filling = {"filling": js.DummyParticles(), "shapes": [shape]}
    walls = js.Ghosts.build(water, dx, scheme.smoothing, js.FreeSlip(), **filling)
    body = js.RigidBody.of(shape, walls.dummies[0], ("heave",), density=density)
    x, volume = js.still_water(walls, DEPTH, dx, [shape])
    still = dict(p=9810.0 * (DEPTH - x[:, 1]), volume=volume, g=(0.0, -9.81), dx=dx, sample_dt=0.02)
    model, state = js.assemble(x, 0.0 * x, scheme=scheme, walls=walls, bodies=[body], **still)
    fall = js.Result(largest_fall, {"fall": js.Label("largest fall of the box", "m")})
    return js.Problem(model, state, sample_dt=0.02, t1=1.0, results=[fall])


def largest_fall(record: js.Record) -> dict:
    return {"fall": -np.min(record["heave"])}


if __name__ == "__main__":
    solution = js.run(js.Program(box, {"density": 400.0}), out="runs/bobbing_box.h5", overwrite=True)
    print(f"the box falls by {1e3 * solution.results['fall']:.1f} mm")
