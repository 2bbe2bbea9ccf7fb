"""The incompressible scheme: still water, floating bodies, the vortex, its solvers and its derivatives."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64

import jaxsph as js
from jaxsph import analysis
from jaxsph.case.initial import SURFACE_ROWS
from jaxsph.case.probes import make_probes
from jaxsph.model import laws
from jaxsph.model.state import Failure
from jaxsph.probes.parts import PartProbe
from jaxsph.report.labels import LABELS
from jaxsph.schemes.bodies import body_grip
from jaxsph.schemes.incompressible import ISPH
from jaxsph.schemes.kernels import NAMED
from jaxsph.schemes.poisson import BiCGStab, Explicit
from jaxsph.schemes.projection import MEAN_TIME, RELAXATION, undoing
from jaxsph.solids.contact import touch_force

TANK = {
    "dx": 0.05,
    "t1": 1.0,
    "tank": {"length": 1.0, "depth": 0.5},
    "scheme": {"kind": "incompressible"},
    "output": {"sample_dt": 0.02},
}
FLOATING = TANK | {
    "dx": 0.025,
    "body": {"block": {"low": [0.35, 0.35], "high": [0.65, 0.65]}, "density": 500.0, "free": ["heave"]},
}
FLAP = {
    "block": {"low": [0.54, 0.06], "high": [0.66, 0.54]},
    "mass": 30.0,
    "inertia": 1.5,
    "pivot": [0.6, 0.15],
    "free": ["pitch"],
    "velocity": [0.0, 0.0, 0.3],
    "pto": {"damping": 10.0, "coulomb": 0.1},
}


# jitted, because otherwise every loop in a step would be compiled separately
prepare_ = jax.jit(lambda model, state: model.scheme.prepare(model, state))
step_ = jax.jit(lambda model, state, tables: model.step(state, tables))
wet_ = jax.jit(lambda m, s, t: m.scheme.place_ghosts(m, s, t).fit.wet)
divergence_ = jax.jit(lambda model, state, tables: model.scheme.divergence(model, state, tables))


@pytest.fixture(scope="module")
def advanced():
    """Function that advances a model and compiles its steps once."""
    compiled = {}

    def of(name, case, n_blocks):
        if name not in compiled:
            model, state = js.build(js.Case.from_dict(case))
            n_steps = n_blocks * model.search.rebuild_every
            march = jax.jit(lambda s: js.simulate(model, s, n_steps=n_steps)[0])
            compiled[name] = model, state, march(state)
        return compiled[name]

    return of


@pytest.mark.parametrize("walls", [pytest.param("mirror", marks=pytest.mark.slow), "dummy"])
def test_water_at_rest_stays_and_its_pressure_is_hydrostatic(advanced, walls):
    """Forty rows. The error, 1/50 of rho g d, is due to the surface's position and to settling particles."""
    case = TANK | {"dx": 0.0125, "tank": TANK["tank"] | {"walls": walls}}
    _model, _, state = advanced(f"fine_{walls}", case, 20)
    p = state.particles
    assert int(state.status.bits) == 0
    error = np.asarray(p.p) - 9810.0 * (0.5 - np.asarray(p.x[:, 1]))
    assert np.sqrt(np.mean(error**2)) < 0.2 * 0.05 * 9810.0
    assert np.abs(np.asarray(p.u)).max() < 0.01 * np.sqrt(9.81 * 0.5)


def test_a_floating_box_stays_and_the_water_carries_its_weight(advanced):
    """With a density ratio of 0.5, the added mass equals the body's; a lagged coupling would oscillate."""
    _model, _, state = advanced("floating", FLOATING, 20)
    weight = 500.0 * 0.3 * 0.3 * 9.81
    assert int(state.status.bits) == 0
    np.testing.assert_allclose(state.parts["body"].force[1], weight, rtol=0.01)
    assert abs(float(state.parts["body"].pose[1])) < 0.02 * 0.15


