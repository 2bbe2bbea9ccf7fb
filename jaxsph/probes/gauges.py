"""Gauges of the surface elevation: by a column's volume, a wire's wet length or interpolated density."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, columns
from jaxsph.core.pairs import nearest_image
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe, places
from jaxsph.parts.paddle import column_depth


class WaveGauge(AbstractProbe):
    """Gauge of the surface elevation (m) at any x, by the volume of a water column across the tank."""

    x: Float[Array, " k"]
    """Positions of the gauges along the tank, m."""
    still: Float[Array, " k"]
    """Depth (m) that the gauge reads where the elevation is zero."""

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
        return {"eta": Reading("m", "surface elevation over the still water level", "gauge")}

    def coordinates(self):
        """See `AbstractProbe`."""
        return places(self.x[:, None], "gauge", "gauge, from the paddle at rest", "x")


class InterpolatedGauge(AbstractProbe):
    """Gauge of the surface elevation (m) at points, by the density along a vertical line of them.

    The surface is at the highest level at which the density is half the water's (Yeylaghi et al. 2016,
    section 4.3.2, which does not say which share of it).
    """

    x: Float[Array, "k H"]
    """Horizontal coordinates of the gauges, m."""
    levels: Float[Array, " L"]
    """Heights of the interpolation points, m, upwards."""
    still: Scalar
    """Height (m) from which the elevation counts."""

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
            return jnp.where(jnp.any(wet), z, 0.0)  # a dry bed: the surface is on it

        return {"eta_interpolated": jax.lax.map(at, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe`."""
        what = "surface elevation at the point, by interpolated density"
        return {"eta_interpolated": Reading("m", what, "surface_point")}

    def coordinates(self):
        """See `AbstractProbe`."""
        return places(self.x, "surface_point", "point", "xy"[: self.x.shape[1]])


class WireGauge(AbstractProbe):
    """Gauge of the surface elevation (m) at points, by the length of a vertical wire that is wet.

    A resistance gauge reads that length: a splash counts by the water in it, not by its top, and a dry bed
    reads a depth of zero. The share of water along the wire is sum_j V_j W(x - x_j), whose integral over the
    height is sum_j V_j W'(x - x_j), with a Gaussian W' of the horizontal distance, of the smoothing length
    1.2 dx. A plane surface reads exactly, and a wave of wavenumber k less its share 0.36 (k dx)^2. Beside
    a wall the wire reads the surface as it is up to 0.7 dx away from it, and within 2.5 dx of a plate it sees
    the water behind the plate too.
    """

    x: Float[Array, "k H"]
    """Horizontal coordinates of the wires, m."""
    still: Float[Array, " k"]
    """Depth (m) that a wire reads where the elevation is zero."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        x, V = columns(state.particles.x)[:-1], model.scheme.volume(state.particles)
        walls, period, h = model.walls, model.scheme.smoothing.period, 1.2 * model.dx

        def depth(point):
            away = nearest_image(tuple(a - b for a, b in zip(x, point, strict=True)), period)
            near = jnp.exp(-sum((a / h) ** 2 for a in away)) / (jnp.sqrt(jnp.pi) * h) ** len(x)
            inside = jnp.ones_like(h)  # the share of the Gaussian that is not behind a wall
            for b, low, high, side in zip(point, walls.low, walls.high, walls.sides, strict=False):
                if side != "periodic":
                    inside = inside * 0.5 * (jax.lax.erf((high - b) / h) - jax.lax.erf((low - b) / h))
            return jnp.sum(V * near) / inside

        return {"eta_wire": jax.lax.map(depth, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe`."""
        what = "surface elevation at the point, by the wet length of a wire"
        return {"eta_wire": Reading("m", what, "surface_point")}

    def coordinates(self):
        """See `AbstractProbe`."""
        return places(self.x, "surface_point", "point", "xy"[: self.x.shape[1]])
