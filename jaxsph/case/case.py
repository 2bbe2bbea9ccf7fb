"""`Case`: a validated case, which can be changed by dotted names, with its TOML text and its notices."""

from __future__ import annotations

import difflib
import functools
import typing
from typing import Any

from pydantic import BaseModel, ValidationError

from jaxsph.case.air_sections import DEVICE_WALLS, LAWS, SMOOTH_LAWS, air_keys
from jaxsph.case.build import build
from jaxsph.case.expected import instead
from jaxsph.case.flume import border_results, check_flume
from jaxsph.case.forecasts import forecasts
from jaxsph.case.geometry import Geometry
from jaxsph.case.limits import check_limits
from jaxsph.case.moorings import check_moorings
from jaxsph.case.notices import limit_notices
from jaxsph.case.numbers import as_number, unit_in
from jaxsph.case.position_notices import position_notices
from jaxsph.case.probes import make_probes
from jaxsph.case.results import SettledPeriods, case_results, mean_of_power
from jaxsph.case.scheme import remedies
from jaxsph.case.section import NAME, Section, by_name, kind_of, meanings
from jaxsph.case.sections import BODY_KEYS, DEVICE_CHAMBER, KINDS, Sections
from jaxsph.errors import CaseError
from jaxsph.problem.problem import Problem
from jaxsph.problem.record import WholeRecord
from jaxsph.problem.toml import toml_text, toml_value

SMOOTH = (
    *air_keys(SMOOTH_LAWS),
    "air.volume",
    f"chamber.{NAME}.air.volume",
    "waves.H",
    "fluid.nu",
    "fluid.rho0",
    "scheme.alpha",
    "scheme.delta",
    "sponge.strength",
    *(f"{body}.pto.{key}" for body in BODY_KEYS for key in ("damping", "coulomb", "spring")),
    *(f"{body}.{key}" for body in BODY_KEYS for key in ("mass", "inertia", "density")),
    *(f"link.{NAME}.{key}" for key in ("stiffness", "pretension", "damping", "quadratic", "friction")),
    *(f"mooring.{NAME}.{key}" for key in ("length", "axial_stiffness", "weight", "mass", "lines")),
)
"""Keys on which a model depends smoothly, for methods that differentiate through the time loop. The lengths
of the tank, the device, the solids and the bodies are excluded, because a change of a length changes the
lattice."""

MEANT = ("missing", "greater_than_equal", "less_than_equal", "greater_than", "less_than")
"""Types of errors (value missing or out of range) whose messages include the meaning of the key."""
LEAST = 1e-3
"""Lower limit of a range up to which the message for a value of zero or less asks for a positive value."""


