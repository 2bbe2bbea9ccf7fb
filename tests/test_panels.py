"""Two-dimensional panel method: exact multipoles, the theory of the OWC, identities and convergence."""

import math

import numpy as np
import pytest
from scipy.special import expi

from jaxsph.waves.panels import Chamber, Hull, Resolution, Section, _solved, hydrodynamics
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering

G, RHO = 9.81, 1000.0


def _block(name, x0, x1, z0, z1=0.3, pivot=(0.0, 0.0)):
    return Hull(name, ((x0, z0), (x1, z0), (x1, z1), (x0, z1)), pivot)


def _disc(count, radius=1.0):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return Hull("disc", tuple(zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)))


BARGE = _block("barge", 0.0, 0.4, -0.2, pivot=(0.2, 0.1))
SEVERAL = Section(
    1.0,
    (
        BARGE,
        _block("wall", 0.9, 0.95, -0.5, pivot=(0.9, -0.5)),
        Hull("wedge", ((0.5, -0.6), (0.8, -0.7), (0.7, -0.9))),
    ),
    chambers=(Chamber("air", 0.4, 0.9, hull="barge"),),
)
"""A barge that carries a chamber, a thin wall and a submerged wedge."""


def _multipoles(K, motion):
    """Force coefficients (added mass + i damping / omega, over rho pi a^2 / 2) of a semicircle of unit radius
    on the surface of infinitely deep water, by Ursell's expansion; y is downwards."""
    theta = (np.arange(400) + 0.5) / 400 * np.pi - 0.5 * np.pi  # from the downward vertical
    r = np.linspace(0.999, 1.001, 3)[:, None]  # the middle one is the surface; for radial derivatives
    x, y = r * np.sin(theta), r * np.cos(theta)
    Z = K * (y - 1j * x)
    # the principal value of int exp(-v y) exp(i v x) / (v - K) dv, as an analytic function of y - ix
    pole = -np.exp(-Z) * expi(Z)
    slope = -pole - 1.0 / Z
    heave = motion == "heave"
    wave = np.exp(-K * y) * (np.cos(K * x) if heave else np.sin(K * x))
    source = (pole.real if heave else slope.imag) + 1j * np.pi * wave
    columns = [source]
    for m in range(1, 25):
        n = 2 * m if heave else 2 * m + 1
        shape = np.cos if heave else np.sin
        columns.append(shape(n * theta) / r**n + K / (n - 1) * shape((n - 1) * theta) / r ** (n - 1))
    columns = np.array(columns)
    radial = (columns[:, 2] - columns[:, 0]) / 0.002  # error 1e-6 of third derivatives
    normal = np.cos(theta) if heave else np.sin(theta)
    found = np.linalg.lstsq(radial.T, normal.astype(complex), rcond=None)[0]
    phi = found @ columns[:, 1]
    return -np.sum(phi * normal) * np.pi / len(theta) / (0.5 * np.pi)


@pytest.mark.parametrize("motion", ["heave", "sway"])
@pytest.mark.parametrize("Ka", [0.5, 1.0, 2.0])
def test_semicircle_agrees_with_multipoles(Ka, motion):
    # The bed at 60 radii changes the coefficients by about (a/h)^2 = 3e-4, and the polygon by 1e-4.
    found = hydrodynamics(Section(60.0, (_disc(800),)), math.sqrt(Ka * G))
    index = found.index("disc", "heave" if motion == "heave" else "surge")
    scale = 0.5 * np.pi * RHO
    coefficient = (found.added_mass + 1j * found.damping / found.omega)[index, index] / scale
    exact = _multipoles(Ka, motion)
    assert abs(coefficient - exact.real - 1j * abs(exact.imag)) < 5e-4


@pytest.mark.parametrize("thickness", [0.2, 0.01])
@pytest.mark.parametrize("Kh", [0.2, 1.0, 4.0])
def test_chamber_at_an_end_wall_agrees_with_matched_modes(Kh, thickness):
    b, a, omega = 0.5, 0.3, math.sqrt(Kh * G)
    exact = radiation_and_scattering(ChamberGeometry(1.0, b, a, thickness), omega)
    # mirrored: the back wall is on the right at x = 0
    wall = _block("wall", -b - thickness, -b, -a)
    found = hydrodynamics(Section(1.0, (wall,), end_wall=0.0, chambers=(Chamber("air", -b, 0.0),)), omega)
    # The theory of matched modes has an error below 1e-6, see `radiation_and_scattering`.
    assert found.admittance[0, 0] == pytest.approx(exact.Z(), rel=3e-6)
    assert found.scattered_flow[0] == pytest.approx(exact.q_S, rel=3e-6)
    assert found.reflection == pytest.approx(exact.R, abs=3e-6)
    assert found.transmission == 0.0


@pytest.mark.parametrize("omega", [2.0, 4.0, 7.0])
def test_reciprocity_and_energy(omega):
    found = hydrodynamics(SEVERAL, omega)
    h, k = SEVERAL.depth, found.k
    c_g = 0.5 * omega / k * (1.0 + 2.0 * k * h / np.sinh(2.0 * k * h))
    A, B, waves = found.added_mass, found.damping, found.radiated
    small = 3e-6 * np.abs(B).max()  # error of the panels
    assert np.abs(A - A.T).max() < 3e-6 * np.abs(A).max()
    assert np.abs(B - B.T).max() < small and np.linalg.eigvalsh(B + B.T).min() > -small
    # the damping is the power of the radiated waves; Haskind: the wave to the left gives the excitation force
    power = RHO * G * c_g
    assert np.abs(B - power * (waves.conj().T @ waves).real[:9, :9]).max() < small
    assert np.abs(found.excitation + 2.0 * power * waves[0, :9]).max() < 3e-6 * np.abs(found.excitation).max()
    assert found.scattered_flow[0] == pytest.approx(2.0 * power * waves[0, 9], rel=1e-5)
    assert np.abs(found.pressure_force + found.motion_flow.T).max() < 1e-6
    radiated = power * np.sum(np.abs(waves[:, 9]) ** 2)
    assert found.admittance[0, 0].real == pytest.approx(radiated, rel=1e-5)
    assert abs(found.reflection) ** 2 + abs(found.transmission) ** 2 == pytest.approx(1.0, abs=3e-6)


