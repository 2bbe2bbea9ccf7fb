"""Mooring lines in still water: catenaries against MoorPy, and a line of lumped masses against MoorDyn.

A chain of 2.87 m joins an anchor on the bed to a fairlead 2.8 m away and 0.4 m higher, whose motion is
prescribed in the comparison with MoorDyn. The water has no particles: the lines have their weight in water,
drag and added mass. Both programs are in the extra `test`. If one is not installed, the report omits the
comparison with it and notes this.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from jaxsph.model.mechanism import Mechanism
from jaxsph.output.plot.style import BLUE, RED, in_style
from jaxsph.parts.catenary import AbstractCatenary, GroundedCatenary, HangingCatenary
from jaxsph.parts.line import Bed, LumpedLine, Morison
from jaxsph.parts.moorings import FromAnchor, Mooring, QuasiStatic

F64 = jnp.float64
RHO, G = 1000.0, 9.81
DIAMETER, MASS, EA, DAMPING = 0.0036, 0.1214, 2e3, 0.5
"""Diameter (m), mass per length (kg/m), axial stiffness (N) and internal damping (N s) of the chain."""
AREA = 0.25 * np.pi * DIAMETER**2
WEIGHT = (MASS - RHO * AREA) * G
"""Weight per length in water, N/m."""
DRAG, ADDED = (2.4, 1.15), (1.0, 0.0)
"""Coefficients of drag and added mass (-), across and along the chain."""
BED = (3e5, 3e4)
"""Stiffness (Pa/m) and damping (Pa s/m) of the bed."""
SPAN, HEIGHT, LENGTH, SEGMENTS = 2.8, 0.4, 2.87, 20
AMPLITUDE, PERIOD, PERIODS, STEP = 0.05, 1.5, 6, 0.004
"""Amplitude (m) and period (s) of the fairlead's motion, number of periods, and time step of the water
(s)."""
STATIC = {
    "slack on the bed": (GroundedCatenary, 2.4, 0.4, 1e3),
    "partly on the bed": (GroundedCatenary, 2.8, 0.4, 1e3),
    "just lifted off the bed": (GroundedCatenary, 2.5, 1.2, 1e3),
    "sagging": (HangingCatenary, 2.2, 0.3, 1e3),
    "taut": (GroundedCatenary, 2.75, 0.9, 1e3),
    "steep": (GroundedCatenary, 0.5, 2.85, 1e3),
    "nearly vertical": (HangingCatenary, 0.01, 2.86, 1e3),
}
"""Kind, span (m), height (m) and axial stiffness (N) of static lines of the length `LENGTH`."""


def catenary(kind: type[AbstractCatenary], length: float, EA: float) -> AbstractCatenary:
    """A catenary of the chain's weight in float64."""
    return kind(*(jnp.asarray(a, F64) for a in (length, WEIGHT, EA)))


def chain() -> LumpedLine:
    """The chain as lumped masses."""
    across, along = (0.5 * RHO * DIAMETER * one for one in DRAG)
    water = (across, np.pi * along, *(RHO * AREA * one for one in ADDED))
    return LumpedLine(
        at_rest=catenary(GroundedCatenary, LENGTH, EA),
        mass=jnp.asarray(MASS, F64),
        damping=jnp.asarray(DAMPING, F64),
        water=Morison(*(jnp.asarray(a, F64) for a in water)),
        bed=Bed(*(jnp.asarray(a, F64) for a in (0.0, *(DIAMETER * one for one in BED)))),
        segments=SEGMENTS,
    ).stepped(STEP)


