"""Added mass, damping and excitation: extraction from series, hydrostatics, cases, files, a whole study."""

import dataclasses

import capytaine
import h5py
import hypothesis.strategies as st
import numpy as np
import pytest
import xarray
from capytaine.io.xarray import merge_complex_values
from hypothesis import given, settings
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.analysis import coefficients as theory
from jaxsph.analysis.coefficients import BodyAtRest, Coefficients, LinearCoefficients, Mode
from jaxsph.case.geometry import Geometry
from jaxsph.case.held import check_period, find_modes, forced, in_waves, reference
from jaxsph.case.hydrostatics import at_rest, buoyancy_stiffness
from jaxsph.case.linear_radiation import linear_coefficients
from jaxsph.case.speeds import wavenumber
from jaxsph.cli.app import app
from jaxsph.cli.coefficients import _doubts, _rows
from jaxsph.study.coefficients import _Study

BOX = js.load_case("box_in_waves")

# --- extraction


@settings(max_examples=40)
@given(
    A=st.floats(1.0, 100.0),
    B=st.floats(0.1, 300.0),
    C=st.floats(0.0, 5000.0),
    T=st.floats(0.8, 3.0),
    phase=st.floats(-3.0, 3.0),
    drift=st.floats(-0.5, 0.5),
)
def test_known_added_mass_and_damping_are_found(A, B, C, T, phase, drift):
    """From means over samples, with a constant force, a drift and a second harmonic.

    The drift is fitted with both harmonics, so that rounding alone remains: 1e-6 of the largest term.
    """
    omega, dt = 2.0 * np.pi / T, T / 50
    t = dt * np.arange(8 * 50 + 1)
    fine = np.linspace(-dt, 0.0, 201)  # the mean over a sample, by Simpson's rule

    def force(t):
        moved = 0.01 * np.exp(1j * (omega * t + phase))
        return np.real((omega**2 * A - 1j * omega * B - C) * moved) + 50.0 + drift * t + np.cos(2 * omega * t)

    weights = np.r_[1.0, np.tile([4.0, 2.0], 99), 4.0, 1.0] / 600.0
    means = np.array([weights @ force(one + fine) for one in t])
    moved = 0.01 * np.cos(omega * t + phase)
    F, xi = (theory.harmonics(t, y, T, 5) for y in (means, moved))
    assert F.shape == (5,)
    found = theory.added_mass_and_damping(theory.of_means(F, omega, dt) / xi, omega, C)
    size = omega**2 * A + omega * B + C + 1e2  # 1e2: the other terms over the motion of 0.01 m
    for value, right, power in zip(found, (A, B), (2, 1), strict=True):
        assert np.allclose(value, right, rtol=0.0, atol=1e-6 * size / omega**power)


def test_spread_is_that_of_the_noise():
    """White noise of 0.1 N in 50 samples a period scatters an amplitude by 0.1 sqrt(4 / 50) N."""
    rng, T = np.random.default_rng(1), 1.3
    t = T / 50 * np.arange(400 * 50 + 1)
    y = 2.0 * np.cos(2 * np.pi / T * t) + 0.1 * rng.standard_normal(t.size)
    mean, spread = theory.with_spread(theory.harmonics(t, y, T, 400))
    # the standard error of 400 periods, and of their standard deviation, is below 4 %
    assert abs(mean - 2.0) < 5 * spread / 20
    assert spread == pytest.approx(0.1 * np.sqrt(4 / 50), rel=0.15)
    assert np.isnan(theory.with_spread(np.ones(1))[1])


def test_the_wave_from_the_paddle_is_separated_from_the_wave_of_the_body():
    k, gauges = 3.2, np.array([1.0, 1.1, 1.3, 1.6])
    there = 0.02 * np.exp(0.3j - 1j * k * gauges) + 0.008 * np.exp(1.1j + 1j * k * gauges)
    found = theory.incident_at(np.stack([there, 2.0 * there], axis=1), gauges, k, 2.5)
    assert found == pytest.approx(np.array([1.0, 2.0]) * 0.02 * np.exp(0.3j - 1j * k * 2.5))
    assert theory.worst_separation(gauges, k) < 3.0 < theory.worst_separation([1.0, 1.01, 1.02], k)


