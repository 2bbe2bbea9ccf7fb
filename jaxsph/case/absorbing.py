"""Sponge layers and relaxation zones that absorb waves in a tank, and checks of their positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.pools import Pool, WaterSurface
from jaxsph.case.sections import ONLY_BODY, Sections
from jaxsph.errors import CaseError
from jaxsph.parts.sponge import Sponge, SpongeLayer


class Zone(NamedTuple):
    """Zone along a wall of the tank."""

    key: str
    """Key of the case that gives the thickness of the zone."""
    thickness: float
    """Thickness, m."""
    axis: int
    """Axis normal to the wall: 0 along the tank, 1 across it."""
    far: bool
    """Whether the zone is along the wall at the higher coordinate."""

    def ends(self, geometry: Geometry) -> tuple[float, float]:
        """Lower and upper coordinate of the zone along `axis`, m."""
        size = geometry.upper[self.axis]
        return (size - self.thickness, size) if self.far else (0.0, self.thickness)


def sponge_layers(case: Sections) -> list[Zone]:
    """Layers of a case's sponge."""
    sponge = case.sponge
    if sponge is None:
        return []
    found = [Zone("sponge.length", sponge.length, 0, True)]
    if sponge.near is not None:
        found.append(Zone("sponge.near", sponge.near, 0, False))
    if sponge.sides is not None:
        found += [Zone("sponge.sides", sponge.sides, 1, far) for far in (False, True)]
    return found


def relaxation_zones(case: Sections) -> list[Zone]:
    """Zones of a case in which the water is relaxed towards the waves of the case."""
    waves, found = case.waves, []
    if waves is None:
        return []
    if waves.zone is not None:
        found.append(Zone("waves.zone", waves.zone, 0, False))
    if waves.side_zones is not None:
        found += [Zone("waves.side_zones", waves.side_zones, 1, far) for far in (False, True)]
    return found


def make_sponges(case: Sections, geometry: Geometry, leaf: Any) -> tuple[Sponge, ...]:
    """Sponge of a case; empty if the case has none. `leaf` converts a number to an array."""
    if case.sponge is None:
        return ()
    layers = []
    for zone in sponge_layers(case):
        low, high = zone.ends(geometry)
        # a layer ends a spacing beyond the wall, so that the layer contains water at the wall
        start, end = (low, high + case.dx) if zone.far else (high, low - case.dx)
        layers.append(SpongeLayer(leaf(start), leaf(end), zone.axis))
    return (Sponge(tuple(layers), leaf(case.sponge.strength)),)


def check_absorbing(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for sponge layers that do not fit, for zones that cover a device, a body or a
    chamber, and for relaxation zones along the side walls that cover a solid."""
    _check_sponge(case, geometry)
    moving = {
        f"the body {name}" if name != ONLY_BODY else "the body": np.asarray(shape.bounds())
        for name, shape in geometry.bodies.items()
    }
    if geometry.plate is not None:
        moving["the device"] = np.array([[geometry.plate.x0], [geometry.length]])
    moving |= {f"the chamber {name}": _bounds(surface) for name, surface in geometry.stretches.items()}
    solids = {f"the solid {name}": np.asarray(shape.bounds()) for name, shape in geometry.solids.items()}
    for zone in sponge_layers(case) + relaxation_zones(case):
        # zones along the side walls relax the water towards the incident waves, which a solid disturbs
        covered = moving | (solids if zone.key == "waves.side_zones" else {})
        _check_clear(zone, covered, geometry)


def _check_sponge(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for a sponge that damps the waves of the case, or is too thick for the tank."""
    sponge = case.sponge
    if sponge is None:
        return
    for key, instead in (("near", "zone"), ("sides", "side_zones")):
        if case.waves is not None and getattr(sponge, key) is not None:
            raise CaseError(
                f"sponge.{key} = {getattr(sponge, key):g} m would damp the waves of the case: give "
                f"waves.{instead}, a relaxation zone that also absorbs waves, instead of sponge.{key}, or "
                "remove waves"
            )
    if sponge.sides is not None:
        given, width = f"sponge.sides = {sponge.sides:g} m", geometry.width
        if width is None:
            raise CaseError(
                f"{given} needs a tank in three dimensions: give tank.width, or remove sponge.sides"
            )
        if 2.0 * sponge.sides >= width:
            raise CaseError(f"{given}: must be less than half the width of {width:g} m")
    near = sponge.near or 0.0
    if sponge.length + near >= geometry.length:
        both, thick = ("sponge.length + sponge.near", "together ") if near else ("sponge.length", "")
        raise CaseError(
            f"{both} = {sponge.length + near:g} m: must {thick}be shorter than the tank "
            f"({geometry.length:g} m)"
        )


def _check_clear(zone: Zone, covered: Mapping[str, np.ndarray], geometry: Geometry) -> None:
    """**Raises** CaseError if a zone overlaps one of the bounds in `covered`, which are given by name."""
    first, last = zone.ends(geometry)
    coordinate = "xy"[zone.axis]
    for what, bounds in covered.items():
        if bounds.shape[1] <= zone.axis:
            continue
        low, high = (float(end[zone.axis]) for end in bounds)
        if first < high - 1e-9 and last > low + 1e-9:
            gone = "[sponge]" if zone.key == "sponge.length" else zone.key  # `sponge.length` is required
            beside = high >= last - 1e-9 if zone.far else low <= first + 1e-9  # a thinner zone overlaps too
            smaller = "" if beside else f"use a smaller {zone.key}, or "
            raise CaseError(
                f"{zone.key} = {zone.thickness:g} m: the zone from {coordinate} = {first:.4g} to {last:.4g} "
                f"m covers {what}, from {low:.4g} to {high:.4g} m, and would absorb energy there; "
                f"{smaller}remove {gone}"
            )


def _bounds(surface: WaterSurface) -> np.ndarray:
    """Lower and upper ends `[2, 1 or 2]` of a chamber's water surface along x, and in 3-D along y, m."""
    if isinstance(surface, Pool):
        return np.stack([surface.corners.min(axis=0), surface.corners.max(axis=0)])
    return np.array([[surface.first], [surface.last]])
