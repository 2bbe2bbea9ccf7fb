"""Water waves on constant depth: theory, the piston that makes them, and their absorption.

Linear and second-order Stokes waves, the transfer function of a piston wavemaker with
its second-order correction, active absorption at the paddle and a sponge layer at the
far end. Equation numbers are those of Zhu et al. (2020) unless another source is named.

Conventions: SI units; x from the paddle's rest position, positive into the tank; z from
the BED, so that z = d is the still water level; a crest passes x = 0 at t = 0. The
paddle's displacement X is positive into the tank, and a paddle velocity
U = (omega / Phi) eta makes the progressive elevation eta (Phi: `biesel`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

Scalar = Float[Array, ""]

GRAVITY = 9.81
"""Acceleration of gravity, m/s2."""

_EVANESCENT_MODES = 200
_URSELL_LIMIT = 8.0 * np.pi**2 / 3.0


def _scalar(value: ArrayLike) -> Scalar:
    """A float array leaf of the default precision, so that it can be traced."""
    return jnp.asarray(value, float)


# --- linear theory -----------------------------------------------------------------


def _sech2(x: Array) -> Array:
    """sech^2 x, which 1 - tanh^2 x loses to rounding from x = 4 on."""
    e = jnp.exp(-2.0 * x)
    return 4.0 * e / (1.0 + e) ** 2


@jax.custom_jvp
def _solve_dispersion(omega: Array, d: Array, g: Array) -> Array:
    """k such that omega^2 = g k tanh kd.

    The explicit start of Guo (2002) is within 0.8 %; each Newton step squares the
    error, so that three reach the rounding of float32 and nearly that of float64.
    """
    y = omega**2 * d / g
    kd = y / (-jnp.expm1(-(y**1.25))) ** 0.4
    for _ in range(3):
        sigma = jnp.tanh(kd)
        kd = kd - (kd * sigma - y) / (sigma + kd * _sech2(kd))
    return kd / d


@_solve_dispersion.defjvp
def _solve_dispersion_jvp(primals, tangents):
    # The implicit function theorem: exact at the root, whatever the iteration did, and
    # it is itself differentiable.
    (omega, d, g), (omega_dot, d_dot, g_dot) = primals, tangents
    k = _solve_dispersion(omega, d, g)
    sech2 = _sech2(k * d)
    forcing = (2.0 * omega * omega_dot - omega**2 / g * g_dot) / g
    return k, (forcing - k**2 * sech2 * d_dot) / (jnp.tanh(k * d) + k * d * sech2)


def wavenumber(omega: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY) -> Float[Array, "..."]:
    """Wavenumber k (rad/m) of linear waves: omega^2 = g k tanh(k d).

    `omega` (rad/s, > 0) and the depth `d` (m, > 0) broadcast. The relative error in
    float32 is under 1e-6 for kd from 0.05 to 20; derivatives of any order are exact.
    """
    arguments = (jnp.asarray(value, float) for value in (omega, d, g))
    return _solve_dispersion(*jnp.broadcast_arrays(*arguments))


def wavelength(T: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY) -> Float[Array, "..."]:
    """Linear wavelength lambda (m) of period `T` (s) on depth `d` (m)."""
    return 2.0 * jnp.pi / wavenumber(2.0 * jnp.pi / jnp.asarray(T, float), d, g)


def _x_over_sinh(x: Array) -> Array:
    """x / sinh x for x > 0, in a form that overflows neither here nor in its derivative."""
    return 2.0 * x * jnp.exp(-x) / -jnp.expm1(-2.0 * x)


def group_velocity(omega: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY) -> Float[Array, "..."]:
    """Linear group velocity (m/s): (omega / 2k) (1 + 2kd / sinh 2kd)."""
    k = wavenumber(omega, d, g)
    return 0.5 * omega / k * (1.0 + _x_over_sinh(2.0 * k * d))


def incident_power(
    H: ArrayLike, T: ArrayLike, d: ArrayLike, rho0: ArrayLike = 1000.0, g: ArrayLike = GRAVITY
) -> Float[Array, "..."]:
    """Mean wave power per metre of crest (W/m), Eq. 26, with A_i = H / 2.

    `H` wave height (m), `T` period (s), `d` depth (m), `rho0` density (kg/m3).
    """
    A = 0.5 * jnp.asarray(H, float)
    omega = 2.0 * jnp.pi / jnp.asarray(T, float)
    return 0.5 * rho0 * g * A**2 * group_velocity(omega, d, g)


def biesel(k: ArrayLike, d: ArrayLike) -> Float[Array, "..."]:
    """Transfer function Phi = H / S0 of a piston wavemaker (-), Eq. 22.

    `k` (rad/m), `d` (m); S0 is the stroke, crest to trough. Written as
    2 tanh kd / (1 + 2kd / sinh 2kd), which is the same and does not overflow.
    """
    kd = jnp.asarray(k, float) * d
    return 2.0 * jnp.tanh(kd) / (1.0 + _x_over_sinh(2.0 * kd))


# --- second-order Stokes waves ---------------------------------------------------------


def _stokes2_amplitude(H: Array, k: Array, d: Array) -> Array:
    """Amplitude of the bound second harmonic (m).

    (H^2 k / 16) cosh kd (2 + cosh 2kd) / sinh^3 kd, in terms of tanh kd.
    """
    sigma = jnp.tanh(k * d)
    return H**2 * k / 16.0 * (3.0 - sigma**2) / sigma**3


def stokes2_elevation(
    x: ArrayLike,
    t: ArrayLike,
    H: ArrayLike,
    T: ArrayLike,
    d: ArrayLike,
    g: ArrayLike = GRAVITY,
) -> Float[Array, "..."]:
    """Elevation eta (m) of a second-order Stokes wave travelling along +x.

    `x` (m) and `t` (s) broadcast; a crest is at x = 0, t = 0. Source: Dean and
    Dalrymple (1991), section 11.2; the mean level is the still water level.
    """
    x, t, H = jnp.asarray(x, float), jnp.asarray(t, float), jnp.asarray(H, float)
    omega = 2.0 * jnp.pi / jnp.asarray(T, float)
    k = wavenumber(omega, d, g)
    theta = k * x - omega * t
    return 0.5 * H * jnp.cos(theta) + _stokes2_amplitude(H, k, d) * jnp.cos(2.0 * theta)


def stokes2_velocity(
    x: ArrayLike,
    z: ArrayLike,
    t: ArrayLike,
    H: ArrayLike,
    T: ArrayLike,
    d: ArrayLike,
    g: ArrayLike = GRAVITY,
) -> Float[Array, "..."]:
    """Velocity (u, w) [..., 2] (m/s) of the wave of `stokes2_elevation`; z (m) from the bed.

    Zero Eulerian mean below the troughs (no return current). Source: Dean and Dalrymple
    (1991), section 11.2. The ratios of hyperbolic functions are written with decaying
    exponentials, which do not overflow.
    """
    x, z, t = jnp.asarray(x, float), jnp.asarray(z, float), jnp.asarray(t, float)
    H = jnp.asarray(H, float)
    omega = 2.0 * jnp.pi / jnp.asarray(T, float)
    k = wavenumber(omega, d, g)
    theta = k * x - omega * t
    bed = -jnp.expm1(-2.0 * k * d)
    first = 0.5 * H * omega * jnp.exp(k * (z - d)) / bed
    second = 1.5 * H**2 * omega * k * jnp.exp(2.0 * k * (z - 2.0 * d)) / bed**4
    e2, e4 = jnp.exp(-2.0 * k * z), jnp.exp(-4.0 * k * z)
    u = first * (1.0 + e2) * jnp.cos(theta) + second * (1.0 + e4) * jnp.cos(2.0 * theta)
    w = first * (1.0 - e2) * jnp.sin(theta) + second * (1.0 - e4) * jnp.sin(2.0 * theta)
    return jnp.stack([u, w], axis=-1)


# --- the piston wavemaker --------------------------------------------------------------


def second_order_piston(H: ArrayLike, k: ArrayLike, d: ArrayLike) -> Float[Array, "..."]:
    """Amplitude e2 (m) of the second harmonic of a piston's displacement, Madsen (1971).

    With X = (S0 / 2) sin(omega t) + e2 sin(2 omega t) the paddle radiates (nearly) no
    free second harmonic. e2 = (H^2 / 32 d) (3 cosh kd / sinh^3 kd - 2 / Phi). Valid for
    an Ursell number H lambda^2 / d^3 below 8 pi^2 / 3, best in shallow water.
    """
    H, kd = jnp.asarray(H, float), jnp.asarray(k, float) * d
    sigma = jnp.tanh(kd)
    return H**2 / (32.0 * d) * (3.0 * _sech2(kd) / sigma**3 - 2.0 / biesel(k, d))


def near_field_ratio(x: float, omega: float, d: float, g: float = GRAVITY) -> float:
    """Evanescent elevation at distance x over the piston's displacement (-); host numpy.

    Linear theory of a piston U = dX/dt: besides the progressive wave,
    eta = X(t) sum_n C_n exp(-k_n x), C_n = 4 sin^2(k_n d) / (2 k_n d + sin 2 k_n d),
    with the roots of omega^2 = -g k_n tan(k_n d). C_n > 0: the near field is in phase
    with the displacement, a quarter period behind the progressive wave at the paddle.
    """
    y = omega**2 * d / g
    n = np.arange(1, _EVANESCENT_MODES + 1)
    kd = n * np.pi
    for _ in range(60):  # a contraction: the slope y / (y^2 + kd^2) is under 1 / pi
        kd = n * np.pi - np.arctan(y / kd)
    C = 4.0 * np.sin(kd) ** 2 / (2.0 * kd + np.sin(2.0 * kd))
    return float(np.sum(C * np.exp(-kd * x / d)))


class SecondOrderPiston(eqx.Module):
    """Second-order wave generation: Madsen's (1971) motion and the bound harmonic.

    Held by `RegularWaves.correction`; `None` there is first-order generation.
    """

    def displacement(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """Correction of the paddle's displacement (m), without ramp."""
        e2 = second_order_piston(waves.H, waves.k, waves.d)
        return e2 * jnp.sin(2.0 * waves.omega * jnp.asarray(t, float))

    def elevation(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """Bound second harmonic of the elevation at x = 0 (m), without ramp."""
        eta2 = _stokes2_amplitude(waves.H, waves.k, waves.d)
        return eta2 * jnp.cos(2.0 * waves.omega * jnp.asarray(t, float))


class RegularWaves(eqx.Module):
    """Regular waves made by a piston, with a smooth start.

    Every number is a float leaf: k, omega and Phi are derived from them at each use, so
    that derivatives with respect to T and d are whole.
    """

    H: Scalar = eqx.field(converter=_scalar)
    """Wave height, crest to trough, m."""
    T: Scalar = eqx.field(converter=_scalar)
    """Period, s."""
    d: Scalar = eqx.field(converter=_scalar)
    """Still water depth, m."""
    g: Scalar = eqx.field(converter=_scalar, default=GRAVITY)
    """Acceleration of gravity, m/s2."""
    ramp: Scalar = eqx.field(converter=_scalar, default=0.0)
    """Length of the start-up, s; 0 starts at once."""
    correction: SecondOrderPiston | None = None
    """Second-order generation, or None for first order."""

    @property
    def omega(self) -> Scalar:
        """Angular frequency, rad/s."""
        return 2.0 * jnp.pi / self.T

    @property
    def k(self) -> Scalar:
        """Wavenumber, rad/m."""
        return wavenumber(self.omega, self.d, self.g)

    @property
    def Phi(self) -> Scalar:
        """Transfer function H / S0 of the piston, Eq. 22."""
        return biesel(self.k, self.d)

    def ramp_factor(self, t: ArrayLike) -> Float[Array, "..."]:
        """Start-up factor in [0, 1]: 10 s^3 - 15 s^4 + 6 s^5 with s = t / ramp.

        Its first two derivatives vanish at both ends: no jump of the acceleration.
        """
        t = jnp.asarray(t, float)
        # A ramp of 0 has s = 1 at once; the inner value keeps its derivative finite.
        length = jnp.where(self.ramp > 0.0, self.ramp, 1.0)
        s = jnp.where(self.ramp > 0.0, jnp.clip(t / length, 0.0, 1.0), 1.0)
        return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)

    def first_order_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """First-order part of the paddle's displacement (m), ramped."""
        t = jnp.asarray(t, float)
        return self.ramp_factor(t) * 0.5 * self.H / self.Phi * jnp.sin(self.omega * t)

    def paddle_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """Paddle displacement X(t) (m), zero and at rest at t = 0 with a ramp; t in s.

        (S0 / 2) sin(omega t), S0 = H / Phi, plus the correction, both times the ramp.
        """
        X = self.first_order_displacement(t)
        if self.correction is None:
            return X
        return X + self.ramp_factor(t) * self.correction.displacement(self, t)

    def paddle_velocity(self, t: ArrayLike) -> Float[Array, "..."]:
        """Paddle velocity dX/dt (m/s), by differentiating the displacement."""
        t = jnp.asarray(t, float)
        return jax.jvp(self.paddle_displacement, (t,), (jnp.ones_like(t),))[1]

    def elevation(self, x: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Target elevation (m) at x (m) from the paddle's rest position, second order.

        Phase-locked to the paddle. It has no ramp: compare it with a simulation only
        once the front, travelling at the group velocity, has passed x.
        """
        return stokes2_elevation(x, t, self.H, self.T, self.d, self.g)

    def paddle_elevation(self, t: ArrayLike) -> Float[Array, "..."]:
        """Linear target elevation at the paddle (m), ramped: the eta of Eq. 23."""
        t = jnp.asarray(t, float)
        return self.ramp_factor(t) * 0.5 * self.H * jnp.cos(self.omega * t)

    def delayed_elevation(self, x: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Target progressive elevation (m) at x (m) near the paddle, ramped.

        The paddle's elevation one travel time k x / omega ago, with the bound second
        harmonic where the waves have one. The ramp travels at the phase speed, which is
        near enough within a fraction of a wavelength.
        """
        t = jnp.asarray(t, float) - self.k * x / self.omega
        eta = self.paddle_elevation(t)
        if self.correction is None:
            return eta
        return eta + self.ramp_factor(t) ** 2 * self.correction.elevation(self, t)


class ActiveAbsorption(eqx.Module):
    """A piston that makes the target waves and absorbs those that come back, Eq. 23.

    Eq. 23, U = (omega / Phi)(2 eta - eta_sph), is feed-forward plus feedback,
    (omega / Phi) eta + (omega / Phi)(eta - eta_sph). Here the feed-forward is the
    paddle's own velocity (with its second-order part) and the feedback compares the
    gauge with what it would read without reflection:

        U = U_target + gain (omega / Phi)(eta_gauge - eta_sph) - drift_rate (X - X_target)
        eta_gauge = eta_progressive(distance, t) + near_field X_1(t)

    The defaults are Eq. 23 as printed. A gauge a few h away lags the paddle by
    k * distance and sees the piston's evanescent modes, which Eq. 23 as printed takes
    for a reflection; `at_gauge` allows for both. The near field is that of the TARGET
    motion: with the actual X any slow drift would feed itself at the rate
    near_field * omega / Phi, though a slow paddle raises no elevation.

    A constant error of the gauge moves the paddle until the water it displaces makes up
    for it (closed tank) or until drift_rate holds it, at (omega / Phi) error / drift_rate.
    """

    gain: Scalar = eqx.field(converter=_scalar, default=1.0)
    """Feedback gain (-): 1 is Eq. 23, 0 is no absorption."""
    drift_rate: Scalar = eqx.field(converter=_scalar, default=0.0)
    """Rate at which the paddle returns to its target position, 1/s; keep << omega."""
    distance: Scalar = eqx.field(converter=_scalar, default=0.0)
    """Distance of the gauge from the paddle, m."""
    near_field: Scalar = eqx.field(converter=_scalar, default=0.0)
    """Evanescent elevation at the gauge per paddle displacement (-)."""

    @classmethod
    def at_gauge(
        cls,
        waves: RegularWaves,
        distance: float,
        gain: ArrayLike = 1.0,
        drift_rate: ArrayLike = 0.0,
    ) -> "ActiveAbsorption":
        """Absorption with a gauge `distance` (m) in front of the paddle.

        The near field is summed on the host for the present T and d of `waves`; it is
        a leaf, constant under differentiation with respect to them.
        """
        near_field = near_field_ratio(float(distance), float(waves.omega), float(waves.d), float(waves.g))
        return cls(gain, drift_rate, distance, near_field)

    def gauge_elevation(self, waves: RegularWaves, t: ArrayLike) -> Float[Array, "..."]:
        """Elevation (m) that the gauge reads when nothing comes back."""
        near = self.near_field * waves.first_order_displacement(t)
        return waves.delayed_elevation(self.distance, t) + near

    def velocity(
        self, waves: RegularWaves, X: ArrayLike, t: ArrayLike, eta_measured: ArrayLike
    ) -> Float[Array, "..."]:
        """Paddle velocity U (m/s) at time t (s), Eq. 23.

        `X` displacement of the paddle (m), `eta_measured` elevation at the gauge over
        the still water level (m).
        """
        feedback = self.gauge_elevation(waves, t) - eta_measured
        drift = X - waves.paddle_displacement(t)
        return (
            waves.paddle_velocity(t)
            + self.gain * waves.omega / waves.Phi * feedback
            - self.drift_rate * drift
        )

    def filter_time(self, waves: RegularWaves) -> Scalar:
        """Time constant (s) of a low-pass on the feedback that suits this gauge.

        The gauge meets the arriving wave k * distance early, and the near field of the
        absorbing motion adds near_field / Phi to that. A first-order filter of this time
        constant on (gauge_elevation - eta_measured) lags by their sum: for T = 1.2 s,
        d = 0.5 m and a gauge at 0.06 m the residual reflection falls from 14 % to 1 %.
        """
        lead = waves.k * self.distance + self.near_field / waves.Phi
        return jnp.tan(lead) / waves.omega

    def residual_reflection(self, waves: RegularWaves, filter_time: ArrayLike = 0.0) -> Scalar:
        """Share (-) of an arriving wave that the paddle sends back, linear theory.

        An arriving wave of amplitude 1 doubles at the fixed paddle; the paddle's motion
        adds a progressive wave b and its own near field -i near_field b / Phi. Closing
        the loop through the gauge gives b, and the share is |1 + b|: 0 for a gauge at
        the paddle without near field. `filter_time` (s) is that of a first-order filter
        on the feedback. Drift is left out; `near_field` must be that of `at_gauge`.
        """
        phase = waves.k * self.distance
        gain = self.gain / (1.0 + 1j * waves.omega * filter_time)
        loop = gain * (jnp.exp(-1j * phase) - 1j * self.near_field / waves.Phi)
        return jnp.abs(1.0 - 2.0 * gain * jnp.cos(phase) / (1.0 + loop))


class Sponge(eqx.Module):
    """Layer that takes velocity out of the particles at the far end, Eqs 27 and 28."""

    x0: Scalar = eqx.field(converter=_scalar)
    """Start of the layer, m."""
    x1: Scalar = eqx.field(converter=_scalar)
    """End of the layer, m; greater than x0."""
    strength: Scalar = eqx.field(converter=_scalar, default=10.0)
    """Damping rate at the end of the layer, 1/s."""

    def factor(self, x: Float[Array, "..."], dt: ArrayLike) -> Float[Array, "..."]:
        """Factor in [0, 1] that multiplies the velocity over a step dt (s), Eq. 28.

        `x` (m) of the particles; 1 outside x0..x1.
        """
        x = jnp.asarray(x, float)
        s = (x - self.x0) / (self.x1 - self.x0)
        inside = (s >= 0.0) & (s <= 1.0)
        damped = jnp.clip(1.0 - dt * self.strength * s**2, 0.0, 1.0)
        return jnp.where(inside, damped, 1.0)


# --- limits ----------------------------------------------------------------------------


def theory_limits(H: float, T: float, d: float, g: float = GRAVITY) -> list[str]:
    """Warnings where the theory of this module does not hold; empty where it does.

    Host function; `H` (m), `T` (s), `d` (m). Each warning gives the value and the limit:
    breaking by steepness (Miche 1944) and by depth (McCowan 1894), the Ursell number for
    second-order Stokes waves, and the kd in which a piston makes clean waves.
    """
    k = float(wavenumber(2.0 * np.pi / T, d, g))
    kd, length = k * d, 2.0 * np.pi / k
    steepness, miche = H / length, 0.142 * np.tanh(kd)
    ursell = H * length**2 / d**3
    limits = []
    if steepness > miche:
        limits.append(
            f"steepness H/lambda = {steepness:.3g} is over Miche's limit "
            f"0.142 tanh(kd) = {miche:.3g}: the wave breaks"
        )
    if H / d > 0.78:
        limits.append(f"H/d = {H / d:.3g} is over 0.78: the wave breaks on this depth")
    if ursell > _URSELL_LIMIT:
        limits.append(
            f"Ursell number H lambda^2/d^3 = {ursell:.3g} is over 8 pi^2/3 = "
            f"{_URSELL_LIMIT:.3g}: second-order Stokes theory has a second crest in the trough"
        )
    if kd > np.pi:
        limits.append(
            f"kd = {kd:.3g} is over pi: deep water, where a piston moves water that "
            "the wave does not and its near field is large"
        )
    if kd < np.pi / 10.0:
        limits.append(f"kd = {kd:.3g} is under pi/10 = {np.pi / 10.0:.3g}: shallow water, use cnoidal waves")
    return limits
