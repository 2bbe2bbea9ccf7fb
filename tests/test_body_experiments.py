"""Linear theory of floating bodies, and what the experiments with bodies read from their runs."""

import dataclasses
import json

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from experiments import common
from experiments.floating_body import (
    RHO,
    G,
    LinearBody,
    Spring,
    box_outline,
    disc_outline,
    hydrostatic_stiffness,
)
from experiments.heaving_cylinder import Cylinder, Release
from experiments.studies import buoy_damping
from experiments.validation import floating_devices
from experiments.verification import draughts, forced_bodies, linear_raos, moored_periods

BOX = LinearBody(box_outline(0.3, 0.1, 0.2), 0.4, 30.0, 0.378, (0.0, 0.0))


def test_stiffness_of_a_box_is_that_of_its_waterline_and_metacentre():
    found = hydrostatic_stiffness(BOX.outline, (0.0, -0.03))
    # metacentric radius 0.3^2 / (12 x 0.1), centre of buoyancy 0.05 m below the level
    metacentre = 0.3**2 / 1.2 - 0.05 + 0.03
    assert found == pytest.approx(RHO * G * np.diag([0.0, 0.3, 0.3 * 0.1 * metacentre]), abs=1e-9)
    aside = hydrostatic_stiffness(BOX.outline, (0.05, -0.03))
    assert aside[1, 2] == pytest.approx(RHO * G * 0.3 * 0.05)  # pitch lowers what is landward of the pivot


def test_stiffness_of_springs_is_the_curvature_of_their_energy():
    spring, centre, h = Spring((0.15, -0.05), (0.75, -0.4), 60.0), (0.02, -0.03), 1e-4

    def energy(q):
        x, z = np.subtract(spring.on_body, centre)
        c, s = np.cos(q[2]), np.sin(q[2])
        end = np.array([x * c + z * s + q[0], z * c - x * s + q[1]]) + centre
        rest = np.hypot(*np.subtract(spring.on_body, spring.anchor))
        return 0.5 * spring.stiffness * (np.hypot(*(end - spring.anchor)) - rest) ** 2

    e = h * np.eye(3)
    curvature = [
        [(energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b)) / (4 * h**2) for b in e] for a in e
    ]
    # differences of the energy are exact to h^2
    assert spring.matrix(centre) == pytest.approx(np.array(curvature), abs=1e-3)


def test_natural_period_has_the_added_mass_of_its_own_frequency():
    T = BOX.natural_period("heave")
    total = BOX.mass + BOX.water(2 * np.pi / T).added_mass[1, 1]
    assert T == pytest.approx(2 * np.pi * np.sqrt(total / BOX.stiffness[1, 1]), rel=2e-4)
    with pytest.raises(ValueError, match="no natural period"):
        BOX.natural_period("surge")


def test_a_released_cylinder_moves_as_by_its_memory():
    """The same motion by Cummins' equation, with the coefficients of Ursell's multipoles."""
    cylinder = Cylinder(0.1, 0.5)
    body = LinearBody(disc_outline(0.1), 0.5, cylinder.mass, 0.1, (0.0, 0.0))
    # surge has no restoring force; a weak spring keeps its static response finite
    body = dataclasses.replace(body, springs=(Spring((0.0, 0.0), (1.0, 0.0), 50.0),))
    t, z = Release(cylinder).path(0.025, 1.5)
    found = body.decay([0.0, 0.025, 0.0], t[::25])[1]
    # the tail of the response beyond 40 rad/s and the interpolated coefficients cost some 1e-3
    assert found == pytest.approx(z[::25], abs=0.005 * 0.025)


@pytest.mark.parametrize("shape", [*draughts.SHAPES, draughts.FLAT], ids=lambda shape: shape.name)
@pytest.mark.parametrize("ratio", draughts.RATIOS)
def test_hydrostatic_draught_displaces_the_weight(shape, ratio):
    outline, draught = shape.outline(), shape.draught(ratio)

    def under(level):
        return outline.intersection(shapely.box(-5.0, -5.0, 5.0, level)).area

    # the disc's outline is a polygon of 8000 sides
    assert under(draught) == pytest.approx(ratio * outline.area, rel=1e-6)
    width = (under(draught + 1e-4) - under(draught - 1e-4)) / 2e-4
    assert shape.width(draught) == pytest.approx(width, rel=1e-4)


