"""Fast theory in time of an oscillating water column with any turbine: curves, valves, laws of your own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.parts import make_chambers
from jaxsph.errors import CaseError
from jaxsph.model.air import AbstractPTO
from jaxsph.parts.pto import PneumaticPTO, ReliefValve
from jaxsph.study.fast_column import DAMPING, LENGTHS, ColumnTheory
from jaxsph.waves.column_motion import column_motion

__all__ = ["ColumnMotionTheory"]

TURBINE = "pto"
"""Name of the turbine among laws of your own."""
PLAIN = 500.0
"""Damping K_dm of the quadratic turbine with which linear theory is asked whether it covers a case."""


@dataclass(frozen=True)
class ColumnMotionTheory(ColumnTheory):
    """Linear theory of the water, with a loss at the lip and inertia of the column, and any turbine.

    The motion of the column is found in time.
    """

    laws: Mapping[str, AbstractPTO] = dataclasses.field(default_factory=dict)
    """Turbine in the place of that of the case, by the name `TURBINE`."""

    smooth: ClassVar[bool] = False

    @classmethod
    def suits(cls, case: Case) -> bool:
        """Whether the turbine of a case needs motions in time."""
        return any(one.curve is not None or one.has_relief for one in case.turbines)

    @classmethod
    def linear(cls, case):
        """See `ColumnTheory`: with a quadratic turbine without a valve."""
        (name,) = case.chambers
        return case.replace({case.chamber_key(name, "pto"): {"K_dm": PLAIN}})

    @classmethod
    def keys(cls, case):
        """See `AbstractFastTheory`. Keys of laws that the case does not have are left out."""
        (pto,) = case.turbines
        of_turbine = {DAMPING: pto.K_dm, "pto.relief": pto.relief, "pto.suction": pto.suction}
        found = {key: key.removeprefix("pto.") for key, value in of_turbine.items() if value is not None}
        return found | LENGTHS

    @classmethod
    def dampings(cls, case):
        """See `AbstractFastTheory`."""
        return tuple(key for key in cls.keys(case) if key == DAMPING)

    @classmethod
    def with_laws(cls, theory: ColumnTheory, laws: Mapping[str, AbstractPTO]) -> ColumnMotionTheory:
        """A theory with another turbine. **Raises** CaseError for another name than `TURBINE`."""
        for name in laws:
            if name != TURBINE:
                raise CaseError(f"{name}: there is no such law; choose {TURBINE}, the turbine of the chamber")
        return cls(theory.case, theory.water, dict(laws))

    def respond(self, added, values, waves):
        """See `AbstractFastTheory`."""
        lengths = {name: value for name, value in values.items() if name in self.water.lengths}
        with jax.ensure_compile_time_eval():  # the chamber of the case has no traced values
            (chamber,) = make_chambers(self.case, Geometry.of(self.case), (), jnp.float32)
        others = {name: value for name, value in values.items() if name not in lengths}
        if others and self.laws:
            raise CaseError(
                f"{', '.join(others)}: the turbine is a law of your own, whose parameters are no keys"
            )
        pto = self.laws.get(TURBINE, _changed(chamber.pto, others))
        chamber = dataclasses.replace(chamber, pto=pto)
        return column_motion(self.water, added, chamber, waves, lengths, self.case.fluid.rho0)


def _changed(pto: Any, values: Mapping[str, Any]) -> Any:
    """Power take-off with other values of its keys K_dm, relief and suction."""
    if isinstance(pto, ReliefValve):
        limits = {"over": values.get("relief", pto.over), "under": values.get("suction", pto.under)}
        return dataclasses.replace(pto, turbine=_changed(pto.turbine, values), **limits)
    if isinstance(pto, PneumaticPTO):
        return dataclasses.replace(pto, K_dm=values.get("K_dm", pto.K_dm))
    return pto
