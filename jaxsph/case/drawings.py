"""Outlines of solids from DXF and SVG drawings, read by the libraries of the extra `drawings`."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from jaxsph.case.data_files import read_text
from jaxsph.case.extras import library
from jaxsph.errors import CaseError

Corners = NDArray[np.float64]

FINE = 1.0e-4
"""Largest ratio of the distance between a curve and its chords to the extent of the outline."""
PIXEL = 0.0254 / 96.0
"""Length of a pixel, m, in an SVG drawing whose size has a unit, for example millimetres."""


def read_outline(path: Path, scale: float | None) -> Corners:
    """Corners `[K, 2]` (m) of the only closed outline in a drawing, with x to the right and z upwards.

    **Arguments**: `scale`: factor on the drawing's lengths, or metres per unit if the drawing has no unit.
    **Raises** CaseError if the drawing cannot be read, has no unit while `scale` is None, or does not have
    exactly one closed outline. Messages never show the content of the drawing.
    """
    text = read_text(path, "drawing", "give the name of a DXF or SVG file, relative to the case's folder")
    read = _DRAWINGS[path.suffix.lower()]
    try:
        outlines, unit = read(text)
    except CaseError as error:
        raise CaseError(f"{path}: {error}") from None
    except Exception:  # the libraries raise errors of any type for a damaged file
        raise CaseError(
            f"{path} cannot be read as a drawing; save the drawing again as {path.suffix[1:].upper()}"
        ) from None
    if unit is None and scale is None:
        raise CaseError(f"{path} has no unit of length: give scale, in m per drawing unit")
    if len(outlines) != 1:
        remedy = "use a separate drawing for each solid"
        if not outlines:
            remedy = "draw the outline as a closed polyline or path, a circle or an ellipse"
        raise CaseError(f"{path} has {len(outlines)} closed outlines: must have one; {remedy}")
    return outlines[0] * (1.0 if unit is None else unit) * (1.0 if scale is None else scale)


def _dxf(text: str) -> tuple[list[Corners], float | None]:
    """Closed outlines of a DXF drawing, and the length of the drawing's unit, m, or None without a unit."""
    ezdxf, units, path = (_library(f"ezdxf{part}") for part in ("", ".units", ".path"))
    drawing = ezdxf.read(io.StringIO(text))
    paths = [path.make_path(one) for one in drawing.modelspace() if one.dxftype() in CLOSED]
    outlines = []
    for one in paths:
        if one.is_closed:
            rough = np.array([(v.x, v.y) for v in one.control_vertices()])
            fine = [(v.x, v.y) for v in one.flattening(FINE * float(np.max(np.ptp(rough, axis=0))))]
            outlines.append(_without_repeats(np.array(fine)))
    return outlines, units.conversion_factor(drawing.units, units.M) if drawing.units else None


CLOSED = ("LWPOLYLINE", "POLYLINE", "CIRCLE", "ELLIPSE", "SPLINE")
"""Entities of a DXF drawing that can be a closed outline."""


def _svg(text: str) -> tuple[list[Corners], float | None]:
    """Closed outlines of an SVG drawing, and the length of the drawing's unit, m.

    Positions are relative to the lower left corner. The length is None if the drawing's size has no unit.
    """
    svg = _library("svgelements")
    drawing = svg.SVG.parse(io.StringIO(text))
    outlines = []
    for element in drawing.elements():
        if isinstance(element, svg.Shape):
            path = svg.Path(element)
            path.reify()
            for part in path.as_subpaths():
                outlines += _closed(svg, svg.Path(part))
    if drawing.viewbox is None and "height" not in drawing.values:
        raise CaseError(
            "the drawing needs a height or a viewBox, because its lower left corner is the origin; save the "
            "drawing with a page size"
        )
    size = str(drawing.values.get("height", ""))
    unit = PIXEL if size.endswith(("mm", "cm", "in", "pt", "pc")) else None
    return [np.array([0.0, float(drawing.height)]) + one * [1.0, -1.0] for one in outlines], unit


def _closed(svg: ModuleType, path) -> Iterator[Corners]:
    """Yields the corners of an SVG path if the path is closed; chords replace the curves."""
    box = path.bbox()
    if box is None or not (isinstance(path[-1], svg.Close) or path.first_point == path.current_point):
        return
    close = FINE * max(box[2] - box[0], box[3] - box[1])
    corners = [np.array([path.first_point])]
    for part in path[1:]:
        straight = isinstance(part, svg.Line | svg.Close)
        corners.append(np.array([part.end]) if straight else _chords(part.npoint, close)[1:])
    yield _without_repeats(np.concatenate(corners).astype(float))


def _chords(curve: Callable[[NDArray], NDArray], close: float) -> Corners:
    """Points on a parametric curve (parameter 0 to 1). The chords between the points deviate from the curve
    by less than `close` (drawing units), unless more than `MOST` chords are needed."""
    number = 4
    while True:
        points = curve(np.linspace(0.0, 1.0, 2 * number + 1))
        ends, middles = points[::2], points[1::2]
        if number > MOST or np.max(np.abs(middles - 0.5 * (ends[1:] + ends[:-1]))) < close:
            return ends
        number *= 2


MOST = 500
"""Number of chords beyond which a curve is not refined, because a polygon has at most a thousand corners."""


def _without_repeats(corners: Corners) -> Corners:
    """Removes corners that repeat the previous corner; the last corner counts as previous to the first."""
    apart = np.max(np.abs(corners - np.roll(corners, 1, axis=0)), axis=1)
    return corners[apart > 1e-9 * np.max(np.ptp(corners, axis=0))]


def _library(name: str) -> ModuleType:
    """Imports a library of the extra `drawings`; see `library`."""
    return library(name, "drawings", "a drawing")


_DRAWINGS = {".dxf": _dxf, ".svg": _svg}
DRAWINGS = tuple(_DRAWINGS)
"""File name endings of drawings."""
