"""Coarse cases and compiled functions shared by the tests: compiling takes longer than running them."""

import atexit
import collections
import contextlib
import os
import shutil
import signal
import tempfile
import time

if "PYTEST_XDIST_WORKER" not in os.environ and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    # One cache for all workers, commands and notebooks of this run, so that every program is compiled once.
    os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="jaxsph_tests_")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    atexit.register(shutil.rmtree, os.environ["JAX_COMPILATION_CACHE_DIR"], ignore_errors=True)

import equinox as eqx
import hypothesis
import jax
import jax.monitoring
import jax.numpy as jnp
import pytest

import jaxsph as js
from jaxsph.core import programs
from jaxsph.output.run_file import RunFile
from jaxsph.run.simulate import simulate as simulate_
from jaxsph.schemes.air import couple_airs
from jaxsph.schemes.step import at_rest

# no deadline: a test must not fail because the machine is loaded
hypothesis.settings.register_profile("jaxsph", deadline=None)
hypothesis.settings.load_profile("jaxsph")

FIRST = ("test_notebooks.py", "test_processes.py", "test_compilations.py")
"""Files with few tests that take minutes. If one of them started last, the other worker would be idle."""


def pytest_collection_modifyitems(items):
    """Sorts files: first `FIRST`, then by number of tests. The tests of a file stay together."""
    count = collections.Counter(item.path for item in items)
    items.sort(key=lambda item: (item.path.name not in FIRST, -count[item.path], item.path))


COARSE = {
    "hydrostatic": {"dx": 0.1, "probes.gauges": [0.2, 0.8]},
    "hydrostatic_3d": {"dx": 0.125, "tank.width": 0.5, "probes.pressure": None},
    # With eight particles across a vessel, artificial viscosity keeps the lattice ordered.
    "vessel": {
        "dx": 0.04,
        "device.wall_thickness": 0.04,
        "scheme.kind": "weakly_compressible",
        "scheme.alpha": 0.02,
    },
    "owc": {
        "dx": 0.04,
        "tank.length": 2.4,
        "device.wall_thickness": 0.04,
        "scheme.kind": "weakly_compressible",
        "probes": {"gauges": [0.8, 1.0, 1.2, 1.5], "pressure": [[2.38, 0.3]]},
    },
    "wave_tank": {"dx": 0.05, "device": None},
}
"""Changes with which a step of a built-in case takes milliseconds."""


@contextlib.contextmanager
def compilations():
    """Context with a list that grows by one with every compilation of the program."""
    found = []

    def listen(event, duration, **_):
        if event == "/jax/core/compile/backend_compile_duration":
            found.append(duration)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield found
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def enable_x64():
    """Context in which arrays are float64; its place in jax differs between the supported versions."""
    if hasattr(jax, "enable_x64"):
        return jax.enable_x64(True)
    from jax.experimental import enable_x64 as older

    return older()


def coarse(name, changes=None):
    """A built-in case on a coarse lattice."""
    return js.load_case(name.removesuffix("_3d")).replace(COARSE[name] | (changes or {}))


def airs_of(model, state):
    """State prepared for a step, and the couplings of its chambers' air by name; to be jitted."""
    scheme = model.scheme
    state, tables = scheme.prepare(model, state)
    ghosts = scheme.ghosts(model, state, tables, at_rest(model, state))
    sources = scheme.sources(ghosts, ghosts.u) if isinstance(scheme, js.DeltaSPH) else ghosts.water
    return state, couple_airs(scheme, model, state.particles, sources, tables, state.parts)


_advance = jax.jit(simulate_, static_argnames=("n_steps", "sample_every"))


def advance(case, model, state, samples):
    """Returns (state, readings) after `samples` samples, with the case's own probes."""
    every = round(case.output.sample_dt / float(model.dt))
    return _advance(
        model,
        state,
        n_steps=samples * every,
        probes=js.make_probes(case, model, state),
        sample_every=every,
    )


def exact_and_difference(case, key, of="energy_pto", share=1e-5):
    """Exact slope of a result over a key of a case, and that from two runs with the value `share` off."""
    value = case.value(key)
    exact = js.derivative(case, key, of=of, method=js.Exact()).slope
    step = share * value

    def result(x):
        return js.run(case.replace({key: x}), progress=False).results[of]

    return exact, (result(value + step) - result(value - step)) / (2 * step)


def kill_with_two_checkpoints(process, path):
    """Kills a run (SIGKILL) after its second checkpoint, so that a checkpoint has been replaced once."""
    try:
        deadline = time.monotonic() + 240.0
        while time.monotonic() < deadline and process.poll() is None:
            if path.exists() and RunFile.open(path).progress() and RunFile.open(path).snapshot_count >= 2:
                break
            time.sleep(0.02)
        os.kill(process.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    finally:
        process.kill()
        process.wait()


def shaken(state, dx, rng, share):
    """The state with every particle moved along each axis by up to `share` of the spacing."""
    move = share * dx * rng.uniform(-1.0, 1.0, state.particles.x.shape)
    return eqx.tree_at(lambda s: s.particles.x, state, state.particles.x + jnp.float32(move))


def with_velocity(state, u):
    """The state with the velocities `u`, broadcast to all particles."""
    old = state.particles.u
    return eqx.tree_at(lambda s: s.particles.u, state, jnp.broadcast_to(jnp.asarray(u, old.dtype), old.shape))


@pytest.fixture(autouse=True, scope="module")
def forget_programs():
    """Clears compiled programs in time: each adds memory maps, and a compilation aborts at their limit."""
    yield
    programs.forget_programs()


def _built(name):
    case = coarse(name)
    return case, *js.build(case)


@pytest.fixture(scope="session")
def hydrostatic():
    """(case, model, state) of a square tank of 10 by 10 particles."""
    return _built("hydrostatic")


@pytest.fixture(scope="session")
def hydrostatic_3d():
    """(case, model, state) of a tank of 8 x 4 x 8 particles."""
    return _built("hydrostatic_3d")


@pytest.fixture(scope="session")
def vessel():
    """(case, model, state) of the communicating vessels under 1000 Pa."""
    return _built("vessel")


# --- in a browser

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip

# Addresses that a page may request: itself, and the server of a watched run.
OWN = ("file:", "data:", "blob:", "http://127.0.0.1")
# What Chromium says about every picture by WebGL that it draws without a graphics card.
SOFTWARE = "GPU stall due to ReadPixels"

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")


@pytest.fixture(scope="module")
def browser():
    """Chromium without a graphics card."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as library:
        opened = library.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def visit(browser):
    """Opens a page, and fails if its console has an error or a warning, or if it requests another file."""
    pages, wrong = [], []

    def opened(address, **options):
        page = browser.new_page(**{"viewport": {"width": 1200, "height": 900}, **options})
        pages.append(page)
        page.on(
            "console",
            lambda told: (
                wrong.append(told.text)
                if told.type in ("error", "warning") and SOFTWARE not in told.text
                else None
            ),
        )
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda asked: None if asked.url.startswith(OWN) else wrong.append(asked.url))
        page.goto(str(address) if str(address).startswith("http") else f"file://{address}")
        if not str(address).startswith("http"):
            page.evaluate("jaxsph.ready")
        return page

    yield opened
    for page in pages:
        page.close()
    assert not wrong
