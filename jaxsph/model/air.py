"""Air of a chamber, its coupling to the water, and the interfaces of power take-offs and ducts.

In two dimensions all quantities are per metre of width.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, dot, stack
from jaxsph.core.slabs import Slabs
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.model.part import AbstractPart
from jaxsph.model.state import Tally

__all__ = [
    "AbstractDuct",
    "AbstractFrame",
    "AbstractPTO",
    "Air",
    "AirCoupling",
    "Given",
    "Pressed",
]


class Air(eqx.Module):
    """State of the air in a chamber, or in a duct, at one time."""

    P_a: Scalar
    """Gauge pressure of a chamber's air, positive when compressed, or pressure drop along a duct, Pa."""
    q: Scalar
    """Flow of air out of the chamber, positive when the water rises, or through the duct, m3/s (m2/s in
    2-D)."""
    driven: Tally
    """Volume of air displaced by the rise of the water, or passed through a duct, since the start of the run,
    m3 (m2 in 2-D)."""
    confined: Any = ()
    """State of compressible air (`parts.air.Confined`); empty for incompressible air."""


class AbstractFrame(eqx.Module):
    """Frame of a chamber, in which the chamber's walls are at rest.

    The argument `parts` of the methods contains the states of the parts, by name.
    """

    @abc.abstractmethod
    def back(self, parts: Mapping[str, Any], x: Components) -> Components:
        """Positions at rest (m) of the points of the frame that are now at x (m)."""

    @abc.abstractmethod
    def turned_back(self, parts: Mapping[str, Any], vectors: Components) -> Components:
        """Vectors rotated from the frame's present orientation to its orientation at rest."""

    @abc.abstractmethod
    def turned(self, parts: Mapping[str, Any], vectors: Components) -> Components:
        """Vectors rotated from the frame's orientation at rest to its present orientation."""

    @abc.abstractmethod
    def reaction(
        self, parts: Mapping[str, Any], x: Components, force: Components
    ) -> dict[str, Float[Array, " V"]]:
        """Generalised forces (N, N m; per metre in 2-D), by name, on the body that carries the frame: the
        reaction to the `force` (N) on points at x (m)."""


class AirCoupling(NamedTuple):
    """Linear maps between the pressure of a chamber's air and the motion of the water and of a body.

    Force and flow use the same weights, so that P_a q is exactly the power that the air absorbs from the
    water and from the body that carries the chamber.
    """

    index: Array
    """Indices of the particles on which the air acts; N marks an unused entry."""
    force: Components
    """Force on each of these particles per unit of P_a, m2 (m in 2-D)."""
    m: Float[Array, " C"]
    """Masses of these particles, kg (kg/m in 2-D)."""
    slabs: Slabs
    """Computing devices among which the particles are divided."""
    reaction: dict[str, Float[Array, " V"]]
    """Force and moment, per unit of P_a, on the body that carries the chamber, by the body's name: the
    reaction to the force on the water. In 2-D two forces (m) and a moment (m2), in 3-D three forces (m2)
    and three moments (m3). Empty if the walls are at rest."""

    def push(self, u: Float[Array, "N D"], impulse: Scalar) -> Float[Array, "N D"]:
        """Velocities of the water (m/s) after an `impulse` of the air, the time integral of P_a (Pa s)."""
        return self.slabs.add(u, self.index, stack([impulse * f / self.m for f in self.force]))

    def flow(self, u: Float[Array, "N D"], velocities: Mapping[str, Float[Array, " V"]]) -> Scalar:
        """Flow of air out of the chamber, m3/s (m2/s in 2-D).

        **Arguments**: the water's velocities u (m/s); `velocities` of the bodies by name: velocity of the
        pivot (m/s) and angular velocity (rad/s).
        """
        at = self.slabs.take(columns(u), jnp.minimum(self.index, u.shape[0] - 1))
        moved = sum(
            (force @ velocities[name] for name, force in self.reaction.items()), jnp.zeros((), u.dtype)
        )
        return -jnp.sum(dot(self.force, at)) - moved

    def mobility(self) -> Scalar:
        """Time derivative of the flow out of the chamber per unit of -P_a, due to the air's force on the
        water alone, m4/kg (m3/kg in 2-D)."""
        return jnp.sum(dot(self.force, self.force) / self.m)


