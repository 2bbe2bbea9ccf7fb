"""The air of a chamber: laws of turbines and valves, compressible air, and their keys in a case."""

import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse, enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.errors import CaseError
from jaxsph.model.air import Air, Pressed
from jaxsph.model.state import Tally
from jaxsph.parts.air import IncompressibleAir, IsentropicAir
from jaxsph.waves.linear_owc import LinearAir

FLOWS = st.floats(-2.0, 2.0, allow_subnormal=False)
COMPLIANCES = st.floats(1e-9, 1e-4)
CURVE = [(-0.1, -400.0), (0.0, 0.0), (0.05, 30.0), (0.2, 900.0)]


def _curve(points=CURVE):
    q, P_a = np.array(points).T
    return js.CharacteristicCurve(jnp.asarray(q), jnp.asarray(P_a))


_press = jax.jit(lambda pto, q, compliance: pto.pressure(q, compliance, 0.0))


# --- laws


@settings(max_examples=100, deadline=None)
@given(q=FLOWS, compliance=COMPLIANCES, resistance=st.floats(0.0, 1e9))
def test_a_linear_turbine_solves_its_law_with_the_water_s_response(q, compliance, resistance):
    with enable_x64():
        P_a = float(_press(js.LinearTurbine(jnp.asarray(resistance)), q, compliance))
    # round-off of the difference q - compliance P_a; subnormal numbers count as zero
    size = resistance * abs(q)
    assert P_a == pytest.approx(resistance * (q - compliance * P_a), rel=1e-12, abs=1e-14 * size + 1e-290)
    assert P_a * q >= 0.0


@settings(max_examples=100, deadline=None)
@given(q=FLOWS, compliance=COMPLIANCES)
def test_a_curve_solves_its_law_with_the_water_s_response(q, compliance):
    with enable_x64():
        P_a = float(_press(_curve(), q, compliance))
    through = q - compliance * P_a
    slopes = {True: (400.0 / 0.1, 0.0, 0.0), False: (870.0 / 0.15, 0.05, 30.0)}
    if -0.1 < through < 0.2:
        expected = np.interp(through, *np.array(CURVE).T)
    else:
        slope, at, there = slopes[through < 0.0]
        expected = there + slope * (through - at)
    assert P_a == pytest.approx(expected, rel=1e-10, abs=1e-10)
    assert P_a * q >= 0.0


def test_a_straight_curve_is_a_linear_turbine_and_flow_is_the_law_s_inverse():
    with enable_x64():
        line, linear = _curve([(-1.0, -2e3), (0.0, 0.0), (0.3, 600.0)]), js.LinearTurbine(jnp.asarray(2e3))
        for q in (-3.0, -0.2, 0.0, 0.1, 5.0):
            assert float(_press(line, q, 1e-4)) == pytest.approx(float(_press(linear, q, 1e-4)), rel=1e-13)
        for turbine in (linear, _curve(), js.PneumaticPTO(jnp.asarray(400.0))):
            for P_a in (-700.0, -5.0, 40.0, 2e3):
                q = turbine.flow(jnp.asarray(P_a))
                assert float(_press(turbine, q, 0.0)) == pytest.approx(
                    P_a, rel=1e-8
                )  # the root has a guard of 1e-12 m2/s


def test_an_orifice_is_bernoulli_s():
    area, discharge, density = 0.01, 0.62, 1.2
    K_dm, q = js.orifice_damping(area, discharge, density), 0.05
    assert K_dm**2 * q**2 == pytest.approx(0.5 * density * (q / (discharge * area)) ** 2)


@settings(max_examples=100, deadline=None)
@given(q=FLOWS, compliance=COMPLIANCES)
def test_a_relief_valve_holds_exactly_and_passes_the_rest(q, compliance):
    over, under = 150.0, 80.0
    valve = js.ReliefValve(js.PneumaticPTO(jnp.float32(500.0)), jnp.float32(over), jnp.float32(under))
    P_a = _press(valve, q, compliance)
    assert -under <= float(P_a) <= over
    through = jnp.float32(q - compliance * P_a)
    turbine, relieved = (float(valve.flows(P_a, through)[name]) for name in ("pto", "relief"))
    if -under < float(P_a) < over:
        assert relieved == 0.0
    else:
        # float32 rounding of the root of the pressure
        assert turbine == pytest.approx(np.sign(q) * np.sqrt(abs(float(P_a))) / 500.0, rel=1e-5)
    assert relieved * q >= 0.0 and turbine * q >= 0.0


