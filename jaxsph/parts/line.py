"""Mooring line of lumped masses in still water: axial stiffness and damping, drag, added mass and the bed.

The equations are those of Hall and Goupee 2015: half of the mass, weight and forces of each segment is
assigned to the node at each end. Each step of the water is divided into several short steps of the line. In
each short step the nodes move at constant velocities for half the step, the forces change these velocities,
and the nodes move on for the other half. Drag and the damping of the bed are integrated implicitly.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.roots import increasing_root
from jaxsph.parts.catenary import STRAIN, AbstractCatenary
from jaxsph.parts.moorings import AbstractMooringLaw, span_and_height, upright

__all__ = ["Bed", "LineMotion", "LumpedLine", "Morison"]

SMALL_SPEED = 1e-6
"""Speed below which drag is linear, so that the derivative of drag is finite at rest, m/s."""
LEAST_ACROSS = 1e-3
"""Smallest ratio of horizontal force to weight of a chain at rest (-). With a smaller force all segments
would be vertical. The height of the chain would then hardly depend on the vertical force, so that the
vertical force could not be found from the height."""
COURANT = 0.5
"""Largest ratio of the line's time step to its largest stable time step (-)."""


class Morison(NamedTuple):
    """Forces of still water on a line, per length (per metre of width in 2-D): drag and added mass."""

    drag_across: Scalar
    """Drag per length of the line and per squared speed across it, 1/2 rho d C_dn, kg/m2."""
    drag_along: Scalar
    """Drag per length of the line and per squared speed along it, 1/2 rho pi d C_dt, kg/m2."""
    mass_across: Scalar
    """Added mass per length for accelerations across the line, rho A C_an, kg/m."""
    mass_along: Scalar
    """Added mass per length for accelerations along the line, rho A C_at, kg/m."""


class Bed(NamedTuple):
    """Elastic horizontal bed under a line."""

    height: Scalar
    """Height of the bed above the anchor, m; negative if the anchor is above the bed."""
    stiffness: Scalar
    """Upward force per length of the line and per depth below the bed's surface, N/m2."""
    damping: Scalar
    """Damping force below the bed's surface, per length of the line and per vertical speed, N s/m2."""


class LineMotion(NamedTuple):
    """State of a line: its nodes between anchor and fairlead, relative to the anchor."""

    x: Float[Array, "K D"]
    """Positions, m."""
    u: Float[Array, "K D"]
    """Velocities, m/s."""
    end: Float[Array, " D"]
    """Position of the fairlead, m."""
    dt: Scalar
    """Duration of the last step of the water, s; 0 at the start."""


class Forces(NamedTuple):
    """Forces on the nodes of a line, anchor and fairlead included, at given positions and velocities."""

    constant: Float[Array, "N D"]
    """Sum of tension, weight and the elastic force of the bed, N (N/m in 2-D)."""
    mass: Float[Array, "N D D"]
    """Mass matrices of the nodes, including added mass, kg (kg/m in 2-D)."""
    damping: Float[Array, "N D D"]
    """Damping matrices of drag and bed: force opposite to the velocity, per unit velocity, N s/m (N s/m2
    in 2-D)."""


