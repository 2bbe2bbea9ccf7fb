"""Two chambers in one tank, in a row at its end, with turbines of different damping, in regular waves."""

import jax.numpy as jnp

import jaxsph as js

dx, depth, length, tip, sample = 0.04, 0.44, 2.0, 0.28, 0.02
plates = (js.WallPlate(1.52, 1.56, tip), js.WallPlate(1.76, 1.80, tip))
chambers = [
    js.Chamber.of(js.PneumaticPTO(jnp.float32(K)), between=sides, tip=tip, level=depth, dx=dx, name=name)
    for name, sides, K in (("sea", (1.56, 1.76), 300.0), ("land", (1.80, 2.0), 600.0))
]
scheme = js.DeltaSPH.of(dx, c0=22.0, viscosity=js.ArtificialViscosity(0.02))
box = js.Box((0.0, 0.0), (length, 0.8), paddle=True, stroke=0.1)
walls = js.Ghosts.build(box, dx, scheme.smoothing, js.FreeSlip(), plates)
waves = js.RegularWaves(jnp.float32(0.06), jnp.float32(1.2), jnp.float32(depth), ramp=jnp.float32(0.6))
paddle = js.Paddle(motion=js.WaveMotion(waves), rows=walls.paddle)
x, volume = js.still_water(walls, depth, dx)
still = dict(p=9810.0 * (depth - x[:, 1]), volume=volume, g=(0.0, -9.81), speed=1.0)
model, state = js.assemble(
    x,
    0.0 * x,
    scheme=scheme,
    walls=walls,
    dx=dx,
    sample_dt=sample,
    moving=[paddle],
    chambers=chambers,
    **still,
)
solution = js.march(model, state, 2.4, sample, js.default_probes(model, state, sample))
for name in ("sea", "land"):
    energy, most = solution[f"power_pto_{name}"].sum() * sample, solution[f"P_a_{name}"].max()
    print(f"chamber {name}: largest pressure {most:.1f} Pa, energy {energy:.3f} J/m")
