"""Measures where the wall time of a time step goes, from XLA's trace of the operations that it executes.

Every operation of the compiled steps is labelled with the part of the step to which it belongs: see
`core.parts`.
"""

from __future__ import annotations

import collections
import re
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.profiler import ProfileData, ProfileOptions

from jaxsph.core.parts import ITERATION, Part
from jaxsph.core.programs import without_cache
from jaxsph.errors import CaseError
from jaxsph.model.state import State
from jaxsph.problem.sources import source_of
from jaxsph.run.devices import everywhere, find_devices, share, usual_devices
from jaxsph.run.host import load_start
from jaxsph.run.recorder import Start, recording_time
from jaxsph.run.simulate import new_program

ENOUGH = 0.5
"""Wall time of the traced steps, s, unless a single sample takes longer."""
MOST = 8
"""Largest number of traced samples; the trace of a sample can have a hundred thousand operations."""
REPEATS = 3
"""Number of measurements of which the fastest counts."""
REST = "rest of the step"
"""Name under which the operations that belong to no part are reported."""


class Share(NamedTuple):
    """Share of a part in a time step."""

    seconds: float
    """Wall time per time step, s."""
    iterations: float
    """Iterations of the pressure solver per time step (-)."""


class Profile(NamedTuple):
    """Wall time of a time step by part, and of the compilation of the steps."""

    particles: int
    """Number of particles of water."""
    devices: int
    """Number of devices that share the run."""
    step: float
    """Wall time per time step, s, without tracing."""
    parts: dict[str, Share]
    """Share of each part, the largest first; the wall times add up to `step`."""
    loops: float
    """Wall time of the native loops, which are sums over neighbours and searches, s per time step."""
    recording: float
    """Wall time for recording samples and a snapshot in a file, s per time step, in addition to `step`."""
    lowering: float
    """Wall time for converting the steps into a program for XLA, s."""
    compilation: float
    """Wall time that XLA takes to compile this program without the cache on disk, s."""
    slowdown: float
    """Ratio of the wall time with tracing to that without (-); the parts are corrected for it."""


class _Operation(NamedTuple):
    """Operation that a device has executed, or an operation that contains others."""

    name: str
    start: float
    end: float


