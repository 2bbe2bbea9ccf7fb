"""The filter of tangents: what it keeps, what it removes, and that values do not depend on it."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import coarse, enable_x64

import jaxsph as js
from jaxsph.core.arrays import columns, stack
from jaxsph.model.interfaces import ExactTangents
from jaxsph.model.tangents import TangentFilter, average_of

CHANGES = {
    "tank.length": 1.2,
    "probes": {"gauges": [0.5]},
    "waves.ramp_periods": 0.25,
    "scheme.alpha": 0.01,
    "precision": "float64",
}


@pytest.fixture(scope="module")
def moving():
    """(model, state, tables) of the OWC in float64, its lattice disturbed by a tenth of a spacing."""
    with enable_x64():
        model, state = js.build(coarse("owc", CHANGES))
        x = state.particles.x
        x = x + 0.1 * model.dx * jax.random.uniform(jax.random.key(0), x.shape, x.dtype, -1.0, 1.0)
        state = eqx.tree_at(lambda s: s.particles.x, state, x)
        state, tables = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    return model, state, tables


@pytest.fixture(scope="module")
def averaged(moving):
    """The average of a field `[N, D]` as numpy."""
    with enable_x64():
        average = jax.jit(average_of)(*moving)
    apply = jax.jit(lambda field: stack(average((columns(field),))[0]))

    def averaged(field):
        with enable_x64():
            return np.asarray(apply(jnp.asarray(field)))

    return averaged


def _inside(model, state):
    """Particles whose kernel reaches no ghost: linear fields are kept where there is only water or air."""
    x = np.asarray(state.particles.x)
    ghosts = np.asarray(model.walls.x)
    reach = float(model.scheme.smoothing.radius)
    near = np.min(np.linalg.norm(x[:, None] - ghosts[None], axis=2), axis=1)
    return near > reach


def test_average_keeps_straight_lines_up_to_the_surface(moving, averaged):
    model, state, _ = moving
    x = np.asarray(state.particles.x)
    field = np.stack([0.3 + 2.0 * x[:, 0] - x[:, 1], -0.1 + 0.5 * x[:, 0] + 3.0 * x[:, 1]], axis=1)
    inside = _inside(model, state)
    top = x[:, 1] > x[inside, 1].max() - float(model.dx)
    assert (inside & top).sum() > 5  # some of them at the surface
    # float64 round-off, times large inverse covariances of a few particles
    assert averaged(field)[inside] == pytest.approx(field[inside], abs=1e-12)


def test_average_holds_what_is_tangential_to_a_wall_as_even(moving, averaged):
    """The tangential component's slope across a wall is suppressed: it becomes a mean over several rows."""
    model, state, _ = moving
    x = np.asarray(state.particles.x)
    middle = (x[:, 0] > 0.4) & (x[:, 0] < 0.7)
    first = middle & (x[:, 1] < float(model.dx))
    slope = averaged(np.stack([x[:, 1], x[:, 1]], axis=1))[first]
    # the component normal to the bed keeps a linear field; the tangential component becomes the average of
    # about three rows
    assert slope[:, 1] == pytest.approx(x[first, 1], abs=1e-12)
    assert np.all(slope[:, 0] - x[first, 1] > 0.2 * float(model.dx))


def test_filter_takes_what_neighbours_differ_by_and_leaves_waves(moving, averaged):
    model, state, _ = moving
    x = np.asarray(state.particles.x)
    inside = _inside(model, state)
    rough = np.random.default_rng(1).normal(size=x.shape)
    long = np.cos(2 * np.pi * x / (40 * float(model.dx)))
    for field, low, high in ((rough, 0.3, 0.9), (long, 0.0, 1e-3)):
        rest = field
        for _ in range(3):
            rest = rest - averaged(rest)
        taken = np.linalg.norm(rest[inside]) / np.linalg.norm(field[inside])
        # the noise is white, and S keeps its wavelengths above about six spacings. The wave has k h = 0.19
        # and loses (1 - exp(-(k h)^2/4))^3 = 7e-7; the rest is due to the unevenness of the lattice
        assert low <= taken < high


@pytest.fixture(scope="module")
def energy(moving):
    """Energy absorbed after 20 steps and its slope over K_dm as functions of the filter, by either mode."""
    model, state, _ = moving
    n = 2 * model.search.rebuild_every

    def absorbed(K_dm, tangents):
        changed = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, model, K_dm)
        changed = dataclasses.replace(changed, tangents=tangents)
        paddle = eqx.tree_at(lambda s: s.particles.u, state, state.particles.u.at[:, 1].add(0.1))
        return js.simulate(changed, paddle, n_steps=n, sample_every=n)[0].ledger["pto"].total

    def forward(K_dm, tangents):
        return jax.jvp(lambda K: absorbed(K, tangents), (K_dm,), (jnp.ones_like(K_dm),))

    def reverse(K_dm, tangents):
        return jax.value_and_grad(lambda K: absorbed(K, tangents))(K_dm)

    def of(function):
        @functools.cache
        def at_the_case(tangents):
            with enable_x64():
                compiled = jax.jit(function, static_argnums=1)
                return tuple(map(float, compiled(model.chambers[0].pto.K_dm, tangents)))

        return at_the_case

    return of(forward), of(reverse)


@pytest.mark.slow  # `test_gradients` tests a whole derivative
def test_values_do_not_know_of_the_filter_and_slopes_little(energy):
    forward, _ = energy
    (value, exact), (same, filtered) = forward(ExactTangents()), forward(TangentFilter())
    assert same == value != 0.0
    # over 20 steps; the filter removes a part of the flow of a chamber four spacings wide. Measured: 5e-4
    assert filtered == pytest.approx(exact, rel=5e-3) and filtered != exact


@pytest.mark.slow
@pytest.mark.parametrize("tangents", [ExactTangents(), TangentFilter(), TangentFilter(order=2, interval=3)])
def test_reverse_mode_is_the_transpose_of_forward_mode(energy, tangents):
    """Sums have another order, which changes the round-off."""
    forward, reverse = energy
    assert reverse(tangents) == pytest.approx(forward(tangents), rel=1e-9)


@pytest.mark.parametrize("arguments", [{"order": 0}, {"interval": 0}])
def test_a_filter_of_nothing_is_refused(arguments):
    with pytest.raises(ValueError, match="must be 1 or more"):
        TangentFilter(**arguments)