# --- the body at rest


def test_hydrostatics_of_a_box_are_exact():
    """C_55 = rho g (b^3 / 12 + b d (z_b - z_p)) - m g (z_g - z_p), about a pivot beside the middle."""
    case = BOX.replace({"body.pivot": [3.05, 0.36], "body.inertia": 1.0})
    body = at_rest(case, Geometry.of(case), "body", 3.05)
    rho_g, b, d, m, off = 9810.0, 0.3, 0.1, 30.0, 0.1
    C_55 = rho_g * (b**3 / 12 + b * off**2 + b * d * (0.35 - 0.36)) - m * 9.81 * (0.4 - 0.36)
    right = [[0, 0, 0], [0, rho_g * b, -rho_g * b * off], [0, -rho_g * b * off, C_55]]
    assert body.stiffness == pytest.approx(np.array(right), abs=1e-9)
    M = [[m, 0, m * 0.04], [0, m, -m * off], [m * 0.04, -m * off, 1.0]]
    assert body.inertia == pytest.approx(np.array(M))
    assert body.pivot == pytest.approx((0.0, -0.04)) and body.centre == pytest.approx((0.1, 0.0))
    assert body.buoyancy == pytest.approx((0.1, -0.05)) and body.area == pytest.approx(0.03)


@settings(max_examples=30)
@given(theta=st.floats(-1e-3, 1e-3), x=st.floats(-0.2, 0.2), z=st.floats(-0.2, 0.2))
def test_buoyancy_stiffness_is_the_change_of_the_force(theta, x, z):
    """Of a trapezium turned by theta about a pivot, by cutting its turned outline at the still water."""
    import shapely

    corners, pivot = np.array([[-0.2, -0.15], [0.15, -0.1], [0.3, 0.2], [-0.25, 0.2]]), np.array([x, z])
    C = buoyancy_stiffness(shapely.Polygon(corners), 0.0, pivot, 1.0)

    def force(angle):
        c, s = np.cos(angle), np.sin(angle)
        r = corners - pivot
        turned = pivot + np.stack([c * r[:, 0] + s * r[:, 1], c * r[:, 1] - s * r[:, 0]], 1)
        wet = shapely.Polygon(turned).intersection(shapely.box(-9, -9, 9, 0))
        return np.array([0.0, wet.area, -wet.area * (wet.centroid.x - x)])

    change = 0.5 * (force(theta) - force(-theta))
    # the change of the moments of a section of this size is linear to theta^3
    assert change == pytest.approx(-C[:, 2] * theta, abs=1e-9)


def test_a_submerged_body_has_no_waterplane():
    case = BOX.replace({"body.block": {"low": [3.0, 0.1], "high": [3.3, 0.2]}})
    body = at_rest(case, Geometry.of(case), "body", 3.0)
    assert np.all(body.stiffness[:2] == 0.0) and body.area == pytest.approx(0.03)


# --- cases


def test_modes_are_the_free_motions_and_those_of_the_carrier():
    assert find_modes(js.load_case("buoy_heave")) == (Mode("body", "heave"),)
    assert [mode.motion for mode in find_modes(js.load_case("flap_2d"))] == ["pitch"]
    raft = find_modes(js.load_case("raft"))
    assert len(raft) == 6 and {mode.body for mode in raft} == {"fore", "aft"}
    inclined = BOX.replace({"body.free": ["surge"], "body.incline": 0.5})
    assert [mode.motion for mode in find_modes(inclined)] == ["surge", "heave"]
    assert find_modes(BOX, ["pitch", "surge"]) == (Mode("body", "surge"), Mode("body", "pitch"))


