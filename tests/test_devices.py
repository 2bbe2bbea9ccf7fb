"""The chamber and its PTO: closed form of the law, signs, derivatives, and the energy that the PTO takes."""

import dataclasses
import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse, enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.core.arrays import columns
from jaxsph.core.slabs import Neighbours, Sources
from jaxsph.model.interfaces import AbstractGrip
from jaxsph.model.state import Particles, Tables
from jaxsph.parts.chamber import Chamber
from jaxsph.parts.pto import PhasedPTO, PneumaticPTO, PrescribedPressure
from jaxsph.parts.sides import Sides
from jaxsph.schemes.step import at_rest

FLOWS = st.floats(-2.0, 2.0)
DAMPINGS = st.floats(0.0, 1.0e6)
# dt sum |f|^2/m, with dt from 1e-5 to 1e-3 s, about 0.1 m2 and about 10 kg/m
COMPLIANCES = st.floats(1e-9, 1e-4)

pressure = jax.jit(lambda K_dm, q, compliance: PneumaticPTO(K_dm).pressure(q, compliance, 0.0))
phased = jax.jit(
    lambda phase, q, t: PhasedPTO(jnp.asarray(500.0), phase, jnp.asarray(2 * np.pi / 1.2)).pressure(
        q, 1e-6, t
    )
)
pressure_slopes = jax.jit(jax.grad(lambda *a: PneumaticPTO(a[0]).pressure(a[1], a[2], 0.0), argnums=(0, 1)))


# --- the law


@settings(max_examples=200, deadline=None)
@given(q=FLOWS, K_dm=DAMPINGS, compliance=COMPLIANCES)
def test_the_turbine_never_drives_the_water(q, K_dm, compliance):
    P_a = float(pressure(K_dm, q, compliance))
    assert np.isfinite(P_a) and P_a * q >= 0.0
    # Nor does it reverse the flow; float32 rounds the product compliance P_a, of ten factors, to 1e-6 of q.
    assert (q - compliance * P_a) * q >= -2e-6 * q * q


@settings(max_examples=200, deadline=None)
@given(q=FLOWS, K_dm=st.floats(1.0, 1.0e6), compliance=COMPLIANCES)
def test_closed_form_solves_the_law_with_the_water_s_response(q, K_dm, compliance):
    """P_a = K_dm^2 |q| q with q = q_free - compliance P_a, written as a sum without cancellation."""
    with enable_x64():
        P_a = float(pressure(K_dm, q, compliance))
    through = np.sign(P_a) * np.sqrt(abs(P_a)) / K_dm
    # Round-off of 1e-16, and the 1e-12 m2/s that keep the root's derivative finite.
    assert through + compliance * P_a == pytest.approx(q, rel=1e-11, abs=2e-12)


def test_open_and_closed_chamber():
    q, compliance = 0.05, 1e-6
    assert float(pressure(0.0, q, compliance)) == 0.0
    left = q - compliance * float(pressure(1.0e6, q, compliance))
    # P_a -> q/compliance = 5e4 Pa, at which K_dm = 1e6 lets sqrt(5e4)/1e6 = 2e-4 m2/s through.
    assert 0.0 <= left < 0.01 * q


@pytest.mark.parametrize("K_dm", [0.5, 300.0, 2218.0])
@pytest.mark.parametrize("q", [-0.08, 0.0, 1e-3, 0.08])
def test_derivatives_are_finite_differences(K_dm, q):
    with enable_x64():
        compliance = 2e-6
        dK, dq = (float(a) for a in pressure_slopes(K_dm, q, compliance))
        h = 1e-5
        by_K = (pressure(K_dm * (1 + h), q, compliance) - pressure(K_dm * (1 - h), q, compliance)) / (
            2 * h * K_dm
        )
        # Truncation h^2 = 1e-10, cancellation 1e-16/h = 1e-11; both zero at q = 0.
        assert dK == pytest.approx(float(by_K), rel=1e-8, abs=1e-14)
        step = 1e-7
        by_q = (pressure(K_dm, q + step, compliance) - pressure(K_dm, q - step, compliance)) / (2 * step)
        # The slope 2 K_dm^2 |q| has a kink at q = 0, where the difference itself is of order K_dm^2 step.
        assert dq == pytest.approx(float(by_q), rel=1e-5, abs=2 * K_dm**2 * step)


