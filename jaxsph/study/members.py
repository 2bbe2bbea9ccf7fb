"""Members of a sweep, run in batches or in separate processes, on this machine or by an executor.

All files of a member are in the sweep's folder, so that another worker can continue the member from the
member's last checkpoint. Two rules prevent a member from running in two processes at once after a worker, or
the sweep itself, was lost. The member's process ends together with the worker that started it, and a worker
gives up a member that another worker has claimed.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from jaxsph.errors import FileError, JaxsphError
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings
from jaxsph.problem.program import Program
from jaxsph.problem.source import Source, identity
from jaxsph.problem.toml import toml_value
from jaxsph.run.interrupt import ATTACHED
from jaxsph.run.stored import stored_identity
from jaxsph.run.together import run_together, shape
from jaxsph.study.failures import failure_of
from jaxsph.study.ownership import refuse_other

LOOK = 0.5
"""Interval at which a worker checks a member's process and claim, s."""


GRACE = 4 * LOOK
"""Time within which a worker that has lost its claim ends its process, s; the new worker waits this long."""


Ended = tuple[dict[str, Any], Meanings]
"""Results, series and failure of a member that has ended, and the meanings of series and results."""


def check_members(sources: Sequence[Source], folder: Path) -> None:
    """**Raises** FileError if the folder holds a member that does not belong to these sources."""
    for run in sorted(folder.glob("[0-9]*.h5")):
        i = int(run.stem) if run.stem.isdecimal() else len(sources)
        if i < len(sources):
            _stage(run, sources[i])
        else:
            raise FileError(
                f"{run} is a member of another sweep, and nothing was changed; give another name for the "
                f"output, or remove {folder}"
            )


def run_each(sources: Mapping[int, Source], folder: Path, executor: Executor) -> Iterator[tuple[int, Ended]]:
    """Runs each member as a job of the executor, with its files in the folder; yields members as they end.

    Any executor with the `submit` of `concurrent.futures` can be used. A job that is lost for good counts as
    a failed member. If the iteration is abandoned, running members stop within a second.
    """
    jobs = {executor.submit(run_member, one, folder / f"{i:04d}"): i for i, one in sources.items()}
    try:
        for job in as_completed(jobs):
            try:
                ended = job.result()
            except Exception as error:  # errors of the executor, for example if a worker was lost repeatedly
                text = f"{type(error).__name__}: {error}"
                ended = {"results": {}, "series": {}, "failure": text}, Meanings()
            yield jobs[job], ended
    finally:
        for job in jobs:
            job.cancel()
        for claim in folder.glob("*.owner"):
            claim.unlink(missing_ok=True)


def run_in_batches(
    sources: Mapping[int, Source], folder: Path, size: int, progress: bool
) -> Iterator[tuple[int, Ended]]:
    """Runs members in this process, up to `size` of them in one call; yields members as they end."""
    runs = {i: folder / f"{i:04d}.h5" for i in sources}
    alike: dict[Any, list[int]] = {}
    for i, member in sources.items():
        if _stage(runs[i], member)[1]:
            yield i, _read(runs[i])
        else:
            alike.setdefault(shape(member), []).append(i)
    for batch in (group[k : k + size] for group in alike.values() for k in range(0, len(group), size)):
        given = run_together([sources[i] for i in batch], [runs[i] for i in batch], progress)
        for i, one in zip(batch, given, strict=True):
            found, variables = _read(runs[i])
            if isinstance(one, JaxsphError):
                found |= {"results": {}, "failure": str(one)}
            yield i, (found, variables)


# --------------------------------------------------------------------------- one member

_thread = threading.local()
"""Attribute `core`: core on which this thread runs its members, set only in threads of `one_per_core`."""


def one_per_core(workers: int | None) -> Executor:
    """Executor whose threads run members, each thread on its own core; by default one thread per core."""
    here = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    workers = workers or len(here)
    cores: SimpleQueue[int] = SimpleQueue()
    for k in range(workers):
        cores.put(here[k % len(here)])

    def take_core() -> None:
        _thread.core = cores.get()

    return ThreadPoolExecutor(workers, initializer=take_core)


