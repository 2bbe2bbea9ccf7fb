"""Waves, compared with their equations, with tables in double precision, and with each other."""

import csv
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import fsolve

from jaxsph.parts.sponge import Sponge, SpongeLayer
from jaxsph.waves import theory
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.near_field import near_field_ratio
from jaxsph.waves.regular import RegularWaves, SecondOrderPiston, second_order_piston

DATA = Path(__file__).parent / "data"
G = 9.81
EPS = float(jnp.finfo(jnp.float32).eps)


def _columns(name):
    with open(DATA / name, newline="") as file:
        rows = list(csv.DictReader(file))
    return {key: [row[key] for row in rows] for key in rows[0]}


TABLE = {k: np.array(v, float) for k, v in _columns("wave_table.csv").items() if k != "case"}
T, D, H, K = (TABLE[c] for c in ("T_s", "d_m", "H_m", "k_1_per_m"))
OMEGA = 2.0 * np.pi / T
# The tables have six digits (relative error up to 5e-6); float32 adds a few ulp of 1e-7.
TABLE_RTOL = 6e-6

wavenumber = jax.jit(theory.wavenumber)
wavenumber_slopes = jax.jit(jax.grad(theory.wavenumber, argnums=(0, 1)))
elevation = jax.jit(theory.stokes2_elevation)
velocity = jax.jit(theory.stokes2_velocity)

REGULAR = RegularWaves(H=0.1, T=1.2, d=0.5, ramp=2.4)
SECOND = RegularWaves(0.1, 1.2, 0.5, ramp=2.4, correction=SecondOrderPiston())
paddle = jax.jit(lambda w, t: (w.paddle_displacement(t), w.paddle_velocity(t), w.paddle_elevation(t)))
paddle_speed = jax.jit(lambda a, w, X, t, eta: a.velocity(w, X, t, eta))
sponge_factor = jax.jit(lambda sponge, x, dt: sponge.factor(x[:, None], dt))
dk_domega = jax.jit(jax.grad(theory.wavenumber))


def _dispersion64(omega, d, g=G):
    """Bisection in double precision, independent of the package."""
    low, high = 0.0, omega**2 / g + omega / np.sqrt(g * d)
    for _ in range(200):
        k = 0.5 * (low + high)
        low, high = (k, high) if g * k * np.tanh(k * d) < omega**2 else (low, k)
    return k


# --- linear theory


@pytest.mark.parametrize(
    ("computed", "column"),
    [
        (lambda: theory.wavenumber(OMEGA, D), "k_1_per_m"),
        (lambda: theory.wavelength(T, D), "lambda_m"),
        (lambda: theory.group_velocity(OMEGA, D), "cg_m_per_s"),
        (lambda: theory.biesel(K, D), "Biesel_H_over_S0"),
        (lambda: theory.incident_power(H, T, D), "P_inc_W_per_m_rho1000"),
        (lambda: theory.stokes2_elevation(0.0, 0.0, H, T, D), "crest_m"),
        (lambda: theory.stokes2_elevation(0.0, T / 2, H, T, D), "trough_m"),
    ],
)
def test_table(computed, column):
    np.testing.assert_allclose(np.abs(computed()), np.abs(TABLE[column]), rtol=TABLE_RTOL)


def test_table_second_order_piston():
    # The bracket is a difference of nearly equal terms, the first of order (kd)^-3: errors of the table's
    # digits and of 10 roundings are relative to the larger terms.
    e2 = second_order_piston(H, theory.wavenumber(OMEGA, D), D)
    expected = TABLE["madsen_e2_amp_m_unverified"]
    term = H**2 / (16.0 * D * TABLE["Biesel_H_over_S0"])
    assert np.all(np.abs(e2 - expected) < TABLE_RTOL * np.abs(expected) + 10 * EPS * term)


