"""Analysis of recorded seas, compared with seas whose spectrum, reflection and mean are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from jaxsph import analysis
from jaxsph.waves import second_order, spectra

D, TP, HS = 0.5, 1.4, 0.04
SEA = spectra.JONSWAP(HS, TP)
F = (0.4 / TP, 2.9 / TP)
T = np.arange(0.0, 280.0, 0.05)
"""Times of 200 waves, s. Seas of another duration are not sums of the record's frequencies."""


def sea(seed, x=0.0, back=0.0, duration=333.0):
    """Elevation at x (m) of a sea, plus the share `back` that a wall at x = 8 m reflects."""
    a, w = spectra.draw_sea(SEA, duration, seed)
    k = second_order.wavenumbers(w, D, 9.81)
    there = a * np.exp(-1j * k * x) + back * a * np.exp(-1j * k * (16.0 - x))
    return second_order.Harmonics(there, w, k).at(T)


def test_heights_and_periods_are_the_spectrum_s():
    """For 200 waves: Hm0 to 2 % (the record is not a repetition of the sea), Te and T02 to 2 %, Tp to 3 %."""
    found = analysis.spectrum(T, sea(1))
    f = np.linspace(*F, 4000)
    S = SEA.density(f)
    m = {n: np.trapezoid(f**n * S, f) for n in (-1, 0, 2)}
    assert found.Hm0 == pytest.approx(HS, rel=0.02)
    assert found.Te == pytest.approx(m[-1] / m[0], rel=0.02)
    assert found.T02 == pytest.approx(np.sqrt(m[0] / m[2]), rel=0.02)
    assert found.Tp == pytest.approx(TP, rel=0.03)


def test_band_holds_the_true_density_as_often_as_it_says():
    """For Gaussian noise of density 1: 90 % of 2,000 values, within three standard errors of that share."""
    rng = np.random.default_rng(0)
    t = np.arange(40_000) * 0.5
    found = analysis.spectrum(t, rng.normal(size=t.size), bands=10)
    low, high = found.band(0.9)
    inside = np.mean((low < 1.0) & (high > 1.0))
    assert found.freedom == 20.0 and inside == pytest.approx(0.9, abs=0.02)


def test_power_of_a_narrow_spectrum_is_that_of_its_wave():
    """A sine at the frequency of a bin: rho g H^2/8 c_g, except for leakage of the taper (1 %)."""
    from jaxsph.waves import theory

    t = np.arange(0.0, 140.0, 0.05)
    found = analysis.spectrum(t, 0.02 * np.cos(2.0 * np.pi * t / 1.4), bands=2)
    assert found.power(D) == pytest.approx(float(theory.incident_power(0.04, 1.4, D)), rel=0.01)


@pytest.mark.parametrize("back", [0.0, 0.3, 1.0])
def test_incident_and_reflected_sea_are_told_apart(back):
    """Five gauges. The ends of the record leak between frequencies: by 0.01 of a coefficient, and by 0.5 % of
    the height of the incident waves in this record."""
    x = np.array([2.6, 2.8, 3.1, 3.5, 4.0])
    eta = np.array([sea(2, at, back) for at in x])
    found = analysis.two_way_sea(eta, x, T, D, f=F)
    assert found.coefficient == pytest.approx(back, abs=0.01)
    assert found.incident.Hm0 == pytest.approx(analysis.spectrum(T, sea(2, x[0])).Hm0, rel=5e-3)
    assert found.left_out < 0.2


def test_gauges_that_cannot_tell_are_refused():
    x = np.array([1.0, 1.001, 1.002])
    with pytest.raises(ValueError, match="cannot separate incident and reflected"):
        analysis.two_way_sea(np.array([sea(2, at) for at in x]), x, T, D, f=F)
    with pytest.raises(ValueError, match="three gauges"):
        analysis.two_way_sea(np.zeros((2, len(T))), x[:2], T, D, f=F)
    with pytest.raises(ValueError, match="but 32 are needed: use a longer record"):
        analysis.two_way_sea(np.zeros((3, 100)), x, T[:100], D, f=F)


def test_single_waves_of_a_sea_follow_rayleigh():
    """H_1/3 is 5 to 10 % below Hm0, as in broad seas; the median height is 0.589 Hm0 in a narrow one."""
    waves = analysis.zero_crossing_waves(T, sea(3))
    assert 0.88 * HS < waves.significant < 1.02 * HS
    H, share = waves.exceedance()
    assert np.all(np.diff(H) >= 0.0) and np.all(np.diff(share) < 0.0)
    narrow = analysis.rayleigh_exceedance(np.array([0.0, 0.5887 * HS]), HS)
    np.testing.assert_allclose(narrow, [1.0, 0.5], atol=1e-4)
    assert np.interp(0.5, share[::-1], H[::-1]) == pytest.approx(0.589 * HS, rel=0.12)
    regular = analysis.zero_crossing_waves(T, np.sin(2.0 * np.pi * T / 1.4))
    np.testing.assert_allclose(regular.H, 2.0, rtol=5e-3)  # 28 samples per period
    np.testing.assert_allclose(regular.T, 1.4, rtol=1e-3)
    with pytest.raises(ValueError, match="a whole wave needs two upward crossings"):
        analysis.zero_crossing_waves(T[:10], sea(3)[:10])


@settings(max_examples=5)
@given(st.sampled_from([0.0, 0.7, 0.95]), st.integers(0, 2**31))
def test_error_of_a_mean_covers_as_often_as_it_should(r, seed):
    """200 AR(1) series of 4,000 samples: the mean error is the scatter of the means, to 20 %.

    The tolerance is three times the 5 % of 200 series, and a bias of a few per cent.
    """
    rng = np.random.default_rng(seed)
    series = signal.lfilter([1.0], [1.0, -r], rng.normal(size=(200, 4500)), axis=1)[:, 500:]
    found = [analysis.mean_with_error(one) for one in series]
    scatter = np.std([one.value for one in found])
    assert np.mean([one.error for one in found]) == pytest.approx(scatter, rel=0.2)


def test_error_of_a_constant_is_none():
    assert analysis.mean_with_error(np.full(20, 3.0)) == (3.0, 0.0)
    with pytest.raises(ValueError, match="8 samples"):
        analysis.mean_with_error([1.0, 2.0])


def test_uneven_times_have_no_spectrum():
    with pytest.raises(ValueError, match="not evenly spaced"):
        analysis.spectrum(np.sort(np.random.default_rng(0).random(200)), np.ones(200))