def run_member(source: Source, stem: Path) -> Ended:
    """Runs or continues one member in its own process; the paths of its files are `stem` with a suffix.

    **Raises** FileError if this machine cannot see the folder, if another worker has claimed the member, or
    if the member's file belongs to another problem.
    """
    if not stem.parent.is_dir():
        raise FileError(
            f"{stem.parent}: the worker on {socket.gethostname()} cannot see this folder; give the sweep an "
            "output on a disk that all workers share"
        )
    run, log = (stem.with_suffix(suffix) for suffix in (".h5", ".log"))
    status = 0
    with _claim(stem.with_suffix(".owner")) as claim:
        # read the stage after the claim, because the previous worker may have continued or ended the member
        begun, ended = _stage(run, source)
        if not ended:
            what = _on(source, run) if begun else _anew(source, run)
            command = [sys.executable, "-m", "jaxsph", *what, "--devices", "1"]
            command += ["--quiet", "--no-plot"]
            status = _run_process(command, log, claim)
    found, variables = _read(run)
    if status:
        found["results"] = {}
        found["failure"] = failure_of(log.read_text(encoding="utf-8", errors="replace"), status)
    return found, variables


def _anew(source: Source, run: Path) -> list[Any]:
    """Arguments of the command that runs a member from its start."""
    if isinstance(source, Program):
        values = [
            part
            for key, value in source.arguments.items()
            for part in ("--set", f"{key}={toml_value(value)}")
        ]
        return ["run", source.place, *values, "--out", run, "--overwrite"]
    toml = run.with_suffix(".toml")
    toml.write_text(source.to_toml(), encoding="utf-8")
    return ["run", toml, "--out", run, "--overwrite"]


def _on(source: Source, run: Path) -> list[Any]:
    """Arguments of the command that continues a member to the `t1` of its source, not of its file."""
    if isinstance(source, Program):
        return ["resume", run, "--program", source.place]
    return ["resume", run, "--t1", repr(source.value("t1"))]


class _Claim:
    """Claim on a member: a file with the mark of the member's worker, which the next worker overwrites."""

    def __init__(self, path: Path) -> None:
        self._path, self._mark = path, uuid.uuid4().hex

    def make(self) -> None:
        """Claims the member, and waits until a previous worker has given it up."""
        taken_over = self._path.exists()
        part = self._path.with_name(f".{self._path.name}.{self._mark}")
        part.write_text(self._mark, encoding="utf-8")
        os.replace(part, self._path)
        if taken_over:
            time.sleep(GRACE)

    def holds(self) -> bool:
        """Whether the claim holds: no other worker has claimed the member, and the sweep has not ended."""
        try:
            return self._path.read_text(encoding="utf-8") == self._mark
        except FileNotFoundError:
            return False


@contextlib.contextmanager
def _claim(path: Path) -> Iterator[_Claim]:
    """Context in which this worker claims a member. **Raises** FileError if the claim is lost."""
    claim = _Claim(path)
    claim.make()
    yield claim
    if not claim.holds():
        raise FileError(
            f"{path.with_suffix('')}: this member was abandoned, because another worker claimed it or "
            "the sweep ended"
        )
    path.unlink(missing_ok=True)


def _run_process(command: list[Any], log: Path, claim: _Claim) -> int:
    """Runs a command while the claim holds, with its output in the file `log`; returns the exit status."""
    environment = os.environ | {ATTACHED: "1"}
    with (
        log.open("w") as messages,
        # the pipe closes when this process ends, for whatever reason, and then the child ends too
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=messages, stderr=messages, env=environment
        ) as child,
    ):
        core = getattr(_thread, "core", None)
        if core is not None and hasattr(os, "sched_setaffinity"):
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(child.pid, {core})  # before the child starts threads
        while child.poll() is None:
            if not claim.holds():
                child.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(LOOK)
        return child.returncode


def _read(run: Path) -> Ended:
    """Results, series and failure in a member's file, and the meaning of each series."""
    try:
        file = RunFile.open(run)
        found = {"results": file.results(), "series": file.series(), "failure": ""}
        return found, Meanings(file.variables(), file.labels())
    except JaxsphError:
        return {"results": {}, "series": {}, "failure": ""}, Meanings()


def _stage(run: Path, source: Source) -> tuple[bool, bool]:
    """Whether a member has a checkpoint to continue from, and whether it has ended.

    An ended member still has its file if the sweep stopped before recording the member. **Raises** FileError
    if the member's file belongs to another problem.
    """
    try:
        file = RunFile.open(run)
        text, stage = file.case_toml, (file.has_checkpoint(), bool(file.results()))
    except FileError:  # missing or damaged: the member is run from the start
        return False, False
    try:
        stored = stored_identity(run, text, file.version)
    except FileError:  # written by another version of jaxsph
        stored = {}
    refuse_other(run, "a member of another sweep", stored, identity(source.to_toml()), run.parent)
    return stage
