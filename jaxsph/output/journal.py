"""The journal beside the file of a run that has not ended, and its last checkpoint.

    run.h5.journal      records: one that names the run and its series, then one for every chunk with the
                        samples and the snapshot; only ever appended to
    run.h5.checkpoint   one record: all that evolves, bit for bit, and how much of the journal it goes with

A chunk costs what it holds, however long the run is. It counts from the moment its checkpoint takes the
place of the last one: of a journal nothing is read beyond what the checkpoint goes with, so a kill at any
moment leaves the chunks before, whole, and what was half written is overwritten by the next append.

Both belong to one `Owner`, the run's file at one stage. Whoever folds them into the file gives it the next
stage in the same atomic step, and then removes them; if it is killed in between, what is left belongs to no
one and is ignored.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from jaxsph.errors import FileError
from jaxsph.output.hdf5 import put_file
from jaxsph.output.records import Damage, Head, pack, read_arrays, read_head


class Owner(NamedTuple):
    """Owner of a journal: a run, and its stage, how often a journal has been folded into the run's file."""

    run: str
    stage: int


class Journal(NamedTuple):
    """Journal of a run, open for reading up to its checkpoint."""

    owner: Owner
    variables: dict[str, Any]
    """Units, long name, dimension and group of each series, by its name."""
    first: int
    """Byte at which the first chunk's record begins."""
    about: dict[str, Any]
    """Description of the checkpoint: `end` (byte at which its journal ends), `time` (of the last sample, s),
    `progress`."""
    chunks: BinaryIO
    saved: BinaryIO
    saved_head: Head

    def heads(self, place: int | None = None) -> Iterator[Head]:
        """Heads of the chunks' records from `place` on, by default of all."""
        place = self.first if place is None else max(place, self.first)
        while place < self.about["end"]:
            head = read_head(self.chunks, place)
            yield head
            place = head.end
        if place != self.about["end"]:
            raise Damage("its records do not end where its checkpoint says")

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Arrays of the checkpoint, bit for bit."""
        return read_arrays(self.saved, self.saved_head)


def journal_path(run: Path) -> Path:
    """Path of the journal beside a run's file."""
    return run.with_name(f"{run.name}.journal")


def checkpoint_path(run: Path) -> Path:
    """Path of the checkpoint beside a run's file."""
    return run.with_name(f"{run.name}.checkpoint")


@contextlib.contextmanager
def beside(run: Path) -> Iterator[Journal | None]:
    """Journal beside a run's file, open for reading; None where there is none with a checkpoint.

    To be opened before the file itself: whoever folds a journal first puts all of it into the file.
    **Raises** FileError where one is damaged.
    """
    with contextlib.ExitStack() as stack:
        try:
            yield _open(run, stack)
        except Damage as error:
            raise FileError(
                f"{journal_path(run)} or {checkpoint_path(run)}: is damaged ({error}). Restore both from a "
                "copy, or run the case again with --overwrite. Without them the file gives the series "
                "up to its last update"
            ) from None


def _open(run: Path, stack: contextlib.ExitStack) -> Journal | None:
    try:
        # the checkpoint first: the journal is never behind it
        saved = stack.enter_context(checkpoint_path(run).open("rb"))
        chunks = stack.enter_context(journal_path(run).open("rb"))
    except FileNotFoundError:
        if checkpoint_path(run).exists() and not journal_path(run).exists():
            raise Damage("there is a checkpoint without its journal") from None
        return None
    head, begin = read_head(saved, 0), read_head(chunks, 0)
    owner = Owner(*begin.about["owner"])
    if Owner(*head.about["owner"]) != owner:
        return None  # one was left by a kill, or a new one has just begun
    if os.fstat(chunks.fileno()).st_size < head.about["end"]:
        raise Damage("the journal ends before its checkpoint")
    return Journal(owner, begin.about["variables"], begin.end, head.about, chunks, saved, head)


def begin(run: Path, owner: Owner, variables: Mapping[str, Any]) -> int:
    """Begins a journal for a run's file, in the place of any other; returns the byte at which it ends."""
    opening = pack({"owner": owner, "variables": variables}, {})
    put_file(journal_path(run), opening)
    return len(opening)


def append(
    run: Path,
    owner: Owner,
    end: int,
    chunk: Mapping[str, np.ndarray],
    checkpoint: Mapping[str, np.ndarray],
    about: Mapping[str, Any],
) -> int:
    """Adds a chunk at the byte `end` of a journal, and replaces the checkpoint; returns the new end."""
    record = pack({}, chunk)
    with journal_path(run).open("r+b") as file:
        file.truncate(end)  # what a kill left
        file.seek(end)
        file.write(record)
        file.flush()
        os.fsync(file.fileno())
    told = {"owner": owner, "end": end + len(record), **about}
    put_file(checkpoint_path(run), pack(told, checkpoint))
    return told["end"]


def remove(run: Path) -> None:
    """Removes the journal and the checkpoint beside a run's file."""
    for path in (checkpoint_path(run), journal_path(run)):
        path.unlink(missing_ok=True)
