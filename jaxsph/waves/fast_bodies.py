"""Fast model of bodies with links in waves: linear theory with quadratic drag and inertia, in JAX.

The free coordinates xi of the bodies follow, for each wave of a sea, from the equations of
`waves.linear_bodies`, with two additions for each coordinate: a force d |v| v against its rate v, which
stands for the vortices that the body sheds, and an inertia that the theory lacks. Neither is known
beforehand; both are found from runs of the water (`study.fast_model`).

Quadratic laws are replaced by linear ones that take the same mean power, from a sinusoidal motion in regular
waves, from a Gaussian motion in a sea.

The water is solved at several frequencies (`BodySeries.of`, on the host) and interpolated, so that an answer
takes a fraction of a millisecond and can be differentiated with respect to the waves and the links.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.chebyshev import Series
from jaxsph.core.roots import fixed_point
from jaxsph.waves.fast_owc import ITERATIONS, Incident, amplitudes
from jaxsph.waves.linear_bodies import SmallMotion
from jaxsph.waves.panels import Section, hydrodynamics

__all__ = ["BodyAdditions", "BodyResponse", "BodySeries", "Dampers", "body_response"]


class BodySeries(eqx.Module):
    """Bodies about their equilibrium, and the response of the water to waves and to their motions, over the
    frequency."""

    series: Series
    """Series over the angular frequency (rad/s) of the real and imaginary parts of the radiation impedance
    `[n, n]` and the exciting force per metre of amplitude `[n]`, in one row."""
    mass: Float[Array, "n n"]
    """Mass matrix of the n free coordinates, kg, kg m or kg m2 per metre of width."""
    stiffness: Float[Array, "n n"]
    """Stiffness of weight, buoyancy and links, N/m, N or N m per metre of width."""
    damping: Float[Array, "n n"]
    """Damping of moorings, N s/m, N s or N m s per metre of width."""
    ways: Float[Array, "L n"]
    """Changes of the links' extensions per unit change of each coordinate."""
    springs: Float[Array, " L"]
    """Stiffness of the links that `stiffness` contains and `Dampers` may change, N/m or N m."""
    depth: float = eqx.field(static=True)
    """Depth of the water, m."""
    rho0: float = eqx.field(static=True)
    """Density of the water, kg/m3."""
    g: float = eqx.field(static=True)
    """Acceleration of gravity, m/s2."""

    @classmethod
    def of(
        cls,
        section: Section,
        bodies: SmallMotion,
        springs: Sequence[float],
        omega: tuple[float, ...],
        rho0: float,
        g: float,
    ) -> BodySeries:
        """Series for the ranges of angular frequency between the successive values of omega (rad/s,
        ascending); solves the flow 16 times for each range, in a few seconds."""
        J, x = bodies.jacobian, float(np.mean([hull.pivot[0] for hull in section.hulls]))

        def responses(nodes: np.ndarray) -> np.ndarray:
            found = []
            for one in nodes:
                water = hydrodynamics(section, float(one), rho0, g)
                # relative to the crest at the bodies: the phase at x = 0 would vary rapidly
                force = J.T @ water.excitation * np.exp(-1j * water.k * x)
                values = np.concatenate([np.ravel(J.T @ water.impedance @ J), force])
                found.append(np.concatenate([np.real(values), np.imag(values)]))
            return np.array(found)

        return cls.restored(Series.of(responses, omega), section, bodies, springs, rho0, g)

    @classmethod
    def restored(
        cls,
        series: Series,
        section: Section,
        bodies: SmallMotion,
        springs: Sequence[float],
        rho0: float,
        g: float,
    ) -> BodySeries:
        """Response with series that were found before."""
        n = len(bodies.mass)
        ways = np.reshape([one.way for one in bodies.dampings], (-1, n))
        given = bodies.mass, bodies.stiffness, bodies.damping, ways, springs
        mass, stiffness, damping, along, own = (jnp.asarray(a, jnp.float32) for a in given)
        return cls(series, mass, stiffness, damping, along, own, section.depth, rho0, g)

    def at(self, omega: Scalar) -> tuple[Array, Array]:
        """Complex radiation impedance `[n, n]` and exciting force per metre of amplitude `[n]`, in the units
        of `panels.Hydrodynamics`, at an angular frequency (rad/s)."""
        values, n = self.series(omega), len(self.mass)
        real, imaginary = jnp.split(values, 2)
        both = real + 1j * imaginary
        return both[: n * n].reshape(n, n), both[n * n :]