def test_dummies_are_told_of_the_level_by_a_mean_of_the_pressure(advanced):
    """Scatter in the last step's pressure makes no dummy wet or dry; a higher mean pressure does."""
    model, _, state = advanced("floating", FLOATING, 20)
    state, tables = prepare_(model, state)
    p, cell = state.particles, 9810.0 * float(model.dx)
    scatter = cell * np.random.default_rng(0).normal(size=len(p.p))
    scattered = eqx.tree_at(lambda s: s.particles.p, state, p.p + jnp.asarray(scatter, p.p.dtype))
    raised = eqx.tree_at(lambda s: s.particles.p_mean, state, p.p_mean + cell)
    usual, same, more = (wet_(model, s, tables) for s in (state, scattered, raised))
    np.testing.assert_array_equal(same, usual)
    assert np.sum(more - usual) > 0.1
    after = step_(model, state, tables).particles
    time = MEAN_TIME * np.sqrt(float(model.scheme.smoothing.h) / 9.81)
    share = 1.0 - np.exp(-float(model.dt) / time)
    np.testing.assert_allclose(after.p_mean, p.p_mean + share * (after.p - p.p_mean), rtol=1e-4, atol=0.1)


@pytest.mark.slow
def test_a_box_floats_in_weakly_compressible_water_too(advanced):
    """Over 0.2 s. Sound makes the force oscillate; its mean carries the weight within 3 %."""
    case = {k: v for k, v in FLOATING.items() if k != "scheme"}
    model, state = js.build(js.Case.from_dict(case))
    sample = 0.02
    found = js.march(model, state, 0.2, sample, (PartProbe.of(model.bodies[0], jnp.float32(sample), 2),))
    mean = found["body_force_mean"][1:, 1].mean()
    np.testing.assert_allclose(mean, 500.0 * 0.3 * 0.3 * 9.81, rtol=0.03)
    assert np.abs(found["heave"]).max() < 0.02 * 0.15


@pytest.mark.slow
def test_energy_of_a_swinging_flap_is_accounted_for():
    """Projection, contact and damping account for all kinetic energy lost (0.02 % when this was written)."""
    case = js.Case.from_dict(TANK | {"body": FLAP, "t1": 0.3, "output": {"sample_dt": 0.02}})
    model, state = js.build(case)
    found = js.march(model, state, 0.3, 0.02, make_probes(case, model, state))
    budget = analysis.energy_budget(found.series)
    assert budget["pto"] > 0.05 * found["kinetic"][0]
    assert abs(budget["residual_share"]) < 1e-3


def test_water_that_touches_a_body_pushes_it(advanced):
    model, _, state = advanced("floating", FLOATING, 20)
    kick = jnp.ones_like(state.particles.u)
    near = np.asarray(model.bodies[0].distance(state.parts["body"], state.particles.x)) < 0.4 * 0.025
    p = eqx.tree_at(lambda s: s.particles.x, state, state.particles.x.at[0].set(jnp.array([0.5, 0.345])))
    force = touch_force(model, model.bodies[0], p.parts["body"], p.particles, kick, model.dt)
    expected = -(float(p.particles.m[0]) + float(np.sum(np.asarray(state.particles.m)[near]))) / model.dt
    np.testing.assert_allclose(force[:2], expected, rtol=1e-5)


