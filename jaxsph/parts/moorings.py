"""Moorings: links between an anchor and a fairlead on a body, with the law of the quasi-static catenary."""

from __future__ import annotations

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.links import AbstractEnds, AbstractLaw, Link
from jaxsph.model.meaning import Entry, Reading
from jaxsph.parts.catenary import AbstractCatenary

__all__ = ["AbstractMooringLaw", "FromAnchor", "Mooring", "QuasiStatic"]

POINTS = 101
"""Number of points in the shape of a catenary."""


class FromAnchor(AbstractEnds):
    """Ends of a mooring, whose extension is the vector from the anchor to the fairlead."""

    body: str = eqx.field(static=True)
    """Name of the body with the fairlead."""
    fairlead: Float[Array, " D"]
    """Position of the fairlead with the body at rest, m."""
    anchor: Float[Array, " D"]
    """Position of the anchor in the tank, m."""

    @property
    def unit(self):
        """See `AbstractEnds`."""
        return "m"

    def extension(self, places):
        """See `AbstractEnds`."""
        return places.point(self.body, self.fairlead) - self.anchor

    def points(self, places):
        """See `AbstractEnds`."""
        return jnp.stack([self.anchor, places.point(self.body, self.fairlead)])

    @property
    def bodies(self):
        """See `AbstractEnds`."""
        return (self.body,)


def span_and_height(s: Float[Array, " D"]) -> tuple[Scalar, Scalar]:
    """Length of a vector's horizontal part, and the vector's upward component."""
    # 1e-12 keeps the derivative of the length finite for a vertical vector
    return jnp.sqrt(jnp.sum(s[:-1] ** 2) + 1e-12), s[-1]


def upright(line: Float[Array, "K 2"], s: Float[Array, " D"]) -> Float[Array, "K D"]:
    """Points (m) of a line, from their horizontal distances and heights (m) in the vertical plane that
    contains the vector s (m)."""
    across = s[:-1] / span_and_height(s)[0]
    return jnp.concatenate([line[:, :1] * across, line[:, 1:]], axis=1)


class AbstractMooringLaw(AbstractLaw):
    """Law of the force on a fairlead; the extension is the vector from the anchor to the fairlead."""

    @abc.abstractmethod
    def anchor_tension(self, own: Any, s: Float[Array, " D"]) -> Scalar:
        """Tension at the anchor, N (N/m in 2-D). `own`: state of the law."""

    @abc.abstractmethod
    def shape(self, own: Any, s: Float[Array, " D"]) -> Float[Array, "K D"]:
        """Points (m) of the line from the anchor to the fairlead, relative to the anchor."""


class QuasiStatic(AbstractMooringLaw):
    """Law of a mooring that is in static equilibrium at all times: no inertia, no drag."""

    catenary: AbstractCatenary
    """The line."""

    @property
    def dissipates(self):
        """See `AbstractLaw`."""
        return False

    def stored(self, own, s):
        """See `AbstractLaw`."""
        del own
        return self.catenary.energy(*span_and_height(s))

    def anchor_tension(self, own, s):
        """See `AbstractMooringLaw`."""
        del own
        force = self.catenary.end_forces(*span_and_height(s))
        return jnp.sqrt(force.across**2 + force.below**2)

    def shape(self, own, s):
        """See `AbstractMooringLaw`."""
        del own
        along = self.catenary.length * jnp.linspace(0.0, 1.0, POINTS, dtype=s.dtype)
        return upright(self.catenary.shape(*span_and_height(s), along), s)


class Mooring(Link):
    """Mooring of a body to an anchor in the tank."""

    law: AbstractMooringLaw
    """Law of the force on the fairlead."""
    name: str = eqx.field(static=True, default="mooring", kw_only=True)
    usual_name: ClassVar[str] = "mooring"

    def drawn(self, motion, places):
        """See `Link`."""
        return self.ends.points(places)[0] + self.law.shape(motion.own, motion.extension)

    def entries(self):
        """See `AbstractPart`."""
        what = f"energy absorbed by the mooring {self.name}"
        return {self.name: Entry(what)} if self.law.dissipates else {}

    def readings(self, dim):
        """See `AbstractPart`."""
        force, of = self._force_unit(dim), f"of the mooring {self.name}"
        return {
            self.called("fairlead_tension"): Reading(force, f"tension at the fairlead {of}"),
            self.called("anchor_tension"): Reading(force, f"tension at the anchor {of}"),
            self.called("fairlead_angle"): Reading(
                "rad", f"angle of the line at the fairlead {of}, downwards from the horizontal"
            ),
        }

    def read(self, state, sampled):
        """See `AbstractPart`."""
        del sampled
        across, up = span_and_height(state.force)
        return {
            self.called("fairlead_tension"): jnp.hypot(across, up),
            self.called("anchor_tension"): self.law.anchor_tension(state.own, state.extension),
            self.called("fairlead_angle"): jnp.arctan2(-up, across),
        }