@settings(max_examples=50, deadline=None)
@given(t=st.floats(0.0, 10.0), q=FLOWS, phase=st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4))
def test_a_phased_damping_is_the_turbine_of_its_moment(t, q, phase):
    """The logarithm of the damping is the Fourier series written out here; it never drives the water."""
    T, K_dm = 1.2, 500.0
    a1, b1, a2, b2 = phase
    angle = 2 * np.pi * t / T
    here = K_dm * np.exp(
        a1 * np.cos(angle) + b1 * np.sin(angle) + a2 * np.cos(2 * angle) + b2 * np.sin(2 * angle)
    )
    with enable_x64():
        P_a = float(phased(jnp.asarray(phase), q, t))
        assert P_a * q >= 0.0
        assert P_a == pytest.approx(float(pressure(here, q, 1e-6)), rel=1e-9)


def test_a_phased_damping_comes_from_its_case():
    case = coarse("owc").replace({"pto.phase": [0.1, -0.2]})
    pto = js.build(case)[0].chambers[0].pto
    assert isinstance(pto, PhasedPTO) and float(pto.omega) == pytest.approx(2 * np.pi / case.waves.T)
    assert float(pto.damping(0.0)) == pytest.approx(case.pto.K_dm * np.exp(0.1))
    assert js.Case.from_dict(tomllib.loads(case.to_toml())) == case
    with pytest.raises(js.CaseError, match="phase = .* a cosine and a sine for every harmonic"):
        case.replace({"pto.phase": [0.1, 0.2, 0.3]})
    with pytest.raises(js.CaseError, match="pto.phase varies the damping"):
        js.linear_owc(case)


def test_prescribed_pressure_ramps():
    def at(ramp, t):
        return float(PrescribedPressure(jnp.float32(1000.0), jnp.float32(ramp)).pressure(0.0, 1.0, t))

    assert [at(2.0, t) for t in (0.0, 1.0, 2.0, 9.0)] == [0.0, 500.0, 1000.0, 1000.0]
    assert at(0.0, 1e-3) == 1000.0  # at once


# --- the coupling


class _Given(AbstractGrip):
    """A grip with given forces."""

    forces: tuple

    def force(self, chamber, x, V, around):
        return self.forces

    def water_pressure(self, weight):
        return jnp.zeros_like(weight)


class _NoPairs:
    smoothing = None

    def __init__(self, forces):
        self.grip = _Given(forces)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), K_dm=st.floats(1.0, 1e4), dt=st.floats(1e-5, 1e-2))
def test_the_air_takes_its_own_work_of_kinetic_energy(seed, K_dm, dt):
    rng = np.random.default_rng(seed)
    with enable_x64():
        n, c = 12, 8
        u, m = jnp.asarray(rng.normal(size=(n, 2))), jnp.asarray(rng.uniform(0.1, 2.0, n))
        index = jnp.asarray(rng.permutation(n)[:c], jnp.int32).at[0].set(n)  # n: an unused entry
        grip = jnp.asarray(rng.normal(size=(2, c)) * 0.01).at[:, 0].set(0.0)
        chamber = Chamber(
            pto=PneumaticPTO(jnp.asarray(K_dm)),
            sides=Sides.of(0.0, 1.0, 0.0, 0.5, 2.0, float),
            **{name: jnp.asarray(z) for name, z in (("fade_low", 0.0), ("fade_high", 1.0), ("still", 1.0))},
            beyond=jnp.asarray(0.0),
        )
        zero = jnp.zeros(n)
        water = Particles(jnp.zeros((n, 2)), jnp.zeros((n, 2)), u, zero, m, jnp.arange(n), zero, zero)
        tables = Tables(Neighbours.of(jnp.zeros((1, n), int)), None, None, {}, {"chamber": index}, None)
        sources = Sources({"x": (zero, zero), "V": zero}, {})
        start = chamber.start(float)
        coupling = chamber.coupling(_NoPairs(tuple(grip)), water, sources, tables, {})
        law = chamber.press(start, coupling.flow(u, {}), dt * coupling.mobility(), 0.0, 0.0, dt)
        new = coupling.push(u, dt * law.P_a)
        air, works, _ = chamber.finish(start, law, coupling.flow(u, {}), coupling.flow(new, {}), dt)
        work = sum(works.values())
        taken = float(0.5 * jnp.sum(m * jnp.sum(u**2 - new**2, axis=1)))
        # An identity, up to the round-off of the energies that are subtracted.
        energy = float(0.5 * jnp.sum(m * jnp.sum(u**2, axis=1)))
        assert taken == pytest.approx(float(work), rel=1e-12, abs=1e-14 * energy)
        # The flow is that of the new velocities, with the same grip.
        flow = -sum(float(jnp.sum(g * new[index, k])) for k, g in enumerate(grip))
        assert flow == pytest.approx(float(air.q), rel=1e-10, abs=1e-13)
        # a guard keeps the law's root smooth at zero flow: the flow counts as up to 1e-12 m2/s larger
        guard = 1e-12 * K_dm**2 * abs(flow)
        assert float(law.P_a) == pytest.approx(K_dm**2 * abs(flow) * flow, rel=1e-9, abs=1e-12 + guard)


