"""Joined bodies without water: double pendulum and slider-crank against scipy, and energy balance.

The bodies are advanced by the kicks and drifts of the solver's time step. Lagrange's equations of the same
bodies (`experiments/linkages.py`), with the angles as the only unknowns, are solved by
`scipy.integrate.solve_ivp`. For a body with a prescribed motion, the work of this motion is compared with the
energy gained.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import jaxsph as js
from experiments import linkages
from experiments.common import Report
from jaxsph.model.mechanism import Mechanism
from jaxsph.output.plot.style import BLUE, RED, in_style
from jaxsph.parts.body import RigidBody
from jaxsph.parts.joint import PlanarJoint
from jaxsph.parts.paths import HarmonicPath

F64 = jnp.float64
T1, STEPS = 3.0, 6000
"""Duration of the comparison with scipy, s, and number of its time steps."""
PERIOD, PERIODS = 1.9, 100
"""Period of the double pendulum, s, and number of periods over which its energy is compared."""
Angles = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Times (s), angles of the bodies (rad), and the angles that scipy computes (rad); one row for each body."""


def march(bodies: Sequence[RigidBody], t1: float, n: int, every: int, dtype: Any = F64):
    """Poses by name, energy (J/m) and work of prescribed motions (J/m) after each block of `every` of the n
    steps to t1 (s)."""
    mechanism, dt = Mechanism(bodies), jnp.asarray(t1 / n, dtype)
    g = jnp.asarray([0.0, -linkages.G], dtype)

    def step(carry, k):
        parts, done = carry
        parts, _, given = mechanism.step(parts, k * dt, dt, g)
        return (parts, done + sum(given.values())), None

    def block(carry, k):
        carry, _ = jax.lax.scan(step, carry, k)
        parts, done = carry
        energy = sum(sum(one.energy(parts[one.name], g)) for one in bodies)
        return carry, ({one.name: parts[one.name].pose for one in bodies}, energy, done)

    start = mechanism.start(dtype)
    steps = jnp.arange(n).reshape(-1, every)
    _, found = jax.jit(lambda s: jax.lax.scan(block, (s, jnp.zeros((), dtype)), steps))(start)
    return found


def pendulum() -> Angles:
    """Angles (rad) of the double pendulum's bars from the vertical over time."""
    return _compared(
        linkages.double_pendulum(F64),
        {"upper": 1, "lower": 1},
        linkages.pendulum_equations,
        [*linkages.ANGLES, 0.0, 0.0],
    )


def crank() -> Angles:
    """Angle (rad) of the slider-crank's crank from the x axis, upwards, over time."""
    return _compared(linkages.slider_crank(F64), {"crank": -1}, linkages.crank_equation, [0.0, 0.0])


def _compared(
    bodies: Sequence[RigidBody], signs: dict[str, int], equations: Callable, start: list[float]
) -> Angles:
    poses, *_ = march(bodies, T1, STEPS, 100)
    t = np.linspace(0.0, T1, STEPS // 100 + 1)[1:]
    exact = solve_ivp(equations, (0, T1), start, rtol=1e-10, atol=1e-12, dense_output=True)
    found = np.stack([sign * poses[name][:, 2] for name, sign in signs.items()])
    return t, found, exact.sol(t)[: len(signs)]


def change_of_energy() -> np.ndarray:
    """Change of the double pendulum's energy divided by `linkages.SWING` (-), every second for 100
    periods."""
    seconds = round(PERIODS * PERIOD)
    _, energy, _ = march(linkages.double_pendulum(F64), seconds, 1000 * seconds, 1000)
    return np.asarray(energy - energy[0]) / linkages.SWING


def work_and_gain() -> tuple[np.ndarray, np.ndarray]:
    """Work of a carriage's prescribed motion, and energy gained by the carriage and a bar that hangs from it,
    J/m."""
    given = ([0.2, 0.05, 0.1], 7.0, [0.0, 0.5, 1.0], 0.5)
    path = HarmonicPath(*(jnp.asarray(value, F64) for value in given))
    joints = PlanarJoint.of(path=(path,), dtype=F64), PlanarJoint.of(["pitch"], parent="cart", dtype=F64)
    bodies = (
        linkages.body("cart", js.Block((-0.2, -0.1), (0.2, 0.1)), joints[0], None, F64),
        linkages.body("bob", linkages.hanging(0.0, 0.8), joints[1], (0.0, 0.0), F64),
    )
    _, energy, work = march(bodies, 2.0, 8000, 100)
    return np.asarray(work - work[0]), np.asarray(energy - energy[0])


def main() -> None:
    """Simulates the joined bodies in float64 and reports the errors of their motion and energy."""
    jax.config.update("jax_enable_x64", True)
    with Report("joints", "Joined bodies without water: a double pendulum and a slider-crank") as report:
        kept = {"double pendulum": pendulum(), "slider-crank": crank()}
        for name, (_, found, exact) in kept.items():
            check = f"{name}: largest error of {'an' if len(found) > 1 else 'the'} angle over {T1:g} s"
            off = np.max(np.abs(found - exact))
            report.row(check, off, "rad", theory=0.0, bar="< 1e-4 rad", passes=off < 1e-4)
        change = change_of_energy()
        off = np.max(np.abs(change))
        over = "over the initial potential energy (zero when hanging straight down)"
        check = f"energy of the double pendulum over {PERIODS} periods: largest change, {over}"
        report.row(check, off, theory=0.0, bar="< 1e-5", passes=off < 1e-5)
        work, gained = work_and_gain()
        off = np.max(np.abs(work - gained)) / np.ptp(gained)
        check = "work of a prescribed motion minus the energy gained, over the range of the energy gained"
        report.row(check, 100 * off, "%", theory=0.0, bar="< 0.1 %", passes=off < 1e-3)
        report.picture(_picture(kept, change))


@in_style
def _picture(kept: dict[str, Angles], change: np.ndarray) -> Figure:
    """Figure of the angles over time, and of the change of energy."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    *axes, last = figure.subplots(1, len(kept) + 1)
    for ax, (name, (t, found, exact)) in zip(axes, kept.items(), strict=True):
        for here, theory, colour in zip(found, exact, (BLUE, RED), strict=False):
            ax.plot(t, here, color=colour)
            ax.plot(t, theory, "k.", ms=3)
        ax.set(xlabel="t, s", ylabel="angle, rad", title=f"{name} (dots: scipy)")
    last.plot(np.arange(1, len(change) + 1), 1e6 * change, color=BLUE)
    last.set(xlabel="t, s", ylabel="change / (1e-6 initial value)", title="energy of the double pendulum")
    return figure
