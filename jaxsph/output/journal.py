"""Journal and last checkpoint of a run in progress, in two files next to the run's file.

    run.h5.journal      records: one that names the run and its series, then one for every chunk with its
                        samples and snapshot; append-only
    run.h5.checkpoint   one record: the complete state, bit for bit, and the journal's length at that time

The cost of writing a chunk depends on its size, not on the length of the run. A chunk becomes valid when its
checkpoint replaces the previous checkpoint, because the journal is read only up to the length stored in the
checkpoint. A kill at any moment therefore leaves all earlier chunks intact, and the next append overwrites a
chunk that was only partly written.

Both files belong to one `Owner`: the run's file at one stage. Merging the two files into the run's file
increases the stage in the same atomic step; the two files are then removed. If the process is killed before
their removal, the remaining files have no owner and are ignored.
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
    """Owner of a journal: a run, and its stage (how many times a journal was merged into the run's file or
    the file was amended)."""

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
        """Heads of the chunks' records from byte `place` on, by default of all chunks."""
        place = self.first if place is None else max(place, self.first)
        while place < self.about["end"]:
            head = read_head(self.chunks, place)
            yield head
            place = head.end
        if place != self.about["end"]:
            raise Damage("the journal's records do not end at the length stored in the checkpoint")

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Arrays of the checkpoint, bit for bit."""
        return read_arrays(self.saved, self.saved_head)


def journal_path(run: Path) -> Path:
    """Path of the journal of a run's file."""
    return run.with_name(f"{run.name}.journal")


def checkpoint_path(run: Path) -> Path:
    """Path of the checkpoint of a run's file."""
    return run.with_name(f"{run.name}.checkpoint")


@contextlib.contextmanager
def beside(run: Path) -> Iterator[Journal | None]:
    """Context with the journal of a run's file, open for reading; None if there is no checkpoint.

    Open the journal before the run's file: a journal is removed only after all of it is in the run's file.
    **Raises** FileError if the journal or the checkpoint is damaged.
    """
    with contextlib.ExitStack() as stack:
        try:
            yield _open(run, stack)
        except Damage as error:
            raise FileError(
                f"{journal_path(run)} or {checkpoint_path(run)} is damaged ({error}). Restore both from a "
                "copy, run the case again with --overwrite, or remove both to keep only the series up to the "
                "last update of the run's file"
            ) from None


def _open(run: Path, stack: contextlib.ExitStack) -> Journal | None:
    try:
        # open the checkpoint first: the journal is then at least as long as the checkpoint states
        saved = stack.enter_context(checkpoint_path(run).open("rb"))
        chunks = stack.enter_context(journal_path(run).open("rb"))
    except FileNotFoundError:
        if checkpoint_path(run).exists() and not journal_path(run).exists():
            raise Damage("there is a checkpoint without its journal") from None
        return None
    head, begin = read_head(saved, 0), read_head(chunks, 0)
    owner = Owner(*begin.about["owner"])
    if Owner(*head.about["owner"]) != owner:
        return None  # files left over from a kill, or a new journal that has no checkpoint yet
    if os.fstat(chunks.fileno()).st_size < head.about["end"]:
        raise Damage("the journal is shorter than its checkpoint states")
    return Journal(owner, begin.about["variables"], begin.end, head.about, chunks, saved, head)


def begin(run: Path, owner: Owner, variables: Mapping[str, Any]) -> int:
    """Creates the journal of a run's file, replacing an existing one; returns its length in bytes."""
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
    """Appends a chunk at byte `end` of a journal and replaces the checkpoint; returns the new end."""
    record = pack({}, chunk)
    with journal_path(run).open("r+b") as file:
        file.truncate(end)  # removes a chunk that a kill left incomplete
        file.seek(end)
        file.write(record)
        file.flush()
        os.fsync(file.fileno())
    told = {"owner": owner, "end": end + len(record), **about}
    put_file(checkpoint_path(run), pack(told, checkpoint))
    return told["end"]


def remove(run: Path) -> None:
    """Removes the journal and the checkpoint of a run's file."""
    for path in (checkpoint_path(run), journal_path(run)):
        path.unlink(missing_ok=True)
