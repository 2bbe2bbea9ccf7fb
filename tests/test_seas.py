"""Seas of many waves: spectra, the sums that a piston makes, second-order theory."""

import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

import jaxsph as js
from jaxsph.case.wave_sections import RecordedWavesSection
from jaxsph.model.meaning import Exchange
from jaxsph.parts.relaxation import RelaxationZone
from jaxsph.waves import second_order, spectra, theory
from jaxsph.waves.regular import RegularWaves, SecondOrderPiston, second_order_piston
from jaxsph.waves.seas import Sea

D, G = 0.5, 9.81


def omega(*T):
    return 2.0 * np.pi / np.array(T)


@pytest.mark.parametrize(
    "spectrum",
    [spectra.JONSWAP(0.04, 1.4), spectra.JONSWAP(0.1, 9.0, 7.0), spectra.Bretschneider(2.0, 8.0)],
    ids=str,
)
def test_spectrum_has_its_height_and_peak(spectrum):
    """The variance is (Hs/4)^2, to the accuracy of the quadrature and the variance beyond 30 peaks (1e-6)."""
    peak = 1.0 / spectrum.Tp
    parts = ((0.0, peak), (peak, 5.0 * peak), (5.0 * peak, 100.0 * peak))
    m0 = sum(quad(spectrum.density, *part)[0] for part in parts)
    assert 4.0 * np.sqrt(m0) == pytest.approx(spectrum.Hs, rel=2e-6)
    f = peak * np.linspace(0.5, 2.0, 3001)
    assert f[np.argmax(spectrum.density(f))] == pytest.approx(peak, rel=1e-3)  # the step of the grid
    assert spectrum.density(0.0) == 0.0


def test_jonswap_without_enhancement_is_bretschneider_s():
    f = np.linspace(0.1, 3.0, 50)
    np.testing.assert_allclose(
        spectra.JONSWAP(0.04, 1.4, 1.0).density(f), spectra.Bretschneider(0.04, 1.4).density(f), rtol=1e-12
    )


def test_height_of_a_grown_sea():
    """0.0246 m/s2 Tp^2 at 9.81 m/s2, from both laws of Pierson and Moskowitz (1964), 0.22 and 0.877 g/U."""
    assert spectra.pierson_moskowitz_height(10.0) == pytest.approx(4.0, rel=0.01)


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.floats(30.0, 300.0))
def test_every_sea_has_the_whole_variance(seed, duration):
    a, w = spectra.draw_sea(spectra.JONSWAP(0.04, 1.4), duration, seed)
    assert 4.0 * np.sqrt(0.5 * np.sum(np.abs(a) ** 2)) == pytest.approx(0.04, rel=1e-9)
    turns = w * duration / (2.0 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), rtol=1e-9)  # the sea repeats after the duration


def test_seeds_differ_and_repeat():
    one, other, again = (spectra.draw_sea(spectra.JONSWAP(0.04, 1.4), 60.0, s)[0] for s in (1, 2, 1))
    assert np.array_equal(one, again) and not np.allclose(one, other)


def test_group_has_its_crest():
    a, _ = spectra.draw_group(spectra.JONSWAP(0.04, 1.4), 60.0, 0.05)
    assert np.sum(a) == pytest.approx(0.05)


@pytest.mark.parametrize("T", [1.0, 1.4, 3.0])
def test_second_order_elevation_of_one_wave_is_stokes(T):
    """To rounding, because both have the same closed form."""
    bound = second_order.second_order_elevation(np.array([0.02 + 0j]), omega(T), D)
    with enable_x64():
        expected = theory._stokes2_amplitude(0.04, theory.wavenumber(omega(T)[0], D), D)
    assert bound.amplitude == pytest.approx(complex(expected), rel=1e-9)
    assert bound.omega == pytest.approx(2.0 * omega(T))


