"""Types: what evolves (`State`), what stays (`Model`), what comes out (`Solution`), and the interfaces.

SI units. x runs along the tank from the wavemaker's rest position; the last axis points up and z = 0 is
the bed. In two dimensions everything is per metre of width.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.state import BodyState, Search, State, Tables


class AbstractPTO(eqx.Module):
    """Law between the chamber's flow and its air pressure."""

    @abc.abstractmethod
    def pressure(self, q_free: Scalar, compliance: Scalar, t: Scalar) -> Scalar:
        """Gauge pressure P_a (Pa) at the end of a step.

        **Arguments**: `q_free`: flow out of the chamber (m2/s) were P_a zero over the step;
        `compliance`: -dq/dP_a of that step (m2/s/Pa), so that q = q_free - compliance P_a; t (s).
        """


class AbstractForce(eqx.Module):
    """A field of body force."""

    @abc.abstractmethod
    def acceleration(self, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """At x (m), m/s2."""

    @abc.abstractmethod
    def potential(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Potential energy per unit mass at x, J/kg: acceleration is minus its gradient."""


class AbstractScheme(eqx.Module):
    """A way to advance the fluid."""

    @abc.abstractmethod
    def prepare(self, model: Model, state: State) -> tuple[State, Tables]:
        """Sorts the particles and searches their neighbours; flags overflow."""

    @abc.abstractmethod
    def step(self, model: Model, state: State, tables: Tables) -> State:
        """One time step."""


class AbstractTangents(eqx.Module):
    """What happens to derivatives, and not to values, after every step."""

    @abc.abstractmethod
    def filtered(self, model: Model, state: State, tables: Tables) -> State:
        """The state, to be differentiated otherwise."""


class AbstractBody(eqx.Module):
    """A rigid body with three motions in the x-z plane."""

    @abc.abstractmethod
    def movable(self, t: Scalar) -> Float[Array, "3"]:
        """1 for the motions that forces change at the time t (s), 0 for those that go on as they are."""

    @abc.abstractmethod
    def generalised_mass(self) -> Float[Array, "3"]:
        """Mass, mass (kg, kg/m in 2-D) and moment of inertia (kg m2, kg m in 2-D)."""

    @abc.abstractmethod
    def moved(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, "N D"]:
        """Points of the body at rest (m) in its pose."""

    @abc.abstractmethod
    def velocity(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, "N D"]:
        """Velocity of the body at the points x in its pose, m/s."""

    @abc.abstractmethod
    def directions(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, "3 N D"]:
        """Velocity there per unit of every motion's."""

    @abc.abstractmethod
    def centripetal(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, "N D"]:
        """Acceleration there that no change of the velocities makes, m/s2."""

    @abc.abstractmethod
    def external(self, body: BodyState, g: Float[Array, " D"]) -> Float[Array, "3"]:
        """Forces that are not the water's nor linear in the velocity."""

    @abc.abstractmethod
    def damping(self) -> Float[Array, "3"]:
        """Force per unit of the velocity, and against it."""

    @abc.abstractmethod
    def absorbed(self, old: BodyState, new: BodyState, dt: Scalar) -> Scalar:
        """Energy taken by the power take-off in a step, J (J/m in 2-D)."""

    @abc.abstractmethod
    def normals(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, "N D"]:
        """Unit normals, outward and in its pose, of the surface nearest to points of the body at rest (m)."""

    @abc.abstractmethod
    def energy(self, body: BodyState, g: Float[Array, " D"]) -> tuple[Scalar, Scalar]:
        """Kinetic energy, and potential energy over that at rest, J (J/m in 2-D)."""

    @abc.abstractmethod
    def distance(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, " N"]:
        """Distance from the body's surface, m; negative inside."""


class AbstractProbe(eqx.Module):
    """Something measured in the loop."""

    @abc.abstractmethod
    def measure(self, model: Model, state: State, tables: Tables) -> Mapping[str, jax.Array]:
        """Named readings at the state's time."""

    @abc.abstractmethod
    def describe(self) -> Mapping[str, tuple[str, str]]:
        """(units, long name) of every reading."""


class Model(eqx.Module):
    """All that stays constant in the loop. Every float is an array leaf: traceable, differentiable."""

    scheme: AbstractScheme
    walls: Any
    """`boundaries.Ghosts`."""
    wavemaker: Any
    """`devices.Wavemaker` or None."""
    sponge: Any
    """`waves.Sponge` or None."""
    chamber: Any
    """`devices.Chamber` or None."""
    g: Float[Array, " D"]
    dx: Scalar
    dt: Scalar
    t0: Scalar
    depth: Scalar
    z0: Float[Array, " N"]
    """Initial height of each particle by id, m: energies are counted from there."""
    search: Search
    force: AbstractForce | None = None
    """Body force beside the uniform g."""
    tangents: AbstractTangents | None = None
    """What keeps derivatives smooth; None for exact ones."""
    body: AbstractBody | None = None

    def step(self, state: State, tables: Tables) -> State:
        """One time step of the scheme."""
        new = self.scheme.step(self, state, tables)
        return new if self.tangents is None else self.tangents.filtered(self, new, tables)

    def walls_at(self, state: State) -> tuple[Float[Array, "G D"], Float[Array, "G D"]]:
        """Places of all ghosts and their nodes, m."""
        x, nodes = self.walls.moved(state.paddle[0])
        if self.body is None:
            return x, nodes
        rows = slice(*self.walls.solid)
        there = self.body.moved(self.walls.x[rows], state.body)
        return x.at[rows].set(there), nodes.at[rows].set(there)

    def time(self, state: State) -> Scalar:
        """Physical time of a state, s."""
        return self.t0 + state.step.astype(self.dt.dtype) * self.dt
