"""Border between a coarse flume and the water of spacing dx: waves that pass it, files, and refusals."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsph as js
from jaxsph.core.pairs import Smoothing
from jaxsph.model.state import Failure
from jaxsph.output.run_file import RunFile
from jaxsph.parts.border import flume_of
from jaxsph.run.chunks import advance_chunk, with_settings_of
from jaxsph.run.scene import scene_of
from jaxsph.schemes.kernels import KERNEL

CASE = {
    "name": "border",
    "dx": 0.04,
    "t1": 1.2,
    "scheme": {"kind": "incompressible"},
    "tank": {"length": 2.4, "depth": 0.4},
    "flume": {"length": 0.8, "factor": 2},
    "start": {"amplitude": 0.02, "mode": 2},
    "probes": {"gauges": [0.24, 1.08, 1.16, 2.28]},
    "output": {"sample_dt": 0.02, "snapshot_dt": 0.2},
}
K = 2 * np.pi / 2.4
OMEGA = np.sqrt(9.81 * K * np.tanh(0.4 * K))


def linear(t):
    """Elevations of the linear standing wave at the gauges at the times t (s), m, `[T, G]`."""
    return 0.02 * np.outer(np.sin(OMEGA * t), np.cos(K * np.array(CASE["probes"]["gauges"])))


@pytest.fixture(scope="module")
def wave(tmp_path_factory):
    """Solution of a standing wave across the border, and the file of its run."""
    path = tmp_path_factory.mktemp("border") / "wave.h5"
    return js.run(js.Case.from_dict(CASE), out=path, progress=False), path


def test_a_standing_wave_passes_the_border(wave):
    """Over a period the wave has the elevation of linear theory on both sides, to a tenth of its height: the
    steepness is 0.05, and the gauges take means over three spacings."""
    solution, _ = wave
    assert abs(solution["eta"] - linear(solution.t)).max() < 0.1 * 0.04


def test_the_zones_agree_where_they_overlap(wave):
    """The gauge on the flume's side of the middle of the overlap deviates from linear theory like the one
    behind it, to a tenth of the wave's height: the flume has five rows of particles."""
    apart = (wave[0]["eta"] - linear(wave[0].t))[:, 1:3]
    assert abs(apart[:, 0] - apart[:, 1]).max() < 0.1 * 0.04


def test_the_border_keeps_the_energy_balance(wave):
    """The ledger of the water behind the border closes with the work of the border."""
    assert abs(wave[0].results["energy_residual_share"]) < 1e-3


def test_particles_of_both_zones_are_drawn(wave):
    """Snapshots contain both zones, each particle with its own number, from end to end of the tank."""
    solution, path = wave
    snapshot, fine = RunFile.open(path).snapshot(-1), len(solution.state.particles.id)
    flume, state = flume_of(solution.model, solution.state)
    assert len(snapshot["x"]) == fine + len(state.particles.id) == len(np.unique(snapshot["id"]))
    assert snapshot["x"][:fine, 0].min() > 0.7 and 1.3 < snapshot["x"][fine:, 0].max() < 1.5
    assert scene_of(js.Case.from_dict(CASE).problem())["low"][0] == 0.0
    assert float(flume.dx) == pytest.approx(2 * float(solution.model.dx))


def test_a_resumed_run_continues_both_zones(wave, tmp_path):
    """A run that stops and continues ends in the same state as one that does not stop."""
    path = tmp_path / "short.h5"
    js.run(js.Case.from_dict(CASE), out=path, t1=0.6, progress=False)
    again = js.resume(path, t1=1.2, progress=False)
    np.testing.assert_array_equal(again["eta"], wave[0]["eta"])
    _, flume = flume_of(again.model, again.state)
    _, whole = flume_of(wave[0].model, wave[0].state)
    np.testing.assert_array_equal(flume.particles.x, whole.particles.x)


