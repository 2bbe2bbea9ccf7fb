"""Interfaces of the parts that compose a model, and the model itself.

A step visits tuples of parts; an empty tuple switches a part off, and the loop over it vanishes when the step
is traced. A part keeps what evolves in `state.own` under its `name` and books energies in `state.ledger`.
"""

from __future__ import annotations

import abc
import enum
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar
from jaxsph.model.state import Particles, Search, State, Tables, Tally

__all__ = [
    "AbstractBody",
    "AbstractChamber",
    "AbstractDamper",
    "AbstractForce",
    "AbstractMovingSolid",
    "AbstractOutlet",
    "AbstractPTO",
    "AbstractProbe",
    "AbstractScheme",
    "AbstractSolid",
    "AbstractTangents",
    "AbstractWall",
    "Air",
    "Entry",
    "ExactTangents",
    "Exchange",
    "Kick",
    "Model",
    "Reading",
]


class Exchange(enum.Enum):
    """Direction of an energy in the ledger."""

    GIVEN = "given"
    """To the water, by what moves it."""
    TAKEN = "taken"
    """From the water, and lost."""
    HARVESTED = "harvested"
    """From the water, by a power take-off."""


class Entry(NamedTuple):
    """Meaning of one energy of the ledger."""

    long_name: str
    exchange: Exchange = Exchange.TAKEN


class Reading(NamedTuple):
    """Meaning of one reading of a probe."""

    units: str
    long_name: str
    dimension: str | None = None
    """Name of the second dimension, such as "gauge"; None for one number a sample."""
    group: str = "series"
    """Group of a run's file that keeps it: "series" or "energy"."""


# --------------------------------------------------------------------------- fields and laws


class AbstractPTO(eqx.Module):
    """Power take-off of a chamber: law between the flow of its air and its pressure."""

    @abc.abstractmethod
    def pressure(self, q_free: Scalar, compliance: Scalar, t: Scalar) -> Scalar:
        """Gauge pressure P_a (Pa) of the air at the end of a step.

        **Arguments**: `q_free`: flow out of the chamber (m2/s) were P_a zero over the step;
        `compliance`: -dq/dP_a of that step (m2/s/Pa), so that q = q_free - compliance P_a; t (s).
        """


