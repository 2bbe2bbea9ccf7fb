"""Fast models of bodies: linear theory as a limit, drag against an independent solution, slopes, and fits."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.case.linear_bodies import linear_motions
from jaxsph.cli.app import app
from jaxsph.study import fast_model
from jaxsph.study.fast_bodies import BodyTheory
from jaxsph.study.fast_model import FastModel, fitted, members_around
from jaxsph.waves.fast_bodies import BodyAdditions
from jaxsph.waves.spectra import HIGHEST, LOWEST

BUOY = js.load_case("buoy_heave").replace({"t1": 16.0})
FLAP = js.load_case("flap_2d")
TRUE = {"buoy_heave": BodyAdditions((500.0,), (0.08,)), "flap_2d": BodyAdditions((12.0,), (0.2,))}
KEY = {"buoy_heave": "link.take_off.damping", "flap_2d": "body.pto.damping"}
SPRING = {"buoy_heave": "link.take_off.stiffness", "flap_2d": "body.pto.spring"}
MOTION = {"buoy_heave": "heave", "flap_2d": "pitch"}


@functools.cache
def _model(name, additions=False):
    """Model of a built-in case, with the additions `TRUE` or without any."""
    case = {"buoy_heave": BUOY, "flap_2d": FLAP}[name]
    model = FastModel.of_theory(case, tuple(case.value("waves.T") * f for f in (1.0, 1.0)))
    return dataclasses.replace(model, added=TRUE[name]) if additions else model


@functools.cache
def _answer(name, additions=False):
    """Compiled results of the model over height, period and damping."""
    model = _model(name, additions)
    return jax.jit(lambda H, T, c: model.results({"waves.H": H, "waves.T": T, KEY[name]: c}))


@pytest.mark.parametrize("name", KEY)
@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(ratio=st.floats(0.65, 2.1), damping=st.floats(0.2, 4.0), H=st.floats(0.01, 0.08))
def test_without_additions_the_model_is_linear_theory(name, ratio, damping, H):
    case = _model(name).case
    T, c = case.value("waves.T") * ratio, case.value(KEY[name]) * damping
    exact = linear_motions(case.replace({"waves.H": H, "waves.T": T, KEY[name]: c})).results
    found = _answer(name)(H, T, c)
    # the series has 16 terms, and the model uses float32
    for of, there in (("P_pto", "P_pto"), ("xi", "xi"), (MOTION[name], f"amplitude_{MOTION[name]}")):
        assert float(found[of]) == pytest.approx(exact[there], rel=3e-4)


@functools.cache
def _with_spring(name):
    """Compiled results of the model over the stiffness of the take-off."""
    model = _model(name)
    return jax.jit(lambda k: model.results({SPRING[name]: k}))


@pytest.mark.parametrize("name", KEY)
@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(share=st.floats(-0.5, 1.0))
def test_another_stiffness_of_a_take_off_is_that_of_linear_theory(name, share):
    """Also a negative one, as in reactive control; relative to the stiffness by buoyancy and weight."""
    model = _model(name)
    stiffness = share * float(model.theory.water.stiffness[0, 0])
    exact = linear_motions(model.case.replace({SPRING[name]: stiffness})).results
    found = _with_spring(name)(stiffness)
    for of, there in (("P_pto", "P_pto"), (MOTION[name], f"amplitude_{MOTION[name]}")):
        assert float(found[of]) == pytest.approx(exact[there], rel=1e-3)


def test_models_of_cases_with_springs_agree():
    """The stiffness replaces that of the case, also where a water of another case was put in its place."""
    soft, hard = (FastModel.of_theory(BUOY.replace({SPRING["buoy_heave"]: k})) for k in (-500.0, 800.0))
    other = dataclasses.replace(soft, theory=dataclasses.replace(soft.theory, water=hard.theory.water))
    for model in (hard, other):
        found = model.results({SPRING["buoy_heave"]: -500.0})
        assert float(found["heave"]) == pytest.approx(float(soft.results()["heave"]), rel=1e-5)
    assert float(hard.results()["heave"]) != pytest.approx(float(soft.results()["heave"]), rel=0.05)


def test_a_stiffness_that_moves_the_bodies_is_refused():
    """A buoy that is heavier than the water it displaces in its given position sinks by a centimetre."""
    heavy = FastModel.of_theory(BUOY.replace({"body.density": 550.0}))
    assert float(heavy.results()["heave"]) > 0.0
    with pytest.raises(js.CaseError, match="take_off has the extension -0.01 at rest, so that"):
        heavy.results({SPRING["buoy_heave"]: 100.0})


@pytest.mark.parametrize("name", KEY)
def test_drag_and_inertia_are_those_of_one_equation_of_motion(name):
    model = _model(name, True)
    water, (drag,), (more,) = model.theory.water, *TRUE[name]
    H, T, c = (model.case.value(key) for key in ("waves.H", "waves.T", KEY[name]))
    omega = 2.0 * np.pi / T
    impedance, force = (complex(np.ravel(a)[0]) for a in water.at(jnp.asarray(omega)))
    mass, stiffness = float(water.mass[0, 0]) * (1.0 + more), float(water.stiffness[0, 0])

    def size(X):
        damping = c + 8.0 / (3.0 * np.pi) * drag * omega * X
        return abs(0.5 * H * force / (stiffness - omega**2 * mass - 1j * omega * (damping + impedance)))

    X = scipy.optimize.brentq(lambda X: size(X) - X, 1e-6, 1.0)
    found = _answer(name, True)(H, T, c)
    assert float(found[MOTION[name]]) == pytest.approx(X, rel=1e-4)
    assert float(found["P_pto"]) == pytest.approx(0.5 * c * (omega * X) ** 2, rel=2e-4)
    lost = float(model.response().P_lost)
    assert lost == pytest.approx(4.0 / (3.0 * np.pi) * drag * (omega * X) ** 3, rel=3e-4)
    assert X < 0.97 * size(0.0)  # the drag is not small


def test_power_in_a_sea_is_the_sum_of_its_waves_if_everything_is_linear():
    model = _model("buoy_heave")
    sea = model.results({"waves.Hs": 0.03, "waves.Tp": 1.1})
    T = 1.1 / np.linspace(LOWEST, HIGHEST, 93)
    waves = model._incident({"Hs": jnp.asarray(0.03), "Tp": jnp.asarray(1.1)})
    each = jax.vmap(lambda a, w: model.theory.respond(model.added, {}, _one(waves, a, w)).P_pto)
    assert float(sea["P_pto"]) == pytest.approx(float(jnp.sum(each(waves.amplitude, waves.omega))), rel=1e-3)
    assert T.max() > 1.1 > T.min()


def _one(waves, amplitude, omega):
    return waves._replace(amplitude=amplitude[None], omega=omega[None])


@pytest.mark.parametrize("method", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("name", KEY)
def test_slopes_over_waves_and_damping(name, method):
    case = _model(name).case
    at = [case.value(key) for key in ("waves.H", "waves.T", KEY[name])]
    model = _model(name, True)

    def power(*x):
        return model.results(dict(zip(("waves.H", "waves.T", KEY[name]), x, strict=True)))["P_pto"]

    slopes = jax.jit(method(power, (0, 1, 2)))(*at)
    for k, slope in enumerate(slopes):
        up, down = (
            _answer(name, True)(*(v * (1.0 + s * (i == k)) for i, v in enumerate(at)))["P_pto"]
            for s in (0.01, -0.01)
        )
        # differences over 2 % of each value
        assert float(slope) == pytest.approx(float((up - down) / (0.02 * at[k])), rel=0.02)


def _runs(name, scatter=0.0):
    """Sweep whose results are those of a model with the additions `TRUE`, with relative errors."""
    case = _model(name).case
    over = {key: np.array(values) for key, values in members_around(case).items()}
    H = 0.98 * over["waves.H"]
    changes = {key: jnp.asarray(values) for key, values in (over | {"waves.H": H}).items()}
    exact, rng = jax.vmap(_model(name, True).results)(changes), np.random.default_rng(3)
    results = {
        of: np.asarray(exact[of_model]) * (1.0 + scatter * rng.normal(size=len(H)))
        for of_model, of in _model(name).theory.read.items()
    }
    return js.Sweep(case, over, results | {"incident_height": H}, {}, {})


@pytest.mark.parametrize("name", KEY)
def test_a_fit_finds_drag_and_inertia_of_exact_runs(name, tmp_path):
    model = fitted(_model(name).case, _runs(name))
    assert model.added.drag == pytest.approx(TRUE[name].drag, rel=1e-2)
    assert model.added.inertia == pytest.approx(TRUE[name].inertia, abs=5e-3)
    assert max(model.error.values()) < 2e-3
    noisy = fitted(_model(name).case, _runs(name, 0.03))
    for found, error, true in zip(
        jax.tree.leaves(noisy.added),
        jax.tree.leaves(noisy.added_error),
        jax.tree.leaves(TRUE[name]),
        strict=True,
    ):
        assert abs(found - true) < 4.0 * error
    noisy.write(tmp_path / "model.json")
    read = FastModel.read(tmp_path / "model.json")
    assert read.added == noisy.added and read.error == noisy.error
    assert float(read.results()["P_pto"]) == float(noisy.results()["P_pto"])


@pytest.mark.parametrize(
    ("case", "changes", "words"),
    [
        ("box_in_waves", {}, "a fast model of bodies needs a power take-off of a body, and no chamber"),
        ("owc_floating", {}, "a fast model of bodies needs a power take-off of a body, and no chamber"),
        ("buoy_3d", {}, r"tank\.width: the tank has three dimensions: a fast model needs linear theory"),
    ],
)
def test_bodies_without_a_fast_model_are_refused(case, changes, words, tmp_path):
    assert BodyTheory.why_not(FLAP) == ""
    with pytest.raises(js.CaseError, match=words):
        js.calibrate(js.load_case(case).replace(changes), tmp_path / "model.json")
    assert not list(tmp_path.iterdir())


def test_the_commands_calibrate_and_predict(tmp_path, monkeypatch):
    monkeypatch.setattr(fast_model, "sweep", lambda *_, **__: _runs("buoy_heave", 0.02))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "buoy_heave_model_runs.h5").touch()  # so that no time is estimated
    done = CliRunner().invoke(app, ["calibrate", "buoy_heave", "--set", "t1=16.0"])
    assert done.exit_code == 0, done.output
    assert "drag in heave" in done.output and "heave 0.0" in done.output
    grid = ["--grid", "link.take_off.damping=100,200", "--out", "found.csv"]
    done = CliRunner().invoke(app, ["predict", "runs/buoy_heave_model.json", *grid])
    assert done.exit_code == 0, done.output
    assert "P_pto = " in done.output and "heave = " in done.output and " W per metre of width" in done.output
    header = (tmp_path / "found.csv").read_text().splitlines()[0]
    assert header == "link.take_off.damping,xi,P_pto (W per metre of width),heave (m)"
