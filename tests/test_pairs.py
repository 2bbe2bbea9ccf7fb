"""Pair sums: exchanges between particles cancel, linear fields are exact, derivatives are correct."""

import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64

from jaxsph.core import pairs
from jaxsph.core.arrays import columns
from jaxsph.core.kernels import Gaussian, WendlandC2
from jaxsph.core.native.forms import blocked
from jaxsph.core.pairs import (
    Smoothing,
    pair_sum,
    pair_weights,
    symmetric_inverse,
    symmetric_product,
    trace_upper,
    uncorrected,
    weighted_sum,
    with_empty,
)
from jaxsph.core.slabs import Neighbours, Sources
from jaxsph.model import laws
from jaxsph.model.state import Particles
from jaxsph.model.viscosity import ArtificialViscosity, PhysicalViscosity
from jaxsph.schemes.integrators import SymplecticEuler
from jaxsph.schemes.weakly_compressible import DeltaSPH

DX = 0.1
RHO0 = 1000.0
EPS = float(np.finfo(np.float32).eps)
DIMS = pytest.mark.parametrize("dim", [2, 3])


def _smoothing(kernel=Gaussian):
    return Smoothing(kernel(), jnp.asarray(1.2 * DX))


def _cloud(dim, n, seed=0, jitter=0.3):
    """A lattice with n particles on a side, disturbed by a share of the spacing."""
    rng = np.random.default_rng(seed)
    x = np.stack(np.meshgrid(*[np.arange(n) * DX] * dim, indexing="ij"), -1).reshape(-1, dim)
    return x + jitter * DX * (rng.random(x.shape) - 0.5)


def _all_others(n):
    """Table that lists all other particles; the kernel's support selects the neighbours."""
    i = np.arange(n)
    return jnp.asarray((i[None, :] + np.arange(1, n)[:, None]) % n, jnp.int32)


def _fields(x, seed=1):
    """Uneven volumes, pressures, velocities, density deviations and gradients."""
    rng = np.random.default_rng(seed)
    n, dim = x.shape
    given = {
        "x": columns(jnp.asarray(x)),
        "u": columns(jnp.asarray(rng.normal(size=(n, dim)))),
        "grad_rho": columns(jnp.asarray(rng.normal(size=(n, dim)))),
        "V": jnp.asarray(DX**dim * rng.uniform(0.8, 1.2, n)),
        "p": jnp.asarray(rng.normal(size=n) * 1e3),
        "rho": jnp.asarray(rng.normal(size=n)),
    }
    return jax.tree.map(lambda a: a.astype(jnp.result_type(float)), given)


# --- antisymmetry


@DIMS
@pytest.mark.parametrize("kernel", [Gaussian, WendlandC2])
@pytest.mark.parametrize("law", ["pressure", "viscous", "diffusion"])
def test_pairs_exchange_and_make_nothing(dim, kernel, law):
    """m_i a_ij = -m_j a_ji with a = f/rho and m = rho V, and therefore V_i f_ij = -V_j f_ji."""
    rng = np.random.default_rng(2)
    n = 300
    a = _fields(rng.normal(size=(n, dim)) * DX, seed=3)
    b = _fields(np.stack(a["x"], -1) + 0.9 * DX * rng.normal(size=(n, dim)), seed=4)
    guard = laws.GUARD * (1.2 * DX) ** 2
    term = {
        "pressure": laws.pressure_force,
        "viscous": lambda *pair: laws.viscous_force(*pair, guard),
        "diffusion": lambda *pair: laws.density_diffusion(*pair, guard),
    }[law]
    one_to_one = jnp.arange(n, dtype=jnp.int32)[None]
    there = pair_sum(term, _smoothing(kernel), a, with_empty(b), one_to_one)
    back = pair_sum(term, _smoothing(kernel), b, with_empty(a), one_to_one)
    there, back = (np.stack(jax.tree.leaves(f)) for f in (there, back))
    assert np.count_nonzero(there) > n // 2
    # In floating point x_i - x_j is exactly -(x_j - x_i), and so are all differences. The products of some
    # ten factors are rounded in another order, which changes them by a few units in the last place.
    np.testing.assert_allclose(a["V"] * there, -(b["V"] * back), rtol=10 * EPS)


