"""Native sums over neighbours and native searches, compared with JAX's forms."""

import functools
import inspect
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsph.core.kernels import Gaussian, Semicircle, WendlandC2
from jaxsph.core.loop import steps
from jaxsph.core.native import forms, functions
from jaxsph.core.native.translation import COMPARISONS, RULES
from jaxsph.core.pairs import Smoothing, pair_sum, pair_weights, weighted_sum, with_empty
from jaxsph.core.search.cells import grid_over, search
from jaxsph.core.transforms import keep
from jaxsph.model import laws
from jaxsph.schemes.kernels import KERNEL, usual_length

DX = 0.1
COUNTS = {2: 70, 3: 130}
"""Numbers of particles; no multiples of the number of lanes."""
GRID = grid_over(np.zeros(2), np.ones(2), 0.2)
LAWS = {
    name: law
    for name, law in inspect.getmembers(laws, inspect.isfunction)
    if list(inspect.signature(law).parameters)[:3] == ["pair", "i", "j"] and law.__module__ == laws.__name__
}


def _fields(dim, seed=0, dtype=np.float32):
    """Fields of particles in a box at random places."""
    rng, n = np.random.default_rng(seed), COUNTS[dim]
    side = DX * n ** (1.0 / dim)

    def some(low=-1.0):
        return jnp.asarray(rng.uniform(low, 1.0, n), dtype)

    def vector():
        return tuple(some() for _ in range(dim))

    x = tuple(jnp.asarray(rng.uniform(0.0, side, n), dtype) for _ in range(dim))
    scalars = {name: some() for name in ("rho", "p", "V")}
    return {"x": x, "u": vector(), "grad_rho": vector(), **scalars}


def _table(n, seed=0):
    """Table that lists every other particle in random slots, with empty slots between them."""
    rng = np.random.default_rng(seed)
    slots = np.full((n + 20, n), n, np.int32)
    for i in range(n):
        others = np.delete(np.arange(n), i)
        slots[rng.permutation(n + 20)[: n - 1], i] = rng.permutation(others)
    return jnp.asarray(slots)


def _smoothing(dim, kernel=None, dtype=np.float32):
    kernel = kernel or KERNEL[dim]
    return Smoothing(kernel, jnp.asarray(usual_length(kernel, dim) * DX, dtype))


def _both(function, *arguments):
    """Results of a function, with JAX's forms and with native ones."""
    found = []
    for on in (False, True):
        before = len(functions.registered())
        with forms.switched(on):
            found.append(jax.jit(lambda *given: function(*given))(*arguments))
        found.append(len(functions.registered()) - before)
    return found[0], found[2]


def _agree(one, other, share):
    """Whether the arrays agree to a `share` of the largest value of each."""
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=share * float(jnp.max(jnp.abs(a)) + 1e-30))


def _law(name):
    law = LAWS[name]
    return functools.partial(law, guard=1e-3 * DX**2) if "guard" in inspect.signature(law).parameters else law


@pytest.mark.parametrize("dim", [2, 3])
def test_every_law_has_the_same_sum(dim):
    fields, table = _fields(dim), _table(COUNTS[dim])

    def sums(fields, smoothing, table):
        sources = with_empty(fields)
        return {name: pair_sum(_law(name), smoothing, fields, sources, table) for name in LAWS}

    assert len(LAWS) >= 8
    jaxs, natives = _both(sums, fields, _smoothing(dim), table)
    # rounding of sums over some 30 neighbours
    _agree(jaxs, natives, 1e-5)


@pytest.mark.parametrize(
    "kernel", [Gaussian(), Semicircle.of(2), WendlandC2()], ids=lambda k: type(k).__name__
)
def test_every_kernel_has_the_same_sum(kernel):
    arguments = _fields(2), _smoothing(2, kernel), _table(COUNTS[2])

    def summed(fields, smoothing, table):
        return pair_sum(laws.pressure_force, smoothing, fields, with_empty(fields), table)

    _agree(*_both(summed, *arguments), 1e-5)


def test_sums_agree_in_float64():
    def summed(fields, smoothing, table):
        return pair_sum(laws.pressure_force, smoothing, fields, with_empty(fields), table)

    with enable_x64():
        fields, smoothing = _fields(2, dtype=np.float64), _smoothing(2, Gaussian(), np.float64)
        _agree(*_both(summed, fields, smoothing, _table(COUNTS[2])), 1e-14)


