"""Files of a run: complete after every interruption, exact, and readable by other programs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxsph.errors import FileError, JaxsphError, SimulationError
from jaxsph.output import hdf5, run_file
from jaxsph.output.hdf5 import SCHEMA, Variable
from jaxsph.output.run_file import RunFile
from jaxsph.output.vtk import export_vtkhdf

CASE = 'name = "sample"\ndx = 0.1\n'
GAUGES = {"gauge_x": ("gauge", np.array([1.0, 2.5]), "m", "distance from the paddle")}
VARIABLES = {
    "eta": Variable("m", "surface elevation", "gauge"),
    "P_a": Variable("Pa", "air pressure"),
    "kinetic": Variable("J m-1", "kinetic energy", group="energy"),
}


def _create(folder, **options):
    return RunFile.create(folder / "run.h5", CASE, {"capacity": 60}, GAUGES, **options)


def _snapshot(k, n=6, dim=2):
    rng = np.random.default_rng(k)
    return {
        "time": 0.5 * (k + 1),
        "step": 10 * (k + 1),
        "paddle": 0.01 * k,
        "x": rng.normal(size=(n, dim)).astype(np.float32),
        "u": rng.normal(size=(n, dim)).astype(np.float32),
        "p": rng.normal(size=n).astype(np.float32),
        "id": rng.permutation(n).astype(np.int32),
    }


def _series(k):
    t = 0.5 * k + 0.1 * np.arange(5)
    eta = np.stack([t, -t], 1).astype(np.float32)
    return {"time": t, "eta": eta, "P_a": 2.0 * t, "kinetic": 3.0 * t}


def _append(run, k, snapshot=True, checkpoint=None):
    run.append(
        _series(k),
        VARIABLES,
        _snapshot(k) if snapshot else None,
        checkpoint if checkpoint is not None else {"particles.x": np.full(3, k, np.float32)},
        {"wall_seconds": float(k)},
    )


@pytest.fixture
def run(tmp_path):
    run = _create(tmp_path)
    for k in range(3):
        _append(run, k)
    return run


# --- contents are read back


def test_everything_is_read_back(run):
    run.finish({"xi": 0.5})
    found = RunFile.open(run.path)
    assert found.case_toml == CASE
    assert found.settings == {"capacity": 60}
    assert found.progress() == {"wall_seconds": 2.0}
    assert found.results() == {"xi": 0.5}
    assert found.variables() == VARIABLES | {"time": Variable("s", "time")}
    series = found.series()
    for name in _series(0):
        expected = np.concatenate([_series(k)[name] for k in range(3)])
        assert series[name].dtype == expected.dtype
        np.testing.assert_array_equal(series[name], expected)
    dim, x, units, _ = found.coordinates()["gauge_x"]
    assert (dim, units, x.tolist()) == ("gauge", "m", [1.0, 2.5])


def test_snapshots_are_read_back(run):
    assert run.snapshot_count == 3
    np.testing.assert_array_equal(run.snapshot_times(), [0.5, 1.0, 1.5])
    for i in (0, 2, -1):
        found, expected = run.snapshot(i), _snapshot(i % 3)
        assert found.keys() == expected.keys()
        for name in expected:
            np.testing.assert_array_equal(found[name], expected[name])
    with pytest.raises(IndexError, match="has 3"):
        run.snapshot(3)


def test_new_file_is_empty(tmp_path):
    run = _create(tmp_path)
    assert run.series() == {} and run.checkpoint() == {} and run.snapshot_count == 0


def test_file_does_not_grow_with_its_checkpoints(tmp_path):
    run, big = _create(tmp_path), {"a": np.arange(50_000.0)}
    sizes = []
    for k in range(5):
        _append(run, k, snapshot=False, checkpoint=big)
        sizes.append(run.path.stat().st_size)
    assert sizes[-1] - sizes[0] < big["a"].nbytes  # HDF5 does not free space by itself


@st.composite
def _arrays(draw):
    dtype = draw(st.sampled_from(["f4", "f8", "f2", "i4", "i8", "u4", "u1", "?", "c8", ">f4"]))
    shape = draw(hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.frombuffer(draw(st.binary(min_size=size, max_size=size)), np.uint8)
    if dtype == "?":
        raw = raw % 2
    return raw.view(dtype).reshape(shape) if size else np.zeros(shape, dtype)


@settings(max_examples=25, deadline=None)
@given(first=st.lists(_arrays(), max_size=3), second=st.lists(_arrays(), max_size=3))
def test_checkpoint_is_exact_to_the_bit(tmp_path_factory, first, second):
    run = _create(tmp_path_factory.mktemp("bits"))
    for k, arrays in enumerate((first, second, second)):
        saved = {f"state.leaf.{i}": a for i, a in enumerate(arrays)}
        _append(run, k, snapshot=False, checkpoint=saved)
        found = run.checkpoint()
        assert found.keys() == saved.keys()
        for name, a in saved.items():
            b = found[name]
            assert (b.dtype, b.shape, b.tobytes()) == (a.dtype, a.shape, a.tobytes())


def test_xarray_opens_both_groups(run):
    with xarray.open_dataset(run.path, group="series", engine="h5netcdf") as data:
        assert data.sizes == {"time": 15, "gauge": 2}
        assert data["eta"].dims == ("time", "gauge")
        assert data["eta"].attrs["units"] == "m"
        assert data["eta"].attrs["long_name"] == "surface elevation"
        assert data["time"].attrs["units"] == "s" and data["time"].dtype == float
        np.testing.assert_array_equal(data["eta"].coords["gauge_x"], [1.0, 2.5])
        np.testing.assert_array_equal(data["P_a"], run.series()["P_a"])
    with xarray.open_dataset(run.path, group="energy", engine="h5netcdf") as data:
        assert set(data.data_vars) == {"kinetic"} and data["kinetic"].dims == ("time",)


# --- interruptions


def _chunks(run):
    """Number of chunks in a file; checks that every chunk is complete and as it was appended."""
    found = RunFile.open(run.path)
    series, count = found.series(), found.snapshot_count
    expected = [_series(k) for k in range(count)]
    for name in expected[0]:
        np.testing.assert_array_equal(series[name], np.concatenate([one[name] for one in expected]))
    np.testing.assert_array_equal(found.snapshot_times(), 0.5 * np.arange(1, count + 1))
    np.testing.assert_array_equal(found.snapshot(-1)["u"], _snapshot(count - 1)["u"])
    np.testing.assert_array_equal(found.checkpoint()["particles.x"], np.full(3, count - 1, np.float32))
    assert found.progress() == {"wall_seconds": count - 1.0}
    assert found.variables() == VARIABLES | {"time": Variable("s", "time")}
    return count


def _crash_at(monkeypatch, name, call):
    """Interrupts call number `call` of the function `os.name`, before the call does anything."""
    real, left = getattr(os, name), [call]

    def crash(*arguments):
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(os, name, crash)


@pytest.mark.parametrize("fresh", [True, False])
@pytest.mark.parametrize(
    ("name", "call"), [("replace", n) for n in range(1, 4)] + [("fsync", n) for n in range(1, 8)]
)
def test_crash_while_writing_leaves_whole_chunks(run, monkeypatch, name, call, fresh):
    """Whichever write is interrupted: that of the journal, of the checkpoint or of the file."""
    if fresh:
        run.fold()
    before = _chunks(run)
    _crash_at(monkeypatch, name, call)
    with pytest.raises(KeyboardInterrupt):
        _append(run, before)
        run.finish({"xi": 0.5})
        pytest.skip("fewer calls than that")
    monkeypatch.undo()
    after = _chunks(run)
    assert after in (before, before + 1)
    assert not [file for file in os.listdir(run.path.parent) if file.endswith(".part")]
    _append(RunFile.open(run.path), after)
    assert _chunks(run) == after + 1


def test_crash_while_a_new_file_is_made_leaves_the_old_one(run, monkeypatch):
    _crash_at(monkeypatch, "replace", 1)
    with pytest.raises(KeyboardInterrupt):
        _create(run.path.parent, overwrite=True)
    monkeypatch.undo()
    assert _chunks(run) == 3


def test_end_of_a_run_leaves_one_file(run):
    assert sorted(os.listdir(run.path.parent)) == ["run.h5", "run.h5.checkpoint", "run.h5.journal"]
    run.finish({"xi": 0.5}, ("no reflection",))
    assert os.listdir(run.path.parent) == ["run.h5"] and _chunks(run) == 3
    assert run.notices() == ("no reflection",) and run.results() == {"xi": 0.5}
    _append(run, 3)  # a run that continues after its end
    run.fold()
    assert os.listdir(run.path.parent) == ["run.h5"] and _chunks(run) == 4


def test_journal_of_another_file_is_ignored(run, tmp_path):
    """After a kill between fold and removal, the journal is beside a file that already contains it."""
    left = {path: path.read_bytes() for path in tmp_path.iterdir() if path != run.path}
    run.finish({"xi": 0.5})
    for path, content in left.items():
        path.write_bytes(content)
    assert _chunks(run) == 3
    _append(run, 3)
    assert _chunks(run) == 4


def test_damaged_journal_is_refused_in_words(run):
    path = run.path.with_name("run.h5.journal")
    whole = path.read_bytes()
    path.write_bytes(whole[:-10])
    with pytest.raises(FileError, match="run.h5.journal .*damaged"):
        run.series()
    path.unlink()
    with pytest.raises(FileError, match="checkpoint without its journal"):
        run.checkpoint()


def kill_while_appending(folder, kills):
    """Kills an appending process at random moments, many times; checks the file after each kill."""
    rng = np.random.default_rng(1)
    run = _create(Path(folder))
    start = time.perf_counter()
    for k in range(3):
        _append(run, k)
    most = 2.0 * (time.perf_counter() - start)  # six appends
    counts = []
    for _ in range(kills):
        child = os.fork()
        if child == 0:
            run = RunFile.open(run.path)
            for k in range(run.snapshot_count, 10**6):
                _append(run, k)
                if k % 7 == 0:
                    run.finish({"xi": 0.1 * k})
        time.sleep(rng.uniform(0.0, most))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        counts.append(_chunks(run))
        with xarray.open_dataset(run.path, group="series", engine="h5netcdf") as data:
            assert data["eta"].dims == ("time", "gauge")
            # the file lags the journal, but holds samples
            n = len(data["time"])
            np.testing.assert_array_equal(data["time"], run.series()["time"][:n])
            assert n > 0
    assert counts == sorted(counts)
    print(*counts)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills its own forks")
def test_kill_at_any_moment_leaves_whole_chunks(tmp_path):
    """In a separate process, without JAX's threads, which do not survive a fork."""
    script = f"import test_io; test_io.kill_while_appending({str(tmp_path)!r}, 40)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=Path(__file__).parent, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    counts = [int(count) for count in done.stdout.split()]
    assert len(counts) == 40 and counts[-1] > 10  # chunks were added between the kills