@pytest.mark.slow
def test_gauges_read_the_surface_in_three_dimensions():
    """At rest, and with the water lifted by a fifth of a spacing."""
    case = js.Case.from_dict(
        {
            "dx": 0.05,
            "t1": 1.0,
            "tank": {"length": 1.0, "width": 0.6, "depth": 0.3},
            "scheme": {"kind": "incompressible"},
            "waves": {"H": 0.05, "T": 1.0},
            "probes": {"gauges": [0.5], "surface": [[0.5, 0.3]]},
        }
    )
    model, state = js.build(case)
    assert float(model.moving[0].motion.still) == pytest.approx(0.3, rel=1e-5)
    gauges = [p for p in make_probes(case, model, state) if "Gauge" in type(p).__name__]
    state, tables = prepare_(model, state)
    lifted = eqx.tree_at(lambda s: s.particles.x, state, state.particles.x + jnp.array([0.0, 0.0, 0.01]))
    for gauge in gauges:
        expected = 0.01 if type(gauge).__name__ == "InterpolatedGauge" else 0.0
        (at_rest,) = gauge.measure(model, state, tables).values()
        (higher,) = gauge.measure(model, lifted, tables).values()
        np.testing.assert_allclose(at_rest, 0.0, atol=0.002)
        # gauges of volumes and wires measure the amount of water, which has not changed
        np.testing.assert_allclose(higher - at_rest, expected, atol=2e-4)


def test_force_on_a_body_is_the_negated_sum_of_the_water_s(advanced):
    """Both sums have the same pairs and differ by the rounding of some ten thousand terms."""
    model, _, state = advanced("floating", FLOATING, 20)
    scheme = model.scheme
    state, tables = prepare_(model, state)
    ghosts = scheme.place_ghosts(model, state, tables)
    body = model.bodies[0]
    rows = slice(*body.rows)
    p_ghosts = jnp.zeros_like(ghosts.p).at[rows].set(1000.0)
    grip = body_grip(scheme, body, state.parts["body"], ghosts, tables)
    on_body = grip.force(state.particles.p, p_ghosts[rows])
    # the sum for the water, without all other ghosts
    alone = ghosts._replace(V=jnp.zeros_like(ghosts.V).at[rows].set(ghosts.V[rows]))
    sources = scheme._sources(alone, jnp.zeros_like(ghosts.x))
    sources = sources.adding("p", state.particles.p, p_ghosts)
    with_body = scheme._sum(laws.pressure_force, sources, tables)
    sources.ghosts["V"] = jnp.zeros_like(sources.ghosts["V"])
    without = scheme._sum(laws.pressure_force, sources, tables)
    V = scheme.volume(state.particles)
    on_water = [float(jnp.sum(V * (a - b))) for a, b in zip(with_body, without, strict=True)]
    size = float(jnp.sum(V * jnp.abs(with_body[1] - without[1])))
    np.testing.assert_allclose(on_body[:2], -np.asarray(on_water), atol=1e-4 * size)
    assert abs(on_water[1]) > 0.01 * size


def test_projection_takes_the_divergence_out():
    """The divergence of a made-up field: each step halves it, so that three steps leave an eighth.

    In addition, crowded particles, which the field has driven together, need a divergence to spread.
    """
    model, state = js.build(js.Case.from_dict(TANK | {"dx": 0.025}))
    x = state.particles.x
    state = eqx.tree_at(
        lambda s: s.particles.u, state, 0.1 * jnp.sin(2 * jnp.pi * x) * jnp.cos(2 * jnp.pi * x)
    )
    state, tables = prepare_(model, state)
    deep = np.asarray(state.particles.x[:, 1]) < 0.4
    before = np.asarray(divergence_(model, state, tables))[deep]
    for _ in range(3):
        state = step_(model, state, tables)
    after = np.asarray(divergence_(model, state, tables))[deep]
    assert np.sqrt(np.mean(after**2)) < 0.2 * np.sqrt(np.mean(before**2))


