"""Random histories of a run's file: it always gives the right numbers, or a clear error."""

import contextlib
import os
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from conftest import coarse
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.case import case as case_module
from jaxsph.case.probes import make_probes
from jaxsph.errors import CaseError, FileError
from jaxsph.output.run_file import RunFile
from jaxsph.run import host
from jaxsph.run.devices import gather, share
from jaxsph.run.simulate import simulate_chunk

CHUNK = 0.02
"""Time between checkpoints, s: two samples."""
MOST = 5
"""Largest number of chunks of a run."""
CASE = coarse("hydrostatic", {"start.amplitude": 0.03, "output.snapshot_dt": CHUNK, "t1": MOST * CHUNK})
VISCOSITIES = (1e-6, 1e-2, 3e-2)
"""Values that change during a run; a change shows in the first sample after it."""


class Killed(BaseException):
    """Stands for a kill: nothing is done after it, except that copies in progress are removed."""


built = {}
chunks = {}


def build(case, sizes=None):
    """`build`, called once for every case; later calls return the same model and state."""
    key = (case.fluid.nu, case.start.amplitude, tuple(sorted((sizes or {}).items())))
    if key not in built:
        built[key] = js.build(case, sizes)
    return built[key]


def truth(history):
    """Series of a run with these viscosities in its chunks, without a file, and the state at its end."""
    if history not in chunks:
        if not history:
            return {}, build(CASE)[1]
        before, state = truth(history[:-1])
        case = CASE.replace({"fluid.nu": history[-1]})
        model, initial = build(case)
        every = round(case.output.sample_dt / float(model.dt))
        probes = make_probes(case, model, initial)
        # a run sums over copies of particles too, which changes the order of sums
        more, evened = share(model, state, 1)
        evened, found = simulate_chunk(more, evened, probes, 2 * every, every)
        state = gather(evened, len(initial.particles.id))
        found = {name: np.asarray(values) for name, values in found.items()}
        dt = case.output.sample_dt
        found["time"] = 2 * (len(history) - 1) * dt + np.arange(2) * dt
        joined = {name: np.concatenate([before[name], v]) if before else v for name, v in found.items()}
        chunks[history] = joined, state
    return chunks[history]


