"""Scatter table: the sea states at a site, and how often they occur."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxsph.case.data_files import read_columns
from jaxsph.errors import CaseError
from jaxsph.study.wave_records import WaveRecord, read_record

HOURS = 8766.0
"""Number of hours in a mean year of 365.25 days."""


@dataclass(frozen=True)
class ScatterTable:
    """Scatter table: sea states at a site, and their shares of the year."""

    Hs: NDArray[np.float64]
    """Significant wave heights, m."""
    Tp: NDArray[np.float64]
    """Peak periods, s."""
    share: NDArray[np.float64]
    """Shares of the year (-), which sum to 1."""
    hours: float | None = None
    """Hours that the table covers, h; None if the table gives shares."""

    @property
    def period(self) -> tuple[str, float]:
        """Words for the time that the table covers, and its hours: those given, or a mean year."""
        return ("year", HOURS) if self.hours is None else (f"{self.hours:,.0f} h of the table", self.hours)

    @property
    def used(self) -> ScatterTable:
        """The table without sea states that do not occur."""
        there = self.share > 0.0
        return dataclasses.replace(self, Hs=self.Hs[there], Tp=self.Tp[there], share=self.share[there])

    def at_scale(self, scale: float) -> ScatterTable:
        """The seas of a model whose lengths are `scale` times smaller, by Froude's law; the hours stay."""
        return dataclasses.replace(self, Hs=self.Hs / scale, Tp=self.Tp / np.sqrt(scale))

    @classmethod
    def of_record(cls, record: WaveRecord, height: float = 0.5, period: float = 1.0) -> ScatterTable:
        """Table of a record of sea states, in classes of `height` (m) and `period` (s).

        Each class has the root mean square of its heights, and the mean period weighted by their squares, so
        that the mean of Hs^2 Tp, and with it the power in deep water, is that of the record. **Raises**
        CaseError if no sea state is known.
        """
        known = (record.Hs > 0.0) & (record.Tp > 0.0)
        Hs, Tp = record.Hs[known], record.Tp[known]
        if not len(Hs):
            raise CaseError("the record has no sea state with both a height and a period")
        classes = np.stack([Hs // height, Tp // period], axis=1)
        _, place, count = np.unique(classes, axis=0, return_inverse=True, return_counts=True)
        energy, moment = (np.bincount(place.ravel(), a) for a in (Hs**2, Hs**2 * Tp))
        return cls(np.sqrt(energy / count), moment / energy, count / len(Hs))

    @classmethod
    def read(cls, path: str | Path) -> ScatterTable:
        """Reads a table from a CSV file with the columns Hs (m), Tp (s), and share (-) or hours (h), or the
        record of a site from a netCDF (.nc) or text file (.txt), see `of_record` and `read_record`.

        **Raises** CaseError for other columns, and for shares that are negative or do not sum to 1.
        """
        if Path(path).suffix.lower() in (".nc", ".txt"):
            return cls.of_record(read_record(path))
        units = {"Hs": "m", "Tp": "s", "share": "-", "hours": "h"}
        found = read_columns(path, units, [{"Hs", "Tp", "share"}, {"Hs", "Tp", "hours"}])
        columns = {name: np.array(values) for name, values in found.items()}
        kind = "share" if "share" in columns else "hours"
        weight = columns[kind]
        if np.any(weight < 0.0) or not np.sum(weight) > 0.0:
            raise CaseError(
                f"{path}: values of {kind} must not be negative, and at least one must be positive"
            )
        if kind == "share" and abs(np.sum(weight) - 1.0) > 1e-3:
            raise CaseError(
                f"{path}: the shares must add up to 1, but add up to {np.sum(weight):.4g}; if the values are "
                "hours, name the column hours"
            )
        hours = float(np.sum(weight)) if kind == "hours" else None
        return cls(columns["Hs"], columns["Tp"], weight / np.sum(weight), hours)

    def check_within(self, Hs: ArrayLike, Tp: ArrayLike) -> None:
        """**Raises** CaseError if a sea state of the table lies outside a matrix over Hs (m) and Tp (s)."""
        used = self.used
        for name, unit, axis, values in (("Hs", "m", Hs, used.Hs), ("Tp", "s", Tp, used.Tp)):
            outside = (values < np.min(axis) - 1e-9) | (values > np.max(axis) + 1e-9)
            if np.any(outside):
                raise CaseError(
                    f"the table has {name} = {values[outside][0]:g} {unit}, but the matrix covers only "
                    f"{np.min(axis):g} to {np.max(axis):g} {unit}: extend the matrix, or remove this sea "
                    "state from the table"
                )
