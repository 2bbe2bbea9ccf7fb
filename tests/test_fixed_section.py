"""Linear diffraction by a fixed section: energy, and the excitation force found from radiated waves."""

import numpy as np
import pytest

from experiments.fixed_section import diffraction
from experiments.heaving_cylinder import Cylinder
from jaxsph.waves.theory import group_velocity

BOX = [(0.2, 0.0), (0.2, -0.2), (-0.2, -0.2), (-0.2, 0.0)]


@pytest.mark.parametrize("T", [0.9, 1.3, 2.0])
def test_what_is_not_sent_back_goes_on(T):
    waves = diffraction(BOX, 1.0, T, 0.01)
    assert waves.reflection**2 + waves.transmission**2 == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("omega", [4.0, 8.8])
def test_a_cylinder_is_pushed_up_as_its_heave_makes_waves(omega):
    """Haskind's relation in two dimensions, |F|^2 = 2 rho g c_g B, with the damping of another theory."""
    cylinder = Cylinder(0.1, 0.5)
    around = np.linspace(0.0, np.pi, 61)
    section = [(0.1 * float(np.cos(a)), -0.1 * float(np.sin(a))) for a in around]
    force = abs(diffraction(section, cylinder.depth, 2.0 * np.pi / omega, 0.005).force[1])
    speed = float(group_velocity(omega, cylinder.depth))
    damping = cylinder.coefficients(omega)[1]
    assert force == pytest.approx(np.sqrt(2.0 * cylinder.rho * cylinder.g * speed * damping), rel=5e-3)


def test_long_waves_lift_a_box_as_still_water_would():
    """The pressure below the box follows the level; the small horizontal force is due to slope and flow."""
    force = diffraction(BOX, 1.0, 40.0, 0.01).force
    assert abs(force[1]) == pytest.approx(1000.0 * 9.81 * 0.4, rel=0.02)
    assert abs(force[0]) < 0.05 * abs(force[1])