def test_integers_of_64_bits_are_read_as_such():
    """In float64 programs tables made from NumPy's arrays have 64 bits."""

    def summed(fields, smoothing, table):
        return pair_sum(laws.pressure_force, smoothing, fields, with_empty(fields), table)

    def found(x, sees, kind):
        return search(x, x, GRID, 60, sees, kind, same=True)

    with enable_x64():
        wide = jnp.asarray(np.asarray(_table(COUNTS[2]), np.int64))
        fields, smoothing = _fields(2, dtype=np.float64), _smoothing(2, Gaussian(), np.float64)
        _agree(*_both(summed, fields, smoothing, wide), 1e-14)
        x = jnp.asarray(np.random.default_rng(0).uniform(0.0, 1.0, (200, 2)))
        masks = [jnp.asarray(np.random.default_rng(k).integers(0, 4, 200)) for k in (1, 2)]
        for one, other in zip(*_both(found, x, *masks), strict=True):
            np.testing.assert_array_equal(one, other)


def _weights(fields, smoothing, table):
    """Sums, and weights by slot, of a law whose constant is a traced value."""
    sums, weights = _stored(fields, smoothing, forms.blocked(table))
    return sums, forms.blocked(table).by_slot(weights)


def _stored(fields, smoothing, table):
    law = functools.partial(_laplacian, guard=1e-3 * smoothing.h**2)
    return pair_weights(law, smoothing, fields, with_empty(fields), table)


def _laplacian(pair, i, j, guard=1e-3 * DX**2):
    w = laws.laplacian_weight(pair, j, guard)
    return (w * i["p"], laws.divergence(pair, i, j)), w


@pytest.mark.parametrize("on", [False, True])
def test_every_index_beyond_the_last_source_is_empty(on):
    """Sums over the water alone use tables that also list ghosts, which follow the water."""
    fields, smoothing, table, n = _fields(2), _smoothing(2), np.asarray(_table(COUNTS[2])), COUNTS[2]
    beyond = np.where(table == n, n + np.arange(len(table))[:, None], table)

    def forward(table):
        def summed(fields):
            return pair_sum(laws.pressure_force, smoothing, fields, with_empty(fields), table)

        return jax.jvp(summed, (fields,), (_fields(2, seed=1),))

    with forms.switched(on):
        for one, other in zip(
            *(jax.tree.leaves(forward(jnp.asarray(a))) for a in (table, beyond)), strict=True
        ):
            np.testing.assert_array_equal(one, other)


def test_weights_agree_in_every_slot():
    _agree(*_both(_weights, _fields(2), _smoothing(2), _table(COUNTS[2])), 1e-5)


def _weighted(fields, smoothing, table):
    """Weighted sum of a field over all neighbours, with weights that depend on other fields."""
    sources, table = with_empty(fields), forms.blocked(table)
    return weighted_sum(_stored(fields, smoothing, table)[1], sources["p"] * sources["V"], table)


@pytest.mark.parametrize("dim", [2, 3])
def test_weighted_sums_agree(dim):
    _agree(*_both(_weighted, _fields(dim), _smoothing(dim), _table(COUNTS[dim])), 1e-5)
    with enable_x64():
        fields = _fields(dim, dtype=np.float64)
        smoothing = _smoothing(dim, KERNEL[dim], np.float64)
        _agree(*_both(_weighted, fields, smoothing, _table(COUNTS[dim])), 1e-13)