def test_chamber_of_a_hull_moves_with_it():
    still = Section(1.0, SEVERAL.hulls, chambers=(Chamber("air", 0.4, 0.9),))
    fixed, carried = hydrodynamics(still, 4.0), hydrodynamics(SEVERAL, 4.0)
    # barge: pivot at x = 0.2; the stretch is 0.5 m long and its middle is 0.45 m to the right of the pivot
    lifted = np.array([0.0, 0.5, -0.5 * 0.45])
    assert (fixed.motion_flow - carried.motion_flow)[0, :3] == pytest.approx(lifted)
    assert (carried.pressure_force - fixed.pressure_force)[:3, 0] == pytest.approx(lifted)
    assert np.array_equal(carried.admittance, fixed.admittance)


def test_pivot_transforms_forces_and_motions():
    at, other = Section(1.0, (BARGE,)), Section(1.0, (Hull("barge", BARGE.outline, (-0.3, -0.4)),))
    a, b = hydrodynamics(at, 4.0), hydrodynamics(other, 4.0)
    # velocity of the pivot (0.2, 0.1) by motions about the other one, with the arm (0.5, 0.5): pitch gives
    # (z, -x)
    moved = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]])
    assert b.added_mass == pytest.approx(moved.T @ a.added_mass @ moved, rel=1e-9, abs=1e-9)
    assert b.excitation == pytest.approx(moved.T @ a.excitation, rel=1e-9)


def test_panels_converge():
    fine = _solved(SEVERAL, 4.0, RHO, G, Resolution(nodes=8, levels=10, largest=0.5))
    errors = []
    for resolution in (Resolution(nodes=2, levels=3), Resolution(nodes=4, levels=5), Resolution()):
        found = _solved(SEVERAL, 4.0, RHO, G, resolution)
        errors.append(np.abs(found.excitation - fine.excitation).max() / np.abs(fine.excitation).max())
    assert errors[1] < 0.05 * errors[0] and errors[2] < 0.2 * errors[1] and errors[2] < 2e-6


def test_waves_pass_over_the_hull_that_is_not_there(monkeypatch):
    # a flat block on the bed, of a thousandth of the depth, hardly disturbs the wave
    found = hydrodynamics(Section(1.0, (_block("slab", 0.0, 0.5, -1.2, -0.999),)), 4.0)
    assert abs(found.reflection) < 1e-3 and abs(found.transmission) == pytest.approx(1.0, abs=1e-5)
    # Froude and Krylov: the force on the slab is the incident pressure on its top, rho g / cosh kh
    k = found.k
    along = (np.exp(0.5j * k) - 1.0) / (1j * k)
    assert found.excitation[1] == pytest.approx(-RHO * G / np.cosh(k) * along, rel=2e-3)


def test_wall_to_the_bed_reflects_everything():
    found = hydrodynamics(Section(1.0, (_block("wall", 0.0, 0.3, -1.0),)), 4.0)
    assert found.reflection == pytest.approx(1.0, abs=1e-7)  # the crest is at the wall's face, x = 0
    assert abs(found.transmission) < 1e-7
    # twice the pressure of the incident wave, integrated over the depth
    assert found.excitation[0] == pytest.approx(2.0 * RHO * G * np.tanh(found.k) / found.k, rel=1e-6)


def test_hull_above_the_water_feels_nothing():
    both = hydrodynamics(Section(1.0, (BARGE, _block("lid", 1.0, 1.2, 0.1))), 4.0)
    alone = hydrodynamics(Section(1.0, (BARGE,)), 4.0)
    assert np.all(both.added_mass[3:] == 0.0) and np.all(both.excitation[3:] == 0.0)
    assert both.added_mass[:3, :3] == pytest.approx(alone.added_mass, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Section(0.0, (BARGE,)), "depth = 0.0 m must be positive"),
        (lambda: Section(1.0), "at least one hull or chamber"),
        (lambda: Section(1.0, (BARGE, BARGE)), "must all differ"),
        (lambda: Section(1.0, (BARGE,), chambers=(Chamber("a", 1.0, 2.0, "raft"),)), "no hull 'raft'"),
        (lambda: Section(1.0, (BARGE,), 1.0, (Chamber("a", 0.5, 2.0),)), "behind the end wall"),
        (lambda: Section(1.0, (), None, (Chamber("a", 0, 1), Chamber("b", 0.5, 2))), "overlap"),
        (lambda: Chamber("a", 1.0, 1.0), "first = 1.0 m must be less"),
        (lambda: Hull("a", ((0, 0), (1, 1), (1, 0), (0, 1))), "no crossing sides"),
        (lambda: hydrodynamics(Section(1.0, (BARGE,)), 0.0), "must be positive"),
        (
            lambda: hydrodynamics(Section(1.0, (BARGE,), None, (Chamber("a", 0.1, 0.6),)), 1.0),
            "out of the hull",
        ),
    ],
)
def test_refusals(make, words):
    with pytest.raises(ValueError, match=words):
        make()
