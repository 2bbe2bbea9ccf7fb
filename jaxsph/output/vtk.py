"""Export of a run's snapshots for ParaView, as one time-dependent VTKHDF file."""

from __future__ import annotations

import contextlib
from pathlib import Path

import h5py
import numpy as np

from jaxsph.errors import FileError
from jaxsph.output.hdf5 import extend, replace_file, tell_write_errors
from jaxsph.output.run_file import RunFile


def export_vtkhdf(run: RunFile, path: str | Path) -> Path:
    """Writes all snapshots as one time-dependent VTKHDF file, which ParaView opens.

    The file holds PolyData with one vertex per particle and the point data `pressure` (Pa), `velocity`
    (m/s, three components) and `id`. Points are in the order of `id`, so point k is the same particle at
    all times. Two-dimensional runs lie in the x-y plane of ParaView's default view, with z written as y.

    **Raises** FileError if the run has no snapshots, or if `path` exists and is not an earlier export.
    """
    path = Path(path)
    count = run.snapshot_count
    if count == 0:
        raise FileError(f"{run.path} has no snapshots yet; continue the run, then export again")
    _check_replaceable(path)
    with tell_write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with replace_file(path, "w", sealed=False) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 2], np.int64)
        # VTK needs a fixed-length string here; h5py writes strings of variable length by default.
        root.attrs.create("Type", np.bytes_("PolyData"))
        sizes = []
        for i in range(count):
            snapshot = run.snapshot(i)
            order = np.argsort(snapshot["id"], kind="stable")
            sizes.append(len(order))
            _append_rows(root, "Points", _three(snapshot["x"][order]))
            _append_rows(root, "PointData/pressure", snapshot["p"][order])
            _append_rows(root, "PointData/velocity", _three(snapshot["u"][order]))
            _append_rows(root, "PointData/id", snapshot["id"][order])
        _write_vertices(root, np.asarray(sizes))
        _write_steps(root, run.snapshot_times(), np.asarray(sizes))
    return path


def _check_replaceable(path: Path) -> None:
    """**Raises** FileError if the file exists and is not an earlier export; only exports are replaced."""
    if not path.exists():
        return
    with contextlib.suppress(OSError), h5py.File(path, "r") as file:
        if "VTKHDF" in file:
            return
    raise FileError(f"{path} exists and is not an earlier export; give another name for the export")


def _three(a: np.ndarray) -> np.ndarray:
    """Array `[N, 2]` or `[N, 3]`, padded with zeros to `[N, 3]`."""
    return np.pad(a, ((0, 0), (0, 3 - a.shape[1])))


def _append_rows(root: h5py.Group, name: str, rows: np.ndarray) -> None:
    if name not in root:
        root.create_dataset(
            name,
            (0, *rows.shape[1:]),
            rows.dtype,
            maxshape=(None, *rows.shape[1:]),
            chunks=(max(1, min(len(rows), 65536)), *rows.shape[1:]),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
    data = root[name]
    assert isinstance(data, h5py.Dataset)
    extend(data, rows)


def _write_vertices(root: h5py.Group, sizes: np.ndarray) -> None:
    """Writes one list of vertices for all steps; a step with n points reads the first n vertices."""
    root["NumberOfPoints"] = sizes
    most = int(sizes.max())
    for kind in ("Vertices", "Lines", "Polygons", "Strips"):
        cells = most if kind == "Vertices" else 0
        group = root.create_group(kind)
        group["NumberOfCells"] = sizes if cells else np.zeros_like(sizes)
        group["NumberOfConnectivityIds"] = sizes if cells else np.zeros_like(sizes)
        group["Connectivity"] = np.arange(cells)
        group["Offsets"] = np.arange(cells + 1)


def _write_steps(root: h5py.Group, times: np.ndarray, sizes: np.ndarray) -> None:
    count = len(times)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = count
    steps["Values"] = times
    steps["PartOffsets"] = np.arange(count)
    steps["NumberOfParts"] = np.ones(count, np.int64)
    steps["PointOffsets"] = starts
    steps["CellOffsets"] = np.zeros((count, 4), np.int64)
    steps["ConnectivityIdOffsets"] = np.zeros((count, 4), np.int64)
    for name in root.require_group("PointData"):
        steps[f"PointDataOffsets/{name}"] = starts