def fairlead(t: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m) and velocities (m/s) `[T, 2]` of the fairlead at times t (s), along x (0) or z (1)."""
    w, share = 2.0 * np.pi / PERIOD, np.minimum(t / PERIOD, 1.0)
    moved = AMPLITUDE * share * np.sin(w * t)
    rate = AMPLITUDE * (w * share * np.cos(w * t) + (t < PERIOD) / PERIOD * np.sin(w * t))
    along = np.eye(2)[axis]
    return np.array([SPAN, HEIGHT]) + moved[:, None] * along, rate[:, None] * along


def static_tensions() -> dict[str, tuple[float, float | None]]:
    """Tension (N) at the fairlead of every static line, computed here and by MoorPy (None if MoorPy is not
    installed)."""
    try:
        other = importlib.import_module("moorpy.Catenary").catenary
    except ImportError:
        other = None
    found = {}
    for name, (kind, span, height, EA) in STATIC.items():
        force = catenary(kind, LENGTH, EA).end_forces(jnp.asarray(span), jnp.asarray(height))
        theirs = None
        if other is not None:
            bed = 0.0 if kind is GroundedCatenary else -10.0
            _, _, H, V, _ = other(span, height, LENGTH, EA, WEIGHT, CB=bed, Tol=1e-10, MaxIter=500)
            theirs = float(np.hypot(H, V))
        found[name] = float(jnp.hypot(force.across, force.up)), theirs
    return found


def driven(axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) in the middle of the steps, and tensions (N) at the fairlead of the driven chain."""
    line, n = chain(), round(PERIODS * PERIOD / STEP)
    ends = STEP * np.arange(1, n + 1)
    places, _ = fairlead(ends, axis)
    _, rates = fairlead(ends - 0.5 * STEP, axis)
    dt = jnp.asarray(STEP, F64)

    def step(own, moved):
        end, rate = moved
        # the mean force of the step in which the fairlead arrives at `end`
        force = line.force(own._replace(dt=dt), end - 0.5 * dt * rate, rate, dt)
        return line.advance(own, end, rate, dt, dt), jnp.linalg.norm(force)

    start = line.start(jnp.asarray([SPAN, HEIGHT], F64))
    _, tension = jax.jit(lambda s: jax.lax.scan(step, s, (jnp.asarray(places), jnp.asarray(rates))))(start)
    return ends - 0.5 * STEP, np.asarray(tension)


INPUT = f"""--- MoorDyn ---
--------------------- LINE TYPES ---------------------
TypeName Diam Mass/m EA BA/-zeta EI Cd Ca CdAx CaAx
(name) (m) (kg/m) (N) (N-s/-) (N-m^2) (-) (-) (-) (-)
chain {DIAMETER} {MASS} {EA} {DAMPING} 0 {DRAG[0]} {ADDED[0]} {DRAG[1]} {ADDED[1]}
--------------------- POINTS ---------------------
ID Type X Y Z Mass Volume CdA Ca
(#) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Fixed 0 0 -0.5 0 0 0 0
2 Coupled {SPAN} 0 {HEIGHT - 0.5} 0 0 0 0
--------------------- LINES ---------------------
ID LineType AttachA AttachB UnstrLen NumSegs Outputs
(#) (name) (#) (#) (m) (-) (-)
1 chain 1 2 {LENGTH} {SEGMENTS} -
--------------------- OPTIONS ---------------------
0 writeLog
5e-5 dtM
{BED[0]} kbot
{BED[1]} cbot
{RHO} WtrDnsty
{G} g
0.5 WtrDpth
--------------------- need this line ---------------------
"""


def by_moordyn(axis: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Times (s) and tensions (N) at the fairlead of the driven chain by MoorDyn; None if MoorDyn is not
    installed."""
    try:
        moordyn: Any = importlib.import_module("moordyn")
    except ImportError:
        return None
    times, tensions = STEP * np.arange(round(PERIODS * PERIOD / STEP)), []
    places, rates = fairlead(times, axis)
    with tempfile.TemporaryDirectory() as folder, _quiet():
        path = Path(folder) / "lines.txt"
        path.write_text(INPUT, encoding="utf-8")
        system = moordyn.Create(str(path))
        state = [([x, 0.0, z - 0.5], [u, 0.0, w]) for (x, z), (u, w) in zip(places, rates, strict=True)]
        moordyn.Init(system, *state[0])
        for t, (place, rate) in zip(times, state, strict=True):
            # the force on the fairlead; as here, it includes half the weight of the last segment
            across, _, up = moordyn.Step(system, place, rate, float(t), STEP)
            tensions.append(np.hypot(across, up))
        moordyn.Close(system)
    return times + STEP, np.array(tensions)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Discards the standard output of a library."""
    sys.stdout.flush()
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)


def periods() -> tuple[float, float]:
    """Surge period (s) of a block of 20 kg/m between two moorings, simulated and from the stiffness of the
    moorings."""
    joint = js.PlanarJoint.of(("surge",), velocity=(0.01, 0.0, 0.0), dtype=F64)
    box = js.Block((-0.1, -0.1), (0.1, 0.1))
    block = js.RigidBody.of(box, (0, 0), joint, density=500.0, name="block", dtype=F64)
    line = catenary(GroundedCatenary, LENGTH, EA)
    moorings = tuple(
        Mooring(FromAnchor("block", jnp.zeros(2), jnp.array([x, -HEIGHT])), QuasiStatic(line), name=name)
        for name, x in (("fore", -SPAN), ("aft", SPAN))
    )
    mechanism, dt, n = Mechanism((block,), moorings), jnp.asarray(0.002, F64), 10_000

    def step(parts, k):
        parts = mechanism.step(parts, k * dt, dt, jnp.zeros(2)).parts
        return parts, parts["block"].pose[0]

    _, x = jax.jit(lambda s: jax.lax.scan(step, s, jnp.arange(n)))(mechanism.start(F64))
    x, t = np.asarray(x), float(dt) * np.arange(1, n + 1)
    at = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = t[at] - x[at] * (t[at + 1] - t[at]) / (x[at + 1] - x[at])
    stiffness = 2.0 * float(jax.hessian(line.energy)(jnp.asarray(SPAN), jnp.asarray(HEIGHT)))
    return float(np.mean(np.diff(crossings))), 2.0 * np.pi * float(np.sqrt(20.0 / stiffness))