def test_one_motion_is_given_and_everything_else_is_held():
    case = js.load_case("raft")
    T, mode = 1.2, find_modes(case)[2]
    run = forced(case, mode, T, js.Forcing(amplitude=0.012))
    moving, held = run.bodies[mode.body], run.bodies["aft"]
    assert moving.motion.amplitude[:2] == (0.0, 0.0) and moving.motion.period == T
    pivot = np.array(moving.pivot or np.mean([moving.block.low, moving.block.high], axis=0))
    under = [[x, moving.block.low[1]] for x in (moving.block.low[0], moving.block.high[0])]
    farthest = np.max(np.hypot(*(np.array(under) - pivot).T))
    assert moving.motion.amplitude[2] * farthest == pytest.approx(0.012)
    assert not any(held.motion.amplitude) and not held.free and held.joined_to is None and not run.link
    assert run.waves.H < 1e-5 and run.waves.absorption and run.sponge == case.sponge
    waves = in_waves(case, find_modes(case), T, js.Forcing())
    assert waves.waves.H == case.waves.H and not any(
        any(one.motion.amplitude) for one in waves.bodies.values()
    )
    for one in (run, waves):
        assert one.t1 / T == pytest.approx(round(one.t1 / T)) and one.output.periods == 5


def test_amplitude_is_a_tenth_of_the_draught_or_half_a_spacing():
    for dx, size in ((0.01, 0.01), (0.02, 0.01), (0.05, 0.025)):
        case = BOX.replace({"dx": dx})
        heave, pitch = (forced(case, Mode("body", one), 1.2, js.Forcing()) for one in ("heave", "pitch"))
        assert heave.body.motion.amplitude == pytest.approx((0.0, size, 0.0))
        assert pitch.body.motion.amplitude[2] == pytest.approx(size / np.hypot(0.15, 0.1))


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"body": None}, {}, "there is no body"),
        ({"body.free": [], "body.mass": 30.0}, {}, r"no body has a free motion: give body.free"),
        (
            {"tank.width": 0.4, "body": {"block": {"low": [3, 0, 0.3], "high": [3.3, 0.4, 0.5]}}},
            {},
            "tank.width",
        ),
        ({}, {"motions": ["sway"]}, "must be one of surge, heave, pitch"),
        ({}, {"motions": {"buoy": ["heave"]}}, "there is no such body; choose from body"),
        ({}, {"motions": []}, "no motion is requested"),
        ({}, {"periods": [0.3]}, "less than 20 spacings"),
        ({}, {"periods": [4.0]}, "more than twice sponge.length"),
        ({"body.block": {"low": [0.7, 0.3], "high": [1.0, 0.5]}}, {}, "move the bodies away from the paddle"),
        (
            {"sponge": None, "body.block": {"low": [1.1, 0.3], "high": [1.4, 0.5]}},
            {"periods": [6.0]},
            "separate",
        ),
        ({}, {"periods": []}, "at least one positive"),
        ({}, {"periods": ["a"]}, "at least one positive"),
        ({}, {"periods": [1.2, 1.2]}, "each period once"),
        ({}, {"out": "here.txt"}, "must end in .nc"),
    ],
)
def test_impossible_studies_are_refused_before_a_run(changes, options, words, tmp_path):
    options = {"periods": [1.2], "out": "here.nc"} | options
    out = tmp_path / options.pop("out")
    with pytest.raises(js.CaseError, match=words):
        js.coefficients(BOX.replace(changes), out=out, progress=False, **options)
    assert not any(tmp_path.iterdir())


def test_a_file_without_its_runs_is_kept(tmp_path):
    (tmp_path / "a.nc").write_text("precious")
    with pytest.raises(js.FileError, match="a_runs.h5, does not"):
        js.coefficients(BOX, [1.2], tmp_path / "a.nc", progress=False)
    assert (tmp_path / "a.nc").read_text() == "precious"


def test_functions_and_bad_forcing_are_refused(tmp_path):
    with pytest.raises(js.CaseError, match="not a function of your own"):
        js.coefficients(BOX.problem, [1.2], tmp_path / "a.nc")
    for bad, words in (
        ({"amplitude": -1.0}, "amplitude"),
        ({"height": np.nan}, "height"),
        ({"cycles": 1}, "cycles"),
    ):
        with pytest.raises(js.CaseError, match=words):
            js.Forcing(**bad)
    check_period(BOX, 1.2)


