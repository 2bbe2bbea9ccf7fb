"""Post-processing of series with known results."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from jaxsph import analysis
from jaxsph.waves import theory

T, D = 1.2, 0.5
OMEGA = 2.0 * np.pi / T
K = float(theory.wavenumber(OMEGA, D))
LENGTH = 2.0 * np.pi / K
TIMES = np.linspace(0.0, 7.3, 731)
GAUGES = np.array([4.0, 4.25, 4.65])


def _two_waves(x, a, r, phase):
    """Waves of incident amplitude a and reflected share r, with a mean level and a bound harmonic."""
    x = np.asarray(x)[:, None]
    incident = np.cos(K * x - OMEGA * TIMES)
    bound = 0.1 * np.cos(2.0 * (K * x - OMEGA * TIMES))
    return a * (incident + bound + r * np.cos(K * x + OMEGA * TIMES + phase) + 0.02)


# --- reflection


@settings(max_examples=40, deadline=None)
@given(a=st.floats(1e-3, 1.0), r=st.floats(0.0, 1.0), phase=st.floats(-np.pi, np.pi))
def test_reflection_recovers_what_was_put_in(a, r, phase):
    result = analysis.reflection(_two_waves(GAUGES, a, r, phase), GAUGES, TIMES, T, D)
    # error of the float32 k (relative 1e-6), times differences in kx of 2 rad and a condition of 2
    assert result.incident == pytest.approx(a, rel=1e-5)
    assert result.coefficient == pytest.approx(r, abs=1e-5)
    assert result.reflected == pytest.approx(a * r, abs=1e-5 * a)


@settings(max_examples=30, deadline=None)
@given(gap=st.floats(0.05, 2.0), r=st.floats(0.0, 1.0))
def test_two_gauges_do_or_raise(gap, r):
    x = np.array([3.0, 3.0 + gap * LENGTH])
    eta = _two_waves(x, 0.05, r, 0.3)
    from_half = abs(gap - 0.5 * round(2.0 * gap))
    assume(abs(from_half - 0.032) > 0.002)  # the condition reaches its limit of 10 at 0.0317
    if from_half < 0.032:
        with pytest.raises(ValueError, match="cannot separate incident"):
            analysis.reflection(eta, x, TIMES, T, D)
    else:
        # As above, with a condition of 10 and a distance of 13 rad.
        found = analysis.reflection(eta, x, TIMES, T, D).coefficient
        assert found == pytest.approx(r, abs=1e-4)


def test_reflection_ignores_noise():
    noise = 0.002 * np.random.default_rng(0).standard_normal((3, TIMES.size))
    eta = _two_waves(GAUGES, 0.05, 0.2, 1.0) + noise
    # Noise of 4 % over 720 samples and a condition of 2: 0.04 sqrt(2/720) 2 = 0.4 %; 3 sigma.
    found = analysis.reflection(eta, GAUGES, TIMES, T, D).coefficient
    assert found == pytest.approx(0.2, abs=0.012)


def test_a_drift_and_an_oscillation_do_not_disturb_each_other():
    """Over three periods, the sine of a harmonic and a straight line are far from orthogonal."""
    t = np.linspace(0.0, 3.6, 181)
    y = 0.3 + 0.02 * t + 0.05 * np.sin(2 * np.pi / 1.2 * t + 0.4) + 0.01 * np.cos(4 * np.pi / 1.2 * t)
    rate = analysis.drift_rate(t, y, 1.2)
    assert rate == pytest.approx(0.02, rel=1e-9)
    assert abs(analysis.fundamental(t, y - rate * t, 1.2)) == pytest.approx(0.05, rel=1e-9)
    assert abs(abs(analysis.fundamental(t, y, 1.2)) - 0.05) > 0.003


def test_fundamental_of_several_series():
    t = np.linspace(0.0, 3 * T, 361)  # whole periods: mean and harmonics are orthogonal to the wave
    B = np.array([[2.0 + 1.0j, -0.3j], [0.0, -1.0]])
    wave = np.exp(1j * OMEGA * t)
    y = 0.7 + np.real(B[..., None] * wave) + 0.2 * np.cos(2 * OMEGA * t + 1.0)
    np.testing.assert_allclose(analysis.fundamental(t, y, T), B, atol=1e-12)
    assert analysis.fundamental(t, y[0, 0], T) == pytest.approx(B[0, 0])


def test_reflection_errors():
    eta = _two_waves(GAUGES, 0.05, 0.2, 0.0)
    with pytest.raises(ValueError, match="at least two"):
        analysis.reflection(eta[:1], GAUGES[:1], TIMES, T, D)
    with pytest.raises(ValueError, match="gauges, times"):
        analysis.reflection(eta, GAUGES[:2], TIMES, T, D)
    with pytest.raises(ValueError, match="cannot separate incident"):
        analysis.reflection(eta, [4.0, 4.0 + LENGTH / 2, 4.0 + LENGTH], TIMES, T, D)
    with pytest.raises(ValueError, match="shorter"):
        analysis.reflection(eta[:, :100], GAUGES, TIMES[:100], T, D)
    with pytest.raises(ValueError, match="samples per period"):
        analysis.reflection(eta[:, ::30], GAUGES, TIMES[::30], T, D)
    with pytest.raises(ValueError, match="increasing"):
        analysis.reflection(eta, GAUGES, TIMES[::-1], T, D)


# --- periods and efficiency


def test_whole_periods():
    mask = analysis.whole_periods(TIMES, T, 3)
    chosen = TIMES[mask]
    assert chosen[-1] == TIMES[-1]
    assert chosen[-1] - chosen[0] == pytest.approx(3 * T, abs=1e-9)  # 360 whole samples
    analysis.whole_periods(np.arange(0, 241, dtype=np.float32) * np.float32(0.01), T, 2)
    with pytest.raises(ValueError, match="shorter than 7"):
        analysis.whole_periods(TIMES, T, 7)
    with pytest.raises(ValueError, match="positive"):
        analysis.whole_periods(TIMES, T, 0)


def test_phase_average():
    t = np.arange(0.0, 12.0, 0.01)
    phase, mean, deviation = analysis.phase_average(t, np.sin(OMEGA * t) + 2.0, T, 24)
    # A bin is 2 pi / 24 wide: its mean is low by a factor 1 - 0.262^2 / 24 = 0.997.
    np.testing.assert_allclose(mean, 2.0 + np.sin(2.0 * np.pi * phase), atol=5e-3)
    assert np.all(deviation < 0.1)  # the uniform spread over a bin: 0.262 / sqrt(12)
    with pytest.raises(ValueError, match="empty"):
        analysis.phase_average(t[:100], t[:100], T, 40)


@settings(max_examples=30, deadline=None)
@given(xi=st.floats(0.0, 1.0), end=st.floats(4.0, 9.0), phase=st.floats(0.0, 6.3))
def test_efficiency_of_periodic_power(xi, end, phase):
    t = np.linspace(0.0, end, 900)
    power = xi * 13.0 * (1.0 - np.cos(2.0 * OMEGA * t + phase))
    result = analysis.efficiency(t, power, T, 13.0, 3)
    # Values at samples are taken as means over the intervals before them, and periods end between samples:
    # the mean of a period is off by a part of 2 omega dt^2 / T, at most a hundredth.
    assert result.xi == pytest.approx(xi, abs=1e-2 * max(xi, 0.1))
    np.testing.assert_allclose(result.per_period, xi, atol=1e-2)


@pytest.mark.parametrize("scatter", [0.003, 0.02, 0.1])
def test_settled_records_keep_almost_all_of_their_periods(scatter):
    rng = np.random.default_rng(0)
    left = [analysis.settled_from(0.25 * (1 + scatter * rng.normal(size=10))) for _ in range(400)]
    # at its level of significance, one record in 20 loses its first period or more
    assert np.mean(np.array(left) > 0) < 0.08 and np.mean(left) < 0.2


@pytest.mark.parametrize(("rise", "decay"), [(0.3, 0.4), (-0.3, 0.4), (1.0, 0.2), (0.1, 0.5)])
def test_transients_leave_means_without_bias(rise, decay):
    """Means of 20 periods with a transient and a scatter of 1 % have a bias below 0.3 of the scatter."""
    rng, periods = np.random.default_rng(1), np.arange(20)
    means, whole = [], []
    for _ in range(300):
        values = 1.0 + rise * decay**periods + 0.01 * rng.normal(size=20)
        means.append(values[analysis.settled_from(values) :].mean())
        whole.append(values.mean())
    assert abs(np.mean(means) - 1.0) < 0.003 < abs(np.mean(whole) - 1.0)


def test_settling_is_found_whatever_the_unit_and_of_exact_records():
    measured = np.array([0.3207, 0.2714, 0.2414, 0.2461, 0.2455, 0.2465, 0.2422, 0.2445, 0.2421, 0.2489])
    assert [analysis.settled_from(unit * measured) for unit in (1.0, 1e-9, 1e9)] == [2, 2, 2]
    assert analysis.settled_from([2.0, 1.0, 1.0, 1.0, 1.0, 1.0]) == 1
    assert analysis.settled_from(np.linspace(1.0, 2.0, 8)) == 5  # trend to the end: three periods left
    assert [analysis.settled_from(np.full(n, v)) for n in range(1, 7) for v in (0.0, 3.0)] == [0] * 12


def test_efficiency_is_exact_for_means_between_samples():
    """Periods may end between samples; the first sample has no interval before it and is not used."""
    t = np.array([0.0, 0.3, 0.9, 1.4, 2.1, 2.5])
    power = np.array([np.pi, 1.0, 2.0, 3.0, 4.0, 5.0])
    result = analysis.efficiency(t, power, 1.0, 2.0, 2)
    # 0.5 to 1.5 s: 0.4 of 2, 0.5 of 3, 0.1 of 4; 1.5 to 2.5 s: 0.6 of 4, 0.4 of 5; over P_inc
    np.testing.assert_allclose(result.per_period, [1.35, 2.2], rtol=1e-12)
    assert analysis.efficiency(t, np.ones(6), 1.25, 1.0, 2).xi == pytest.approx(1.0, rel=1e-12)
    assert analysis.efficiency(t, np.array([0.0, *np.ones(5)]), 1.25, 1.0, 2).xi == pytest.approx(1.0)
    with pytest.raises(ValueError, match="shorter"):
        analysis.efficiency(t, t, 1.0, 2.0, 3)
    with pytest.raises(ValueError, match="P_inc"):
        analysis.efficiency(t, t, 1.0, 0.0, 1)


# --- errors against a reference


def test_extrema_are_found_between_samples():
    t = np.linspace(0.0, 6.0, 301)
    found = analysis.extrema(t, 0.05 * np.cos(OMEGA * t))
    exact = 0.5 * T * np.arange(1, 10)
    # The parabola through points 0.105 rad apart: relative error of the value 0.105^4 / 24.
    np.testing.assert_allclose(found.t, exact, atol=1e-4)
    np.testing.assert_allclose(found.y, 0.05 * found.sign, rtol=1e-5)
    np.testing.assert_array_equal(found.sign, (-1) ** np.arange(1, 10))


@settings(max_examples=30, deadline=None)
@given(scale=st.floats(0.7, 1.3), shift=st.floats(-0.2, 0.2))
def test_mean_errors_of_a_scaled_and_delayed_wave(scale, shift):
    t_ref, t = np.linspace(0.0, 8.0, 801), np.linspace(0.5, 7.0, 521)
    eta_ref = 0.05 * np.cos(OMEGA * t_ref)
    eta = scale * 0.05 * np.cos(OMEGA * (t - shift * T))
    amplitude = analysis.mae_amplitude(t, eta, t_ref, eta_ref, 0.05, T)
    phase = analysis.mae_phase(t, eta, t_ref, eta_ref, T)
    # The parabolas' errors, as above, for both series.
    assert amplitude == pytest.approx(abs(scale - 1.0), abs=2e-5)
    assert phase == pytest.approx(abs(shift), abs=2e-4)


def test_smoothing_tames_noise():
    t = np.linspace(0.0, 8.0, 801)
    eta = 0.05 * np.cos(OMEGA * t)
    noisy = eta + 0.002 * np.random.default_rng(1).standard_normal(t.size)
    # Noise of 4 %, averaged over 21 points (weight 9/4/21 at the centre), leaves 1.3 %, and a bias of the
    # same size, because extrema select the largest noise.
    assert analysis.mae_amplitude(t, noisy, t, eta, 0.05, T, window=21) < 0.03
    assert analysis.mae_phase(t, noisy, t, eta, T, window=21) < 0.02


def test_pairing_errors():
    t = np.linspace(0.0, 8.0, 801)
    eta = 0.05 * np.cos(OMEGA * t)
    with pytest.raises(ValueError, match="no extremum"):
        analysis.mae_phase(t, t, t, eta, T)
    gap = np.where((t > 2.0) & (t < 5.5), 0.0, eta)
    with pytest.raises(ValueError, match="no (crest|trough) within"):
        analysis.mae_amplitude(t, gap, t, eta, 0.05, T)
    with pytest.raises(ValueError, match="is within T/2"):
        analysis.mae_phase(t + 100.0, eta, t, eta, T)


# --- decay


@settings(max_examples=25, deadline=None)
@given(
    offset=st.floats(-0.2, 0.2),
    decay_rate=st.floats(0.0, 0.6),
    omega=st.floats(2.0, 12.0),
    phase=st.floats(-3.0, 3.0),
)
def test_fit_recovers_a_damped_oscillation(offset, decay_rate, omega, phase):
    t = np.linspace(3.0, 9.0, 400)
    s = t - 3.0
    y = offset + 0.05 * np.exp(-decay_rate * s) * np.cos(omega * s + phase)
    found = analysis.fit_damped_oscillation(t, y)
    # The series is exact; the error is the optimiser's tolerance, 1e-8 in the cost.
    assert found.omega == pytest.approx(omega, abs=1e-4)
    assert found.decay_rate == pytest.approx(decay_rate, abs=1e-4)
    assert found.offset == pytest.approx(offset, abs=1e-5)
    assert found.amplitude == pytest.approx(0.05, abs=1e-5)
    assert found.phase == pytest.approx(phase, abs=1e-3)


def test_fit_errors():
    t = np.linspace(0.0, 6.0, 300)
    with pytest.raises(ValueError, match="the series is constant"):
        analysis.fit_damped_oscillation(t, np.full(300, 0.3))
    with pytest.raises(ValueError, match="less than half"):
        analysis.fit_damped_oscillation(t, np.random.default_rng(2).standard_normal(300))


def test_oscillation_period():
    t = np.linspace(0.0, 10.0, 1001)
    # Errors: linear interpolation of the crossings, and a mean over a part of a period at the end.
    assert analysis.oscillation_period(t, 3.0 + np.sin(OMEGA * t)) == pytest.approx(T, rel=1e-3)
    with pytest.raises(ValueError, match="crossings"):
        analysis.oscillation_period(t, t)


@given(
    decay=st.floats(-0.02, 0.1),
    reflection=st.floats(0.0, 0.1),
    phase=st.floats(0.0, 6.0),
    shift=st.floats(-0.02, 0.02),
)
@settings(max_examples=25, deadline=None)
def test_decay_per_wavelength_beside_a_reflected_wave(decay, reflection, phase, shift):
    x, wavelength = np.linspace(1.0, 5.6, 12), 2.048
    k, along = 2 * np.pi / wavelength, x - x[0]
    incident = (
        np.exp(1j * phase) * (1 - decay) ** (along / wavelength) * np.exp(-1j * k * (1 + shift) * along)
    )
    amplitude = 0.05 * (incident + reflection * np.exp(1j * k * along))
    # the error is the tolerance of the search, 1e-8 of the cost
    assert analysis.decay_per_wavelength(x, amplitude, wavelength) == pytest.approx(decay, abs=1e-5)


def test_decay_per_wavelength_refuses_what_has_none():
    x = np.linspace(0.0, 6.0, 7)
    with pytest.raises(
        ValueError, match="the largest amplitude is 0 m: give finite amplitudes, not all zero"
    ):
        analysis.decay_per_wavelength(x, 0.0 * x, 1.0)
    with pytest.raises(ValueError, match="four or more positions"):
        analysis.decay_per_wavelength([1.0], [1.0], 1.0)


# --- energy budget


@pytest.mark.parametrize("kept", [(), ("loss_viscous",), ("power_sponge", "loss_viscous", "loss_other")])
def test_a_budget_lists_the_losses_that_a_run_has(kept):
    t = np.linspace(0.0, 2.0, 21)
    series = {"time": t, **{name: 0.0 * t for name in ("kinetic", "potential", "compression")}}
    series |= {"power_paddle": np.ones_like(t), **{name: np.full_like(t, 0.25) for name in kept}}
    budget = analysis.energy_budget(series)
    losses = {name.split("_")[1] for name in kept}
    assert set(budget) == {"paddle", "stored", "pto", "residual", "residual_share"} | losses
    assert all(budget[name] == pytest.approx(0.5) for name in losses)
    assert budget["residual"] == pytest.approx(2.0 - 0.5 * len(losses))
