"""Fast theory, in time, of bodies whose links have laws that linear theory does not cover: latches, friction,
end stops and ropes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np

from jaxsph.case.bodies import link_laws
from jaxsph.case.case import Case
from jaxsph.case.linear_bodies import small_motions
from jaxsph.case.section import choice
from jaxsph.errors import CaseError
from jaxsph.model.links import AbstractLaw
from jaxsph.parts.links import Damper, EndStops, Friction, Latch, Laws, Spring
from jaxsph.study.fast_bodies import BodyTheory
from jaxsph.waves.body_motion import Tie, body_motion

__all__ = ["MotionTheory"]

LINK_FIELDS = {
    "damping": (Damper, "linear"),
    "quadratic": (Damper, "quadratic"),
    "friction": (Friction, "size"),
    "stop_stiffness": (EndStops, "stiffness"),
    "latch": (Latch, "hold"),
    "stiffness": (Spring, "stiffness"),
}
"""Laws of the keys of a link that a model can change, and the laws' fields."""
TAKE_OFF_FIELDS = {
    "damping": (Damper, "linear"),
    "coulomb": (Friction, "size"),
    "stop_stiffness": (EndStops, "stiffness"),
    "spring": (Spring, "stiffness"),
}
"""The same for the power take-off of a body."""
Change: TypeAlias = tuple[type[AbstractLaw], str, Any]
"""A kind of law, its field, and the field's new value."""
FAINT = 1e-6
"""Damping of a link in linear theory that has no other force there, N s/m or N m s."""


@dataclass(frozen=True)
class MotionTheory(BodyTheory):
    """Linear theory of the water, with drag and inertia of each free coordinate, and any law of the links.

    Motions are found in time.
    """

    laws: Mapping[str, AbstractLaw] = dataclasses.field(default_factory=dict)
    """Laws in the place of those of the case, by the names of the links."""

    smooth: ClassVar[bool] = False

    @classmethod
    def suits(cls, case: Case) -> bool:
        """Whether a link of a case has a law that needs motions in time."""
        ptos = (one.pto for one in case.every_body.values())
        return any(
            one.friction or one.latch_damping or one.stop_stiffness or one.slack for one in case.link.values()
        ) or any(pto.coulomb or pto.stop_stiffness for pto in ptos if pto is not None)

    @classmethod
    def why_not(cls, case):
        """See `AbstractFastTheory`."""
        if reason := super().why_not(case):
            return reason
        small = small_motions(cls.linear(case))
        for name, one in case.link.items():
            s = small.extensions[name]
            if one.stops is not None and not one.stops[0] <= s <= one.stops[1]:
                return f"link.{name}.stops: a stop acts at rest, and a fast model needs bodies between stops"
            if one.slack and one.stiffness * s + one.pretension < -FAINT:
                return f"link.{name} is slack at rest, and a fast model needs ropes that are taut there"
        return ""

    @classmethod
    def linear(cls, case):
        """See `BodyTheory`: without friction, latches and end stops, and with springs for ropes."""
        changes: dict[str, Any] = {}
        for name, one in case.link.items():
            omitted = {"friction": 0.0, "stops": None, "stop_stiffness": 0.0, "slack": False}
            omitted |= {"latch": None, "latch_damping": 0.0}
            if not (one.damping or one.quadratic):
                omitted["damping"] = FAINT
            changes |= {f"link.{name}.{key}": value for key, value in omitted.items()}
        for name, body in case.every_body.items():
            if body.pto is not None:
                key = f"{case.body_key(name)}.pto"
                changes |= {f"{key}.coulomb": 0.0, f"{key}.stop": math.pi, f"{key}.stop_stiffness": 0.0}
        return case.replace(changes)

    @classmethod
    def keys(cls, case):
        """See `AbstractFastTheory`; a key is its own name in `respond`. Keys of laws that the case does not
        have are left out."""
        signed = cls.signed(case)
        return {key: key for key, one in _known(case).items() if one.value or key in signed}

    def respond(self, added, values, waves):
        """See `AbstractFastTheory`."""
        return body_motion(self.water, added, self._ties(values), waves)

    def _ties(self, values: Any) -> tuple[Tie, ...]:
        """Links with changed laws."""
        found, of_link = [], self._changes(values)
        laws = {**link_laws(self.case, np.float32), **self.laws}
        for (name, link), way in zip(self.small.links.items(), self.water.ways, strict=True):
            link = dataclasses.replace(link, law=_changed(name, laws[name], of_link.get(name, [])))
            numbers = self.small.extensions[name], self.small.stiffness[name]
            found.append(Tie(link, way, *(jnp.asarray(a, jnp.float32) for a in numbers)))
        return tuple(found)

    def _changes(self, values: Any) -> dict[str, list[Change]]:
        """Laws that change, their fields and new values, by the names of the links."""
        found: dict[str, list[Change]] = {}
        known = _known(self.case)
        for key, value in values.items():
            link, kind, field, _ = known[key]
            if kind is Spring:
                self.check_at_rest(link)
            found.setdefault(link, []).append((kind, field, value))
        return found

    @classmethod
    def with_laws(cls, theory: BodyTheory, laws: Mapping[str, AbstractLaw]) -> MotionTheory:
        """A theory with other laws of links, by their names. **Raises** CaseError for a link that is not
        there."""
        for name in laws:
            if name not in theory.small.links:
                raise CaseError(f"{name}: there is no such link; {choice(theory.small.links, 'links')}")
        return cls(theory.case, theory.water, theory.small, theory.dampers, dict(laws))

    def results(self, response):
        """See `AbstractFastTheory`."""
        found = {"xi": response.xi, "P_pto": response.P_pto}
        for name, way in self.small.swings.items():
            found[name] = jnp.abs(response.sizes @ jnp.asarray(way, jnp.float32))
        return found


class _Key(NamedTuple):
    """A number of a link in a case."""

    link: str
    """Name of the link."""
    kind: type[AbstractLaw]
    """Law that the number belongs to."""
    field: str
    """Field of the law."""
    value: float | None


def _known(case: Case) -> dict[str, _Key]:
    """Numbers of the links of a case that a model can change, by their keys."""
    ptos = {
        case.pto_names[name]: (f"{case.body_key(name)}.pto", one.pto)
        for name, one in case.every_body.items()
        if one.pto
    }
    links = {name: (f"link.{name}", one) for name, one in case.link.items() if not one.slack}
    return {
        f"{section}.{of}": _Key(name, kind, field, getattr(one, of))
        for each, fields in ((ptos, TAKE_OFF_FIELDS), (links, LINK_FIELDS))
        for name, (section, one) in each.items()
        for of, (kind, field) in fields.items()
    }


def _changed(name: str, law: AbstractLaw, changes: list[Change]) -> AbstractLaw:
    """The law of the link `name` with other values of its fields, and with a spring if its stiffness changes.

    **Raises** CaseError for changes of a law that is not that of the case.
    """
    if not changes:
        return law
    if not isinstance(law, Laws):
        raise CaseError(f"{name} has a law of your own, whose parameters are not keys of the case")
    each = list(law.laws)
    for kind, of, value in changes:
        if kind is Spring and not any(isinstance(one, Spring) for one in each):
            each.append(Spring(*(jnp.zeros((), jnp.float32) for _ in range(2))))
        each = [dataclasses.replace(one, **{of: value}) if isinstance(one, kind) else one for one in each]
    return Laws(tuple(each))
