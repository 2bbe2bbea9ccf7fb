"""Near field of a piston: the evanescent waves that the piston generates besides the progressive wave."""

from __future__ import annotations

import numpy as np

from jaxsph.waves.theory import GRAVITY

_EVANESCENT_MODES = 200
"""Number of evanescent modes that are summed."""


def near_field_ratio(x: float, omega: float, d: float, g: float = GRAVITY) -> float:
    """Ratio of the evanescent elevation at x (m) from a piston to the piston's displacement (-).

    Host function. Linear theory of a piston U = dX/dt: besides the progressive wave,
    eta = X(t) sum_n C_n exp(-k_n x), C_n = 4 sin^2(k_n d) / (2 k_n d + sin 2 k_n d),
    with the roots of omega^2 = -g k_n tan(k_n d). Since C_n > 0, the near field is in phase
    with the displacement, a quarter period behind the progressive wave at the paddle.
    """
    y = omega**2 * d / g
    n = np.arange(1, _EVANESCENT_MODES + 1)
    kd = n * np.pi
    for _ in range(60):  # a contraction: the slope y / (y^2 + kd^2) is less than 1 / pi
        kd = n * np.pi - np.arctan(y / kd)
    C = 4.0 * np.sin(kd) ** 2 / (2.0 * kd + np.sin(2.0 * kd))
    return float(np.sum(C * np.exp(-kd * x / d)))
