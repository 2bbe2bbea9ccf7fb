"""Runs, sweeps and fields of a snapshot as `xarray` datasets, for analysis and plots in notebooks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # which imports its subpackages on first use
import shapely
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.fields import FAR, linear_fit, vorticity
from jaxsph.errors import FileError
from jaxsph.output.plot.tank import outlines_of
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import SweepFile

if TYPE_CHECKING:
    import xarray


def read(path: str | Path) -> xarray.Dataset:
    """Loads the readings and results of a run, or of the members of a sweep, with their units and names.

    The dataset of a run contains every series over `time` (s), for gauges and sensors also over their
    positions. Its attributes are the results, the notices and the case's text. The run may still be in
    progress. The dataset of a sweep contains results and series over the parameters; a series with the name
    of a result is called `..._series`.
    **Raises** FileError if the file was not written by jaxsph, or if xarray or h5netcdf is missing.
    """
    with wanted("js.read", "xarray and h5netcdf"):
        import h5netcdf  # noqa: F401
        import xarray
    if SweepFile(path).is_one():
        results, series = (
            xarray.load_dataset(path, engine="h5netcdf", group=group) for group in (None, "series")
        )
        both = {name: f"{name}_series" for name in series.data_vars if name in results}
        return results.merge(series.rename(both))
    run = RunFile.open(path)
    series, variables = run.series(), run.variables()
    if "time" not in series:
        raise FileError(f"{path}: the run has no readings yet; read the file after the first snapshot")
    time = {"time": _variable(("time",), series.pop("time"), "s", "time")}
    places = {n: _variable((dim,), at, *words) for n, (dim, at, *words) in run.coordinates().items()}
    found = {}
    for name, values in series.items():
        one = variables[name]
        dims = ("time", one.dim or f"{name}_component")[: values.ndim]
        found[name] = _variable(dims, values, one.units, one.long_name)
    about = {"case": run.case_toml, "jaxsph_version": run.version, "notices": "\n".join(run.notices())}
    return xarray.Dataset(found, time | places, run.results() | about)


def on_grid(
    snapshot: Mapping[str, Any], x: ArrayLike, z: ArrayLike, y: float | None = None
) -> xarray.Dataset:
    """Velocity (m/s), pressure (Pa) and vorticity (1/s) of a snapshot on the points of a grid.

    **Arguments**: `snapshot`: as returned by `RunFile.snapshot`; `x` and `z`: coordinates of the grid, m;
    `y`: position of the grid's plane across a three-dimensional tank, m, by default mid-width of the water.
    Values outside the water are NaN. In two dimensions so are values inside solids, as the run's pictures
    draw the solids, if the run's file gives their outlines; in three dimensions values inside solids thinner
    than about two spacings are interpolated. **Raises** ValueError if there are too few particles for a
    linear fit.
    """
    with wanted("js.on_grid", "xarray"):
        import xarray
    places, u, p = (np.asarray(snapshot[name], np.float64) for name in ("x", "u", "p"))
    x, z = np.atleast_1d(np.asarray(x, np.float64)), np.atleast_1d(np.asarray(z, np.float64))
    points = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    if places.shape[1] == 3:
        middle = 0.5 * (places[:, 1].min() + places[:, 1].max()) if y is None else y
        points = np.insert(points, 1, middle, axis=1)
    particles = scipy.spatial.KDTree(places)
    fit = linear_fit(particles, np.column_stack([u, p]), points)
    spacing = float(np.median(particles.query(places, 2)[0][:, 1]))
    wet = (fit.nearest < FAR * spacing) & ~_in_solids(snapshot, points)
    shown = np.where(wet, 1.0, np.nan)
    fields = {
        "velocity_x": (fit.value[:, 0], "m s-1", "velocity of the water along the tank"),
        "velocity_z": (fit.value[:, u.shape[1] - 1], "m s-1", "velocity of the water upwards"),
        "pressure": (fit.value[:, -1], "Pa", "gauge pressure"),
        "vorticity": (vorticity(fit.gradient[..., :-1]), "s-1", "vorticity, positive clockwise"),
    }
    shape = (len(z), len(x))
    found = {
        n: _variable(("z", "x"), (shown * a).reshape(shape), *words) for n, (a, *words) in fields.items()
    }
    at = {"x": _variable(("x",), x, "m", "along the tank"), "z": _variable(("z",), z, "m", "upwards")}
    return xarray.Dataset(found, at, {"time": float(snapshot["time"])})


def _in_solids(snapshot: Mapping[str, Any], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points `[N, 2]` (m) are inside a solid in the pose of a snapshot; False in three dimensions,
    where outlines are only projections, and for a snapshot without a scene."""
    inside = np.zeros(len(points), bool)
    if points.shape[1] == 2:
        for outline in outlines_of(getattr(snapshot, "scene", {})):
            inside |= shapely.contains_xy(shapely.Polygon(outline.at(snapshot)), points)
    return inside


def _variable(dims, values, units: str, long_name: str):
    return dims, values, {"units": units, "long_name": long_name}


@contextlib.contextmanager
def wanted(what: str, libraries: str) -> Iterator[None]:
    """Context for imports of packages from the extra `analysis`. **Raises** FileError if one is missing."""
    try:
        yield
    except ImportError as error:
        missing = str(error) if error.name is None else f"{error.name} is not installed"
        raise FileError(
            f'{what} needs {libraries}, but {missing}: run pip install "jaxsph[analysis]"'
        ) from None
