"""Ownership of the files of a study: one process writes to an output, and nothing of another study is taken
over."""

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
"""Number of differences that an error names."""

_held: set[Path] = set()
_guard = threading.Lock()
"""Outputs that studies of this process write to: a process does not exclude itself by locks of files."""


def refuse_other(
    path: Path, what: str, stored: Mapping[str, Any], given: Mapping[str, Any], remove: Path | None = None
) -> None:
    """**Raises** FileError that names what differs between the study stored at a path and the one given.

    `remove`: what to remove where the stored study is not wanted; by default the path.
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
            f"{path}: holds {what}, and nothing was changed. It differs in {few}{more}. Give another name "
            f"for the output, or remove {remove or path}"
        )


def _shown(values: Mapping[str, Any], name: str) -> str:
    text = str(values.get(name, "not given"))
    return text if len(text) <= 60 else f"{text[:57]}..."


@contextlib.contextmanager
def only_study(out: Path) -> Iterator[None]:
    """Context in which this process alone runs a study with the output `out`.

    The lock is the system's, on a file beside the output, and ends with the process, however it ends. Only
    the process that coordinates takes it, not the workers. On a disk without locks only studies of the same
    process exclude each other. **Raises** FileError where another study has the output.
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
    """Handle of the lock's file, locked. **Raises** FileError where another process has it."""
    while True:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            # of the process, not of the handle: a child that was forked does not keep it
            if fcntl is not None:
                fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            who = os.read(handle, 200).decode(errors="replace") or "another process"
            os.close(handle)
            raise FileError(_taken(out, who)) from None
        except OSError:
            pass  # a disk without locks
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), os.stat(lock)):
                os.ftruncate(handle, 0)
                os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
                return handle
        os.close(handle)  # the study before has ended just now, and its file is gone


def _taken(out: Path, who: str) -> str:
    return (
        f"{out}: another study ({who}) is writing to it, and nothing was changed. Wait until it has ended, "
        "or give another name for the output"
    )