class Life:
    """A file, and the histories that it may have after what was done to it."""

    def __init__(self, folder):
        self.path, self.damaged = Path(folder) / "run.h5", False
        self.possible = set()  # histories of chunks

    def look(self):
        """History of the file's contents, and its present viscosity; None if the file reports damage."""
        try:
            run = RunFile.open(self.path)
            series, nu = run.series(), js.Case.from_dict(run.case_keys()).fluid.nu
            results, since, count = run.results(), run.since, run.snapshot_count
            run.checkpoint(), [run.snapshot(i) for i in range(count)]
        except FileError:
            assert self.damaged or not self.path.exists()
            return None
        n = len(series.get("time", ())) // 2
        fitting = [
            h
            for h in self.possible
            if len(h) == n and all(np.array_equal(series[k], v) for k, v in truth(h)[0].items())
        ]
        assert fitting, f"{n} chunks that no history explains"
        assert count == n
        history = fitting[0]
        changes = [k for k in range(1, n) if history[k] != history[k - 1]]
        expected = changes[-1] * CHUNK if changes else 0.0
        if n and nu != history[-1]:  # changed, but not continued yet
            expected = n * CHUNK
            assert not results, "results of before the change"
        # later than the last visible change if a change was undone before the run continued
        assert expected - 1e-9 <= since <= n * CHUNK + 1e-9
        if results:
            assert results["t_end"] == pytest.approx(n * CHUNK, rel=1e-6)
        return history, nu

    def run(self, nu, n, overwrite):
        """Starts a new run of n chunks."""
        self.possible |= {(nu,) * k for k in range(n + 1)}
        case = CASE.replace({"fluid.nu": nu})
        js.run(case, t1=n * CHUNK, out=self.path, overwrite=overwrite, progress=False, devices=1)
        return (nu,) * n

    def resume(self, n, nu=None):
        """Continues by n chunks, with another viscosity or the same."""
        found = self.look()
        if found is not None:
            history, now = found
            more = now if nu is None else nu
            self.possible |= {history + (more,) * k for k in range(n + 1)}
            n += len(history)
        changes = None if nu is None else {"fluid.nu": nu}
        js.resume(self.path, t1=n * CHUNK, changes=changes, progress=False, devices=1)

    def do(self, what):
        """Does one action; its only errors are those that name the file or a field."""
        try:
            if what[0] == "run":
                self.run(*what[1:])
            elif what[0] == "resume":
                self.resume(*what[1:])
            elif what[0] == "refused":
                self.refused(what[1])
            elif what[0] == "kill":
                self.kill(*what[1:])
            elif what[0] == "second":
                self.second(*what[1:])
            elif what[0] == "damage":
                self.damage(*what[1:])
        except (FileError, CaseError) as error:
            assert str(self.path) in str(error) or "t1 = " in str(error)
        self.look()

    def refused(self, t1):
        """A run and a change that are refused leave every byte as it was."""
        before = self.contents()
        for attempt in (
            lambda: js.run(CASE, t1=t1, out=self.path, overwrite=True, progress=False),
            lambda: js.resume(self.path, t1=t1, changes={"fluid.nu": 0.05}, progress=False),
        ):
            with pytest.raises((CaseError, FileError)):
                attempt()
        assert self.contents() == before

    def kill(self, name, call, what):
        """An action that is killed at call number `call` of the function `os.name`."""
        real, left = getattr(os, name), [call]

        def kill(*arguments):
            left[0] -= 1
            if left[0] == 0:
                raise Killed
            return real(*arguments)

        with (
            mock.patch.object(os, name, kill),
            mock.patch.object(host, "_one_file", lambda file: contextlib.nullcontext()),
            contextlib.suppress(Killed),
        ):
            self.do(what)

    def second(self, at, what, first):
        """Another action begins and ends while the first is in its chunk `at`."""
        left = [at]

        def chunk(*arguments, **named):
            left[0] -= 1
            if left[0] == 0:
                self.do(what)
            return simulate_chunk(*arguments, **named)

        with mock.patch.object(host, "simulate_chunk", chunk):
            self.do(first)

    def damage(self, which, share, bits):
        """Flips some bits of one byte in one of the files."""
        path = self.path.with_name(self.path.name + which)
        if path.exists():
            content = bytearray(path.read_bytes())
            content[int(share * (len(content) - 1))] ^= bits
            path.write_bytes(content)
            self.damaged = True

    def contents(self):
        return {path.name: path.read_bytes() for path in self.path.parent.iterdir()}


VISCOSITY = st.sampled_from(VISCOSITIES)
LENGTH = st.integers(1, 2)
RUN = st.tuples(st.just("run"), VISCOSITY, st.integers(1, 3), st.booleans())
RESUME = st.tuples(st.just("resume"), LENGTH, st.none() | VISCOSITY)
WHOLE = RUN | RESUME | RESUME
CALLS = st.tuples(st.sampled_from(["replace", "fsync"]), st.integers(1, 12))
STEP = (
    WHOLE
    | RESUME
    | st.tuples(st.just("refused"), st.sampled_from([-3.0, 0.0, float("nan"), float("inf")]))
    | st.tuples(st.just("kill"), CALLS, WHOLE).map(lambda s: (s[0], *s[1], s[2]))
    | st.tuples(st.just("second"), st.integers(1, 3), WHOLE, WHOLE)
    | st.tuples(
        st.just("damage"),
        st.sampled_from(["", "", ".journal", ".checkpoint"]),
        st.floats(0.0, 1.0),
        st.integers(1, 255),
    )
)
SEQUENCE = st.tuples(RUN.map(lambda s: (*s[:3], True)), st.lists(STEP, min_size=2, max_size=6))


def live(sequence):
    """Applies a sequence of actions to one file, and checks the file after each action."""
    first, others = sequence
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(case_module, "build", build),
    ):
        life = Life(folder)
        for what in (first, *others):
            life.do(what)


LENIENT = {"deadline": None, "suppress_health_check": list(HealthCheck), "print_blob": True}


@settings(max_examples=8, derandomize=True, **LENIENT)
@given(SEQUENCE)
def test_whatever_happens_to_a_file_it_is_right_or_says_so(sequence):
    live(sequence)


@pytest.mark.slow
@settings(max_examples=500, **LENIENT)
@given(SEQUENCE)
def test_five_hundred_lives_of_a_file(sequence):
    live(sequence)
