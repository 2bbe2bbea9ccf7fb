"""Fast theory of an oscillating water column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp

from jaxsph.case.case import Case
from jaxsph.case.linear import chamber_geometry, linear_air, why_no_theory
from jaxsph.problem.results import amplitude
from jaxsph.study.fast_theory import AbstractFastTheory, Fitted, Predictable
from jaxsph.waves.fast_owc import SHARE, Additions, Air, WaterSeries, fast_response

__all__ = ["DAMPING", "LENGTHS", "ColumnTheory"]

DAMPING = "pto.K_dm"
LENGTHS = {
    "device.draught": "draught",
    "device.chamber_length": "length",
    "device.wall_thickness": "thickness",
}
"""Lengths of the device that a model can change, with their names in `waves.fast_owc`."""


@dataclass(frozen=True)
class ColumnTheory(AbstractFastTheory):
    """Linear theory of an oscillating water column, with a loss at the lip and inertia of the column."""

    water: WaterSeries

    power: ClassVar[str] = "P_owc"

    @classmethod
    def why_not(cls, case):
        """See `AbstractFastTheory`."""
        if case.device is None or len(case.turbines) != 1:
            return "a fast model needs a device with a turbine in regular waves"
        missing = why_no_theory(cls.linear(case))
        return (
            f"{missing}: a fast model needs linear theory of the oscillating water column" if missing else ""
        )

    @classmethod
    def linear(cls, case: Case) -> Case:
        """The case with a turbine that linear theory covers; by default the case itself."""
        return case

    @classmethod
    def of(cls, case, omega):
        """See `AbstractFastTheory`."""
        return cls(case, WaterSeries.of(chamber_geometry(case), omega, case.g))

    @classmethod
    def restored(cls, case, series):
        """See `AbstractFastTheory`."""
        return cls(case, WaterSeries.restored(series, chamber_geometry(case), case.g))

    @classmethod
    def keys(cls, case):
        """See `AbstractFastTheory`."""
        del case
        return {DAMPING: "K_dm", **LENGTHS}

    @classmethod
    def dampings(cls, case):
        """See `AbstractFastTheory`."""
        del case
        return (DAMPING,)

    @classmethod
    def moves(cls, case, parameter):
        """See `AbstractFastTheory`: lengths may change by more than the known response of the water."""
        del case
        return parameter in LENGTHS

    @property
    def read(self):
        """See `AbstractFastTheory`."""
        return {"xi": "xi_measured", "P_a": amplitude("P_a"), "flow": amplitude("flow")}

    @property
    def predictable(self):
        """See `AbstractFastTheory`."""
        return {
            "xi": Predictable("hydrodynamic efficiency", "", "xi"),
            "P_owc": Predictable("absorbed power", "W per metre of width", "xi"),
            "P_a": Predictable("amplitude of the air's pressure", "Pa", "P_a"),
            "flow": Predictable("amplitude of the flow of air", "m2/s", "flow"),
        }

    @property
    def additions(self):
        """See `AbstractFastTheory`."""
        low, high = Additions(0.0, -0.5), Additions(jnp.inf, 2.0)
        return Fitted(Additions(1.0, 0.0), Additions(1.0, 0.1), low, high)

    def additions_from(self, given):
        """See `AbstractFastTheory`."""
        return Additions(**given)

    def found(self, added, error):
        """See `AbstractFastTheory`."""
        lip = f"{added.lip:.3g} +- {error.lip:.2g} velocity heads of the column"
        length = f"{added.length:.3g} +- {error.length:.2g} draughts"
        return [("loss coefficient of the lip", lip), ("additional length of the column", length)]

    def respond(self, added, values, waves):
        """See `AbstractFastTheory`."""
        (pto,), linear = self.case.turbines, linear_air(self.case)
        lengths = {name: value for name, value in values.items() if name in self.water.lengths}
        air = Air(values.get("K_dm", pto.quadratic or 0.0), linear.resistance, linear.give)
        return fast_response(self.water, added, air, waves, lengths, self.case.fluid.rho0)

    def results(self, response):
        """See `AbstractFastTheory`."""
        return {name: getattr(response, name) for name in self.predictable}

    def within(self, values):
        """See `AbstractFastTheory`."""
        found: Any = True
        for name, usual in self.water.lengths.items():
            found &= jnp.abs(jnp.asarray(values.get(name, usual)) - usual) <= 2.0 * SHARE * usual
        return found
