"""Arguments and options that several commands have, and what the texts given for them stand for."""

from __future__ import annotations

import contextlib
import enum
import math
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.errors import CaseError
from jaxsph.run import interrupt


def complete_case(begun: str) -> list[str]:
    """Built-in cases and TOML files whose names begin so."""
    import jaxsph as js

    names = [*js.built_in_cases(), *(str(path) for path in sorted(Path().glob("*.toml")))]
    return [name for name in names if name.startswith(begun)]


def _complete_key(begun: str) -> list[str]:
    """Keys of a case that begin so, with the sign that their value follows."""
    from jaxsph.case.case import key_names
    from jaxsph.case.sections import Sections

    return [f"{name}=" for name in sorted(key_names(Sections)) if name.startswith(begun)]


CaseName = Annotated[
    str,
    typer.Argument(
        metavar="CASE",
        help="A TOML file, a built-in name, or FILE.py:FUNCTION, which returns a Problem.",
        autocompletion=complete_case,
    ),
]


RunName = Annotated[Path, typer.Argument(metavar="FILE", help="The file of a run.")]


Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change one value, e.g. --set pto.K_dm=300; repeatable. KEY= without a value removes the key.",
        autocompletion=_complete_key,
    ),
]


Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change one value from here on, e.g. --set tank.height=1.5; repeatable. "
        "Only what leaves particles and walls where they are.",
    ),
]


EndTime = Annotated[float | None, typer.Option("--t1", metavar="S", help="End of the run, s.")]


Devices = Annotated[
    int | None,
    typer.Option(
        "--devices",
        metavar="N",
        help="Accelerators, or on a CPU cores, that share the run; default: those that make it faster.",
    ),
]


Process = Annotated[
    str | None,
    typer.Option(
        "--process",
        metavar="K/N@HOST:PORT",
        help="Process K (from 0) of N that share the run and meet at HOST:PORT; auto under Slurm or MPI.",
    ),
]


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


class Way(enum.StrEnum):
    """Method of a slope by its name on the command line; the methods are in `jaxsph.study`."""

    ensemble = enum.auto()
    filtered = enum.auto()
    exact = enum.auto()

    def of(self, spread: float, members: int, out: Path | None = None) -> Any:
        """Method with these numbers of an ensemble, which the other methods do not use."""
        import jaxsph as js

        match self:
            case Way.ensemble:
                return js.Ensemble(spread, members, out)
            case Way.filtered:
                return js.Filtered()
            case Way.exact:
                return js.Exact()


Method = Annotated[
    Way,
    typer.Option(
        help="ensemble: many runs, with a standard error; filtered: one run, with a bias; "
        "exact: only for runs of a fraction of a second."
    ),
]


Pictures = Annotated[bool, typer.Option("--plot/--no-plot", help="Make pictures after the run.")]


Page = Annotated[
    bool, typer.Option("--report/--no-report", help="Write a page for the browser beside the file.")
]


Program = Annotated[
    str | None,
    typer.Option(
        "--program",
        metavar="FILE.py:FUNCTION",
        help="The function that made the run, where it was no case: a file never makes anyone import one.",
    ),
]


def load(name: str, settings: list[str] | None) -> Any:
    """Case of a name, or program of FILE.py:FUNCTION, with the values of --set; JAX gets its precision."""
    import jaxsph as js

    case = js.Program.load(name) if ".py" in name else js.load_case(name)
    if settings:
        case = case.replace(dict(setting_of(text) for text in settings))
    match_precision(getattr(case, "precision", None))
    interrupt.raise_again()
    return case


def setting_of(text: str) -> tuple[str, Any]:
    """("a.b", value) from "a.b=value", the value being TOML, or else plain text."""
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
    """("a.b", values) from "a.b=1,2,3" or "a.b=first:last:count"; whole numbers where all are written so."""
    from jaxsph.study.sweep import MOST_MEMBERS

    key, equals, value = (part.strip() for part in text.partition("="))
    values: list[float] = []
    with contextlib.suppress(ValueError):  # what is not a number is refused below
        if value.count(":") == 2:
            first, last, number = value.split(":")
            count = int(number)
            if count > MOST_MEMBERS:
                raise CaseError(f"{option} {text!r}: COUNT must be {MOST_MEMBERS} or less")
            step = (float(last) - float(first)) / max(count - 1, 1)
            values = [float(first) + k * step for k in range(count)]
        else:
            values = [float(part) for part in value.split(",")]
    if not key or not equals or not values or not all(map(math.isfinite, values)):
        raise CaseError(
            f"{option} {text!r}: must be KEY=VALUE,VALUE or KEY=FIRST:LAST:COUNT, of finite numbers and with "
            "a COUNT of 1 or more"
        )
    if "." not in value and all(one.is_integer() and abs(one) < 2**53 for one in values):
        values = [int(one) for one in values]  # a seed must be one
    return key, values


def each_once(pairs: Iterable[tuple[str, Any]], option: str) -> dict[str, Any]:
    """Values by key. **Raises** CaseError for a key that is given twice."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise CaseError(f"{option} {key}: is given twice; give all that it may be in one {option}")
        found[key] = value
    return found


def bounds_of(text: str) -> tuple[str, tuple[float, float]]:
    """("a.b", (low, high)) from "a.b=low:high"."""
    key, _, value = (part.strip() for part in text.partition("="))
    try:
        low, high = (float(part) for part in value.split(":"))
    except ValueError:
        raise CaseError(f"--over {text!r}: must be KEY=LOW:HIGH, such as --over pto.K_dm=100:2500") from None
    return key, (low, high)


def match_precision(precision: str | None) -> None:
    """Switches JAX to float64 where a case asks for it, before the first array is made."""
    if precision == "float64":
        import jax

        jax.config.update("jax_enable_x64", True)
