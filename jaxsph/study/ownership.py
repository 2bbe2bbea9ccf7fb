"""Ownership of a study's files: only one process writes to an output, and files of another study are
refused."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from jaxsph.errors import FileError
from jaxsph.output.hdf5 import tell_write_errors

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None

_FEW = 5
"""Largest number of differences that an error message lists."""

_held: set[Path] = set()
_guard = threading.Lock()
"""Lock of `_held`, the outputs of this process's studies; a file lock does not exclude a second study in the
same process."""


def refuse_other(
    path: Path, what: str, stored: Mapping[str, Any], given: Mapping[str, Any], remove: Path | None = None
) -> None:
    """**Raises** FileError, naming what differs, if the study stored at a path differs from the given study.

    `what`: the stored study in words; `remove`: path that the message suggests removing, by default `path`.
    """
    differing = [
        f"{name} ({_shown(stored, name)} there, {_shown(given, name)} here)"
        for name in sorted({*stored, *given})
        if name not in stored or name not in given or stored[name] != given[name]
    ]
    if differing:
        few = ", ".join(differing[:_FEW])
        more = f" and {len(differing) - _FEW} more" if len(differing) > _FEW else ""
        raise FileError(
            f"{path} contains {what}, and nothing was changed. The studies differ in {few}{more}: give "
            f"another name for the output, or remove {remove or path}"
        )


def _shown(values: Mapping[str, Any], name: str) -> str:
    text = str(values.get(name, "not given"))
    return text if len(text) <= 60 else f"{text[:57]}..."


@contextlib.contextmanager
def only_study(out: Path) -> Iterator[None]:
    """Context in which only this process runs a study with the output `out`.

    The lock is a system lock on a file next to the output, and is released when the process ends, for
    whatever reason. Only the coordinating process acquires the lock, not the workers. On a file system
    without locks, only studies of the same process exclude each other. **Raises** FileError if another study
    uses the output.
    """
    out = out.resolve()
    lock = out.with_name(f".{out.name}.lock")
    with _guard:
        if out in _held:
            raise FileError(_taken(out, "of this process"))
        _held.add(out)
    try:
        with tell_write_errors(out):
            out.parent.mkdir(parents=True, exist_ok=True)
            handle = _lock(out, lock)
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)
            os.close(handle)
    finally:
        _held.discard(out)


def _lock(out: Path, lock: Path) -> int:
    """Locks the lock file and returns its handle. **Raises** FileError if another process has locked it."""
    while True:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            # the lock belongs to the process, not to the handle, so a forked child does not keep it
            if fcntl is not None:
                fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            who = os.read(handle, 200).decode(errors="replace") or "another process"
            os.close(handle)
            raise FileError(_taken(out, who)) from None
        except OSError:
            pass  # a file system without locks
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), os.stat(lock)):
                os.ftruncate(handle, 0)
                os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
                return handle
        os.close(handle)  # the previous study has just ended and removed its lock file


def _taken(out: Path, who: str) -> str:
    return (
        f"{out}: another study ({who}) is writing to it, and nothing was changed. Wait until it has ended, "
        "or give another name for the output"
    )