@pytest.mark.parametrize("shape", [*draughts.SHAPES, draughts.FLAT], ids=lambda shape: shape.name)
def test_bodies_are_at_every_tenth_of_a_spacing(shape):
    tank = draughts.Tank(shape, 0.7, 0.02)
    case = tank.case()
    places = []
    for body, size in zip(case.every_body.values(), tank.sizes(), strict=True):
        if body.disc is not None:
            x, low = body.disc.centre[0], body.disc.centre[1] - body.disc.radius
        else:
            corners = np.array(body.polygon or (body.block.low, body.block.high))
            x, low = 0.5 * (corners[:, 0].min() + corners[:, 0].max()), corners[:, 1].min()
        assert abs(size / shape.usual - 1.0) < 0.15
        places.append([x / tank.dx, (draughts.DEPTH - low) / tank.dx])
    for axis in np.array(places).T:
        assert np.sort(np.round(10 * axis).astype(int) % 10) == pytest.approx(np.arange(10))
        assert 10 * axis == pytest.approx(np.round(10 * axis), abs=1e-6)


@given(st.lists(st.floats(-0.01, 0.01), min_size=3, max_size=3))
def test_draughts_of_boxes_follow_from_the_closed_tank(heaves):
    """Boxes lowered by `heaves`: the level rises until the area of the water is what it was."""
    tank = draughts.Tank(draughts.Box(), 0.5, 0.02, places=3)
    t = np.array([0.0, 6.0, 7.0])
    series = {"time": t} | {f"heave_body_{k}": np.full(3, -h) for k, h in enumerate(heaves)}
    low = draughts.DEPTH - tank.draughts() - heaves
    sizes = tank.sizes()
    water = tank.length * draughts.DEPTH - float(sizes @ tank.draughts())
    level = (water - float(sizes @ low)) / (tank.length - float(sizes.sum()))
    expected = (level - low - tank.draughts()) / tank.dx
    assert tank.errors(series) == pytest.approx(expected, abs=1e-9)


@given(st.floats(1.0, 50.0), st.floats(1.0, 300.0), st.floats(0.5, 1.5))
def test_forced_motion_gives_back_its_coefficients(added_mass, damping, T):
    """Force means over sampling intervals, which do not fit the period, of a known A, B and C."""
    omega, dt, C, a = 2 * np.pi / T, 0.01, 2000.0, 0.015
    t = dt * np.arange(1, int(8 * T / dt) + 1)
    x = a * np.sin(omega * t)
    # integral of -C x - A x'' - B x'
    whole = (C - omega**2 * added_mass) * a * np.cos(omega * t) / omega - damping * x
    start = (C - omega**2 * added_mass) * a / omega
    mean = np.diff(whole, prepend=start) / dt
    found = forced_bodies.coefficients(t, x, mean, T, C)
    for values, expected in zip(found, (added_mass, damping), strict=True):
        assert values == pytest.approx(np.full(forced_bodies.TAKEN, expected), rel=1e-5)


@pytest.mark.parametrize("body", [*forced_bodies.BODIES, forced_bodies.SHARP], ids=lambda body: body.name)
@pytest.mark.parametrize("motion", ["heave", "roll"])
def test_hydrostatic_force_of_a_small_motion_is_linear(body, motion, monkeypatch):
    monkeypatch.setattr(forced_bodies, "AMPLITUDE", 1e-4)
    one = forced_bodies.Forced(body, motion, 0.9)
    exact = hydrostatic_stiffness(body.outline, one.pivot)[one.index, one.index]
    assert one.stiffness() == pytest.approx(exact, rel=1e-5)


def test_a_cylinder_rolling_about_its_axis_moves_no_water():
    theory = forced_bodies.Forced(forced_bodies.CYLINDER, forced_bodies.AXIS, 0.9).theory()
    below = forced_bodies.Forced(forced_bodies.CYLINDER, "roll", 0.9).theory()
    assert all(abs(a) < 1e-3 * b for a, b in zip(theory, below, strict=True))
    surge = forced_bodies.Forced(forced_bodies.CYLINDER, "surge", 0.9).theory()
    assert below == pytest.approx(np.array(surge) * 0.12**2, rel=2e-3)


def test_forced_motions_are_valid_cases_and_resolved():
    for one in forced_bodies.members():
        case = one.case(0.01)
        arms = np.hypot(*np.subtract(one.body.outline, one.pivot).T)
        farthest = one.amplitude * (1.0 if one.index < 2 else arms.max())
        assert farthest == pytest.approx(0.015)  # one and a half spacings
        assert case.t1 == pytest.approx(8 * one.T)


