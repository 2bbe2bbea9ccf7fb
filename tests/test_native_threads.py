"""Division of native loops among threads."""

import hashlib
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsph.core.native.calls import begin_call
from jaxsph.core.native.forms import blocked
from jaxsph.core.native.functions import register
from jaxsph.core.native.threads import in_parts
from jaxsph.core.native.vectors import INDEX, Vectors
from jaxsph.core.pairs import Smoothing, pair_sum, weighted_sum, with_empty
from jaxsph.core.search.cells import grid_over, search
from jaxsph.model import laws
from jaxsph.schemes.kernels import KERNEL

COUNT = 6000
"""Number of particles."""

REPEATS = 50
"""Number of calls; a helper may begin at any time during a call, or after it."""


def _counter(step):
    """Function that sets every element of its result to zero, and then adds 1 to each, in parts."""

    def module_of(name):
        module, call = begin_call(name)
        (count,) = call.sizes(0, 1)
        for add in (False, True):
            with in_parts(call, count, INDEX(step)) as (part, begin, end):
                b, one = part.builder, Vectors(part.builder, 1)
                with one.loop(begin, end, 1) as (i, _, _):
                    place = one.place(part.result(0), np.int32, i)
                    number = b.add(b.load(place, typ=_INT), _INT(1)) if add else _INT(0)
                    b.store(number, place)
        call.finish()
        return module

    return register(module_of)


_INT = Vectors(None, 1).type(np.int32).element


@pytest.mark.parametrize("count, step", [(1, 1), (1000, 1), (1000, 7), (64, 64), (65, 64), (100_000, 33)])
def test_every_element_belongs_to_one_part(count, step):
    name = _counter(step)
    found = jax.jit(jax.ffi.ffi_call(name, jax.ShapeDtypeStruct((count,), jnp.int32)))
    for _ in range(REPEATS):
        np.testing.assert_array_equal(found(jnp.zeros(count, jnp.int32)), 1)


def _sums():
    """Checksum of a table and of sums over it, for enough particles that each loop has many parts."""
    rng, ones = np.random.default_rng(1), jnp.ones(COUNT, jnp.int32)
    x = jnp.asarray(rng.uniform(0.0, 1.0, (COUNT, 2)), jnp.float32)
    grid = grid_over(np.zeros(2), np.ones(2), 0.04)
    table = jax.jit(lambda x: search(x, x, grid, 60, ones, ones, same=True))(x).indices
    fields = {"x": tuple(x.T), **{name: x[:, 0] + k for k, name in enumerate(("p", "V", "rho"))}}
    smoothing = Smoothing(KERNEL[2], jnp.float32(0.01))
    sums = jax.jit(lambda f: pair_sum(laws.pressure_force, smoothing, f, with_empty(f), table))(fields)
    listed = blocked(table)
    weights = listed.stored(jnp.asarray(rng.uniform(0.0, 1.0, table.shape), jnp.float32))
    weighted = jax.jit(weighted_sum)(weights, jnp.append(x[:, 1], 0.0), listed)
    slopes = jax.jit(
        lambda f: jax.vjp(lambda f: pair_sum(laws.pressure_force, smoothing, f, with_empty(f), table), f)[1](
            sums
        )
    )(fields)
    found = hashlib.sha256()
    for a in (table, *sums, weighted, *jax.tree.leaves(slopes)):
        found.update(np.asarray(a).tobytes())
    return found.hexdigest()


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity"), reason="this system cannot restrict a process to a core"
)
def test_results_do_not_depend_on_the_number_of_threads():
    code = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
    code += "from test_native_threads import _sums; print(_sums())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=os.path.dirname(__file__),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == _sums()