def test_control_is_a_differentiable_function_of_the_chamber():
    def control(gain, air, t):
        del t
        return js.PneumaticPTO(300.0 * (1.0 + gain * air.P_a))

    own = Air(jnp.float32(2.0), jnp.float32(0.1), Tally.zero(jnp.float32))

    def pressure(gain):
        return js.ControlledPTO.of(control, gain).at(own, 0.0).pressure(0.1, 0.0, 0.0)

    assert float(pressure(0.0)) == pytest.approx(300.0**2 * 0.1**2, rel=1e-6)
    # d/dgain of (300 (1 + 2 gain))^2 q^2
    assert float(jax.grad(pressure)(0.0)) == pytest.approx(4.0 * 300.0**2 * 0.1**2, rel=1e-5)


# --- compressible air over a piston of water: dq/dt = (drive - P_a) / inertia

AIR = {"volume": 0.5, "p0": 101_325.0, "gamma": 1.4}
INERTIA = 500.0
"""Pressure per rate of change of the flow, kg/m4, for a water column 0.5 m high and 1 m long."""


def _isentropic(dtype, **changes):
    return IsentropicAir(**{name: jnp.asarray(v, dtype) for name, v in (AIR | changes).items()})


def _piston(air, pto, drive, q0, dt, steps, dtype):
    """Pressures (Pa), flows (m2/s), last state and energy of air over a piston under `drive(t)` (Pa)."""

    def step(carry, i):
        own, q, taken = carry
        t, none = (i + 1) * dt, jnp.zeros((), dtype)
        q_free = q + dt / INERTIA * drive(t)
        P_a, pressed = air.press(pto, own, q_free, dt / INERTIA, none, t, dt)
        new = q_free - dt / INERTIA * P_a
        mean = 0.5 * (q + new)
        passed, _ = air.divided(Pressed(P_a, pressed, pto, none), mean)
        held = air.finish(own, passed, passed, mean, dt)
        taken = taken + dt * air.head(P_a) * passed
        return (Air(P_a, new, own.driven.add(dt * new), held), new, taken), (P_a, new)

    zero = jnp.zeros((), dtype)
    own = Air(zero, jnp.asarray(q0, dtype), Tally.zero(dtype), air.start(dtype))
    start = (own, jnp.asarray(q0, dtype), zero)
    (own, _, taken), (P_a, q) = jax.lax.scan(step, start, jnp.arange(steps, dtype=dtype))
    return np.asarray(P_a, float), np.asarray(q, float), own, float(taken)


def test_a_closed_chamber_swings_at_the_exact_frequency():
    """In float32, as in a run; a linear turbine with a resistance of 1e12 is practically closed."""
    air, dt = _isentropic(jnp.float32), 2e-3
    exact = np.sqrt(AIR["gamma"] * AIR["p0"] / (INERTIA * AIR["volume"]))
    closed = js.LinearTurbine(jnp.float32(1e12))
    _, q, _, taken = _piston(air, closed, lambda t: 0.0 * t, 5e-3, jnp.float32(dt), 4000, jnp.float32)
    up = np.flatnonzero((q[:-1] < 0.0) & (q[1:] >= 0.0))
    crossing = dt * (up - q[up] / (q[up + 1] - q[up]))
    omega = 2.0 * np.pi * (len(crossing) - 1) / (crossing[-1] - crossing[0])
    # the trapezoidal rule lowers the frequency by (omega dt)^2 / 12 = 2e-4
    assert omega == pytest.approx(exact, rel=5e-4)
    # no growth or decay in 30 periods, because the air's force is taken at the middle of a step
    assert np.abs(q[-300:]).max() == pytest.approx(np.abs(q[:300]).max(), rel=5e-3)
    assert abs(taken) < 1e-6


@pytest.mark.parametrize("turbine", [js.PneumaticPTO(400.0), js.LinearTurbine(8e3)])
def test_little_air_is_incompressible_air(turbine):
    with enable_x64():
        turbine = jax.tree.map(jnp.asarray, turbine)

        def drive(t):
            return 300.0 * jnp.sin(5.0 * t)

        dt = 5e-4
        ideal = _piston(IncompressibleAir(), turbine, drive, 0.0, dt, 8000, float)
        errors = []
        for volume in (0.2, 0.02):
            # less volume means less compliance; here the ambient pressure is raised instead, without limit
            air = _isentropic(float, volume=0.5, p0=AIR["p0"] * 0.5 / volume)
            P_a = _piston(air, turbine, drive, 0.0, dt, 8000, float)[0]
            errors.append(np.linalg.norm(P_a - ideal[0]) / np.linalg.norm(ideal[0]))
        tiny = _isentropic(float, p0=1e10)
        P_a, _, _, taken = _piston(tiny, turbine, drive, 0.0, dt, 8000, float)
    # equal in the limit, but the flow in the law is half a step earlier: omega dt / 2 = 1.2e-3
    assert np.linalg.norm(P_a[5:] - ideal[0][5:]) / np.linalg.norm(ideal[0]) < 2e-3
    assert taken == pytest.approx(ideal[3], rel=1e-3)
    assert errors[1] < 0.2 * errors[0]


