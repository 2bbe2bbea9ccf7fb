"""Fits of what a fast model adds to linear theory to the results of runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.study.fast_theory import AbstractFastTheory

__all__ = ["Fit", "Predicted"]


class Predicted(NamedTuple):
    """A run and the model's predictions for it."""

    changes: dict[str, float]
    """Parameters of the run."""
    H: float
    """Measured height of the incident waves, m."""
    results: dict[str, float]
    """Results of the run, by the names in `AbstractFastTheory.read`."""
    left_out: dict[str, float]
    """The same results by a model that was fitted to the other runs."""


class Fit:
    """Fits of a model's additions to some of several runs, which share compiled functions."""

    def __init__(
        self,
        theory: AbstractFastTheory,
        answer: Callable[[Any, Mapping[str, jax.Array]], dict[str, jax.Array]],
        runs: Sequence[Predicted],
    ) -> None:
        """Fits of the additions of a theory; `answer`: results with additions, for changed parameters."""
        changes, read = _changes(runs), [*theory.read]
        usual = jnp.asarray([[one.results[name] for name in read] for one in runs])
        self._count = len(read)
        self._start, self._scale, *self._bounds = (_flat(a) for a in theory.additions)
        _, self._whole = jax.flatten_util.ravel_pytree(theory.additions.start)

        def results(x: jax.Array) -> dict[str, jax.Array]:
            found = jax.vmap(lambda at: answer(self._whole(x), at))(changes)
            return {name: found[name] for name in read}

        def residuals(x: jax.Array, weights: jax.Array) -> jax.Array:
            off = jnp.stack([*results(x).values()], 1) / usual - 1.0
            return jnp.ravel(off * weights[:, None])

        self._results = jax.jit(results)
        self._residuals, self._slopes = jax.jit(residuals), jax.jit(jax.jacfwd(residuals))

    def results(self, added: Any) -> dict[str, jax.Array]:
        """Results of a model with these additions in the waves of the runs, `[R]`."""
        return self._results(jnp.asarray(_flat(added), jnp.float32))

    def to(self, weights: NDArray) -> tuple[Any, Any]:
        """Additions that fit the runs with weight 1 best, and their standard errors.

        The sum of the squares of the results' relative errors is the least. The standard errors follow from
        the scatter of these errors. The weights of the other runs are 0.
        """

        def of(function: Callable[..., jax.Array]) -> Callable[[NDArray], NDArray]:
            return lambda x: np.asarray(
                function(jnp.asarray(x, jnp.float32), jnp.asarray(weights, float)), float
            )

        best = scipy.optimize.least_squares(
            of(self._residuals), self._start, of(self._slopes), bounds=self._bounds, x_scale=self._scale
        )
        freedom = max(np.count_nonzero(weights) * self._count - best.x.size, 1)
        covariance = np.linalg.pinv(best.jac.T @ best.jac) * (2.0 * best.cost / freedom)
        return self._named(best.x), self._named(np.sqrt(np.diag(covariance)))

    def _named(self, x: NDArray) -> Any:
        """Additions from their values in one row."""
        return jax.tree.map(float, self._whole(jnp.asarray(x, jnp.float32)))


def _flat(added: Any) -> NDArray:
    """Values of additions in one row, in double precision."""
    return np.array(jax.tree.leaves(added), float)


def _changes(runs: Sequence[Predicted]) -> dict[str, jax.Array]:
    """Parameters of runs, with the measured heights of their waves."""
    found = {key: jnp.asarray([one.changes[key] for one in runs]) for key in runs[0].changes}
    return found | {"waves.H": jnp.asarray([one.H for one in runs])}
