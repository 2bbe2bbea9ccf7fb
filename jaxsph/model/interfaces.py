"""Interfaces of schemes, tangent filters, damping zones, outlets and chambers; `Model` contains all parts.

A step loops over tuples of parts. An empty tuple costs nothing, because these loops run only while JAX traces
the step. A part stores its evolving state in `state.parts` under its `name` and adds its energies to
`state.ledger`. In two dimensions all quantities are per metre of width.

The interfaces of schemes and chambers and the class `Model` refer to each other, and therefore share this
file. The interfaces of solids (`model.solids`) and of air and power take-offs (`model.air`) do not refer to
`Model`.
"""

from __future__ import annotations

import abc
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, stack
from jaxsph.core.pairs import Law, Smoothing
from jaxsph.core.slabs import Chosen, Sources
from jaxsph.model.air import AbstractDuct, AbstractFrame, AbstractPTO, Air, AirCoupling, Given, Pressed
from jaxsph.model.forces import FORCES, AbstractForce
from jaxsph.model.links import Link
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.model.mechanism import Mechanism
from jaxsph.model.part import AbstractPart
from jaxsph.model.solids import AbstractBody, AbstractMovingSolid, AbstractSolid, AbstractWall
from jaxsph.model.state import Particles, Search, State, Tables, with_mass

__all__ = [
    "AbstractChamber",
    "AbstractDamper",
    "AbstractForce",
    "AbstractGrip",
    "AbstractOutlet",
    "AbstractScheme",
    "AbstractTangents",
    "ExactTangents",
    "Model",
]


# --------------------------------------------------------------------------- the water


class AbstractScheme(eqx.Module):
    """A scheme: the discrete equations that advance the fluid in time."""

    smoothing: eqx.AbstractVar[Smoothing]
    """Kernel, smoothing length and periodic axes."""
    grip: eqx.AbstractClassVar[AbstractGrip]
    """Form in which the scheme applies the pressure of a chamber's air to the water."""
    rho0: eqx.AbstractVar[Scalar]
    """Density of water at zero gauge pressure, kg/m3."""
    too_fast: eqx.AbstractClassVar[str]
    """Text of the error message for a particle that is faster than `fastest`."""

    @abc.abstractmethod
    def pressure(self, p: Particles) -> Float[Array, " N"]:
        """Gauge pressure of every particle, Pa."""

    @abc.abstractmethod
    def with_pressure(self, p: Particles, pressure: Float[Array, " N"]) -> Particles:
        """Particles with the gauge pressure `pressure` (Pa), and with masses that leave their volumes
        unchanged."""

    @abc.abstractmethod
    def stable_dt(self, g: float, dim: int) -> float:
        """Largest stable time step, s, for the gravity g (m/s2) in `dim` dimensions."""

    @abc.abstractmethod
    def fastest(self, dt: Scalar | float) -> Scalar:
        """Speed above which the scheme is no longer valid with time steps of dt (s), m/s."""

    @abc.abstractmethod
    def description(self) -> str:
        """Text for users with the name and the characteristic speed (m/s) of the scheme."""

    @abc.abstractmethod
    def cost(self, dx: float, dim: int) -> float:
        """Computing time of a step per water particle, s, on one core of a current CPU, accurate to
        50 % in most cases.

        Each ghost adds `AbstractFilling.effort` times this time.

        **Arguments**: `dx`: spacing, m; `dim`: number of dimensions.
        """

    def neighbours(self, dx: float, dim: int) -> float:
        """Number of particles in the kernel's support, with the spacing `dx` (m) in `dim` dimensions."""
        reach = float(self.smoothing.radius) / dx
        return math.pi * reach**2 * (1.0 if dim == 2 else 4.0 / 3.0 * reach)

    @abc.abstractmethod
    def compression(self, p: Particles) -> Scalar:
        """Energy stored by compression of the water, J (J/m in 2-D)."""

    def losses(self) -> Mapping[str, str]:
        """Meanings of the powers that `dissipation` computes, by name; by default there are none."""
        return {}

    def dissipation(self, model: Model, state: State, tables: Tables) -> Mapping[str, Scalar]:
        """Powers lost in terms whose energies are not in the ledger, by name, W (W/m in 2-D)."""
        del model, state, tables
        return {}

    def volume(self, p: Particles) -> Float[Array, " N"]:
        """Volume of every particle, m3 (m2 in 2-D)."""
        return p.m / (self.rho0 + p.rho)

    @abc.abstractmethod
    def prepare(self, model: Model, state: State) -> tuple[State, Tables]:
        """State with its particles sorted by cell, and their neighbour tables; an overflow is flagged."""

    @abc.abstractmethod
    def step(self, model: Model, state: State, tables: Tables) -> State:
        """State after one time step of `model.dt`."""

    @abc.abstractmethod
    def regularise(self, model: Model, state: State, tables: Tables) -> State:
        """State after the scheme's regularisation of the particles, if one is due at this search."""

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Meaning of the energies that the scheme itself adds to the ledger, by name."""

    @abc.abstractmethod
    def limiters(self) -> Mapping[str, str]:
        """Descriptions of the scheme's limiters, by their names in `State.limits`."""


