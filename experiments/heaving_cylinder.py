"""Linear theory of a half-immersed circular cylinder in heave in water of finite depth, and its free motion.

A cylinder of radius a floats with its axis in the still surface of water of depth h; all values are per metre
of width. The time factor is exp(-i omega t), K = omega^2/g, and zeta = z + ix with z upwards from the still
level. A potential and its stream function are the real and imaginary parts of an analytic function of zeta.
r and theta are polar coordinates about the axis, with theta = 0 straight down. At unit heave velocity the
stream function on the cylinder is x.

The potential is Ursell's sum for deep water with every term extended to the depth h:

- A source in the surface. In deep water it is, as a principal value,

      PV int exp(k zeta) / (k - K) dk = exp(K zeta) (E1(K zeta) + i pi)    (Im zeta > 0).

  At depth h the kernel is cosh k(h + zeta) / (k sinh kh - K cosh kh). Its difference from the deep-water
  kernel, D(k), decays as exp(-2kh). D has poles at the wavenumber k0 at this depth (k0 tanh k0 h = K) and at
  K; these are subtracted and integrated analytically. Adding i pi times the residue at k0 makes the waves
  outgoing.
- Multipoles, whose kernels are the source's times k^(2m - 2) (k^2 - K^2) / (2m - 1)!. In deep water they are
  cos(2m theta)/r^2m + K/(2m - 1) cos((2m - 1) theta)/r^(2m - 1) and make no waves. The finite depth again
  adds an integral over D(k), and also a small wave, because the pole is at k0 instead of K.

The strengths are fitted by least squares so that the stream function on the cylinder is x. At infinite
frequency phi = 0 on the surface, and only the multipole terms proportional to K remain.

Sources: F. Ursell, On the heaving motion of a circular cylinder on the surface of a fluid, Q. J. Mech. Appl.
Math. 2 (1949) 218-231; W. E. Cummins, The impulse response function and ship motions, Schiffstechnik 9
(1962) 101-109; T. F. Ogilvie, Recent progress toward the understanding and prediction of ship motions, Proc.
5th Symposium on Naval Hydrodynamics (1964) 3-80, for the relation of the memory function to added mass
and damping.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import exp1, gammaln

Values = NDArray[np.floating]
"""Array of real numbers."""
Complex = NDArray[np.complexfloating]
"""Array of complex numbers."""
MULTIPOLES, POINTS = 20, 100
"""Number of multipoles, and number of Gauss points on a quarter of the cylinder."""
DEEP = 12.0
"""Value of K h (-) above which k0 is set to K: exp(-2 K h) is below 4e-11 there."""
FALLEN = 40.0
"""Upper limit k h (-) of the integrals for the effect of the bed; high enough for all multipoles."""


@dataclass(frozen=True)
class Cylinder:
    """A half-immersed circular cylinder in water of finite depth, per metre of width."""

    radius: float
    """Radius a, m."""
    depth: float
    """Depth h of the still water, m; it should be at least a few radii."""
    rho: float = 1000.0
    """Density of the water, kg/m3."""
    g: float = 9.81
    """Acceleration of gravity, m/s2."""

    @property
    def mass(self) -> float:
        """Mass of the cylinder, equal to the mass of the displaced water, kg/m."""
        return 0.5 * np.pi * self.rho * self.radius**2

    @property
    def stiffness(self) -> float:
        """Hydrostatic stiffness in heave, N/m per metre."""
        return 2.0 * self.rho * self.g * self.radius

    def coefficients(self, omega: float) -> tuple[float, float]:
        """Added mass (kg/m) and damping (N s/m per metre) at the angular frequency omega (rad/s)."""
        force, _ = self._radiated(omega)
        return force.real, omega * force.imag

    def damping_of_the_waves(self, omega: float) -> float:
        """Damping computed from the energy flux of the radiated waves, N s/m per metre.

        In theory it equals the damping of `coefficients`; here it is computed from the waves' strength only.
        """
        _, outgoing = self._radiated(omega)
        k = wavenumber(omega, self.depth, self.g)
        height = omega / self.g * abs(outgoing) * np.pi * float(self._wave(omega, k, np.zeros(1))[0].real)
        twice = 2.0 * k * self.depth
        group = 0.5 * omega / k * (1.0 + 2.0 * twice * np.exp(-twice) / -np.expm1(-2.0 * twice))
        return 2.0 * self.rho * self.g * height**2 * group

    def added_mass_at_infinity(self) -> float:
        """Added mass at infinite frequency, kg/m."""
        _, odd = self._multipoles
        k, weights = _rule(FALLEN / self.depth)
        # cosh k(h + zeta) / cosh kh minus exp(k zeta)
        bed = -2.0 * np.sinh(np.outer(self._zeta, k)) / (np.exp(2.0 * k * self.depth) + 1.0)
        columns = odd + (bed * weights) @ self._powers(k) / self.radius
        return float(self._force(columns.real @ self._fitted(columns.imag)))

    def _radiated(self, omega: float) -> tuple[complex, complex]:
        """Added mass + i damping/omega (kg/m), and strength of the waves over that of a unit source."""
        K, zeta = omega**2 / self.g, self._zeta
        even, odd = self._multipoles
        source = np.exp(K * zeta) * (exp1(K * zeta) + 1j * np.pi)
        columns = np.column_stack([source, even + K * self.radius * odd])
        more, waves, made = self._of_the_depth(omega)
        columns = columns + more
        strengths = self._fitted(columns.imag + 1j * waves.imag)
        return self._force((columns.real + 1j * waves.real) @ strengths), complex(made @ strengths)

    def _of_the_depth(self, omega: float) -> tuple[Complex, Complex, Values]:
        """Terms that the finite depth adds on the cylinder, the outgoing wave of each term on the cylinder,
        and the strengths of these waves relative to the source's wave."""
        K, h, at = omega**2 / self.g, self.depth, self._zeta[:, None]
        k0, poles = wavenumber(omega, h, self.g), K * h < DEEP
        end = max(FALLEN / h, 2.0 * k0) if poles else DEEP / h
        k, weights = _rule(end)
        grown = np.exp(-2.0 * k * h)  # cosh kh and sinh kh are divided by exp(kh)/2 to avoid overflow
        kernel = (np.exp(k * at) + grown * np.exp(-k * at)) / (k * (1.0 - grown) - K * (1.0 + grown))
        wave, deep = self._wave(omega, k0, self._zeta), np.exp(K * self._zeta)
        # kernels divided by the source's kernel, at every k and at k0; at K the multipoles' kernels are zero
        over = np.column_stack([np.ones_like(k), self._powers(k) * (k**2 - K**2)[:, None]])
        made = np.append(1.0, self._powers(np.array([k0]))[0] * (k0 - K) * (k0 + K))
        more = ((kernel - np.exp(k * at) / (k - K)) * weights) @ over
        if poles:
            more -= np.outer(wave, made * (np.sum(weights / (k - k0)) - np.log((end - k0) / k0)))
            more[:, 0] += deep * (np.sum(weights / (k - K)) - np.log((end - K) / K))
        return more, np.pi * np.outer(wave, made), made

    def _wave(self, omega: float, k: float, zeta: Values | Complex) -> Complex:
        """Wave on the cylinder: the residue of the source's kernel at the pole k."""
        K, h = omega**2 / self.g, self.depth
        grown = np.exp(-2.0 * k * h)
        under = (1.0 - K * h) * (1.0 - grown) + k * h * (1.0 + grown)
        return (np.exp(k * zeta) + grown * np.exp(-k * zeta)) / under + 0j

    @cached_property
    def _theta(self) -> Values:
        return 0.25 * np.pi * (np.polynomial.legendre.leggauss(POINTS)[0] + 1.0)

    @cached_property
    def _zeta(self) -> Complex:
        return -self.radius * np.exp(-1j * self._theta)

    @cached_property
    def _multipoles(self) -> tuple[Complex, Complex]:
        """Deep-water multipoles on the cylinder (-): the part without K a, and the coefficient of K a."""
        order = np.arange(1, 2 * MULTIPOLES, 2)
        zeta = (self._zeta / self.radius)[:, None]
        return zeta ** -(order + 1), -(zeta**-order) / order

    def _powers(self, k: Values) -> Values:
        """Kernels k^(2m - 2) a^2m / (2m - 1)! at every k, m2."""
        order = np.arange(1, 2 * MULTIPOLES, 2)
        return np.exp(np.outer(np.log(k * self.radius), order - 1) - gammaln(order + 1)) * self.radius**2

    def _fitted(self, stream: Values | Complex):
        """Strengths with which the stream functions in the columns add up to x on the cylinder, m.

        Points near the surface, where the columns change fastest, have larger weights.
        """
        weight = (0.5 * np.pi - self._theta) ** -0.5
        wanted = (weight * self._zeta.imag).astype(stream.dtype)
        return np.linalg.lstsq(stream * weight[:, None], wanted, rcond=None)[0]

    def _force(self, phi):
        """Integral of rho phi cos(theta) over the wetted half, kg/m at unit velocity."""
        weights = 0.25 * np.pi * np.polynomial.legendre.leggauss(POINTS)[1]
        return 2.0 * self.rho * self.radius * np.sum(weights * phi * np.cos(self._theta))


