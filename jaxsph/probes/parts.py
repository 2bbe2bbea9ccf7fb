"""Probe of any part of a model: the part's readings, and the power of its power take-off."""

from __future__ import annotations

import equinox as eqx

from jaxsph.core.arrays import Scalar, columns
from jaxsph.model.meaning import Reading
from jaxsph.model.part import AbstractPart, Sampled
from jaxsph.model.probe import AbstractProbe
from jaxsph.probes.energy import per_metre

__all__ = ["PartProbe"]


class PartProbe(AbstractProbe):
    """Probe of a part, for example a chamber or a body: its readings, and the power that its PTO absorbs."""

    sample_dt: Scalar
    """Time between samples, s."""
    part: str = eqx.field(static=True)
    """Name of the part in the model."""
    meanings: tuple[tuple[str, Reading], ...] = eqx.field(static=True)
    """Names and meanings of the part's readings."""
    harvest: tuple[str, ...] = eqx.field(static=True)
    """Ledger names of the energies that the part's power take-off absorbs."""
    dim: int = eqx.field(static=True)
    """Number of dimensions."""

    @classmethod
    def of(cls, part: AbstractPart, sample_dt: Scalar, dim: int) -> PartProbe:
        """Builds the probe of a part, for samples `sample_dt` (s) apart in `dim` dimensions."""
        return cls(sample_dt, part.name, tuple(part.readings(dim).items()), part.harvest(), dim)

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        del tables
        part = next(part for part in model.parts if part.name == self.part)
        p, scheme = state.particles, model.scheme
        sampled = Sampled(columns(p.x), scheme.volume(p), scheme.rho0, model.dx, self.sample_dt, state.parts)
        powers = {f"power_{name}": state.ledger[name].recent / self.sample_dt for name in self.harvest}
        return {**part.read(state.parts.get(part.name), sampled), **powers}

    def describe(self):
        """See `AbstractProbe.describe`."""
        what = "power absorbed by the PTO, mean since the last sample"
        power = Reading(per_metre("W", self.dim), what)
        return {**dict(self.meanings), **{f"power_{name}": power for name in self.harvest}}
