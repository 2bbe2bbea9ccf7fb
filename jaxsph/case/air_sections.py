"""Sections of a case file for chambers, ducts, power take-offs and compressible air."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Annotated

from pydantic import Field, model_validator

from jaxsph.case.section import NAME, Coordinate, Density, Duration, Name, Section
from jaxsph.parts.pto import orifice_damping

VALVE = ("relief", "suction")
LAWS: dict[str, tuple[str, ...]] = {
    "K_dm": ("phase", *VALVE),
    "resistance": VALVE,
    "area": ("discharge", "density", *VALVE),
    "curve": VALVE,
    "P_a": ("ramp",),
}
"""Keys that select the law of a power take-off, each with the further keys that the law allows."""

FAR = "far"
"""Name of the tank's end wall in `chamber.NAME.between`."""
DEVICE_WALLS = ("device", FAR)
"""Walls of the device's chamber: the device's plate and the tank's end wall."""
SMOOTH_LAWS = ("K_dm", "resistance", "area", "discharge", "P_a", "relief", "suction")
"""Keys of a power take-off on which a model depends smoothly; `resume` may change their values."""


def air_keys(keys: Iterable[str]) -> list[str]:
    """Dotted names of the `keys` of all sections `pto`, and `duct.NAME.area`; NAME stands for any name."""
    places = ("", f"chamber.{NAME}.", f"duct.{NAME}.")
    return [f"{place}pto.{key}" for key in keys for place in places] + [f"duct.{NAME}.area"]


Area = Annotated[float, Field(ge=1e-6, le=1e3)]
Discharge = Annotated[float, Field(ge=0.1, le=1.0)]
Reading = Annotated[float, Field(ge=-1e9, le=1e9)]