def test_what_the_water_gives_is_the_turbine_s_or_stored():
    """Over a swing with pressures of about a twentieth of the ambient pressure, where air is not linear."""
    with enable_x64():
        air, turbine, dt = _isentropic(float), js.PneumaticPTO(jnp.asarray(2000.0)), 1e-4
        P_a, q, own, taken = _piston(air, turbine, lambda t: 0.0 * t, 0.4, dt, 900, float)
        given = 0.5 * INERTIA * (0.4**2 - q[-1] ** 2)
        stored = float(air.stored(own))
    assert np.abs(P_a).max() > 4e3 and stored > 1.0
    # the head is taken at the pressure of the step: an error of second order in dt omega = 2e-3
    assert given == pytest.approx(taken + stored, rel=1e-4)
    assert float(air.head(1e-3)) == pytest.approx(1e-3, rel=1e-5)


# --- in a case


@pytest.mark.parametrize(
    ("law", "kind"),
    [
        ({"resistance": 4e3}, js.LinearTurbine),
        ({"area": 0.005, "discharge": 0.62}, js.PneumaticPTO),
        ({"curve": [[0.0, 0.0], [0.1, 500.0]]}, js.CharacteristicCurve),
        ({"K_dm": 500.0, "relief": 60.0}, js.ReliefValve),
    ],
    ids=["linear", "orifice", "curve", "relief"],
)
def test_every_law_comes_from_its_keys(law, kind):
    case = js.Case.from_dict(coarse("owc").model_dump(exclude_none=True, mode="json") | {"pto": law})
    assert isinstance(js.build(case)[0].chambers[0].pto, kind)
    assert js.Case.from_dict(tomllib.loads(case.to_toml())) == case


def test_another_law_takes_the_place_of_the_first():
    case = coarse("owc").replace({"pto.relief": 60.0, "pto.phase": [0.1, 0.2]})
    linear = case.replace({"pto.resistance": 4e3})
    assert linear.pto.K_dm is None and linear.pto.phase is None and linear.pto.relief == 60.0
    orifice = linear.replace({"pto.area": 0.005})
    assert orifice.pto.quadratic == pytest.approx(js.orifice_damping(0.005, 0.6))
    pressed = orifice.replace({"pto.P_a": 10.0})
    assert pressed.pto.relief is None and not pressed.pto.is_turbine


def test_a_curve_of_one_direction_is_mirrored():
    case = coarse("owc").replace({"pto.curve": [[0.0, 0.0], [0.1, 500.0], [0.2, 1500.0]]})
    assert case.pto.points == ((-0.2, -1500.0), (-0.1, -500.0), (0.0, 0.0), (0.1, 500.0), (0.2, 1500.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"pto.curve": [[0.0, 0.0], [0.1, 500.0], [0.2, 400.0]]},
            r"the point \(q = 0.1, P_a = 500 Pa\) is followed by",
        ),
        ({"pto.curve": [[0.1, 500.0], [0.2, 900.0]]}, r"must contain the point \(0, 0\)"),
        (
            {"pto": {"P_a": 10.0, "relief": 20.0}},
            "relief has no effect with P_a; give K_dm or resistance or area or curve instead of P_a, or "
            "remove relief",
        ),
        ({"pto": {"K_dm": 1.0, "resistance": 2.0}}, "exactly one of"),
        (
            {"air.volume": 0.005},
            r"air.volume = 0.005 m2: waves .* may fill the chamber; .* needs at least 0.0\d+ m2",
        ),
        ({"air.volume": 0.5, "pto.P_a": 10.0}, r"air: compressible air needs a turbine"),
        ({"air": {"gamma": 1.4}}, r"air.volume: is missing \(Volume"),
    ],
    ids=lambda value: None if isinstance(value, str) else "+".join(value),
)
def test_bad_air_is_named_with_what_is_allowed(changes, message):
    with pytest.raises(CaseError, match=message):
        js.load_case("owc").replace(changes)


def test_a_curve_comes_from_a_file_beside_the_case(tmp_path):
    text = js.load_case("owc").to_toml().replace("K_dm = 534.66", 'file = "turbine.csv"')
    (tmp_path / "own.toml").write_text(text)
    (tmp_path / "turbine.csv").write_text("q (m2/s),P_a (Pa)\n0,0\n0.1,500\n0.2,1500\n")
    assert js.load_case(tmp_path / "own.toml").pto.curve == ((0.0, 0.0), (0.1, 500.0), (0.2, 1500.0))
    (tmp_path / "turbine.csv").write_text("q (m2/s),P_a (kPa)\n0,0\n0.1,0.5\n")
    with pytest.raises(CaseError, match="must be in Pa"):
        js.load_case(tmp_path / "own.toml")


