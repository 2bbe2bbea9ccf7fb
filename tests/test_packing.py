"""Packing of still water around solids."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxsph.case.initial import outside_body, still_water
from jaxsph.core.pairs import Smoothing
from jaxsph.schemes.incompressible import ISPH
from jaxsph.solids.box import Box, FreeSlip
from jaxsph.solids.filling import DummyParticles
from jaxsph.solids.placement import lattice
from jaxsph.solids.shapes import Block, Disc, Polygon, box_corners
from jaxsph.solids.walls import Ghosts

DX, LEVEL = 0.02, 0.4
TILTED = Polygon(((0.32, 0.18), (0.48, 0.10), (0.54, 0.22), (0.38, 0.30)))
HALF_IN = Disc((0.4, 0.4), 0.1)
FITTING = Block((0.3, 0.2), (0.5, 0.5))


def _around(shape, sides=("walls", "floor")):
    """Ghosts, and water packed around the shape."""
    smoothing: Smoothing = ISPH.of(DX, speed=1.0, dim=2).smoothing
    box = Box((0.0, 0.0), (0.8, 0.6), sides=sides)
    walls = Ghosts.build(box, DX, smoothing, FreeSlip(), filling=DummyParticles(), shapes=(shape,))
    return walls, *still_water(walls, LEVEL, DX, [shape])


def _cut(shape):
    """Water on the lattice, before the packing."""
    x, _ = lattice((0.0, 0.0), (0.8, LEVEL), DX)
    return x[outside_body(_away(shape, x) / DX)]


def _away(shape, x):
    return np.asarray(shape.distance(jnp.asarray(x, jnp.float32)))


def _unevenness(x, volume, walls, shape):
    """Sum of V W minus 1 near the shape and below the surface's reach, with a Gaussian of 1.2 spacings."""
    deep = (x[:, 1] < LEVEL - 4.2 * DX) & (_away(shape, x) < 4 * DX)
    every = np.concatenate([x, np.asarray(walls.x)]) / DX
    V = np.concatenate([volume, np.asarray(walls.volume)]) / DX**2
    pairs = KDTree(x[deep] / DX).sparse_distance_matrix(KDTree(every), 4.2, output_type="ndarray")
    W = np.exp(-((pairs["v"] / 1.2) ** 2)) / (np.pi * 1.2**2)
    return np.bincount(pairs["i"], V[pairs["j"]] * W, deep.sum()) - 1.0


@pytest.mark.parametrize("shape", [TILTED, HALF_IN], ids=["tilted", "disc"])
def test_water_is_even_around_a_solid(shape):
    """The sum is off by a few per cent on the cut lattice, and by a few thousandths after the packing."""
    walls, x, volume = _around(shape)
    before = _cut(shape)
    assert x.shape == before.shape
    ragged = _unevenness(before, np.full(len(before), DX**2), walls, shape)
    even = _unevenness(x, volume, walls, shape)
    assert np.abs(ragged).max() > 0.015
    assert np.sqrt(np.mean(even**2)) < 0.5 * np.sqrt(np.mean(ragged**2))
    assert np.abs(even).max() < 0.01
    assert _away(shape, x).min() > 0.35 * DX
    nearest = KDTree(x).query(x, k=2)[0][:, 1]
    assert nearest.min() > 0.8 * DX


def test_surface_and_far_water_stay():
    _, x, volume = _around(HALF_IN)
    before = _cut(HALF_IN)
    far = _away(HALF_IN, before) >= 6 * DX
    np.testing.assert_array_equal(x[far], before[far])
    np.testing.assert_array_equal(volume[far], DX**2)
    # the top row is half a spacing below the surface, up to what the disc leaves over in a row
    row = ~far & (before[:, 1] > LEVEL - DX)
    assert np.abs(x[row, 1] - before[row, 1]).max() < 0.25 * DX
    # whole particles fill the space, to half a particle
    section = 0.5 * np.pi * HALF_IN.radius**2
    assert volume.sum() == pytest.approx(0.8 * LEVEL - section, abs=DX**2)


def test_a_lattice_that_fits_stays():
    """Up to the motion that remains after the last iteration."""
    _, x, volume = _around(FITTING)
    np.testing.assert_allclose(x, _cut(FITTING), atol=2e-3 * DX)
    np.testing.assert_allclose(volume, DX**2, rtol=1e-4)


def test_water_stays_inside_periodic_ends():
    """The packing does not use the water beyond a periodic end, and moves nothing near that end."""
    shape = Disc((0.02, 0.2), 0.06)
    _, x, _ = _around(shape, ("periodic", "floor"))
    before = _cut(shape)
    beside = np.minimum(before[:, 0], 0.8 - before[:, 0]) < 3.5 * DX
    np.testing.assert_array_equal(x[beside], before[beside])
    assert x[~beside, 0].min() > 0.0 and x[~beside, 0].max() < 0.8


@pytest.mark.parametrize(("angle", "radius"), [(0.31, 0.094), (0.5, 0.1), (0.67, 0.117)])
def test_the_water_is_a_smooth_function_of_a_solid(angle, radius):
    """A second, equal change of a box's angle or a disc's radius moves water and dummies equally far.

    Otherwise a slope with respect to a shape would be a slope of jumps.
    """
    change = 1e-4

    def built(k):
        corners = box_corners((-0.1, -0.06), (0.1, 0.06))
        turn = angle + k * change + np.array([0.0, 0.5 * np.pi])
        tilted = Polygon([0.37, 0.22] + corners @ np.stack([np.cos(turn), np.sin(turn)]))
        found = []
        for shape in (tilted, Disc((0.37, 0.22), radius + k * change)):
            walls, x, volume = _around(shape)
            found += [np.asarray(walls.x, float), np.asarray(walls.volume, float), x, volume]
        return found

    for before, here, after in zip(*(built(k) for k in (-1, 0, 1)), strict=True):
        first, second = after - before, after - 2.0 * here + before
        # four times the rounding of single precision
        assert np.abs(second).max() < 0.05 * np.abs(first).max() + 2.4e-7 * np.abs(here).max()
