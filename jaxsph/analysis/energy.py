"""Energy budget of a run, computed from its series."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np


def takers(series: Iterable[str], harvested: Collection[str] = ("power_pto",)) -> list[str]:
    """Names of the parts with a series `power_<name>`, except the power take-offs and the paddle. These parts
    remove energy from the water.

    `harvested`: names of the power take-offs' series.
    """
    powers = [name for name in series if name.startswith("power_")]
    return [n.removeprefix("power_") for n in powers if n != "power_paddle" and n not in harvested]


def energy_budget(
    series: dict[str, np.ndarray], harvested: Collection[str] = ("power_pto",)
) -> dict[str, float]:
    """Energies supplied, stored and removed over a whole record, J (J/m in 2-D), by name.

    The keys are `paddle` (work of paddles, driven bodies, relaxation zones and body forces), `stored` (change
    of kinetic, potential and compression energy), `pto` (absorbed by all power take-offs), `<name>` for every
    series `loss_<name>` or other series `power_<name>` (energy removed from the water, for example `viscous`,
    `sponge`, `contact`), `residual` (the imbalance), and `residual_share` (ratio of `residual` to the
    paddle's work or to the largest kinetic energy, whichever is larger). The entry `projection` of an
    incompressible flow is negative if the pressure projection adds energy to the water.

    `harvested`: names of the power take-offs' series. A series `power_<name>` contains means over the
    interval before each sample. A series `loss_<name>` contains values at the samples, and is integrated by
    the trapezoidal rule.
    """
    t = series["time"]
    dt = np.diff(t)

    def work(name: str) -> float:
        return float(np.sum(series[name][1:] * dt)) if name in series else 0.0

    total = series["kinetic"] + series["potential"] + series["compression"]
    budget = {
        "paddle": work("power_paddle"),
        "stored": float(total[-1] - total[0]),
        "pto": sum((work(name) for name in harvested), 0.0),
    }
    losses = [name for name in series if name.startswith("loss_")]
    budget |= {name.removeprefix("loss_"): float(np.trapezoid(series[name], t)) for name in losses}
    budget |= {taker: work(f"power_{taker}") for taker in takers(series, harvested)}
    spent = sum(v for k, v in budget.items() if k != "paddle")
    budget["residual"] = budget["paddle"] - spent
    scale = max(abs(budget["paddle"]), float(np.max(np.abs(series["kinetic"]))), 1e-12)
    budget["residual_share"] = budget["residual"] / scale
    return budget
