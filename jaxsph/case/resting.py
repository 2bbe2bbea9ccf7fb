"""Bodies of a case at rest: their equilibrium in still water, and their inertia and stiffness about it.

The equilibrium minimises the potential energy of weight, links and displaced water. The stiffness of small
motions about the equilibrium is the second derivative of this energy with respect to the coordinates of the
joints. The computations run on the host in double precision and need `jax.enable_x64(True)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from shapely import affinity

from jaxsph.case.bodies import make_bodies, make_links
from jaxsph.case.geometry import Geometry
from jaxsph.case.hydrostatics import buoyancy_stiffness, submerged
from jaxsph.case.moorings import make_moorings
from jaxsph.case.sections import Sections
from jaxsph.model.mechanism import Mechanism
from jaxsph.model.solids import AbstractBody

__all__ = ["Posture", "Resting"]

BALANCED = 1e-8
"""Largest net force, relative to the bodies' weight, at which the bodies count as in equilibrium (-)."""

Real = NDArray[Any]
"""Array of real numbers."""


class _Floating(NamedTuple):
    """Buoyancy of a body near a pose."""

    pose: Real
    """Displacements (m) of the pivot, and pitch (rad), in the pose."""
    slope: Real
    """Derivatives of the displaced water's potential energy with respect to the pose, N/m, N/m, N."""
    stiffness: Real
    """Second derivatives `[3, 3]` of this energy, N/m2, N/m or N."""


class Posture(NamedTuple):
    """Bodies and links at rest for given coordinates of the joints."""

    poses: Any
    """Displacements of the pivots (m, m) and pitch (rad) of all bodies `[B, 3]`."""
    ways: Any
    """Derivatives of the poses with respect to the coordinates of all joints `[B, 3, n]`."""
    mass: Any
    """Mass matrix of the coordinates of all joints `[n, n]`."""
    extensions: Any
    """Extensions of all links, by the link's name, m or rad."""
    slopes: Any
    """Derivatives of the extensions with respect to the coordinates, by the link's name."""