def _seconds(run, first, count=10):
    start = time.perf_counter()
    for k in range(first, first + count):
        _append(run, k)
    return time.perf_counter() - start


def test_append_does_not_slow_down_with_the_length_of_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda handle: None)  # leaves out the disk's own time, which varies
    run = _create(tmp_path)
    _seconds(run, 0)
    early = min(_seconds(run, 10 * k) for k in range(1, 4))
    with monkeypatch.context() as faster:
        faster.setattr(run_file, "SMALL", 0)
        faster.setattr(run_file, "COPIES", 0)
        _seconds(run, 40, 960)
    late = min(_seconds(run, 1000 + 10 * k) for k in range(3))
    # Measured: 0.3 to 1.4 on a shared machine; the ratio would grow with the run if whole files were copied.
    assert late < 1.7 * early


def test_full_disk_is_explained_and_leaves_the_old_file(run, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    before = run.path.read_bytes()
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(FileError, match="No space left.*unchanged"):
        _append(run, 3)
    assert run.path.read_bytes() == before


def test_copies_of_killed_runs_are_removed_when_old(run):
    folder = run.path.parent
    old, new = folder / ".run.h5.1.part", folder / ".run.h5.2.part"
    for part in (old, new):
        part.write_bytes(b"unfinished")
    os.utime(old, (0, 0))
    _append(run, 3)
    assert not old.exists() and new.exists()


def test_two_runs_on_one_file_are_noticed(run):
    with pytest.raises(FileError, match="another run writes"):
        _append(run, 1)


@pytest.mark.parametrize("how", ["replaced", "changed", "ended"])
def test_a_run_does_not_go_on_in_the_file_of_another(run, how):
    """A run remembers the owner of its file, and writes nothing if the owner has changed."""
    if how == "replaced":
        other = _create(run.path.parent, overwrite=True)
        _append(other, 0)
    elif how == "changed":
        other = RunFile.open(run.path)
        other.amend(CASE.replace("0.1", "0.2"), {}, {}, 1.5, {})
    else:
        other = RunFile.open(run.path)
        other.finish({"xi": 0.5})
    before = _everything(run.path)
    for write in (lambda: _append(run, 3), lambda: run.finish({})):
        with pytest.raises(FileError, match="continued by another program"):
            write()
    assert _everything(run.path) == before
    _append(other, 1 if how == "replaced" else 3)


# --- wrong files


def test_existing_file_is_kept(run):
    before = run.path.read_bytes()
    with pytest.raises(FileError, match="--overwrite.*jaxsph resume"):
        _create(run.path.parent)
    assert run.path.read_bytes() == before
    assert _create(run.path.parent, overwrite=True).series() == {}


def test_folders_are_made(tmp_path):
    assert RunFile.create(tmp_path / "a" / "b" / "c.h5", CASE, {}, {}).path.exists()


def test_path_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="could not be written"):
        RunFile.create(tmp_path / "file" / "run.h5", CASE, {}, {})
    with pytest.raises(FileError, match="is a folder"):
        RunFile.create(tmp_path, CASE, {}, {})