def profile(given: Any, devices: int | None = None) -> Profile:
    """Measures the wall time of a time step by part: neighbour search, pressure solver, probes and so on.

    `given`: a case, a problem, a function that returns a problem, or the path of a run's file; a case is
    measured from its first step on, where the pressure solver needs fewer iterations than in waves, and a
    file from its last checkpoint on. `devices`: as for `run`. The steps are compiled without the cache on
    disk. **Raises** CaseError, as `run`, and on an accelerator; FileError, as `resume`.
    """
    find_devices(devices)
    if jax.default_backend() != "cpu":
        raise CaseError(
            "profile measures the parts of a step on CPUs only; set JAX_PLATFORMS=cpu, or trace a run on the "
            "accelerator with jax.profiler"
        )
    start = load_start(given) if isinstance(given, str | Path) else _first(given)
    problem = start.problem
    model, state = share(start.model, start.state, devices or usual_devices(start.model, start.state))
    probes, every = everywhere(model.search.slabs, problem.probes), problem.sample_every
    arguments = model, state, probes, problem.per_chunk, every
    began = time.perf_counter()
    lowered = new_program(model).lower(*arguments, jnp.int32(every))
    compiling = time.perf_counter()
    with without_cache():
        compiled = lowered.compile()
    ready = time.perf_counter()

    def advance(state: State, samples: int) -> tuple[State, dict[str, jax.Array]]:
        """State and readings after a number of samples."""
        return jax.block_until_ready(compiled(model, state, probes, jnp.int32(samples * every)))

    def take(samples: int) -> float:
        """Wall time (s) of the steps of a number of samples."""
        began = time.perf_counter()
        advance(first[0], samples)
        return time.perf_counter() - began

    first = advance(state, 1)  # from here on, the solver starts from an earlier solution
    samples = max(1, min(int(ENOUGH / take(1)), problem.per_chunk // every, MOST))
    plain = min(take(samples) for _ in range(REPEATS))
    # the first trace of a process is slower than the others
    traced, trace = min((_traced(lambda: take(samples)) for _ in range(1 + REPEATS)), key=lambda one: one[0])
    lines = _executed(trace)
    count, steps = model.search.slabs.count, samples * every
    delay = max(traced - plain, 0.0) * 1e9 * count / sum(map(len, lines))
    text = compiled.as_text()
    return Profile(
        len(start.state.particles.id),
        count,
        plain / steps,
        _shares(lines, _scopes(text), delay, plain / steps, steps * count),
        _loops(lines, text) / (steps * count),
        recording_time(start, [first, advance(first[0], 1)]),
        compiling - began,
        ready - compiling,
        traced / plain,
    )


def _first(given: Any) -> Start:
    """Starting point of a run from its beginning."""
    source = source_of(given)
    return Start(source, source.problem())


def _traced(call: Callable[[], float]) -> tuple[float, Any]:
    """Result of a call, and its trace."""
    options = ProfileOptions()
    options.python_tracer_level, options.host_tracer_level = 0, 2
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder, profiler_options=options):
            found = call()
        (path,) = Path(folder).rglob("*.xplane.pb")
        return found, ProfileData.from_file(str(path))


def _executed(trace: Any) -> list[list[_Operation]]:
    """Operations that each thread has executed, for all threads that have executed any."""
    lines = [
        [
            _Operation(name, e.start_ns, e.start_ns + e.duration_ns)
            for e in line.events
            if (name := dict(e.stats).get("hlo_op"))
        ]
        for plane in trace.planes
        for line in plane.lines
    ]
    return [line for line in lines if line]


def _scopes(program: str) -> dict[str, list[str]]:
    """Scopes in which the operations of a compiled program were traced, from the outside inwards."""
    return {
        found[1]: found[2].split("/")
        for found in re.finditer(r'^\s*(?:ROOT )?%?([\w.-]+) = .*op_name="([^"]*)"', program, re.MULTILINE)
    }


def _loops(lines: list[list[_Operation]], program: str) -> float:
    """Wall time of the native loops in all threads together, s; the median of a loop's executions counts."""
    names = set(re.findall(r'%?([\w.-]+) = .*custom_call_target="jaxsph_', program))
    took: dict[str, list[float]] = collections.defaultdict(list)
    for operation in (operation for line in lines for operation in line if operation.name in names):
        took[operation.name].append(operation.end - operation.start)
    return 1e-9 * sum(len(times) * statistics.median(times) for times in took.values())


def _nested(line: list[_Operation]) -> Iterator[tuple[_Operation, int | None]]:
    """Operations of a thread in order of start, each with the number of the operation that contains it."""
    around: list[tuple[int, float]] = []
    for number, operation in enumerate(sorted(line, key=lambda one: (one.start, -one.end))):
        while around and operation.start >= around[-1][1]:
            around.pop()
        yield operation, around[-1][0] if around else None
        around.append((number, operation.end))


def _shares(
    lines: list[list[_Operation]], scopes: dict[str, list[str]], delay: float, step: float, steps: int
) -> dict[str, Share]:
    """Shares of the parts in a step, the largest first.

    An operation belongs to the part in whose scope it was traced, or else to the part of the operation that
    contains it, such as a loop. The median of an operation's executions counts, and the median of the gaps
    between the operations in a loop, so that other processes on the machine distort the shares little.
    **Arguments**: the operations of each thread; the scopes of each operation; `delay`: time that tracing
    adds to an operation for each operation that it contains, ns; `step`: wall time of a step without tracing,
    s; `steps`: number of traced steps, times the number of devices.
    """
    names = {part.value for part in Part}
    gaps: dict[tuple[str, str], list[float]] = collections.defaultdict(list)
    took: dict[tuple[str, str], list[float]] = collections.defaultdict(list)
    runs: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    for line in lines:
        placed = list(_nested(line))
        parts: list[str] = []
        reached = [operation.start for operation, _ in placed]  # end of the last operation contained
        for operation, outer in placed:
            path = scopes.get(operation.name, [])
            above = REST if outer is None else parts[outer]
            part = next((scope for scope in path if scope in names), above)
            parts.append(part)
            if outer is not None:
                gaps[above, placed[outer][0].name].append(operation.start - reached[outer])
                reached[outer] = operation.end
            if ITERATION in path and "while" not in path[path.index(ITERATION) :]:
                runs[part][operation.name] += 1
        for (operation, _), part, since in zip(placed, parts, reached, strict=True):
            took[part, operation.name].append(operation.end - since)
    own: dict[str, float] = collections.defaultdict(float)
    for (part, _), idle in gaps.items():
        own[part] += len(idle) * max(statistics.median(idle) - delay, 0.0)
    for (part, _), busy in took.items():
        own[part] += len(busy) * statistics.median(busy)
    scale = step / sum(own.values())
    return {
        part: Share(scale * seconds, max(runs[part].values(), default=0) / steps)
        for part, seconds in sorted(own.items(), key=lambda one: -one[1])
    }