@pytest.mark.parametrize("on", [False, True])
def test_a_weighted_sum_can_be_transposed(on):
    fields, smoothing, table = _fields(2), _smoothing(2), _table(COUNTS[2])
    listed, n = forms.blocked(table), COUNTS[2] + 1
    weights = _stored(fields, smoothing, listed)[1]
    with forms.switched(on):
        transposed = jax.linear_transpose(lambda f: weighted_sum(weights, f, listed), jnp.zeros(n))
        (back,) = transposed(jnp.ones(COUNTS[2]))
    expected = np.bincount(np.ravel(table), np.ravel(listed.by_slot(weights)), n)
    np.testing.assert_allclose(back, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


def _pressures(fields, smoothing, table):
    return pair_sum(laws.pressure_force, smoothing, fields, with_empty(fields), table)


SUMS = {"sum": _pressures, "weights": _weights, "weighted": _weighted}


def _forward(summed, fields, smoothing):
    """Results of a sum and their tangents."""
    other = jax.tree.map(lambda a: 0.1 * a, (_fields(2, seed=1), smoothing))
    return jax.jvp(lambda f, s: summed(f, s, _table(COUNTS[2])), (fields, smoothing), other)


def _backward(summed, fields, smoothing):
    """Gradient of the squares of a sum."""

    def total(fields, smoothing):
        return sum(jnp.sum(a**2) for a in jax.tree.leaves(summed(fields, smoothing, _table(COUNTS[2]))))

    return jax.grad(total, (0, 1))(fields, smoothing)


@pytest.mark.parametrize("derivative", [_forward, _backward])
@pytest.mark.parametrize("name", SUMS)
def test_derivatives_agree_and_are_native(name, derivative):
    derivative, arguments = functools.partial(derivative, SUMS[name]), (_fields(2), _smoothing(2))
    _agree(*_both(derivative, *arguments), 1e-5)
    texts = []
    for on in (False, True):
        with forms.switched(on):
            texts.append(jax.jit(lambda *given: derivative(*given)).lower(*arguments).as_text())
    by_jax, native = texts
    # a gather or a scatter over all neighbours in JAX's form, in a loop over the slots
    assert "stablehlo.while" in by_jax and "stablehlo.while" not in native


def _moved(scale, fields, smoothing, table):
    """Sum of squares of velocities after steps of a loop that reverse mode recomputes."""

    def step(fields):
        force = keep(_pressures(fields, smoothing, table))
        around = _weighted(fields, smoothing, table)
        p = fields["p"] + 1e-7 * scale * around
        return fields | {"u": tuple(u + 1e-5 * f for u, f in zip(fields["u"], force, strict=True)), "p": p}

    last = steps(step, fields, 3)
    return sum(jnp.sum(a**2) for a in jax.tree.leaves(last["u"]))


@pytest.mark.parametrize(
    "derivative",
    [
        lambda f: jax.grad(f),
        lambda f: jax.vmap(jax.grad(f)),
        lambda f: jax.grad(lambda a: jnp.sum(jax.vmap(f)(a) ** 2)),
        lambda f: jax.grad(jax.grad(f)),
        lambda f: lambda a: jax.jvp(jax.grad(f), (a,), (a,))[1],
        lambda f: lambda a: jax.jvp(lambda b: jax.jvp(f, (b,), (b,))[1], (a,), (a,))[1],
    ],
    ids=["once", "in lanes", "over lanes", "twice", "forward of reverse", "forward of forward"],
)
def test_derivatives_through_loops_agree(derivative, request):
    fields, smoothing, table = _fields(2), _smoothing(2), _table(COUNTS[2])
    scale = jnp.asarray([1.0, 2.0]) if "lanes" in request.node.callspec.id else jnp.float32(2.0)

    def found(scale):
        return derivative(lambda a: _moved(a, fields, smoothing, table))(scale)

    _agree(*_both(found, scale), 1e-4)


def test_lanes_of_a_batch_agree():
    fields, smoothing, table = _fields(2), _smoothing(2), _table(COUNTS[2])
    several = jax.tree.map(lambda a: jnp.stack([a, 0.9 * a, 1.1 * a]), fields)

    def summed(fields):
        return pair_sum(laws.pressure_force, smoothing, fields, with_empty(fields), table)

    _agree(*_both(jax.vmap(summed), several), 1e-5)
    _agree(*_both(jax.vmap(lambda fields: _weighted(fields, smoothing, table)), several), 1e-5)


CALLED = """
import re
import jax.numpy as jnp
import jaxsph as js
from jaxsph.run.devices import everywhere, find_devices, share
from jaxsph.run.simulate import new_program

find_devices(2)
problem = js.load_case("hydrostatic").replace({"scheme.kind": "incompressible"}).problem()
for devices in (1, 2):
    model, state = share(problem.model, problem.state, devices)
    probes, every = everywhere(model.search.slabs, problem.probes), problem.sample_every
    lowered = new_program(model).lower(model, state, probes, every, every, jnp.int32(every))
    print(*sorted(set(re.findall("@jaxsph_[0-9a-f]+", lowered.as_text()))))
"""


def test_several_devices_use_the_native_functions_of_one():
    """On several devices JAX adds operations to a law, which must not make it untranslatable."""
    done = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True, check=True)
    alone, shared = (set(line.split()) for line in done.stdout.splitlines())
    assert len(alone) > 8 and alone <= shared


def test_few_targets_and_untranslatable_laws_use_the_form_of_jax():
    fields, smoothing, table = _fields(2), _smoothing(2), _table(COUNTS[2])
    few = jax.tree.map(lambda a: a[:5], fields)

    def odd(pair, i, j):
        return jnp.sin(pair.r2) * pair.W

    def sums(fields, few, table):
        sources = with_empty(fields)
        return (
            pair_sum(odd, smoothing, fields, sources, table),
            pair_sum(laws.pressure_force, smoothing, few, sources, table[:, :5]),
        )

    before = functions.registered()
    _agree(*_both(sums, fields, few, table), 1e-6)
    assert functions.registered() == before


