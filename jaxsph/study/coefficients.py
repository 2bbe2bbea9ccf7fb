"""`coefficients`: added mass, damping and excitation of a case's bodies, from runs with prescribed motions
and runs in waves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxsph.analysis.coefficients import (
    MOTIONS,
    Coefficients,
    Mode,
    added_mass_and_damping,
    harmonics,
    incident_at,
    of_means,
    with_spread,
)
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.held import Forcing, check_period, find_modes, forced, in_waves, reference
from jaxsph.case.hydrostatics import at_rest, water_stiffness
from jaxsph.case.linear_radiation import linear_coefficients
from jaxsph.case.sections import ONLY_BODY
from jaxsph.case.speeds import wavenumber
from jaxsph.errors import CaseError, FileError
from jaxsph.model.part import name_of
from jaxsph.output.coefficient_files import AbstractCoefficientFile, file_at
from jaxsph.output.sweep_file import SweepFile
from jaxsph.study.ownership import only_study
from jaxsph.study.sweep import Runner, checked_batch, run_missing

IN_WAVES = "waves"
"""Name of the runs in waves; all other runs have the names of the modes."""


def coefficients(
    case: Case,
    periods: Sequence[float],
    out: str | Path | AbstractCoefficientFile,
    *,
    motions: Mapping[str, Sequence[str]] | Sequence[str] | None = None,
    forcing: Forcing = Forcing(),  # noqa: B008
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
) -> Coefficients:
    """Added mass, damping and excitation of a case's bodies at wave periods (s), per metre of width.

    For every period and every mode (one motion of one body), one run moves the body harmonically in still
    water and holds all other motions. For every period, one further run has regular waves and holds all
    bodies. Joints and links are removed, so that a mode is the motion of a single body in the tank.

    **Arguments**: `out`: a file of coefficients, such as `js.CapytaineFile("buoy.nc")`, or a path that ends
    in .nc (Capytaine's dataset) or .h5 (WEC-Sim's BEMIO). The runs are stored next to it, in
    `<name>_runs.h5`, from which a repeated call continues. `motions`: some of "surge", "heave" and "pitch",
    for all bodies or by body; by default every motion in which a body is free or is carried by another body.
    `forcing`: amplitudes and number of periods. `workers`, `executor`: see `sweep`. The coefficients of a
    failed run are NaN: see `Coefficients.failures`.
    **Raises** CaseError before any run if the case has no such motion or does not resolve a period;
    FileError if a file belongs to another study or cannot be written.
    """
    modes, file = find_modes(case, motions), out if isinstance(out, AbstractCoefficientFile) else file_at(out)
    sources = check_study(case, periods, file, modes, forcing)
    study = _Study(case, modes, np.sort(np.asarray(periods, float))[::-1], forcing)
    batch = checked_batch(workers, None, executor)
    runs = SweepFile(runs_of(file.path).resolve())
    if file.path.exists() and not runs.path.exists():
        raise FileError(
            f"{file.path} exists, but the file of its runs, {runs.path.name}, does not; nothing was changed. "
            f"Give another name for the output, or remove {file.path.name}"
        )
    with only_study(runs.path):
        members, _ = run_missing(
            runs,
            case,
            study.axes,
            tuple(len(values) for values in study.axes.values()),
            sources,
            Runner(batch, workers, executor),
            progress,
            study.about,
        )
    found = study.evaluated([members[i] for i in range(len(sources))], sources)
    file.write(found)
    return found


def runs_of(path: Path) -> Path:
    """Path of the file that holds the runs for a file of coefficients."""
    return path.with_name(f"{path.stem}_runs.h5")


def check_study(
    case: Case,
    periods: Sequence[float],
    out: str | Path | AbstractCoefficientFile,
    modes: tuple[Mode, ...],
    forcing: Forcing,
) -> list[Case]:
    """Cases of all runs of a study (see `coefficients`).

    **Raises** CaseError if the periods are not distinct positive numbers, if the tank is unsuitable for
    a period, if a run is not possible, or if the file format does not allow these modes.
    """
    try:
        found = np.asarray(periods, float)
    except (TypeError, ValueError):  # strings, or nested lists of different lengths
        found = np.zeros(0)
    if found.ndim != 1 or not found.size or not np.all(np.isfinite(found)) or np.any(found <= 0.0):
        raise CaseError(f"periods = {periods!r}: must be a list of at least one positive number, in s")
    if len(np.unique(found)) < found.size:
        raise CaseError(f"periods = {list(periods)}: give each period once")
    for T in found.tolist():
        check_period(case, T)
    study = _Study(case, modes, np.sort(found)[::-1], forcing)
    file = out if isinstance(out, AbstractCoefficientFile) else file_at(out)
    file.check(modes, study.bodies)
    return study.members()


class _Study(NamedTuple):
    """Runs of a study: for every period one run per mode, and one in waves."""

    case: Case
    modes: tuple[Mode, ...]
    periods: NDArray[np.float64]
    forcing: Forcing

    @property
    def axes(self) -> dict[str, NDArray]:
        """Periods (s), and indices of the runs at each period."""
        return {"period": self.periods, "run": np.arange(len(self.modes) + 1)}

    @property
    def about(self) -> dict[str, Any]:
        """Settings of the study that are not part of the case."""
        runs = [f"{mode.motion} of {mode.body}" for mode in self.modes]
        return {"runs": [*runs, IN_WAVES]} | {f"forcing.{k}": v for k, v in asdict(self.forcing).items()}

    @property
    def x(self) -> float:
        """Reference position of the waves, m from the paddle."""
        return reference(self.case, self.modes)

    @property
    def bodies(self) -> dict[str, Any]:
        """Properties at rest of the bodies that have a mode, by name."""
        geometry = Geometry.of(self.case)
        names = dict.fromkeys(mode.body for mode in self.modes)
        return {name: at_rest(self.case, geometry, name, self.x) for name in names}

    def members(self) -> list[Case]:
        """Cases of all runs; the last axis varies fastest. **Raises** CaseError if a case cannot be run."""
        found: list[Case] = []
        for T in map(float, self.periods):
            found += [forced(self.case, mode, T, self.forcing) for mode in self.modes]
            found.append(in_waves(self.case, self.modes, T, self.forcing))
        return found

    def evaluated(self, members: Sequence[Mapping[str, Any]], sources: Sequence[Case]) -> Coefficients:
        """Coefficients from the results of all runs; NaN where a run failed."""
        geometry, n, W = Geometry.of(self.case), len(self.modes), len(self.periods)
        shapes = dict.fromkeys(("A", "A_spread", "B", "B_spread"), (W, n, n)) | dict.fromkeys(
            ("X_spread", "echo"), (W, n)
        )
        found: dict[str, NDArray] = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
        found["X"] = np.full((W, n), np.nan + 0j)
        failures = {}
        for w, T in enumerate(map(float, self.periods)):
            runs = []
            for name, i in zip(self.about["runs"], range(w * (n + 1), (w + 1) * (n + 1)), strict=True):
                runs.append(_Run(members[i]["series"], sources[i].probes.gauges, T, self))
                if members[i]["failure"]:
                    failures[f"{name}, T = {T:g} s"], runs[-1] = members[i]["failure"], None
            self._at_period(T, runs, {name: values[w] for name, values in found.items()})
        return Coefficients(
            2.0 * np.pi / self.periods,
            self.modes,
            **found,
            bodies=self.bodies,
            x=self.x,
            depth=geometry.depth,
            rho=self.case.fluid.rho0,
            g=self.case.g,
            failures=failures,
            name=self.case.name,
            linear=linear_coefficients(self.case, self.modes, 2.0 * np.pi / self.periods, self.x),
        )

    def _at_period(self, T: float, runs: Sequence[_Run | None], found: Mapping[str, NDArray]) -> None:
        """Sets the coefficients `found` of one period T (s) from its `runs`; a failed run is None.

        In a run with prescribed motion, waves that return from the paddle act on bodies as incident waves.
        Their force is computed from the excitation and subtracted.
        """
        *moving, waves = runs
        if waves is not None:
            found["X"][:], found["X_spread"][:] = with_spread(waves.forces() / waves.incident())
        C = water_stiffness(self.case, Geometry.of(self.case), self.modes)
        for j, run in enumerate(moving):
            if run is None:
                continue
            force, moved = run.forces(), run.motion(self.modes[j])
            if waves is not None:
                back = found["X"][:, None] * run.incident()
                force = force - back
                found["echo"][j] = np.mean(np.abs(back[j])) / np.mean(np.abs(force[j] + C[j, j] * moved))
            a, b = added_mass_and_damping(force / moved, 2.0 * np.pi / T, C[:, j])
            found["A"][:, j], found["A_spread"][:, j] = with_spread(a)
            found["B"][:, j], found["B_spread"][:, j] = with_spread(b)


class _Run(NamedTuple):
    """Series of one run of a study, and its complex amplitudes in each averaged period."""

    series: Mapping[str, NDArray]
    gauges: Sequence[float]
    T: float
    study: _Study

    def _harmonics(self, values: NDArray) -> NDArray[np.complex128]:
        """Complex amplitudes `[..., periods]` of a series `[times, ...]`."""
        t = np.asarray(self.series["time"], float)
        rows = np.moveaxis(np.asarray(values, float), 0, -1)
        return harmonics(t, rows, self.T, self.study.forcing.cycles)

    def forces(self) -> NDArray[np.complex128]:
        """Complex amplitudes `[n, periods]` of the water's forces along the modes, N/m or N."""
        found, dt = {}, self.T / round(self.T / (self.series["time"][-1] - self.series["time"][-2]))
        for body in dict.fromkeys(mode.body for mode in self.study.modes):
            means = self._harmonics(self.series[_called("body_force_mean", body)])
            found[body] = of_means(means, 2.0 * np.pi / self.T, dt)
        return np.stack([found[mode.body][MOTIONS.index(mode.motion)] for mode in self.study.modes])

    def motion(self, mode: Mode) -> NDArray[np.complex128]:
        """Complex amplitudes `[periods]` of a prescribed motion, m or rad."""
        return self._harmonics(self.series[_called(mode.motion, mode.body)])

    def incident(self) -> NDArray[np.complex128]:
        """Complex amplitudes `[periods]` of the wave from the paddle at the reference position, m."""
        geometry = Geometry.of(self.study.case)
        k = wavenumber(self.T, geometry.depth, self.study.case.g)
        return incident_at(self._harmonics(self.series["eta"]), self.gauges, k, self.study.x)


def _called(reading: str, body: str) -> str:
    """Name of a reading of a body."""
    return name_of(reading, body, ONLY_BODY)
