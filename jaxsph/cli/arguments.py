"""Arguments and options shared by several commands, and functions that parse their values."""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import typer

from jaxsph.cli.terminal import print_notes
from jaxsph.errors import CaseError
from jaxsph.run import interrupt


def complete_case(begun: str) -> list[str]:
    """Names of built-in cases and of TOML files in the current folder that begin with `begun`."""
    import jaxsph as js

    names = [*js.built_in_cases(), *(str(path) for path in sorted(Path().glob("*.toml")))]
    return [name for name in names if name.startswith(begun)]


def _complete_key(begun: str) -> list[str]:
    """Keys of a case that begin with `begun`, each followed by an equals sign."""
    from jaxsph.case.case import key_names
    from jaxsph.case.sections import Sections

    return [f"{name}=" for name in sorted(key_names(Sections)) if name.startswith(begun)]


CaseName = Annotated[
    str,
    typer.Argument(
        metavar="CASE",
        help="A TOML file, a built-in case, or FILE.py:FUNCTION for a function that returns a Problem.",
        autocompletion=complete_case,
    ),
]


ProfiledName = Annotated[
    str,
    typer.Argument(
        metavar="CASE",
        help="As for `jaxsph run`, or the file of a run: steps after its last checkpoint are then measured.",
        autocompletion=complete_case,
    ),
]


RunName = Annotated[Path, typer.Argument(metavar="FILE", help="File written by jaxsph, such as runs/owc.h5.")]


Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change one value, e.g. --set pto.K_dm=300. KEY= without a value removes the key; the file of a "
        "search, e.g. --set runs/owc_optimum.h5, gives the values of its best device. Repeatable.",
        autocompletion=_complete_key,
    ),
]


Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change one value for the rest of the run, e.g. --set tank.height=1.5. Only changes that do not "
        "move particles or walls are possible. Repeatable.",
    ),
]


EndTime = Annotated[float | None, typer.Option("--t1", metavar="S", help="End time of the run, s.")]


Devices = Annotated[
    int | None,
    typer.Option(
        "--devices",
        metavar="N",
        help="Number of accelerators, or of CPU cores used as devices, among which the run's particles are "
        "divided; default: as many as speed it up. The cores of a CPU share the native loops of one device.",
    ),
]


Process = Annotated[
    str | None,
    typer.Option(
        "--process",
        metavar="K/N@HOST:PORT",
        help="Run as process K (from 0) of N that share the run and connect at HOST:PORT. "
        "Under Slurm or MPI: auto.",
    ),
]


Quick = Annotated[
    bool, typer.Option("--quick", help="A coarse first look: larger particles, a shorter run, no pictures.")
]


Workers = Annotated[int | None, typer.Option(help="Number of runs at a time; default: one per core.")]


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


Table = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Scatter table (CSV with Hs, Tp and share or hours) or record of a site (.nc, .txt), for the "
        "mean power over its seas.",
    ),
]


Scale = Annotated[
    float,
    typer.Option(help="Lengths at the site of --table over those of the case (Froude's law), e.g. 40."),
]


class Way(enum.StrEnum):
    """Command-line name of a method for a slope (the derivative of a result); see `jaxsph.study`."""

    ensemble = enum.auto()
    filtered = enum.auto()
    exact = enum.auto()
    model = enum.auto()

    def of(
        self, spread: float | None, members: int, out: Path | None = None, model: Path | None = None
    ) -> Any:
        """Method of `jaxsph.study` with this name; only those with several runs use the arguments.

        **Raises** CaseError for the file of a `model` with another method.
        """
        import jaxsph as js

        if model is not None and self is not Way.model:
            raise CaseError(f"--model {model}: needs --method model, not {self.value}")
        runs = {"members": members, "out": out} | ({} if spread is None else {"spread": spread})
        match self:
            case Way.ensemble:
                return js.Ensemble(**runs)
            case Way.filtered:
                return js.Filtered()
            case Way.exact:
                return js.Exact()
            case Way.model:
                return js.Calibrated(dataclasses.replace(js.Calibrated().ensemble, **runs), model)


Spread = Annotated[
    float | None,
    typer.Option(
        help="Largest change of the parameter to either side, as a share of its value; default: "
        "0.3, of a slope with a model 0.5."
    ),
]


Method = Annotated[
    Way,
    typer.Option(
        help="ensemble: many runs, gives a standard error; filtered: one run, gives a biased slope; "
        "exact: one run, useful only if t1 is a fraction of a second; model: runs and a fast model of the "
        "device, for parameters and results that such a model has."
    ),
]


Pictures = Annotated[bool, typer.Option("--plot/--no-plot", help="Draw pictures after the run.")]


Page = Annotated[
    bool, typer.Option("--report/--no-report", help="Write an HTML page with the results next to the file.")
]


Program = Annotated[
    str | None,
    typer.Option(
        "--program",
        metavar="FILE.py:FUNCTION",
        help="Function that built the problem of the run; not needed for the run of a case. For safety, "
        "jaxsph never imports code that is only named in a file.",
    ),
]