def test_missing_file(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        RunFile.open(tmp_path / "no.h5")
    with pytest.raises(FileError, match="is a folder"):
        RunFile.open(tmp_path)


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.3, 0.999])
def test_truncated_file(run, share):
    whole = run.path.read_bytes()
    run.path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(FileError, match="cut short"):
        RunFile.open(run.path)


def test_foreign_files(tmp_path):
    text, other = tmp_path / "notes.h5", tmp_path / "other.h5"
    text.write_text("not this one")
    with pytest.raises(FileError, match="not an HDF5 file"):
        RunFile.open(text)
    with h5py.File(other, "w") as file:
        file["x"] = 1.0
    with pytest.raises(FileError, match="not from jaxsph"):
        RunFile.open(other)


def test_file_of_a_newer_version(run):
    with h5py.File(run.path, "r+") as file:
        file.attrs["schema"] = SCHEMA + 1
    with pytest.raises(FileError, match="newer jaxsph"):
        RunFile.open(run.path)


def test_series_that_do_not_belong_together(run):
    before = run.path.read_bytes()
    for change in (
        {"time": None},
        {"P_a": np.zeros(4)},
        {"eta": np.zeros((5, 3))},
        {"unknown": np.zeros(5)},
    ):
        series = {k: v for k, v in (_series(3) | change).items() if v is not None}
        with pytest.raises(ValueError):
            run.append(series, VARIABLES, None, {}, {})
    with pytest.raises(ValueError, match="slash"):
        _append(run, 3, checkpoint={"a/b": np.zeros(1)})
    assert run.path.read_bytes() == before


