"""Handles Ctrl-C between chunks, when all data are complete, and never inside JAX.

An exception that is raised while JAX compiles or runs can crash the interpreter. An interrupt is therefore
only noted here, and a run checks for it after every chunk; a second interrupt acts at once.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator

CODE = 130
"""Exit status of an interrupted program: 128 plus the signal's number."""

ATTACHED = "JAXSPH_ATTACHED"
"""Name of the environment variable that makes a program end when its standard input closes.

The program then ends with the process that started it, however that process ends.
"""

STOPPING = "\njaxsph: stopping at the end of this chunk; Ctrl-C again stops at once"


class Interrupt:
    """Request to a run to stop at the end of its chunk."""

    def __init__(self) -> None:
        """Starts without a request and without a saved chunk."""
        self.asked = False
        self.has_saved = False
        """Whether the run has saved a chunk; until then an interrupt ends the run at once."""

    def chunk_is_saved(self) -> None:
        """Notes that a chunk was saved. **Raises** KeyboardInterrupt if a stop is requested."""
        self.has_saved = True
        if self.asked:
            raise KeyboardInterrupt


_runs: list[Interrupt] = []
"""Requests to the runs in progress, with the innermost run last."""
_watched = False
"""Whether `end_at_once` handles the interrupts of this process."""


@contextlib.contextmanager
def hear_interrupts() -> Iterator[Interrupt]:
    """Context in which Ctrl-C requests a stop of the run instead of raising KeyboardInterrupt.

    The run checks for the request after every chunk. Outside the main thread no signals arrive.
    """
    interrupt = Interrupt()
    _runs.append(interrupt)
    ours = (
        not _watched
        and threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )

    def note(number: int, frame: object) -> None:
        if interrupt.asked:
            raise KeyboardInterrupt
        interrupt.asked = True
        print(STOPPING, file=sys.stderr, flush=True)

    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        _runs.remove(interrupt)
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


@contextlib.contextmanager
def end_at_once(words: Callable[[], str]) -> Iterator[None]:
    """Context of a program with one run: an interrupt ends the program at once or after the run's chunk.

    An interrupt before the first saved chunk, or a second interrupt, ends the program at once. A thread
    handles the signal, even while the main thread is busy compiling. **Arguments**: `words` returns the last
    message.
    """
    global _watched
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ear, mouth = socket.socketpair()
    mouth.setblocking(False)
    before = signal.signal(signal.SIGINT, lambda *_: None)
    fd_before = signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
    thread = threading.Thread(target=_listen, args=(ear, words), daemon=True)
    _watched = True
    thread.start()
    try:
        yield
    finally:
        _watched = False
        signal.set_wakeup_fd(fd_before)
        signal.signal(signal.SIGINT, before)
        mouth.close()
        thread.join()
        ear.close()


def _listen(ear: socket.socket, words: Callable[[], str]) -> None:
    while heard_ := ear.recv(1):
        if heard_[0] != signal.SIGINT:
            continue
        run = _runs[-1] if _runs else None
        if run is not None and run.has_saved and not run.asked:
            run.asked = True
            print(STOPPING, file=sys.stderr, flush=True)
        else:
            end(words())


def end_with_parent() -> None:
    """Makes a program with the variable `ATTACHED` end when its input closes; a run keeps its checkpoint."""
    if not os.environ.get(ATTACHED):
        return

    def watch() -> None:
        while os.read(0, 1):
            pass
        os._exit(CODE)

    threading.Thread(target=watch, daemon=True).start()


def _end_early(number: int, frame: object) -> None:
    end("\njaxsph: interrupted before anything was started")


def end_early() -> None:
    """Makes an interrupt end a program that has just started, even during imports."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_early)


def raise_again() -> None:
    """Makes interrupts raise KeyboardInterrupt again, as in Python by default."""
    if signal.getsignal(signal.SIGINT) is _end_early:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def end(words: str) -> None:
    """Ends the program with a message, without the interpreter's shutdown."""
    print(words, file=sys.stderr, flush=True)
    sys.stdout.flush()
    os._exit(CODE)