class BodyAdditions(NamedTuple):
    """What linear theory of bodies lacks, for each free coordinate; with zeros the model is linear theory."""

    drag: tuple[Scalar | float, ...]
    """Quadratic drag d, N s2/m2 or N m s2 per metre of width."""
    inertia: tuple[Scalar | float, ...]
    """Additional inertia relative to the bodies' own (-)."""


class Dampers(NamedTuple):
    """Forces of the links against their extensions s and the rates v of these, k s + c v + q |v| v, per metre
    of width."""

    linear: Float[Array, " L"]
    """Linear damping c, N s/m or N m s."""
    quadratic: Float[Array, " L"]
    """Quadratic damping q, N s2/m2 or N m s2."""
    harvests: Float[Array, " L"]
    """1 for a power take-off, 0 for another link."""
    stiffness: Float[Array, " L"]
    """Stiffness k in the place of `BodySeries.springs`, N/m or N m."""


class BodyResponse(NamedTuple):
    """Response of bodies to waves, per metre of width.

    In a sea the amplitudes are sqrt(2) times the standard deviations.
    """

    xi: Array
    """Ratio of absorbed to incident power (-)."""
    P_pto: Array
    """Mean absorbed power, W/m."""
    P_inc: Array
    """Mean incident power, W/m."""
    coordinates: Float[Array, "N n"]
    """Complex amplitudes of the free coordinates in each wave, m or rad."""
    P_lost: Array
    """Mean power lost by drag, W/m."""


def body_response(water: BodySeries, added: BodyAdditions, dampers: Dampers, waves: Incident) -> BodyResponse:
    """Response of bodies to incident waves."""
    omega = waves.omega
    impedance, force = jax.vmap(water.at)(omega)
    drag, inertia = (jnp.asarray(jnp.stack([*map(jnp.asarray, a)]), jnp.float32) for a in added)
    mass = water.mass + jnp.diag(inertia * jnp.diag(water.mass))
    w = omega[:, None, None]
    more = dampers.stiffness - water.springs
    stiffness = water.stiffness + water.ways.T @ (more[:, None] * water.ways)
    fixed = stiffness - w**2 * mass - 1j * w * (water.damping + impedance)
    driven = force * waves.amplitude[:, None]

    def coordinates(sizes: tuple[Array, Array]) -> Array:
        """Amplitudes of the coordinates in each wave, with the dampings at these sizes of the rates of links
        and coordinates."""
        links, rates = sizes
        each = dampers.linear + waves.law.equal * dampers.quadratic * links
        damping = water.ways.T @ (each[:, None] * water.ways) + jnp.diag(waves.law.equal * drag * rates)
        return jnp.linalg.solve(fixed - 1j * w * damping, driven[..., None])[..., 0]

    def rates(xi: Array) -> tuple[Array, Array]:
        """Sizes of the rates of links and coordinates: amplitudes, or sqrt(2) standard deviations."""
        each = omega[:, None] * xi
        return amplitudes(each @ water.ways.T), amplitudes(each)

    def step(sizes: tuple[Array, Array]) -> tuple[Array, Array]:
        # if a damping grows by a factor, its rate falls by at most this factor, so that the mean converges
        links, own = rates(coordinates(sizes))
        return jnp.sqrt(sizes[0] * links), jnp.sqrt(sizes[1] * own)

    free = rates(coordinates((jnp.zeros(len(water.ways)), jnp.zeros(len(drag)))))
    links, own = fixed_point(step, free, ITERATIONS)
    xi = coordinates((links, own))
    taken = dampers.linear + waves.law.equal * dampers.quadratic * links
    P_pto = 0.5 * jnp.sum(dampers.harvests * taken * links**2)
    P_inc = waves.power(water.depth, water.rho0, water.g)
    P_lost = 0.5 * waves.law.equal * jnp.sum(drag * own**3)
    return BodyResponse(P_pto / P_inc, P_pto, P_inc, xi, P_lost)
