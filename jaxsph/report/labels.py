"""Labels of results: text, unit and meaning of the standard scalar results of a run."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from jaxsph.model.meaning import Group, Label
from jaxsph.model.rigid import SPACES, space_with
from jaxsph.output.hdf5 import Variable
from jaxsph.problem.results import LINEAR

_WHOLE = "times the ratio of the whole sea's incident power to that of the averaged part"
_DEVICE = {
    "xi": Label(
        "hydrodynamic efficiency",
        "",
        "absorbed over incident power of the target waves (energies for a wave group)",
    ),
    "xi_error": Label(
        "  efficiency: standard error",
        "",
        "from the changes within this run only; the error of the spacing is not included",
    ),
    "xi_scatter": Label(
        "  efficiency: scatter between periods",
        "",
        "standard deviation of the efficiencies of single periods",
    ),
    "xi_measured": Label(
        "  efficiency: from the measured incident power",
        "",
        "absorbed power over the incident power at the gauges",
    ),
    "capture_width": Label("capture width", "m", "absorbed power over incident power per metre of crest"),
    "P_owc": Label("absorbed power", "W/m", "mean power of the turbines, and of the bodies' power take-offs"),
    "P_owc_sea": Label("  absorbed power: in the whole sea", "W/m", _WHOLE),
    "P_pto": Label("absorbed power", "W/m", "mean power of the bodies' power take-offs"),
    "P_pto_sea": Label("  absorbed power: in the whole sea", "W/m", _WHOLE),
}
_WAVES = {
    "periods": Label("periods averaged", "", "number of whole periods at the end of the run"),
    "periods_left_out": Label(
        "  earlier periods left out", "", "waves had arrived, but the means of the periods still had a trend"
    ),
    "P_inc": Label(
        "incident power over the averaged periods", "W/m", "of the target waves in these periods, by theory"
    ),
    "P_inc_sea": Label(
        "  incident power: of the whole sea",
        "W/m",
        "of the target sea, by theory; given if only a part of the sea is averaged",
    ),
    "E_inc": Label("energy of the group", "J/m", "of the target waves, by theory"),
    "incident_height": Label("incident wave height", "m", "measured by the gauges"),
    "Hm0": Label("significant height of the incident waves", "m", "measured by the gauges"),
    "Te": Label("energy period of the incident waves", "s", "measured by the gauges"),
    "P_inc_measured": Label("measured incident power", "W/m", "of the incident waves at the gauges"),
    "reflection": Label("reflection coefficient", "", "height of reflected over height of incident waves"),
}
_NUMERICS = {
    "energy_paddle": Label(
        "work done by the paddle",
        "J/m",
        "energy given to the water by the wavemaker while results were averaged",
    ),
    "energy_stored": Label("  stored in the water", "J/m", "kinetic, potential and compression energy"),
    "energy_pto": Label("  absorbed by the PTO", "J/m"),
    "energy_sponge": Label("  absorbed by the sponge", "J/m"),
    "energy_viscous": Label("  viscous loss", "J/m"),
    "energy_diffusive": Label(
        "  loss by density diffusion", "J/m", "numerical loss due to the smoothing of the density"
    ),
    "energy_hyperviscosity": Label(
        "  loss by hyperviscosity", "J/m", "numerical loss due to the damping of particle noise"
    ),
    "energy_separation": Label("  lost in separating clumped particles", "J/m", "numerical"),
    "energy_contact": Label("  lost in contact with solids", "J/m"),
    "energy_projection": Label(
        "  lost in the projection",
        "J/m",
        "numerical: pressure work not converted into kinetic energy of the water; negative for a gain",
    ),
    "energy_residual": Label(
        "  not accounted for", "J/m", "work minus all other energies of the budget; zero in an exact budget"
    ),
    "energy_residual_share": Label(
        "  not accounted for, share",
        "",
        "over the paddle's work or the largest kinetic energy, whichever is larger; a few hundredths at most",
    ),
    "noise": Label(
        "noise of the particles, relative to their speed",
        "",
        "deviation of velocities from those of neighbours: below 0.1 in a good run, doubtful above 0.15",
    ),
    "t_end": Label("end of the run", "s"),
    "steps": Label("time steps"),
    "wall_seconds": Label("wall time", "s", "compilation included"),
    "particle_steps_per_second": Label("particle steps per second", "1/s"),
}
_NUMERICS |= {
    f"whole_{name}": label._replace(text=f"{label.text}, whole run", meaning="from the start of the run")
    for name, label in _NUMERICS.items()
    if name.startswith("energy_")
}
LABELS = {
    name: label._replace(group=group)
    for group, labels in ((Group.DEVICE, _DEVICE), (Group.WAVES, _WAVES), (Group.NUMERICS, _NUMERICS))
    for name, label in labels.items()
}
"""Labels of the scalar results in two dimensions, in the order of a table."""

OF_PROGRAM = ("periods", "periods_left_out", "steps", "wall_seconds", "particle_steps_per_second")
"""Names of the results that describe the run and not the water or the device."""

PER_METRE = ("P_inc", "P_inc_sea", "E_inc", "P_inc_measured")
"""Names of the results that are per metre of width in three dimensions too."""


def in_order(results: Collection[str], own: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """Names of results in the order of a table: by group, each followed by its linear-theory value.

    `own`: labels of results outside `LABELS`, in their order in a table.
    """
    known, own = list(LABELS), own or {}
    for name in own:
        if name not in LABELS:  # an energy is placed with the other energies, before the residual
            whole, energy, _ = name.partition("energy_")
            rest = f"{whole}energy_residual"
            known.insert(known.index(rest) if energy and rest in known else len(known), name)
    known += [name for name in results if name not in known]
    groups = list(Group)

    def key(name: str) -> tuple[int, int, bool]:
        base = name.removeprefix(LINEAR)
        group = groups.index(Group(label_of(base, True, own).group))
        return group, known.index(base if base in known else name), base != name

    return sorted(results, key=key)


def label_of(name: str, flat: bool, own: Mapping[str, Sequence[str]] | None = None) -> Label:
    """Label of a result; units are per metre of width only in two dimensions (`flat`) and for `PER_METRE`.

    `own`: text, unit, meaning and group of results outside `LABELS`.
    """
    if name.startswith(LINEAR) and name not in (own or {}):
        of = label_of(name.removeprefix(LINEAR), flat, own)
        return of._replace(text=f"  {of.text.strip()}: linear theory", meaning="")
    if name not in LABELS:
        return Label(*(own or {}).get(name, (name,)))
    found = LABELS[name]
    per_metre = flat or name in PER_METRE
    return found if per_metre else found._replace(unit=found.unit.removesuffix("/m"))


def components_of(variable: Variable, count: int) -> dict[str, str]:
    """Short names of the components of a reading of a rigid body, with their descriptions; empty for others.

    `count`: number of components. The components are forces ("x", "z", "moment") or velocities ("surge").
    """
    if variable.dim != "motion" or count not in (len(space.motions) for space in SPACES.values()):
        return {}
    space = space_with(count)
    if not variable.units.startswith("N"):
        return {name: name for name in space.motions}
    found = {name.removeprefix("force_"): words for name, words in space.loads.items()}
    return {
        name: words if name.startswith("moment") else f"{words.removeprefix('force ')} ({name})"
        for name, words in found.items()
    }


def is_flat(keys: Mapping[str, Any]) -> bool:
    """Whether a case with these keys is two-dimensional, with results per metre of width."""
    return keys.get("tank", {}).get("width") is None


def short(label: Label) -> str:
    """Text of a label in a table; if the label belongs to the row above, only the words after its colon."""
    text = label.text
    return f"  {text.rsplit(': ', 1)[-1].strip()}" if text.startswith(" ") else text


def in_words(value: float) -> str:
    """Value of a result as shown in a table: four digits, or a whole number."""
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value)}"
    return f"{value:.4g}"


def with_error_in_words(value: float, error: float) -> str:
    """Value and error of a result with the digits that the error leaves, such as 0.68 ± 0.03."""
    if not math.isfinite(error) or error == 0.0:
        return in_words(value)
    digits = 1 - math.floor(math.log10(error))
    if digits < 0:
        value, error = round(value, digits), round(error, digits)
    return f"{value:.{max(digits, 0)}f} ± {error:.{max(digits, 0)}f}"
