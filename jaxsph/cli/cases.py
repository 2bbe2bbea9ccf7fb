"""Commands for cases before a run: `jaxsph check`, `profile`, `show`, `new` and `cases`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jaxsph.case.report import in_time
from jaxsph.cli.arguments import CaseName, Devices, ProfiledName, Quick, Settings, complete_case, load
from jaxsph.cli.terminal import messages, print_table
from jaxsph.errors import CaseError, FileError


def check(
    case: CaseName,
    settings: Settings = None,
    quick: Quick = False,
    timed: Annotated[
        bool, typer.Option("--time", help="Compile the case and time a few of its steps on this machine.")
    ] = False,
    devices: Devices = None,
) -> None:
    """Check a case, and print its number of particles, time step, waves and expected wall time."""
    import jaxsph as js

    with messages():
        loaded = load(case, settings, quick)
        is_case = not isinstance(loaded, js.Program)
        rows = js.check(loaded) + (js.linear_check(loaded) if is_case else [])
        if timed:
            found = js.duration(loaded, devices)
            text = (
                f"{in_time(found.total)} on {_in_words(found.devices)} here, including "
                f"{in_time(found.compilation)} of compilation"
            )
            rows = [*(row for row in rows if row[0] != "wall time"), ("wall time", text)]
        print_table(rows)
        for notice in loaded.notices() if is_case else ():
            typer.echo(f"note: {notice}", err=True)


def _in_words(devices: int) -> str:
    return f"{devices} device" + ("s" if devices > 1 else "")


def profile(
    case: ProfiledName,
    settings: Settings = None,
    quick: Quick = False,
    devices: Devices = None,
) -> None:
    """Measure the wall time of each part of a time step: search, pressure solver, probes and others."""
    import jaxsph as js

    with messages():
        of_run = case.endswith(".h5")
        if of_run and (settings or quick):
            raise CaseError(f"{case} is the file of a run, whose case is fixed: omit --set and --quick")
        found = js.profile(case if of_run else load(case, settings, quick), devices)
        on = f"{found.particles} particles on {_in_words(found.devices)}"
        rows = [("time step", f"{1e3 * found.step:.3g} ms for {on}")]
        for name, share in found.parts.items():
            solved = f", {share.iterations:.3g} iterations" if share.iterations else ""
            rows.append((f"  {name}", f"{share.seconds / found.step:6.1%}{solved}"))
        if found.loops:
            rows.append(
                ("native loops", f"{found.loops / found.step:6.1%} of the time step, in several parts")
            )
        rows.append(("recording", f"{found.recording / found.step:6.1%} of the time step, in addition to it"))
        compiled = (
            f"{found.lowering:.3g} s to convert the steps for XLA, {found.compilation:.3g} s to compile them"
        )
        rows.append(("start", f"{compiled} without the cache"))
        slower = f"steps took {found.slowdown:.2f} times as long while they were profiled"
        rows.append(("accuracy", f"{slower}; the parts are corrected for this"))
        print_table(rows)


def show(
    case: CaseName,
    settings: Settings = None,
    whole: Annotated[
        bool, typer.Option("--whole", help="Include every key that has its default value.")
    ] = False,
) -> None:
    """Print a case with its short forms written out, for example pto as a key of its chamber."""
    import jaxsph as js
    from jaxsph.problem.toml import toml_text

    with messages():
        loaded = load(case, settings)
        if isinstance(loaded, js.Program):
            raise CaseError(f"{case} is a program and has no case file; give a case")
        expanded = loaded.expanded()
        typer.echo(expanded.to_toml() if whole else toml_text(expanded.given()))


def new(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Case file to write; .toml is added if missing.")
    ],
    like: Annotated[
        str,
        typer.Option("--like", metavar="CASE", help="Case to start from.", autocompletion=complete_case),
    ] = "owc",
) -> None:
    """Write a new case file, with every key and its meaning as comments."""
    import jaxsph as js
    from jaxsph.case.commented import commented_toml

    with messages():
        stem = name.removesuffix(".toml").replace("\\", "/").rpartition("/")[2]
        if not stem.strip(". ") or not name.isprintable():
            raise CaseError(f"NAME {name!r}: must end with a file name, such as my_owc or cases/my_owc")
        path = Path(name if name.endswith(".toml") else f"{name}.toml")
        case = js.load_case(like).replace({"name": path.stem})
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                file.write(commented_toml(case))
        except FileExistsError:
            raise FileError(f"{path} already exists; choose another NAME, or remove the file") from None
        except OSError as error:
            raise FileError(f"{path} cannot be written: {error.strerror or error}") from None
        typer.echo(f"wrote {path}; next: jaxsph check {path}, then jaxsph run {path}")


def cases() -> None:
    """List the built-in cases."""
    import jaxsph as js

    print_table(list(js.built_in_cases().items()))
