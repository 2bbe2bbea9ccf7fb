"""Free top without water: energy, angular momentum and attitude of a tumbling block over 100 turns.

No force acts on the block, which spins mainly about its intermediate axis and therefore turns over again and
again. Energy and angular momentum are constants; the attitude is compared with Euler's equations, solved by
`scipy.integrate.solve_ivp`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import jaxsph as js
from experiments.common import Report
from jaxsph.model.mechanism import Mechanism
from jaxsph.output.plot.style import BLUE, RED, in_style

SIDES = (0.3, 0.5, 0.8)
"""Sides of the block, m."""
DENSITY = 700.0
"""Density of the block, kg/m3."""
SPIN = (0.05, 2.0 * np.pi, 0.3)
"""Angular velocity at t = 0, rad/s: one turn per second about the intermediate axis, and a disturbance."""
TURNS = 100
"""Number of turns, one per second."""
STEPS = 200
"""Number of time steps per turn."""


class Tumble(NamedTuple):
    """Motion of the block at the start and after every turn."""

    t: np.ndarray
    """Times `[K]`, s."""
    energy: np.ndarray
    """Kinetic energy `[K]`, J."""
    momentum: np.ndarray
    """Angular momentum `[K, 3]` about the centre of mass, kg m2/s."""
    pose: np.ndarray
    """Poses `[K, 7]`: displacement (m) and unit quaternion."""


def tumble(dtype: Any, turns: int = TURNS) -> Tumble:
    """Free motion of the block in the precision `dtype`, with the time steps of the solver."""
    shape = js.Block((0.0, 0.0, 0.0), SIDES)
    joint = js.SpatialJoint.of(js.SpatialJoint.space.motions, velocity=(0.1, -0.2, 0.0, *SPIN), dtype=dtype)
    body = js.RigidBody.of(shape, (0, 0), joint, density=DENSITY, dtype=dtype)
    mechanism, dt, g = Mechanism((body,)), jnp.asarray(1.0 / STEPS, dtype), jnp.zeros(3, dtype)

    def step(parts, k):
        return mechanism.step(parts, k * dt, dt, g).parts, None

    def turn(parts, k):
        motion = parts[body.name]
        spinning = body.mass_matrix(motion.pose) @ motion.velocity
        found = body.energy(motion, g)[0], spinning[3:], motion.pose
        return jax.lax.scan(step, parts, k)[0], found

    steps = jnp.arange((turns + 1) * STEPS).reshape(-1, STEPS)
    _, found = jax.jit(lambda parts: jax.lax.scan(turn, parts, steps))(mechanism.start(dtype))
    return Tumble(np.arange(turns + 1.0), *(np.asarray(one, float) for one in found))


def exact(t: np.ndarray) -> Rotation:
    """Attitudes of the block at the times t (s), from Euler's equations."""
    a, b, c = SIDES
    inertia = DENSITY * a * b * c / 12.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])

    def rates(_, y):
        spin, q = y[:3], y[3:]  # spin along the axes of the body; q = (x, y, z, w)
        turning = np.append(q[3] * spin + np.cross(q[:3], spin), -q[:3] @ spin)
        return np.concatenate([-np.cross(spin, inertia * spin) / inertia, 0.5 * turning])

    start = [*SPIN, 0.0, 0.0, 0.0, 1.0]
    found = solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, rtol=1e-12, atol=1e-12, method="DOP853")
    return Rotation.from_quat(found.y[3:].T)


def errors(found: Tumble) -> tuple[float, float, np.ndarray]:
    """Largest relative errors of energy and angular momentum (-), and errors (rad) of the attitude."""
    energy = np.abs(found.energy / found.energy[0] - 1.0).max()
    size = np.linalg.norm(found.momentum[0])
    momentum = np.linalg.norm(found.momentum - found.momentum[0], axis=1).max() / size
    attitude = Rotation.from_quat(found.pose[:, [4, 5, 6, 3]])
    return float(energy), float(momentum), (attitude * exact(found.t).inv()).magnitude()


def main() -> None:
    """Lets the block tumble in both precisions and reports the errors."""
    jax.config.update("jax_enable_x64", True)
    with Report("free_top", "Free top without water: a tumbling block") as report:
        kept = {"float64": tumble(jnp.float64), "float32": tumble(jnp.float32)}
        for name, found in kept.items():
            energy, momentum, away = errors(found)
            for what, value in (("energy", energy), ("angular momentum", momentum)):
                check = f"{name}: {what} over {TURNS} turns, largest relative change"
                report.row(check, value, theory=0.0, bar="1e-5", passes=value < 1e-5)
            report.row(f"{name}: attitude after {TURNS} turns, error", float(away[-1]), "rad", theory=0.0)
        report.picture(_picture(kept))


@in_style
def _picture(kept: dict[str, Tumble]) -> Figure:
    """Figure of the errors of energy and attitude over time."""
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (name, found), colour in zip(kept.items(), (BLUE, RED), strict=True):
        left.semilogy(found.t[1:], np.abs(found.energy[1:] / found.energy[0] - 1.0), color=colour, label=name)
        right.semilogy(found.t[1:], errors(found)[2][1:], color=colour)
    left.set(xlabel="t, s", ylabel="relative change of the energy")
    left.legend()
    right.set(xlabel="t, s", ylabel="error of the attitude, rad")
    return figure
