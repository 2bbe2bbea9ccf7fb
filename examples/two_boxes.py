"""Two boxes with a half and a third of the water's density float in one tank.

A half and a third of their heights are immersed.
"""

import jaxsph as js

dx, depth, sample = 0.04, 0.4, 0.02
boxes = (js.Block((0.4, 0.28), (0.64, 0.52)), js.Block((1.12, 0.32), (1.36, 0.56)))
densities = (500.0, 1000.0 / 3.0)
scheme = js.ISPH.of(dx, speed=2.0, dim=2)
walls = js.Ghosts.build(
    js.Box((0.0, 0.0), (1.76, 0.8)),
    dx,
    scheme.smoothing,
    js.FreeSlip(),
    filling=js.DummyParticles(),
    shapes=boxes,
)
bodies = [
    js.RigidBody.of(shape, rows, ("surge", "heave", "pitch"), density=density, name=f"{k}")
    for k, (shape, rows, density) in enumerate(zip(boxes, walls.dummies, densities, strict=True))
]
x, volume = js.still_water(walls, depth, dx, boxes)
p = 9810.0 * (depth - x[:, 1])
model, state = js.assemble(
    x,
    0.0 * x,
    scheme=scheme,
    walls=walls,
    dx=dx,
    sample_dt=sample,
    p=p,
    volume=volume,
    g=(0.0, -9.81),
    bodies=bodies,
)
solution = js.march(model, state, 0.6, sample, js.default_probes(model, state, sample))
for k, body in enumerate(bodies):
    force = solution[f"body_force_mean_{k}"][5:, 1].mean() / (9.81 * float(body.mass))
    heave = solution[f"heave_{k}"][-1]
    print(f"box {k}: the water carries {force:.3f} of its weight; heave {1e3 * heave:.2f} mm")