class PTOSection(Section):
    """Power take-off of a chamber's air: a quadratic damping, a linear turbine, an orifice, a characteristic
    curve or a prescribed pressure. Give exactly one of them. In two dimensions flows and areas are per metre
    of width."""

    K_dm: float | None = Field(None, ge=0, le=1.0e6)
    """Damping coefficient of a quadratic turbine or a slot (P_a = K_dm^2 |q| q), kg^0.5 m^-2.5
    (kg^0.5 m^-3.5 in 3-D); with 1e6 the chamber is practically closed."""
    phase: tuple[Annotated[float, Field(ge=-10, le=10)], ...] | None = Field(
        None, min_length=2, max_length=100
    )
    """Fourier coefficients of ln(K_dm(t)/K_dm) over the wave phase, a cosine and a sine coefficient for each
    harmonic: [a1, b1, a2, b2]."""
    resistance: float | None = Field(None, ge=0, le=1e12)
    """Resistance of a linear turbine (P_a = resistance q), for example a Wells turbine, Pa s/m2 (Pa s/m3
    in 3-D)."""
    area: Area | None = None
    """Area of an orifice, m2 (per metre of width in 2-D)."""
    discharge: Discharge = 0.6
    """Discharge coefficient of the orifice (-)."""
    density: Density = 1.2
    """Density of the ambient air, kg/m3; the damping of an orifice depends on it."""
    curve: tuple[tuple[Reading, Reading], ...] | None = Field(None, min_length=2, max_length=10_000)
    """Characteristic curve: pairs of flow (m2/s; m3/s in 3-D) and pressure (Pa), both increasing, with the
    point (0, 0). A curve that begins at (0, 0) is mirrored for inhalation. Alternatively, `pto.file` names a
    CSV file."""
    P_a: float | None = Field(None, ge=-1e9, le=1e9)
    """Prescribed gauge pressure, Pa."""
    ramp: Duration = 0.0
    """Time over which a prescribed pressure grows from zero, s."""
    relief: float | None = Field(None, ge=1e-3, le=1e9)
    """Gauge pressure at which a relief valve in parallel with the turbine opens and lets air out, Pa."""
    suction: float | None = Field(None, ge=1e-3, le=1e9)
    """Suction at which the relief valve opens and lets air in, Pa, as a positive number."""

    @model_validator(mode="after")
    def _one_law(self) -> PTOSection:
        given = [key for key in LAWS if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(
                "give exactly one of K_dm (a quadratic damping), resistance (a linear turbine), area (an "
                "orifice), curve (a characteristic curve) and P_a (a prescribed pressure); "
                f"{' and '.join(given) + ' are' if given else 'none of them is'} given"
            )
        for key in self.changed:
            laws = [law for law, allowed in LAWS.items() if key in allowed]
            if key != given[0] and given[0] not in laws:
                self.refuse([key], f"with {given[0]}", f"give {' or '.join(laws)} instead of {given[0]}")
        if self.phase is not None and len(self.phase) % 2:
            raise ValueError(
                f"phase = {list(self.phase)} must have an even number of values; give a cosine and a sine "
                "for every harmonic"
            )
        if self.curve is not None:
            _check_curve(self.curve)
        return self

    @property
    def is_turbine(self) -> bool:
        """Whether the power take-off is a turbine: true for every law except a prescribed pressure."""
        return self.P_a is None

    @property
    def has_relief(self) -> bool:
        """Whether the turbine has a relief valve."""
        return self.relief is not None or self.suction is not None

    @property
    def quadratic(self) -> float | None:
        """Damping coefficient K_dm, kg^0.5 m^-2.5 (kg^0.5 m^-3.5 in 3-D), given or computed for an orifice;
        None for other laws."""
        if self.area is not None:
            return orifice_damping(self.area, self.discharge, self.density)
        return self.K_dm

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """Characteristic curve for both directions of flow, as pairs of flow (m2/s; m3/s in 3-D) and pressure
        (Pa)."""
        curve = self.curve or ()
        if curve and curve[0] == (0.0, 0.0):
            return (*((-q, -p) for q, p in curve[:0:-1]), *curve)
        return curve


def _check_curve(curve: tuple[tuple[float, float], ...]) -> None:
    """**Raises** ValueError unless flow and pressure both rise along the curve, which must contain (0, 0)."""
    for (q, p), (after, higher) in itertools.pairwise(curve):
        if not (after > q and higher > p):
            raise ValueError(
                f"in curve, the point (q = {q:g}, P_a = {p:g} Pa) is followed by (q = {after:g}, P_a = "
                f"{higher:g} Pa), but flow and pressure must both rise from each point to the next; sort the "
                "points, and leave out the points at which the turbine stalls"
            )
    if (0.0, 0.0) not in curve:
        raise ValueError(
            "curve must contain the point (0, 0), because without flow a turbine has no pressure drop; add "
            "this point"
        )


class AirSection(Section):
    """Compressible, isentropic air of the chamber; without this section the air is incompressible."""

    volume: float = Field(ge=1e-6, le=1e9)
    """Volume of air above still water in the chamber and its ducts, m3 (in 2-D per metre of width, m2)."""
    pressure: float = Field(101_325.0, ge=1.0, le=1e9)
    """Ambient pressure, Pa."""
    gamma: float = Field(1.4, ge=1.01, le=2.0)
    """Ratio of the specific heats (-)."""

    @property
    def give(self) -> float:
        """Compliance of the air at ambient pressure, volume / (gamma pressure), m3/Pa (m2/Pa in 2-D)."""
        return self.volume / (self.gamma * self.pressure)


class ChamberSection(Section):
    """A chamber of air over the water between two walls, or in a body's hollow; you choose its name."""

    between: tuple[str, str] | None = None
    """The two walls: names of solids, "device" for the device's plate, "far" for the tank's end wall."""
    body: Name | None = None
    """Name of the body whose hollow contains the chamber; give it instead of `between`. The air moves with
    the body. The hollow is open below and closed by a roof."""
    at: Coordinate | tuple[Coordinate, Coordinate] | None = None
    """Position x inside the hollow at the still water level, m; needed if the body has several hollows. In
    three dimensions a point (x, y) in the chamber, m; the chamber covers the water surface that solids, or
    the `body`, enclose around this point."""
    pto: PTOSection | None = None
    air: AirSection | None = None

    @model_validator(mode="after")
    def _one_place(self) -> ChamberSection:
        inside = isinstance(self.at, tuple)
        if self.between is not None and self.body is not None:
            raise ValueError("give exactly one of between (two walls) and body (a body with a hollow)")
        if self.between is not None and isinstance(self.at, tuple):
            raise ValueError(
                f"at = {list(self.at)} is for a tank with a width, and between for a tank without a width; "
                "remove one of the two keys"
            )
        if self.between is None and self.body is None and not inside:
            raise ValueError(
                "give exactly one of between (two walls) and body (a body with a hollow), or in three "
                "dimensions at = [x, y], a point in the chamber"
            )
        if self.at is not None and self.body is None and not inside:
            raise ValueError(
                f"at = {self.at:g} m selects a hollow of a body; give body instead of between, or remove at"
            )
        return self


class DuctSection(Section):
    """A duct between the air of two chambers; you choose its name. Give either area or pto."""

    between: tuple[Name, Name]
    """Names of the two chambers; the flow from the first to the second is positive."""
    area: Area | None = None
    """Smallest cross-section of the duct, m2 (per metre of width in 2-D). The kinetic energy of the air is
    lost downstream of this cross-section."""
    discharge: Discharge = 0.6
    """Discharge coefficient of the duct's smallest cross-section (-)."""
    density: Density = 1.2
    """Density of the ambient air, kg/m3."""
    pto: PTOSection | None = None
    """Turbine in the duct; give it instead of `area`."""

    @model_validator(mode="after")
    def _one_law(self) -> DuctSection:
        if (self.area is None) == (self.pto is None):
            raise ValueError("give exactly one of area (of the duct) and pto (a turbine in the duct)")
        if self.pto is not None:
            self.refuse(("discharge", "density"), "with pto", "give area instead of pto")
        return self