def test_long_wave_of_a_slow_group_is_the_set_down():
    """Longuet-Higgins and Stewart (1962): -S / (rho (g h - c_g^2)), to 0.3 % with periods 0.1 % apart."""
    w = omega(1.4, 1.4 * 1.001)
    a = np.array([0.02, 0.02], complex)
    bound = second_order.second_order_elevation(a, w, D)
    speed, k = float(theory.group_velocity(w[0], D)), second_order.wavenumbers(w, D, G)[0]
    stress = (2.0 * speed * k / w[0] - 0.5) * G * 0.02**2
    assert np.argmin(bound.omega) == 0
    assert bound.amplitude[0] == pytest.approx(-stress / (G * D - speed**2), rel=3e-3)
    assert bound.k[0] == pytest.approx(-np.diff(second_order.wavenumbers(w, D, G))[0], rel=1e-6)


def test_second_order_displacement_of_long_waves_is_madsen_s():
    """Madsen (1971) holds in shallow water: at kd = 0.49 and 0.24 the two agree to (kd)^2 / 5."""
    for T, kd in ((3.0, 0.49), (6.0, 0.24)):
        found = second_order.second_order_displacement(np.array([0.005 + 0j]), omega(T), D)
        with enable_x64():
            expected = float(second_order_piston(0.01, float(theory.wavenumber(omega(T)[0], D)), D))
        assert found.amplitude[0] == pytest.approx(-1j * expected, rel=kd**2 / 5)


def test_second_order_displacement_converges_with_the_modes():
    a, w = np.array([0.02, 0.02j]), omega(1.2, 1.5)
    coarse, fine = (second_order.second_order_displacement(a, w, D, modes=m) for m in (16, 64))
    np.testing.assert_allclose(coarse.amplitude, fine.amplitude, rtol=0.01, atol=2e-6)


@settings(max_examples=10)
@given(st.permutations(range(4)), st.floats(-3.0, 3.0))
def test_second_order_does_not_depend_on_the_waves_order_or_the_clock(order, shift):
    """A later start of the clock shifts the phase of every amplitude by its own frequency; to rounding."""
    a, w = np.array([0.01, 0.02j, 0.01 + 0.01j, -0.005]), omega(1.6, 1.4, 1.3, 1.0)
    order = list(order)
    for function in (second_order.second_order_displacement, second_order.second_order_elevation):
        one = function(a, w, D)
        other = function((a * np.exp(1j * w * shift))[order], w[order], D)
        np.testing.assert_allclose(other.omega, one.omega, rtol=1e-9)
        np.testing.assert_allclose(
            other.amplitude, one.amplitude * np.exp(1j * one.omega * shift), rtol=1e-7, atol=1e-10
        )


def test_sea_of_one_wave_is_regular():
    """Displacement, velocity, elevation at a gauge and near field, to the rounding of float32."""
    regular = RegularWaves(0.04, 1.4, D, ramp=2.8)
    sea = Sea.of(np.array([0.02]), omega(1.4), D, 2.8, second_order_piston=False)
    t = jnp.linspace(0.0, 6.0, 61)
    for name in ("omega", "k", "Phi"):
        assert getattr(sea, name) == pytest.approx(float(getattr(regular, name)), rel=1e-5)
    np.testing.assert_allclose(sea.paddle_displacement(t), regular.paddle_displacement(t), atol=1e-6)
    np.testing.assert_allclose(sea.paddle_velocity(t), regular.paddle_velocity(t), atol=1e-5)
    np.testing.assert_allclose(sea.delayed_elevation(0.1, t), regular.delayed_elevation(0.1, t), atol=1e-6)
    near = [w.near_elevation(w.near_field(0.1), t) for w in (sea, regular)]
    np.testing.assert_allclose(*near, atol=1e-7)