class Case(Sections):
    """Validated description of a run, in SI units. A case is immutable; `replace` returns a changed copy."""

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Case:
        """Case from a mapping, as read from a TOML file. **Raises** CaseError, which names the field, the
        value and what is allowed."""
        if not isinstance(data, dict):
            raise CaseError(f"a case must be a mapping of keys and sections, not {_shown(data)}")
        data = _plain(data)
        _check_keys(data)
        try:
            case = cls.model_validate(data)
        except ValidationError as error:
            raise CaseError(_readable(error)) from None
        geometry = Geometry.of(case)
        check_limits(case, geometry)
        check_flume(case, geometry)
        check_moorings(case, geometry)
        return case

    def replace(self, changes: dict[str, Any]) -> Case:
        """Copy of the case with keys changed by dotted name, for example `case.replace({"pto.K_dm": 300.0})`.

        None removes a key. A new `scheme.kind` or `waves.kind` starts from the defaults of that kind,
        because values of one kind have no meaning in another. A new law of `pto` replaces the previous one.
        **Raises** CaseError, as `from_dict` does.
        """
        data = self.model_dump(exclude_none=True, mode="json")
        for name in KINDS:
            kind = data.get(name, {}).get("kind")
            if changes.get(f"{name}.kind", kind) != kind:
                data.pop(name, None)
        for key, value in changes.items():
            if value is None and key not in key_names(Case):
                _check_keys(_nested(key))  # raises an error for a key that no section has
            *path, last = key.split(".")
            place = data
            for part in path:
                place = place.setdefault(part, {})
                if not isinstance(place, dict):
                    raise CaseError(f"{key}: {part} is a value, not a section; set {part} itself")
            if value is None:
                place.pop(last, None)
            else:
                if path[-1:] == ["pto"] and path[0] not in ("body", "bodies") and last in LAWS:
                    for gone in place.keys() - {last, *LAWS[last]}:
                        place.pop(gone)
                place[last] = value
        return Case.from_dict(data)

    def problem(self) -> Problem:
        """Builds the problem: model, initial state, probes and results. **Raises** CaseError."""
        model, state = build(self)
        return Problem(
            model,
            state,
            self.output.sample_dt,
            self.t1,
            probes=make_probes(self, model, state),
            results=case_results(self) + border_results(self),
            snapshot_dt=self.output.snapshot_dt,
            name=self.name,
            description=self.description,
            averaging=WholeRecord() if self.waves is None else SettledPeriods(self),
            mean_of_power=functools.partial(mean_of_power, self),
            remedies=remedies(self),
        )

    def value(self, name: str) -> Any:
        """Value of a key, by dotted name; None if the case does not give the key. **Raises** CaseError for
        an unknown key."""
        value = functools.reduce(inner, name.split("."), self)
        if value is None:
            self.replace({name: 1.0})  # raises an error, with a suggestion, if there is no such key
        return value

    def built(self, name: str) -> Any:
        """Value of a key in the model: lengths in `Geometry.rounded` are rounded to whole spacings, all other
        values are as given."""
        return Geometry.of(self).rounded.get(name, self.value(name))

    def roughness(self, name: str) -> str:
        """Reason why the model may not depend smoothly on a key; empty if the dependence is smooth."""
        if self.flume is not None:
            return "slopes through the time loop do not include the flume"
        return (
            "" if any_name(name) in SMOOTH else f"the time loop depends smoothly only on {', '.join(SMOOTH)}"
        )

    def to_toml(self) -> str:
        """TOML text of the whole case, defaults included."""
        return toml_text(self.model_dump(exclude_none=True, mode="json"))

    def expanded(self) -> Case:
        """The same case with the short forms `pto` and `air` moved to the section of the device's chamber."""
        given = self.given()
        own = {key: given.pop(key) for key in ("pto", "air") if key in given}
        if not own:
            return self
        chamber = {"between": DEVICE_WALLS, **own}
        return Case.from_dict(given | {"chamber": {DEVICE_CHAMBER: chamber, **given.get("chamber", {})}})

    def given(self) -> dict[str, Any]:
        """Values of the case that differ from the defaults, and the kinds of the scheme and the waves."""
        data = self.model_dump(exclude_defaults=True, exclude_none=True, mode="json")
        kinds = {name: getattr(self, name).kind for name in KINDS if getattr(self, name) is not None}
        return data | {name: {"kind": kind, **data.get(name, {})} for name, kind in kinds.items()}

    def notices(self, ended: bool = False) -> list[str]:
        """Notices for the user about lengths changed by rounding, limits that the case approaches or exceeds,
        doubtful positions and densities, and the averages of its run. `ended`: whether the run has ended and
        has its own notices of the averages."""
        geometry = Geometry.of(self)
        found = [*geometry.notices, *limit_notices(self, geometry), *position_notices(self, geometry)]
        return found if ended else [*found, *forecasts(self)]


def any_name(key: str) -> str:
    """Dotted key with `NAME` in place of the name chosen in the case: "solid.bed.disc" becomes
    "solid.NAME.disc"."""
    first, *rest = key.split(".")
    field = Case.model_fields.get(first)
    if field is None or not rest or not by_name(field.annotation):
        return key
    return ".".join([first, NAME, *rest[1:]])


def inner(part: Any, key: str) -> Any:
    """Value of a key in a section, or in a mapping of sections; None if the key is absent."""
    return part.get(key) if isinstance(part, dict) else getattr(part, key, None)


