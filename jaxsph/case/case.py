"""A whole case: validation, changes by dotted names, TOML text."""

from __future__ import annotations

import difflib
import json
from typing import Any

from pydantic import BaseModel, ValidationError

from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.errors import CaseError
from jaxsph.waves import theory


class Case(Sections):
    """A whole case, in SI units. Immutable: `replace` gives a changed copy."""

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Case:
        """Validates a mapping. **Raises** CaseError that names field, value and what is allowed."""
        _known_keys(data, cls)
        try:
            case = cls.model_validate(data)
        except ValidationError as error:
            raise CaseError(_readable(error)) from None
        if case.pto is not None and case.pto.phase is not None and case.waves is None:
            raise CaseError(f"pto.phase = {case.pto.phase}: is over the phase of waves, and there are none")
        Geometry.of(case)  # refuses what does not fit the lattice
        return case

    def replace(self, changes: dict[str, Any]) -> Case:
        """A copy with fields changed, by dotted name: `case.replace({"pto.K_dm": 300.0})`."""
        data = self.model_dump(exclude_none=True, mode="json")
        for key, value in changes.items():
            *path, last = key.split(".")
            place = data
            for part in path:
                place = place.setdefault(part, {})
                if not isinstance(place, dict):
                    raise CaseError(f"{key}: {part} is a value, not a section")
            if value is None:
                place.pop(last, None)
            elif key == "pto.K_dm":
                place.pop("P_a", None)
                place[last] = value
            elif key == "pto.P_a":
                place.pop("K_dm", None)
                place.pop("phase", None)
                place[last] = value
            else:
                place[last] = value
        return Case.from_dict(data)

    def to_toml(self) -> str:
        """The whole case as TOML text, defaults included."""
        return _to_toml(self.model_dump(exclude_none=True, mode="json"))

    def notices(self) -> list[str]:
        """What was adjusted to the lattice, and limits of theory that the case oversteps."""
        notes = list(Geometry.of(self).notices)
        if self.waves is not None:
            notes += theory.theory_limits(self.waves.H, self.waves.T, self.tank.depth, self.g)
        if self.waves is not None and self.waves.H < 3 * self.dx:
            notes.append(
                f"waves.H = {self.waves.H:g} m is only {self.waves.H / self.dx:.1f} spacings high; "
                "expect visible decay along the tank (five or more are usual)"
            )
        return notes


def _known_keys(data: dict[str, Any], section: type[BaseModel], prefix: str = "") -> None:
    for key, value in data.items():
        fields = section.model_fields
        if key not in fields:
            everything = _all_keys(Case)
            near = [k for k in everything if k.lower() == (prefix + key).lower()]
            near = near or difflib.get_close_matches(prefix + key, everything, n=1, cutoff=0.5)
            near = near or [k for k in everything if k.rsplit(".", 1)[-1] == key]
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise CaseError(f"unknown key {prefix + key!r}{hint} (keys here: {', '.join(sorted(fields))})")
        inner = _section_type(fields[key].annotation)
        if inner is not None and isinstance(value, dict):
            _known_keys(value, inner, f"{prefix}{key}.")


def _section_type(annotation: Any) -> type[BaseModel] | None:
    for option in getattr(annotation, "__args__", (annotation,)):
        if isinstance(option, type) and issubclass(option, BaseModel):
            return option
    return None


def _all_keys(section: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for name, field in section.model_fields.items():
        inner = _section_type(field.annotation)
        keys.append(prefix + name)
        if inner is not None:
            keys += _all_keys(inner, f"{prefix}{name}.")
    return keys


def _readable(error: ValidationError) -> str:
    lines = []
    for item in error.errors():
        field = ".".join(str(part) for part in item["loc"]) or "case"
        value = (
            "" if item["type"] == "missing" or isinstance(item["input"], dict) else (f" = {item['input']!r}")
        )
        lines.append(f"{field}{value}: {item['msg']}")
    return "\n".join(lines)


def _to_toml(data: dict[str, Any], prefix: str = "") -> str:
    own = [f"{k} = {_toml_value(v)}" for k, v in data.items() if not isinstance(v, dict)]
    text = "\n".join(own) + "\n" if own else ""
    for key, value in data.items():
        if isinstance(value, dict):
            text += f"\n[{prefix}{key}]\n" + _to_toml(value, f"{prefix}{key}.")
    return text


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return repr(value)
