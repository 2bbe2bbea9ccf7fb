"""Water that overtops a crest or runs up a face: keys of a case, and the readings."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsph as js
from jaxsph.case.geometry import Geometry
from jaxsph.case.results import case_results
from jaxsph.case.shapes import crest_of
from jaxsph.errors import CaseError
from jaxsph.problem.record import Record, Window
from jaxsph.solids.shapes import Block, Disc, Polygon

CASE = js.Case.from_dict(
    {
        "dx": 0.04,
        "t1": 4.0,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": 3.6, "depth": 0.4},
        "waves": {"H": 0.06, "T": 1.2},
        "solid": {"wall": {"polygon": [[1.8, 0.0], [2.8, 0.5], [3.0, 0.5], [3.0, 0.0]]}},
        "probes": {"overtopping": ["wall"], "run_up": ["wall"]},
        "output": {"sample_dt": 0.02},
    }
)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"probes.run_up": ["quay"]}, "probes.run_up: there is no solid 'quay'; choose from wall"),
        ({"probes.overtopping": ["device"]}, "there is no solid 'device'"),
        (
            {"solid.wall.polygon": [[1.8, 0.0], [2.4, 0.3], [3.0, 0.0]]},
            "the crest of wall, at z = 0.3 m, must be above still water, at z = 0.4 m",
        ),
    ],
)
def test_a_crest_that_is_none_is_refused(changes, message):
    with pytest.raises(CaseError, match=message):
        CASE.replace(changes)


@pytest.mark.parametrize(
    "shape, crest",
    [
        (Block((1.0, 0.0), (1.5, 0.5)), (1.5, 0.5)),
        (Polygon(((0.0, 0.0), (1.0, 0.5), (1.2, 0.5), (1.2, 0.0))), (1.2, 0.5)),
        (Polygon(((0.0, 0.0), (1.0, 0.5), (2.0, 0.0))), (1.0, 0.5)),
        (Disc((1.0, 0.3), 0.2), (1.0, 0.5)),
    ],
)
def test_the_crest_is_the_landward_end_of_the_highest_part(shape, crest):
    np.testing.assert_allclose(crest_of(shape, 0.02), crest, atol=0.01)


@pytest.fixture(scope="module")
def built():
    """Problem of the case, and a function that reads its coastal probes after moving some particles."""
    problem = CASE.problem()
    probes = [p for p in problem.probes if any("wall" in n and "force" not in n for n in p.describe())]

    def read(x, u):
        """Readings with the first particles at x, with the velocities u."""
        p, n = problem.state.particles, len(x)
        moved = (p.x.at[:n].set(x), p.u.at[:n].set(u))
        state = eqx.tree_at(lambda s: (s.particles.x, s.particles.u), problem.state, moved)
        found = [probe.measure(problem.model, state, None) for probe in probes]
        return {name: float(value) for one in found for name, value in one.items()}

    return problem, read


def test_water_behind_the_crest_is_what_has_gone_over_it(built):
    """None at rest; five particles on the lee side count as five volumes, whatever their level."""
    problem, read = built
    assert set(read(jnp.zeros((0, 2)), jnp.zeros((0, 2)))) == {
        "overtopped_wall",
        "overtopping_wall",
        "run_up_wall",
    }
    assert read(problem.state.particles.x[:0], jnp.zeros((0, 2)))["overtopped_wall"] == pytest.approx(0.0)
    V = float(problem.state.particles.m[0]) / 1000.0
    there = jnp.array([[3.3, 0.41 + 0.02 * i] for i in range(5)])
    found = read(there, jnp.zeros_like(there))
    assert found["overtopped_wall"] == pytest.approx(5.0 * V, rel=1e-4)
    assert found["overtopping_wall"] == 0.0


def test_a_sheet_over_the_crest_flows_as_thick_as_it_is(built):
    """A row of particles a spacing apart passes the crest at 1 m/s: the flow is its volume per length."""
    problem, read = built
    x = jnp.stack([3.0 + 0.04 * (jnp.arange(12) - 5.5), jnp.full(12, 0.52)], axis=1)
    V = float(problem.state.particles.m[0]) / 1000.0
    found = read(x, jnp.broadcast_to(jnp.array([1.0, 0.0]), x.shape))
    assert found["overtopping_wall"] == pytest.approx(V / 0.04, rel=1e-3)


def test_run_up_is_the_highest_water_on_the_face_alone(built):
    """At rest it is the still water level, within the part of a spacing by which the slope cuts the lattice.

    A particle on the face raises it, but a particle in the air or behind the crest does not.
    """
    _, read = built
    still = read(jnp.zeros((0, 2)), jnp.zeros((0, 2)))["run_up_wall"]
    assert abs(still) < 0.04
    on_face, in_air, behind = [2.68, 0.46], [2.3, 0.6], [3.02, 0.49]
    for places, level in (([on_face], 0.08), ([in_air], still), ([behind], still), ([on_face, in_air], 0.08)):
        x = jnp.array(places)
        assert read(x, jnp.zeros_like(x))["run_up_wall"] == pytest.approx(level, abs=1e-3)


def test_results_are_a_mean_flow_and_a_mean_of_the_periods_highest():
    """From artificial series over two periods."""
    t = np.linspace(0.0, 4.0, 201)
    series = {"overtopped_wall": 0.01 * t, "run_up_wall": 0.05 * np.sin(2 * np.pi * t / 1.2) + 0.01 * t}
    over = t >= 1.6 - 1e-9
    solution = type("Made", (), {"t": t, "series": series, "__getitem__": lambda self, n: series[n]})()
    record = Record(solution, Window(over, periods=2), 0.0)
    made = {r.what: r.make(record) for r in case_results(CASE) if r.what in ("mean overtopping", "run-up")}
    assert made["mean overtopping"]["overtopping_wall"] == pytest.approx(0.01)
    each = np.array_split(series["run_up_wall"][over], 2)
    assert made["run-up"]["run_up_wall"] == pytest.approx(np.mean([part.max() for part in each]))
    unsettled = Record(solution, Window(over), 0.0)
    assert not any(r.make(unsettled) for r in case_results(CASE) if r.what in made)


def test_the_readings_are_named_after_the_solid():
    assert Geometry.of(CASE).solids.keys() == {"wall"}
    told = {name for probe in CASE.problem().probes for name in probe.describe()}
    assert {"overtopped_wall", "overtopping_wall", "run_up_wall"} <= told