def _plain(value: Any, name: str = "case", depth: int = 0) -> Any:
    """Converts lists and arrays to tuples and NumPy scalars to Python numbers, as the sections require."""
    if depth > 10:
        raise CaseError(f"{name}: lists or sections are nested too deeply; use at most ten levels")
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise CaseError(f"{_shown(key)}: the name of a key must be text")
        inner = "" if depth == 0 else f"{name}."
        return {key: _plain(part, inner + key[:100], depth + 1) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_plain(part, name, depth + 1) for part in value)
    if hasattr(value, "tolist"):
        return _plain(value.tolist(), name, depth + 1)
    return value


def _shown(value: Any) -> str:
    """Value as text for a message, shortened if it is long."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested lists, or an integer of thousands of digits
        text = f"an integer of {value.bit_length()} bits" if isinstance(value, int) else "..."
    return text if len(text) <= 120 else f"{text[:100]}... ({len(text)} characters)"


def _check_keys(data: dict[str, Any]) -> None:
    """**Raises** CaseError for the first unknown key; the message suggests the most similar known key."""
    if "isph" in data:
        raise CaseError(_instead_of_isph(data["isph"]))
    _check_section(data, Case, "")


def _nested(key: str) -> dict[str, Any]:
    """Mapping with an empty section at a dotted key."""
    first, _, rest = key.partition(".")
    return {first: _nested(rest) if rest else {}}


def _check_section(data: dict[str, Any], section: type[BaseModel], prefix: str) -> None:
    """**Raises** CaseError for the first unknown key of a section; `prefix`: the section's dotted name."""
    for key, value in data.items():
        fields = section.model_fields
        if key not in fields:
            raise CaseError(_unknown_key(key, section, prefix))
        inner = section_in(fields[key].annotation)
        if prefix + key in KINDS and not (value is None and key == "waves"):
            inner = _kind(key, value)
        if inner is None or not isinstance(value, dict):
            continue
        if not by_name(fields[key].annotation):
            _check_section(value, inner, f"{prefix}{key}.")
            continue
        for name, one in value.items():
            if isinstance(one, dict):
                _check_section(one, inner, f"{prefix}{key}.{name}.")


def _unknown_key(key: str, section: type[BaseModel], prefix: str) -> str:
    """Message for a key that a section does not have."""
    here = ", ".join(sorted(section.model_fields))
    kinds = KINDS.get(prefix.removesuffix("."), {})
    if kinds:
        kind = section.model_fields["kind"].default
        others = [other for other, keys in kinds.items() if other != kind and key in keys.model_fields]
        if others:
            those = " or ".join(f'"{other}"' for other in others)
            return (
                f'{prefix}{key} belongs to {prefix}kind = {those}, and this case has "{kind}": '
                f"remove the key, or change the kind (keys here: {here})"
            )
    everything = key_names(Case)
    name = _shown(prefix + key)
    near = [k for k in everything if k.lower() == (prefix + key).lower()]
    if not near and (there := instead(prefix + key)):
        return f"unknown key {name}: {there} (keys here: {here})"
    near = near or difflib.get_close_matches((prefix + key)[:100], everything, n=1, cutoff=0.5)
    near = near or [k for k in everything if k.rsplit(".", 1)[-1] == key]
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"unknown key {name}{hint} (keys here: {here})"


def _kind(name: str, data: Any) -> type[Section]:
    """Class of the section `name`, for the kind in its `data`. **Raises** CaseError for an unknown kind."""
    kinds = KINDS[name]
    if not isinstance(data, dict):
        raise CaseError(f"{name} = {_shown(data)}: must be a section, [{name}]")
    kind = kind_of(kinds)(data)
    if not isinstance(kind, str) or kind not in kinds:
        allowed = " or ".join(f'"{one}"' for one in kinds)
        raise CaseError(f"{name}.kind = {_shown(kind)}: must be {allowed}")
    return kinds[kind]


