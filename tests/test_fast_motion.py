"""Fast models of bodies in time: linear theory as a limit, exact motions with latches and stops, and fits."""

import dataclasses
import functools
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.core.chebyshev import Series
from jaxsph.study import search as searching
from jaxsph.study.fast_bodies import BodyTheory
from jaxsph.study.fast_model import FastModel, Predicted, fitted, members_around
from jaxsph.study.fast_motion import MotionTheory
from jaxsph.waves.fast_bodies import BodyAdditions, BodySeries

BUOY = js.load_case("buoy_heave").replace({"t1": 16.0})
LATCH = {"body": "body", "motion": "heave", "latch": 0.15, "latch_damping": 1e5}
LATCHED = BUOY.replace({"link.latch": LATCH})
DAMPING, HOLD = "link.take_off.damping", "link.latch.latch"
ADDED = BodyAdditions((500.0,), (0.08,))


def _model(case):
    return _made(case.to_toml())


@functools.cache
def _made(text):
    return FastModel.of_theory(js.Case.from_dict(tomllib.loads(text)), (1.0, 1.5))


def _in_time(model):
    """The same model, in which motions are found in time."""
    return model.with_laws({})


@functools.cache
def _answers(name):
    """Compiled results of a model in the frequency domain and in time, over height, period and damping."""
    case = BUOY if name == "buoy_heave" else js.load_case(name)
    key = DAMPING if name == "buoy_heave" else "body.pto.damping"
    model = FastModel.of_theory(case)
    both = [
        jax.jit(lambda H, T, c, one=one: one.results({"waves.H": H, "waves.T": T, key: c}))
        for one in (model, _in_time(model))
    ]
    return case.value("waves.T"), case.value(key), both


