"""Duct with a turbine or an orifice between the air of two chambers."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxsph.model.air import AbstractDuct, AbstractPTO, Air, Pressed
from jaxsph.model.meaning import Oscillation, Reading
from jaxsph.model.state import Tally

__all__ = ["Duct"]


class Duct(AbstractDuct):
    """Duct between two chambers. The law of its power take-off relates the pressure drop to the flow.

    The volume of the air in the duct is neglected. The energy absorbed in the duct is the energy that the air
    of one chamber loses minus the energy that the air of the other chamber gains.
    """

    between: tuple[str, str] = eqx.field(static=True)
    """Names of the chambers; flow from the first to the second is positive."""
    pto: AbstractPTO
    """Power take-off in the duct, or the duct's own resistance."""
    name: str = eqx.field(static=True, default="duct", kw_only=True)
    usual_name: ClassVar[str] = "duct"

    def start(self, dtype):
        """See `AbstractDuct`."""
        zero = jnp.zeros((), dtype)
        return Air(zero, zero, Tally.zero(dtype))

    def entries(self):
        """See `AbstractPart`."""
        return {self.called(name): entry for name, entry in self.pto.entries(self.name).items()}

    def readings(self, dim):
        """See `AbstractPart`."""
        flow, width = ("m2 s-1", " per unit width") if dim == 2 else ("m3 s-1", "")
        way = f"from the {self.between[0]} to the {self.between[1]}"
        found = {
            "pressure_drop": Reading("Pa", f"air pressure drop {way}"),
            "duct_flow": Reading(flow, f"flow of air {way}{width}"),
            "duct_flow_mean": Reading(flow, f"flow of air {way}{width}, mean since the last sample"),
        }
        return {self.called(name): reading for name, reading in found.items()}

    def oscillations(self, dim):
        """See `AbstractPart`."""
        drop = Oscillation(self.called("pressure_drop"), f"pressure drop in the {self.name}", "Pa")
        flow = Oscillation(
            self.called("duct_flow_mean"), f"air flow in the {self.name}", "m2/s" if dim == 2 else "m3/s"
        )
        return {self.called(name): one for name, one in (("pressure_drop", drop), ("duct_flow", flow))}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        found = {
            "pressure_drop": state.P_a,
            "duct_flow": state.q,
            "duct_flow_mean": state.driven.recent / sampled.interval,
        }
        return {self.called(name): value for name, value in found.items()}

    def press(self, air, q_free, compliance, t):
        """See `AbstractDuct`."""
        pto = self.pto.at(air, t)
        drop = pto.pressure(q_free, compliance, t)
        return Pressed(drop, q_free - compliance * drop, pto, jnp.zeros_like(drop))

    def finish(self, air, pressed, work, dt):
        """See `AbstractDuct`."""
        drop, q = pressed.P_a, pressed.passed
        amounts = {name: dt * drop * part for name, part in pressed.pto.flows(drop, q).items()}
        # the mean flows out of the chambers differ slightly from the duct's flow at the end of the step;
        # correct the sum to `work`
        if amounts:  # a closed duct has no entries
            first = next(iter(amounts))
            amounts[first] = amounts[first] - (sum(amounts.values()) - work)
        air = Air(drop, q, air.driven.add(dt * q))
        return air, {self.called(name): amount for name, amount in amounts.items()}
