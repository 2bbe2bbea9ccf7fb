"""Linear theory of a case: incident power, response of the OWC (see `waves.linear_owc`) and of bodies."""

from __future__ import annotations

import numpy as np

from jaxsph.case.air_sections import DEVICE_WALLS, PTOSection
from jaxsph.case.body_sections import PLANAR as MOTIONS
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear_bodies import has_free_bodies, linear_motions, why_no_motions
from jaxsph.case.sections import ONLY_BODY, Sections
from jaxsph.errors import CaseError
from jaxsph.waves import second_order, theory
from jaxsph.waves.linear_owc import LinearAir, LinearOWC, linear_response
from jaxsph.waves.linear_sea import LinearSea, linear_sea_response
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering


def incident_power(case: Sections) -> float:
    """Mean power of the waves that a case specifies, W per metre of crest.

    The depth is rounded to whole spacings, as for the paddle and all results.
    """
    depth = Geometry.of(case).depth
    a, omega = case.waves.sum_of_waves(depth, case.g)
    each = theory.incident_power(2.0 * np.abs(a), 2.0 * np.pi / omega, depth, case.fluid.rho0, case.g)
    return float(np.sum(each))


def incident_energy(case: Sections, x: float, start: float, end: float) -> float:
    """Energy (J per metre of crest) that a case's waves carry past x (m) from `start` to `end` (s), by linear
    theory and without the ramp. Over a whole repetition of a sea the mean rate is `incident_power`."""
    depth = Geometry.of(case).depth
    a, omega = case.waves.sum_of_waves(depth, case.g)
    height, T = 2.0 * np.abs(a), 2.0 * np.pi / omega
    power = np.asarray(theory.incident_power(height, T, depth, case.fluid.rho0, case.g), np.float64)
    k = second_order.wavenumbers(omega, depth, case.g) * np.cos(case.waves.directions(len(omega)))
    # a wave with the amplitude sqrt(2 P) has the mean square P, which is the power of this wave
    root = np.sqrt(2.0 * power) * np.exp(1j * (np.angle(a) - k * x))
    # the integral of each product of two waves is known: a sinc about the middle of the time span
    span, middle = end - start, root * np.exp(0.5j * omega * (start + end))
    apart, both = (np.sinc(f.outer(omega, omega) * span / (2.0 * np.pi)) for f in (np.subtract, np.add))
    return float(0.5 * span * np.real(middle @ apart @ np.conj(middle) + middle @ both @ middle))


def linear_owc(case: Sections, lip_loss: float = 0.0) -> LinearOWC:
    """Linear theory of a case's device in the case's waves, with depth and draught rounded to whole spacings.

    `lip_loss` is the coefficient zeta (-) of the head lost at the front wall's lip, see `linear_response`.
    The theory includes compressible air and linear turbines. The incident wave is linear, with the amplitude
    waves.H / 2. The response of the water is cached, so that calling this function for each case of a
    sweep of the damping or the height is fast. Alternatively, call `linear_response` with arrays.
    **Raises** CaseError for a case that the theory does not cover, such as one without a turbine, or with a
    platform.
    """
    missing = _missing(case)
    if missing is not None:
        raise CaseError(
            f"{missing}: linear theory of an OWC needs a device with a linear or quadratic turbine, in "
            "regular waves over a flat bed"
        )
    water = radiation_and_scattering(chamber_geometry(case), 2.0 * np.pi / case.waves.T, case.g)
    return linear_response(
        water, case.waves.H, _turbine(case).quadratic or 0.0, case.fluid.rho0, lip_loss, air=linear_air(case)
    )


def sea_is_linear(case: Sections) -> bool:
    """Whether linear theory of a sea covers a case: the case must have an OWC with a linear or quadratic
    turbine over a flat bed, and waves that are not regular."""
    return case.waves is not None and case.waves.kind != "regular" and _missing(case, seas=True) is None


def linear_sea(case: Sections) -> LinearSea:
    """Linear theory of a case's device in the case's sea, by stochastic linearisation of the turbine.

    **Raises** CaseError for a case that the theory does not cover, such as one without a turbine, or with a
    platform.
    """
    if not sea_is_linear(case):
        if case.waves is not None and case.waves.kind == "regular":
            raise CaseError('waves.kind = "regular": use linear_owc; linear_sea covers other kinds of waves')
        raise CaseError(
            f"{_missing(case, seas=True)}: linear theory of an OWC in a sea needs a device with a linear or "
            "quadratic turbine, over a flat bed"
        )
    tank = Geometry.of(case)
    a, omega = case.waves.sum_of_waves(tank.depth, case.g)
    K_dm, air = _turbine(case).quadratic or 0.0, linear_air(case)
    return linear_sea_response(chamber_geometry(case), a, omega, K_dm, case.fluid.rho0, case.g, air)


def linear_air(case: Sections) -> LinearAir:
    """Resistance of a case's turbine (Pa s/m2; 0 unless linear), and compliance of the air (m2/Pa)."""
    (chamber,) = case.chambers.values()
    give = 0.0 if chamber.air is None else chamber.air.give
    return LinearAir(_turbine(case).resistance or 0.0, give)


