"""Sensors of the water's pressure and velocity at points, interpolated between the particles."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, columns, stack
from jaxsph.core.pairs import nearest_image
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe, places
from jaxsph.model.solids import AbstractBody
from jaxsph.model.state import State


class PressureProbe(AbstractProbe):
    """Sensor of the water's gauge pressure (Pa) at fixed points, interpolated; zero outside the water."""

    x: Float[Array, "k D"]
    """Positions of the sensors, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        pressure = model.pressure(state)

        def carried(r):
            # first extrapolate each particle's pressure to the sensor with the hydrostatic gradient
            return pressure[:, None] + model.scheme.rho0 * (r @ model.g)[:, None]

        return {"pressure": _interpolated(self.x, model, state, carried)[:, 0]}

    def describe(self):
        """See `AbstractProbe.describe`."""
        return {"pressure": Reading("Pa", "gauge pressure at the sensor", "sensor")}

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return places(self.x, "sensor", "sensor", _axes(self.x))


class BodyPressureProbe(AbstractProbe):
    """Sensor of the water's gauge pressure (Pa) at points that move with a body; see `PressureProbe`."""

    x: Float[Array, "k D"]
    """Positions of the sensors on the body at rest, m."""
    body: str = eqx.field(static=True)
    """Name of the body."""
    reading: str = eqx.field(static=True)
    """Name of the reading."""
    sensor: str = eqx.field(static=True)
    """Name of the reading's dimension."""

    @classmethod
    def of(cls, body: AbstractBody, x: Float[Array, "k D"]) -> BodyPressureProbe:
        """Builds the sensors of a body at points x (m) on the body at rest."""
        return cls(x, body.name, body.called("body_pressure"), body.called("body_sensor"))

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        (body,) = (body for body in model.bodies if body.name == self.body)
        moved = PressureProbe(body.carry(state.parts[body.name], self.x))
        return {self.reading: moved.measure(model, state, tables)["pressure"]}

    def describe(self):
        """See `AbstractProbe.describe`."""
        words = f"gauge pressure at the sensor of the {self.body}"
        return {self.reading: Reading("Pa", words, self.sensor)}

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return places(self.x, self.sensor, "sensor on the body at rest", _axes(self.x))


class VelocityProbe(AbstractProbe):
    """Sensor of the water's velocity (m/s) at fixed points, interpolated; zero outside the water."""

    x: Float[Array, "k D"]
    """Positions of the sensors, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        found = _interpolated(self.x, model, state, lambda _: state.particles.u)
        return {f"velocity_{axis}": found[:, k] for k, axis in enumerate(_axes(self.x))}

    def describe(self):
        """See `AbstractProbe.describe`."""
        return {
            f"velocity_{a}": Reading("m s-1", f"velocity of the water along {a} at the point", "point")
            for a in _axes(self.x)
        }

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return places(self.x, "point", "point", _axes(self.x))


def _axes(x: Float[Array, "k D"]) -> str:
    """Letters of the coordinate axes of points."""
    return "xz" if x.shape[1] == 2 else "xyz"


def _interpolated(points: Float[Array, "k D"], model: Model, state: State, field) -> Float[Array, "k F"]:
    """Kernel averages, at points (m), of `field(r)` `[N, F]`; r: vectors (m) from particles to a point."""
    p, V = state.particles, model.scheme.volume(state.particles)
    smoothing = model.scheme.smoothing

    def at(point):
        r = stack(nearest_image(columns(point - p.x), smoothing.period))
        r2 = jnp.sum(r * r, axis=1)
        w = jnp.where(
            r2 < smoothing.radius**2, V * smoothing.kernel.value(r2, smoothing.h, p.x.shape[1]), 0.0
        )
        near = jnp.sum(w)
        return jnp.where(near > 0.2, (w @ field(r)) / jnp.maximum(near, 0.2), 0.0)

    # one point after the other: all at once would need an array of points times particles
    return jax.lax.map(at, points)
