"""An open rim: water that splashes over it leaves the model; its mass and energy are counted."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsph as js

CASE = {
    "dx": 0.05,
    "t1": 1.0,
    "tank": {"length": 0.6, "depth": 0.3, "height": 0.5, "rim": "open"},
    "output": {"sample_dt": 0.02},
}


@pytest.fixture(scope="module")
def fountain():
    """(state, solution) of a tank with three drops above its water, thrown over the rim at 2 m/s."""
    case = js.Case.from_dict(CASE | {"fluid": {"c0": 40.0}})
    model, state = js.build(case)
    top = jnp.argsort(state.particles.x[:, 1])[-3:]
    x = state.particles.x.at[top, 1].set(0.46)
    u = jnp.zeros_like(x).at[top, 1].set(2.0)
    state = eqx.tree_at(lambda s: (s.particles.x, s.particles.u), state, (x, u))
    return state, js.march(model, state, 0.2, 0.02, js.make_probes(case, model, state))


def test_what_goes_over_the_rim_is_gone_and_counted(fountain):
    before, found = fountain
    end = found.state.particles
    lost = float(jnp.sum(before.particles.m) - jnp.sum(end.m))
    assert int(found.state.status.bits) == 0
    # float32 sums of a hundred masses; the water at the top has the density at zero pressure
    assert lost == pytest.approx(3 * 1000.0 * 0.05**2, rel=1e-3)
    assert 1000.0 * float(found["spilt"][-1]) == pytest.approx(lost, rel=1e-3)
    assert float(found.state.parts["rim"].mass.total) == pytest.approx(lost, rel=1e-4)
    assert float(found.state.ledger["rim"].total) > 0.0
    assert np.count_nonzero(np.asarray(end.m) == 0.0) == 3
    # 7.5 kg/m left at under 2 m/s, 0.2 m above their lattice positions: half of that energy is kinetic
    assert float(found.state.ledger["rim"].total) == pytest.approx(
        7.5 * (0.5 * 1.4**2 + 9.81 * 0.25), rel=0.3
    )


def test_a_closed_rim_ends_the_run():
    case = js.Case.from_dict(CASE | {"fluid": {"c0": 40.0}, "tank": CASE["tank"] | {"rim": "closed"}})
    model, state = js.build(case)
    state = eqx.tree_at(lambda s: s.particles.x, state, state.particles.x.at[0, 1].set(0.6))
    with pytest.raises(js.SimulationError, match=r"left the tank over its rim.*\n.*make the tank higher"):
        js.march(model, state, 0.02, 0.02)