class AbstractTangents(eqx.Module):
    """Filter of the state's tangents after each step; values are unchanged."""

    @abc.abstractmethod
    def filter(self, model: Model, state: State, tables: Tables) -> State:
        """State with filtered tangents and unchanged values."""


class ExactTangents(AbstractTangents):
    """No filter: the tangents of the state are unchanged."""

    def filter(self, model, state, tables):
        """See `AbstractTangents.filter`."""
        del model, tables
        return state


class AbstractDamper(AbstractPart):
    """A zone in which the velocities of the water are relaxed towards given velocities, for example zero."""

    @abc.abstractmethod
    def damp(
        self, x: Float[Array, "N D"], u: Float[Array, "N D"], t: Scalar, dt: Scalar
    ) -> Float[Array, "N D"]:
        """Damped velocities (m/s) of water at x (m) with velocities u (m/s), for a step of dt (s) that ends
        at the time t (s)."""


class AbstractOutlet(AbstractPart):
    """A place where water leaves the model permanently."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Any:
        """State of the outlet at t = 0, stored as `State.parts[name]`."""

    @abc.abstractmethod
    def drain(self, model: Model, state: State) -> State:
        """State without the water that has reached the outlet since the last search."""


# --------------------------------------------------------------------------- chambers


class AbstractGrip(eqx.Module):
    """Form in which a scheme applies the air's pressure to the water, p = P_a on the surface of a chamber."""

    @abc.abstractmethod
    def force(
        self,
        chamber: AbstractChamber,
        x: Components,
        V: Float[Array, " C"],
        around: Callable[[Law], Components],
    ) -> Components:
        """Force on particles per unit of P_a, m2 (m in 2-D).

        **Arguments**: `x`, `V`: positions (m) and volumes (m3; m2 in 2-D) of the particles; `around(law)`:
        sums of a pair law over the particles' neighbours.
        """

    @abc.abstractmethod
    def water_pressure(self, weight: Float[Array, " N"]) -> Float[Array, " N"]:
        """Fraction (0 to 1) of P_a to add to the scheme's pressure to obtain the total pressure of the water.

        `weight`: weights chi of the chamber at the particles.
        """


