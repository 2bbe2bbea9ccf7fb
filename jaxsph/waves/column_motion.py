"""Motion in time of an oscillating water column in waves, in JAX: linear theory of the water, any turbine.

The coordinate is the volume of air that the column has displaced, and its rate the flow q out of the chamber.
The equation is that of `waves.in_time` for forces in pascals: the impedance of the water is that of
`waves.fast_owc`, of which the stiffness rho g / b is a part, and the additions are a loss at the lip and an
additional length of the column. Air and power take-off have the laws with which they act in a run of the
water: characteristic curves, valves and compressible air are possible.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.loop import every_block
from jaxsph.model.air import Air
from jaxsph.model.interfaces import AbstractChamber
from jaxsph.model.meaning import Exchange
from jaxsph.waves.fast_owc import Additions, Incident, WaterSeries
from jaxsph.waves.in_time import Equation, Moving, Timeline

__all__ = ["ColumnMotion", "column_motion"]


class ColumnMotion(NamedTuple):
    """Motion of a water column in waves that have settled, per metre of width.

    In a sea the amplitudes are sqrt(2) times the standard deviations.
    """

    xi: Array
    """Hydrodynamic efficiency (-)."""
    P_owc: Array
    """Mean absorbed power, W/m."""
    P_inc: Array
    """Mean incident power, W/m."""
    P_lost: Array
    """Mean power lost at the lip, W/m."""
    flow: Array
    """Amplitude of the flow of air out of the chamber, m2/s."""
    P_a: Array
    """Amplitude of the air's pressure, Pa."""
    level: Array
    """Amplitude of the column's mean elevation, m."""
    t: Float[Array, " K"]
    """Times, s."""
    flows: Float[Array, " K"]
    """Flow of air out of the chamber, m2/s."""
    pressures: Float[Array, " K"]
    """Gauge pressure of the air, Pa."""


def column_motion(
    water: WaterSeries,
    added: Additions,
    chamber: AbstractChamber,
    waves: Incident,
    lengths: dict[str, Scalar],
    rho0: float,
) -> ColumnMotion:
    """Motion of a column in incident waves; the arguments are those of `fast_owc.fast_response`, with a
    `chamber` in the place of the air."""
    time, g = Timeline.of(waves), water.g
    b, a = ((water.lengths | lengths)[name] for name in ("length", "draught"))
    stiffness = rho0 * g / b

    def response(omega: Scalar) -> tuple[Array, Array]:
        q_R, q_S = water.at(omega, lengths)
        of_pressure = 1j * rho0 * g / (omega * q_R)
        return (of_pressure - 1j * stiffness / omega)[None, None], (of_pressure * q_S)[None]

    def matrix(value: Any) -> Array:
        return jnp.reshape(jnp.asarray(value, jnp.float32), (1, 1))

    lip = jnp.reshape(jnp.asarray(0.5 * rho0 * added.lip / b**2, jnp.float32), 1)
    bare = Equation(matrix(rho0 * added.length * a / b), matrix(0.0), matrix(stiffness), lip, jnp.zeros(()))
    equation = bare.with_memory(response, water.series.ends, time)
    force = time.forces(response)
    useful = [name for name, one in chamber.entries().items() if one.exchange is Exchange.HARVESTED]

    def step(state: tuple[Moving, Air, Array], _: None) -> tuple[tuple[Moving, Air, Array], Any]:
        (at, air, mean), dt = state, time.dt
        given, mass = equation.begin(at, time.drive(force, at.k), dt)
        give = dt / mass[0, 0]
        free = at.v[0] + give * given[0]
        pressed = chamber.press(air, free, give, jnp.zeros(()), time.t(at.k), dt)
        after = free - give * pressed.P_a
        rise = (after - at.v) / dt
        air, taken = chamber.finish(air, pressed, at.v[0], after, dt)[:2]
        harvested = sum((taken[name] for name in useful), jnp.zeros(())) / dt
        mean = mean + time.share(at.k) * jnp.stack([harvested, equation.lost(at, rise, dt)])
        return (at.moved(rise, dt), air, mean), (at.v[0] + 0.5 * dt * rise[0], pressed.P_a, at.middle(dt)[0])

    start = Moving.at_rest(1), chamber.start(jnp.float32), jnp.zeros(2)
    (*_, mean), (q, P_a, volume) = every_block(step, start, time.count)
    P_inc, (P_owc, P_lost) = waves.power(water.depth, rho0, g), mean
    flow, pressure, level = (jnp.abs(time.sizes(one)) for one in (q, P_a, volume / b))
    series = time.times, time.settled(q), time.settled(P_a)
    return ColumnMotion(P_owc / P_inc, P_owc, P_inc, P_lost, flow, pressure, level, *series)
