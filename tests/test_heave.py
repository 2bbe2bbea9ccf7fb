"""Linear theory of the heaving cylinder, and results read from a record of its free motion."""

import numpy as np
import pytest

from experiments.heaving_cylinder import Cylinder, Release, strip_of_a_long_cylinder
from experiments.validation.heave import extremes, let_go, period_and_damping

SHALLOW, DEEP = Cylinder(0.1, 0.5), Cylinder(0.1, 200.0)


@pytest.mark.parametrize("omega", [0.1, 2.0, 6.0, 8.8, 12.0, 15.3, 15.4, 25.0])
def test_the_waves_take_what_the_damping_gives(omega):
    """On both sides of 15.34 rad/s, above which the source is that of deep water; 20 multipoles give 1e-4."""
    damping = SHALLOW.coefficients(omega)[1]
    assert SHALLOW.damping_of_the_waves(omega) == pytest.approx(damping, rel=2e-4)


def test_slow_heave_pumps_shallow_water():
    """On each side, unit velocity makes a flow a, waves of height a/c, and the power rho g (a/c)^2 c/2."""
    speed = np.sqrt(SHALLOW.g * SHALLOW.depth)
    pumped = 2.0 * SHALLOW.rho * SHALLOW.g * SHALLOW.radius**2 / speed
    assert SHALLOW.coefficients(0.05)[1] == pytest.approx(pumped, rel=1e-3)


def test_limits_of_deep_water():
    """At infinite frequency, half a cylinder's mass; slowly, waves of 2 K a times the heave (Ursell 1949)."""
    assert DEEP.added_mass_at_infinity() == pytest.approx(DEEP.mass, rel=1e-4)
    Ka = 0.005
    omega = np.sqrt(Ka * DEEP.g / DEEP.radius)
    # B v^2 / 2 is the power of two waves of height a_w = ratio v/omega, each rho g a_w^2/2 times g/(2 omega)
    ratio = np.sqrt(DEEP.coefficients(omega)[1] * omega**5 / (DEEP.rho * DEEP.g**2)) / omega
    assert ratio == pytest.approx(2 * Ka, rel=0.05)  # the next term is of order K a ln K a


def test_memory_gives_the_added_mass_back():
    release = Release(SHALLOW)
    assert release.added_mass_off_the_memory() < 1e-3
    coarse = period_and_damping(*release.path(0.02, 1.5, 0.004))
    assert period_and_damping(*release.path(0.02, 1.5)) == pytest.approx(coarse, rel=1e-3)


def test_a_long_cylinder_has_the_same_coefficients():
    """Coarse panels; with finer ones both solvers agree better."""
    pytest.importorskip("capytaine")
    strip = strip_of_a_long_cylinder(SHALLOW, 8.8, 2.0, strips=40, panels=4)
    assert strip == pytest.approx(SHALLOW.coefficients(8.8), rel=0.04)


def test_period_and_damping_of_a_damped_swing():
    """For any position of rest, and for readings with scatter."""
    ratio, period = 0.15, 0.7
    rate = 2 * np.pi / period
    t = np.arange(0.0, 1.5, 0.005)
    decay = ratio / np.sqrt(1 - ratio**2) * rate
    z = np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))  # at rest at t = 0
    for offset, noise in ((0.0, 0.0), (0.05, 0.0), (0.0, 0.003)):
        scattered = z + offset + noise * np.random.default_rng(1).standard_normal(t.size)
        found = period_and_damping(t, scattered)
        assert found == pytest.approx((period, ratio), rel=0.005 if not noise else 0.02)


def test_a_record_too_short_says_so():
    t = np.arange(0.0, 0.5, 0.005)
    with pytest.raises(ValueError, match="1 turning points"):
        extremes(t, np.cos(2 * np.pi * t))


def test_the_cylinder_floats_half_immersed():
    case = let_go("incompressible", 0.02)
    body = case.body
    assert body.mass == pytest.approx(500 * np.pi * body.disc.radius**2)
    assert body.disc.centre[1] > case.tank.depth
