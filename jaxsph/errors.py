"""Errors for users: each says what is wrong, with its value, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["CaseError", "DerivativeError", "FileError", "JaxsphError", "SimulationError"]


class JaxsphError(Exception):
    """Any error of jaxsph that a user can act on."""


class CaseError(JaxsphError):
    """A case that cannot be run: names the field, its value, and what is allowed."""


class FileError(JaxsphError):
    """A file that cannot be read or written: names the file and the remedy."""


class DerivativeError(JaxsphError):
    """A derivative that cannot be trusted: says since when and which method to use instead."""


class SimulationError(JaxsphError):
    """A run that had to stop; its last good checkpoint stays in the file."""

    step: int | None
    """Step of the first failure."""
    time: float | None
    """Its physical time, s."""
    where: Sequence[float] | None
    """Its place, m."""

    def __init__(
        self,
        message: str,
        step: int | None = None,
        time: float | None = None,
        where: Sequence[float] | None = None,
    ) -> None:
        """**Arguments**: text for the user; step, time (s) and place (m) of the first failure."""
        super().__init__(message)
        self.step, self.time, self.where = step, time, where