@pytest.mark.parametrize(("width", "unit", "other"), [("", "m2/s", "m3/s"), ("width = 0.4", "m3/s", "m2/s")])
def test_the_flow_of_a_curve_is_per_metre_of_width_in_two_dimensions_only(tmp_path, width, unit, other):
    text = f"""
    dx = 0.04
    t1 = 1.0
    [tank]
    length = 2.0
    depth = 0.4
    {width}
    [pto]
    file = "turbine.csv"
    """
    (tmp_path / "own.toml").write_text(text)
    (tmp_path / "turbine.csv").write_text(f"q ({other}),P_a (Pa)\n0,0\n0.1,500\n")
    with pytest.raises(CaseError, match=f"q must be in {unit}; convert the values"):
        js.load_case(tmp_path / "own.toml")


@pytest.mark.parametrize(
    "kind", [pytest.param("weakly_compressible", marks=pytest.mark.slow), "incompressible"]
)
def test_a_chamber_with_air_and_a_valve_keeps_its_books(kind):
    """Compressed air makes the vessels swing and opens the valve; the ledger accounts for all energy."""
    case = coarse("vessel").replace(
        {"scheme": {"kind": kind}, "pto.K_dm": 4000.0, "pto.suction": 60.0, "air.volume": 0.5}
    )
    model, state = js.build(case)
    chamber = model.chambers[0]
    squeezed = jnp.float32(400.0 / AIR["p0"] / 1.4 * 0.5)
    state = eqx.tree_at(lambda s: s.parts["chamber"].confined.excess.settled, state, squeezed)
    before = float(chamber.air.stored(state.parts["chamber"]))
    end, series = advance(case, model, state, samples=60)
    P_a = np.asarray(series["P_a"])
    assert P_a.min() == -60.0  # held exactly
    assert P_a[1] == pytest.approx(400.0, rel=0.1)
    after = float(chamber.air.stored(end.parts["chamber"]))
    ledger = {name: float(tally.total) for name, tally in end.ledger.items()}
    assert ledger["relief"] > 0.0 and ledger["pto"] > 0.0
    # the error is of first order in the step in which the valve opens; a sample is a tenth of a period
    assert ledger["air"] == pytest.approx(after - before, abs=0.01 * before)
    assert "flow_pto" in series


# --- linear theory


def test_linear_theory_of_compressible_air_keeps_energy_and_its_limits():
    geometry = js.ChamberGeometry(0.5, 0.64, 0.16, 0.02)
    water = js.radiation_and_scattering(geometry, 5.0)
    some = LinearAir(resistance=800.0, give=3e-6)
    found = js.linear_response(water, 0.04, 300.0, air=some)
    # energy that is not absorbed is reflected: air and linear turbine have no other losses
    assert found.xi + abs(found.R) ** 2 == pytest.approx(1.0, abs=1e-6)
    law = (some.resistance + 8.0 / (3.0 * np.pi) * 300.0**2 * abs(found.q_pto)) * found.q_pto
    assert found.P_a == pytest.approx(law, rel=1e-9)
    assert found.q_pto - found.q == pytest.approx(1j * 5.0 * some.give * found.P_a, rel=1e-9)
    ideal = js.linear_response(water, 0.04, 300.0)
    small = js.linear_response(water, 0.04, 300.0, air=LinearAir(give=1e-12))
    assert small.xi == pytest.approx(ideal.xi, rel=1e-5) and ideal.eta_max == pytest.approx(water.eta_max)
    a, omega = np.array([0.02]), np.array([5.0])
    sea = js.linear_sea_response(geometry, a, omega, 0.0, air=some)
    regular = js.linear_response(water, 0.04, 0.0, air=some)
    assert sea.P_owc == pytest.approx(regular.P_owc) and sea.sigma_level * np.sqrt(2.0) == pytest.approx(
        abs(regular.level)
    )
    with pytest.raises(ValueError, match="lip_loss must be 0 with compressible air"):
        js.linear_response(water, 0.04, 300.0, lip_loss=1.0, air=some)


def test_linear_theory_of_a_case_has_its_air():
    case = js.load_case("owc")
    stiff, soft = (js.linear_owc(case.replace({"air.volume": v})) for v in (0.02, 2.0))
    ideal = js.linear_owc(case)
    assert abs(stiff.xi - ideal.xi) < abs(soft.xi - ideal.xi)
    linear = js.linear_owc(case.replace({"pto.resistance": 4e3}))
    assert linear.P_a == pytest.approx(4e3 * linear.q)
    with pytest.raises(CaseError, match="relief valve"):
        js.linear_owc(case.replace({"pto.relief": 50.0}))
