"""Members of a sweep: runs in processes of their own, here or wherever an executor takes them.

All that a member has done lies in the sweep's folder, so whoever takes it up next goes on from its last
checkpoint. Two rules keep a member from being run twice at a time when a worker, or the sweep itself, was
lost: its process ends when the worker that started it does, and a worker gives up a member that another has
claimed.
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
from jaxsph.study.ownership import refuse_other

FORWARD_FLAGS = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true"
"""Flags of the compiler (XLA) for members: a step takes 0.83 of its time. With them a checkpointed reverse
pass cannot be compiled, so they are no default of the package; a member only runs forward."""


LOOK = 0.5
"""Time between two looks of a worker at a member's process and claim, s."""


GRACE = 4 * LOOK
"""Time in which a worker that has lost its claim ends its process, s; the new one waits for so long."""


Ended = tuple[dict[str, Any], Meanings]
"""Results, series and failure of a member that has ended, and the meanings of series and results."""


def check_members(sources: Sequence[Source], folder: Path) -> None:
    """**Raises** FileError where the folder holds a member that is not of these."""
    for run in sorted(folder.glob("[0-9]*.h5")):
        i = int(run.stem) if run.stem.isdecimal() else len(sources)
        if i < len(sources):
            _stage(run, sources[i])
        else:
            raise FileError(
                f"{run}: is a member of another sweep, and nothing was changed; give another name for the "
                f"output, or remove {folder}"
            )


def run_each(sources: Mapping[int, Source], folder: Path, executor: Executor) -> Iterator[tuple[int, Ended]]:
    """Members as they end, each a job of the executor; all that it does lies in the folder.

    The executor may be of any kind with `submit` of `concurrent.futures`. A job that is lost for good counts
    as a member that failed. Where the iteration is given up, members that run stop within a second.
    """
    jobs = {executor.submit(run_member, one, folder / f"{i:04d}"): i for i, one in sources.items()}
    try:
        for job in as_completed(jobs):
            try:
                ended = job.result()
            except Exception as error:  # of the executor, such as a worker lost again and again
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
    """Members as they end, up to `size` of them side by side in this process."""
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
"""Core on which this thread runs its members, as `core`; a thread that is not of `one_per_core` has none."""


def one_per_core(workers: int | None) -> Executor:
    """Threads of this process that run members, each on a core of its own; by default one for every core."""
    here = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    workers = workers or len(here)
    cores: SimpleQueue[int] = SimpleQueue()
    for k in range(workers):
        cores.put(here[k % len(here)])

    def take_core() -> None:
        _thread.core = cores.get()

    return ThreadPoolExecutor(workers, initializer=take_core)


def run_member(source: Source, stem: Path) -> Ended:
    """Runs, or finishes, one member in a process of its own; its files have the path `stem` and a suffix.

    **Raises** FileError where this machine does not see the folder, where another worker has claimed the
    member, or where its file is of another problem.
    """
    if not stem.parent.is_dir():
        raise FileError(
            f"{stem.parent}: the worker on {socket.gethostname()} sees no such folder; give the sweep an "
            "output on a disk that all its workers share"
        )
    run, log = (stem.with_suffix(suffix) for suffix in (".h5", ".log"))
    status = 0
    with _claim(stem.with_suffix(".owner")) as claim:
        # only now: a worker that had it before may have taken it on, or to its end
        begun, ended = _stage(run, source)
        if not ended:
            what = _on(source, run) if begun else _anew(source, run)
            command = [sys.executable, "-m", "jaxsph", *what, "--devices", "1"]
            command += ["--quiet", "--no-plot"]
            status = _run_process(command, log, claim)
    found, variables = _read(run)
    if status:
        found["results"] = {}
        found["failure"] = log.read_text(encoding="utf-8").strip() or f"ended with status {status}"
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
    """Arguments of the command that goes on with a member: with its own end, whatever that of the file is."""
    if isinstance(source, Program):
        return ["resume", run, "--program", source.place]
    return ["resume", run, "--t1", repr(source.value("t1"))]


class _Claim:
    """Mark of the worker that runs a member, in a file which the next worker's mark takes the place of."""

    def __init__(self, path: Path) -> None:
        self._path, self._mark = path, uuid.uuid4().hex

    def make(self) -> None:
        """Claims the member, and waits until a worker that had it has given it up."""
        taken_over = self._path.exists()
        part = self._path.with_name(f".{self._path.name}.{self._mark}")
        part.write_text(self._mark, encoding="utf-8")
        os.replace(part, self._path)
        if taken_over:
            time.sleep(GRACE)

    def holds(self) -> bool:
        """Whether the member is this worker's still: no other has claimed it, and the sweep goes on."""
        try:
            return self._path.read_text(encoding="utf-8") == self._mark
        except FileNotFoundError:
            return False


@contextlib.contextmanager
def _claim(path: Path) -> Iterator[_Claim]:
    """Context in which a member is this worker's. **Raises** FileError where another has claimed it."""
    claim = _Claim(path)
    claim.make()
    yield claim
    if not claim.holds():
        raise FileError(
            f"{path.with_suffix('')}: was given up, for another worker has it or the sweep has ended"
        )
    path.unlink(missing_ok=True)


def _run_process(command: list[Any], log: Path, claim: _Claim) -> int:
    """Runs a command for as long as the claim holds, its messages going to a file; returns its status."""
    environment = {"XLA_FLAGS": FORWARD_FLAGS} | os.environ | {ATTACHED: "1"}
    with (
        log.open("w") as messages,
        # the pipe closes when this process ends, in whatever way, and the child ends with it
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=messages, stderr=messages, env=environment
        ) as child,
    ):
        core = getattr(_thread, "core", None)
        if core is not None and hasattr(os, "sched_setaffinity"):
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(child.pid, {core})  # before it starts threads of its own
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
    """Whether a member has a checkpoint to go on from, and whether it has ended: a sweep that was stopped
    before it recorded such a member has nothing left to run.

    **Raises** FileError where the file is of another problem.
    """
    try:
        file = RunFile.open(run)
        text, stage = file.case_toml, (file.has_checkpoint(), bool(file.results()))
    except FileError:  # missing or damaged: the member is run anew
        return False, False
    try:
        stored = stored_identity(run, text, file.version)
    except FileError:  # of another version of jaxsph
        stored = {}
    refuse_other(run, "a member of another sweep", stored, identity(source.to_toml()), run.parent)
    return stage
