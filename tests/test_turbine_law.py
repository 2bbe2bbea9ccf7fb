"""Air pressure as an unknown of a step: readings satisfy the law of every power take-off."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse, enable_x64

import jaxsph as js
from jaxsph.model.meaning import Entry, Exchange

CURVE = ((-0.1, -900.0), (0.0, 0.0), (0.02, 30.0), (0.1, 900.0))

LAWS = {
    "soft": ({"K_dm": 150.0}, lambda q: 150.0**2 * np.abs(q) * q),
    "hard": ({"K_dm": 1e4}, lambda q: 1e8 * np.abs(q) * q),
    "wells": ({"resistance": 4e3}, lambda q: 4e3 * q),
    "curve": (
        {"curve": CURVE},
        lambda q: np.interp(q, *np.array(CURVE).T),
    ),
}
"""Laws by name: keys of the power take-off, and its pressure (Pa) from the flow (m2/s)."""


@pytest.fixture(scope="module")
def swinging():
    """A vessel of incompressible water, whose column rises at 0.15 m/s."""
    case = coarse("vessel").replace({"scheme": {"kind": "incompressible"}, "pto.K_dm": 500.0})
    model, state = js.build(case)
    u = jnp.zeros_like(state.particles.u)
    x = state.particles.x
    chamber = model.chambers[0]
    u = u.at[:, 1].set(jnp.where((x[:, 0] > chamber.sides.x0[0]) & (x[:, 1] > chamber.fade_low), 0.15, 0.0))
    return case, eqx.tree_at(lambda s: s.particles.u, state, u)


def _run(swinging, changes, samples=20):
    case, state = swinging
    case = case.replace(changes)
    model, fresh = js.build(case)
    state = eqx.tree_at(lambda s: (s.parts, s.ledger), state, (fresh.parts, fresh.ledger))
    return model, *advance(case, model, state, samples=samples)


@pytest.mark.parametrize(
    "law", [pytest.param(law, marks=[pytest.mark.slow] * (law in ("soft", "hard", "wells"))) for law in LAWS]
)
def test_pressure_and_flow_of_the_incompressible_scheme_obey_the_law(swinging, law):
    keys, pressure = LAWS[law]
    _, end, series = _run(swinging, {"pto": keys})
    P_a, q = (np.asarray(series[name], float)[1:] for name in ("P_a", "flow"))
    assert int(end.status.bits) == 0
    assert np.abs(P_a).max() > 1.0  # not all pressures are negligible
    # about ten float32 roundings of the closed form, and of the flow of the new velocities
    assert P_a == pytest.approx(pressure(q), abs=1e-4 * np.abs(P_a).max())


def test_compressible_air_and_its_turbine_obey_both_laws(swinging):
    _, _, series = _run(swinging, {"pto": {"K_dm": 500.0}, "air.volume": 0.5})
    P_a, q = (np.asarray(series[name], float)[1:] for name in ("P_a", "flow_pto"))
    assert P_a == pytest.approx(500.0**2 * np.abs(q) * q, abs=1e-4 * np.abs(P_a).max())


@pytest.mark.slow
def test_a_valve_holds_the_pressure_and_the_turbine_the_law(swinging):
    _, end, series = _run(swinging, {"pto": {"K_dm": 500.0, "relief": 25.0}})
    P_a, q = (np.asarray(series[name], float)[1:] for name in ("P_a", "flow"))
    held = P_a >= 25.0
    assert held.any() and not held.all() and P_a.max() == 25.0
    free = ~held
    assert P_a[free] == pytest.approx(500.0**2 * np.abs(q[free]) * q[free], abs=1e-4 * np.abs(P_a).max())
    assert float(end.ledger["relief"].total) > 0.0


@pytest.mark.slow
def test_a_closed_chamber_holds_its_water(swinging):
    """Of an initial flow of about 0.06 m2/s, almost nothing remains after one step."""
    _, _, open_ = _run(swinging, {"pto": {"K_dm": 0.0}}, samples=4)
    _, end, closed = _run(swinging, {"pto": {"K_dm": 1e6}}, samples=4)
    flows = [float(np.abs(np.asarray(s["flow"])[1:]).max()) for s in (open_, closed)]
    assert int(end.status.bits) == 0
    assert flows[1] < 1e-2 * flows[0]


def test_a_prescribed_pressure_is_the_pressure(swinging):
    _, _, series = _run(swinging, {"pto": {"P_a": 40.0, "ramp": 0.01}})
    assert np.asarray(series["P_a"])[3:] == pytest.approx(40.0, rel=1e-6)


# each takes a minute to compile; test_air tests slopes of the law itself
@pytest.mark.slow
@pytest.mark.parametrize("valve", [{"relief": 5.0}, {"suction": 5.0}], ids="+".join)
def test_slopes_of_a_single_valve_are_numbers_forward_and_in_reverse(swinging, valve):
    """The limit that is not given is infinite, and its slope is zero."""
    case, state = swinging
    case = case.replace({"pto": {"K_dm": 500.0} | valve})
    model, fresh = js.build(case)
    state = eqx.tree_at(lambda s: (s.parts, s.ledger), state, (fresh.parts, fresh.ledger))
    n = model.search.rebuild_every

    def taken(pto):
        end, _ = js.simulate(eqx.tree_at(lambda m: m.chambers[0].pto, model, pto), state, n_steps=n)
        return end.ledger["pto"].total + end.ledger["relief"].total

    pto = model.chambers[0].pto
    slopes = jax.jit(jax.grad(taken))(pto)
    for leaf in jax.tree.leaves(slopes):
        assert np.isfinite(leaf)
    along = jax.jit(lambda p, dp: jax.jvp(taken, (p,), (dp,)))
    for k in range(3):
        seed = [jnp.zeros_like(leaf) for leaf in jax.tree.leaves(pto)]
        seed[k] = jnp.ones_like(seed[k])
        tangent = jax.tree.unflatten(jax.tree.structure(pto), seed)
        _, forward = along(pto, tangent)
        # float32 sums in two different orders
        assert float(forward) == pytest.approx(float(jax.tree.leaves(slopes)[k]), rel=2e-2, abs=1e-6)


class _Meter(js.PneumaticPTO):
    """A quadratic turbine with its own name in the ledger."""

    def entries(self, whose):
        return {"rotor": Entry(f"rotor of the {whose}", Exchange.HARVESTED)}


@pytest.mark.slow
def test_a_power_take_off_has_a_ledger_name_of_its_own(swinging):
    case, state = swinging
    model, _ = js.build(case)
    model = eqx.tree_at(lambda m: m.chambers[0].pto, model, _Meter(jnp.float32(500.0)))
    (named,) = model.chambers[0].entries()
    zero = state.ledger["pto"]
    state = eqx.tree_at(
        lambda s: s.ledger, state, {n: a for n, a in state.ledger.items() if n != "pto"} | {named: zero}
    )
    end, _ = js.simulate(model, state, n_steps=model.search.rebuild_every)
    assert named == "rotor" and float(end.ledger["rotor"].total) > 0.0


@pytest.mark.slow
def test_two_chambers_obey_their_laws_at_once():
    """Only a plate of one spacing separates them: the pressure of one changes the flow of the other."""
    dx, depth, length, tip, sample = 0.04, 0.4, 1.2, 0.28, 0.02
    plates = (js.WallPlate(0.72, 0.76, tip), js.WallPlate(0.96, 1.0, tip))
    dampings = {"sea": 2000.0, "land": 400.0}
    chambers = [
        js.Chamber.of(js.PneumaticPTO(jnp.float32(K)), between=sides, tip=tip, level=depth, dx=dx, name=name)
        for (name, K), sides in zip(dampings.items(), ((0.76, 0.96), (1.0, length)), strict=True)
    ]
    scheme = js.ISPH.of(dx, 1.0, dim=2)
    box = js.Box((0.0, 0.0), (length, 0.8))
    walls = js.Ghosts.build(box, dx, scheme.smoothing, js.FreeSlip(), plates)
    x, volume = js.still_water(walls, depth, dx)
    u = 0.2 * np.stack([np.zeros(len(x)), np.where(x[:, 0] > 0.76, 1.0, -0.5)], axis=1)
    still = dict(p=9810.0 * (depth - x[:, 1]), volume=volume, g=(0.0, -9.81), speed=1.0)
    model, state = js.assemble(
        x, u, scheme=scheme, walls=walls, dx=dx, sample_dt=sample, chambers=chambers, **still
    )
    found = js.march(model, state, 0.4, sample, js.default_probes(model, state, sample))
    assert int(found.state.status.bits) == 0
    for name, K in dampings.items():
        P_a, q = (np.asarray(found[f"{kind}_{name}"], float)[1:] for kind in ("P_a", "flow"))
        assert np.abs(P_a).max() > 1.0
        assert P_a == pytest.approx(K**2 * np.abs(q) * q, abs=1e-4 * np.abs(P_a).max())


@pytest.mark.slow
def test_slopes_through_the_air_s_pressure_are_differences(swinging):
    """In float64: slope of the energy that a damped oscillation gives the turbine, over its damping."""
    with enable_x64():
        case = swinging[0].replace({"precision": "float64", "scheme.tolerance": 1e-9})
        model, state = js.build(case)
        x, chamber = state.particles.x, model.chambers[0]
        within = (x[:, 0] > chamber.sides.x0[0]) & (x[:, 1] > chamber.fade_low)
        u = jnp.zeros_like(x).at[:, 1].set(jnp.where(within, 0.15, 0.0))
        state = eqx.tree_at(lambda s: s.particles.u, state, u)

        @jax.jit
        def taken(K_dm):
            changed = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, model, K_dm)
            end, _ = js.simulate(changed, state, n_steps=2 * model.search.rebuild_every)
            return end.ledger["pto"].total

        K = jnp.asarray(500.0)
        _, slope = jax.jvp(taken, (K,), (jnp.ones_like(K),))
        step = 0.5
        difference = float(taken(K + step) - taken(K - step)) / (2.0 * step)
    # error of the difference, (step/K)^2 = 1e-6, and the solver's tolerance divided by step/K
    assert float(slope) == pytest.approx(difference, rel=1e-4)