def test_linear_theory_knows_the_same_box():
    """Panel theory of the same modes: symmetric, and by Haskind's relation consistent with its excitation.

    In two dimensions a symmetric body radiates B = |X|^2 / (2 rho g c_g) (Newman 1977, section 6.18).
    """
    T = 1.2
    found = linear_coefficients(BOX, find_modes(BOX), [2 * np.pi / T], reference(BOX, find_modes(BOX)))
    assert found.A[0, 1, 1] == pytest.approx(30.9, rel=0.01) and found.B[0, 1, 1] == pytest.approx(
        167.5, rel=0.01
    )
    from jaxsph.waves.theory import group_velocity

    c_g = float(group_velocity(2 * np.pi / T, 0.4))
    for i in (0, 1):
        assert found.B[0, i, i] == pytest.approx(abs(found.X[0, i]) ** 2 / (2 * 9810.0 * c_g), rel=0.01)
    slope = {"polygon": [[6.0, 0.0], [9.0, 0.0], [9.0, 0.5]]}
    beach = BOX.replace({"solid": {"beach": slope}, "sponge": None})
    assert linear_coefficients(beach, find_modes(BOX), [5.0], 3.15) is None


# --- files


def _body(x=0.0, pivot=(0.0, 0.0), centre=(0.0, 0.0)):
    return BodyAtRest(
        (x + pivot[0], pivot[1]),
        (x + centre[0], centre[1]),
        (x, -0.05),
        0.03,
        np.diag([30.0, 30.0, 0.378]),
        np.diag([0.0, 2943.0, 7.36]),
    )


def _made(bodies, motions=("surge", "heave", "pitch")):
    modes = tuple(Mode(name, motion) for name in bodies for motion in motions)
    rng, n, W = np.random.default_rng(0), len(modes), 3
    A, B = (rng.random((W, n, n)) + 5.0 * np.eye(n) for _ in range(2))
    X = rng.random((W, n)) + 1j * rng.random((W, n))
    return Coefficients(
        np.array([3.0, 4.0, 5.0]), modes, A, 0.1 * A, B, 0.1 * B, X, 0.1 * abs(X), 0.01 * abs(X), bodies,
        x=3.15, depth=0.4, rho=1000.0, g=9.81, name="made",
    )  # fmt: skip