@pytest.mark.parametrize("share", [pytest.param(1.0, marks=pytest.mark.slow), 0.5])
def test_crowded_water_spreads_as_fast_with_any_step(advanced, share):
    """With 2 % too much mass, one step leaves the divergence that spreads the water, whatever dt.

    The surface above and a tolerance of 0.3 % change the mean divergence of the water well below the surface.
    """
    model, state, _ = advanced("mirror", TANK | {"tank": TANK["tank"] | {"walls": "mirror"}}, 20)
    state = eqx.tree_at(lambda s: s.particles.m, state, 1.02 * state.particles.m)
    model = eqx.tree_at(lambda m: m.dt, model, share * model.dt)
    state, tables = prepare_(model, state)
    after = step_(model, state, tables)
    deep = np.asarray(state.particles.x[:, 1]) < 0.25
    found = np.asarray(divergence_(model, after, tables))[deep].mean()
    rate = RELAXATION * np.sqrt(9.81 / float(model.scheme.smoothing.h))
    np.testing.assert_allclose(found, 0.02 * rate, rtol=0.15)


def _undoing(scheme, filled, edge, dt):
    """Rate (1/s) for a particle with this kernel sum and this slope of the sum, under gravity."""
    frequency = jnp.sqrt(9.81 / scheme.smoothing.h)
    filled, edge = jnp.asarray([filled]), jnp.asarray([edge])
    rate, _ = undoing(filled, edge, scheme.lattice, scheme.relaxation, frequency, dt)
    return float(rate[0])


@pytest.mark.parametrize("kernel", ["polynomial", "semicircle", "gaussian", "wendland"])
def test_second_row_is_held_the_firmer_the_longer_the_step(kernel):
    """At rest the second row lacks the sum over the missing lattice above; other rows are held as usual."""
    scheme = ISPH.of(0.02, 1.0, dim=2, kernel=NAMED[2][kernel])
    usual = RELAXATION * np.sqrt(9.81 / float(scheme.smoothing.h))
    first, second = map(float, scheme.lattice.edges)

    def rate(edge, dt):
        fill = 1.0 - float(scheme.lattice.lacks) * (edge == second)
        return (_undoing(scheme, fill + 0.01, edge, dt) - _undoing(scheme, fill, edge, dt)) / 0.01

    np.testing.assert_allclose(rate(second, 1e-4), usual, rtol=1e-3)
    assert rate(second, 0.004) > 1.2 * usual
    np.testing.assert_allclose(rate(second, 0.005) / rate(second, 0.004), 5.0 / 4.0, rtol=1e-3)
    for edge in (0.0, 0.25 * second, first):
        np.testing.assert_allclose(rate(edge, 0.005), usual, rtol=1e-3)
    for dt in (0.005, 0.01):  # a step never corrects more than the whole error
        assert rate(second, dt) * dt < 1.0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["polynomial", "semicircle", "gaussian", "wendland"])
def test_rows_under_a_surface_are_told_by_the_slope_of_the_kernels_sum(kernel, dim):
    """The slope of the second row differs clearly from those of the first and the third row."""
    scheme = ISPH.of(0.02, 1.0, dim=dim, kernel=NAMED[dim][kernel])
    reach = np.arange(-6.0, 7.0)
    axes = np.meshgrid(*(reach,) * dim)
    r2, h = jnp.asarray(sum(a**2 for a in axes)), float(scheme.smoothing.h) / 0.02
    slope = np.asarray(NAMED[dim][kernel].slope(r2, h, dim)) * axes[-1]
    slope = slope * np.asarray(r2 < (NAMED[dim][kernel].reach * h) ** 2)
    first, second, third = (slope[axes[-1] < row + 0.5].sum() for row in range(3))
    np.testing.assert_allclose(scheme.lattice.edges, (first, second), rtol=1e-4)
    assert -1e-6 <= third < 0.25 * second < 0.125 * first


@pytest.mark.parametrize("dim", [2, 3])
def test_second_row_is_not_crowded_at_rest(dim):
    """With the default kernels it rests at its lattice position; without relaxation nothing holds it."""
    scheme = ISPH.of(0.02, 1.0, dim=dim)
    fill, second = 1.0 - float(scheme.lattice.lacks), float(scheme.lattice.edges[1])
    assert 0.005 < scheme.lattice.lacks < 0.02
    firm = (_undoing(scheme, fill + 0.01, second, 0.005) - _undoing(scheme, fill, second, 0.005)) / 0.01
    assert abs(_undoing(scheme, fill, second, 0.005)) < 1e-3 * firm
    free = ISPH.of(0.02, 1.0, dim=dim, relaxation=0.0)
    assert _undoing(free, fill + 0.01, second, 0.005) == 0.0


