"""Parts that compose: the ledger, chambers in both schemes, names, and what a step keeps of each part."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import coarse
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph import analysis
from jaxsph.model.meaning import Exchange
from jaxsph.model.state import Tally
from jaxsph.probes.gauges import WaveGauge
from jaxsph.probes.joined import described, measured
from jaxsph.probes.parts import PartProbe
from jaxsph.schemes.integrators import PredictorCorrector
from jaxsph.schemes.step import at_rest, move_walls


def add_all(tally, amounts):
    """The tally after the steps of one sample were added one after the other and settled."""
    return jax.lax.scan(lambda t, a: (t.add(a), None), tally, amounts)[0].settle()


@jax.jit
def run_tally(samples):
    """Tally of a run of samples."""
    start = Tally.zero(jnp.float32)
    return jax.lax.scan(lambda tally, row: (add_all(tally, row), None), start, samples)[0]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), offset=st.floats(-1.0, 1.0, width=32))
def test_a_tally_loses_nothing_over_a_long_run(seed, offset):
    """Twenty thousand steps in samples of ten; a plain float32 sum would have a thousand times the error."""
    amounts = np.float32(np.random.default_rng(seed).normal(offset, 1.0, (2000, 10)))
    exact = float(np.sum(np.float64(amounts)))
    found = run_tally(jnp.asarray(amounts))
    # ten additions in a sample round to 2^-24 of at most some tens; the total rounds to 2^-24 of its size
    assert float(found.total) == pytest.approx(exact, abs=2000**0.5 * 10 * 2e-6 + 2e-7 * abs(exact))


@pytest.fixture(scope="module")
def damped_vessel():
    """(case, model, state): the communicating vessels with a turbine, released with sinking water."""
    case = coarse("vessel", {"pto.K_dm": 300.0})
    model, state = js.build(case)
    right = state.particles.x[:, 0] > model.chambers[0].sides.x0[0]
    sinking = jnp.stack([jnp.zeros_like(right, float), jnp.where(right, -0.2, 0.0)], -1)
    return case, model, eqx.tree_at(lambda s: s.particles.u, state, jnp.float32(sinking))


@pytest.mark.slow
def test_work_is_that_of_all_steps_whatever_the_samples(damped_vessel):
    """The work must not be that of the last block only."""
    _, model, state = damped_vessel
    every = model.search.rebuild_every
    march = jax.jit(
        lambda s, sample_every: js.simulate(model, s, n_steps=4 * every, sample_every=sample_every)[0],
        static_argnames="sample_every",
    )
    often, once = march(state, every), march(state, 4 * every)
    first = march(march(state, every), every)
    assert float(often.ledger["pto"].total) > 0.0
    # the same additions, except for the place where a sample settles them
    assert float(often.ledger["pto"].total) == pytest.approx(float(once.ledger["pto"].total), rel=1e-6)
    assert float(first.ledger["pto"].total) > float(often.ledger["pto"].total)
    # corners of the surface have too little water for a corrected gradient; the water below has enough
    steps = once.particles.m.size * int(once.step)
    assert 0.0 <= float(once.limits["gradient"].total) < 0.1 * steps
    p = [0.5 * float(jnp.sum(s.particles.m * jnp.sum(s.particles.u**2, axis=1))) for s in (state, once)]
    assert p[1] < p[0]


def test_air_of_the_predictor_corrector_is_of_one_time(damped_vessel):
    """Force and flow use the positions for which the rates are taken, wherever the step began."""
    _, model, state = damped_vessel
    state, tables = jax.jit(lambda s: model.scheme.prepare(model, s))(state)
    scheme, chamber = model.scheme, model.chambers[0]
    lifted = state.particles.x.at[:, 1].add(0.02)
    at = eqx.tree_at(lambda s: s.particles.x, state, lifted)

    @jax.jit
    def flows():
        ghosts = scheme.ghosts(model, at, tables, at_rest(model, at))
        sources = scheme.sources(ghosts, ghosts.u)
        air = chamber.coupling(scheme, at.particles, sources, tables, at.parts)
        end = PredictorCorrector._advance(scheme, model, state, at, tables, model.dt)
        i = jnp.minimum(air.index, len(lifted) - 1)
        expected = -sum(jnp.sum(f * end.particles.u[i, k]) for k, f in enumerate(air.force))
        return end.parts["chamber"].q, expected

    q, expected = flows()
    # The water at the end of the step, with the grip of `at`: the same sum, to rounding.
    assert float(q) == pytest.approx(float(expected), rel=1e-5)


INCOMPRESSIBLE = {"scheme": {"kind": "incompressible"}}


@pytest.mark.slow  # the books of a chamber in this scheme are kept in test_air too
@pytest.mark.parametrize(("K_dm", "least"), [(300.0, 0.0), (1.0e6, 1e-5)])
def test_a_chamber_works_in_the_incompressible_scheme(K_dm, least):
    """The energy taken is P_a q and never negative; a closed chamber passes almost no flow."""
    case = coarse("owc", INCOMPRESSIBLE | {"tank.length": 1.2, "probes": {"gauges": [0.5]}, "pto.K_dm": K_dm})
    case = case.replace({"waves.ramp_periods": 0.5})
    model, state = js.build(case)
    sample = case.output.sample_dt
    found = js.march(model, state, 1.2, sample, js.make_probes(case, model, state))
    taken, flow, P_a = found["power_pto"], found["flow"], found["P_a"]
    assert int(found.state.status.bits) == 0 and np.all(np.isfinite(P_a))
    assert taken.sum() > 0.0
    budget = analysis.energy_budget(found.series)
    # every term is summed over the steps except the viscous loss, which is 0.2 %; float32 rounds the rest
    assert abs(budget["residual_share"]) < 5e-3
    # The reading of power is a mean over a sample, P_a q a value at its end; both vary within the sample. In
    # a closed chamber the flow is as small as its change by the particles' motion in a step: `least`, m2/s.
    rest = least * float(np.sum(np.abs(P_a)))
    assert taken.sum() == pytest.approx(float(np.sum(P_a * flow)), rel=0.15, abs=rest)


def test_parts_have_names_of_their_own(damped_vessel):
    _, model, state = damped_vessel
    walls = model.walls
    x = np.asarray(state.particles.x)
    given = dict(scheme=model.scheme, walls=walls, dx=0.04, sample_dt=0.01)
    with pytest.raises(ValueError, match=r"parts have the same name \(chamber\)"):
        js.assemble(x, 0 * x, **given, chambers=[model.chambers[0]] * 2)
    wanted = js.Box((0.0, 0.0), (0.8, 0.8), paddle=True, stroke=0.1)
    walls = js.Ghosts.build(wanted, 0.04, model.scheme.smoothing, js.FreeSlip())
    with pytest.raises(ValueError, match="give a paddle"):
        js.assemble(x[:4], 0 * x[:4], **(given | {"walls": walls}))


def test_every_energy_of_the_ledger_is_described(damped_vessel):
    _, model, state = damped_vessel
    entries = model.entries()
    assert set(entries) == set(state.ledger) == {"pto", "hyperviscosity", "separation"}
    assert entries["pto"].exchange is Exchange.HARVESTED
    interval = move_walls(model.scheme, model, state, model.dt)
    assert set(interval.after) == set(state.parts) == {"chamber"}


def test_readings_that_share_a_name_are_refused(hydrostatic):
    """Both when probes are measured and when they are described; otherwise the later reading would win."""
    _, model, state = hydrostatic
    probes = (WaveGauge(jnp.array([0.3]), jnp.array([0.0])), WaveGauge(jnp.array([0.6]), jnp.array([0.0])))
    for join in (lambda: described(probes), lambda: measured(probes, model, state, None)):
        with pytest.raises(
            ValueError, match="'eta' of WaveGauge has the same name as a reading of WaveGauge"
        ):
            join()
    assert set(described(probes[:1])) == {"time", "eta"}


def test_a_probe_describes_exactly_its_readings(hydrostatic):
    """Before anything is compiled; a reading without a unit could not be recorded."""
    _, model, state = hydrostatic

    class Forgetful(WaveGauge):
        def measure(self, model, state, tables):
            return {"a": state.step, "b": state.step}

    with pytest.raises(
        ValueError, match=r"Forgetful.measure returns the readings \['a', 'b'\], and describe"
    ):
        measured((Forgetful(jnp.array([0.3]), jnp.array([0.0])),), model, state, None)


def _take_off(name, body):
    law = js.Damper(jnp.float32(1.0), jnp.float32(0.0))
    return js.Link(js.AlongJoint(body, 2, "rad"), law, harvests=True, name=name)


def test_a_chamber_and_a_body_have_readings_of_their_own():
    """A body without a power take-off has no power, and does not take over the chamber's."""
    chamber = js.Chamber.of(
        js.PneumaticPTO(jnp.float32(100.0)), between=(1.0, 1.2), tip=0.2, level=0.4, dx=0.04
    )
    block = js.Block((0.4, 0.28), (0.64, 0.52))
    bodies = [js.RigidBody.of(block, (0, 1), ("heave",), density=500.0)]
    bodies.append(js.RigidBody.of(block, (0, 1), ("pitch",), density=500.0, name="2"))
    probes = [
        PartProbe.of(part, jnp.float32(0.01), 2) for part in (chamber, *bodies, _take_off("pto_2", "2"))
    ]
    powers = [name for name in described(probes) if name.startswith("power_")]
    assert powers == ["power_pto", "power_pto_2"]


@pytest.mark.parametrize(
    ("dim", "force", "flow"), [(2, "N m-1, N m-1, N", "m2 s-1"), (3, "N, N, N, N m, N m, N m", "m3 s-1")]
)
def test_amounts_of_two_dimensions_are_per_metre_of_width(dim, force, flow):
    """No quantity of a device has the unit of the other number of dimensions."""
    block = js.Block((0.4, 0.28), (0.64, 0.52))
    body = js.RigidBody.of(block, (0, 1), ("pitch",), density=500.0, name="b")
    link = _take_off("pto_b", "b")
    pto = js.PneumaticPTO(jnp.float32(100.0))
    chamber = js.Chamber.of(pto, between=(1.0, 1.2), tip=0.2, level=0.4, dx=0.04)
    found = described([PartProbe.of(part, jnp.float32(0.01), dim) for part in (body, link, chamber)])
    assert found["body_force_b"].units == found["body_force_mean_b"].units == force
    assert found["flow"].units == found["flow_mean"].units == flow
    assert found["chamber_volume"].units == ("m2" if dim == 2 else "m3")
    assert found["power_pto"].units == found["power_pto_b"].units == ("W m-1" if dim == 2 else "W")
