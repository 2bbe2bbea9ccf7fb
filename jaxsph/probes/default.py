"""Default probes of a model, which follow from its parts."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsph.model.interfaces import AbstractChamber, Model
from jaxsph.model.meaning import Exchange
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.solids import AbstractBody
from jaxsph.model.state import State
from jaxsph.parts.paddle import Paddle
from jaxsph.parts.rim import Rim
from jaxsph.probes.devices import BodyProbe, ChamberProbe, PaddleProbe, RimProbe
from jaxsph.probes.energy import EnergyProbe
from jaxsph.probes.noise import NoiseProbe

__all__ = ["default_probes"]


def default_probes(model: Model, state: State, sample_dt: float) -> tuple[AbstractProbe, ...]:
    """Probes of a model's energies, noise, paddles, chambers and bodies; energies count from `state`.

    `sample_dt`: time between samples, s. What follows "chamber" or "body" in a part's name ends the names of
    its readings.
    """
    every, dim = jnp.asarray(sample_dt, model.dt.dtype), len(model.g)
    found: list[AbstractProbe] = [EnergyProbe.over(model, state, every), NoiseProbe()]
    found += [PaddleProbe(wall.name) for wall in model.moving if isinstance(wall, Paddle)]
    for k, chamber in enumerate(model.chambers):
        suffix, further = chamber.name.removeprefix("chamber"), tuple(chamber.readings(dim).items())
        found.append(ChamberProbe(every, k, suffix, further, _harvest(chamber), dim))
    for k, body in enumerate(model.bodies):
        suffix = body.name.removeprefix("body")
        found.append(BodyProbe(every, k, suffix, dim, _harvest(body)))
    found += [RimProbe(rim.name, dim) for rim in model.outlets if isinstance(rim, Rim)]
    return tuple(found)


def _harvest(part: AbstractBody | AbstractChamber) -> tuple[str, ...]:
    """Names in the ledger of the energies that a part's power take-off takes."""
    return tuple(name for name, entry in part.entries().items() if entry.exchange is Exchange.HARVESTED)