@DIMS
@pytest.mark.parametrize("viscosity", [PhysicalViscosity(1.0), ArtificialViscosity(0.1)])
def test_isolated_blob_keeps_its_momentum(dim, viscosity):
    x = _cloud(dim, {2: 8, 3: 4}[dim])
    n = len(x)
    sources = _fields(x)
    m = sources["V"] * (RHO0 + sources["rho"])
    particles = Particles(
        jnp.asarray(x, jnp.float32),
        jnp.zeros((n, dim)),
        jnp.stack(sources["u"], -1),
        sources["rho"],
        m,
        jnp.arange(n),
        jnp.zeros(n),
        jnp.zeros(n),
    )
    scheme = DeltaSPH(
        smoothing=_smoothing(),
        c0=jnp.asarray(20.0),
        rho0=jnp.asarray(RHO0),
        delta=jnp.asarray(0.1),
        viscosity=viscosity,
        integrator=SymplecticEuler(),
    )
    weightless = types.SimpleNamespace(g=jnp.zeros(dim))
    tables = types.SimpleNamespace(fluid=Neighbours.of(_all_others(n)))
    del sources["grad_rho"]
    rates = scheme.momentum(weightless, particles, Sources(sources, {}), tables)
    force = np.asarray(m) * np.stack(rates.acceleration)
    # Every force is a sum of at most n - 1 terms, each rounded about ten times relative to itself; the total
    # is at most that share of the sum of all magnitudes. One wrong pair in a hundred would leave 1e-2 of it.
    assert np.all(np.abs(force.sum(axis=1)) < 10 * EPS * np.sqrt(n) * np.abs(force).sum(axis=1))
    assert np.all(np.abs(force).sum(axis=1) > 0)


# --- linear fields


def _gradient(x, rho, V):
    n = len(x)
    fields = {"x": columns(x), "rho": rho, "V": V}
    smoothing, sources, table = _smoothing(), with_empty(fields), _all_others(n)

    def both(*pair):
        return laws.moment_matrix(*pair), laws.density_gradient(*pair)

    M, b = pair_sum(both, smoothing, fields, sources, table)
    return M, jnp.stack(symmetric_product(symmetric_inverse(M), b), -1)


@DIMS
def test_renormalised_gradient_is_exact_for_linear_fields_also_at_edges(dim):
    with enable_x64():
        x = jnp.asarray(_cloud(dim, {2: 8, 3: 5}[dim]))
        slope = jnp.asarray([3.0, -2.0, 0.5][:dim])
        V = _fields(np.asarray(x))["V"]
        M, found = _gradient(x, 7.0 + x @ slope, V)
        dense = np.zeros((len(x), dim, dim))
        upper = np.triu_indices(dim)
        dense[:, upper[0], upper[1]] = dense[:, upper[1], upper[0]] = np.stack(M, -1)
        sound = np.linalg.det(dense) > 0.05
        edge = np.any((x < 0.5 * DX) | (x > x.max(axis=0) - 0.5 * DX), axis=1)
        assert np.count_nonzero(sound & edge) > 0.5 * edge.sum() and np.all(sound[~edge])
        # Round-off of 1e-16 in sums of some tens of terms, times a condition of 1/0.05.
        np.testing.assert_allclose(found[sound], np.broadcast_to(slope, found.shape)[sound], rtol=1e-11)


@DIMS
def test_density_diffusion_leaves_linear_fields_alone(dim):
    with enable_x64():
        x = jnp.asarray(_cloud(dim, 5))
        slope = jnp.asarray([3.0, -2.0, 0.5][:dim])
        n = len(x)

        def rate(rho):
            fields = {
                "x": columns(x),
                "rho": rho,
                "V": jnp.full(n, DX**dim),
                "grad_rho": columns(jnp.broadcast_to(slope, x.shape)),
            }
            law = lambda *pair: laws.density_diffusion(*pair, laws.GUARD * (1.2 * DX) ** 2)  # noqa: E731
            return pair_sum(law, _smoothing(), fields, with_empty(fields), _all_others(n))

        linear = 7.0 + x @ slope
        bent = linear + 0.1 * jnp.sum((x / DX) ** 2, axis=1)
        # The two halves of Psi cancel to round-off of rho (1e-15); a curved field gives the scale.
        assert float(jnp.max(jnp.abs(rate(linear)))) < 1e-12 * float(jnp.max(jnp.abs(rate(bent))))


