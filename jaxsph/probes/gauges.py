"""Gauges of the surface elevation: by column volume, wet length of a wire, or interpolated density."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar, columns
from jaxsph.core.pairs import nearest_image
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe, places
from jaxsph.parts.border import flume_of
from jaxsph.parts.paddle import column_depth


class WaveGauge(AbstractProbe):
    """Gauge of the surface elevation (m) at any x, from the volume of a water column across the tank."""

    x: Float[Array, " k"]
    """Positions of the gauges along the tank, m."""
    still: Float[Array, " k"]
    """Depth that the gauge reads at zero elevation, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        x, V = columns(state.particles.x), model.scheme.volume(state.particles) / model.walls.width
        period = model.scheme.smoothing.period

        def column(at):
            away = nearest_image((x[0] - at, *x[1:]), period)
            return column_depth(away, V, jnp.zeros_like(at), 3.0 * model.dx)

        depth = jax.vmap(column)(self.x)
        return {"eta": depth - self.still}

    def describe(self):
        """See `AbstractProbe.describe`."""
        return {"eta": Reading("m", "surface elevation above the still water level", "gauge")}

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return places(np.asarray(self.x)[:, None], "gauge", "gauge, from the paddle at rest", "x")


class FlumeGauge(AbstractProbe):
    """Gauge of the surface elevation (m) in a tank with a coarse flume, which measures each position in the
    zone that it belongs to."""

    own: WaveGauge
    """Gauges in the water of the model, one for every position."""
    flume: WaveGauge
    """Gauges in the flume, one for every position."""
    border: Scalar
    """Position x up to which the flume is measured, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        behind = self.own.measure(model, state, tables)["eta"]
        before = self.flume.measure(*flume_of(model, state), tables)["eta"]
        return {"eta": jnp.where(self.own.x < self.border, before, behind)}

    def describe(self):
        """See `AbstractProbe.describe`."""
        return self.own.describe()

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return self.own.coordinates()


class InterpolatedGauge(AbstractProbe):
    """Gauge of the surface elevation (m), from the density along a vertical line of points.

    The surface is at the highest level at which the density is half the water's (Yeylaghi et al. 2016,
    section 4.3.2, which does not specify this ratio).
    """

    x: Float[Array, "k H"]
    """Horizontal coordinates of the gauges, m."""
    levels: Float[Array, " L"]
    """Heights of the interpolation points, m, in ascending order."""
    still: Scalar
    """Height of zero elevation, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
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
            return jnp.where(jnp.any(wet), z, 0.0)  # a dry bed: the surface is at z = 0

        return {"eta_interpolated": jax.lax.map(at, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe.describe`."""
        what = "surface elevation at the point, from interpolated density"
        return {"eta_interpolated": Reading("m", what, "surface_point")}

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return places(self.x, "surface_point", "point", "xy"[: self.x.shape[1]])


class WireGauge(AbstractProbe):
    """Gauge of the surface elevation (m) at points, from the wet length of a vertical wire.

    A resistance gauge measures this length. A splash adds only the length that it wets, whatever the height
    of the splash, and over a dry bed the depth is zero. The volume fraction of water along the wire is
    sum_j V_j W(x - x_j). The integral of this fraction over the height is sum_j V_j W'(x - x_j), where W' is
    a Gaussian of the horizontal distance with a smoothing length of 1.2 dx. The reading of a plane surface is
    exact. In a wave of wavenumber k the reading is too low by the fraction 0.36 (k dx)^2. Next to a wall the
    wire reads the elevation at up to 0.7 dx from the wall. Within 2.5 dx of a plate the wire also measures
    the water behind the plate.
    """

    x: Float[Array, "k H"]
    """Horizontal coordinates of the wires, m."""
    still: Float[Array, " k"]
    """Depth that a wire reads at zero elevation, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        x, V = columns(state.particles.x)[:-1], model.scheme.volume(state.particles)
        walls, period, h = model.walls, model.scheme.smoothing.period, 1.2 * model.dx

        def depth(point):
            away = nearest_image(tuple(a - b for a, b in zip(x, point, strict=True)), period)
            near = jnp.exp(-sum((a / h) ** 2 for a in away)) / (jnp.sqrt(jnp.pi) * h) ** len(x)
            inside = jnp.ones_like(h)  # share of the Gaussian that is not behind a wall
            for b, low, high, side in zip(point, walls.low, walls.high, walls.sides, strict=False):
                if side != "periodic":
                    inside = inside * 0.5 * (jax.lax.erf((high - b) / h) - jax.lax.erf((low - b) / h))
            return jnp.sum(V * near) / inside

        return {"eta_wire": jax.lax.map(depth, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe.describe`."""
        what = "surface elevation at the point, from the wet length of a wire"
        return {"eta_wire": Reading("m", what, "surface_point")}

    def coordinates(self):
        """See `AbstractProbe.coordinates`."""
        return places(self.x, "surface_point", "point", "xy"[: self.x.shape[1]])
