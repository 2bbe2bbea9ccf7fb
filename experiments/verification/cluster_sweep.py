"""Sweep of eight members on two Dask workers, one of which is killed, against members run one by one."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster

import jaxsph as js
from experiments.common import Report
from jaxsph.errors import FileError
from jaxsph.output.run_file import RunFile


def main(dx: float = 0.04, t1: float = 2.0) -> None:
    """Kills one of two workers once its member has a checkpoint; another worker continues this member."""
    case = js.load_case("owc").replace(
        {"dx": dx, "device.wall_thickness": dx, "t1": t1, "output.snapshot_dt": 0.1}
    )
    over = {"pto.K_dm": [200.0, 400.0, 800.0, 1600.0], "waves.H": [0.03, 0.04]}
    title = f"Sweep of eight runs of the OWC to {t1:g} s by two Dask workers, one of which is killed"
    with tempfile.TemporaryDirectory() as folder, Report("cluster_sweep", title, dx) as report:
        alone = js.sweep(case, over, Path(folder) / "alone.h5", workers=1)
        shared = Path(folder) / "shared.h5"
        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            killed: list[float] = []
            killer = threading.Thread(target=_kill_one, args=(client, shared, killed), daemon=True)
            killer.start()
            both = js.sweep(case, over, shared, executor=client.get_executor(pure=False))
            killer.join()
        same = sum(
            all(np.array_equal(both.members[place][name], values) for name, values in series.items())
            for place, series in alone.members.items()
        )
        ended = len(both.members) - len(both.failures)
        report.row("members without failure", float(ended), bar="8", passes=ended == 8)
        report.row(
            "members equal bit for bit to those of a sweep without Dask",
            float(same),
            bar="8",
            passes=same == 8,
        )
        kept = f"{killed[0]:.2f}" if killed else "no worker was killed"
        report.row("time of the checkpoint of the killed worker's member (s)", kept, passes=bool(killed))


def _kill_one(client: Client, out: Path, killed: list[float]) -> None:
    """Kills the worker of the first member as soon as this member has a checkpoint."""
    run = out.resolve().with_name(f"{out.name}.members") / "0000.h5"
    while not (t := _time(run)):
        time.sleep(0.05)
    # the worker with the first member is the process that started the run of this member
    victims = client.run(lambda: [os.getpid(), _children()])
    for pid, children in victims.values():
        if any(str(run) in command for command in children):
            os.kill(pid, signal.SIGKILL)
            killed.append(t)


def _time(run: Path) -> float:
    """Time of the last checkpoint in a member's file, s; 0 if there is no checkpoint."""
    try:
        times = RunFile.open(run).series().get("time", np.zeros(1))
        return float(times[-1])
    except FileError:
        return 0.0


def _children() -> list[str]:
    """Command lines of the child processes of this process (Linux)."""
    mine = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    pids = " ".join(path.read_text() for path in mine).split()
    return [Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode() for pid in pids]