class AbstractChamber(AbstractPart):
    """A chamber of trapped air above a part of the water's surface."""

    pto: eqx.AbstractVar[AbstractPTO]
    """Power take-off of the chamber."""
    frame: eqx.AbstractVar[AbstractFrame]
    """Frame in which the chamber's walls are at rest. Unless stated otherwise, positions refer to this
    frame, with all bodies at rest."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Air:
        """Air of the chamber at t = 0."""

    @abc.abstractmethod
    def volume(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Volume of the water in the chamber, m3 (m2 in 2-D), for particles with volumes V at x (m).

        `smooth`: half the height (m) of the layer in which particles are counted partly.
        """

    @abc.abstractmethod
    def level(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Mean elevation of the chamber's surface above still water, m; arguments as for `volume`."""

    @abc.abstractmethod
    def candidates(self, x: Components, margin: float, capacity: int) -> tuple[Array, Array]:
        """Indices `[capacity]` of particles on which the air may act before the next search, and their
        number.

        `margin`: distance by which the air's region is widened to allow for motion until that search, m.
        """

    @abc.abstractmethod
    def weight(self, x: Components) -> Float[Array, " N"]:
        """Weight chi of the air's pressure at points x (m), 0 to 1."""

    @abc.abstractmethod
    def coupling(
        self,
        scheme: AbstractScheme,
        water: Particles,
        sources: Sources,
        tables: Tables,
        parts: Mapping[str, Any],
    ) -> AirCoupling:
        """Coupling of the chamber's air to the particles at their present positions.

        `parts`: states of the parts by name."""

    @abc.abstractmethod
    def press(
        self, air: Air, q_free: Scalar, compliance: Scalar, ducted: Scalar, t: Scalar, dt: Scalar
    ) -> Pressed:
        """Pressure of the air over a step of dt (s) that starts at the time t (s) with the state `air`.

        **Arguments**: `q_free`: flow out of the chamber (m3/s; m2/s in 2-D) at the end of the step if P_a
        were zero; `compliance`: -dq/dP_a of that flow, so that q = q_free - compliance P_a; `ducted`: flow
        out of the chamber into its ducts.
        """

    @abc.abstractmethod
    def finish(
        self, air: Air, pressed: Pressed, before: Scalar, after: Scalar, dt: Scalar
    ) -> tuple[Air, Mapping[str, Scalar], Given]:
        """Air at the end of a step of dt (s), the energies (J, J/m in 2-D) taken from the water, by name, and
        the energy and flow given to the ducts.

        **Arguments**: `before`, `after`: flows out of the chamber at the start and the end of the step, with
        the coupling of the step, m3/s (m2/s in 2-D).
        """

    @abc.abstractmethod
    def water_pressure(self, air: Air, grip: AbstractGrip, x: Components) -> Float[Array, " N"]:
        """Part of the water's gauge pressure at x (m) that is due to the air, Pa.

        This part must be added to the scheme's pressure, which does not contain it. `grip`: the
        form in which the scheme applies the air pressure (`AbstractScheme.grip`).
        """


# --------------------------------------------------------------------------- the model


class Model(eqx.Module):
    """Model of a case: everything that does not change in the time loop.

    Every float is an array leaf, which can be traced and differentiated.
    """

    scheme: AbstractScheme
    """Scheme that advances the fluid."""
    walls: Any
    """Ghosts of all solids (`solids.walls.Ghosts`)."""
    solids: tuple[AbstractSolid, ...]
    """Solids at rest."""
    moving: tuple[AbstractWall, ...]
    """Moving walls: paddles and driven solids."""
    bodies: tuple[AbstractBody, ...]
    """Rigid bodies."""
    links: tuple[Link, ...]
    """Forces between bodies, or between a body and the tank."""
    chambers: tuple[AbstractChamber, ...]
    """Chambers of trapped air."""
    ducts: tuple[AbstractDuct, ...]
    """Ducts between the air of chambers."""
    dampers: tuple[AbstractDamper, ...]
    """Damping zones."""
    outlets: tuple[AbstractOutlet, ...]
    """Places where water leaves permanently."""
    forces: tuple[AbstractForce, ...]
    """Body forces in addition to the uniform gravity g."""
    tangents: AbstractTangents
    """Filter of the state's tangents; `ExactTangents` for no filter."""
    g: Float[Array, " D"]
    """Acceleration of gravity, a vector, m/s2."""
    dx: Scalar
    """Particle spacing, m."""
    dt: Scalar
    """Time step, s."""
    t0: Scalar
    """Physical time of step 0, s."""
    depth: Scalar
    """Depth of water for depth-averaged results, m."""
    z0: Float[Array, " N"]
    """Initial height of each particle, by `Particles.id`, m; potential energies are relative to this
    height."""
    search: Search
    """Neighbour search, and the sizes of its tables."""

    def step(self, state: State, tables: Tables) -> State:
        """State after one time step of the scheme, with its tangents filtered."""
        new = self.scheme.step(self, state, tables)
        new = eqx.tree_at(lambda s: s.particles, new, with_mass(new.particles, state.particles))
        return self.tangents.filter(self, new, tables)

    def every_solid(self) -> Sequence[AbstractSolid]:
        """All solids of the model: those at rest, moving walls and bodies."""
        return (*self.solids, *self.moving, *self.bodies)

    def movers(self) -> Sequence[AbstractMovingSolid]:
        """Solids that can move: the moving walls, and the bodies that are not fixed."""
        return (*self.moving, *(body for body in self.bodies if not body.fixed))

    def walls_at(
        self, parts: Mapping[str, Any], *mirrored: Float[Array, "I D"]
    ) -> tuple[Float[Array, "G D"], Float[Array, "G D"]]:
        """Positions of all ghosts and of their nodes, m, with the moving solids in the states `parts`.

        `mirrored`: positions (m) of the particles that image ghosts mirror, at most one array. Without
        `mirrored` the image ghosts keep their positions at rest.
        """
        x, nodes, images = self.walls.x, self.walls.node, self.walls.images
        for solid in (*self.moving, *self.bodies):
            rows = slice(*solid.rows)
            there, its_nodes = solid.place(parts[solid.name], x[rows], nodes[rows])
            x, nodes = x.at[rows].set(there), nodes.at[rows].set(its_nodes)
        for seen in mirrored:
            x = x.at[: images.count].set(images.image(seen, self.paddle_at(parts)))
            nodes = nodes.at[: images.count].set(seen)
        return x, nodes

    def paddle_at(self, parts: Mapping[str, Any]) -> Callable[[Array], Array]:
        """Function that returns the present positions (m) of points fixed to the paddle, or to a far end that
        moves, from their positions at rest. At an end that does not move it is the identity."""
        ends = {
            wall.rows: functools.partial(wall.place, parts[wall.name])
            for wall in self.moving
            if wall.rows in (self.walls.paddle, self.walls.far_end)
        }
        near, far = (ends.get(rows, lambda x, _: (x, x)) for rows in (self.walls.paddle, self.walls.far_end))
        if not self.walls.far_end:
            return lambda x: near(x, x)[0]
        middle = 0.5 * (self.walls.low[0] + self.walls.high[0])
        return lambda x: jnp.where(x[:, :1] < middle, near(x, x)[0], far(x, x)[0])

    def ghosts_at(
        self, parts: Mapping[str, Any], p: Particles, images: Chosen
    ) -> tuple[Float[Array, "G D"], Float[Array, "G D"], Float[Array, " G"]]:
        """Positions (m) of all ghosts and of their nodes, and the volumes (m^D) that the ghosts have if wet.

        `images`: particles of `p` that image ghosts mirror. An image ghost without a particle is at its
        position at rest and has no volume.
        """
        count, there = self.walls.images.count, images.there
        seen = images.fields({"x": columns(p.x), "V": self.scheme.volume(p)})
        x, nodes = self.walls_at(parts, stack(seen["x"]))
        share = there.astype(p.x.dtype) * seen["V"] * self.walls.images.share(x[:count])
        x = x.at[:count].set(jnp.where(there[:, None], x[:count], self.walls.x[:count]))
        return x, nodes, self.walls.volume.at[:count].set(share)

    def acceleration(self, x: Float[Array, "N D"], t: Scalar) -> Float[Array, "N D"]:
        """Acceleration due to the body forces other than g at x (m) and the time t (s), m/s2."""
        total = jnp.zeros_like(x)
        for force in self.forces:
            total = total + force.acceleration(x, t)
        return total

    def pressure(self, state: State) -> Float[Array, " N"]:
        """Gauge pressure of every particle, Pa: the scheme's pressure plus the part due to the chambers'
        air."""
        p = self.scheme.pressure(state.particles)
        for chamber in self.chambers:
            air = state.parts[chamber.name]
            x = chamber.frame.back(state.parts, columns(state.particles.x))
            p = p + chamber.water_pressure(air, self.scheme.grip, x)
        return p

    @property
    def mechanism(self) -> Mechanism:
        """All bodies and links, as one system of joined bodies."""
        return Mechanism(self.bodies, self.links)

    @property
    def parts(self) -> tuple[AbstractPart, ...]:
        """Parts that exchange energy with the water or have readings."""
        return (
            *self.moving,
            *self.bodies,
            *self.links,
            *self.chambers,
            *self.ducts,
            *self.dampers,
            *self.outlets,
        )

    def entries(self) -> dict[str, Entry]:
        """Meaning of every energy of the ledger, by name."""
        found: dict[str, Entry] = {}
        for part in (*self.parts, self.scheme):
            found |= part.entries()
        if self.forces:
            found[FORCES] = Entry("work of body forces", Exchange.GIVEN)
        return found

    def time(self, state: State) -> Scalar:
        """Physical time t0 + step dt of a state, s."""
        return self.t0 + state.step.astype(self.dt.dtype) * self.dt