@DIMS
def test_position_divergence_is_the_dimension_inside_and_less_at_the_surface(dim):
    n = 9
    x = jnp.asarray(_cloud(dim, n, jitter=0.0), jnp.float32)
    M, _ = _gradient(x, jnp.zeros(len(x)), jnp.full(len(x), DX**dim))
    divergence = np.asarray(trace_upper(M, dim)).reshape((n,) * dim)
    centre, face = (n // 2,) * dim, (n // 2,) * (dim - 1) + (n - 1,)
    # The cut at 3h removes 1e-3 (2-D) to 3e-3 (3-D) of the second moment, and the lattice as much again.
    assert divergence[centre] == pytest.approx(dim, rel=6e-3)
    assert divergence[face] < 1.89 / 2.0 * dim


# --- the loop itself


def test_empty_slots_and_far_sources_add_nothing():
    fields = _fields(_cloud(2, 4))
    n = len(fields["V"])
    full = _all_others(n)
    padded = jnp.concatenate([full, jnp.full((3, n), n, jnp.int32)])
    sums = [
        pair_sum(laws.pressure_force, _smoothing(), fields, with_empty(fields), t) for t in (full, padded)
    ]
    np.testing.assert_array_equal(sums[0], sums[1])
    outside = fields | {"x": tuple(c * 100.0 for c in fields["x"])}  # 10 m apart, outside every support
    alone = pair_sum(laws.pressure_force, _smoothing(), outside, with_empty(outside), full)
    assert not np.any(np.stack(alone))


def test_jit_is_eager():
    fields = _fields(_cloud(2, 6))
    table = _all_others(len(fields["V"]))

    def force(f):
        return jnp.stack(pair_sum(laws.pressure_force, _smoothing(), f, with_empty(f), table))

    eager, jitted = force(fields), jax.jit(force)(fields)
    # Fusion may contract a product and a sum: errors are some units in the last place of the largest term.
    np.testing.assert_allclose(jitted, eager, atol=20 * EPS * float(jnp.max(jnp.abs(eager))))


def test_derivatives_of_a_pair_sum():
    with enable_x64():
        x = jnp.asarray(_cloud(2, 5))
        fields = _fields(np.asarray(x))
        table = _all_others(len(x))
        weights = jnp.asarray(np.random.default_rng(5).normal(size=(2, len(x))))

        @jax.jit
        def total(x):
            f = fields | {"x": columns(x)}
            force = pair_sum(laws.pressure_force, _smoothing(), f, with_empty(f), table)
            return jnp.sum(weights * jnp.stack(force))

        v = jnp.asarray(np.random.default_rng(6).normal(size=x.shape))
        _, forward = jax.jvp(total, (x,), (v,))
        step = 1e-6 * DX
        difference = (total(x + step * v) - total(x - step * v)) / (2 * step)
        # Truncation (step/h)^2 = 1e-12 and cancellation 1e-16/1e-6 = 1e-10 of terms that partly cancel; at 3h
        # a pair's term jumps by 1e-4, but no pair of this cloud crosses that distance.
        assert float(forward) == pytest.approx(float(difference), rel=1e-6)
        reverse = jnp.vdot(jax.grad(total)(x), v)
        # The same derivative, summed in another order.
        assert float(reverse) == pytest.approx(float(forward), rel=1e-10)


def test_loops_over_slots_give_one_sum_and_one_slope(monkeypatch):
    """The loops for CPUs and for accelerators agree, also with empty slots and an incomplete last block."""
    x = _cloud(2, 5)
    with enable_x64():
        fields, n = _fields(x), len(x)
    table = jnp.concatenate([_all_others(n), jnp.full((9, n), n, jnp.int32)])

    def found(x):
        f = fields | {"x": columns(x)}
        force = pair_sum(laws.pressure_force, _smoothing(), f, with_empty(f), table)
        law = lambda pair, i, j: (pair.W, j["V"] * pair.W)  # noqa: E731
        listed = blocked(table)
        filled, weights = pair_weights(law, _smoothing(), f, with_empty(f), listed)
        return jnp.stack([*force, filled, weighted_sum(weights, jnp.append(f["rho"], 0.0), listed)])

    def sums_and_slopes(loop):
        monkeypatch.setattr(pairs, "slot_loop", lambda: loop)
        x0, direction = jnp.asarray(x), jnp.ones(x.shape).at[:, 0].set(0.3)
        weights = jnp.asarray(np.random.default_rng(5).normal(size=(4, n)))
        run = jax.jit(lambda x: jax.jvp(found, (x,), (direction,)))
        return *run(x0), jax.jit(jax.grad(lambda x: jnp.sum(weights * found(x))))(x0)

    with enable_x64():
        cpu, accelerator = (sums_and_slopes(loop) for loop in (pairs.ONE_BY_ONE, pairs.IN_BLOCKS))
    for one, other in zip(cpu, accelerator, strict=True):
        # the same terms in the same order, some of them as fused products and sums
        np.testing.assert_allclose(other, one, atol=1e-13 * np.max(np.abs(one)))


@pytest.mark.parametrize(("dim", "limit"), [(2, 98.6), (3, 136.3)])
def test_gradients_are_corrected_but_in_corners(dim, limit):
    """Water in a wedge of 2 degrees less and more than the limit, and at a flat surface."""
    kernel, n = WendlandC2(), 81 if dim == 3 else 401
    at = np.linspace(-2.0, 2.0, n)
    x = np.stack(np.meshgrid(*[at] * dim, indexing="ij"), -1).reshape(-1, dim)
    F = np.asarray(kernel.slope(jnp.sum(jnp.square(x), 1), 1.0, dim), float) * (np.sum(x**2, 1) < 4.0)
    angle = np.degrees(np.abs(np.arctan2(x[:, 1], x[:, 0])))

    def wedge(degrees):
        # points exactly on a face would count by half; with faces slightly off the lattice there are none
        inside = angle < 0.5 * degrees
        rows = [(a, b) for a in range(dim) for b in range(a, dim)]
        return tuple(
            jnp.asarray(-np.sum((F * x[:, a] * x[:, b])[inside]) * (at[1] - at[0]) ** dim) for a, b in rows
        )

    assert uncorrected(wedge(limit - 2.0)) and not uncorrected(wedge(limit + 2.0))
    assert uncorrected(wedge(90.0)) and not uncorrected(wedge(180.0)) and not uncorrected(wedge(361.0))
    one = symmetric_inverse(wedge(90.0))
    assert [float(a) for a in one] == ([1, 0, 1] if dim == 2 else [1, 0, 0, 1, 0, 1])
