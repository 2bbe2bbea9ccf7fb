"""Two-dimensional linear diffraction of regular waves by a fixed section in water of finite depth.

The time factor is exp(-i omega t), z is upwards from the still level, and the waves come from x = -inf.
Potentials are scaled so that the incident potential is exp(ikx) cosh k(z + h) / cosh kh. The pressure per
amplitude of the incident waves is then rho g times the potential.

The potential added by the section is computed on the boundary of the water between two vertical lines, which
are so far from the section that only propagating waves reach them. Green's identity is used with the source
ln r and its image in the bed. The normal derivative of the added potential is K = omega^2/g times the
potential on the surface, ik times the potential on the verticals (outgoing waves), and on the section the
negative of the incident potential's derivative. The potential is constant on each element, and the integrals
over the elements are exact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxsph.waves.theory import GRAVITY, wavenumber

Values = NDArray[np.floating]
"""Array of real numbers."""
Complex = NDArray[np.complexfloating]
"""Array of complex numbers."""
PER_WAVE = 80
"""Number of elements per wavelength on the surface and per depth on a vertical; with 40, R^2 + T^2 differs
from 1 by 1 %."""
FAR = 4.0
"""Distance from the section to the verticals over the depth (-); evanescent waves decay to exp(-1.6 FAR)."""


@dataclass(frozen=True)
class Diffraction:
    """Response of a fixed section to waves of unit amplitude."""

    force: Complex
    """Complex amplitudes of the force along x and upwards, shape (2,), N/m per metre of wave amplitude."""
    reflection: float
    """Height of the reflected waves over the height of the incident waves (-)."""
    transmission: float
    """Height of the waves behind the section over the height of the incident waves (-)."""


def diffraction(
    section: list[tuple[float, float]], depth: float, T: float, size: float, rho: float = 1000.0
) -> Diffraction:
    """Response of a fixed section to waves of period T (s) in water of the depth `depth` (m).

    `section`: corners (m) from right to left: the two at the still level, at x and -x, and those below
    this level. `size`: largest mean length of the elements on a side of the section, m.
    """
    omega = 2.0 * np.pi / T
    k = float(wavenumber(omega, depth))
    far = section[0][0] + FAR * depth
    surface = int(PER_WAVE * (far - section[0][0]) * k / (2.0 * np.pi))
    sides = [
        _line((far, -depth), (far, 0.0), PER_WAVE),
        _line((far, 0.0), section[0], surface),
        *(_line(a, b, _count(a, b, size)) for a, b in itertools.pairwise(section)),
        _line(section[-1], (-far, 0.0), surface),
        _line((-far, 0.0), (-far, -depth), PER_WAVE),
    ]
    behind, above, *body, before, front = np.split(
        np.arange(sum(len(side) for side in sides)), np.cumsum([len(side) for side in sides])[:-1]
    )
    on_section = np.concatenate(body)
    ends = np.concatenate(sides)
    middle, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=-1) / length[:, None]

    rise = k * (middle[:, 1] + depth)
    incident = np.exp(1j * k * middle[:, 0]) * np.cosh(rise) / np.cosh(k * depth)
    outwards = k * incident * (1j * normal[:, 0] + np.tanh(rise) * normal[:, 1])

    own, given = np.zeros(len(ends), complex), np.zeros(len(ends), complex)
    own[np.concatenate([above, before])] = omega**2 / GRAVITY
    own[np.concatenate([behind, front])] = 1j * k
    given[on_section] = -outwards[on_section]
    source, dipole = _integrals(ends, middle, depth)
    matrix = np.pi * np.eye(len(ends)) - dipole + source * own
    added = np.linalg.solve(matrix, -source @ given)
    total = incident + added

    push = (total * length)[on_section] @ normal[on_section]

    def wave(potential: Complex, at: Values) -> float:
        """Amplitude of the wave in a potential on a vertical: the part proportional to cosh k(z + h)."""
        shape = np.cosh(rise[at])
        return float(abs(potential[at] @ shape) / (shape @ shape) * np.cosh(k * depth))

    return Diffraction(rho * GRAVITY * push, wave(added, front), wave(total, behind))


def _count(a: tuple[float, float], b: tuple[float, float], size: float) -> int:
    """Number of elements between two corners."""
    return max(2, int(np.ceil(np.hypot(b[0] - a[0], b[1] - a[1]) / size)))


def _line(a: tuple[float, float], b: tuple[float, float], count: int) -> Values:
    """Ends of `count` elements from a to b, shape (count, 2, 2); the elements are smaller near a and b."""
    s = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, count + 1)))[:, None]
    points = (1.0 - s) * np.array(a) + s * np.array(b)
    return np.stack([points[:-1], points[1:]], axis=1)


def _integrals(ends: Values, at: Values, depth: float) -> tuple[Values, Values]:
    """Integrals of ln r and of its normal derivative over every element and its image, at the points `at`."""
    image = ends[:, ::-1] * np.array([1.0, -1.0]) - np.array([0.0, 2.0 * depth])
    of_elements, of_images = _of(ends, at), _of(image, at)
    np.fill_diagonal(of_elements[1], 0.0)
    return of_elements[0] + of_images[0], of_elements[1] + of_images[1]


def _of(ends: Values, at: Values) -> tuple[Values, Values]:
    """Integrals of ln r and of its normal derivative over elements, at the points `at`."""
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    t = along / length[:, None]
    offset = at[:, None] - ends[None, :, 0]
    x = np.sum(offset * t, axis=-1)
    y = offset[..., 0] * t[:, 1] - offset[..., 1] * t[:, 0]
    angle = np.arctan2(length * y, y**2 + x * (x - length))
    logarithm = x * np.log(np.hypot(x, y)) - (x - length) * np.log(np.hypot(x - length, y))
    return logarithm - length + y * angle, -angle
