"""Water at rest beside a wall one spacing thick, with and without the background pressure (`Background`).

The incompressible scheme has no background pressure. With this scheme water beside a wall one spacing thick
keeps moving, and water beside a wall as thick as the support of the kernel is at rest.
"""

from __future__ import annotations

import equinox as eqx
import jax

import jaxsph as js
from experiments.common import Report


def main(dx: float = 0.02, t1: float = 4.0) -> None:
    """Reports the largest speed after a quarter, half and all of t1 (s), without viscosity."""
    case = at_rest(dx)
    title = f"Inviscid water at rest beside a thin wall for {t1:g} s"
    with Report("thin_wall", title, dx) as report:
        for label, background in (
            ("with the background pressure", True),
            ("without the background pressure", False),
        ):
            model, state = js.build(case)
            if not background:
                model = eqx.tree_at(lambda m: m.scheme.background, model, ())
            speeds = list(_speeds(model, state, t1))
            for part, index in (
                ("after a quarter of the time", len(speeds) // 4),
                ("after half of the time", len(speeds) // 2),
                ("at the end", -1),
            ):
                last = background and index == -1
                report.row(
                    f"{label}: largest speed {part}",
                    speeds[index],
                    "m/s",
                    theory=0.0,
                    bar="< 0.01 m/s" if last else "",
                    passes=speeds[index] < 0.01 if last else None,
                )

        for spacings in (1, 5):
            *_, speed = _speeds(*js.build(at_rest(dx, "incompressible", spacings)), t1)
            what = f"incompressible, wall {spacings} dx thick: largest speed at the end"
            report.row(what, speed, "m/s", theory=0.0)


def at_rest(dx: float, kind: str = "weakly_compressible", spacings: int = 1) -> js.Case:
    """Two vessels of inviscid water at rest with the scheme `kind` and a plate `spacings` spacings thick."""
    return js.load_case("vessel").replace(
        {
            "scheme.kind": kind,
            "dx": dx,
            "tank.length": 0.64 + spacings * dx,
            "device.wall_thickness": spacings * dx,
            "device.draught": 0.32,
            "pto": None,
            "fluid.nu": 0.0,
        }
    )


def _speeds(model: js.Model, state: js.State, t1: float):
    """Largest speed (m/s) about every 0.05 s, until the first failure."""
    every = model.search.rebuild_every
    chunk = max(1, round(0.05 / float(model.dt) / every)) * every
    advance = jax.jit(lambda m, s: js.simulate(m, s, n_steps=chunk, sample_every=chunk)[0])
    for _ in range(round(t1 / (chunk * float(model.dt)))):
        state = advance(model, state)
        if int(state.status.bits):
            return
        yield float((state.particles.u**2).sum(axis=1).max()) ** 0.5