def load(
    name: str,
    settings: list[str] | None,
    quick: bool = False,
    t1: float | None = None,
    stored: Mapping[str, Any] = MappingProxyType({}),
) -> Any:
    """Loads a case by name, or a program FILE.py:FUNCTION, with the values of --set; sets JAX's precision.

    `quick`: whether to return the coarse form of the case, for a first look; `t1`: its new end time, s;
    `stored`: values before those of --set.
    """
    import jaxsph as js

    changes = dict(stored)
    for text in settings or ():
        changes |= _best_of(text) if is_search(text) else dict([setting_of(text)])
    is_program = ".py" in name
    if is_program:
        case = js.Program.load(name, {key: value for key, value in changes.items() if value is not None})
    else:
        given = js.load_case(name)
        case = given.replace(changes) if changes else given
        if isinstance(case, js.Case):
            print_notes(_dropped(given, case, changes))
    match_precision(case.arguments.get("precision") if is_program else getattr(case, "precision", None))
    interrupt.raise_again()
    case = js.coarsen(case) if quick else case
    return case if t1 is None else case.replace({"t1": t1})


def _dropped(before: Any, after: Any, changes: dict[str, Any]) -> list[str]:
    """Notes on the keys that a case loses because `changes` set another alternative."""
    keys, left = (_values(case.model_dump(exclude_defaults=True, mode="json")) for case in (before, after))
    gone = {
        key: value
        for key, value in keys.items()
        if key not in left and not any(f"{key}.".startswith(f"{changed}.") for changed in changes)
    }
    because = ", ".join(f"{key} = {value}" for key, value in changes.items() if value is not None)
    return [f"{key} = {value} of the case no longer applies with {because}" for key, value in gone.items()]


def _values(section: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values of nested sections by dotted name."""
    found = {}
    for name, value in section.items():
        found |= _values(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return found


def is_search(text: str) -> bool:
    """Whether a setting is the file of a search."""
    return "=" not in text and text.strip().endswith(".h5")


def _best_of(text: str) -> dict[str, float]:
    """Values of the best device of a search, from its file, which are printed as a note."""
    from jaxsph.study.optimise import best_parameters

    found = best_parameters(text.strip())
    print_notes([f"{', '.join(f'{key} = {value:.4g}' for key, value in found.items())} by {text.strip()}"])
    return found


def setting_of(text: str) -> tuple[str, Any]:
    """Parses "a.b=value" into ("a.b", value): the value as TOML, or as text if not valid TOML; None if
    empty."""
    key, equals, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not key or not equals:
        raise CaseError(f"--set {text!r}: must be KEY=VALUE, such as --set pto.K_dm=300")
    if not value:
        return key, None
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value


def values_of(text: str, option: str = "--grid") -> tuple[str, list[float]]:
    """Parses "a.b=1,2,3" or "a.b=first:last:count" into ("a.b", values); integers if written as integers."""
    from jaxsph.study.sweep import MOST_MEMBERS

    key, equals, value = (part.strip() for part in text.partition("="))
    shown, before = (value, "") if option == f"--{key}" else (text, "KEY=")
    values: list[float] = []
    with contextlib.suppress(ValueError):  # values that are not numbers are refused below
        if value.count(":") == 2:
            first, last, number = value.split(":")
            count = int(number)
            if count > MOST_MEMBERS:
                raise CaseError(f"{option} {shown!r}: COUNT must be {MOST_MEMBERS} or less")
            step = (float(last) - float(first)) / max(count - 1, 1)
            values = [float(first) + k * step for k in range(count)]
        else:
            values = [float(part) for part in value.split(",")]
    if not key or not equals or not values or not all(map(math.isfinite, values)):
        raise CaseError(
            f"{option} {shown!r}: must be {before}VALUE,VALUE or {before}FIRST:LAST:COUNT, with finite "
            "numbers and a COUNT of 1 or more"
        )
    if "." not in value and all(one.is_integer() and abs(one) < 2**53 for one in values):
        values = [int(one) for one in values]  # a seed must be an integer
    return key, values


def each_once(pairs: Iterable[tuple[str, Any]], option: str) -> dict[str, Any]:
    """Dictionary of the pairs of key and value. **Raises** CaseError if a key is given twice."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise CaseError(f"{option} {key} is given twice; use only one {option} for each key")
        found[key] = value
    return found


def bounds_of(text: str) -> tuple[str, tuple[float, float]]:
    """Parses "a.b=low:high" into ("a.b", (low, high))."""
    key, _, value = (part.strip() for part in text.partition("="))
    try:
        low, high = (float(part) for part in value.split(":"))
    except ValueError:
        raise CaseError(f"--over {text!r}: must be KEY=LOW:HIGH, such as --over pto.K_dm=100:2500") from None
    return key, (low, high)


def table_of(path: Path | None, scale: float) -> Any:
    """Scatter table from its file, at the scale of the case; None without a file.

    `scale`: lengths at the site of the table over those of the case. **Raises** CaseError for a scale that is
    not positive, or one without a table.
    """
    from jaxsph.report.froude import check_scale
    from jaxsph.study.scatter import ScatterTable

    check_scale(scale)
    if path is not None:
        return ScatterTable.read(path).at_scale(scale)
    if scale != 1.0:
        raise CaseError(f"--scale {scale:g}: needs --table, which is that of a site of this scale")
    return None


def match_precision(precision: str | None) -> None:
    """Switches JAX to float64 if this is the precision of a case; call it before any array is created."""
    if precision == "float64":
        import jax

        jax.config.update("jax_enable_x64", True)
