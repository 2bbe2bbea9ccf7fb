"""Gauges of the surface elevation: by a water column's volume, interpolated density or surface particles."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, columns
from jaxsph.core.pairs import nearest_image
from jaxsph.model.interfaces import AbstractProbe, Reading
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


class ParticleGauge(AbstractProbe):
    """Gauge of the surface elevation (m) at points, by the mean height of the surface's particles nearby.

    Surface particles are those of Yeylaghi et al. 2016, Eq. 23-24; nearby is within a spacing of the point
    (their section 4.3.2).
    """

    x: Float[Array, "k H"]
    """Horizontal coordinates of the gauges, m."""
    still: Scalar
    """Height (m) of the surface's particles where the elevation is zero: half a spacing under it."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        p = state.particles
        surface = model.scheme.kernel_sum(model, state, tables) <= 0.9
        z = p.x[:, -1]

        def at(point):
            near = surface & (jnp.sum((p.x[:, :-1] - point) ** 2, axis=1) < model.dx**2)
            # only what is within a spacing of the highest counts: the rim of a bubble below does not
            highest = jnp.max(jnp.where(near, z, 0.0))
            near = near & (z > highest - model.dx)
            mean = jnp.sum(jnp.where(near, z, 0.0)) / jnp.maximum(jnp.sum(near), 1)
            # without a particle of the surface nearby there is no reading, and none is made up
            return jnp.where(jnp.any(near), mean, jnp.nan)

        return {"eta_particles": jax.lax.map(at, self.x) - self.still}

    def describe(self):
        """See `AbstractProbe`."""
        what = "surface elevation at the point, by the surface's particles"
        return {"eta_particles": Reading("m", what, "surface_point")}
