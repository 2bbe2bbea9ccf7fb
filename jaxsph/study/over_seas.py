"""Slope of the mean power over a year, from slopes in the seas of a scatter table."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from jaxsph.errors import CaseError
from jaxsph.study.base import AbstractMethod, Derivative
from jaxsph.study.ensemble import Ensemble
from jaxsph.study.scatter import ScatterTable


class OverSeas(AbstractMethod):
    """Mean of the slopes in the seas of a scatter table, weighted by the seas' shares of the year.

    The case is run with the significant height and peak period of each sea, and always with the same seed.
    Only the mean power `P_owc` can be averaged over a year; an efficiency belongs to a single sea.
    """

    table: ScatterTable
    """Sea states and their shares of the year."""
    method: AbstractMethod = Ensemble(members=5)
    """Method for the slope in one sea."""
    out: Path | None = None
    """Base path of the output files, one per sea (`STEM_sea00.h5`, ...); None stores no files."""

    def kept(self, path):
        """See `AbstractMethod.kept`."""
        return self if self.out is not None else dataclasses.replace(self, out=Path(path))

    def derivative(self, source, parameter, of, progress):
        """See `AbstractMethod.derivative`."""
        waves = getattr(source, "waves", None)
        if waves is None or waves.kind != "irregular":
            raise CaseError(
                'a scatter table sets waves.Hs and waves.Tp: give a case with waves.kind = "irregular"'
            )
        if of != "P_owc":
            raise CaseError(f"of = {of!r}: over a scatter table it must be 'P_owc', the mean power")
        found: list[tuple[float, Derivative]] = []
        rows = zip(self.table.share, self.table.Hs, self.table.Tp, strict=True)
        for i, (share, Hs, Tp) in enumerate(rows):
            if share > 0.0:
                sea = source.replace({"waves.Hs": float(Hs), "waves.Tp": float(Tp)})
                found.append((share, self._of_sea(i).derivative(sea, parameter, of, progress)))
        errors = [share * (one.error or 0.0) for share, one in found]
        return Derivative(
            parameter,
            of,
            value=sum(share * one.value for share, one in found),
            slope=sum(share * one.slope for share, one in found),
            error=float(np.sqrt(np.sum(np.square(errors)))),
            reach=min(one.reach for _, one in found),
            method=self,
        )

    def _of_sea(self, i: int) -> AbstractMethod:
        """Method for sea number i, with a separate file if files are stored."""
        if self.out is None:
            return self.method
        return self.method.kept(self.out.with_name(f"{self.out.stem}_sea{i:02d}.h5"))
