"""Errors for users; every message states the error, the wrong value and the remedy."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["CaseError", "DerivativeError", "FileError", "JaxsphError", "SimulationError"]

ERROR_MARK = "jaxsph: error: "
"""Beginning of the message of an error on the command line."""


class JaxsphError(Exception):
    """Base class of the errors of jaxsph that a user can act on."""


class CaseError(JaxsphError):
    """Raised if a case cannot be run; the message names the field, its value, and what is allowed."""


class FileError(JaxsphError):
    """Raised if a file cannot be read or written; the message names the file and the remedy."""


class DerivativeError(JaxsphError):
    """Raised if a derivative is unreliable; for a single run the message gives the time and the remedy."""


class SimulationError(JaxsphError):
    """Raised if a run had to stop; the file of the run, if any, keeps the last good checkpoint."""

    step: int | None
    """Number of the step of the first failure."""
    time: float | None
    """Physical time of the first failure, s."""
    where: Sequence[float] | None
    """Position of the first failure, m."""

    def __init__(
        self,
        message: str,
        step: int | None = None,
        time: float | None = None,
        where: Sequence[float] | None = None,
    ) -> None:
        """Error with a message, and the step, time (s) and position (m) of the first failure."""
        super().__init__(message)
        self.step, self.time, self.where = step, time, where