class Resting:
    """Bodies of a case at their equilibrium in still water.

    **Attributes**: `mechanism`, and the states `parts` of its bodies and links at t = 0; `moving` bodies; the
    mask `free` of the coordinates of all joints; at the equilibrium, all coordinates `q`, the `posture`, the
    bodies' `poses` (m, m, rad) by name, and the `stiffness` of the free coordinates.
    """

    def __init__(self, case: Sections, geometry: Geometry) -> None:
        """**Raises** ValueError if there is no stable equilibrium near the given positions."""
        twice = case.model_copy(update={"precision": "float64"})
        rows = [(0, 0)] * (len(geometry.bodies) + len(geometry.solids))

        def leaf(a: Any) -> jax.Array:
            return jnp.asarray(a, np.float64)

        bodies = make_bodies(twice, geometry, rows, leaf)
        links = make_links(twice, bodies, leaf) + make_moorings(twice, leaf)
        self.case, self.geometry = case, geometry
        self.mechanism = Mechanism(bodies, links)
        self.parts = self.mechanism.start(np.float64)
        for link in links:
            if jax.tree.leaves(self.parts[link.name].own):
                raise ValueError(
                    f'the force of {link.name} depends on its history (a latch, or kind = "line")'
                )
        self.moving = [body for body in bodies if not body.fixed]
        self.free = np.concatenate([np.array(body.joint.free, bool) for body in bodies])
        self._posture, self._second = jax.jit(self._posture_of), jax.jit(self._derivatives)
        start = np.concatenate([np.asarray(self.parts[body.name].q) for body in bodies])
        self.q, self.stiffness = self._balanced(start)
        self.posture = self._posture(self.q)
        poses = np.asarray(self.posture.poses)
        self.poses = {body.name: pose for body, pose in zip(bodies, poses, strict=True)}

    def _placed(self, q: jax.Array) -> dict[str, Any]:
        """States of bodies and links by name, for coordinates q of all joints at rest; traced."""
        changed, first = dict(self.parts), 0
        for body in self.mechanism.bodies:
            at = q[first : first + body.joint.size]
            first += body.joint.size
            changed[body.name] = eqx.tree_at(
                lambda m: (m.q, m.rates), self.parts[body.name], (at, jnp.zeros_like(at))
            )
        return {**changed, **self.mechanism.placed(changed, jnp.zeros(()))}

    def _posture_of(self, q: jax.Array) -> Posture:
        """Bodies and links for coordinates q of all joints at rest; traced."""
        parts, t, n = self._placed(q), jnp.zeros(()), len(self.free)
        kinematics = self.mechanism.kinematics(parts, t)

        def extensions(q):
            placed = self._placed(q)
            return {link.name: self.mechanism.extension(link, placed, t) for link in self.mechanism.links}

        ways, mass = kinematics.ways[0, :, :, :n], kinematics.mass_matrix[:n, :n]
        return Posture(kinematics.poses[0], ways, mass, extensions(q), jax.jacfwd(extensions)(q))

    def _energy(self, q: jax.Array, water: Mapping[str, _Floating]) -> jax.Array:
        """Potential energy (J/m) of weight, links and buoyancy for coordinates q; traced."""
        parts, g = self._placed(q), jnp.array([0.0, -self.case.g])
        total = self.mechanism.stored(parts, jnp.zeros(()))
        for name, floating in water.items():
            away = parts[name].pose - floating.pose
            total = total + floating.slope @ away + 0.5 * away @ floating.stiffness @ away
        for body in self.moving:
            total = total + body.energy(parts[body.name], g)[1]
        return total

    def _derivatives(self, q: jax.Array, water: Mapping[str, _Floating]) -> tuple[jax.Array, jax.Array]:
        """First and second derivatives of the potential energy with respect to the coordinates q; traced."""
        return jax.grad(self._energy)(q, water), jax.hessian(self._energy)(q, water)

    def _buoyancy(self, poses: Real) -> dict[str, _Floating]:
        """Buoyancy of the moving bodies near the poses `[B, 3]` of all bodies, by name."""
        rho_g, level, found = self.case.fluid.rho0 * self.case.g, self.geometry.depth, {}
        for body, pose in zip(self.mechanism.bodies, poses, strict=True):
            if body.fixed:
                continue
            region, at = self.region(body, pose), np.asarray(body.pivot) + pose[:2]
            under, slope = submerged(region, level), np.zeros(3)
            if under.area:
                slope = -rho_g * under.area * np.array([0.0, 1.0, at[0] - under.centroid.x])
            found[body.name] = _Floating(pose, slope, buoyancy_stiffness(region, level, at, rho_g))
        return found

    def region(self, body: AbstractBody, pose: Real) -> Any:
        """Cross-section of a moving body in a pose, as a shapely geometry (m)."""
        (x, z), c, s = np.asarray(body.pivot), np.cos(pose[2]), np.sin(pose[2])
        shift = pose[0] + x - c * x - s * z, pose[1] + z - c * z + s * x
        region = self.geometry.bodies[body.name].region()
        return affinity.affine_transform(region, [c, s, -s, c, *shift])

    def _balanced(self, q: Real) -> tuple[Real, Real]:
        """Coordinates of the equilibrium in still water, by Newton's method from coordinates q, and the
        stiffness of the free coordinates there."""
        g, depth, both = self.case.g, self.geometry.depth, np.ix_(self.free, self.free)
        for _ in range(30):
            posture = self._posture(q)
            size = np.sqrt(np.diag(np.asarray(posture.mass)[both]))
            water = self._buoyancy(np.asarray(posture.poses))
            slope, stiffness = (np.asarray(one) for one in self._second(q, water))
            stiffness, force = stiffness[both], -slope[self.free] / size
            values, ways = np.linalg.eigh(stiffness / np.outer(size, size))
            least = 1e-6 * max(float(values[-1]), g / depth)
            if np.max(np.abs(force)) < BALANCED * g * float(np.sqrt(np.sum(size**2))):
                if values[0] < -least:
                    raise ValueError(
                        "the bodies have no stable equilibrium near their positions at rest: lower their "
                        "centres of mass, or hold the bodies with links"
                    )
                return q, stiffness
            firm = values > least
            step = ways[:, firm] @ ((ways[:, firm].T @ force) / values[firm]) / size
            q = q.copy()
            q[self.free] += step * min(1.0, 0.2 * depth / max(float(np.max(np.abs(step))), 1e-12))
        raise ValueError(
            "the bodies are not in equilibrium in still water near their positions at rest: change their "
            "density or mass, or their positions"
        )
