"""Checks of the names that a case gives to its parts."""

from __future__ import annotations

from jaxsph.case.sections import DEVICE_CHAMBER, ONLY_BODY, TANK, Sections
from jaxsph.errors import CaseError
from jaxsph.model.consistency import RESERVED

LOSSES = ("contact", "hyperviscosity", "projection", "separation", "viscous")
"""Names of the energies that the water itself loses."""
TAKEN = ("body", "border", "chamber", "paddle", "rim", "sponge", "zone", TANK, *LOSSES)
"""Names that the program itself gives to parts, and that a case must not give to other parts."""


def check_names(case: Sections) -> None:
    """**Raises** CaseError for parts that share a name, or have a reserved name."""
    kinds = ("bodies", "link", "mooring", "solid", "chamber", "duct")
    named = [(f"{kind}.{name}", name) for kind in kinds for name in getattr(case, kind)]
    named += [(f"{case.body_key(body)}.pto", name) for body, name in case.pto_names.items()]
    if case.body is not None and ONLY_BODY in case.bodies:
        raise CaseError(f"bodies.{ONLY_BODY} and [{ONLY_BODY}] are the same body: give only one of them")
    usual = (f"chamber.{DEVICE_CHAMBER}", "" if case.body is not None else f"bodies.{ONLY_BODY}")
    for key, name in named:
        # a solid at rest is not stored in the snapshots
        taken = TAKEN if key.startswith("solid.") else TAKEN + RESERVED
        if name in taken and key not in usual:
            raise CaseError(f"{key}: the names {', '.join(taken)} are reserved; choose another name")
        twice = [other for other, one in named if one == name and other != key]
        if twice:
            raise CaseError(f"{key} and {twice[0]} have the same name: rename one of them")
