"""What is measured inside the loop, at the sample rate: gauges, sensors, chamber, energy."""

from __future__ import annotations

import equinox as eqx

from jaxsph.core.arrays import Scalar, columns
from jaxsph.model.interfaces import AbstractProbe
from jaxsph.probes.energy import _per_metre


class ChamberProbe(AbstractProbe):
    """Level, volume, flow, air pressure and power of the OWC."""

    sample_dt: Scalar

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        x, V = columns(state.particles.x), model.scheme.volume(state.particles)
        chamber = model.chamber
        return {
            "chamber_level": chamber.level(x, V, model.dx),
            "chamber_volume": chamber.volume(x, V, model.dx),
            "P_a": state.air[0],
            "flow": state.air[1],
            "flow_mean": state.work.flow / self.sample_dt,
            "power_pto": state.work.pto / self.sample_dt,
        }

    def describe(self):
        """See `AbstractProbe`."""
        return {
            "chamber_level": ("m", "mean elevation of the chamber's surface over the still level"),
            "chamber_volume": ("m2", "water in the chamber above the level where flow is measured"),
            "P_a": ("Pa", "gauge pressure of the chamber's air, positive when compressed"),
            "flow": ("m2 s-1", "flow of air out of the chamber per unit width"),
            "flow_mean": ("m2 s-1", "flow out of the chamber, mean since the last sample"),
            "power_pto": ("W m-1", "power taken by the PTO, mean since the last sample"),
        }


class BodyProbe(AbstractProbe):
    """Motion of the rigid body, the water's force on it, and the power of its PTO."""

    sample_dt: Scalar
    dim: int = eqx.field(static=True, default=2)

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        body = state.body
        return {
            "surge": body.pose[0],
            "heave": body.pose[1],
            "pitch": body.pose[2],
            "body_velocity": body.velocity,
            "body_force": body.force + body.contact,
            "body_force_mean": state.work.impulse / self.sample_dt,
            "power_pto": state.work.pto / self.sample_dt,
        }

    def describe(self):
        """See `AbstractProbe`."""
        return {
            "surge": ("m", "displacement of the body along the tank"),
            "heave": ("m", "displacement of the body upwards"),
            "pitch": ("rad", "angle of the body, positive landward"),
            "body_velocity": ("m s-1, m s-1, rad s-1", "velocities of surge, heave and pitch"),
            "body_force": ("N, N, N m", "the water's force on the body, and its moment about the pivot"),
            "body_force_mean": ("N, N, N m", "the same, mean since the last sample"),
            "power_pto": (_per_metre("W", self.dim), "power taken by the PTO, mean since the last sample"),
        }
