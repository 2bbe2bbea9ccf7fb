"""Theory of water waves in constant depth: linear and second-order Stokes waves, and the transfer function of
a piston wavemaker.

Equation numbers refer to Zhu et al. (2020) unless another source is named. SI units. x is measured from the
paddle's rest position, positive into the tank. z is the height above the BED, so that z = d is the still
water level. A crest passes x = 0 at t = 0. Functions broadcast over arrays and can be differentiated, except
host functions.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import real

GRAVITY = 9.81
"""Acceleration of gravity, m/s2."""


_URSELL_LIMIT = 8.0 * np.pi**2 / 3.0
"""Ursell number H lambda^2 / d^3 up to which second-order Stokes theory holds (-)."""


def _sech2(x: Array) -> Array:
    """Square of the hyperbolic secant of x (-); 1 - tanh^2 x loses digits above about x = 4."""
    e = jnp.exp(-2.0 * x)
    return 4.0 * e / (1.0 + e) ** 2


@jax.custom_jvp
def _solve_dispersion(omega: Array, d: Array, g: Array) -> Array:
    """Wavenumber k (rad/m) of the dispersion relation omega^2 = g k tanh kd.

    The explicit first value (Guo 2002) has an error below 0.8 %. Each Newton step squares the
    error, so that three steps reach the rounding error of float32 and nearly that of float64.
    """
    y = omega**2 * d / g
    kd = y / (-jnp.expm1(-(y**1.25))) ** 0.4
    for _ in range(3):
        sigma = jnp.tanh(kd)
        kd = kd - (kd * sigma - y) / (sigma + kd * _sech2(kd))
    return kd / d


_solve_once = jax.jit(_solve_dispersion)
"""Jitted `_solve_dispersion`: traced once, although a time step calls it in several places."""


@_solve_dispersion.defjvp
def _solve_dispersion_jvp(primals, tangents):
    # The derivative by the implicit function theorem is exact at the root, regardless of the iteration,
    # and can itself be differentiated.
    (omega, d, g), (omega_dot, d_dot, g_dot) = primals, tangents
    k = _solve_dispersion(omega, d, g)
    sech2 = _sech2(k * d)
    forcing = (2.0 * omega * omega_dot - omega**2 / g * g_dot) / g
    return k, (forcing - k**2 * sech2 * d_dot) / (jnp.tanh(k * d) + k * d * sech2)


def wavenumber(omega: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY) -> Float[Array, "..."]:
    """Wavenumber k of linear waves, rad/m: omega^2 = g k tanh(k d).

    `omega` (rad/s, > 0) and the depth `d` (m, > 0) broadcast. The relative error in
    float32 is under 1e-6 for kd from 0.05 to 20; derivatives of any order are exact.
    """
    arguments = tuple(real(value) for value in (omega, d, g))
    dtype = jnp.result_type(*arguments)
    return _solve_once(*jnp.broadcast_arrays(*(a.astype(dtype) for a in arguments)))


def wavelength(T: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY) -> Float[Array, "..."]:
    """Wavelength lambda of linear waves of period `T` (s) in water of depth `d` (m), m."""
    return 2.0 * jnp.pi / wavenumber(2.0 * jnp.pi / real(T), d, g)


def stokes3_wavenumber(
    H: ArrayLike, T: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY
) -> Float[Array, "..."]:
    """Wavenumber k of third-order Stokes waves in a closed tank, rad/m: higher waves are longer.

    omega^2 = g k s (1 + (kH/2)^2 ((9 - 10 s^2 + 9 s^4) / (8 s^4) - 1 / (kd s))) with s = tanh kd. The
    fraction with 8 s^4 holds for waves without a mean velocity below the troughs (Whitham 1974, section
    13.13). The last term accounts for the return current of a closed tank, which balances the waves' mass
    transport E/c (Stokes' second definition of the celerity). Height `H` (m), period `T` (s) and depth `d`
    (m) broadcast.
    """
    H, d, omega = real(H), real(d), 2.0 * jnp.pi / real(T)
    k = wavenumber(omega, d, g)
    # each pass adds at least two digits, since the height changes k by only a few per cent
    for _ in range(6):
        s, kd = jnp.tanh(k * d), k * d
        part = (9.0 - 10.0 * s**2 + 9.0 * s**4) / (8.0 * s**4) - 1.0 / (kd * s)
        k = wavenumber(omega / jnp.sqrt(1.0 + (0.5 * k * H) ** 2 * part), d, g)
    return k


@jax.jit
def _x_over_sinh(x: Array) -> Array:
    """Ratio x / sinh x for x > 0 (-); neither the ratio nor its derivative overflows."""
    return 2.0 * x * jnp.exp(-x) / -jnp.expm1(-2.0 * x)


def group_velocity(omega: ArrayLike, d: ArrayLike, g: ArrayLike = GRAVITY) -> Float[Array, "..."]:
    """Group velocity of linear waves, m/s: (omega / 2k) (1 + 2kd / sinh 2kd); `omega` in rad/s, `d` in m."""
    k = wavenumber(omega, d, g)
    return jnp.asarray(0.5 * omega / k * (1.0 + _x_over_sinh(2.0 * k * d)))


def incident_power(
    H: ArrayLike, T: ArrayLike, d: ArrayLike, rho0: ArrayLike = 1000.0, g: ArrayLike = GRAVITY
) -> Float[Array, "..."]:
    """Mean power of regular waves per metre of crest, W/m: Eq. 26 with A_i = H / 2.

    `H` wave height (m), `T` period (s), `d` depth (m), `rho0` density (kg/m3).
    """
    A = 0.5 * real(H)
    omega = 2.0 * jnp.pi / real(T)
    return jnp.asarray(0.5 * rho0 * g * A**2 * group_velocity(omega, d, g))


def biesel(k: ArrayLike, d: ArrayLike) -> Float[Array, "..."]:
    """Transfer function Phi = H / S0 of a piston wavemaker (-), Eq. 22.

    H is the wave height and S0 the stroke (peak to peak); `k` (rad/m), `d` (m). The form
    2 tanh kd / (1 + 2kd / sinh 2kd) of Eq. 22 does not overflow.
    """
    kd = real(k) * d
    return 2.0 * jnp.tanh(kd) / (1.0 + _x_over_sinh(2.0 * kd))


def _stokes2_amplitude(H: Array, k: Array, d: Array) -> Array:
    """Amplitude of the bound second harmonic of the elevation, m.

    The amplitude is (H^2 k / 16) cosh kd (2 + cosh 2kd) / sinh^3 kd, computed in terms of tanh kd.
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
    """Elevation eta of a second-order Stokes wave travelling along +x, m.

    `x` (m) and `t` (s) broadcast; a crest is at x = 0, t = 0. The wavenumber is that of linear waves, which
    is correct to second order. Over many wavelengths use `stokes3_wavenumber` and `stokes2_profile`.
    """
    omega = 2.0 * jnp.pi / real(T)
    k = wavenumber(omega, d, g)
    return stokes2_profile(k * real(x) - omega * real(t), H, k, d)


def stokes2_profile(phase: ArrayLike, H: ArrayLike, k: ArrayLike, d: ArrayLike) -> Float[Array, "..."]:
    """Elevation eta of a second-order Stokes wave at a phase (rad; 0 at a crest), m.

    Height `H` (m), wavenumber `k` (rad/m), depth `d` (m). Source: Dean and Dalrymple (1991), section 11.2;
    the mean level is the still water level.
    """
    phase, H, k, d = real(phase), real(H), real(k), real(d)
    return 0.5 * H * jnp.cos(phase) + _stokes2_amplitude(H, k, d) * jnp.cos(2.0 * phase)


def stokes2_velocity(
    x: ArrayLike,
    z: ArrayLike,
    t: ArrayLike,
    H: ArrayLike,
    T: ArrayLike,
    d: ArrayLike,
    g: ArrayLike = GRAVITY,
) -> Float[Array, "..."]:
    """Velocity (u, w) `[..., 2]` of a second-order Stokes wave travelling along +x, m/s.

    The wave has the elevation `stokes2_elevation`, and a zero Eulerian mean velocity below the
    troughs (no return current). z (m) is the height above the bed.
    Source: Dean and Dalrymple (1991), section 11.2.
    The ratios of hyperbolic functions are written with decaying exponentials, which do not
    overflow.
    """
    x, z, t = real(x), real(z), real(t)
    H = real(H)
    omega = 2.0 * jnp.pi / real(T)
    k = wavenumber(omega, d, g)
    theta = k * x - omega * t
    bed = -jnp.expm1(-2.0 * k * d)
    first = 0.5 * H * omega * jnp.exp(k * (z - d)) / bed
    second = 1.5 * H**2 * omega * k * jnp.exp(2.0 * k * (z - 2.0 * d)) / bed**4
    e2, e4 = jnp.exp(-2.0 * k * z), jnp.exp(-4.0 * k * z)
    u = first * (1.0 + e2) * jnp.cos(theta) + second * (1.0 + e4) * jnp.cos(2.0 * theta)
    w = first * (1.0 - e2) * jnp.sin(theta) + second * (1.0 - e4) * jnp.sin(2.0 * theta)
    return jnp.stack([u, w], axis=-1)


def standing_velocity(x: np.ndarray, a: float, k: float, d: float, g: float = GRAVITY) -> np.ndarray:
    """Velocities `[N, D]` (m/s) at `x` (m) in a linear standing wave when its surface is flat; host only.

    The surface rises where cos kx > 0. **Arguments**: `a`: amplitude of the surface, m; `k`: wavenumber,
    rad/m; `d`: depth, m; `g`: acceleration of gravity, m/s2.
    """
    u, scale = np.zeros_like(x), a * np.sqrt(g * k * np.tanh(k * d))
    # cosh(kz)/sinh(kd) and sinh(kz)/sinh(kd) from decaying exponentials, because growing exponentials
    # overflow in deep water
    up, down = np.exp(k * (x[:, -1] - d)), np.exp(-k * (x[:, -1] + d))
    u[:, 0] = -scale * np.sin(k * x[:, 0]) * (up + down) / -np.expm1(-2 * k * d)
    u[:, -1] = scale * np.cos(k * x[:, 0]) * (up - down) / -np.expm1(-2 * k * d)
    return u


def largest_stroke(d: float) -> float:
    """Largest peak-to-peak stroke of a piston for waves within `theory_limits` in depth `d` (m), m.

    With the limits H/d = min(8 pi^2/3 (kd/2 pi)^2, 0.142 (2 pi/kd) tanh kd, 0.78) the stroke H/Phi is largest
    where the first two limits are equal: 0.684 d at kd = 1.007. The function returns 0.685 d.
    """
    return 0.685 * d


def theory_limits(H: float, T: float, d: float, g: float = GRAVITY) -> list[str]:
    """Warnings if the theory of this module does not hold for a wave; an empty list if the theory holds.

    Host function; height `H` (m), period `T` (s), depth `d` (m). Each warning gives the value and the limit:
    breaking by steepness (Miche 1944) and by depth (McCowan 1894), the Ursell number for
    second-order Stokes waves, and the range of kd in which a piston generates clean waves.
    """
    k = float(wavenumber(2.0 * np.pi / T, d, g))
    kd, length = k * d, 2.0 * np.pi / k
    steepness, miche = H / length, 0.142 * np.tanh(kd)
    ursell = H * length**2 / d**3
    limits = []
    if steepness > miche:
        limits.append(
            f"steepness H/lambda = {steepness:.3g} exceeds Miche's limit "
            f"0.142 tanh(kd) = {miche:.3g}: the wave breaks; use a smaller height H"
        )
    if H / d > 0.78:
        limits.append(
            f"H/d = {H / d:.3g} exceeds 0.78: the wave breaks at this depth; use a smaller height H"
        )
    if ursell > _URSELL_LIMIT:
        limits.append(
            f"Ursell number H lambda^2/d^3 = {ursell:.3g} exceeds 8 pi^2/3 = "
            f"{_URSELL_LIMIT:.3g}: second-order Stokes theory gives a second crest in the trough; use a "
            "smaller height H or period T"
        )
    if kd > np.pi:
        limits.append(
            f"kd = {kd:.3g} exceeds pi (deep water): a piston also moves the water at depths where the "
            "waves do not, so the piston's near field is large; use a longer period T, or gauges and devices "
            "far from the piston"
        )
    if kd < np.pi / 10.0:
        limits.append(
            f"kd = {kd:.3g} is below pi/10 = {np.pi / 10.0:.3g} (shallow water): cnoidal theory would be "
            "needed; use a shorter period T"
        )
    return limits
