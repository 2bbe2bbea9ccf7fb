"""A released column of water: what the case builds, and a coarse run (the slow lane has the fine one)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import coarse
from scipy.sparse import diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve

import jaxsph as js
from experiments.validation import dam_break
from jaxsph.case.geometry import Geometry
from jaxsph.errors import CaseError

DAM = js.load_case("dam_break")
NEAR = {"probes": {}}
"""No sensors: those of the built-in case are at the far wall, which a short tank does not have."""


# --- input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tank.column": 0.0}, r"tank.column = 0.0: must be positive"),
        ({"tank.column": -1.0}, r"tank.column = -1.0: must be positive"),
        ({"tank.column": 4.0}, r"tank.column = 4 m: must be at most tank.length = 3.22 m"),
        ({"tank.column": 0.03}, r"tank.column = 0.03 m does not fit dx = 0.02 m"),
        (
            {"waves": {"H": 0.04, "T": 1.2}},
            r"tank.column = 1.2 m is the length of a released column, but \[waves\] needs",
        ),
        (
            {"start": {"amplitude": 0.01}},
            r"tank.column = 1.2 m is the length of a released column, but \[start\] needs",
        ),
        (
            {"device": {"chamber_length": 0.3, "wall_thickness": 0.02, "draught": 0.2}},
            r"tank.column = 1.2 m is the length of a released column, but \[device\] needs",
        ),
    ],
)
def test_bad_columns_are_named_with_what_is_allowed(changes, message):
    with pytest.raises(CaseError, match=message):
        DAM.replace(changes)


def test_column_is_snapped_with_a_notice():
    case = DAM.replace({"tank.column": 1.205})
    assert any("tank.column = 1.205 m" in note and "becomes 1.2 m" in note for note in case.notices())
    assert Geometry.of(case).column == pytest.approx(1.2)
    # without a column, the water fills the tank
    assert Geometry.of(coarse("hydrostatic")).column == pytest.approx(1.0)


def test_whole_tank_as_a_column_is_a_tank_at_rest():
    case = DAM.replace({"dx": 0.1, "tank.length": 0.6, "tank.column": 0.6} | NEAR)
    model, state = js.build(case)
    rest = 1000.0 * 9.81 * (0.6 - state.particles.x[:, 1]) / model.scheme.c0**2
    np.testing.assert_allclose(state.particles.rho, rest, rtol=1e-5)  # rounding of float32


# --- what is built


@pytest.fixture(scope="module")
def built():
    """(model, state) of the built-in case."""
    return js.build(DAM)


@pytest.mark.parametrize("width", [None, 0.36])
def test_column_holds_the_water_it_says(width, built):
    """In two and in three dimensions."""
    deep = DAM.replace(
        {"dx": 0.09, "tank": {"length": 1.8, "depth": 0.36, "width": width, "column": 0.9}} | NEAR
    )
    model, state = built if width is None else js.build(deep)
    x, dx = np.asarray(state.particles.x), float(model.dx)
    size = np.array([1.2, 0.6] if width is None else [0.9, width, 0.36])
    # half a spacing from every face, within the rounding of float32
    np.testing.assert_allclose(x.min(axis=0), 0.5 * dx, rtol=1e-5)
    np.testing.assert_allclose(x.max(axis=0), size - 0.5 * dx, rtol=1e-5)
    assert len(x) == round(float(np.prod(size / dx)))
    # The mass exceeds that of water at rho0 by its compression, p/(rho0 c0^2): at most g H/c0^2.
    most = 9.81 * 0.6 / float(model.scheme.c0) ** 2
    mass = float(jnp.sum(state.particles.m)) / (1000.0 * np.prod(size)) - 1.0
    assert 0.0 < mass < most
    assert not np.any(np.asarray(state.particles.u))


def test_speed_of_sound_is_ten_times_the_dam_break_s_speed(built):
    """Eq. 2 with Ritter's front, 2 sqrt(g H)."""
    assert float(built[0].scheme.c0) == pytest.approx(20.0 * np.sqrt(9.81 * 0.6))