def test_capytaine_reads_the_netcdf_file(tmp_path):
    """Its response of the bodies is that of the equation of motion with the same coefficients."""
    made = _made({"fore": _body(), "aft": _body(1.0)})
    js.CapytaineFile(tmp_path / "a.nc").write(made)
    data = merge_complex_values(xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf"))
    assert list(data.radiating_dof.values)[:2] == ["fore__Surge", "fore__Heave"]
    assert set(data.added_mass.dims) == {"omega", "radiating_dof", "influenced_dof"}
    found = capytaine.post_pro.rao(data).sel(wave_direction=0.0).transpose("omega", "radiating_dof").values
    for w, omega in enumerate(made.omega):
        H = -(omega**2) * (made.M + made.A[w]) + 1j * omega * made.B[w] + made.C
        # Capytaine's time factor is exp(-i omega t)
        assert np.conj(found[w]) == pytest.approx(np.linalg.solve(H, made.X[w]), rel=1e-9)
    assert "per metre of width" in data.attrs["units"]
    assert data.added_mass_spread.values == pytest.approx(made.A_spread)


def test_names_of_a_single_body_are_capytaine_s(tmp_path):
    js.CapytaineFile(tmp_path / "a.nc").write(_made({"body": _body()}))
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as data:
        assert list(data.influenced_dof.values) == ["Surge", "Heave", "Pitch"]
        assert set(data.excitation_force.dims) == {"complex", "omega", "wave_direction", "influenced_dof"}


def test_bemio_file_has_six_motions_about_the_centre_of_mass(tmp_path):
    """The work of a force in a motion, Re conj(v) F, does not depend on the point that describes it."""
    made = _made({"buoy": _body(pivot=(0.1, 0.05)), "plate": _body(1.0)})
    js.BEMIOFile(tmp_path / "a.h5").write(made)
    with h5py.File(tmp_path / "a.h5") as file:
        coefficients = file["body1/hydro_coeffs"]
        A = 1000.0 * coefficients["added_mass/all"][()]
        B = 1000.0 * coefficients["radiation_damping/all"][()] * made.omega
        X = 9810.0 * (coefficients["excitation/re"][()] + 1j * coefficients["excitation/im"][()])
        assert A.shape == B.shape == (6, 12, 3) and X.shape == (6, 1, 3)
        assert np.all(A[[1, 3, 5]] == 0.0) and np.all(A[:, [1, 3, 5, 7, 9, 11]] == 0.0)
        G = A[np.ix_([0, 2, 4], [0, 2, 4])]  # about the centre of mass
        r = np.array([0.1, 0.05])
        for motion in np.eye(3):
            pivot = motion + motion[2] * np.array([r[1], -r[0], 0.0])
            assert motion @ G[..., 0] @ motion == pytest.approx(pivot @ made.A[0, :3, :3] @ pivot)
            assert motion @ X[[0, 2, 4], 0, 0] == pytest.approx(pivot @ made.X[0, :3])
        assert file["simulation_parameters/w"][:, 0] == pytest.approx(made.omega)
        assert file["simulation_parameters/water_depth"][()] == [[0.4]]
        assert file["body2/properties/cg"][:, 0] == pytest.approx([1.0, 0.0, 0.0])
        assert file["body1/hydro_coeffs/linear_restoring_stiffness"].shape == (6, 6)
        unknown = coefficients["added_mass/inf_freq"][()]
        assert unknown.shape == (6, 12) and np.isnan(unknown[2, 2]) and unknown[1, 1] == 0.0


def test_bemio_needs_all_motions_if_the_pivot_is_not_the_centre_of_mass(tmp_path):
    hinged = _made({"flap": _body(pivot=(0.0, -0.3))}, ("pitch",))
    with pytest.raises(js.CaseError, match="moments about the centre of mass"):
        js.BEMIOFile(tmp_path / "a.h5").write(hinged)
    js.CapytaineFile(tmp_path / "a.nc").write(hinged)


# --- a whole study


def _series(study, source, force, moved, waves, back):
    """Series of a run with complex amplitudes of force (N/m), motion (m) and waves along +x and -x (m)."""
    (T,), k, x = study.periods, wavenumber(1.2, 0.4, 9.81), np.array(source.probes.gauges)
    omega, dt = 2.0 * np.pi / T, T / 50
    t = dt * np.arange(round(source.t1 / dt) + 1)
    half = 0.5 * omega * dt
    means = force * np.sin(half) / half * np.exp(-1j * half)

    def over(amplitude):
        return np.real(np.multiply.outer(np.exp(1j * omega * t), amplitude))

    eta = waves * np.exp(-1j * k * (x - study.x)) + back * np.exp(1j * k * (x - study.x))
    forces = np.stack([0.0 * t, over(means), 0.0 * t], axis=1)
    return {"time": t, "body_force_mean": forces, "heave": over(moved), "eta": over(eta)}


def test_waves_from_the_paddle_are_subtracted_and_failures_leave_gaps():
    """With synthetic series of known coefficients, to the accuracy of the wavenumber in single precision."""
    study = _Study(BOX, (Mode("body", "heave"),), np.array([1.2]), js.Forcing())
    sources, omega = study.members(), 2.0 * np.pi / 1.2
    A, B, C, X, moved, echo = (
        31.0,
        168.0,
        9810.0 * 0.3,
        1900.0 * np.exp(0.5j),
        0.01 * np.exp(0.2j),
        3e-4 + 1e-4j,
    )
    force = (omega**2 * A - 1j * omega * B - C) * moved + X * echo
    series = [
        _series(study, sources[0], force, moved, echo, 0.004),
        _series(study, sources[1], X * 0.02, 0.0, 0.02, 0.006j),
    ]
    done = [{"series": one, "failure": ""} for one in series]
    found = study.evaluated(done, sources)
    assert found.A == pytest.approx(np.full((1, 1, 1), A), rel=1e-3)
    assert found.B == pytest.approx(np.full((1, 1, 1), B), rel=1e-3)
    assert found.X == pytest.approx(np.full((1, 1), X), rel=1e-3)
    share = abs(X * echo) / abs((omega**2 * A - 1j * omega * B) * moved)
    assert found.echo == pytest.approx(np.full((1, 1), share), rel=1e-2) and not found.failures
    done[1] = {"series": {}, "failure": "the run failed\nmore"}
    found = study.evaluated(done, sources)
    assert np.isnan(found.X).all() and np.isnan(found.echo).all() and np.isfinite(found.B).all()
    assert found.A[0, 0, 0] != pytest.approx(A, rel=1e-3)  # the waves from the paddle are not known
    assert [*found.failures] == ["waves, T = 1.2 s"]
    done[0] = {"series": {}, "failure": "no"}
    assert np.isnan(study.evaluated(done, sources).A).all()


def test_the_table_names_modes_units_and_theory():
    made = dataclasses.replace(_made({"fore": _body(), "aft": _body(1.0)}), linear=None)
    rows = dict(_rows(made))
    assert len(rows) == 18 and "kg m;" in rows["pitch of aft, T = 1.571 s"]
    assert "linear theory" not in rows["heave of fore, T = 1.571 s"]
    with_theory = dataclasses.replace(made, linear=LinearCoefficients(made.A, made.B, made.X))
    shown = dict(_rows(with_theory))["heave of fore, T = 1.571 s"]
    assert f"linear theory: A = {made.A[1, 1, 1]:.4g}" in shown
    notes = " ".join(_doubts(BOX.replace({"sponge": None}), dataclasses.replace(made, B_spread=0.2 * made.B)))
    assert "there is no sponge" in notes and "varies by 20%" in notes and "x = 3.15 m" in notes


TINY = {
    "dx": 0.05,
    "tank": {"length": 3.6, "depth": 0.3},
    "sponge": {"length": 1.2},
    "waves": {"H": 0.05, "T": 1.2},
    "body.block": {"low": [1.2, 0.15], "high": [1.6, 0.45]},
    "body.free": ["heave"],
    "body.mass": 60.0,
    "body.inertia": None,
}


@pytest.mark.slow
def test_a_study_runs_and_continues(tmp_path, monkeypatch):
    """On a lattice of 6 particles over the depth the numbers are rough: signs and sizes only."""
    monkeypatch.chdir(tmp_path)
    case = BOX.replace(TINY)
    (tmp_path / "tiny.toml").write_text(case.to_toml())
    # one run at a time, so that the second reuses the program that the first has compiled
    command = ["coefficients", "tiny.toml", "--period", "1.2", "--cycles", "2", "-o", "tiny.nc", "-q"]
    first = CliRunner().invoke(app, [*command, "--workers", "1"])
    assert first.exit_code == 0, first.output
    assert "recorded in tiny.nc" in first.output
    written = (tmp_path / "tiny_runs.h5").stat().st_mtime_ns
    found = js.coefficients(case, [1.2], "tiny.nc", forcing=js.Forcing(cycles=2), progress=False)
    assert (tmp_path / "tiny_runs.h5").stat().st_mtime_ns == written  # nothing is run again
    linear = found.linear
    # a wrong sign, phase or stiffness would not give the theory to a factor of two; with three spacings of
    # draught the numerical dissipation is more than half of the damping
    assert 0.5 < found.A[0, 0, 0] / linear.A[0, 0, 0] < 2.0
    assert 0.5 < found.B[0, 0, 0] / linear.B[0, 0, 0] < 2.0
    assert abs(found.X[0, 0]) == pytest.approx(abs(linear.X[0, 0]), rel=0.3)
    with xarray.open_dataset("tiny.nc", engine="h5netcdf") as data:
        assert data.added_mass.values[0, 0, 0] == found.A[0, 0, 0]
    other = CliRunner().invoke(app, [*command, "--amplitude", "0.03"])
    assert other.exit_code == 2 and "forcing.amplitude" in other.output