def strip_of_a_long_cylinder(
    cylinder: Cylinder, omega: float, length: float, strips: int = 60, panels: int = 8
) -> tuple[float, float]:
    """Added mass (kg/m) and damping (N s/m per metre) of a long cylinder, by the three-dimensional code
    capytaine.

    The heave of a cylinder of `length` (m) decreases as cos^2 to zero at the ends. On an infinite cylinder
    the total force of such a distribution equals the force of the plane problem times the integral of the
    heave, because all other wavenumbers along the axis have zero total force. The ends therefore need no
    correction; only the small force on the infinite cylinder beyond them is missing. A quarter of each strip
    has `panels` panels. With a length of 3 m the result is within 0.5 % of `Cylinder.coefficients` at 8.7
    rad/s, and within 2 to 3 % at 6 and 12 rad/s.

    **Raises** ModuleNotFoundError if capytaine is not installed.
    """
    try:
        import capytaine
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            'the check of the coefficients needs capytaine: pip install "jaxsph[test]"'
        ) from error
    capytaine.set_logging("ERROR")
    mesh = capytaine.mesh_horizontal_cylinder(
        length=length, radius=cylinder.radius, resolution=(panels // 2, 4 * panels, strips)
    ).immersed_part(water_depth=cylinder.depth)
    heave = np.tile([0.0, 0.0, 1.0], (mesh.nb_faces, 1))
    swelling = heave * np.cos(np.pi * mesh.faces_centers[:, :1] / length) ** 2
    body = capytaine.FloatingBody(mesh=mesh, dofs={"heave": heave, "swelling": swelling})
    problem = capytaine.RadiationProblem(
        body=body,
        omega=omega,
        water_depth=cylinder.depth,
        radiating_dof="swelling",
        rho=cylinder.rho,
        g=cylinder.g,
    )
    # This solver of capytaine was chosen because its result is nearest to the theory. The default solver's
    # added mass is above the theory by 10, 7 and 5 % with 4, 8 and 16 panels (8.8 rad/s, 4 m).
    solver = capytaine.BEMSolver(green_function=capytaine.HAMS_GF(), method="direct")
    found = solver.solve(problem, keep_details=False)
    whole = 0.5 * length
    return found.added_masses["heave"] / whole, found.radiation_dampings["heave"] / whole


class Release:
    """Free heave of a cylinder released at rest above its equilibrium, by Cummins' equation.

    (m + A_inf) z'' + int_0^t kappa(t - s) z'(s) ds + c z = 0 with the memory function
    kappa(t) = (2/pi) int_0^inf B(omega) cos(omega t) d omega.
    """

    def __init__(self, cylinder: Cylinder, omega_end: float = 40.0, count: int = 160) -> None:
        """Computes the damping at `count` frequencies up to omega_end (rad/s), enough to resolve the memory
        function over 12 s.

        Increasing omega_end by half moves the turning points of a path by less than 1e-5 of a period.
        """
        self.cylinder = cylinder
        nodes, weights = np.polynomial.legendre.leggauss(count)
        self.omega = 0.5 * omega_end * (nodes + 1.0)
        self.weights = 0.5 * omega_end * weights
        self.added_mass, self.damping = np.transpose([cylinder.coefficients(w) for w in self.omega])
        self.infinite = cylinder.added_mass_at_infinity()

    def memory(self, t: Values) -> Values:
        """Memory function kappa at the times t (s), N/m per metre."""
        return 2.0 / np.pi * np.cos(np.outer(t, self.omega)) @ (self.weights * self.damping)

    def added_mass_off_the_memory(self, dt: float = 0.002, end: float = 12.0) -> float:
        """Largest difference between A and A_inf - int kappa sin(omega t) dt / omega, divided by A_inf (-).

        Frequencies up to 3 rad/s are left out: the memory of longer waves lasts longer (Ogilvie 1964).
        """
        t = np.arange(0.0, end, dt)
        kappa = self.memory(t)
        some = self.omega > 3.0
        sines = np.trapezoid(np.sin(np.outer(self.omega[some], t)) * kappa, t, axis=1)
        off = self.infinite - sines / self.omega[some] - self.added_mass[some]
        return float(np.max(np.abs(off))) / self.infinite

    def path(self, z0: float, end: float, dt: float = 0.002) -> tuple[Values, Values]:
        """Times (s) and heights above equilibrium (m) after the release at z0 (m), by the trapezoidal
        rule."""
        t = np.arange(round(end / dt) + 1) * dt
        kappa, c = self.memory(t), self.cylinder.stiffness
        mass = self.cylinder.mass + self.infinite
        z, v, force = np.full(t.size, z0), np.zeros(t.size), -c * z0
        for n in range(t.size - 1):
            # v is 0 at the release; the newest velocity's share of the integral is on the left-hand side
            past = dt * float(kappa[n:0:-1] @ v[1 : n + 1])
            known = -past - c * (z[n] + 0.5 * dt * v[n])
            v[n + 1] = (mass * v[n] + 0.5 * dt * (force + known)) / (mass + 0.25 * dt**2 * (kappa[0] + c))
            z[n + 1] = z[n] + 0.5 * dt * (v[n] + v[n + 1])
            force = -past - 0.5 * dt * kappa[0] * v[n + 1] - c * z[n + 1]
        return t, z


def _rule(end: float) -> tuple[Values, Values]:
    """Nodes and weights of a Gauss rule from 0 to `end`."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    return 0.5 * end * (nodes + 1.0), 0.5 * end * weights


def wavenumber(omega: float, depth: float, g: float) -> float:
    """Wavenumber (rad/m) of linear waves of angular frequency omega (rad/s), accurate to round-off."""
    K = omega**2 / g
    top = 2.0 * max(K, omega / np.sqrt(g * depth))
    return float(brentq(lambda k: k * np.tanh(k * depth) - K, 0.0, top, xtol=1e-15, rtol=1e-14))