def slopes() -> float:
    """Largest relative difference between exact and finite-difference slopes of the tension with respect to
    length, weight and EA."""
    worst = 0.0
    for kind, span, height, EA in STATIC.values():

        def tension(values, kind=kind, span=span, height=height):
            force = kind(*values).end_forces(jnp.asarray(span), jnp.asarray(height))
            return jnp.hypot(force.across, force.up)

        at = jnp.asarray([LENGTH, WEIGHT, EA], F64)
        exact, steps = jax.jit(jax.grad(tension))(at), np.diag(1e-5 * np.asarray(at))
        found = jax.jit(jax.vmap(tension))(jnp.concatenate([at + steps, at - steps]))
        apart = (found[:3] - found[3:]) / (2e-5 * np.asarray(at))
        # where a slope is zero, the error is relative to 0.01 times the tension divided by the parameter
        scale = np.abs(apart) + 0.01 * float(tension(at)) / np.asarray(at)
        worst = max(worst, float(np.max(np.abs(exact - apart) / scale)))
    return worst


def main() -> None:
    """Solves and moves the lines in float64."""
    jax.config.update("jax_enable_x64", True)
    with Report("moorings", "Mooring lines in still water, against MoorPy and MoorDyn") as report:
        for name, (here, theirs) in static_tensions().items():
            check = f"catenary, {name}: tension at the fairlead"
            if theirs is None:
                report.row(f"{check} (MoorPy is not installed: no comparison)", here, "N")
                continue
            near = abs(here / theirs - 1.0) < 0.005
            report.row(check, here, "N", theory=theirs, bar="within 0.5 % of MoorPy", passes=near)
        kept = {}
        for axis, name in enumerate(("horizontal", "vertical")):
            (t, here), other = driven(axis), by_moordyn(axis)
            kept[name] = (t, here), other
            _compare(report, f"line, {name} motion", (t, here), other)
        measured, expected = periods()
        off = abs(measured / expected - 1.0)
        check = "period of a block between two catenaries"
        report.row(check, measured, "s", theory=expected, bar="within 2 %", passes=off < 0.02)
        error = slopes()
        check = "exact slopes of the tension with respect to length, weight and EA: largest relative error"
        report.row(check, error, theory=0.0, bar="< 1e-4", passes=error < 1e-4)
        report.picture(_picture(kept))


def _compare(report: Report, check: str, here: tuple, other: tuple | None) -> None:
    """Reports the amplitude of the tension of a driven line over the last periods, and the difference from
    MoorDyn."""
    late = here[0] > 3.0 * PERIOD
    amplitude = 0.5 * np.ptp(here[1][late])
    if other is None:
        report.row(f"{check}: amplitude of the tension (MoorDyn is not installed)", amplitude, "N")
        return
    theirs = np.interp(here[0], *other)
    expected = 0.5 * np.ptp(theirs[late])
    off = float(np.sqrt(np.mean((here[1] - theirs)[late] ** 2)) / expected)
    near = abs(amplitude / expected - 1.0) < 0.03
    what = f"{check}: amplitude of the tension at the fairlead"
    report.row(what, amplitude, "N", theory=expected, bar="within 3 % of MoorDyn", passes=near)
    what = f"{check}: RMS difference of the tension from MoorDyn, over the amplitude"
    report.row(what, 100 * off, "%", theory=0.0, bar="< 3 %", passes=off < 0.03)


@in_style
def _picture(kept: dict[str, tuple]) -> Figure:
    """Figure of the tensions of the driven lines over time."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    for ax, (name, (here, other)) in zip(figure.subplots(1, len(kept)), kept.items(), strict=True):
        ax.plot(*here, color=BLUE, label="here")
        if other is not None:
            ax.plot(*other, "--", color=RED, label="MoorDyn")
        ax.set(xlabel="t, s", ylabel="tension at the fairlead, N", title=f"{name} motion of the fairlead")
        ax.legend()
    return figure
