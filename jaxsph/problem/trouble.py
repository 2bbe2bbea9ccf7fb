"""What stops a run, and what its problem's maker can change about it."""

from __future__ import annotations

import enum
from collections.abc import Mapping


@enum.unique
class Trouble(enum.Enum):
    """Why a run had to stop. The values say what to change in a problem that someone has put together; a case
    knows its keys for it."""

    OVER_RIM = "make the tank higher"
    """A particle has left over the tank's rim."""
    THROUGH_WALL = "take shorter time steps, or a smaller spacing"
    """A particle is inside a solid."""
    TOO_FAST = "build the scheme for a higher speed, or take shorter time steps"
    """A particle is faster than the scheme allows."""
    NOT_FINITE = "take shorter time steps, or more viscosity"
    """A value is not finite."""
    NOT_CONVERGED = "take shorter time steps, or give the scheme a solver with a larger tolerance"
    """A solution for the pressure did not converge."""
    TOO_DENSE = "build the walls with another filling, such as MirrorNodes"
    """The images of the water at a wall have no room."""
    NO_TABLES = "take a smaller spacing, or shorter time steps"
    """The neighbour tables cannot be kept."""


Remedies = Mapping[Trouble, str]
"""What to change about some troubles; for others the values of `Trouble` hold. `{higher}` in a remedy of
`OVER_RIM` stands for a sufficient height, m."""
