"""Processes of one run, on one host or several: how they connect, and their collective operations.

Every process runs the same program on the same case, with slabs on its own devices (`run.devices`). The first
process writes the run's file.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils

from jaxsph.errors import CaseError, SimulationError

AUTO = "auto"
"""Value of `place` if Slurm or MPI provides the index of the process and the address of process 0."""

HEARTBEAT = 20
"""Time without a heartbeat after which a process counts as lost, s."""

WIDTH = 96
"""Length to which the name of a process is truncated or padded, bytes."""


def join(place: str) -> None:
    """Connects this process to the other processes of a run; call it before JAX is first used.

    **Arguments**: `place`: K/N@HOST:PORT, where K is the index of this process (from 0), N the number of
    processes, and HOST:PORT the address of process 0, to which all processes connect; or auto under Slurm or
    MPI. **Raises** CaseError for any other text, or if the other processes are not found.
    """
    known: dict[str, Any] = {}
    if place != AUTO:
        found = re.fullmatch(r"(\d+)/(\d+)@(.+:\d+)", place)
        if found is None or not int(found[1]) < int(found[2]):
            raise CaseError(
                f"process = {place!r}: must be auto (under Slurm or MPI) or K/N@HOST:PORT with K from 0 to "
                "N - 1, such as 0/2@node1:7000 for the first of two processes that connect at port 7000 of "
                "node1"
            )
        known = {
            "process_id": int(found[1]),
            "num_processes": int(found[2]),
            "coordinator_address": found[3],
        }
    try:
        jax.distributed.initialize(**known, heartbeat_timeout_seconds=HEARTBEAT)
    except (ValueError, RuntimeError) as error:
        remedy = (
            "start the run under Slurm or MPI, or give K/N@HOST:PORT"
            if place == AUTO
            else "start all N processes, each with its own K and the same N@HOST:PORT"
        )
        raise CaseError(
            f"process = {place!r}: the processes of the run did not connect ({error}); {remedy}"
        ) from error


class Processes:
    """Processes that share a run: their names, and the index of this process."""

    def __init__(self) -> None:
        """Collects the names of all processes: a collective operation, which every process must call."""
        self.count = jax.process_count()
        self.here = jax.process_index()
        self.names: list[str] = []
        if self.count > 1:
            own = f"{socket.gethostname()}, process id {os.getpid()}".encode()[:WIDTH].ljust(WIDTH)
            every = multihost_utils.process_allgather(np.frombuffer(own, np.uint8))
            self.names = [bytes(name).decode().strip() for name in np.asarray(every)]

    @property
    def is_first(self) -> bool:
        """Whether this process writes the run's file and reports its progress."""
        return self.here == 0

    def any(self, flag: bool) -> bool:
        """Whether the flag is set in any process: a collective operation, which every process must call."""
        if self.count == 1:
            return flag
        return bool(np.any(multihost_utils.process_allgather(np.asarray(flag))))

    @contextlib.contextmanager
    def hearing_of_losses(self, path: Any) -> Iterator[None]:
        """Context in which the loss of another process raises a SimulationError.

        With two processes the error names the lost process; with more, it lists all other processes, one of
        which is lost.

        `path`: file of the run, which keeps the last checkpoint.
        """
        try:
            yield
        except (ValueError, RuntimeError) as error:
            if self.count == 1 or isinstance(error, SimulationError) or not _is_loss(error):
                raise
            others = [f"{k} ({name})" for k, name in enumerate(self.names) if k != self.here]
            lost = f"process {others[0]}" if len(others) == 1 else "one of the processes " + ", ".join(others)
            remedy = "start the run again"
            if path is not None:
                remedy = f"continue from the last checkpoint with jaxsph resume {path}"
            raise SimulationError(
                f"{lost} has ended or cannot be reached, so the shared run cannot continue; {remedy}"
            ) from error


def whole(tree: Any) -> Any:
    """Arrays that every process can read, gathered from arrays that may be split between processes."""

    def read(a):
        if isinstance(a, jax.Array) and not a.is_fully_addressable and not a.is_fully_replicated:
            return multihost_utils.process_allgather(a, tiled=True)
        return a

    return jax.tree.map(read, tree)


def _is_loss(error: Exception) -> bool:
    """Whether an error of JAX means that messages to another process failed."""
    text = str(error)
    return any(word in text for word in ("Gloo", "NCCL", "coordination service", "Connection closed"))
