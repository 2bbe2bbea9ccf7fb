"""What is measured inside the loop, at the sample rate: gauges, sensors, chamber, energy."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph._typing import Array, Float, Scalar, columns, dot, stacked
from jaxsph.devices import column_depth
from jaxsph.pairs import nearest_image, pair_sum, with_empty
from jaxsph.state import AbstractProbe, Model, State

__all__ = [
    "BodyPressureProbe",
    "BodyProbe",
    "ChamberProbe",
    "EnergyProbe",
    "InterpolatedGauge",
    "ParticleGauge",
    "PressureProbe",
    "VelocityProbe",
    "WaveGauge",
]


class WaveGauge(AbstractProbe):
    """Surface elevation over the still level at any x, averaged across the tank: the volume of a column of
    water."""

    x: Float[Array, " k"]
    still: Float[Array, " k"]
    """Depth read in the initial state, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        x, V = columns(state.particles.x), model.scheme.volume(state.particles) / model.walls.width
        period = model.scheme.smoothing.period

        def column(at):
            away = nearest_image((x[0] - at, *x[1:]), period)
            return column_depth(away, V, jnp.zeros_like(at), 3.0 * model.dx)

        depth = jax.vmap(column)(self.x)
        return {"eta": depth - self.still}

    def describe(self):
        """See `AbstractProbe`."""
        return {"eta": ("m", "surface elevation over the still water level")}


class InterpolatedGauge(AbstractProbe):
    """Elevation of the surface at points: the highest level of a line of interpolation points up to which the
    density is more than half the water's (Yeylaghi et al. 2016, section 4.3.2, where half is not said)."""

    x: Float[Array, "k H"]
    """Horizontal coordinates, m."""
    levels: Float[Array, " L"]
    """Heights of the interpolation points, m, upwards."""
    still: Scalar
    """Depth at rest, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        p, V = state.particles, model.scheme.volume(state.particles)
        smoothing, dim = model.scheme.smoothing, state.particles.x.shape[1]

        def at(point):
            across2 = jnp.sum((p.x[:, :-1] - point) ** 2, axis=1)

            def density(z):
                r2 = across2 + (p.x[:, -1] - z) ** 2
                W = smoothing.kernel.value(r2, smoothing.h, dim)
                return jnp.sum(jnp.where(r2 < smoothing.radius**2, V * W, 0.0))

            share = jax.lax.map(density, self.levels)
            wet = share > 0.5
            top = self.levels.shape[0] - 1 - jnp.argmax(wet[::-1])
            above = jnp.minimum(top + 1, self.levels.shape[0] - 1)
            on = (share[top] - 0.5) / jnp.maximum(share[top] - share[above], 1e-6)
            z = self.levels[top] + on * (self.levels[above] - self.levels[top])
            return jnp.where(jnp.any(wet), z, 0.0)

        return {"eta_interpolated": jax.lax.map(at, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe`."""
        return {"eta_interpolated": ("m", "surface elevation at the point, by interpolated density")}


class ParticleGauge(AbstractProbe):
    """Elevation of the surface at points: the mean height of the surface's particles (Yeylaghi et al. 2016,
    Eq. 23-24) within a spacing of the point (their section 4.3.2)."""

    x: Float[Array, "k H"]
    """Horizontal coordinates, m."""
    still: Scalar
    """Height of the surface's particles at rest, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        scheme, p = model.scheme, state.particles
        ghosts, V = scheme.placed(model, state, tables), scheme.volume(state.particles)
        sources = {
            "x": columns(jnp.concatenate([p.x, ghosts.x])),
            "V": jnp.concatenate([V, ghosts.V]),
        }
        around = pair_sum(
            lambda pair, i, j: j["V"] * pair.W,
            scheme.smoothing,
            {"x": columns(p.x)},
            with_empty(sources),
            tables.fluid,
        )
        own = scheme.smoothing.kernel.value(jnp.zeros_like(V), scheme.smoothing.h, p.x.shape[1])
        surface = around + V * own <= 0.9
        z = p.x[:, -1]

        def at(point):
            near = surface & (jnp.sum((p.x[:, :-1] - point) ** 2, axis=1) < model.dx**2)
            # spray that falls back is above, a bubble below: what is within a spacing of the highest counts
            highest = jnp.max(jnp.where(near, z, 0.0))
            near = near & (z > highest - model.dx)
            return jnp.sum(jnp.where(near, z, 0.0)) / jnp.maximum(jnp.sum(near), 1)

        return {"eta_particles": jax.lax.map(at, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe`."""
        return {"eta_particles": ("m", "surface elevation at the point, by the surface's particles")}


class PressureProbe(AbstractProbe):
    """Gauge pressure at fixed points: the water's, interpolated; zero where no water is near."""

    x: Float[Array, "k D"]

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        pressure = model.scheme.pressure(state.particles)

        def carried(r):
            # each particle's pressure is first carried to the sensor's height
            return pressure[:, None] + model.scheme.rho0 * (r @ model.g)[:, None]

        return {"pressure": _interpolated(self.x, model, state, carried)[:, 0]}

    def describe(self):
        """See `AbstractProbe`."""
        return {"pressure": ("Pa", "gauge pressure at the sensor")}