class AbstractForce(eqx.Module):
    """A field of body force beside the uniform gravity."""

    @abc.abstractmethod
    def acceleration(self, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Acceleration at x (m), m/s2."""

    @abc.abstractmethod
    def potential(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Potential energy per unit mass at x, J/kg: the acceleration is minus its gradient."""


class AbstractScheme(eqx.Module):
    """A way to advance the fluid."""

    @abc.abstractmethod
    def prepare(self, model: Model, state: State) -> tuple[State, Tables]:
        """Sorts the particles and searches their neighbours; flags overflow."""

    @abc.abstractmethod
    def step(self, model: Model, state: State, tables: Tables) -> State:
        """One time step."""

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Energies that the scheme itself books."""

    @abc.abstractmethod
    def limiters(self) -> Mapping[str, str]:
        """Names of the scheme's limiters, and what each does to a particle."""


class AbstractTangents(eqx.Module):
    """Filter of the state's tangents after each step; values are unchanged."""

    @abc.abstractmethod
    def filtered(self, model: Model, state: State, tables: Tables) -> State:
        """The state with its tangents filtered."""


class ExactTangents(AbstractTangents):
    """The tangents as they are."""

    def filtered(self, model, state, tables):
        """See `AbstractTangents`."""
        del model, tables
        return state


class AbstractDamper(eqx.Module):
    """A zone that takes velocity out of the water."""

    name: eqx.AbstractVar[str]
    """Key of its energy in the ledger."""

    @abc.abstractmethod
    def factor(self, x: Float[Array, "N D"], dt: Scalar) -> Float[Array, " N"]:
        """Factor in [0, 1] of the velocities at x (m) over a step of dt (s)."""

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Energies that the damper books: its own under its name."""


class AbstractOutlet(eqx.Module):
    """A place where water leaves the model for good."""

    name: eqx.AbstractVar[str]
    """Key of its state in `State.own`, and of its energy in the ledger."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Any:
        """State at t = 0, to become `State.own[name]`."""

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Energies that the outlet books."""

    @abc.abstractmethod
    def drain(self, model: Model, state: State) -> State:
        """The state without the water that has come to the outlet since the last search."""


# --------------------------------------------------------------------------- solids


class AbstractSolid(eqx.Module):
    """A solid at the water's edge: a wall of the tank, a plate, a paddle, a rigid body."""

    name: eqx.AbstractVar[str]
    """Key of its motion in `State.own`; empty for a solid at rest."""

    @abc.abstractmethod
    def push(self, own: Any, x: Float[Array, "N D"], dx: Scalar, c0: Scalar) -> Float[Array, "N D"]:
        """Acceleration (m/s2) of a spring that keeps particles at x (m) from touching the solid's surface;
        see `solids.contact.spring`. `own`: the solid's state, `State.own[name]`, or None."""

    @abc.abstractmethod
    def entered(self, own: Any, x: Float[Array, "N D"], dx: Scalar) -> Array:
        """True for particles at x (m) that are inside the solid, and not by a rounding."""


class AbstractMovingSolid(AbstractSolid):
    """A solid that moves and has ghosts of its own."""

    rows: eqx.AbstractVar[tuple[int, int]]
    """Index of its first ghost, and of the one after its last."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Any:
        """Motion at t = 0, to become `State.own[name]`."""

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Energies that the solid books."""

    @abc.abstractmethod
    def place(self, own: Any, x: Float[Array, "B D"], nodes: Float[Array, "B D"]) -> tuple[Array, Array]:
        """Places (m) of its ghosts and of their nodes, from those at rest."""

    @abc.abstractmethod
    def velocity(self, own: Any, x: Float[Array, "B D"]) -> Float[Array, "B D"]:
        """Velocity of the solid at points x that move with it, m/s."""

    @abc.abstractmethod
    def touched(self, own: Any, x: Float[Array, "N D"], dx: Scalar) -> Array:
        """True for particles at x (m) near enough to be stopped by the solid."""

    @abc.abstractmethod
    def halfway(self, old: Any, new: Any, dt: Scalar) -> Any:
        """Motion in the middle of a step of dt (s) that begins with `old` and ends with `new`."""


class AbstractWall(AbstractMovingSolid):
    """A solid whose motion is given: a piston, a rocking bed."""

    @abc.abstractmethod
    def move(
        self, own: Any, water: Particles, depth_volume: Float[Array, " N"], t: Scalar, dt: Scalar
    ) -> Any:
        """Motion at t + dt (s); `depth_volume`: particles' volumes per metre of the tank's width, m2."""

    @abc.abstractmethod
    def acceleration(self, old: Any, new: Any, x: Float[Array, "B D"], dt: Scalar) -> Float[Array, "B D"]:
        """Acceleration of its surface at the ghosts x (m) over a step from `old` to `new`, m/s2."""

    @abc.abstractmethod
    def with_velocity(self, own: Any, after: Any) -> Any:
        """The motion `own` with the velocity of the motion `after`: still in its place."""

    @abc.abstractmethod
    def cover(self, own: Any, x: Float[Array, "G D"], dx: Scalar) -> Float[Array, " G"]:
        """Share (0 to 1) in which ghosts at x (m) of other solids stand in the water's side of the wall."""


class AbstractBody(AbstractMovingSolid):
    """A rigid body with three motions in the x-z plane, driven by the water or going on as they are."""

    @abc.abstractmethod
    def movable(self, t: Scalar) -> Float[Array, "3"]:
        """1 for the motions that forces change at the time t (s), 0 for those that go on as they are."""

    @abc.abstractmethod
    def generalised_mass(self) -> Float[Array, "3"]:
        """Mass, mass (kg, kg/m in 2-D) and moment of inertia (kg m2, kg m in 2-D)."""

    @abc.abstractmethod
    def directions(self, own: Any, x: Float[Array, "N D"]) -> Float[Array, "3 N D"]:
        """Velocity at the points x per unit of every motion's velocity."""

    @abc.abstractmethod
    def centripetal(self, own: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Acceleration at the points x that no change of the velocities makes, m/s2."""

    @abc.abstractmethod
    def external(self, own: Any, g: Float[Array, " D"]) -> Float[Array, "3"]:
        """Forces that are neither the water's nor linear in the velocity, N, N, N m (per metre in 2-D)."""

    @abc.abstractmethod
    def damping(self) -> Float[Array, "3"]:
        """Force against every velocity per unit of it."""

    @abc.abstractmethod
    def normals(self, own: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Outward unit normals, in the body's pose, of the surface nearest to points x (m) of the body at
        rest."""

    @abc.abstractmethod
    def distance(self, own: Any, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of x from the body's surface, m; negative inside."""

    @abc.abstractmethod
    def energy(self, own: Any, g: Float[Array, " D"]) -> tuple[Scalar, Scalar]:
        """Kinetic energy, and potential energy over that at rest, J (J/m in 2-D)."""

    @abc.abstractmethod
    def absorbed(self, old: Any, new: Any, dt: Scalar) -> Scalar:
        """Energy taken by the body's power take-off in a step, J (J/m in 2-D)."""

    @abc.abstractmethod
    def harvest(self) -> tuple[str, ...]:
        """Names in the ledger of the energies that its power take-off takes."""

    @abc.abstractmethod
    def exchanges(self, taken: Scalar, driven: Scalar) -> Mapping[str, Scalar]:
        """Energies of a step by their names in the ledger, J (J/m in 2-D): `taken` by the power take-off, and
        given by what drives the motions that are not free (`driven`)."""


# --------------------------------------------------------------------------- chambers


class Air(eqx.Module):
    """Air of a chamber at time t."""

    P_a: Scalar
    """Gauge pressure, Pa, positive when compressed."""
    q: Scalar
    """Flow of air out of the chamber, m3/s (m2/s in 2-D), positive when the water rises."""
    driven: Tally
    """Volume of air driven out, m3 (m2 in 2-D)."""


class Kick(NamedTuple):
    """Change of the water's velocities by a chamber's air over a step."""

    u: Float[Array, "N D"]
    """Velocities with the change, m/s."""
    P_a: Scalar
    """Air pressure that made it, Pa."""
    index: Array
    """Particles that feel the air; N stands for none."""
    force: Components
    """Force on each of them per unit of P_a, m2 (m in 2-D)."""


class AbstractChamber(eqx.Module):
    """Trapped air over a part of the water's surface."""

    name: eqx.AbstractVar[str]
    """Key of its air in `State.own`."""
    pto: eqx.AbstractVar[AbstractPTO]

    @property
    @abc.abstractmethod
    def energy(self) -> str:
        """Name in the ledger of the energy that the PTO takes."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Air:
        """Air at t = 0."""

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Energies that the chamber books."""

    @abc.abstractmethod
    def candidates(self, x: Float[Array, "N D"], margin: float, capacity: int) -> tuple[Array, Array]:
        """Indices `[capacity]` of the particles that may feel the air before the next search, and their
        number."""

    @abc.abstractmethod
    def kick(
        self,
        scheme: AbstractScheme,
        water: Particles,
        sources: dict,
        u: Float[Array, "N D"],
        tables: Tables,
        t: Scalar,
        dt: Scalar,
    ) -> Kick:
        """The air's force over dt (s) on velocities u (m/s) that have had every other explicit force."""

    @abc.abstractmethod
    def finish(
        self, own: Air, kick: Kick, before: Float[Array, "N D"], after: Float[Array, "N D"], dt: Scalar
    ) -> tuple[Air, Scalar]:
        """Air at the end of the step, and the energy (J, J/m in 2-D) that it took from the water, whose
        velocities went from `before` to `after` (m/s)."""

    @abc.abstractmethod
    def carried(self, own: Air, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Pressure (Pa) of the water at x (m) that the scheme's own pressure leaves to the air."""


# --------------------------------------------------------------------------- probes


class AbstractProbe(eqx.Module):
    """Something measured in the loop."""

    @abc.abstractmethod
    def measure(self, model: Model, state: State, tables: Tables) -> Mapping[str, jax.Array]:
        """Readings by name at the state's time."""

    @abc.abstractmethod
    def describe(self) -> Mapping[str, Reading]:
        """Meaning of every reading."""


# --------------------------------------------------------------------------- the model


class Model(eqx.Module):
    """Everything that stays constant in the loop. Every float is an array leaf: traceable, differentiable."""

    scheme: AbstractScheme
    walls: Any
    """Ghosts of all solids (`solids.walls.Ghosts`)."""
    solids: tuple[AbstractSolid, ...]
    """Solids at rest."""
    moving: tuple[AbstractWall, ...]
    """Walls whose motion is given."""
    bodies: tuple[AbstractBody, ...]
    """Rigid bodies."""
    chambers: tuple[AbstractChamber, ...]
    """Chambers of trapped air."""
    dampers: tuple[AbstractDamper, ...]
    """Zones that take velocity out of the water."""
    outlets: tuple[AbstractOutlet, ...]
    """Places where water leaves for good."""
    forces: tuple[AbstractForce, ...]
    """Body forces beside the uniform g."""
    tangents: AbstractTangents
    """Filter of the tangents; `ExactTangents` leaves them."""
    g: Float[Array, " D"]
    dx: Scalar
    dt: Scalar
    t0: Scalar
    depth: Scalar
    z0: Float[Array, " N"]
    """Initial height of each particle by id, m: energies are counted from there."""
    search: Search

    def step(self, state: State, tables: Tables) -> State:
        """One time step of the scheme."""
        return self.tangents.filtered(self, self.scheme.step(self, state, tables), tables)

    def every_solid(self) -> Sequence[AbstractSolid]:
        """Solids at rest, moving walls and bodies."""
        return (*self.solids, *self.moving, *self.bodies)

    def walls_at(self, own: Mapping[str, Any]) -> tuple[Float[Array, "G D"], Float[Array, "G D"]]:
        """Places of all ghosts and their nodes, m, with the parts in the states `own`."""
        x, nodes = self.walls.x, self.walls.node
        for solid in (*self.moving, *self.bodies):
            rows = slice(*solid.rows)
            there, its_nodes = solid.place(own[solid.name], x[rows], nodes[rows])
            x, nodes = x.at[rows].set(there), nodes.at[rows].set(its_nodes)
        return x, nodes

    def acceleration(self, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Acceleration by the body forces beside g at x (m), m/s2."""
        total = jax.numpy.zeros_like(x)
        for force in self.forces:
            total = total + force.acceleration(x)
        return total

    def pressure(self, state: State) -> Float[Array, " N"]:
        """Gauge pressure of every particle, Pa: the scheme's, and what it leaves to the air of chambers."""
        p = self.scheme.pressure(state.particles)
        for chamber in self.chambers:
            p = p + chamber.carried(state.own[chamber.name], state.particles.x)
        return p

    def entries(self) -> dict[str, Entry]:
        """Meaning of every energy of the ledger, by name."""
        found: dict[str, Entry] = {}
        parts = (
            *self.moving,
            *self.bodies,
            *self.chambers,
            *self.dampers,
            *self.outlets,
            self.scheme,
        )
        for part in parts:
            found |= part.entries()
        return found

    def time(self, state: State) -> Scalar:
        """Physical time of a state, s."""
        return self.t0 + state.step.astype(self.dt.dtype) * self.dt


def own_states(model: Model, dtype: np.dtype | type) -> dict[str, Any]:
    """States of all parts at t = 0, by name."""
    parts = (*model.moving, *model.bodies, *model.chambers, *model.outlets)
    return {part.name: part.start(dtype) for part in parts}
