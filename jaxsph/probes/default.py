"""Default probes of a model, selected according to its parts."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsph.model.interfaces import Model
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State
from jaxsph.probes.energy import EnergyProbe
from jaxsph.probes.noise import NoiseProbe
from jaxsph.probes.parts import PartProbe

__all__ = ["DEFAULT", "default_probes"]


DEFAULT = (EnergyProbe, NoiseProbe, PartProbe)
"""Classes of the default probes."""


def default_probes(model: Model, state: State, sample_dt: float) -> tuple[AbstractProbe, ...]:
    """Default probes: energies relative to `state`, noise, and the readings of the model's parts.

    `sample_dt`: time between samples, s.
    """
    every, dim = jnp.asarray(sample_dt, model.dt.dtype), len(model.g)
    of_parts = [PartProbe.of(part, every, dim) for part in model.parts]
    return (EnergyProbe.over(model, state, every), NoiseProbe(), *(p for p in of_parts if p.describe()))
