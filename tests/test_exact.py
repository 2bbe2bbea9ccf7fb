"""Exact solutions: short, coarse runs here; runs at the resolution of the bars in the slow lane.

The slow lane has the bars of the experiments; the coarse tests state the origin of their tolerances.
"""

import numpy as np
import pytest

from experiments.verification import channel, oscillating_drop, rotating_square, standing_wave, taylor_green


def test_series_start_at_rest_and_end_steady():
    y = np.linspace(0.0, channel.L, 21)[1:-1]
    for flow in channel.FLOWS.values():
        # 200 terms of a series that falls like 1/n: an error of 1 % at t = 0, where convergence is slowest
        np.testing.assert_allclose(flow.profile(y, 1e-4 * channel.SCALE)[:-4], 0.0, atol=0.01 * channel.U)
    s = y / channel.L
    late = 5.0 * channel.SCALE
    np.testing.assert_allclose(channel.FLOWS["Poiseuille"].profile(y, late), channel.U * 4 * s * (1 - s))
    np.testing.assert_allclose(channel.FLOWS["Couette"].profile(y, late), channel.U * s)


@pytest.mark.parametrize("name", channel.FLOWS)
def test_plane_flow_develops_as_the_series(name):
    """10 spacings across. The error is 0.6 % and falls about as dx^1.5 to 0.08 % with 40; 2 % is allowed."""
    flow = channel.FLOWS[name]
    profiles = channel.solved(flow, 10, (0.1,))
    rms, most = channel.errors(flow, profiles)[0]
    assert rms < 0.02 and most < 0.04
    # the exact profile is far from zero: particles at rest would have a large error
    assert channel.errors(flow, [(t, y, 0 * u) for t, y, u in profiles])[0][0] > 0.1


def test_drop_begins_as_the_exact_one():
    """R = 10 dx, to 0.7 s, two thirds of the way to the first extreme."""
    run = oscillating_drop.solved(10, 0.7)
    sigma, _A, _B, p = oscillating_drop.exact(run.t)
    # the coarse circle is a staircase: its axes differ by dx/R times a fraction of one per cent
    assert oscillating_drop.axes_error(run) < 0.01
    np.testing.assert_allclose(run["sigma"], sigma, atol=0.03 * oscillating_drop.SIGMA0)
    # The probe averages over three spacings, 0.3 R, over which p falls by 9 %. Sound waves of some per cent
    # of p (c0 is 15 m/s) cancel in the mean over the run.
    assert np.mean(run["p_centre"]) / np.mean(p) == pytest.approx(0.91, abs=0.04)
    # 6 % of the kinetic energy is lost in two periods at R = 12 dx (`oscillating_drop`)
    assert abs(oscillating_drop.energy_drift(run)) < 0.02


def test_initial_pressure_of_the_patch_is_poisson_s():
    """lap p = 2 rho omega^2 by differences; the centre's value is known from the torsion of a square bar."""
    at, step = np.array([[0.1, -0.2], [0.0, 0.0]]), 0.02
    p = rotating_square.initial_pressure
    around = sum(p(at + step * np.array(d)) for d in ((1, 0), (-1, 0), (0, 1), (0, -1)))
    laplacian = (around - 4.0 * p(at)) / step**2
    np.testing.assert_allclose(laplacian, 2.0 * rotating_square.RHO, rtol=0.01)  # errors: step^2, 60 terms
    assert p(at)[1] / rotating_square.RHO == pytest.approx(rotating_square.CENTRE, abs=1e-5)


def test_patch_keeps_energy_and_momentum():
    """To omega t = 0.5, when the rotation is still rigid. Shifting may cost 1 % of the angular momentum."""
    run = rotating_square.solved(16, 0.5)
    energy, spin = rotating_square.drift(run)
    assert abs(energy) < 0.01 and abs(spin) < 0.015
    assert np.max(run["max_speed"]) < 0.8 * rotating_square.OMEGA * rotating_square.L
    p = run.state.particles
    momentum = np.asarray(p.m, float) @ np.asarray(p.u, float)
    assert np.all(np.abs(momentum) < 1e-5 * float(np.sum(np.asarray(p.m))))  # pairs cancel to rounding


@pytest.mark.slow
def test_vortex_decays_at_the_exact_rate_and_converges():
    runs = {n: taylor_green.solved(n, 1.0) for n in (25, 50)}
    assert taylor_green.decay_rate(runs[50]) == pytest.approx(1.0, abs=0.03)
    coarse, fine = (taylor_green.velocity_error(run) for run in runs.values())
    assert fine < 0.5 * coarse  # at least first order


@pytest.mark.slow
def test_vortex_needs_shifting():
    """Without shifting the lattice breaks up, and the vortex loses half of its energy."""
    assert taylor_green.decay_rate(taylor_green.solved(50, 0.6, strength=None)) > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("name", channel.FLOWS)
def test_plane_flow_at_all_times(name):
    flow = channel.FLOWS[name]
    assert all(rms < 0.02 for rms, _ in channel.errors(flow, channel.solved(flow, 40)))


@pytest.mark.slow
def test_drop_has_the_exact_period():
    run = oscillating_drop.solved(25, 9.5)
    assert oscillating_drop.period(run) == pytest.approx(oscillating_drop.PERIOD, rel=0.01)
    assert oscillating_drop.period(run, skip=2) == pytest.approx(oscillating_drop.PERIOD, rel=0.002)


@pytest.mark.slow
def test_patch_is_held_together_by_shifting():
    run, without = (rotating_square.solved(40, 2.5, strength=s) for s in (12.0, None))
    assert rotating_square.voids(run) < 0.5 * rotating_square.voids(without)
    assert abs(rotating_square.drift(run)[0]) < 0.5 * abs(rotating_square.drift(without)[0])


@pytest.mark.slow
def test_small_wave_decays_by_its_viscosity():
    """Within 10 %: on a lattice the viscous sum itself has an error of up to 9 %."""
    own, damped = (
        standing_wave.fitted(standing_wave.solved(0.04, 0.03, 5.0, changes)).decay_rate
        for changes in ({}, {"fluid.nu": standing_wave.NU})
    )
    assert damped - own == pytest.approx(standing_wave.DECAY, rel=0.1)
