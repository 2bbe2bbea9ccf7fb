"""Slope of the mean power over a year: the seas of a scatter table, each by another method."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from jaxsph.errors import CaseError
from jaxsph.study.base import AbstractMethod, Derivative
from jaxsph.study.ensemble import Ensemble
from jaxsph.study.matrix import ScatterTable


class OverSeas(AbstractMethod):
    """Mean over a scatter table of the slopes in its seas, each with the weight of its share of the year.

    The case's irregular waves get every sea's height and period; its seed stays. Only the mean power
    `P_owc` has a meaning over a year: an efficiency is one of each sea.
    """

    table: ScatterTable
    """Sea states and their shares."""
    method: AbstractMethod = Ensemble(members=5)
    """Method for the slope in one sea."""
    out: Path | None = None
    """Path from which the files of the seas are named; None keeps none."""

    def kept(self, path):
        """See `AbstractMethod`."""
        return self if self.out is not None else dataclasses.replace(self, out=Path(path))

    def derivative(self, source, parameter, of, progress):
        """See `AbstractMethod`."""
        waves = getattr(source, "waves", None)
        if waves is None or waves.kind != "irregular":
            raise CaseError('a scatter table needs waves.kind = "irregular", whose Hs and Tp it gives')
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
        """Method for sea number i, with a file of its own where files are kept."""
        if self.out is None:
            return self.method
        return self.method.kept(self.out.with_name(f"{self.out.stem}_sea{i:02d}.h5"))
