"""Reason why the process of a member failed, from its messages and its exit status."""

from __future__ import annotations

import re
import signal

from jaxsph.errors import ERROR_MARK
from jaxsph.run.chunks import REPLAYED

TRACEBACK = "Traceback (most recent call last):"
"""Heading of the message of a Python exception; the exception is the next line that is not indented."""

FATAL = re.compile(r"F\d{4} |Fatal Python error|.*\bCheck failed\b")
"""Beginning of a line in which the compiler or the interpreter says why it ends the process."""

PROGRESS = re.compile(r"\d+%\||\[(\d+:)?\d\d:\d\d[<,]")
"""Part of a line that shows the progress of a run."""

NOTICE = re.compile(
    rf"\s|note: |{re.escape(REPLAYED)}|jaxsph: stopping"
    r"|[IW]\d{4} |WARNING: |\S+:\d+: \w*Warning: |\*\*\* Check"
)
"""Beginning of a line that is no reason: a notice, a warning, or a line of a list of calls."""


def failure_of(messages: str, status: int) -> str:
    """Reason why a process failed, in the first line, and details in further lines.

    **Arguments**: `messages`: all that the process printed; `status`: its exit status, or minus the number of
    the signal that killed it. The reason is the error of jaxsph if the process printed one. Otherwise it is
    the signal or the exit status, with the exception or the last line that is no notice.
    """
    if ERROR_MARK in messages:
        return messages.rpartition(ERROR_MARK)[2].strip()
    lines = [line.rstrip() for line in messages.splitlines() if line.strip() and not PROGRESS.search(line)]
    last = _last_words(lines)
    first = f"{_ending(status)}: {last}" if last else _ending(status)
    return "\n".join([first, *(lines if lines != [last] else [])])


def _last_words(lines: list[str]) -> str:
    """Line of a process's messages that gives the reason for its end; empty if no line does."""
    fatal = [line for line in lines if FATAL.match(line)]
    if fatal:
        return fatal[-1]
    telling = [line for line in lines if not NOTICE.match(line) and any(map(str.isalnum, line))]
    if TRACEBACK in lines:
        begin = len(lines) - lines[::-1].index(TRACEBACK)
        return next((line for line in lines[begin:] if line in telling), "")
    return telling[-1] if telling else ""


def _ending(status: int) -> str:
    """Way in which a process ended: its exit status, or the name of the signal that killed it."""
    if status >= 0:
        return f"the process ended with exit status {status}"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = f"signal {-status}"
    memory = ", for example because the memory was full" if name == "SIGKILL" else ""
    return f"the process was killed by {name} (exit status {status}){memory}"
