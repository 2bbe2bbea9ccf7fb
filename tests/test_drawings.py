"""Outlines of solids from drawings and from CSV files."""

import sys

import ezdxf
import numpy as np
import pytest
from ezdxf import units

import jaxsph as js
from jaxsph.errors import CaseError

SECRET = "correct-horse"
CASE = """
dx = 0.1
t1 = 1.0
[tank]
length = 4.0
depth = 0.4
[solid.hull]
"""
RADIUS = 0.2
"""Radius of the round end of the outline, m."""
STRAIGHT = [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0 * RADIUS], [0.0, 2.0 * RADIUS]]
"""Corners of a rectangle, m; a half circle is attached to the right side."""


def _dxf(path, *, unit=units.MM, outlines=1):
    """Writes a DXF drawing of the outline, with the half circle as a bulge between its ends."""
    drawing, per_metre = ezdxf.new(), 1000.0 if unit == units.MM else 1.0
    drawing.units = unit
    corners = [(per_metre * x, per_metre * z) for x, z in STRAIGHT]
    points = [(*corners[0], 0.0), (*corners[1], 1.0), (*corners[2], 0.0), (*corners[3], 0.0)]
    for _ in range(outlines):
        drawing.modelspace().add_lwpolyline(points, format="xyb", close=True)
    drawing.modelspace().add_text(SECRET)
    drawing.saveas(path)


def _svg(path, *, unit="mm", outlines=1, close="Z"):
    """Writes the same as SVG, on a page of 1200 mm by 500 mm from its lower left corner; y is downwards."""
    size = f'width="1200{unit}" height="500{unit}" viewBox="0 0 1200 500"'
    outline = f'<path d="M 0 500 L 1000 500 A 200 200 0 0 0 1000 100 L 0 100 {close}"/>'
    text = f"<desc>{SECRET}</desc>{outlines * outline}"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{text}</svg>')


def _hull(tmp_path, file, more=""):
    """Shape of a case whose solid has its outline in a file."""
    path = tmp_path / "case.toml"
    path.write_text(CASE + f'file = "{file}"\n{more}')
    return js.Polygon(js.load_case(path).solid["hull"].polygon)


@pytest.mark.parametrize(("file", "draw"), [("hull.dxf", _dxf), ("hull.SVG", _svg)])
def test_a_drawing_has_the_size_of_its_unit(tmp_path, file, draw):
    """Area and centre of the rectangle with the half circle, within the error of the chords."""
    draw(tmp_path / file)
    area_of, centre, _ = _hull(tmp_path, file).moments()
    box, round_end = 2.0 * RADIUS, 0.5 * np.pi * RADIUS**2
    area = box + round_end
    x = (0.5 * box + (1.0 + 4.0 * RADIUS / (3.0 * np.pi)) * round_end) / area
    assert area_of == pytest.approx(area, rel=1e-3)
    np.testing.assert_allclose(centre, [x, RADIUS], rtol=1e-3)


@pytest.mark.parametrize(("file", "draw"), [("hull.dxf", _dxf), ("hull.svg", _svg)])
def test_a_drawing_is_scaled_and_placed(tmp_path, file, draw):
    """The corner at the drawing's origin goes to `at`, and `scale` multiplies all distances from it."""
    draw(tmp_path / file)
    corners = np.asarray(_hull(tmp_path, file, "scale = 0.5\nat = [2.0, 0.1]").vertices)
    for corner in ([2.0, 0.1], [2.5, 0.1], [2.0, 0.1 + RADIUS]):
        assert np.min(np.linalg.norm(corners - corner, axis=1)) < 1e-6


def test_a_csv_is_scaled_and_placed_alike(tmp_path):
    """The same keys, for a table in millimetres."""
    rows = "".join(f"{1000 * x},{1000 * z}\n" for x, z in STRAIGHT)
    (tmp_path / "hull.csv").write_text("x,z\n" + rows)
    shape = _hull(tmp_path, "hull.csv", "scale = 0.001\nat = [0.5, 0.0]")
    np.testing.assert_allclose(shape.vertices, np.add(STRAIGHT, [0.5, 0.0]))


@pytest.mark.parametrize(
    ("draw", "more", "words"),
    [
        (lambda p: _dxf(p / "hull.dxf", unit=0), "", "has no unit of length: give scale, in m"),
        (lambda p: _svg(p / "hull.svg", unit=""), "", "has no unit of length: give scale, in m"),
        (lambda p: _dxf(p / "hull.dxf", outlines=2), "", "has 2 closed outlines: must have one"),
        (lambda p: _svg(p / "hull.svg", outlines=3), "", "has 3 closed outlines: must have one"),
        (lambda p: _svg(p / "hull.svg", close=""), "", "has 0 closed outlines: must have one"),
        (lambda p: (p / "hull.dxf").write_text(SECRET), "", "cannot be read as a drawing; .* as DXF"),
        (
            lambda p: (p / "hull.svg").write_text(f"<svg><{SECRET}"),
            "",
            "cannot be read as a drawing; .* as SVG",
        ),
        (
            lambda p: (p / "hull.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>"),
            "",
            "needs a height",
        ),
        (lambda p: (p / "hull.dwg").write_text(SECRET), "", "a drawing whose name ends in .dxf or .svg"),
        (
            lambda p: _svg(p / "hull.svg"),
            "scale = -1.0",
            "solid.hull.scale = -1.0: must be a positive number",
        ),
        (lambda p: _svg(p / "hull.svg"), "at = [1.0]", r"solid.hull.at = \[1.0\]: must be a position"),
    ],
)
def test_a_drawing_that_cannot_be_used_is_refused(tmp_path, draw, more, words):
    """The message says what is wrong with the file, and shows nothing of the file's content."""
    draw(tmp_path)
    (file,) = (path.name for path in tmp_path.iterdir())
    with pytest.raises(CaseError, match=words) as caught:
        _hull(tmp_path, file, more)
    assert SECRET not in str(caught.value)


def test_a_drawing_without_its_library_says_what_to_install(tmp_path, monkeypatch):
    """The library belongs to an extra."""
    _svg(tmp_path / "hull.svg")
    monkeypatch.setitem(sys.modules, "svgelements", None)
    with pytest.raises(CaseError, match=r"needs svgelements, .* pip install 'jaxsph\[drawings\]'"):
        _hull(tmp_path, "hull.svg")