def test_sea_s_second_order_is_in_displacement_and_gauge():
    """They are the sums computed on the host, once the ramp has ended."""
    a, w = np.array([0.02, 0.015j]), omega(1.3, 1.5)
    first, second = (Sea.of(a, w, D, 1.0, second_order_piston=one) for one in (False, True))
    t = np.linspace(2.0, 5.0, 31)
    more = np.asarray(second.paddle_displacement(t) - first.paddle_displacement(t))
    np.testing.assert_allclose(more, second_order.second_order_displacement(a, w, D).at(t), atol=1e-6)
    more = np.asarray(second.delayed_elevation(0.0, t) - first.delayed_elevation(0.0, t))
    np.testing.assert_allclose(more, second_order.second_order_elevation(a, w, D).at(t), atol=1e-6)


def test_the_wave_that_stands_for_a_sea_is_near_its_peak():
    a, w = spectra.draw_sea(spectra.JONSWAP(0.04, 1.4), 140.0, 0)
    sea = Sea.of(a, w, D, second_order_piston=False)
    assert 2.0 * np.pi / float(sea.omega) == pytest.approx(1.4, rel=0.05)


# --------------------------------------------------------------------------- the relaxation zone

X, Z = jnp.linspace(-0.2, 2.0, 23), jnp.linspace(0.0, 0.8, 17)
SEA = Sea.of(np.array([0.02, 0.015j]), omega(1.3, 1.5), D, 1.0)


@pytest.mark.parametrize(
    "waves",
    [
        RegularWaves(0.001, 1.4, D, ramp=1.0, correction=SecondOrderPiston()),
        Sea.of(np.array([0.0005, 0.0005j]), omega(1.3, 1.5), D, 1.0),
    ],
    ids=["regular", "sea"],
)
def test_velocities_are_those_of_the_elevation(waves):
    """w = d eta/dt at the still level, the flow at x = 0 is that of the wall, and u_x = -w_z.

    The waves are so low that the second order is 0.5 % of the first; differences over 0.2 m and 0.1 m have an
    error of (k 0.1)^2/6 = 2 %.
    """
    t, step = 5.0, 2e-2
    u, w = waves.velocity(X, Z, t)
    rate = (waves.delayed_elevation(X, t + step) - waves.delayed_elevation(X, t - step)) / (2.0 * step)
    level = int(np.argmin(np.abs(np.asarray(Z) - D)))
    assert np.max(np.abs(w[:, level] - rate)) < 0.01 * np.max(np.abs(rate))
    fine = jnp.linspace(0.0, D, 201)
    flow = jnp.trapezoid(waves.velocity(X, fine, t)[0], fine, axis=1) / D
    moved = (waves.mean_displacement(t + step) - waves.mean_displacement(t - step)) / (2.0 * step)
    there = flow[int(np.argmin(np.abs(np.asarray(X))))]
    assert abs(there - moved) < 0.01 * np.max(np.abs(flow))
    u_x = (u[2:, 1:-1] - u[:-2, 1:-1]) / 0.2
    w_z = (w[1:-1, 2:] - w[1:-1, :-2]) / 0.1
    assert np.max(np.abs(u_x + w_z)) < 0.03 * np.max(np.abs(w_z))


def test_zone_draws_velocities_towards_the_waves_and_books_the_energy():
    """A step of ten times the inverse rate takes the whole difference at the near end, none past the zone."""
    zone = RelaxationZone(SEA, *(jnp.asarray(a) for a in (2.0, 5.0)), X, Z)
    x = jnp.array([[0.0, 0.4], [0.5, 0.3], [1.9, 0.2], [2.5, 0.4]])
    asked = np.asarray(zone.asked(x, 5.0))
    there = np.array([SEA.velocity(a[:1], a[1:], 5.0)[:, 0, 0] for a in x])
    # error between the points of the zone's lattice: (k 0.1)^2/8 of 0.1 m/s
    np.testing.assert_allclose(asked[:3], there[:3], atol=5e-4)
    assert 1.0 == zone.weight(x[:, 0])[0] > zone.weight(x[:, 0])[1] > zone.weight(x[:, 0])[2] > 0.0
    after = np.asarray(zone.damp(x, jnp.ones_like(x), 5.0, 2.0))
    np.testing.assert_allclose(after[0], asked[0], atol=1e-3)
    assert np.array_equal(after[3], [1.0, 1.0])
    assert zone.entries()["zone"].exchange is Exchange.GIVEN