# ------------------------------------------------------------------- operations

NUMBERS = st.one_of(
    st.floats(width=32, allow_nan=True, allow_infinity=True, allow_subnormal=False),
    st.sampled_from([0.0, -0.0, 1.0, -1.0]),
)
ONE_OPERAND = {
    "neg": jnp.negative,
    "square": jnp.square,
    "rsqrt": jax.lax.rsqrt,
    "sqrt": jnp.sqrt,
    "abs": jnp.abs,
    "floor": jnp.floor,
    "ceil": jnp.ceil,
    "cube": lambda a: a**3,
    "inverse": lambda a: a**-2,
    "sign": lambda a: (a > 0).astype(a.dtype),
    "whole": lambda a: jnp.where(~(a != a), 1.0, 0.0),
}
TWO_OPERANDS = {
    "add": jnp.add,
    "sub": jnp.subtract,
    "mul": jnp.multiply,
    "div": jnp.divide,
    "max": jnp.maximum,
    "min": jnp.minimum,
    "both": lambda a, b: jnp.where((a > 0) & (b > 0) | (a < b), a, b),
    "other": lambda a, b: jnp.where(jnp.logical_xor(a > 0, b > 0), a, b),
    **{
        sign: functools.partial(lambda how, a, b: how(a, b) * 1.0, getattr(jnp, name))
        for sign, name in {
            "lt": "less",
            "le": "less_equal",
            "gt": "greater",
            "ge": "greater_equal",
            "eq": "equal",
            "ne": "not_equal",
        }.items()
    },
}


@functools.cache
def _operations(native):
    """All operations on arrays of 16 pairs of numbers, as the laws of one sum each."""
    n = 16
    table = jnp.arange(n, dtype=jnp.int32)[None]
    smoothing = Smoothing(WendlandC2(), jnp.float32(1.0))

    def every(a, b):
        zeros = jnp.zeros(n, jnp.float32)
        mine, theirs = ({"x": (zeros, zeros), "a": c} for c in (a, b))

        def law(pair, i, j):
            one = {name: how(i["a"]) for name, how in ONE_OPERAND.items()}
            return one | {name: how(i["a"], j["a"]) for name, how in TWO_OPERANDS.items()}

        return pair_sum(law, smoothing, mine, with_empty(theirs), table)

    with forms.switched(native):
        return jax.jit(every).lower(*[jax.ShapeDtypeStruct((n,), jnp.float32)] * 2).compile()


@settings(max_examples=50, deadline=None)
@given(st.lists(NUMBERS, min_size=32, max_size=32))
def test_every_operation_agrees_bit_for_bit(numbers):
    a, b = np.asarray(numbers, np.float32).reshape(2, 16)
    jaxs, natives = (_operations(native)(a, b) for native in (False, True))
    for name, values in jaxs.items():
        if name == "rsqrt":  # XLA may use an approximation, and has a NaN for -0.0
            np.testing.assert_allclose(natives[name][a > 0], values[a > 0], rtol=1e-6)
        else:
            np.testing.assert_array_equal(natives[name], values, err_msg=name)


def test_every_translated_operation_is_compared():
    compared = {*ONE_OPERAND, *TWO_OPERANDS, "exp", "select_n", "and", "or", "xor", "not", "add_any"}
    assert {name for name, kind in RULES if kind != "i"} | set(COMPARISONS) <= compared


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_exponential_function_is_accurate(dtype):
    with enable_x64():
        x = np.linspace(-80.0, 80.0, 4801, dtype=dtype)
        mine = {"x": (np.zeros_like(x),) * 2, "a": x}
        table = np.zeros((1, len(x)), np.int32)
        smoothing = Smoothing(WendlandC2(), jnp.asarray(1.0, dtype))

        def summed(mine):
            sources = with_empty(jax.tree.map(lambda a: a[:16], mine))  # the fewest for any processor
            return pair_sum(lambda pair, i, j: jnp.exp(i["a"]), smoothing, mine, sources, table)

        before = len(functions.registered())
        with forms.switched(True):
            found = jax.jit(summed)(mine)
        assert len(functions.registered()) == before + 1
    exact = np.exp(x.astype(np.longdouble))
    # the rounding of x/log(2) to n and r, and of the last sum
    np.testing.assert_allclose(found, exact, rtol=3.0 * float(np.finfo(dtype).eps))