def test_errors_carry_their_place():
    error = SimulationError("stopped", step=3, time=0.1, where=(1.0, 2.0))
    assert isinstance(error, JaxsphError)
    assert (error.step, error.time, error.where) == (3, 0.1, (1.0, 2.0))


# --- ParaView


@pytest.mark.parametrize("dim", [2, 3])
def test_vtkhdf_layout(tmp_path, dim):
    run = _create(tmp_path)
    sizes = [6, 6, 4]
    snapshots = [_snapshot(k, n, dim) for k, n in enumerate(sizes)]
    for k, snapshot in enumerate(snapshots):
        run.append(_series(k), VARIABLES, snapshot, {}, {})
    path = export_vtkhdf(run, tmp_path / "out" / "run.vtkhdf")
    with h5py.File(path) as file:
        root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
        assert root.attrs["Version"][0] == 2
        kind = root.attrs.get_id("Type").get_type()
        assert root.attrs["Type"] == b"PolyData" and not kind.is_variable_str()
        assert steps.attrs["NSteps"] == 3
        np.testing.assert_array_equal(steps["Values"], [0.5, 1.0, 1.5])
        np.testing.assert_array_equal(root["NumberOfPoints"], sizes)
        np.testing.assert_array_equal(root["Vertices/NumberOfCells"], sizes)
        assert root["Points"].shape == (sum(sizes), 3)
        assert root["PointData/velocity"].shape == (sum(sizes), 3)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            assert steps[name].shape == (3, 4) and not np.any(steps[name])
        for name in ("Lines", "Polygons", "Strips"):
            assert not np.any(root[name]["NumberOfCells"]) and len(root[name]["Offsets"]) == 1
        assert len(root["Vertices/Offsets"]) == len(root["Vertices/Connectivity"]) + 1
        for i, snapshot in enumerate(snapshots):
            start = steps["PointOffsets"][i]
            order = np.argsort(snapshot["id"])
            rows = slice(start, start + sizes[i])
            x, p, u = (snapshot[name][order] for name in "xpu")
            np.testing.assert_array_equal(root["Points"][rows, :dim], x)
            np.testing.assert_array_equal(root["PointData/pressure"][rows], p)
            np.testing.assert_array_equal(root["PointData/velocity"][rows, :dim], u)
            np.testing.assert_array_equal(root["PointData/id"][rows], np.arange(sizes[i]))
            assert steps["PointDataOffsets/pressure"][i] == start
    export_vtkhdf(run, path)  # again, replacing its own file