def test_rao_is_about_the_drift():
    t, T = np.arange(0.0, 12.0, 0.02), 1.2
    y = 0.1 + 0.03 * t + 0.02 * np.cos(2 * np.pi * t / T + 1.0) + 0.003 * np.cos(4 * np.pi * t / T)
    assert linear_raos.rao(t, y, T, 0.015) == pytest.approx(0.02 / 0.015, rel=1e-9)


def test_raos_are_of_the_boxes_of_the_cases():
    for box in linear_raos.BOXES:
        case, theory = box.case(1.15, 0.02), box.theory()
        body = case.body
        wet = shapely.Polygon(theory.outline).intersection(shapely.box(-1.0, -1.0, 1.0, 0.0))
        assert body.mass == pytest.approx(1000.0 * wet.area)  # floats at its draught
        assert body.centre[1] - 0.4 == pytest.approx(theory.centre[1])
        assert len(theory.springs) == len(case.link)
    first, keeled, _ = (box.theory().metacentric_height for box in linear_raos.BOXES)
    assert first == pytest.approx(0.025)
    assert keeled == pytest.approx(0.09, abs=0.002)


@pytest.mark.parametrize("one", moored_periods.RELEASES, ids=lambda one: one.motion)
def test_links_are_at_rest_where_the_box_floats(one):
    case = one.case(0.02)
    away = np.array(one.start[:2])
    for link in case.link.values():
        on_body, anchor = np.array(link.at)
        assert np.hypot(*(on_body - away - anchor)) == pytest.approx(link.rest)
    assert case.body.angle == one.start[2]
    low, high = np.array(case.body.block.low) - away, np.array(case.body.block.high) - away
    assert 0.5 * (low + high) == pytest.approx([0.5 * one.length, 0.4])


def test_free_motion_of_the_box_is_from_its_equilibrium():
    one = moored_periods.Release("heave", 0.02, 1.0)
    series = {"time": np.array([0.0, 1.0, 2.0]), "heave": np.array([0.0, 0.0, -0.02])}
    t, z = one.free_motion(series)
    assert t == pytest.approx([0.0, 1.0]) and z == pytest.approx([0.02, 0.0])


def test_search_finds_the_maximum_of_linear_theory():
    best = buoy_damping.linear_best()
    seen = []

    def power(damping):
        seen.append(damping)
        return buoy_damping.linear_power(damping)

    last = buoy_damping.golden_section(power, *buoy_damping.BOUNDS, 9)
    assert len(seen) == 9 and abs(np.log(last / best)) < 0.1
    runs = np.array(seen)
    fitted = buoy_damping.best_of(runs, np.array([buoy_damping.linear_power(b) for b in runs]))
    # the power of linear theory is exactly that of the parabola
    assert fitted == pytest.approx((best, buoy_damping.linear_power(best)), rel=1e-6)
    assert buoy_damping.linear_power(best) > max(buoy_damping.linear_power(best * f) for f in (0.98, 1.02))


@pytest.mark.slow
def test_draughts_at_a_coarse_spacing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(common.Report, "folder", tmp_path)
    monkeypatch.setattr(draughts, "SHAPES", (draughts.Box(),))
    monkeypatch.setattr(draughts, "RATIOS", (0.5,))
    draughts.main(dx=0.04, places=2, t1=3.0)
    rows = json.loads((tmp_path / "draughts_0.04.json").read_text())["rows"]
    # three and five spacings of draught; bodies still heave a little after three seconds
    assert all(abs(row["here"]) < 0.5 for row in rows if row["unit"] == "dx")


def test_deviations_from_theory_leave_out_motions_that_theory_hardly_has():
    results = {"linear_amplitude_heave_a": 0.02, "linear_amplitude_heave_b": 1e-5, "linear_xi": 0.2}
    results |= {"amplitude_heave_a": 0.019, "amplitude_heave_b": 1e-3, "xi": 0.1}
    assert floating_devices.off_theory(results) == pytest.approx({"heave_a": -5.0, "power": -50.0})


@pytest.mark.slow
def test_floating_devices_are_reported(tmp_path, monkeypatch):
    """One coarse device: rows for its readings, its power and its energies."""
    for name in ("RUNS", "OWN"):
        monkeypatch.setattr(common, name, tmp_path)
    monkeypatch.setattr(common.Report, "folder", tmp_path)
    monkeypatch.setattr(floating_devices, "DEVICES", ("buoy_heave",))
    floating_devices.main(0.04)
    rows = json.loads((tmp_path / "floating_devices_0.04.json").read_text())["rows"]
    assert {"buoy_heave: power, deviation from linear theory", "buoy_heave: incident height"} <= {
        r["check"] for r in rows
    }