def test_flow_is_the_rise_times_the_chamber_s_length(vessel):
    _, model, state = vessel
    state, tables = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    p, rise = state.particles, 0.3
    ghosts = model.scheme.ghosts(model, state, tables, at_rest(model, state))
    sources, chamber = model.scheme.sources(ghosts, ghosts.u), model.chambers[0]
    air = chamber.coupling(model.scheme, p, sources, tables, state.parts)
    flow = float(air.flow(jnp.zeros_like(p.u).at[:, 1].set(rise), {}))
    # Second-order sums over a lattice of 8 particles across with a fading zone of 4 spacings.
    assert flow == pytest.approx(rise * float(model.chambers[0].surface), rel=0.05)


def test_chamber_level_and_volume_of_water_at_rest(vessel):
    _, model, state = vessel
    x = columns(state.particles.x)
    V = state.particles.m / (model.scheme.rho0 + state.particles.rho)
    # On the lattice the smoothed cut counts every row exactly; float32 sums of 40 volumes.
    assert float(model.chambers[0].level(x, V, model.dx)) == pytest.approx(0.0, abs=1e-4)
    raised = (x[0], x[1] + 0.01)
    assert float(model.chambers[0].level(raised, V, model.dx)) == pytest.approx(0.01, abs=2e-3)


# --- in the water


@pytest.fixture(scope="module")
def pushed(vessel):
    """State and series of 0.3 s with +1000 Pa on the right vessel."""
    return advance(*vessel, samples=30)


def test_compressed_air_pushes_its_own_level_down(pushed, vessel):
    state, series = pushed
    assert int(state.status.bits) == 0
    level, eta = np.asarray(series["chamber_level"]), np.asarray(series["eta"])
    # The level falls towards -0.05 m within half a period of 1.4 s; the other level, as wide, rises equally.
    assert level[-1] < -0.02 and eta[-1, 1] < -0.02 < 0.02 < eta[-1, 0]
    assert np.all(np.diff(level[2:]) < 0)
    assert np.asarray(series["flow"])[-1] < 0.0


def _energy(series):
    return np.asarray(series["kinetic"] + series["potential"] + series["compression"])


def _released(start, K_dm):
    """State and series of 0.6 s from the pushed state, with the air free to leave through the PTO."""
    case = coarse("vessel", {"pto.K_dm": K_dm})
    model, fresh = js.build(case)
    # The case expects still water, but this water moves: search twice as often.
    often = dataclasses.replace(model.search, rebuild_every=model.search.rebuild_every // 2)
    model = eqx.tree_at(lambda m: m.search, model, often)
    return advance(case, model, eqx.tree_at(lambda s: s.particles, fresh, start.particles), samples=60)


def test_the_column_loses_what_the_pto_takes(pushed):
    start, _ = pushed
    open_, damped = (_released(start, K_dm) for K_dm in (0.0, 1500.0))
    assert int(open_[0].status.bits) == int(damped[0].status.bits) == 0
    power = np.asarray(damped[1]["power_pto"])[1:]
    assert np.all(np.asarray(open_[1]["power_pto"]) == 0.0)
    work = 0.01 * power.sum()
    begin, end, undamped = _energy(damped[1])[0], _energy(damped[1])[-1], _energy(open_[1])[-1]
    # With the wrong sign the work would be negative and the column would gain energy. With eight particles
    # across, losses and noise of the scheme are some tenths of the energy, so the bounds are halves.
    assert work > 0.4 * begin
    assert end < 0.5 * begin and undamped - end > 0.5 * work
    # The air's work in a step is P_a times the mean of q before and after the step. The work can be slightly
    # negative only in a step in which q changes sign.
    assert power.min() > -1e-3 * power.max()


def test_a_closed_chamber_holds_its_level(pushed):
    start, _ = pushed
    state, after = _released(start, 1.0e6)
    assert int(state.status.bits) == 0
    level = np.asarray(after["chamber_level"])
    # An open chamber swings down by 0.02 m and back by 0.05 m in this time. Here only the compressibility of
    # the water and settling particles change the level, by a twentieth of a spacing.
    assert level[0] < -0.02 and np.ptp(level) < 0.002