def test_explicit_sweeps_end_where_the_krylov_solution_is(advanced):
    """Jacobi's sweeps slowly reach the same pressure: 400 of them reduce the error to a tenth."""
    model, state, _ = advanced("mirror", TANK | {"tank": TANK["tank"] | {"walls": "mirror"}}, 20)
    state, tables = prepare_(model, state)

    def pressure(solver):
        scheme = dataclasses.replace(model.scheme, solver=solver)
        other = dataclasses.replace(model, scheme=scheme)
        return np.asarray(step_(other, state, tables).particles.p)

    exact = pressure(BiCGStab(1e-5))
    far = np.abs(pressure(Explicit(1)) - exact).max()
    near = np.abs(pressure(Explicit(400)) - exact).max()
    assert near < 0.1 * far
    assert near < 0.01 * exact.max()


@pytest.fixture(scope="module")
def flap_step():
    """Function from the PTO's damping to the flap's velocity (times 1000) and moment after one step."""
    case = TANK | {"dx": 0.06, "tank": {"length": 1.2, "depth": 0.48}, "body": FLAP}
    model, state = js.build(js.Case.from_dict(case))
    state, tables = jax.jit(lambda s: model.scheme.prepare(model, s))(state)

    def after(damping):
        other = eqx.tree_at(lambda m: m.links[0].law.laws[0].linear, model, damping)
        body = other.step(state, tables).parts["body"]
        return jnp.stack([1e3 * body.velocity[2], body.force[2]])

    return after


def test_slopes_of_a_step_are_linear_and_those_of_differences(flap_step):
    """At the default tolerance: tangents are solved to 0.3 % of their own right-hand side.

    With the tolerance relative to the right-hand side of the pressure, they would be exactly zero.
    """
    at = jnp.float32(10.0)
    push = jax.jit(lambda v: jax.jvp(flap_step, (at,), (v,))[1])
    one, two = push(jnp.float32(1.0)), push(jnp.float32(2.0))
    # factors of two are exact in every iteration
    np.testing.assert_array_equal(two, 2.0 * one)
    backward = jax.jit(jax.jacrev(flap_step))(at)
    np.testing.assert_allclose(backward, one, rtol=0.05)
    value = jax.jit(flap_step)
    # Values are accurate to 0.3 % of the pressure's right-hand side: a wide step, and 10 % for the moment.
    differences = (value(at + 5.0) - value(at - 5.0)) / 10.0
    np.testing.assert_allclose(one[0], differences[0], rtol=0.03)
    np.testing.assert_allclose(one[1], differences[1], rtol=0.1)


def test_a_solution_that_does_not_converge_is_a_failure(advanced):
    """Its residual is stored; the driver makes the message."""
    model, state, _ = advanced("mirror", TANK | {"tank": TANK["tank"] | {"walls": "mirror"}}, 20)
    state, tables = prepare_(model, state)
    scheme = dataclasses.replace(model.scheme, solver=BiCGStab(1e-5, iterations=2))
    after = step_(dataclasses.replace(model, scheme=scheme), state, tables)
    assert Failure(int(after.status.bits)) & Failure.NOT_CONVERGED
    assert 1e-5 < float(after.status.residual) < 1.0