def test_tables_of_the_flume_grow_in_a_run(wave):
    """A chunk in which the flume's tables overflow is computed again with larger ones, as other water is, and
    a failure of the flume that tables do not explain ends the run."""
    solution, said = wave[0], []
    model, flume = solution.model, solution.model.moving[0].flume
    needed = flume.search.capacity + 20

    def failing(failure):
        def advance(now):
            full = failure is Failure.NON_FINITE or flume_of(now, solution.state)[0].search.capacity < needed
            status = solution.state.parts["border"].flume.status
            status = eqx.tree_at(lambda s: s.bits, status, jnp.int32(failure if full else 0))
            status = eqx.tree_at(lambda s: s.most["capacity"], status, jnp.int32(needed))
            return eqx.tree_at(lambda s: s.parts["border"].flume.status, solution.state, status), {}

        return advance

    grown, *_ = advance_chunk(model, failing(Failure.NEIGHBOUR_OVERFLOW), said.append, "flume", {})
    assert flume_of(grown, solution.state)[0].search.capacity >= needed and len(said) == 1
    assert with_settings_of(model, grown).moving[0].flume.search.capacity >= needed
    with pytest.raises(js.SimulationError, match="a value is no longer finite"):
        advance_chunk(model, failing(Failure.NON_FINITE), said.append, "flume", {})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"scheme.kind": "weakly_compressible"},
            r"flume.length = 0.8 m: a flume cannot be combined with a scheme",
        ),
        ({"flume.length": 0.82}, r"flume.length = 0.82 m: must be a whole number.*use 0.8 m"),
        ({"flume.length": 0.4}, r"flume.length = 0.4 m: must be at least ten spacings of the flume, 0.8 m"),
        ({"flume.length": 1.76}, r"flume.length = 1.76 m: the flume overlaps.*use at most 1.44 m"),
        ({"tank.depth": 0.36}, r"flume.factor = 2: the depth of 0.36 m is not a whole number"),
        ({"probes.pressure": [[0.3, 0.1]]}, r"probes.pressure\[0\] = \[0.3, 0.1\] is in the flume"),
        ({"flume.factor": 1}, r"flume.factor = 1: must be greater than or equal to 2"),
        (
            {"solid.step.block": {"low": [1.6, 0.0], "high": [2.4, 0.12]}},
            r"flume.length = 0.8 m: the flume overlaps.*before the first solid.*at 1.6 m",
        ),
    ],
)
def test_flumes_that_do_not_fit_are_refused(changes, message):
    """The error names the flume's key, its value, and what fits."""
    with pytest.raises(js.CaseError, match=message):
        js.Case.from_dict(CASE).replace(changes)


def test_slopes_through_the_time_loop_are_refused():
    """Filters of tangents act on the water behind the border only."""
    changes = {"waves": {"H": 0.02, "T": 1.2}, "start": None}
    assert "flume" in js.Case.from_dict(CASE).replace(changes).roughness("waves.H")


def test_images_in_a_far_end_that_moves():
    """Particles are mirrored in the displaced face, also in the corner with the bed; the near end rests."""
    smoothing = Smoothing(KERNEL[2], jnp.float32(0.06))
    box = js.Box((0.0, 0.0), (1.0, 0.8), stroke=0.2, far_moves=True)
    walls = js.Ghosts.build(box, 0.05, smoothing, js.FreeSlip())
    assert not walls.paddle and walls.far_end == walls.images.far_end
    x = jnp.array([[0.97, 0.03], [0.02, 0.5]], jnp.float32)

    def moved(x):
        return jnp.where(x[:, :1] < 0.5, x, x.at[:, 0].add(0.01))

    for one in walls.images.sets:
        seen = np.asarray(one.image(x, moved))
        for plane in one.planes:
            face = plane.at + (0.01 if plane.moves else 0.0)
            if plane.axis == 0 and plane.side < 0:
                assert seen[0, 0] == pytest.approx(2 * face - 0.97, abs=1e-6)
            if plane.axis == 0 and plane.side > 0:
                assert seen[1, 0] == pytest.approx(-0.02, abs=1e-6)
    with pytest.raises(ValueError, match="needs MirrorImages"):
        js.Ghosts.build(box, 0.05, smoothing, js.FreeSlip(), filling=js.DummyParticles())