FLUME = {
    "dx": 0.1,
    "t1": 0.2,
    "tank": {"length": 6.0, "depth": 0.5},
    "scheme": {"kind": "incompressible"},
    "waves": {"H": 0.06, "T": 1.2, "zone": 2.0},
}


@pytest.mark.slow
def test_a_run_with_a_zone_books_what_the_zone_and_its_wall_give():
    """Without an absorbing paddle the energy budget closes, to less than 1 % of the kinetic energy."""
    done = js.run(js.Case.from_dict(FLUME | {"t1": 1.0}), progress=False)
    assert done.state.ledger["zone"].total != 0.0
    assert abs(done.results["energy_residual"]) < 1e-2 * max(abs(done["kinetic"]))


@pytest.mark.parametrize(
    ("waves", "words"),
    [
        ({"zone": 0.9}, r"waves.zone = 0.9 m: must be at least half a wavelength, 1.02 m"),
        ({"zone": 5.9}, r"leaves less than a tenth of the 6 m"),
        ({"kind": "irregular", "Hs": 0.04, "Tp": 1.4}, "the wavelength, 2.57 m, is less than 40"),
        ({"kind": "irregular", "Tp": 3.0}, r'spectrum = "jonswap" needs waves.Hs'),
        (
            {"kind": "irregular", "Hs": 0.5, "Tp": 3.0},
            r"waves.Hs = 0.5 m: waves with a period of 3 s .* break above a height of 0.39",
        ),
        (
            {"kind": "irregular", "Hs": 0.1, "Tp": 3.0, "duration": 9.0},
            r"duration = 9 s must be 16 to 500 peak",
        ),
        (
            {"kind": "irregular", "Hs": 0.1, "Tp": 3.0, "spectrum": "bretschneider", "gamma": 2.0},
            "applies to spectrum",
        ),
        ({"kind": "irregular", "Hs": 0.1, "Tp": 3.0, "spectrum": "pierson_moskowitz"}, "follows from Tp"),
        ({"kind": "bichromatic", "H": [0.03, 0.03], "T": [1.5, 1.5]}, "two periods must differ"),
        (
            {"kind": "focused", "crest": 0.1, "Tp": 3.0, "x": 3.0, "t": 9.0, "Hs": 0.1},
            r'belongs to waves.kind = "irr',
        ),
        ({"kind": "recorded", "t": list(np.arange(40.0)), "eta": [0.0] * 40}, "does not vary"),
        (
            {"kind": "recorded", "t": [*range(39), 45], "eta": [0.1, 0.0] * 20},
            r"gap or a jump of 7 s from t = 38 s",
        ),
        ({"kind": "recorded", "t": [*range(40)], "eta": [0.1] * 39}, "t has 40 times, but eta has 39 values"),
        ({"kind": "recorded", "t": [*range(40)]}, "give exactly one of waves.eta"),
        ({"kind": "wild"}, r'waves.kind = \'wild\': must be "regular" or "bichromatic"'),
    ],
)
def test_waves_that_a_tank_cannot_have_are_refused(waves, words):
    own = waves if "kind" in waves else FLUME["waves"] | waves
    own = {k: [float(one) for one in v] if isinstance(v, list) else v for k, v in own.items()}
    with pytest.raises(js.CaseError, match=words):
        js.Case.from_dict(FLUME | {"waves": own})