def test_solver_begins_afresh_where_it_comes_no_nearer():
    """A chain of 400 rows needs many cycles of iterations, but fewer than the default maximum.

    The residual returned is that of the solution.
    """
    n = 400

    def operator(unknown):
        p = unknown[0]
        up, down = jnp.append(p[1:], 0.0), jnp.append(0.0, p[:-1])
        return p - 0.5 * up - 0.5 * down, ()

    b = jnp.asarray(np.random.default_rng(3).normal(size=n), jnp.float32)
    solver = BiCGStab(3e-3)
    (p, _), residual, converged = jax.jit(lambda b: solver.solve(operator, (b, ()), (0.0 * b, ())))(b)
    left = float(jnp.linalg.norm(b - operator((p, ()))[0]) / jnp.linalg.norm(b))
    assert bool(converged) and float(residual) <= 3.003e-3
    # pressures are up to n^2 times the right-hand side, which limits the accuracy of float32
    assert left < 2 * 3e-3
    once = BiCGStab(3e-3, iterations=50)
    assert not bool(once.solve(operator, (b, ()), (0.0 * b, ()))[2])


@pytest.mark.parametrize(("b", "solvable"), [((1.0, 0.0, 1.0), True), ((1.0, 0.0, 0.0), False)])
def test_solver_survives_a_product_that_vanishes(b, solvable):
    """One right-hand side leads to a division by zero in the second iteration, the other one in the first."""
    turned = jnp.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    A = jnp.array([[1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]]) if solvable else turned

    def operator(unknown):
        return A @ unknown[0], ()

    b = jnp.array(b)
    (p, _), residual, converged = BiCGStab(1e-5).solve(operator, (b, ()), (jnp.zeros(3), ()))
    left = float(jnp.linalg.norm(b - A @ p) / jnp.linalg.norm(b))
    assert bool(converged) == solvable
    np.testing.assert_allclose(float(residual), left, atol=1e-6)
    assert left <= 1e-5 if solvable else left == 1.0


def test_limiters_are_counted(advanced):
    """With 30 % too much mass, every deep particle exceeds the 20 % of crowding that one step corrects.

    Still water has no tension.
    """
    model, state, end = advanced("mirror", TANK | {"tank": TANK["tank"] | {"walls": "mirror"}}, 20)
    assert float(end.limits["tension"].total) < 0.01 * state.particles.m.size * int(end.step)
    heavy = eqx.tree_at(lambda s: s.particles.m, state, 1.3 * state.particles.m)
    heavy, tables = prepare_(model, heavy)
    after = step_(model, heavy, tables)
    deep = int(np.sum(np.asarray(state.particles.x[:, 1]) < 0.3))
    assert float(after.limits["crowding"].recent) >= 0.8 * deep


@pytest.mark.slow
def test_slope_of_the_absorbed_energy_is_that_of_differences():
    """Slope with respect to the PTO's damping of a moving flap, over 0.07 s in float64; the bar is 1e-4."""
    case = TANK | {
        "dx": 0.03,
        "precision": "float64",
        "tank": {"length": 1.2, "depth": 0.45},
        "scheme": {"kind": "incompressible", "tolerance": 1e-11},
        "body": FLAP,
    }
    with enable_x64():
        model, state = js.build(js.Case.from_dict(case))
        n_steps = 14 // model.search.rebuild_every * model.search.rebuild_every

        @jax.jit
        def absorbed(damping):
            wider = eqx.tree_at(lambda m: m.links[0].law.laws[0].linear, model, damping)
            end = js.simulate(wider, state, n_steps=n_steps, sample_every=n_steps)[0]
            return end.ledger["pto"].total, end.status.bits

        at, by = jnp.float64(10.0), 1e-3
        (value, bits), (slope, _) = jax.jvp(absorbed, (at,), (jnp.ones_like(at),))
        differences = (absorbed(at + by)[0] - absorbed(at - by)[0]) / (2 * by)
    assert int(bits) == 0 and float(value) > 0.0
    assert float(slope) == pytest.approx(float(differences), rel=1e-4)


