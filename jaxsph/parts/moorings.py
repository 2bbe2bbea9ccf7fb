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
    """Ends of a mooring, whose extension is the vector (x, z) from the anchor to the fairlead."""

    body: str = eqx.field(static=True)
    """Name of the body with the fairlead."""
    fairlead: Float[Array, "2"]
    """Position (x, z) of the fairlead with the body at rest, m."""
    anchor: Float[Array, "2"]
    """Position (x, z) of the anchor in the tank, m."""

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


class AbstractMooringLaw(AbstractLaw):
    """Force of a mooring on its fairlead, as a function of the vector from the anchor to the fairlead."""

    @abc.abstractmethod
    def anchor_tension(self, own: Any, s: Float[Array, "2"]) -> Scalar:
        """Tension at the anchor, N (N/m in 2-D). `own`: state of the law."""

    @abc.abstractmethod
    def shape(self, own: Any, s: Float[Array, "2"]) -> Float[Array, "K 2"]:
        """Points (m) of the line from the anchor to the fairlead, relative to the anchor."""


class QuasiStatic(AbstractMooringLaw):
    """Law of a mooring that is in static equilibrium at every time: no inertia, no drag."""

    catenary: AbstractCatenary
    """The line."""

    @property
    def dissipates(self):
        """See `AbstractLaw`."""
        return False

    def stored(self, own, s):
        """See `AbstractLaw`."""
        del own
        return self.catenary.energy(s[0], s[1])

    def anchor_tension(self, own, s):
        """See `AbstractMooringLaw`."""
        del own
        force = self.catenary.end_forces(jnp.abs(s[0]), s[1])
        return jnp.sqrt(force.across**2 + force.below**2)

    def shape(self, own, s):
        """See `AbstractMooringLaw`."""
        del own
        along = self.catenary.length * jnp.linspace(0.0, 1.0, POINTS, dtype=s.dtype)
        x = self.catenary.shape(jnp.abs(s[0]), s[1], along)
        return x.at[:, 0].multiply(jnp.where(s[0] < 0.0, -1.0, 1.0))


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
        return {self.name: Entry(f"energy taken by the mooring {self.name}")} if self.law.dissipates else {}

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
        across, up = state.force
        return {
            self.called("fairlead_tension"): jnp.hypot(across, up),
            self.called("anchor_tension"): self.law.anchor_tension(state.own, state.extension),
            self.called("fairlead_angle"): jnp.arctan2(-up, jnp.abs(across)),
        }