def test_export_spares_other_files(run, tmp_path):
    before = run.path.read_bytes()
    with pytest.raises(FileError, match="not an earlier export"):
        export_vtkhdf(run, run.path)
    assert run.path.read_bytes() == before
    empty = RunFile.create(tmp_path / "empty.h5", CASE, {}, {})
    with pytest.raises(FileError, match="no snapshots"):
        export_vtkhdf(empty, tmp_path / "a.vtkhdf")


# --- damage


def _everything(path):
    """All that a run's file gives to its readers, as text."""
    run = RunFile.open(path)
    found = [run.schema, run.version, run.machine, run.case_toml, run.settings]
    found += [
        run.results(),
        run.notices(),
        run.series(),
        run.variables(),
        run.coordinates(),
        run.checkpoint(),
    ]
    found += [
        run.has_checkpoint(),
        run.snapshot_times(),
        [run.snapshot(i) for i in range(run.snapshot_count)],
    ]
    return repr(found)


def misread(path, places, bits, whole):
    """Places and bits that, when flipped, give other contents or an error other than FileError."""
    content, wrong = path.read_bytes(), []
    for place, bit in zip(places, bits, strict=True):
        changed = bytearray(content)
        changed[place] ^= bit
        path.write_bytes(changed)
        try:
            if _everything(path.with_name("run.h5")) != whole:
                wrong.append((place, bit, "other contents"))
        except FileError:
            pass
        except Exception as error:
            wrong.append((place, bit, repr(error)))
    path.write_bytes(content)
    return wrong


@pytest.mark.parametrize("name", ["run.h5", "run.h5.journal", "run.h5.checkpoint"])
@pytest.mark.parametrize("ended", [True, False])
def test_a_flipped_byte_is_never_read_as_a_number(run, name, ended):
    """A checksum covers all that is stored: the contents are right, or FileError is raised."""
    if ended:
        run.finish({"xi": 0.5}, ("no reflection",))
        _append(run, 3)
    whole, rng = _everything(run.path), np.random.default_rng(3)
    path = run.path.with_name(name)
    places = rng.integers(0, path.stat().st_size, 60)
    assert not misread(path, places, rng.integers(1, 256, len(places)), whole)


def test_damage_is_not_sealed_by_the_next_chunk(run):
    """Before a file is changed, its old checksum is verified, so that no damage gets a new checksum."""
    run.fold()
    with h5py.File(run.path, "r+") as file:
        file.attrs["case"] = CASE.replace("0.1", "0.2")
    with pytest.raises(FileError, match="damaged .*another program may have changed the file"):
        _append(run, 3)
    with pytest.raises(FileError, match="damaged"):
        _ = run.case_toml


def test_results_do_not_outlive_the_end_that_they_are_of(run):
    """A run that continues has no results until its new end, with its chunks in the journal or folded."""
    run.finish({"xi": 0.5}, ("no reflection",))
    _append(run, 3)
    assert not run.results() and not run.notices()
    run.fold()
    assert not run.results() and not run.notices()


def test_a_file_is_sealed_once_however_often_it_is_written(run):
    """HDF5 removes the last checksum, and a file that has lost bytes is refused."""
    for k in range(3, 6):
        _append(run, k)
    run.fold()
    content = run.path.read_bytes()
    assert content.count(b"jaxsph CRC-32") == 1
    for lost in (1, 4, 20, 39):
        run.path.write_bytes(content[:-lost])
        with pytest.raises(FileError, match="damaged"):
            run.series()


def test_files_of_older_versions_are_read_without_checksums(run):
    run.fold()
    with h5py.File(run.path, "r+") as file:
        file.attrs["schema"] = 3
    assert _chunks(run) == 3


def test_a_file_that_is_replaced_while_it_is_checked_is_not_taken_for_damaged(tmp_path, monkeypatch):
    """A run in progress replaces its file at every checkpoint."""
    path, other = tmp_path / "run.h5", tmp_path / "next.h5"
    for one, size in ((path, 2), (other, 3)):
        with hdf5.replace_file(one, "w") as file:
            file["values"] = np.arange(size)
    checked = hdf5._crc_of_bytes

    def meanwhile(file, length):
        if other.exists():
            os.replace(other, path)
        return checked(file, length)

    monkeypatch.setattr(hdf5, "_crc_of_bytes", meanwhile)
    with hdf5.open_file(path) as file:
        assert len(file["values"]) == 3