class BodyPressureProbe(AbstractProbe):
    """Gauge pressure at points that move with the body: the water's, as `PressureProbe`."""

    x: Float[Array, "k D"]
    """At rest, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        moved = PressureProbe(model.body.moved(self.x, state.body))
        return {"body_pressure": moved.measure(model, state, tables)["pressure"]}

    def describe(self):
        """See `AbstractProbe`."""
        return {"body_pressure": ("Pa", "gauge pressure at the body's sensor")}


class VelocityProbe(AbstractProbe):
    """Velocity at fixed points: the water's, interpolated; zero where no water is near."""

    x: Float[Array, "k D"]

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        found = _interpolated(self.x, model, state, lambda r: state.particles.u)
        return {f"velocity_{axis}": found[:, k] for k, axis in enumerate(self._axes)}

    def describe(self):
        """See `AbstractProbe`."""
        return {
            f"velocity_{a}": ("m s-1", f"velocity of the water at the point along {a}") for a in self._axes
        }

    @property
    def _axes(self) -> str:
        return "xz" if self.x.shape[1] == 2 else "xyz"


def _interpolated(points: Float[Array, "k D"], model: Model, state: State, field) -> Float[Array, "k F"]:
    """Kernel averages of `field(r)` `[N, F]` at points; r from the particles to the point, m."""
    p, V = state.particles, model.scheme.volume(state.particles)
    smoothing = model.scheme.smoothing

    def at(point):
        r = stacked(nearest_image(columns(point - p.x), smoothing.period))
        r2 = jnp.sum(r * r, axis=1)
        w = jnp.where(
            r2 < smoothing.radius**2, V * smoothing.kernel.value(r2, smoothing.h, p.x.shape[1]), 0.0
        )
        near = jnp.sum(w)
        return jnp.where(near > 0.2, (w @ field(r)) / jnp.maximum(near, 0.2), 0.0)

    # one point after the other: side by side they would take an array of points times particles
    return jax.lax.map(at, points)


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


class EnergyProbe(AbstractProbe):
    """Stored energies over the initial state, a body's too, powers exchanged and lost, the largest speed.

    Powers of paddle, PTO, sponge, contact and projection are sums over every step since the last sample;
    those of viscosity and density diffusion are taken at the sample.
    """

    sample_dt: Scalar
    compression0: Scalar
    """Compression energy of the initial state, J (J/m in 2-D)."""
    field0: Scalar | None = None
    """Potential energy of the initial state in the body force field, J; None without a field."""
    body0: Scalar | None = None
    """Potential energy of the rigid body in the initial state, J; None without one."""
    dim: int = eqx.field(static=True, default=2)

    @classmethod
    def over(cls, model: Model, state: State, sample_dt: Scalar) -> EnergyProbe:
        """The probe whose stored energies are counted from this state."""
        field0 = None if model.force is None else cls.field(model, state)
        body0 = None if model.body is None else model.body.energy(state.body, model.g)[1]
        return cls(sample_dt, model.scheme.compression(state.particles), field0, body0, len(model.g))

    @staticmethod
    def field(model: Model, state: State) -> Scalar:
        """Potential energy in the body force field, J (J/m in 2-D)."""
        return jnp.sum(state.particles.m * model.force.potential(state.particles.x))

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        p = state.particles
        speed2 = dot(columns(p.u), columns(p.u))
        lost = model.scheme.dissipation(model, state, tables)
        potential = -jnp.sum(p.m * model.g[-1] * (p.x[:, -1] - model.z0[p.id]))
        if self.field0 is not None:
            potential = potential + self.field(model, state) - self.field0
        kinetic = 0.5 * jnp.sum(p.m * speed2)
        if self.body0 is not None:
            own, height = model.body.energy(state.body, model.g)
            kinetic, potential = kinetic + own, potential + height - self.body0
        return {
            "kinetic": kinetic,
            "potential": potential,
            "compression": model.scheme.compression(p) - self.compression0,
            "power_paddle": state.work.paddle / self.sample_dt,
            "power_sponge": state.work.sponge / self.sample_dt,
            "loss_viscous": lost.viscous,
            "loss_diffusive": lost.diffusive,
            "power_contact": state.work.contact / self.sample_dt,
            "power_projection": state.work.projection / self.sample_dt,
            "max_speed": jnp.sqrt(jnp.max(speed2)),
            "paddle": state.paddle[0],
        }

    def describe(self):
        """See `AbstractProbe`."""
        energy, power = _per_metre("J", self.dim), _per_metre("W", self.dim)
        return {
            "kinetic": (energy, "kinetic energy"),
            "potential": (energy, "potential energy over the initial state"),
            "compression": (energy, "compression energy over the initial state"),
            "power_paddle": (power, "power of the paddle on the water, mean since the last sample"),
            "power_sponge": (power, "power taken by the sponge, mean since the last sample"),
            "loss_viscous": (power, "viscous dissipation"),
            "loss_diffusive": (power, "dissipation by the density diffusion"),
            "power_contact": (power, "power lost by water that meets a solid, mean since the last sample"),
            "power_projection": (power, "power lost in the projection, mean since the last sample"),
            "max_speed": ("m s-1", "largest speed of a particle"),
            "paddle": ("m", "displacement of the paddle"),
        }


def _per_metre(units: str, dim: int) -> str:
    """Of the tank's width in two dimensions."""
    return f"{units} m-1" if dim == 2 else units
