"""What pictures and pages draw around the particles: whole bodies, moorings and links."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from test_moorings_case import BODY, CHAIN, LINE, TANK

import jaxsph as js
from jaxsph.errors import CaseError
from jaxsph.model.consistency import RESERVED, check_parts
from jaxsph.output.plot.particles import PRESSURE, _limits, _Picture
from jaxsph.output.plot.tank import Tank
from jaxsph.output.run_file import RunFile
from jaxsph.report.frames import Frames
from jaxsph.report.pack import Pack
from jaxsph.run.scene import places_of, scene_of

LINKS = {
    "rope": {"between": ["tank", "body"], "at": [[2.0, 0.0], [2.0, 0.4]], "stiffness": 10.0},
    "brake": {"body": "body", "motion": "heave", "damping": 1.0},
}
MOORINGS = {"chain": CHAIN, "line": LINE | {"at": [2.2, 0.45], "anchor": [3.6, 0.0]}}
MOVED = (0.05, 0.02, 0.3)
"""Pose of the body in which the links are drawn, m, m, rad."""


@pytest.fixture(scope="module")
def moored():
    """A floating box with a catenary, a line of lumped masses, a rope and a take-off along its heave."""
    return js.Case.from_dict(TANK | {"body": BODY, "mooring": MOORINGS, "link": LINKS}).problem()


@pytest.fixture(scope="module")
def moved(moored):
    """Its state with the body in the pose `MOVED`, and the extensions of the links that belong to it."""
    model, state = moored.model, moored.state
    body = eqx.tree_at(lambda m: m.q, state.parts["body"], jnp.asarray(MOVED, jnp.float32))
    parts = dict(state.parts) | {"body": body}
    parts |= model.mechanism.placed(parts, jnp.float32(0.0))
    for link in model.links:
        s = model.mechanism.extension(link, parts, jnp.float32(0.0))
        parts[link.name] = eqx.tree_at(lambda m: m.extension, parts[link.name], s)
    own = eqx.tree_at(lambda m: m.own.end, parts["line"], parts["line"].extension)
    return eqx.tree_at(lambda s: s.parts, state, parts | {"line": own})


def carried(point):
    """Where a point of the body is in the pose `MOVED`; the body turns about its centre."""
    pivot, (c, s) = np.array([2.0, 0.5]), (np.cos(MOVED[2]), np.sin(MOVED[2]))
    x, z = np.asarray(point) - pivot
    return pivot + MOVED[:2] + [c * x + s * z, c * z - s * x]


def test_links_are_drawn_from_end_to_end(moored, moved):
    drawn = places_of(moored.model, moved)
    assert set(scene_of(moored)["lines"]) == {"rope", "chain", "line"}
    assert drawn["body"] == pytest.approx(MOVED)
    ends = {"rope": LINKS["rope"]["at"]} | {n: [m["anchor"], m["at"]] for n, m in MOORINGS.items()}
    for name, (anchor, at) in ends.items():
        assert drawn[name][0] == pytest.approx(anchor, abs=1e-6)
        assert drawn[name][-1] == pytest.approx(carried(at), abs=1e-4)
    assert "brake" not in drawn


def test_a_catenary_is_drawn_with_its_length_above_the_bed(moored, moved):
    chain = places_of(moored.model, moved)["chain"]
    length = np.sum(np.hypot(*np.diff(chain, axis=0).T))
    # it stretches by its tension over 1000 N, some per cent at most
    assert CHAIN["length"] * 0.999 < length < CHAIN["length"] * 1.05
    assert chain[:, 1].min() > -1e-5


def test_pictures_and_pages_show_lines_and_the_whole_body(moored, moved, tmp_path):
    drawn = places_of(moored.model, moved)
    run = RunFile.create(tmp_path / "run.h5", 'name = "moored"', {}, {}, scene=scene_of(moored))
    p = moored.state.particles
    water = {"x": np.asarray(p.x), "u": np.asarray(p.u), "p": np.asarray(p.p), "id": np.asarray(p.id)}
    for t in (0.1, 0.2):
        run.append({"time": np.array([t])}, {}, {"time": t} | water | drawn, {}, {})
    tank = Tank.of(run)
    assert tank.top > 0.6 and set(tank.lines) == {"rope", "chain", "line"}
    snapshot = run.snapshot(-1)
    picture = _Picture(tank, PRESSURE, _limits(PRESSURE, [snapshot]))
    picture.show(snapshot)
    shown = {name: np.transpose(line.get_data()) for name, line in picture.lines}
    assert all(shown[name] == pytest.approx(drawn[name]) for name in tank.lines)
    content = Frames(run).content(Pack())
    assert [one["count"] for one in content["tank"]["lines"]] == [len(drawn[name]) for name in tank.lines]
    assert [one["points"]["n"] for one in content["tank"]["lines"]] == [
        2 * 2 * len(drawn[name]) for name in tank.lines
    ]


@pytest.mark.parametrize("name", RESERVED)
def test_no_part_has_the_name_of_a_field_of_the_particles(name, moored):
    """A snapshot would hold the pose of the body in place of the positions of the particles."""
    step = {"block": {"low": [3.0, 0.0], "high": [3.2, 0.2]}}
    with pytest.raises(CaseError, match=f"bodies.{name}: the names .* are reserved"):
        js.Case.from_dict(TANK | {"bodies": {name: BODY}})
    # a solid at rest is drawn where it is, without an entry in the snapshots
    fixed = js.Case.from_dict(TANK | {"solid": {name: step}}).problem()
    assert name not in places_of(fixed.model, fixed.state)
    (drawn,) = (one for one in scene_of(fixed)["solids"] if np.max(one["corners"]) < 4.0)
    assert drawn["name"] == "" and np.max(drawn["corners"], axis=0) == pytest.approx([3.2, 0.2])
    link, *others = moored.model.links
    links = (dataclasses.replace(link, name=name), *others)
    with pytest.raises(ValueError, match="a snapshot needs id, p, step"):
        check_parts(dataclasses.replace(moored.model, links=links))