@pytest.mark.parametrize(
    "change, message",
    [
        (
            {"scheme": {"kind": "incompressible", "alpha": 0.1}},
            'scheme.alpha belongs to scheme.kind = "weakly',
        ),
        (
            {"body": FLOATING["body"] | {"release": 1.0, "velocity": [0.0, 0.1, 0.0]}},
            "until release = 1 s the body is at rest; remove velocity",
        ),
        ({"body": FLOATING["body"] | {"disc": {"centre": [0.5, 0.5], "radius": 0.1}}}, "exactly one"),
        ({"body": FLOATING["body"] | {"density": None}}, "density"),
        ({"body": {"block": {"low": [0.8, 0.3], "high": [1.2, 0.5]}}}, "outside the tank"),
        ({"body": FLOATING["body"] | {"pto": {"damping": 1.0}}}, "pitch"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    case = {k: v for k, v in (TANK | change).items() if v is not None}
    with pytest.raises(js.CaseError, match=message):
        js.Case.from_dict(case)


# The bar is 0.1 mm of level, at a spacing of 40 mm. With the surface taken g dt^2/2 too low, a tank rose by
# 0.3 mm (3-D: 1 mm). With surface rows that start on the lattice it sinks by 0.05 mm (3-D: rises by 0.25 mm).
@pytest.mark.parametrize(
    "width", [{}, pytest.param({"width": 0.16}, marks=pytest.mark.slow)], ids=["2-D", "3-D"]
)
def test_still_water_stays_at_its_level_from_the_first_step_on(width):
    """A tank at rest keeps its mean level and takes no energy from the projection."""
    tank = {"length": 0.4, "depth": 0.48, "height": 0.8}
    case = js.Case.from_dict(TANK | {"dx": 0.04, "tank": tank | width, "output": {"sample_dt": 0.05}})
    run = js.run(case, t1=0.3, progress=False)
    weight = 1000.0 * 9.81 * 0.48 * 0.4 * width.get("width", 1.0)
    assert np.max(np.abs(run["potential"])) / weight < 1e-4
    assert abs(np.sum(run["power_projection"]) * 0.05) / weight < 1e-4


@pytest.mark.slow
def test_results_have_the_budget_of_the_whole_run_beside_that_of_settled_periods():
    """The results of a run with waves contain its whole energy, whatever part of the run has settled."""
    waves = {"H": 0.08, "T": 1.0}
    case = js.Case.from_dict(TANK | {"tank": {"length": 2.0, "depth": 0.5}, "waves": waves})
    run = js.run(case, t1=0.2, progress=False)
    budget = analysis.energy_budget(run.series)
    whole = {name: value for name, value in run.results.items() if name.startswith("whole_energy_")}
    assert whole == {f"whole_energy_{name}": value for name, value in budget.items()}
    assert set(whole) | {name.removeprefix("whole_") for name in whole} <= set(LABELS)


@pytest.mark.slow
@pytest.mark.parametrize(("kernel", "dim"), sorted(SURFACE_ROWS, key=str))
def test_rows_under_a_surface_start_where_they_rest(kernel, dim):
    """For every kernel of the table, after 2 s: the mean height of a row moves by 0.0005 spacings.

    Rows that start on the lattice would move by 0.01 to 0.02 spacings.
    """
    name = next(name for name, one in NAMED[dim].items() if type(one) is kernel)
    tank = {"length": 0.96, "depth": 0.48} | ({"width": 0.4} if dim == 3 else {})
    scheme = {"kind": "incompressible", "kernel": name}
    case = js.Case.from_dict({"name": "rows", "dx": 0.04, "t1": 2.0, "scheme": scheme, "tank": tank})
    begun, ended = (
        np.asarray(p.x)[np.argsort(np.asarray(p.id)), -1] / case.dx
        for p in (js.build(case)[1].particles, js.run(case, progress=False).state.particles)
    )
    row = np.round(tank["depth"] / case.dx - begun - 0.5)
    moved = [np.mean((ended - begun)[row == k]) for k in range(6)]
    np.testing.assert_allclose(moved, 0.0, atol=0.0015)