def _instead_of_isph(section: Any) -> str:
    """Message that shows the replacement of a section `isph`, which older cases have."""
    keys = section if isinstance(section, dict) else {}
    own = "".join(f"{key} = {toml_value(value)}\n" for key, value in keys.items())
    return (
        "isph: a case has one section for its scheme. Replace [isph] and [scheme] by:\n"
        f'[scheme]\nkind = "incompressible"\n{own}'.rstrip()
    )


def section_in(annotation: Any) -> type[BaseModel] | None:
    """Section class in the annotation of a field (the first, if the field allows several), or None."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (section_in(option) for option in typing.get_args(annotation))
    return next((one for one in found if one is not None), None)


def key_names(section: type[BaseModel], prefix: str = "") -> list[str]:
    """Dotted names of all keys of a section and of its subsections."""
    keys = []
    for name, field in section.model_fields.items():
        name = f"{name}.{NAME}" if by_name(field.annotation) else name
        keys.append(prefix + name)
        if prefix + name in KINDS:
            kinds = KINDS[name].values()
            keys += dict.fromkeys(f"{name}.{key}" for kind in kinds for key in kind.model_fields)
            continue
        inner = section_in(field.annotation)
        if inner is not None:
            keys += key_names(inner, f"{prefix}{name}.")
    return keys


def _readable(error: ValidationError) -> str:
    """Message with a line for each of the first five errors: the field, the value and what is allowed."""
    lines = []
    found = error.errors()
    for item in found[:5]:
        # pydantic's path contains the kind of a scheme or of waves, which is not a field
        path = [part for i, part in enumerate(item["loc"]) if i != 1 or item["loc"][0] not in KINDS]
        path = [part for part in path if part != "[key]"]  # marks a name chosen in the case
        field = ".".join(str(part) for part in path) or "case"
        value = (
            ""
            if item["type"] == "missing" or isinstance(item["input"], dict)
            else f" = {_shown(item['input'])}"
        )
        words = _in_toml_words(item["msg"])
        if item["type"] == "float_type" and isinstance(item["input"], str):
            words += as_number(item["input"], unit_in(_description(item["loc"])))
        if item["type"] == "greater_than_equal" and _needs_positive(item["input"], **item.get("ctx", {})):
            words = "must be positive"
        if item["type"] in MEANT:
            words = words.replace("Field required", "is missing") + _meaning(item["loc"])
        lines.append(f"{field}{value}: {words}")
    if len(found) > 5:
        lines.append(f"... and {len(found) - 5} more")
    return "\n".join(lines)


def _needs_positive(given: Any, ge: float) -> bool:
    """Whether a number is zero or less, and the lower limit `ge` of its range is positive but very small."""
    return given <= 0.0 < ge <= LEAST


def _in_toml_words(message: str) -> str:
    """Message of the validator, with TOML's names for Python's types."""
    message = message.removeprefix("Value error, ").replace(" after validation", "")
    if message.startswith("Input should be a valid dictionary"):
        return "must be a section"
    if message.startswith("String should match pattern"):  # only the name of a case has a pattern
        return "must not contain slashes or control characters"
    message = message.replace("valid tuple", "list").replace("Tuple", "The list")
    message = message.replace("a valid integer", "an integer").replace("be a valid", "be a")
    return message.replace("Input should be", "must be")


def _meaning(place: tuple[str | int, ...]) -> str:
    """Meaning of a key, in brackets; empty if no meaning is given. `place`: path of the key in the case."""
    words = _description(place)
    return f" ({words.rstrip('.')})" if words else ""


def _description(place: tuple[str | int, ...]) -> str:
    """Description of a key in its section; empty if the key is not described. `place`: path of the key."""
    section: Any = Case
    words, kinds, names = "", {}, False
    for part in place:
        if part in kinds:  # pydantic's path contains the kind of a scheme or of waves
            section, kinds = kinds[part], {}
            continue
        if names:  # a name chosen in the case
            names = False
            continue
        field = getattr(section, "model_fields", {}).get(part)
        if field is None:
            return ""
        words, kinds = meanings(section).get(str(part), ""), KINDS.get(str(part), {})
        section, names = section_in(field.annotation), by_name(field.annotation)
    return words