def _turbine(case: Sections) -> PTOSection:
    """The only turbine of a case that linear theory covers."""
    (pto,) = case.turbines
    return pto


def chamber_geometry(case: Sections) -> ChamberGeometry:
    """Geometry of the only chamber of a case, with the depth and the draught rounded to whole spacings."""
    tank = Geometry.of(case)
    (stretch,) = tank.stretches.values()
    lengths = (tank.depth, stretch.surface, tank.depth - tank.plate.tip, tank.plate.thickness)
    return ChamberGeometry(*(float(np.round(length, 12)) for length in lengths))


def linear_check(case: Sections) -> list[tuple[str, str]]:
    """Response of a chamber or of bodies by linear theory, as labels and values.

    For a chamber in regular waves these are efficiency, pressure (Pa) and level (m), and in a sea efficiency
    and power (W/m); for bodies their motions (m, rad), the power (W/m) and the efficiency. If the theory does
    not cover the case, the list contains only the reason. Otherwise the list is empty for a chamber in a
    focused group, which has no mean power, for a case without waves, and for a case with neither a turbine
    nor a body with a free motion.
    """
    if has_free_bodies(case):
        return _bodies_check(case)
    if why := why_no_theory(case):
        return [("linear theory", f"none: {why}")]
    if sea_is_linear(case) and case.waves.kind != "focused":
        sea = linear_sea(case)
        return [
            ("linear efficiency", f"{sea.xi:.3g} (mean of the whole sea)"),
            ("linear power", f"{sea.P_owc:.4g} W per metre of width"),
        ]
    if _missing(case) is not None:
        return []
    found = linear_owc(case)
    best = f"at most {found.eta_max:.3g}"
    pto = _turbine(case)
    if pto.quadratic is not None:
        best += f", at K_dm = {found.K_dm_best:.4g}"
    if pto.area is not None:  # the damping of an orifice is inversely proportional to its area
        best += f", or area = {pto.area * pto.quadratic / found.K_dm_best:.3g} m2 per m"
    return [
        ("linear efficiency", f"{found.xi:.3g} ({best})"),
        (
            "linear pressure",
            f"{abs(found.P_a):.4g} Pa amplitude at the wave frequency, {found.P_a_peak:.4g} Pa peak "
            "by the turbine's law",
        ),
        ("linear chamber level", f"{abs(found.level):.3g} m amplitude"),
    ]


def _bodies_check(case: Sections) -> list[tuple[str, str]]:
    """Amplitudes of the bodies' motions, and the power, by linear theory, as labels and values."""
    try:
        found = linear_motions(case)
    except CaseError as error:
        return [("linear theory", f"none: {error}")]
    rows = []
    for name, motions in found.motions.items():
        of = "" if name == ONLY_BODY else f" of {name}"
        for motion, value, unit in zip(MOTIONS, motions, ("m", "m", "rad"), strict=True):
            if abs(value) > 1e-9:
                rows.append((f"linear {motion}{of}", f"{abs(value):.3g} {unit} amplitude"))
    if found.powers:
        rows.append(("linear power", f"{found.P_pto:.4g} W per metre of width"))
        rows.append(("linear efficiency", f"{found.xi:.3g}"))
    return rows


def why_no_theory(case: Sections) -> str:
    """Reason why linear theory does not cover the chambers or bodies of a case in waves; empty if the theory
    covers them, or if the case has no waves, or neither a turbine nor a body with a free motion."""
    if has_free_bodies(case):
        return why_no_motions(case)
    if not case.turbines or case.waves is None:
        return ""
    return _missing(case, seas=case.waves.kind != "regular") or ""


def _missing(case: Sections, seas: bool = False) -> str | None:
    """Reason why linear theory of regular waves, or of `seas`, does not cover a case; None if covered."""
    if case.dim == 3:
        return "tank.width: the tank has three dimensions"
    if len(case.chambers) > 1:
        return "there are several chambers"
    for name, chamber in case.chambers.items():
        if set(chamber.between or ()) != set(DEVICE_WALLS):
            return f"chamber.{name} is not between the plate of a device and the end wall"
    if case.device is None:
        return "no device is given"
    if case.solid:
        return f"solid.{next(iter(case.solid))} is in the water"
    if case.waves is None:
        return "no waves are given"
    if not seas and case.waves.kind != "regular":
        return f'waves.kind = "{case.waves.kind}"'
    if not case.turbines:
        return "no turbine is given (by a key such as pto.K_dm)"
    (pto,), (name,) = case.turbines, case.chambers
    key = case.chamber_key(name, "pto")
    if pto.curve is not None or pto.has_relief:
        return f"{key}.curve is neither linear nor quadratic" if pto.curve else f"{key} has a relief valve"
    if pto.phase is not None:
        return f"{key}.phase varies the damping over the wave"
    if case.device.platform_height:
        return f"device.platform_height = {case.device.platform_height:g} m makes the bed uneven"
    return None