@pytest.mark.parametrize("name", ["buoy_heave", "flap_2d"])
@settings(max_examples=4, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(ratio=st.floats(0.65, 2.1), factor=st.floats(0.2, 3.0), H=st.floats(0.01, 0.08))
def test_with_linear_laws_motions_in_time_are_those_of_linear_theory(name, ratio, factor, H):
    T, c, (exact, found) = _answers(name)
    a, b = (one(H, T * ratio, c * factor) for one in (exact, found))
    # a damper acts with the rate at the end of each of 200 steps in a period
    for of in a:
        assert float(b[of]) == pytest.approx(float(a[of]), rel=0.015)


def test_in_a_sea_the_linear_power_is_that_of_its_spectrum():
    model, sea = _model(BUOY), {"waves.Hs": 0.04, "waves.Tp": 1.3}
    a, b = (jax.jit(one.results)(sea) for one in (model, _in_time(model)))
    for of in a:
        assert float(b[of]) == pytest.approx(float(a[of]), rel=0.01)


STILL = 40.0
"""Added mass of a water that does not radiate, kg/m."""
PUSH = 2000.0
"""Force of its waves per metre of amplitude, N/m2."""


def _without_radiation(case):
    """Model of a case in a water with constant added mass and force, for which motions are known exactly."""
    model = _model(case)
    theory, water = model.theory, model.theory.water

    def responses(omega):
        zero = np.zeros_like(omega)
        return np.stack([zero, zero + PUSH, -omega * STILL, zero], axis=1)

    series = Series.of(responses, water.series.ends)
    flat = BodySeries.restored(
        series, theory.small.section, theory.small.bodies, [0.0] * len(water.ways), 1000.0, 9.81
    )
    return dataclasses.replace(model, theory=dataclasses.replace(theory, water=flat))


def _mass_and_stiffness(model):
    water = model.theory.water
    return float(water.mass[0, 0]) + STILL, float(water.stiffness[0, 0])


def _averages(t, x, v, power, T, periods=4):
    """Amplitude of the first harmonic and mean power over the last periods."""
    last = t > t[-1] - periods * T
    turn = np.exp(2j * np.pi * t[last] / T)
    return 2.0 * abs(np.mean(x[last] * turn)), np.mean(power(x[last], v[last]))


@pytest.mark.parametrize(("T", "hold"), [(1.1, 0.1), (1.4, 0.2), (1.5, 0.28)])
def test_a_latched_body_moves_as_its_exact_solution(T, hold):
    """Between two events the exact motion is integrated with a tolerance of 1e-8."""
    model, H, c = _without_radiation(LATCHED), 0.04, 150.0
    M, K = _mass_and_stiffness(model)

    def slope(t, y):
        return [y[1], (0.5 * H * PUSH * np.cos(2.0 * np.pi * t / T) - K * y[0] - c * y[1]) / M]

    def reversal(_, y):
        return y[1]

    reversal.terminal = True
    now, y, ts, xs, vs = 0.0, [0.0, 0.0], [], [], []
    while now < 20.0 * T:
        y = [y[0], 1e-6 * slope(now, y)[1]]  # away from the reversal
        one = scipy.integrate.solve_ivp(
            slope, (now, now + 10.0 * T), y, events=reversal, rtol=1e-8, atol=1e-10, max_step=0.002
        )
        held = np.arange(one.t[-1], one.t[-1] + hold, 0.001)
        ts += [one.t, held]
        xs += [one.y[0], np.full_like(held, one.y[0, -1])]
        vs += [one.y[1], np.zeros_like(held)]
        now, y = one.t[-1] + hold, [one.y[0, -1], 0.0]
    t = np.arange(0.0, 20.0 * T, 0.001)
    x, v = (np.interp(t, np.concatenate(ts), np.concatenate(a)) for a in (xs, vs))
    size, P = _averages(t, x, v, lambda _, v: c * v**2, T)
    found = model.results({"waves.H": H, "waves.T": T, DAMPING: c, HOLD: hold})
    assert float(found["heave"]) == pytest.approx(size, rel=0.015)
    assert float(found["P_pto"]) == pytest.approx(P, rel=0.03)
    free = model.results({"waves.H": H, "waves.T": T, DAMPING: c, HOLD: 1e-4})
    assert float(found["P_pto"]) > 1.05 * float(free["P_pto"])


@pytest.mark.parametrize(
    ("link", "force", "harvest"),
    [
        ({"friction": 8.0}, lambda x, v: -8.0 * np.tanh(v / 0.01), True),
        (
            {"stops": [-0.01, 0.015], "stop_stiffness": 2e4},
            lambda x, v: -2e4 * (np.maximum(x - 0.015, 0.0) - np.maximum(-0.01 - x, 0.0)),
            False,
        ),
    ],
    ids=["friction", "stops"],
)
def test_friction_and_end_stops_act_as_in_an_exact_solution(link, force, harvest):
    model = _without_radiation(BUOY.replace({f"link.take_off.{key}": value for key, value in link.items()}))
    (M, K), H, T, c = _mass_and_stiffness(model), 0.04, 1.3, 150.0

    def slope(t, y):
        wave = 0.5 * H * PUSH * np.cos(2.0 * np.pi * t / T)
        return [y[1], (wave - K * y[0] - c * y[1] + force(*y)) / M]

    t = np.linspace(0.0, 24.0 * T, 24 * 500, endpoint=False)
    exact = scipy.integrate.solve_ivp(
        slope, (0.0, t[-1]), [0.0, 0.0], t_eval=t, method="LSODA", rtol=1e-8, atol=1e-10
    )
    size, P = _averages(t, *exact.y, lambda x, v: c * v**2 - (force(x, v) * v if harvest else 0.0), T)
    found = model.results({"waves.H": H, "waves.T": T})
    assert float(found["heave"]) == pytest.approx(size, rel=0.01)
    assert float(found["P_pto"]) == pytest.approx(P, rel=0.015)
    free = _without_radiation(BUOY).results({"waves.H": H, "waves.T": T})
    assert size < 0.95 * float(free["heave"])


def test_a_take_off_of_a_flap_has_friction_and_stops():
    """The keys of a body's own take-off reach its laws."""
    flap = js.load_case("flap_2d").replace({"body.pto.coulomb": 1.0, "body.pto.stop_stiffness": 50.0})
    flap = flap.replace({"body.pto.stop": 0.05})
    model = FastModel.of_theory(flap)
    assert {"body.pto.coulomb", "body.pto.stop_stiffness", "body.pto.spring"} <= {*model.keys}
    free = FastModel.of_theory(js.load_case("flap_2d")).results()
    found = jax.jit(lambda k: model.results({"body.pto.stop_stiffness": k, "body.pto.coulomb": 0.0}))
    soft, hard = (float(found(k)["pitch"]) for k in (1e-3, 2e4))
    assert soft == pytest.approx(float(free["pitch"]), rel=0.015)
    assert hard < 0.06 < soft


def test_a_rope_pulls_only():
    """A buoy on a rope to the bed, whose pretension is the less the deeper the buoy."""
    rope = {"between": ["tank", "body"], "at": [[3.15, 0.0], [3.15, 0.3]], "slack": True, "stiffness": 800.0}
    case = BUOY.replace({"link.rope": rope})
    model, taut = _model(case), _model(case.replace({"link.rope.slack": False}))
    assert isinstance(model.theory, MotionTheory) and type(taut.theory) is BodyTheory
    assert not any(key.startswith("link.rope") for key in model.keys)
    heave, both, free = (float(one.results()["heave"]) for one in (model, taut, _model(BUOY)))
    # of a period, the rope acts during one half
    assert min(both, free) < heave < max(both, free)
    assert abs(both / free - 1.0) > 0.05


@pytest.mark.parametrize("method", [jax.jacfwd, jax.jacrev])
def test_slopes_over_the_parameters_of_a_law_of_your_own(method):
    """A law of two coefficients, as the weights of a network would be."""

    def force(p, s, v, t):
        return -p[0] * s - p[1] * jnp.tanh(v / 0.1)

    model = _model(BUOY)

    def power(p):
        return model.with_laws({"take_off": js.Controlled.of(force, p)}).results({"waves.T": 1.3})["P_pto"]

    at, step = jnp.array([-300.0, 12.0]), jnp.array([6.0, 0.24])
    slopes = jax.jit(method(power))(at)
    value = jax.jit(power)
    for k in range(2):
        change = step * (jnp.arange(2) == k)
        difference = (value(at + change) - value(at - change)) / (2.0 * step[k])
        assert float(slopes[k]) == pytest.approx(float(difference), rel=0.02)


def test_laws_of_your_own_and_their_refusals():
    damper, model = js.Damper(jnp.float32(150.0), jnp.float32(0.0)), _model(BUOY)
    found = model.with_laws({"take_off": damper}).results()
    assert float(found["P_pto"]) == pytest.approx(float(model.results()["P_pto"]), rel=0.01)
    with pytest.raises(js.CaseError, match="generator: there is no such link; choose from take_off"):
        model.with_laws({"generator": damper})
    with pytest.raises(js.CaseError, match="take_off has a law of your own"):
        model.with_laws({"take_off": damper}).results({DAMPING: 100.0})


def test_a_stiffness_that_moves_the_bodies_is_refused():
    heavy = FastModel.of_theory(LATCHED.replace({"body.density": 550.0}))
    with pytest.raises(js.CaseError, match="take_off has the extension -0.01 at rest, so that"):
        heavy.results({"link.take_off.stiffness": 100.0})


def test_links_that_act_otherwise_at_rest_are_refused():
    """The equilibrium of linear theory would not be theirs."""
    rope = {"between": ["tank", "body"], "at": [[3.15, 0.0], [3.15, 0.3]], "slack": True, "stiffness": 800.0}
    for change, words in (
        ({"link.take_off.stops": [0.01, 0.05], "link.take_off.stop_stiffness": 1e3}, "a stop acts at rest"),
        ({"link.rope": rope | {"rest": 0.35}}, r"link\.rope is slack at rest"),
    ):
        with pytest.raises(js.CaseError, match=words):
            FastModel.of_theory(BUOY.replace(change))


def test_a_model_moves_to_a_device_with_a_latch_and_keeps_its_additions_and_laws(tmp_path):
    model = dataclasses.replace(_model(BUOY), added=ADDED)
    latched = model.moved(LATCHED)
    assert isinstance(latched.theory, MotionTheory) and latched.added == ADDED
    assert type(latched.moved(BUOY).theory) is BodyTheory
    own = model.with_laws({"take_off": js.Damper(jnp.float32(90.0), jnp.float32(0.0))})
    moved = own.moved(BUOY.replace({DAMPING: 300.0}))
    assert float(moved.results()["P_pto"]) == pytest.approx(float(own.results()["P_pto"]), rel=1e-6)
    with pytest.raises(js.CaseError, match="a model with laws of your own cannot be written"):
        own.write(tmp_path / "m.json")
    assert not list(tmp_path.iterdir())


def _runs():
    """Sweep whose results are those of a latched model with the additions `ADDED`."""
    over = {key: np.array(values) for key, values in members_around(LATCHED).items()}
    changes = {key: jnp.asarray(values) for key, values in over.items()}
    model = FastModel.of_theory(LATCHED, (1.0, 1.6))
    exact = jax.vmap(dataclasses.replace(model, added=ADDED).results)(changes)
    values = {of: np.asarray(exact[name]) for name, of in model.theory.read.items()}
    return js.Sweep(LATCHED, over, values | {"incident_height": over["waves.H"]}, {}, {})


def test_a_fit_finds_drag_and_inertia_of_latched_runs(tmp_path, monkeypatch):
    assert [*members_around(LATCHED)] == ["waves.H", "waves.T", DAMPING]
    model = fitted(LATCHED, _runs())
    assert model.added.drag == pytest.approx(ADDED.drag, rel=0.02)
    assert model.added.inertia == pytest.approx(ADDED.inertia, abs=0.01)
    assert max(model.error.values()) < 5e-3
    monkeypatch.chdir(tmp_path)
    model.write("m.json")
    read = FastModel.read("m.json")
    assert isinstance(read.theory, MotionTheory)
    assert float(read.results()["P_pto"]) == float(model.results()["P_pto"])
    done = CliRunner().invoke(app, ["predict", "m.json", "--grid", f"{HOLD}=0.1,0.2"])
    assert done.exit_code == 0 and f"{HOLD} = 0.2" in done.output, done.output


def test_a_search_finds_the_time_of_a_latch(tmp_path, monkeypatch):
    """Waves of 1.5 s are longer than the buoy's period: held for a sixth of them, it absorbs more."""
    case = LATCHED.replace({"waves.T": 1.5, HOLD: 0.02})

    def calibrate(case, out, *, over, periods, **_):
        runs = Predicted({}, 0.04, {"P_pto": 1.0, "heave": 1.0}, {"P_pto": 1.02, "heave": 1.0})
        return dataclasses.replace(FastModel.of_theory(case, periods), added=ADDED, runs=(runs,))

    monkeypatch.setattr(searching, "calibrate", calibrate)
    bounds = {DAMPING: (50.0, 400.0), HOLD: (0.02, 0.4)}
    found = js.search(case, bounds, tmp_path / "s.h5", of="P_pto", progress=False)
    model = calibrate(case, None, over=None, periods=None)
    grid = np.meshgrid(np.geomspace(50.0, 400.0, 16), np.linspace(0.02, 0.4, 39))
    power = jax.jit(jax.vmap(lambda c, h: model.results({DAMPING: c, HOLD: h})["P_pto"]))
    powers = power(*(jnp.ravel(a) for a in map(jnp.asarray, grid)))
    best = float(jnp.max(powers))
    assert best > 1.15 * float(found.history[0]["P_pto"]) and found.value > 0.99 * best
    assert 0.1 < found.case.value(HOLD) < 0.3
