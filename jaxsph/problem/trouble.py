"""Reasons why a run stops, and what to change in its problem."""

from __future__ import annotations

import enum
from collections.abc import Mapping


@enum.unique
class Trouble(enum.Enum):
    """Reason why a run had to stop.

    The value is the advice for a problem built in Python; a case names its own keys instead (`Remedies`).
    """

    OVER_RIM = "make the tank higher"
    """A particle has left the tank over its rim."""
    THROUGH_WALL = "use shorter time steps, or a smaller spacing"
    """A particle is inside a solid."""
    TOO_FAST = "build the scheme for a higher speed, or use shorter time steps"
    """A particle is faster than the scheme allows."""
    NOT_FINITE = "use shorter time steps, or more viscosity"
    """A value is not finite."""
    NOT_CONVERGED = "use shorter time steps, or give the scheme a solver with a larger tolerance"
    """The iterative solution for the pressure did not converge."""
    TOO_DENSE = "build the walls with another filling, such as MirrorNodes"
    """More particles are near a wall than there are ghosts for their images."""
    NO_TABLES = "use a smaller spacing, or shorter time steps"
    """The neighbour tables overflow repeatedly."""
    TOUCHING = "give the body less mass, or a link that stops it before it reaches the other solid"
    """A body is too close to another solid."""


Remedies = Mapping[Trouble, str]
"""What to change for each trouble; by default the value of the trouble. In the remedy of `OVER_RIM`,
`{higher}` stands for a sufficient height, m."""
