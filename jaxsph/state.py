"""Types: what evolves (`State`), what stays (`Model`), what comes out (`Solution`), and the interfaces.

SI units. x runs along the tank from the wavemaker's rest position; the last axis points up and z = 0 is
the bed. In two dimensions everything is per metre of width.
"""

from __future__ import annotations

import abc
import enum
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph._typing import Array, Float, Int, Scalar
from jaxsph.neighbours import Grid

__all__ = [
    "AbstractBody",
    "AbstractForce",
    "AbstractPTO",
    "AbstractProbe",
    "AbstractScheme",
    "BodyState",
    "Failure",
    "Model",
    "Particles",
    "Search",
    "Solution",
    "State",
    "Status",
    "Tables",
    "Work",
]


class Particles(eqx.Module):
    """The fluid's particles at time t, in the order of the last sort by cell."""

    x: Float[Array, "N D"]
    """Positions, m."""
    x_carry: Float[Array, "N D"]
    """What rounding x to its type has lost so far, m (compensated summation)."""
    u: Float[Array, "N D"]
    """Velocities, m/s."""
    rho: Float[Array, " N"]
    """Deviation of the density from rho0, kg/m3: a float32 of the whole would lose the pressure."""
    m: Float[Array, " N"]
    """Masses, kg (kg/m in two dimensions)."""
    id: Int[Array, " N"]
    """Place in the initial lattice: follows a particle through the sorts."""
    p: Float[Array, " N"] | None = None
    """Gauge pressure, Pa, of a scheme that solves for it; None where it follows from the density."""


class Work(eqx.Module):
    """What was exchanged since the last sample, summed over every step: energies, J (J/m in 2-D), air and
    momentum."""

    paddle: Scalar
    """Done on the water by the paddle, and by a body where it is not free."""
    pto: Scalar
    """Taken by the power take-off from the water."""
    sponge: Scalar
    """Taken by the sponge."""
    flow: Scalar
    """Volume of air driven out of the chamber, m3 (m2 in 2-D)."""
    contact: Scalar
    """Taken from the water that touches a solid: see `schemes.stopped`."""
    projection: Scalar
    """Taken by pressures from the water and given to no solid: what a projection leaves of the divergence."""
    impulse: Float[Array, "3"]
    """Of the water's force on the body, N s, N s, N m s (per metre in 2-D)."""

    @classmethod
    def zero(cls, dtype: Any) -> Work:
        """Nothing exchanged yet."""
        return cls(*(jnp.zeros((), dtype) for _ in range(6)), jnp.zeros(3, dtype))


class Failure(enum.IntFlag):
    """What can go wrong inside the loop; reported once, outside it."""

    NEIGHBOUR_OVERFLOW = 1
    STALE_TABLE = 2
    NON_FINITE = 4
    THROUGH_WALL = 8
    CHAMBER_OVERFLOW = 16
    TOO_FAST = 32


class Status(eqx.Module):
    """Failures so far, and where the first one was."""

    bits: Int[Array, ""]
    step: Int[Array, ""]
    where: Float[Array, " D"]

    @classmethod
    def sound(cls, dim: int, dtype: Any) -> Status:
        """No failure."""
        return cls(jnp.zeros((), jnp.int32), jnp.zeros((), jnp.int32), jnp.zeros(dim, dtype))

    def flag(self, failure: Failure, failed: jax.Array, step: jax.Array, where: jax.Array) -> Status:
        """Adds a failure; the step and place of the first one are kept."""
        first = failed & (self.bits == 0)
        return Status(
            self.bits | jnp.where(failed, int(failure), 0).astype(self.bits.dtype),
            jnp.where(first, step, self.step),
            jnp.where(first, where, self.where),
        )


class BodyState(eqx.Module):
    """A rigid body's surge (m), heave (m) and pitch (rad) from its place at rest, and what goes with them."""

    pose: Float[Array, "3"]
    velocity: Float[Array, "3"]
    force: Float[Array, "3"]
    """Of the water's pressure, N, N, N m (per metre in 2-D), in the last step."""
    contact: Float[Array, "3"]
    """Of water that touched it in the last step, likewise; the body feels it in the next."""

    @classmethod
    def at_rest(cls, dtype: Any, velocity: Any = (0.0, 0.0, 0.0), pose: Any = (0.0, 0.0, 0.0)) -> BodyState:
        """Not yet under any force of the water."""
        none = jnp.zeros(3, dtype)
        return cls(jnp.asarray(pose, dtype), jnp.asarray(velocity, dtype), none, none)


class State(eqx.Module):
    """All that evolves. Time is not accumulated: t = model.t0 + step * model.dt."""

    particles: Particles
    paddle: Float[Array, "4"]
    """Displacement (m) and velocity (m/s) of the wavemaker, its filtered absorption error and the slow
    mean of that (m)."""
    air: Float[Array, "2"]
    """Gauge pressure of the chamber's air (Pa) and flow out of it (m3/s, m2/s in 2-D)."""
    work: Work
    step: Int[Array, ""]
    status: Status
    body: BodyState | None = None


class Search(eqx.Module):
    """What fixes the neighbour tables' shapes and cadence; found in `build`, grown by `run`."""

    grid: Grid
    capacity: int = eqx.field(static=True)
    """Slots per fluid particle."""
    node_capacity: int = eqx.field(static=True)
    """Slots per interpolation node."""
    chamber_capacity: int = eqx.field(static=True)
    """Particles under the chamber's air pressure, at most."""
    rebuild_every: int = eqx.field(static=True)
    """Steps between searches."""
    skin: float = eqx.field(static=True)
    """What the search radius adds to the support, m."""


class Tables(eqx.Module):
    """Neighbour tables of one rebuild block, and the positions they were made for."""

    fluid: Int[Array, "K N"]
    nodes: Int[Array, "Kn G"]
    paddle: Int[Array, "Kp P"] | None
    """Fluid around each ghost of the paddle, for the force on it."""
    chamber: Int[Array, " C"] | None
    """Particles that may feel the chamber's air; N stands for none."""
    x: Float[Array, "N D"]


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


class Solution(eqx.Module):
    """What a run gives: the samples as numpy arrays, the last state, and what to call things."""

    series: dict[str, np.ndarray]
    """Each reading at every sample, `[T]` or `[T, k]`; "time" among them."""
    units: dict[str, tuple[str, str]] = eqx.field(static=True)
    """(units, long name) of each reading."""
    model: Model
    state: State
    case: Any = None
    results: dict[str, float] | None = None
    """Scalars made from the series: efficiency, powers, reflection (see `analysis`)."""

    @property
    def t(self) -> np.ndarray:
        """Sample times, s."""
        return self.series["time"]

    def __getitem__(self, name: str) -> np.ndarray:
        """The reading called `name`."""
        if name not in self.series:
            raise KeyError(f"no reading {name!r}; there are {', '.join(sorted(self.series))}")
        return self.series[name]
