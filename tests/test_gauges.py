"""Gauges of the surface: readings of a wire in still water, under a slope, in a wave and under a splash."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsph as js
from jaxsph.case.probes import make_probes
from jaxsph.probes.gauges import WaveGauge

DX, LENGTH, DEPTH = 0.02, 1.0, 0.2
AT = (0.0, 0.013, 0.251, 0.5, 0.737, 0.999)


@pytest.fixture(scope="module")
def tank():
    """A tank with wires, its model and state."""
    case = js.load_case("hydrostatic").replace(
        {
            "dx": DX,
            "tank.length": LENGTH,
            "tank.depth": DEPTH,
            "tank.height": 0.6,
            "probes.pressure": None,
            "probes.surface": [(x,) for x in AT],
        }
    )
    return case, *js.build(case)


def filled(state, elevation):
    """The state with columns of particles whose volumes fill the tank to the elevation (m) at every x (m)."""
    p, rows = state.particles, round(DEPTH / DX)
    x = (np.arange(round(LENGTH / DX)) + 0.5) * DX
    top = DEPTH + elevation(x)
    z = (np.arange(rows) + 0.5) / rows * top[:, None]
    places = np.stack([np.broadcast_to(x[:, None], z.shape), z], -1).reshape(-1, 2)
    m = np.repeat(1000.0 * DX * top / rows, rows)
    return eqx.tree_at(
        lambda s: (s.particles.x, s.particles.m, s.particles.rho),
        state,
        (jnp.asarray(places, p.x.dtype), jnp.asarray(m, p.m.dtype), jnp.zeros_like(p.rho)),
    )


def wires(case, model, state, at):
    """Readings at the case's surface points in the state `at`, by name, without `eta_interpolated`."""
    tables = None
    found = {}
    for probe in make_probes(case, model, state):
        names = [k for k, r in probe.describe().items() if r.dimension == "surface_point"]
        if names and names != ["eta_interpolated"]:
            tables = model.scheme.prepare(model, at)[1] if tables is None else tables
            found |= probe.measure(model, at, tables)
    return found


# Bounds: float32 sums of a few hundred terms are good to 1e-5 of the depth. A wave's reading is also lower
# because of smoothing, by exp(-(1.2 k dx)^2/4). Slopes are read where no wall is in the Gaussian's reach.
@pytest.mark.parametrize(
    ("elevation", "places", "bound"),
    [
        (lambda x: 0.0 * x, slice(None), 1e-5 * DEPTH),
        (lambda x: 0.1 * (x - 0.5), slice(2, 5), 1e-5 * DEPTH),
        (lambda x: 0.02 * np.cos(2 * np.pi * x), slice(2, 5), 0.02 * 0.36 * (2 * np.pi * DX) ** 2 + 2e-6),
    ],
    ids=["still", "tilted", "standing wave"],
)
def test_a_wire_reads_the_exact_surface(tank, elevation, places, bound):
    """A wire reads a plane surface exactly (a level one also beside a wall), and a wave but for smoothing."""
    case, model, state = tank
    at = filled(state, elevation)
    read = np.asarray(wires(case, model, state, at)["eta_wire"])
    exact = elevation(np.asarray(AT))
    assert np.max(np.abs(read - exact)[places]) < bound


def test_a_wire_reads_water_under_a_splash(tank):
    """Over 2 cm of broken water every wire reads a number, close to the volume there per length: drops count
    by their volume, not by their height."""
    case, model, state = tank
    x = np.array(state.particles.x)
    m = np.array(state.particles.m)
    inside = x[:, 1] < 0.02  # one layer remains, with a gap of three spacings
    keep = inside & (np.abs(x[:, 0] - 0.5) > 1.5 * DX)
    drops = np.flatnonzero(~inside)[:3]
    x[drops] = [[0.25, 0.12], [0.26, 0.13], [0.737, 0.14]]
    m[~keep] = 0.0
    m[drops] = 1000.0 * DX**2
    gone = np.flatnonzero(~keep & ~np.isin(np.arange(len(x)), drops))
    m = np.maximum(m, 1e-12)
    x[gone] = np.stack([np.full(len(gone), 0.01), np.linspace(0.3, 0.59, len(gone))], -1)
    at = eqx.tree_at(
        lambda s: (s.particles.x, s.particles.m),
        state,
        (jnp.asarray(x, state.particles.x.dtype), jnp.asarray(m, state.particles.m.dtype)),
    )
    volume = WaveGauge(jnp.asarray(AT, model.dt.dtype), jnp.zeros(len(AT), model.dt.dtype))
    depth = np.asarray(volume.measure(model, at, None)["eta"])
    for name, read in wires(case, model, state, at).items():
        read = np.asarray(read) + DEPTH
        assert np.all(np.isfinite(read)), name
        # the wire averages over 1.2 dx and the gauge of volumes over 3 dx: with a drop of one cell they
        # differ by less than dx
        assert np.all(read >= 0.0), name
        assert np.max(np.abs(read - depth)[1:-1]) < DX, name


def test_a_wire_is_differentiable_in_the_places_of_the_water(tank):
    """The slope of a reading with respect to a shift of the water is that of the exact surface."""
    case, model, state = tank
    probe = next(p for p in make_probes(case, model, state) if "eta_wire" in p.describe())
    at = filled(state, lambda x: 0.1 * (x - 0.5))

    def read(shift):
        moved = eqx.tree_at(lambda s: s.particles.x, at, at.particles.x + shift * jnp.array([1.0, 0.0]))
        return probe.measure(model, moved, None)["eta_wire"][3]

    slope = jax.jvp(read, (jnp.zeros(()),), (jnp.ones(()),))[1]
    # moved to the right by s, a surface with the slope 0.1 falls by 0.1 s; the sum's rounding is 1e-6
    assert abs(float(slope) + 0.1) < 1e-3
