"""Processes that share a run: their places, their common results, and the loss of one of them."""

import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxsph.errors import CaseError, SimulationError
from jaxsph.output.run_file import RunFile
from jaxsph.run.processes import Processes, join

COARSE = ("--set", "dx=0.04", "--set", "device.wall_thickness=0.04", "--no-plot")


def begin(command, file, place=None, *options):
    """Starts the process of a coarse OWC, or one of the two processes that share it."""
    where = [] if place is None else ["--process", place]
    return subprocess.Popen(
        [sys.executable, "-m", "jaxsph", *command, "--out", str(file), *COARSE, *where, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def free_address():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{s.getsockname()[1]}"


@pytest.mark.parametrize("place", ["2/2@node1:7000", "0/2", "0@node1:7000", "first"])
def test_a_place_that_is_none_is_refused(place):
    with pytest.raises(CaseError, match=r"must be auto \(under Slurm or MPI\) or K/N@HOST:PORT"):
        join(place)


def test_a_lost_process_is_named():
    """Only errors in messages between processes are taken as the loss of a process."""
    alone = Processes()
    assert (alone.count, alone.is_first, alone.any(True)) == (1, True, True)
    alone.count, alone.names = 3, ["a", "b", "c"]
    lost = r"one of the processes 1 \(b\), 2 \(c\) has ended.*jaxsph resume run.h5"
    with pytest.raises(SimulationError, match=lost), alone.hearing_of_losses("run.h5"):
        raise ValueError("UNKNOWN: Gloo collective permute failed: Connection reset by peer")
    with pytest.raises(ValueError, match="another thing"), alone.hearing_of_losses("run.h5"):
        raise ValueError("another thing")


@pytest.mark.slow
def test_two_processes_are_two_devices(tmp_path):
    """Equal bit for bit, because sums have the same order; only the first process writes."""
    at, end = free_address(), ("--t1", "0.2")
    both = [begin(["run", "owc"], tmp_path / "processes.h5", f"{k}/2@{at}", *end) for k in range(2)]
    alone = begin(["run", "owc"], tmp_path / "devices.h5", None, "--devices", "2", *end)
    said = [process.communicate(timeout=600)[0] for process in (*both, alone)]
    assert [p.returncode for p in (*both, alone)] == [0, 0, 0], said
    assert "recorded in" in said[0]
    assert "recorded in" not in said[1]
    shared, devices = (RunFile.open(tmp_path / f"{name}.h5").series() for name in ("processes", "devices"))
    for name, values in devices.items():
        np.testing.assert_array_equal(shared[name], values)


@pytest.mark.slow
@pytest.mark.parametrize("victim", [0, 1])
def test_a_killed_process_ends_the_other(tmp_path, victim):
    """The other process names the lost one and ends in seconds; the run continues from its file."""
    at, path = free_address(), tmp_path / "run.h5"
    both = [begin(["run", "owc"], path, f"{k}/2@{at}", "--t1", "60") for k in range(2)]
    journal = path.with_name("run.h5.checkpoint")
    while not journal.exists():
        assert all(p.poll() is None for p in both), [p.communicate()[0] for p in both]
        time.sleep(0.5)
    os.kill(both[victim].pid, signal.SIGKILL)
    said = both[1 - victim].communicate(timeout=120)[0]
    assert both[1 - victim].returncode not in (0, None)
    assert f"process {victim} ({socket.gethostname()}, process id {both[victim].pid}) has ended" in said
    assert f"jaxsph resume {path}" in said
    done = RunFile.open(path).series()["time"][-1]
    resumed = subprocess.run(
        [sys.executable, "-m", "jaxsph", "resume", str(path), "--t1", str(done + 0.2), "--no-plot", "-q"],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert resumed.returncode == 0, resumed.stderr
    assert RunFile.open(path).series()["time"][-1] > done + 0.1