class AbstractPTO(eqx.Module):
    """Power take-off of a chamber: the law between the flow and the pressure of its air."""

    @abc.abstractmethod
    def pressure(self, q_free: Scalar, compliance: Scalar, t: Scalar) -> Scalar:
        """Gauge pressure P_a (Pa) of the air at the end of a step.

        **Arguments**: `q_free`: flow (m3/s; m2/s in 2-D) out of the chamber if P_a were zero over the step;
        `compliance`: -dq/dP_a of that step, so that q = q_free - compliance P_a; `t`: time, s.
        """

    def at(self, air: Air, t: Scalar) -> AbstractPTO:
        """Power take-off for one step, given the chamber's `air` and the time t (s) at the start of the
        step."""
        del air, t
        return self

    def flows(self, P_a: Scalar, q: Scalar) -> Mapping[str, Scalar]:
        """Parts of the flow q (m3/s; m2/s in 2-D) at P_a (Pa), by the names of `entries`; the parts sum to q.

        The energy of an entry is the energy of the air in the entry's part of the flow. If there is a single
        entry, its part is q.
        """
        del P_a
        (name,) = self.entries("")  # a power take-off with several entries overrides this method
        return {name: q}

    def divided(self, mean: Scalar, ducted: Scalar) -> tuple[Scalar, Scalar]:
        """Parts of a step's `mean` flow of incompressible air, m3/s (m2/s in 2-D): through the take-off, and
        into the ducts.

        `ducted`: flow into the ducts that follows from their laws at the end of the step, in the same unit.
        """
        return mean - ducted, ducted

    def entries(self, whose: str) -> Mapping[str, Entry]:
        """Energies that the power take-off adds to the ledger, by kind; `whose`: name of the chamber or duct.

        Useful energy is marked as `Exchange.HARVESTED`.
        """
        return {"pto": Entry(f"power take-off of the {whose}", Exchange.HARVESTED)}


class Pressed(NamedTuple):
    """Pressure and flows of the air in a chamber or a duct over a step, from the laws of the air and of the
    power take-off."""

    P_a: Scalar
    """Gauge pressure of a chamber's air, or pressure drop along a duct, Pa."""
    passed: Scalar
    """Flow through the power take-off, m3/s (m2/s in 2-D)."""
    pto: AbstractPTO
    """Power take-off for the step (`AbstractPTO.at`)."""
    ducted: Scalar
    """Flow out of the chamber into its ducts, m3/s (m2/s in 2-D)."""


class Given(NamedTuple):
    """Energy and flow that a chamber's air has delivered to the chamber's ducts in a step."""

    head: Scalar
    """Energy of the chamber's air per volume of air that leaves the chamber, Pa."""
    flow: Scalar
    """Mean flow into the ducts over the step, m3/s (m2/s in 2-D)."""


class AbstractDuct(AbstractPart):
    """A duct with a power take-off between the air of two chambers."""

    between: eqx.AbstractVar[tuple[str, str]]
    """Names of the chambers; flow from the first to the second is positive."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Air:
        """Air of the duct at t = 0; the pressure of this air is the pressure drop along the duct."""

    @abc.abstractmethod
    def press(self, air: Air, q_free: Scalar, compliance: Scalar, t: Scalar) -> Pressed:
        """Pressure drop along the duct over a step that starts at the time t (s), and the flow through the
        duct.

        **Arguments**: `air`: the duct's air at the start of the step; the other arguments are as in
        `AbstractPTO.pressure`.
        """

    @abc.abstractmethod
    def finish(
        self, air: Air, pressed: Pressed, work: Scalar, dt: Scalar
    ) -> tuple[Air, Mapping[str, Scalar]]:
        """Air at the end of a step of dt (s), and the energies (J, J/m in 2-D) taken from the water, by name.

        `work`: energy that the air of both chambers has delivered to the duct, J (J/m in 2-D).
        """