class LumpedLine(AbstractMooringLaw):
    """Law of a mooring line whose mass is lumped at nodes.

    The extension of the link is the position of the fairlead relative to the anchor.
    """

    at_rest: AbstractCatenary
    """Catenary in which the line starts at rest, with the line's length, weight and axial stiffness."""
    mass: Scalar
    """Mass per length in air, kg/m."""
    damping: Scalar
    """Internal damping BA: tension per rate of strain, N s."""
    water: Morison
    """Forces of the water."""
    bed: Bed
    """The bed."""
    segments: int = eqx.field(static=True)
    """Number of segments."""
    substeps: int = eqx.field(static=True, default=1)
    """Number of steps of the line in a step of the water."""

    @property
    def size(self) -> Scalar:
        """Length of a segment without tension, m."""
        return self.at_rest.length / self.segments

    def start(self, s):
        """See `AbstractLaw`: at rest, as a chain of straight segments, sunk into the bed by its weight."""
        x = upright(hung_chain(self.at_rest, self.segments, *span_and_height(s)), s)
        sunk = self.bed.height - self.at_rest.weight / self.bed.stiffness
        lying = x[:, -1] < self.bed.height + 1e-6 * self.at_rest.length
        x = x.at[:, -1].set(jnp.where(lying, sunk, x[:, -1]))
        return LineMotion(x, jnp.zeros_like(x), s, jnp.zeros((), s.dtype))

    def stored(self, own, s):
        """See `AbstractLaw`: kinetic, elastic and potential energy of the line, and of the bed under it."""
        del s
        x, u = self._whole(own.x, own.u, own.end, jnp.zeros_like(own.end))
        forces = self._forces(x, u)
        kinetic = 0.5 * jnp.einsum("ni,nij,nj->", u, forces.mass, u)
        strain = jnp.maximum(self._segments(x)[1] / self.size - 1.0, 0.0)
        elastic = 0.5 * self.at_rest.axial_stiffness * self.size * jnp.sum(strain**2)
        share = self._shares(x.dtype)
        sunk = jnp.maximum(self.bed.height - x[:, -1], 0.0)
        potential = self.at_rest.weight * x[:, -1] + 0.5 * self.bed.stiffness * sunk**2
        return kinetic + elastic + share @ potential

    def force(self, own, s, v, t):
        """See `AbstractLaw`: mean force on the fairlead in a step in which the fairlead moves at v (m/s)."""
        del t
        return self._moved(own, s + 0.5 * own.dt * v, v, own.dt)[1]

    def advance(self, own, s, v, t, dt):
        """See `AbstractLaw`."""
        del t
        return self._moved(own, s, v, dt)[0]

    def anchor_tension(self, own, s):
        """See `AbstractMooringLaw`."""
        del s
        x, u = self._whole(own.x, own.u, own.end, jnp.zeros_like(own.end))
        return jnp.linalg.norm(self._tensions(x, u)[0])

    def shape(self, own, s):
        """See `AbstractMooringLaw`."""
        del s
        return self._whole(own.x, own.u, own.end, jnp.zeros_like(own.end))[0]

    def stable_step(self) -> float:
        """Largest stable step (s), from the stiffness of the segments and the bed, and the damping of the
        segments.

        A step dt is stable for dt w < 2 (sqrt(1 + c^2) - c), with the largest angular frequency w of the
        chain of masses and springs, and the damping ratio c at this frequency.
        """
        size, added = float(self.size), min(float(self.water.mass_along), float(self.water.mass_across))
        mass = (float(self.mass) + added) * size
        stiffest = 4.0 * float(self.at_rest.axial_stiffness) / size + float(self.bed.stiffness) * size
        frequency = np.sqrt(stiffest / mass)
        ratio = 4.0 * float(self.damping) / size / (2.0 * mass * frequency)
        return float(2.0 * (np.sqrt(1.0 + ratio**2) - ratio) / frequency)

    def stepped(self, dt: float) -> LumpedLine:
        """The same line, with the number of substeps that it needs in a water step of dt (s)."""
        return dataclasses.replace(self, substeps=int(np.ceil(dt / (COURANT * self.stable_step()))))

    def _moved(self, own: LineMotion, end: Array, v: Array, dt: Scalar) -> tuple[LineMotion, Array]:
        """State of the line after its fairlead has moved to `end` (m) at the velocity v (m/s) in a step of dt
        (s), and the mean force on the fairlead (N)."""
        h, path = dt / self.substeps, end - own.end

        def step(carry, k):
            x, u = carry
            x = x + 0.5 * h * u
            whole = self._whole(x, u, own.end + (k + 0.5) / self.substeps * path, v)
            forces = self._forces(*whole)
            inner = slice(1, self.segments)
            push = forces.constant[inner] - jnp.einsum("nij,nj->ni", forces.damping[inner], u)
            u = u + h * _solved(forces.mass[inner] + h * forces.damping[inner], push)
            return (x + 0.5 * h * u, u), forces.constant[-1] - forces.damping[-1] @ v

        steps = jnp.arange(self.substeps, dtype=end.dtype)
        (x, u), pulls = jax.lax.scan(step, (own.x, own.u), steps)
        return LineMotion(x, u, end, dt), jnp.mean(pulls, axis=0)

    def _whole(self, x: Array, u: Array, end: Array, v: Array) -> tuple[Array, Array]:
        """Positions (m) and velocities (m/s) of all nodes, anchor and fairlead included."""
        anchor = jnp.zeros((1, len(end)), x.dtype)
        return jnp.concatenate([anchor, x, end[None]]), jnp.concatenate([anchor, u, v[None]])

    def _segments(self, x: Array) -> tuple[Array, Array]:
        """Unit vectors along the segments, towards the fairlead, and their lengths (m)."""
        apart = jnp.diff(x, axis=0)
        length = jnp.sqrt(jnp.sum(apart**2, axis=1) + 1e-18)
        return apart / length[:, None], length

    def _tensions(self, x: Array, u: Array) -> Array:
        """Tensions of the segments as vectors towards the fairlead, N; the elastic part is never negative."""
        along, length = self._segments(x)
        rate = jnp.sum(jnp.diff(u, axis=0) * along, axis=1) / self.size
        elastic = self.at_rest.axial_stiffness * jnp.maximum(length / self.size - 1.0, 0.0)
        return (elastic + self.damping * rate)[:, None] * along

    def _shares(self, dtype: np.dtype) -> Array:
        """Length of line lumped at each node, m."""
        ends = jnp.full(self.segments + 1, 1.0, dtype).at[jnp.array([0, -1])].set(0.5)
        return self.size * ends

    def _forces(self, x: Array, u: Array) -> Forces:
        """Forces on all nodes at the positions x (m) and velocities u (m/s)."""
        tension, none = self._tensions(x, u), jnp.zeros_like(x[:1])
        share, upward = self._shares(x.dtype), jnp.zeros_like(x[0]).at[-1].set(1.0)
        sunk = jnp.maximum(self.bed.height - x[:, -1], 0.0)
        hung = share * (self.bed.stiffness * sunk - self.at_rest.weight)
        pulled = jnp.concatenate([tension, none]) - jnp.concatenate([none, tension])
        # direction of the line at a node: along the chord between the two neighbouring nodes
        chord = jnp.concatenate([x[1:], x[-1:]]) - jnp.concatenate([x[:1], x[:-1]])
        along = chord / jnp.sqrt(jnp.sum(chord**2, axis=1, keepdims=True) + 1e-18)
        parallel = along[:, :, None] * along[:, None, :]
        across = jnp.eye(x.shape[1], dtype=x.dtype) - parallel
        slip = jnp.sum(u * along, axis=1)
        speed_along = jnp.sqrt(slip**2 + SMALL_SPEED**2)
        sideways = u - slip[:, None] * along
        speed_across = jnp.sqrt(jnp.sum(sideways**2, axis=1) + SMALL_SPEED**2)

        def each(factor: Array, matrix: Array) -> Array:
            return (share * factor)[:, None, None] * matrix

        mass = each(self.mass + self.water.mass_across + 0.0 * sunk, across)
        mass = mass + each(self.mass + self.water.mass_along + 0.0 * sunk, parallel)
        damping = each(self.water.drag_across * speed_across, across)
        damping = damping + each(self.water.drag_along * speed_along, parallel)
        damping = damping + each(
            jnp.where(sunk > 0.0, self.bed.damping, 0.0), jnp.outer(upward, upward)[None]
        )
        return Forces(pulled + hung[:, None] * upward, mass, damping)