def test_a_recorded_series_is_made_again():
    """A sea's elevation at 3 m, recorded over one repetition, gives the waves of that sea, to rounding."""
    a, w = spectra.draw_sea(spectra.JONSWAP(0.08, 3.0), 64.0, 3)
    t = np.arange(640) * 0.1
    there = second_order.Harmonics(a * np.exp(-1j * second_order.wavenumbers(w, D, G) * 3.0), w, w).at(t)
    X = second_order.displacement(a, w, D, G).at(t)
    section = RecordedWavesSection(t=tuple(t), eta=tuple(there), x=3.0)
    for one in (section, RecordedWavesSection(t=tuple(t), X=tuple(X))):
        found, omegas = one.sum_of_waves(D, G)
        # its smallest waves are left out
        kept = np.isin(*(np.round(which * 64.0 / (2.0 * np.pi)) for which in (w, omegas)))
        assert kept.sum() >= len(a) - 1
        np.testing.assert_allclose(found, a[kept], atol=1e-12)
    assert section.height == pytest.approx(0.08, rel=1e-6) and section.left_out < 1e-4
    assert section.period == pytest.approx(3.0, rel=0.05)


def test_kinds_of_waves_go_through_a_file_s_text():
    for waves in (
        {"kind": "irregular", "Hs": 0.1, "Tp": 3.0},
        {"kind": "focused", "crest": 0.1, "Tp": 3.0, "x": 3.0, "t": 9.0},
        {"kind": "bichromatic", "H": [0.03, 0.05], "T": [1.5, 1.7]},
    ):
        case = js.Case.from_dict(FLUME | {"waves": waves})
        assert js.Case.from_dict(tomllib.loads(case.to_toml())) == case
        assert case.replace({"waves.kind": "regular", "waves.H": 0.05, "waves.T": 1.5}).waves.H == 0.05


def test_incident_power_is_the_sum_over_the_waves():
    both = {"kind": "bichromatic", "H": [0.03, 0.05], "T": [1.5, 1.7]}
    two = [{"H": H, "T": T} for H, T in zip(both["H"], both["T"], strict=True)]
    sea, *each = (js.incident_power(js.Case.from_dict(FLUME | {"waves": w})) for w in (both, *two))
    assert sea == pytest.approx(sum(each), rel=1e-5)


SEA_FILE = """dx = 0.1
t1 = 1.0
[tank]
length = 6.0
depth = 0.5
[waves]
kind = "recorded"
file = "sea.csv"
x = 2.0
"""


def test_a_recorded_series_is_read_from_its_file(tmp_path):
    """The file is in the case's folder; the case then contains the series, so that a run needs no file."""
    t = np.arange(0.0, 60.0, 0.1).round(3)
    eta = (0.03 * np.sin(2.0 * np.pi * t / 3.0)).round(6)
    rows = "\n".join(f"{a},{b}" for a, b in zip(eta, t, strict=True))
    (tmp_path / "sea.csv").write_text(f"eta [m], t [s]\n{rows}\n")
    (tmp_path / "sea.toml").write_text(SEA_FILE)
    case = js.load_case(tmp_path / "sea.toml")
    assert case.waves.t == tuple(t) and case.waves.eta == tuple(eta) and case.waves.x == 2.0
    assert case.waves.period == pytest.approx(3.0) and case.waves.height == pytest.approx(0.0849, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t (s),eta (mm)\n0,1\n", r"line 1 \(14 characters\): eta must be in m"),
        ("t_ms,eta\n0,1\n", "line 1 .*: t must be in s"),
        ("time,level\n0,1\n", r"line 1 .*: must name the columns t \(s\), eta \(m\) or t \(s\), X \(m\)"),
        ("", r"line 1 \(0 characters\): must name"),
        ("t,eta\n0,1\n0.1,x\n", r"line 3 \(5 characters\): must have 2 finite numbers \(t, eta\)"),
        ("t,eta\n0,1\n0.1,nan\n", "line 3"),
        ("t,eta\n0,1\n0.1\n", "line 3"),
    ],
)
def test_a_file_that_is_no_series_is_refused(tmp_path, text, words):
    (tmp_path / "sea.csv").write_text(text)
    (tmp_path / "sea.toml").write_text(SEA_FILE)
    with pytest.raises(js.CaseError, match=words):
        js.load_case(tmp_path / "sea.toml")