@settings(max_examples=60, deadline=None)
@given(kd=st.floats(0.05, 20.0), d=st.floats(0.05, 50.0))
def test_wavenumber_solves_dispersion(kd, d):
    omega = np.float32(np.sqrt(G * kd / d * np.tanh(kd)))
    d = np.float32(d)
    exact = _dispersion64(float(omega), float(d))
    # 1e-6, as the docstring states, is eight roundings of float32.
    assert float(wavenumber(omega, d)) == pytest.approx(exact, rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(kd=st.floats(0.05, 20.0), d=st.floats(0.1, 10.0))
def test_wavenumber_derivatives(kd, d):
    omega = np.sqrt(G * kd / d * np.tanh(kd))
    by_omega, by_d = wavenumber_slopes(omega, d)
    # dk/domega = 1 / c_g; dk/dd from the implicit function theorem, in double precision.
    sinh2 = np.sinh(2.0 * kd)
    exact_omega = 2.0 * kd / d / (omega * (1.0 + 2.0 * kd / sinh2))
    exact_d = -((kd / d) ** 2) / (np.sinh(kd) * np.cosh(kd) + kd)
    # 20 roundings in powers and quotients of k, and 2 kd roundings of the exponent.
    assert float(by_omega) == pytest.approx(exact_omega, rel=20 * EPS)
    assert float(by_d) == pytest.approx(exact_d, rel=(20 + 4 * kd) * EPS)


def test_wavenumber_second_derivative():
    # Compared with a central difference of the exact first derivative: relative error of order step^2 = 1e-4,
    # and rounding EPS / step = 1e-5.
    slope, step = dk_domega, 1e-2
    difference = (slope(5.0 + step, 0.5) - slope(5.0 - step, 0.5)) / (2 * step)
    assert float(jax.jit(jax.grad(slope))(5.0, 0.5)) == pytest.approx(float(difference), rel=5e-4)


def test_group_velocity_is_slope_of_dispersion():
    speed = theory.group_velocity(5.0, 0.5)
    slope = dk_domega(5.0, 0.5)
    assert float(speed * slope) == pytest.approx(1.0, rel=10 * EPS)  # two divisions, tanh


def test_deep_water_does_not_overflow():
    # sinh(kd) overflows float32 at kd = 89: here kd is 400.
    grad = jax.grad(lambda k: theory.biesel(k, 1.0))(400.0)
    assert float(theory.biesel(400.0, 1.0)) == pytest.approx(2.0, rel=2 * EPS)
    assert np.isfinite(grad)
    assert np.all(np.isfinite(velocity(0.0, 400.0, 0.0, 0.01, 1.0, 400.0)))


# --- Stokes


def test_stokes2_series():
    data = _columns("stokes2_T1.2_H0.1_d0.5_one_period.csv")
    data = {key: np.array(value, float) for key, value in data.items()}
    t = 1.2 * data["t_over_T"]
    # Seven digits of 0.05 m, and the phase's rounding, 2 pi EPS times 0.05 m.
    np.testing.assert_allclose(elevation(0.0, t, 0.1, 1.2, 0.5), data["eta_stokes2_m"], atol=1e-7)
    # A thousandth of the height leaves the second order below 1e-3 of the first.
    small = velocity(0.0, 0.5, t, 1e-4, 1.2, 0.5)[:, 0] * 1e3
    linear = data["u_surface_z0_linear_m_per_s"]
    np.testing.assert_allclose(small, linear, atol=1e-3 * np.max(linear))


@pytest.mark.parametrize("H", [0.02, 0.05])
def test_stokes3_wavenumber_is_that_of_the_full_equations(H):
    T, d = 1.2, 0.5
    linear = float(wavenumber(2.0 * np.pi / T, d))
    exact = _steady_wavenumber(H, T, d) / linear - 1.0
    # terms beyond third order are smaller by a factor of about (kH/2)^2, 0.6 % at the larger height; float32
    # gives the difference to 1e-6
    allowed = 4.0 * (linear * H / 2.0) ** 2 * abs(exact) + 1e-6
    assert float(theory.stokes3_wavenumber(H, T, d)) / linear - 1.0 == pytest.approx(exact, abs=allowed)


def _steady_wavenumber(H, T, d, modes=10):
    """Wavenumber of a steady wave without mass transport, by the series of Rienecker and Fenton (1981)."""
    omega, phase, j = 2.0 * np.pi / T, np.pi * np.arange(modes + 1) / modes, np.arange(1, modes + 1)

    def residual(y):
        eta, B, (k, mean, flow, head) = y[: modes + 1], y[modes + 1 : -4], y[-4:]
        z, around = j * k * eta[:, None], j * phase[:, None]
        rise, run = np.sinh(z) / np.cosh(j * k * d), np.cosh(z) / np.cosh(j * k * d)
        stream = (B * rise * np.cos(around)).sum(axis=1) - mean * eta + flow
        u = (j * k * B * run * np.cos(around)).sum(axis=1) - mean
        w = (j * k * B * rise * np.sin(around)).sum(axis=1)
        level = (0.5 * (eta[0] + eta[-1]) + eta[1:-1].sum()) / modes - d
        rest = [level, eta[0] - eta[-1] - H, flow - omega / k * d]
        return np.concatenate([stream, 0.5 * (u**2 + w**2) + G * eta - head, rest])

    k = float(wavenumber(omega, d))
    c = omega / k
    first = [0.5 * H * G / omega, *np.zeros(modes - 1), k, c, c * d, 0.5 * c**2 + G * d]
    y, _, found, _ = fsolve(residual, [*(d + 0.5 * H * np.cos(phase)), *first], full_output=True, xtol=1e-12)
    assert found == 1
    return y[-4]


def test_stokes2_velocity_laws():
    """Incompressible and irrotational, no flow through the bed, and the kinematic surface condition."""
    at = partial(velocity, H=0.1, T=1.2, d=0.5)
    x, z, t = 0.3, 0.35, 0.2
    (du_dx, dw_dx), (du_dz, dw_dz) = jax.jit(jax.jacfwd(at, argnums=(0, 1)))(x, z, t)
    # Gradients are of order 1 /s: a few roundings.
    assert float(du_dx + dw_dz) == pytest.approx(0.0, abs=20 * EPS)
    assert float(du_dz - dw_dx) == pytest.approx(0.0, abs=20 * EPS)
    assert float(at(x, 0.0, t)[1]) == 0.0

    @jax.jit
    def kinematic_residual(H):
        """Largest residual |eta_t + u eta_x - w| at the surface over a period."""

        def one(t):
            eta = partial(theory.stokes2_elevation, H=H, T=1.2, d=0.5)
            u, w = theory.stokes2_velocity(x, 0.5 + eta(x, t), t, H, 1.2, 0.5)
            return jax.grad(eta, 1)(x, t) + u * jax.grad(eta, 0)(x, t) - w

        return jnp.max(jnp.abs(jax.vmap(one)(jnp.linspace(0.0, 1.2, 48))))

    # A second-order theory leaves a third-order residual: halving H divides it by 8.
    # 10 % is the share of the fourth order at kA = 0.06.
    ratio = float(kinematic_residual(0.04) / kinematic_residual(0.02))
    assert ratio == pytest.approx(8.0, rel=0.1)


# --- piston


def test_second_order_piston_conserves_mass():
    """Madsen's e2 from the balance at the paddle, (d + eta(X)) dX/dt = c eta(X).

    A wave of permanent form carries the flux c eta. At second order and without the near field, the balance
    gives e2 = eta2 / (2 k d) - (H^2/4) / (2 d Phi). This is exact as kd -> 0, and Madsen's formula must
    approach it faster than its own second term.
    """
    kd = np.array([0.4, 0.2, 0.1])
    k, height = kd / 0.5, 0.01
    Phi = 4 * np.sinh(kd) ** 2 / (2 * kd + np.sinh(2 * kd))
    eta2 = height**2 * k / 16 * np.cosh(kd) * (2 + np.cosh(2 * kd)) / np.sinh(kd) ** 3
    balance = eta2 / (2 * kd) - height**2 / (8 * 0.5 * Phi)
    second_term = height**2 / (16 * 0.5 * Phi)
    gap = np.abs(second_order_piston(height, k, 0.5) - balance) / second_term
    assert np.all(gap < 1.0 * kd**2)  # the next order of the expansion; its factor is 2/3
    # Without the second term, or with twice it, the gap would be 1 at every kd.
    assert gap[-1] < 0.02


def test_paddle_moves_as_told():
    t = jnp.linspace(0.0, 6.0, 601)
    X, U, eta = paddle(REGULAR, t)
    assert float(X[0]) == 0.0 and float(U[0]) == 0.0
    # Once the ramp is over U = (omega / Phi) eta; 1e-5 is the rounding of omega t = 30.
    after = t > 2.4
    np.testing.assert_allclose(
        U[after], (REGULAR.omega / REGULAR.Phi * eta)[after], atol=1e-5 * float(jnp.max(U))
    )
    # Velocity = slope of the displacement: trapezoidal rule, error (omega dt)^2 / 12 = 2e-4.
    steps = 0.5 * (U[1:] + U[:-1]) * 0.01
    np.testing.assert_allclose(jnp.cumsum(steps), X[1:] - X[0], atol=1e-3 * float(jnp.max(X)))


def test_paddle_is_elementwise_and_differentiable():
    t = jnp.array([0.1, 1.0, 5.0])
    by_map = jax.jit(jax.vmap(lambda t: SECOND.paddle_velocity(t)))(t)
    np.testing.assert_allclose(paddle(SECOND, t)[1], by_map, rtol=1e-5, atol=1e-7)  # reordering
    gradient = jax.jit(jax.grad(lambda w: w.paddle_displacement(1.7)))(SECOND)
    step = 1e-2  # central difference: rounding EPS / step = 1e-5, truncation of order 1e-3
    plus, minus = (
        RegularWaves(0.1, 1.2 + s * step, 0.5, ramp=2.4, correction=SECOND.correction) for s in (1, -1)
    )
    slope = (paddle(plus, 1.7)[0] - paddle(minus, 1.7)[0]) / (2 * step)
    assert float(gradient.T) == pytest.approx(float(slope), rel=5e-3)
    assert np.all(np.isfinite(jax.tree.leaves(gradient)))


def test_no_ramp_starts_at_once_with_finite_gradient():
    w = RegularWaves(0.1, 1.2, 0.5)
    assert float(w.paddle_elevation(0.0)) == pytest.approx(0.05)
    gradient = jax.jit(jax.grad(lambda w: w.paddle_velocity(0.0)))(w)
    assert np.all(np.isfinite(jax.tree.leaves(gradient)))


def test_correction_is_madsens():
    t = jnp.linspace(3.0, 6.0, 50)
    difference = paddle(SECOND, t)[0] - paddle(REGULAR, t)[0]
    e2 = second_order_piston(0.1, SECOND.k, 0.5)
    # A difference of displacements of 0.035 m: their rounding, EPS times 0.035 m.
    np.testing.assert_allclose(difference, e2 * jnp.sin(2 * SECOND.omega * t), atol=2e-8)


def test_elevation_is_phase_locked():
    t = jnp.linspace(3.0, 6.0, 50)
    linear = RegularWaves(1e-4, 1.2, 0.5)  # second order below 1e-4 of the first
    np.testing.assert_allclose(linear.elevation(0.0, t), linear.paddle_elevation(t), atol=2e-4 * 0.5e-4)


# --- near field and absorption


def _piston_modes(x, omega, d, n=2000):
    """Elevation per displacement of a piston, from a solution of the linear problem on a grid.

    phi is a sum over vertical modes, whose coefficients are a least-squares fit of the condition at the
    paddle; the closed-form integrals are not used.
    """
    y = omega**2 * d / G
    roots = []
    for i in range(1, 41):
        low, high = (i - 0.5) * np.pi + 1e-12, i * np.pi
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if -middle * np.tan(middle) > y else (low, middle)
        roots.append(low / d)
    k0, kn = _dispersion64(omega, d), np.array(roots)
    z = (np.arange(n) + 0.5) * d / n
    cosh0 = np.cosh(k0 * z) / np.cosh(k0 * d)
    modes = np.concatenate([[cosh0], np.cos(kn[:, None] * z)]).T
    # Potential per unit displacement X = exp(i omega t): phi_x = i omega at x = 0.
    fit = np.linalg.lstsq(modes, np.full(n, 1j * omega), rcond=None)[0]
    phi = fit / -np.concatenate([[1j * k0], kn])
    eta = -1j * omega / G * phi * np.concatenate([[1.0], np.cos(kn * d)])
    return eta[0], np.sum(eta[1:] * np.exp(-kn * x))


def test_near_field_and_biesel_solve_the_piston_problem():
    omega, d, x = 2 * np.pi / 1.2, 0.5, 0.06
    progressive, near = _piston_modes(x, omega, d)
    # The fit on 2000 points replaces the integrals, with an error of order 1e-5.
    assert progressive == pytest.approx(1j * float(theory.biesel(REGULAR.k, d)), rel=1e-4)
    assert near == pytest.approx(near_field_ratio(x, omega, d), rel=1e-3)
    assert near.real > 0.0


def _reading(w, absorption, t):
    """Linear elevation of the target waves at the gauge: progressive wave and near field."""
    eta = 0.5 * w.H * jnp.cos(w.omega * t - w.k * absorption.distance)
    return eta + absorption.near_field * paddle(w, t)[0]


def test_absorption_leaves_the_target_wave_alone():
    absorption = ActiveAbsorption.at_gauge(REGULAR, 0.06, drift_rate=0.05)
    t = jnp.linspace(3.0, 6.0, 60)
    X, U, _ = paddle(REGULAR, t)
    speed = paddle_speed(absorption, REGULAR, X, t, _reading(REGULAR, absorption, t))
    np.testing.assert_allclose(speed, U, atol=1e-5)  # m/s; rounding of omega t = 30 rad


def test_default_absorption_is_equation_23():
    t, measured = jnp.linspace(3.0, 6.0, 60), 0.013
    X, _, eta = paddle(REGULAR, t)
    speed = paddle_speed(ActiveAbsorption(), REGULAR, X, t, measured)
    printed = REGULAR.omega / REGULAR.Phi * (2.0 * eta - measured)
    np.testing.assert_allclose(speed, printed, atol=1e-5)  # m/s; rounding of omega t = 30 rad


def test_drift_term_returns_the_paddle():
    absorption = ActiveAbsorption(gain=0.0, drift_rate=0.1)
    X, U, _ = paddle(REGULAR, 4.0)
    speed = paddle_speed(absorption, REGULAR, X + 0.02, 4.0, 0.0)
    assert float(speed - U) == pytest.approx(-0.1 * 0.02, abs=1e-6)  # rounding of U = 0.2 m/s


def test_second_order_target_is_what_the_gauge_reads():
    absorption = ActiveAbsorption(distance=0.06)
    t = jnp.linspace(3.0, 6.0, 60)
    # The Stokes wave itself is not taken for a reflection; rounding of phases of 60 rad.
    np.testing.assert_allclose(absorption.gauge_elevation(SECOND, t), SECOND.elevation(0.06, t), atol=1e-6)


def _residual_reflection(absorption, waves, filter_time=0.0):
    """Reflection coefficient of the paddle for an arriving wave (-), by closing the loop through the gauge.

    An arriving wave of amplitude 1 doubles at the fixed paddle; the paddle's motion adds a progressive wave b
    and its own near field -i near_field b / Phi. `filter_time` (s): time constant of a first-order filter on
    the feedback.
    """
    omega, k, Phi = (float(v) for v in (waves.omega, waves.k, waves.Phi))
    phase = k * float(absorption.distance)
    gain = float(absorption.gain) / (1.0 + 1j * omega * float(filter_time))
    loop = gain * (np.exp(-1j * phase) - 1j * float(absorption.near_field) / Phi)
    return abs(1.0 - 2.0 * gain * np.cos(phase) / (1.0 + loop))


def test_residual_reflection():
    # A gauge at the paddle without near field absorbs all; without gain it is a wall.
    assert _residual_reflection(ActiveAbsorption(), REGULAR) == pytest.approx(0, abs=EPS)
    assert _residual_reflection(ActiveAbsorption(0.0), REGULAR) == pytest.approx(1)
    # Close the loop through `velocity`: an arriving wave cos(omega t + k x), doubled at the paddle, and the
    # response Re(b exp(i omega t)) of the paddle with its near field. The commanded motion must equal the
    # paddle's motion, which is a linear equation for b.
    absorption = ActiveAbsorption.at_gauge(REGULAR, 0.06)
    t = np.linspace(3.0, 4.2, 25)
    X, U, _ = paddle(REGULAR, t)
    omega, k, Phi = (float(v) for v in (REGULAR.omega, REGULAR.k, REGULAR.Phi))
    turn, lag = np.exp(1j * omega * t), np.exp(-1j * k * 0.06)

    def excess(arriving, b):
        """Commanded velocity of the paddle minus its actual velocity, m/s."""
        share = 2 * arriving * np.cos(k * 0.06) + b * (lag - 1j * absorption.near_field / Phi)
        eta = _reading(REGULAR, absorption, t) + np.real(share * turn)
        told = paddle_speed(absorption, REGULAR, X, t, eta) - U
        return np.asarray(told) - omega / Phi * np.real(b * turn)

    columns = np.stack([excess(0.0, 1.0), excess(0.0, 1j)], axis=-1)
    re, im = np.linalg.lstsq(columns, -excess(1.0, 0.0), rcond=None)[0]
    # Float32 phases of 20 rad: 20 EPS, and twice that for the division.
    residual = _residual_reflection(absorption, REGULAR)
    assert residual == pytest.approx(abs(1 + re + 1j * im), abs=60 * EPS)
    # The filter removes the phase to first order; the remainder is of the order of its square, 0.29^2.
    filtered = _residual_reflection(absorption, REGULAR, absorption.filter_time(REGULAR))
    assert filtered < 0.29**2 < residual


def test_sponge():
    sponge = Sponge((SpongeLayer(6.0, 8.0),))
    x = jnp.array([5.0, 6.0, 7.0, 8.0, 8.5])
    # Eq. 28 by hand; a few roundings.
    np.testing.assert_allclose(
        sponge_factor(sponge, x, 1e-3), [1.0, 1.0, 1 - 0.0025, 1 - 0.01, 1.0], rtol=2 * EPS
    )
    assert float(sponge_factor(sponge, x, 1.0)[3]) == 0.0  # clipped, not reversed
    assert np.all(
        np.isfinite(jax.jit(jax.grad(lambda s: jnp.sum(s.factor(x[:, None], 1e-3))))(sponge).strength)
    )


# --- limits


@pytest.mark.parametrize(
    ("H", "T", "d", "words"),
    [
        (0.1, 1.2, 0.5, []),
        (0.4, 1.2, 0.5, ["steepness", "H/d"]),
        (0.2, 4.0, 0.5, ["Ursell"]),
        (0.02, 0.6, 0.5, ["exceeds pi"]),
        (0.01, 8.0, 0.5, ["below pi/10"]),
    ],
)
def test_theory_limits(H, T, d, words):
    warnings = theory.theory_limits(H, T, d)
    for word in words:
        assert any(word in warning for warning in warnings)
    assert bool(warnings) == bool(words)


def test_no_wave_of_the_theory_asks_for_a_larger_stroke():
    """For all periods and heights that `theory_limits` accepts; the largest stroke is within 0.5 % of it."""
    d, largest = 0.42, 0.0
    for kd in [1.007, *np.linspace(0.32, 3.1, 30)]:
        T = 2 * np.pi / np.sqrt(G * kd / d * np.tanh(kd))
        low, high = 0.0, d
        for _ in range(12):
            H = 0.5 * (low + high)
            low, high = (low, H) if theory.theory_limits(H, T, d) else (H, high)
        largest = max(largest, low / float(theory.biesel(kd / d, d)))
    assert 0.995 * theory.largest_stroke(d) < largest <= theory.largest_stroke(d)
