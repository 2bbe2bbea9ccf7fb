"""Fast models of a column in time: linear theory and an integrated sea as limits, curves, valves, fits."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.case.linear import chamber_geometry
from jaxsph.study.fast_column import ColumnTheory
from jaxsph.study.fast_column_motion import ColumnMotionTheory
from jaxsph.study.fast_model import FastModel, fitted, members_around
from jaxsph.waves.fast_owc import Additions
from jaxsph.waves.linear_sea import integrated_sea_response

OWC = js.load_case("owc")
VALVED = OWC.replace({"pto.relief": 60.0, "pto.suction": 60.0})
AIR = {"air": {"volume": 0.2, "pressure": 2e4}}
CURVE = {"curve": [[0.0, 0.0], [0.01, 20.0], [0.02, 90.0], [0.04, 400.0]]}
PERIODS = (1.0, 1.6)


@functools.cache
def _both(kind):
    """Compiled results of a model with a linear turbine, in the frequency domain and in time, over height,
    period and draught."""
    case = OWC.replace({"pto": {"resistance": 3000.0}})
    case = case.replace(AIR) if kind == "air" else case
    model = dataclasses.replace(FastModel.of_theory(case, PERIODS), added=Additions(0.0, 0.15))
    keys = "waves.H", "waves.T", "device.draught"
    return [
        jax.jit(lambda *x, one=one: one.results(dict(zip(keys, x, strict=True))))
        for one in (model, model.with_laws({}))
    ]


@pytest.mark.parametrize("kind", ["incompressible", "air"])
@settings(max_examples=4, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(H=st.floats(0.01, 0.06), T=st.floats(0.9, 3.0), draught=st.floats(0.14, 0.18))
def test_with_a_linear_turbine_motions_in_time_are_those_of_linear_theory(kind, H, T, draught):
    exact, found = (one(H, T, draught) for one in _both(kind))
    # the pressure of a step is that at its end
    for of in exact:
        assert float(found[of]) == pytest.approx(float(exact[of]), rel=0.015)


def test_the_power_in_a_sea_is_that_of_the_integrated_response():
    """The other solution is periodic, by iteration over its frequencies, with the same random phases."""
    model, Hs, Tp, K_dm = FastModel.of_theory(OWC, PERIODS), 0.04, 1.3, 700.0
    waves = model._incident({"Hs": jnp.asarray(Hs), "Tp": jnp.asarray(Tp)})
    phases = 2.0 * np.pi * np.random.default_rng(0).random(len(waves.omega))
    amplitude = np.asarray(waves.amplitude, float) * np.exp(1j * phases)
    omega = 2.0 * np.pi * np.arange(20, 113) / (40.0 * Tp)
    np.testing.assert_allclose(waves.omega, omega, rtol=1e-5)
    exact = integrated_sea_response(chamber_geometry(OWC), amplitude, omega, K_dm, 40.0 * Tp)
    found = model.with_laws({"pto": js.PneumaticPTO(jnp.float32(K_dm))})
    found = found.response({"waves.Hs": Hs, "waves.Tp": Tp})
    assert float(found.P_owc) == pytest.approx(exact.P_owc, rel=0.01)
    assert float(found.flow) == pytest.approx(np.sqrt(2.0) * exact.sigma_q, rel=0.01)


def test_a_curve_of_a_quadratic_turbine_is_that_turbine():
    q = np.linspace(0.0, 0.06, 200)
    curve = [[float(a), float(OWC.pto.K_dm**2 * a * a)] for a in q]
    model = FastModel.of_theory(OWC.replace({"pto": {"curve": curve}}), PERIODS)
    assert isinstance(model.theory, ColumnMotionTheory)
    assert [*model.keys] == ["device.draught", "device.chamber_length", "device.wall_thickness"]
    usual = FastModel.of_theory(OWC, PERIODS).with_laws({})
    for of, value in usual.results().items():
        assert float(model.results()[of]) == pytest.approx(float(value), rel=1e-3)


def test_a_valve_limits_the_pressure_and_gives_no_power():
    model = FastModel.of_theory(VALVED, PERIODS)
    response = jax.jit(lambda r, s: model.response({"pto.relief": r, "pto.suction": s}))
    low, skewed, closed = response(50.0, 50.0), response(50.0, 1e6), response(1e6, 1e6)
    assert float(jnp.max(jnp.abs(low.pressures))) == pytest.approx(50.0, rel=1e-5)
    assert float(jnp.max(skewed.pressures)) == pytest.approx(50.0, rel=1e-5)
    assert float(jnp.min(skewed.pressures)) < -80.0
    assert float(low.P_owc) < float(skewed.P_owc) < float(closed.P_owc)
    usual = FastModel.of_theory(OWC, PERIODS).with_laws({}).response()
    assert float(closed.P_owc) == pytest.approx(float(usual.P_owc), rel=1e-5)
    # the power of the turbine is P_a times its own flow
    through = jnp.sign(low.pressures) * jnp.sqrt(jnp.abs(low.pressures)) / OWC.pto.K_dm
    assert float(low.P_owc) == pytest.approx(float(jnp.mean(low.pressures * through)), rel=0.01)


@pytest.mark.parametrize(
    ("case", "keys", "at"),
    [
        (VALVED, ("pto.K_dm", "pto.relief"), (500.0, 70.0)),
        (OWC.replace({"pto": CURVE}), ("waves.H", "device.draught"), (0.04, 0.16)),
    ],
    ids=["valve", "curve"],
)
def test_slopes_in_time(case, keys, at):
    model = FastModel.of_theory(case, PERIODS)

    def xi(*x):
        return model.results(dict(zip(keys, x, strict=True)))["xi"]

    slopes, value = jax.jit(jax.grad(xi, (0, 1)))(*at), jax.jit(xi)
    for k, slope in enumerate(slopes):
        up, down = (value(*(v * (1.0 + s * (i == k)) for i, v in enumerate(at))) for s in (0.01, -0.01))
        assert float(slope) == pytest.approx(float((up - down) / (0.02 * at[k])), rel=0.03)


def test_turbines_of_your_own_and_their_refusals():
    def opening(gain, air, t):
        return js.PneumaticPTO(400.0 + gain * jnp.abs(air.P_a))

    model = FastModel.of_theory(OWC, PERIODS)

    def xi(gain):
        return model.with_laws({"pto": js.ControlledPTO.of(opening, gain)}).results()["xi"]

    slope, value = jax.jit(jax.value_and_grad(xi)), jax.jit(xi)
    difference = (value(2.05) - value(1.95)) / 0.1
    assert float(slope(2.0)[1]) == pytest.approx(float(difference), rel=0.02)
    turbine = js.PneumaticPTO(jnp.float32(600.0))
    with pytest.raises(js.CaseError, match="take_off: there is no such law; choose pto"):
        model.with_laws({"take_off": turbine})
    with pytest.raises(js.CaseError, match="K_dm: the turbine is a law of your own"):
        model.with_laws({"pto": turbine}).results({"pto.K_dm": 300.0})
    with pytest.raises(js.CaseError, match="phase varies the damping over the wave"):
        FastModel.of_theory(OWC.replace({"pto.phase": [0.1, 0.0]}))
    with pytest.raises(js.CaseError, match=r"platform_height = 0\.04 m makes the bed uneven"):
        FastModel.of_theory(VALVED.replace({"device.platform_height": 0.04, "device.platform_length": 0.2}))


def test_a_fit_finds_loss_and_length_of_runs_with_a_valve(tmp_path):
    true, over = Additions(1.8, 0.12), members_around(VALVED)
    assert [*over] == ["waves.H", "waves.T", "pto.K_dm"]
    over = {key: np.array(values) for key, values in over.items()}
    model = FastModel.of_theory(VALVED, (1.2, 1.6))
    exact = jax.vmap(dataclasses.replace(model, added=true).results)(
        {key: jnp.asarray(values) for key, values in over.items()}
    )
    values = {of: np.asarray(exact[name]) for name, of in model.theory.read.items()}
    runs = js.Sweep(VALVED, over, values | {"incident_height": over["waves.H"]}, {}, {})
    found = fitted(VALVED, runs)
    assert found.added == pytest.approx(true, rel=0.02)
    found.write(tmp_path / "m.json")
    read = FastModel.read(tmp_path / "m.json")
    assert isinstance(read.theory, ColumnMotionTheory)
    assert float(read.results()["xi"]) == float(found.results()["xi"])
    moved = read.moved(OWC)
    assert type(moved.theory) is ColumnTheory and moved.added == read.added