def hung_chain(line: AbstractCatenary, count: int, span: Scalar, height: Scalar) -> Float[Array, "K 2"]:
    """Inner nodes (m, relative to the anchor) of a chain of equal straight segments in static equilibrium.

    Half of the weight of each segment acts at each of its ends. As for the catenary, the span increases with
    the horizontal force, and at a given horizontal force the height increases with the vertical force. Slack
    that lies on the bed is spread evenly.
    """
    below = line.length * (jnp.arange(count, 0, -1, dtype=span.dtype) - 0.5) / count
    weight = line.weight * line.length
    low, high = jnp.log(LEAST_ACROSS * weight), jnp.log(weight + STRAIN * line.axial_stiffness)
    H = jnp.exp(increasing_root(_span_beyond, low, high, (line, below, span, height)))
    x, z = _sides(H, _vertical(H, line, below, height), line, below)
    lying = z < 1e-9 * line.length
    slack = jnp.sum(x) - span
    x = x - jnp.where(lying, slack / jnp.maximum(jnp.sum(lying.astype(x.dtype)), 1.0), 0.0)
    return jnp.stack([jnp.cumsum(x)[:-1], jnp.cumsum(z)[:-1]], axis=1)


def _sides(H: Scalar, V: Scalar, line: AbstractCatenary, below: Array) -> tuple[Array, Array]:
    """Components (m) along x and z of the segments whose middles are at the distances `below` (m) from the
    fairlead."""
    up = line.vertical(V, below)
    longer = (1.0 / jnp.sqrt(H**2 + up**2) + 1.0 / line.axial_stiffness) * line.length / len(below)
    return H * longer, up * longer


def _vertical(H: Scalar, line: AbstractCatenary, below: Array, height: Scalar) -> Scalar:
    """Vertical force (N) at the fairlead for the horizontal force H (N) and the height (m)."""
    weight = line.weight * line.length
    most = jnp.arcsinh(1.0 + STRAIN * line.axial_stiffness / weight)
    return weight * jnp.sinh(increasing_root(_height_beyond, -most, most, (H, line, below, height)))


def _height_beyond(y: Scalar, parameters: tuple) -> Scalar:
    """Height of a chain minus the given height, m. The vertical force at the fairlead is sinh(y) times the
    weight of the chain."""
    H, line, below, height = parameters
    V = line.weight * line.length * jnp.sinh(y)
    return jnp.sum(_sides(H, V, line, below)[1]) - height


def _span_beyond(y: Scalar, parameters: tuple) -> Scalar:
    """Span of a chain with the horizontal force exp(y) (N), minus the given span, m."""
    line, below, span, height = parameters
    H = jnp.exp(y)
    return jnp.sum(_sides(H, _vertical(H, line, below, height), line, below)[0]) - span


def _solved(matrix: Float[Array, "K D D"], vector: Float[Array, "K D"]) -> Float[Array, "K D"]:
    """Solutions of small systems of equations with positive definite matrices, by elimination."""
    rows = [jnp.concatenate([matrix[:, i], vector[:, i : i + 1]], axis=1) for i in range(vector.shape[1])]
    for i, pivot in enumerate(rows):
        rows[i] = pivot / pivot[:, i : i + 1]
        for j in range(len(rows)):
            if j != i:
                rows[j] = rows[j] - rows[j][:, i : i + 1] * rows[i]
    return jnp.stack([row[:, -1] for row in rows], axis=1)
