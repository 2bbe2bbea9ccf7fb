"""The hydrostatic pressure that is taken out of the pair sums at a thin wall and put back as a force."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64

import jaxsph as js
from experiments.verification import thin_wall
from jaxsph.case.geometry import Geometry
from jaxsph.case.parts import make_background
from jaxsph.core.arrays import columns
from jaxsph.core.kernels import Gaussian
from jaxsph.core.pairs import Smoothing, pair_sum, with_empty
from jaxsph.model import laws
from jaxsph.model.background import Background
from jaxsph.model.viscosity import PhysicalViscosity

DX, H = 0.01, 0.012


def _background():
    return Background(*(jnp.asarray(a) for a in (1.0, 0.03, 0.32, 0.26, 0.40, 9810.0, 0.37)))


def test_force_is_the_gradient_of_the_smoothed_background():
    """Compared with automatic differentiation of the product; 1e-12 is the round-off of third derivatives."""
    with enable_x64():
        background = _background()
        x = jnp.asarray(np.random.default_rng(0).uniform([0.6, 0.0], [1.4, 0.42], (200, 2)))

        def smoothed(x):
            def at(x):
                return background.pressure(x[None])[0]

            return at(x) + 0.25 * H * H * jnp.trace(jax.hessian(at)(x))

        expected = -np.asarray(jax.vmap(jax.grad(smoothed))(x))
        found = np.stack(background.force(x, jnp.asarray(H)), axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_sum_and_force_cancel_where_the_kernel_is_full():
    """Pair sum with p = R everywhere, compared with the force put back.

    Where R begins and ends, its third derivative jumps by 60 p/L^3 = 2e7 Pa/m3 over L = 0.14 m. Half of the
    kernel sees the jump, which leaves h^2/8 of it, 3 %.
    """
    with enable_x64():
        background = _background()
        axes = np.arange(0.55, 1.45, DX), np.arange(0.02, 0.46, DX)
        x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
        inner = np.all((x > [0.6, 0.07]) & (x < [1.4, 0.41]), axis=1)
        index = np.flatnonzero(inner)[::7]
        r = np.linalg.norm(x[index, None] - x[None], axis=2)
        near = [np.flatnonzero((d < 3 * H) & (d > 0)) for d in r]
        table = np.full((max(map(len, near)), len(index)), len(x))
        for k, row in enumerate(near):
            table[: len(row), k] = row
        V = jnp.full(len(x), DX**2)
        R = background.pressure(jnp.asarray(x))
        fields = {"x": columns(jnp.asarray(x)), "p": R, "V": V}
        targets = jax.tree.map(lambda a: a[index], fields)
        smoothing = Smoothing(Gaussian(), jnp.asarray(H))
        summed = pair_sum(laws.pressure_force, smoothing, targets, with_empty(fields), jnp.asarray(table))
        along, up = background.force(jnp.asarray(x[index]), jnp.asarray(H))
        # the sum gives the force of the pressure, -grad R, and the body force must be the same
        left = np.asarray(summed) - np.stack([along, up])
        assert np.abs(left).max() < 0.03 * np.abs(np.asarray(up)).max()


def test_what_the_sums_lose_is_in_the_budget(vessel):
    """Without walls, the power of the pair sums and of the force put back changes compression energy and sum
    V R.

    The remainder is due to the smoothing of the gradient, h^2/4 lap R.
    """
    _, model, state = vessel
    none = jnp.zeros_like(model.scheme.delta)
    scheme = eqx.tree_at(lambda s: (s.delta, s.viscosity), model.scheme, (none, PhysicalViscosity(none)))
    assert scheme.background
    u = jnp.asarray(np.random.default_rng(1).normal(size=state.particles.x.shape), jnp.float32)

    @jax.jit
    def powers(state):
        state, tables = scheme.prepare(model, state)
        state = eqx.tree_at(lambda s: s.particles.u, state, u)
        p = state.particles
        sources = scheme.sources(scheme.place_ghosts(model, state, tables), 0.0 * model.walls.x)
        sources.ghosts["V"] = jnp.zeros_like(sources.ghosts["V"])
        rates = scheme.momentum(model, p, sources, tables)
        rate = scheme.continuity(p, sources, rates.grad_rho, tables)
        gained = zip(u.T, rates.acceleration, model.g, strict=True)
        given = sum(jnp.sum(p.m * c * (a - g)) for c, a, g in gained)

        def energy(scheme):
            return lambda x, rho: scheme.compression(eqx.tree_at(lambda p: (p.x, p.rho), p, (x, rho)))

        bare = eqx.tree_at(lambda s: s.background, scheme, ())
        return given, *(jax.jvp(energy(s), (p.x, p.rho), (u, rate))[1] for s in (scheme, bare))

    given, stored, compressed = (float(a) for a in powers(state))
    assert given + stored == pytest.approx(0.0, abs=0.05 * abs(stored - compressed))


def test_only_thin_walls_have_one():
    owc = js.load_case("owc")
    thick = owc.replace({"device.wall_thickness": 0.08, "probes.pressure": None})
    assert make_background(owc, Geometry.of(owc), jnp.asarray)
    assert not make_background(thick, Geometry.of(thick), jnp.asarray)


@pytest.mark.slow
def test_a_wall_of_one_spacing_stays_quiet():
    """Four seconds, no viscosity: 1 cm/s is 0.4 % of sqrt(g d); with no background the tip reaches 7 cm/s."""
    solution = js.run(thin_wall.at_rest(0.02), t1=4.0, progress=False)
    assert np.max(solution["max_speed"][solution.t > 1.0]) < 0.01