def test_pressure_of_a_release_solves_laplace_s_equation(built):
    """Compared with a direct finite-difference solution on the same 60 x 30 points.

    Both are of second order, except at the foot of the released face, where the pressure's slope has a
    logarithmic singularity: the difference is 0.5 % of rho g H. Hydrostatic pressure would be off by 98 %.
    """
    model, state = built
    p = np.asarray(state.particles.rho) * float(model.scheme.c0) ** 2 / (1000.0 * 9.81 * 0.6)
    nx, nz = 60, 30

    def second(count, last):
        """Second difference: zero slope at the low end, except for the source; p = 0 at the high face."""
        middle = np.full(count, -2.0)
        middle[0], middle[-1] = -1.0, last
        return diags_array([np.ones(count - 1), middle, np.ones(count - 1)], offsets=[-1, 0, 1])

    # p = 0 on a face half a spacing away: the ghost value is minus the last one
    lap = kron(second(nx, -3.0), eye_array(nz)) + kron(eye_array(nx), second(nz, -3.0))
    source = np.zeros((nx, nz))
    source[:, 0] = -1.0 / nz  # dp/dz = -rho g on the bed, over rho g H
    expected = spsolve(lap.tocsc(), source.ravel())
    assert np.max(abs(p - expected)) < 0.005


# --- a run


def test_coarse_front_is_between_experiment_and_computation():
    """Twelve spacings over the height, at T = 2.

    No gate delays the water here, so the front must not lag the slower experiment; nor may it lead the
    inviscid computation of Koshizuka and Oka. The front is known to a spacing (a/6) at best.
    """
    case = dam_break.front_case(12)
    # the sizes to which a run's tables grow when the jet passes: one slot more than the column needs at rest
    tables = {"capacity": 96, "node_capacity": 80, "chamber_capacity": 1, "rebuild_every": 2}
    model, state = js.build(case, tables)
    unit = np.sqrt(dam_break.WIDTH / (2 * dam_break.G))
    every = model.search.rebuild_every
    steps = round(2.0 * unit / float(model.dt) / every) * every
    end = jax.jit(js.simulate, static_argnames="n_steps")(model, state, n_steps=steps)[0]
    assert not int(end.status.bits)
    T = float(model.time(end)) / unit
    x, height = dam_break.front_and_height(np.asarray(end.particles.x), case.dx)
    slow = min(np.interp(T, s.T, s.x) for s in dam_break.measured().values())
    fast = np.interp(T, *dam_break.mps())
    spacing = case.dx / dam_break.WIDTH
    assert slow - spacing < x / dam_break.WIDTH < fast + spacing
    # the residual column: within a spacing (1/12 of its height) of Martin and Moyce's table
    assert height / dam_break.HEIGHT == pytest.approx(dam_break.residual(T), abs=1 / 12)
    # Without gate and paddle, the energy of the fall becomes kinetic energy, less a few per cent of losses;
    # only the initial compression could add to it.
    p = end.particles
    kinetic = float(0.5 * jnp.sum(p.m * jnp.sum(p.u**2, axis=1)))
    fallen = float(jnp.sum(p.m * 9.81 * (model.z0[p.id] - p.x[:, 1])))
    stored = float(model.scheme.compression(state.particles))
    assert 0.9 * fallen < kinetic < fallen + stored
    # no particle has left: a particle half a spacing inside a wall would have failed the run
    assert float(jnp.min(p.x)) > 0


def test_front_ignores_splashes():
    """Particles more than two spacings from the main body of water do not count as the front."""
    x = np.stack(np.meshgrid(np.arange(8.0), np.arange(4.0), indexing="ij"), -1).reshape(-1, 2)
    splash = np.array([[9.6, 0.0], [11.0, 3.0]])
    front, height = dam_break.front_and_height(np.concatenate([x, splash]), 1.0)
    assert (front, height) == (7.5, 3.5)
    near = np.array([[8.4, 0.0]])  # within two spacings: still the front
    assert dam_break.front_and_height(np.concatenate([x, near]), 1.0)[0] == pytest.approx(8.9)


def test_comparison_finds_a_constant_lead():
    """The table itself, shifted earlier by 0.3: the comparison finds this lead and no other deviation."""
    table = dam_break.measured()["Martin and Moyce, table"]
    front = dam_break.Front(table.T - 0.3, table.x, np.ones_like(table.T))
    found = dam_break.compared(front)
    # the mean of the leads over the table and over the figure, which differ by the error of reading
    assert found.lead["Martin and Moyce, table"] == pytest.approx(0.3, abs=0.05)
    raw = found.raw["Martin and Moyce, table"]
    assert np.mean(raw) > 5 * np.mean(abs(found.deviation["Martin and Moyce, table"]))
    assert np.max(found.outside) < found.scatter
    # a front at half the speed is far outside the scatter
    slow = dam_break.Front(2 * table.T, table.x, np.ones_like(table.T))
    assert np.max(dam_break.compared(slow).outside) > 3 * found.scatter