# ------------------------------------------------------------------- search


@pytest.mark.parametrize(
    ("dim", "period", "capacity"),
    [(2, (), 60), (2, ((0, 1.0),), 3), (2, ((1, 1.0),), 60), (3, ((2, 1.0),), 60)],
)
def test_searches_list_the_same_neighbours_in_the_same_order(dim, period, capacity):
    rng, n = np.random.default_rng(3), 407  # no multiple of the targets that are searched for together
    sources = jnp.asarray(rng.uniform(0.0, 1.0, (n + 60, dim)), jnp.float32)
    sees, kind = (jnp.asarray(rng.integers(0, 4, size), jnp.int32) for size in (n, n + 60))
    grid = grid_over(np.zeros(dim), np.ones(dim), 0.19, period)

    def found(sources, sees, kind):
        return search(sources[:n], sources, grid, capacity, sees, kind, same=True)

    jaxs, natives = _both(found, sources, sees, kind)
    assert int(jaxs.most) > 3  # with a capacity of three, most neighbours have no place
    for one, other in zip(jaxs, natives, strict=True):
        np.testing.assert_array_equal(one, other)


def test_searches_in_float64_list_the_same_neighbours():
    rng = np.random.default_rng(5)
    with enable_x64():
        x = jnp.asarray(rng.uniform(0.0, 1.0, (333, 3)), jnp.float64)
        ones, grid = jnp.ones(333, jnp.int32), grid_over(np.zeros(3), np.ones(3), 0.19)
        jaxs, natives = _both(lambda x: search(x, x, grid, 60, ones, ones, same=True), x)
    np.testing.assert_array_equal(jaxs.indices, natives.indices)
    assert int(jaxs.most) == int(natives.most) > 8


@given(st.lists(st.booleans(), min_size=40, max_size=40), st.sampled_from([1, 13, 40, 64]))
@settings(max_examples=30, deadline=None)
def test_the_true_elements_of_a_mask_are_listed_in_order(mask, size):
    mask = np.array(mask)
    expected = np.full(size, len(mask))
    listed = np.flatnonzero(mask)[:size]
    expected[: len(listed)] = listed
    for on in (True, False):
        with forms.switched(on):
            np.testing.assert_array_equal(forms.true_indices(jnp.asarray(mask), size), expected)


def test_positions_that_are_not_numbers_do_no_harm():
    x = jnp.asarray(np.random.default_rng(0).uniform(0.0, 1.0, (200, 2)), jnp.float32)
    x = x.at[7].set(jnp.nan).at[9, 0].set(jnp.inf).at[11, 1].set(-1e30)
    ones = jnp.ones(200, jnp.int32)
    with forms.switched(True):
        found = jax.jit(lambda x: search(x, x, GRID, 40, ones, ones, same=True))(x)
    indices = np.asarray(found.indices)
    assert indices.min() >= 0
    assert indices.max() <= 200


# ------------------------------------------------------------------- code on disk


def test_code_is_kept_on_disk_and_damaged_code_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr(functions, "program_folder", lambda: tmp_path)
    smoothing, fields = _smoothing(2, Gaussian(2.5)), _fields(2)

    def law(pair, i, j):
        return 1.25 * pair.W * j["p"]  # a law of no other test

    with forms.switched(True):
        jax.jit(lambda f, t: pair_sum(law, smoothing, f, with_empty(f), t))(fields, _table(COUNTS[2]))
    (file,) = tmp_path.iterdir()
    whole, name = file.read_bytes(), file.stem
    assert functions._stored(name) == whole[functions.DIGEST :]
    assert functions.load([name])
    for damaged in (b"", whole[:100], whole[:-1] + b"x"):
        file.write_bytes(damaged)
        assert functions._stored(name) == b""
    assert not functions.load(["jaxsph_of_another_version"])


def test_without_llvmlite_the_forms_of_jax_are_used():
    code = (
        "import sys; sys.modules['llvmlite'] = None\n"
        "import conftest, jaxsph as js\n"
        "from jaxsph.core.native import forms\n"
        "assert not forms.available() and 'jaxsph[native]' in forms.advice()\n"
        "case = conftest.coarse('hydrostatic', {'output.snapshot_dt': 0.05})\n"
        "assert js.run(case, t1=0.02, progress=False, devices=1).series['time'].size\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=Path(__file__).parent
    )
    assert done.returncode == 0, done.stderr
