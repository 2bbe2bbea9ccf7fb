"""The `jaxsph` command: an argument or an option for each choice, and the words that a user reads."""

from __future__ import annotations

import contextlib
import enum
import math
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxsph.errors import CaseError, FileError, JaxsphError, SimulationError
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import SweepFile
from jaxsph.output.vtk import export_vtkhdf
from jaxsph.report.labels import in_order, in_words, label_of
from jaxsph.run import interrupt

app = typer.Typer(
    name="jaxsph",
    help="Simulate wave energy converters as particles of water (SPH). Begin with: jaxsph run owc --quick",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


CLUSTER_TIMEOUT = 10
"""Time in which a cluster's scheduler has to answer, s."""


def _complete_case(begun: str) -> list[str]:
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
    typer.Argument(metavar="CASE", help="A TOML file or a built-in name.", autocompletion=_complete_case),
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


@app.command()
def run(
    case: CaseName,
    settings: Settings = None,
    t1: EndTime = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Default: runs/<name of the case>.h5"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE where it exists.")] = False,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="A coarse first look: larger particles, a shorter run, no pictures."),
    ] = False,
    devices: Devices = None,
    process: Process = None,
    plot: Pictures = True,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Run a case and record it into one HDF5 file."""
    import jaxsph as js

    with _messages():
        is_first = _find(devices, process)
        loaded = _load(case, settings)
        loaded = js.coarsen(loaded) if quick else loaded
        out = out if out is not None else Path("runs") / f"{loaded.name}.h5"
        quiet = quiet or not is_first
        if not quiet:
            for notice in loaded.notices():
                typer.echo(f"note: {notice}", err=True)
        with _resumable(out):
            solution = js.run(
                loaded, t1=t1, out=out, overwrite=overwrite, progress=not quiet, devices=devices
            )
        if is_first:
            _report(solution, out, (plot and not quick, report), quiet)
            if quick and not quiet:
                typer.echo(f"this was COARSE, for a first look: for numbers to rely on, jaxsph run {case}")


@app.command()
def sweep(
    case: CaseName,
    grid: Annotated[
        list[str],
        typer.Option(
            "--grid",
            metavar="KEY=VALUES",
            help="Values of one parameter: 0.02,0.04 or first:last:count; repeatable.",
        ),
    ],
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Default: runs/<name of the case>_sweep.h5"),
    ] = None,
    t1: EndTime = None,
    workers: Annotated[int | None, typer.Option(help="Runs at a time; default: one per core.")] = None,
    batch: Annotated[
        int | None, typer.Option(help="Runs side by side in one call; the default on an accelerator, 8.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Dask scheduler whose workers run the members: tcp://host:8786."
        ),
    ] = None,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Run a case for every combination of values, or go on with an interrupted sweep."""
    import jaxsph as js

    with _messages(), _cluster(scheduler) as executor:
        loaded = _load(case, settings)
        over = _each_once((_values(text) for text in grid), "--grid")
        if t1 is not None:
            if "t1" in over:
                raise CaseError("--t1: is one of the parameters of --grid; give one of the two")
            loaded = loaded.replace({"t1": t1})
        out = out if out is not None else Path("runs") / f"{loaded.name}_sweep.h5"
        done = js.sweep(
            loaded, over, out, workers=workers, batch=batch, executor=executor, progress=not quiet
        )
        if not quiet:
            _table(_sweep_rows(done))
        typer.echo(f"recorded in {out}")
        _write_page(out, report, quiet)
        for place, text in done.failures.items():
            typer.echo(f"failed: {_place(done, place)}: {text.splitlines()[0]}", err=True)
        if done.failures:
            raise typer.Exit(1)


@app.command()
def matrix(
    case: CaseName,
    heights: Annotated[
        str,
        typer.Option("--hs", metavar="VALUES", help="Significant heights, m: 0.02,0.04 or first:last:count."),
    ],
    periods: Annotated[
        str, typer.Option("--tp", metavar="VALUES", help="Peak periods, s: 1.2,1.4 or first:last:count.")
    ],
    seeds: Annotated[
        int, typer.Option(help="Different seas run in every sea state; more of them lower its error.")
    ] = 1,
    table: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Scatter table of Hs, Tp and share or hours, for the annual mean."),
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Default: runs/<name of the case>_matrix.h5"),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers run the seas.")
    ] = None,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Power matrix: mean power in irregular seas of every height and period, and over a scatter table."""
    import jaxsph as js

    with _messages(), _cluster(scheduler) as executor:
        loaded = _load(case, settings)
        scatter = None if table is None else js.ScatterTable.read(table)
        Hs, Tp = (
            _values(f"{name}={text}", f"--{name}")[1] for name, text in (("hs", heights), ("tp", periods))
        )
        out = out if out is not None else Path("runs") / f"{loaded.name}_matrix.h5"
        done = js.power_matrix(loaded, Hs, Tp, out, seeds=seeds, executor=executor, progress=not quiet)
        _table(_matrix_rows(done, scatter))
        typer.echo(f"recorded in {out}")
        if not quiet:
            from jaxsph.output.plot.matrix import plot_matrix

            typer.echo(f"picture: {plot_matrix(done, out.with_name(out.stem + '_plots'))}")
        _write_page(out, report, quiet)
        for place, text in done.sweep.failures.items():
            typer.echo(f"failed: {_place(done.sweep, place)}: {text.splitlines()[0]}", err=True)
        if done.sweep.failures:
            raise typer.Exit(1)


@app.command()
def slope(  # of a command the options are the arguments
    case: CaseName,
    over: Annotated[str, typer.Option("--over", metavar="KEY", help="The number to vary: pto.K_dm.")],
    of: Annotated[str, typer.Option("--of", help="The result: xi, P_owc or energy_pto.")] = "xi",
    method: Method = Way.ensemble,
    members: Annotated[
        int, typer.Option(help="Runs around the case's value, through which a parabola is fitted.")
    ] = 9,
    spread: Annotated[
        float, typer.Option(help="Reach of those runs to either side of the value, as a share of it.")
    ] = 0.3,
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Default: runs/<name of the case>_<KEY>.h5"),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Slope of a result over one number of the case, with its error."""
    import jaxsph as js

    with _messages():
        loaded = _load(case, settings)
        out = out if out is not None else Path("runs") / f"{loaded.name}_{over}.h5"
        found = js.derivative(loaded, over, of, method.of(spread, members, out), progress=not quiet)
        error = "" if found.error is None else f" +- {found.error:.2g}"
        _table(
            [
                (of, f"{found.value:.4g}"),
                (f"d {of} / d {over}", f"{found.slope:.4g}{error}"),
                ("speaks of changes up to", f"{found.reach:.3g}"),
            ]
        )
        if method is Way.ensemble:
            typer.echo(f"recorded in {out}")


@app.command()
def optimise(  # of a command the options are the arguments
    case: CaseName,
    over: Annotated[
        list[str], typer.Option("--over", metavar="KEY=LOW:HIGH", help="A number to choose; repeatable.")
    ],
    of: Annotated[str, typer.Option("--of", help="What to maximise: xi, P_owc or energy_pto.")] = "xi",
    method: Method = Way.ensemble,
    members: Annotated[int, typer.Option(help="Runs for every slope.")] = 9,
    spread: Annotated[
        float, typer.Option(help="Reach of those runs to either side of the value, as a share of it.")
    ] = 0.3,
    evaluations: Annotated[int, typer.Option(help="Largest number of slopes.")] = 10,
    table: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Scatter table of Hs, Tp and share or hours: P_owc over the year."),
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Default: runs/<name of the case>_optimum.h5"),
    ] = None,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Search the values that make a result largest, or go on with an interrupted search."""
    import jaxsph as js

    with _messages():
        loaded = _load(case, settings)
        out = out if out is not None else Path("runs") / f"{loaded.name}_optimum.h5"
        bounds = _each_once((_bounds(text) for text in over), "--over")
        way = method.of(spread, members)
        if table is not None:
            of, way = "P_owc", js.OverSeas(js.ScatterTable.read(table), way)
        found = js.maximise(loaded, bounds, out, of, way, evaluations=evaluations, progress=not quiet)
        for here in found.history:
            _table(
                [(f"{of} at " + ", ".join(f"{key} = {here[key]:.4g}" for key in bounds), f"{here[of]:.4g}")]
            )
        highest = max(found.history, key=lambda here: here[of])
        best = ", ".join(f"{key} = {highest[key]:.4g}" for key in bounds)
        typer.echo(f"best: {of} = {found.value:.4g} at {best} ({found.reason})")
        typer.echo(f"recorded in {out}")
        _write_page(out, report, quiet)


@app.command()
def resume(
    file: RunName,
    settings: Changes = None,
    t1: EndTime = None,
    devices: Devices = None,
    process: Process = None,
    plot: Pictures = True,
    report: Page = True,
    quiet: Quiet = False,
) -> None:
    """Go on with a run from its last checkpoint."""
    import jaxsph as js

    with _messages():
        is_first = _find(devices, process)
        quiet = quiet or not is_first
        stored = RunFile.open(file).case_keys()
        _match_precision(stored.get("precision"))
        changes = dict(_setting(text) for text in settings or [])
        with _resumable(file):
            solution = js.resume(file, t1=t1, progress=not quiet, changes=changes, devices=devices)
        if is_first:
            _report(solution, file, (plot, report), quiet)


@app.command()
def plot(
    file: RunName,
    folder: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder; default: beside FILE, runs/owc_plots for runs/owc.h5."),
    ] = None,
    animation: Annotated[
        bool, typer.Option("--animation/--no-animation", help="Animate the snapshots.")
    ] = True,
    vtk: Annotated[
        Path | None, typer.Option("--vtk", metavar="FILE", help="Also export for ParaView.")
    ] = None,
    linear: Annotated[
        bool, typer.Option("--linear", help="Draw what linear theory expects of the chamber.")
    ] = False,
) -> None:
    """Make pictures of a run or a sweep, finished or not, and export a run's particles."""
    import jaxsph as js
    from jaxsph.output.plot.pictures import plot_run
    from jaxsph.output.plot.sweeps import plot_sweep

    with _messages():
        interrupt.raise_again()
        if SweepFile(file).is_one():
            for path in plot_sweep(file, folder):
                typer.echo(path)
            return
        opened = RunFile.open(file)
        expected = js.linear_owc(js.Case.from_dict(opened.case_keys())) if linear else None
        for path in plot_run(opened, folder=folder, animation=animation, linear=expected):
            typer.echo(path)
        if vtk is not None:
            typer.echo(export_vtkhdf(opened, vtk))


@app.command("report")
def write_report(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Files of runs or sweeps, shown side by side.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Default: the first FILE with .html.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace FILE also where it is no page of jaxsph.")
    ] = False,
    show: Annotated[bool, typer.Option("--show", help="Open it in the browser.")] = False,
) -> None:
    """Write a page for the browser: results, charts, and the particles played back, in one file."""
    from jaxsph.report.page import report

    with _messages():
        interrupt.raise_again()
        page = report(files, out, overwrite)
        typer.echo(f"{page} ({page.stat().st_size / 1e6:.1f} MB)")
        if show:
            typer.launch(str(page))


@app.command()
def watch(
    file: RunName,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; default: one that is free.")] = 0,
    show: Annotated[bool, typer.Option("--show", help="Open it in the browser.")] = False,
) -> None:
    """Show a run that goes on in the browser, renewed after every chunk, until Ctrl-C."""
    import threading

    from jaxsph.report.watch import Watch

    with _messages():
        interrupt.raise_again()
        with Watch(file, port) as served:
            typer.echo(f"{served.address} (end it with Ctrl-C)")
            if show:
                typer.launch(served.address)
            with contextlib.suppress(KeyboardInterrupt):
                threading.Event().wait()


@app.command()
def check(case: CaseName, settings: Settings = None) -> None:
    """Validate a case and say what its run will be."""
    import jaxsph as js

    with _messages():
        loaded = _load(case, settings)
        _table(js.check(loaded) + js.linear_check(loaded))
        for notice in loaded.notices():
            typer.echo(f"note: {notice}", err=True)


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Writes NAME.toml.")],
    like: Annotated[
        str,
        typer.Option("--like", metavar="CASE", help="The case to begin with.", autocompletion=_complete_case),
    ] = "owc",
) -> None:
    """Write a case file to begin with, with every key and its meaning as comments."""
    import jaxsph as js
    from jaxsph.case.commented import commented_toml

    with _messages():
        stem = name.removesuffix(".toml").replace("\\", "/").rpartition("/")[2]
        if not stem.strip(". ") or not name.isprintable():
            raise CaseError(f"NAME {name!r}: must end in the name of a file, such as my_owc or cases/my_owc")
        path = Path(name if name.endswith(".toml") else f"{name}.toml")
        case = js.load_case(like).replace({"name": path.stem})
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                file.write(commented_toml(case))
        except FileExistsError:
            raise FileError(f"{path}: exists already; choose another NAME, or remove it") from None
        except OSError as error:
            raise FileError(f"{path}: cannot be written: {error.strerror or error}") from None
        typer.echo(f"{path}: jaxsph check {path}, then jaxsph run {path}")


@app.command()
def cases() -> None:
    """List the built-in cases."""
    import jaxsph as js

    _table(list(js.built_in_cases().items()))


def _find(devices: int | None, process: str | None) -> bool:
    """Joins the processes of a run and makes cores devices, before JAX is first used.

    **Returns** whether this process is the first. **Raises** CaseError where there are too few of either.
    """
    import jax

    from jaxsph.run.devices import find_devices
    from jaxsph.run.processes import join

    if process is not None:
        join(process)
    find_devices(devices)
    return jax.process_index() == 0


def _load(name: str, settings: list[str] | None) -> Any:
    import jaxsph as js

    case = js.load_case(name)
    if settings:
        case = case.replace(dict(_setting(text) for text in settings))
    _match_precision(getattr(case, "precision", None))
    interrupt.raise_again()
    return case


def _setting(text: str) -> tuple[str, Any]:
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


def _values(text: str, option: str = "--grid") -> tuple[str, list[float]]:
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


def _each_once(pairs: Iterable[tuple[str, Any]], option: str) -> dict[str, Any]:
    """Values by key. **Raises** CaseError for a key that is given twice."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise CaseError(f"{option} {key}: is given twice; give all that it may be in one {option}")
        found[key] = value
    return found


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    """("a.b", (low, high)) from "a.b=low:high"."""
    key, _, value = (part.strip() for part in text.partition("="))
    try:
        low, high = (float(part) for part in value.split(":"))
    except ValueError:
        raise CaseError(f"--over {text!r}: must be KEY=LOW:HIGH, such as --over pto.K_dm=100:2500") from None
    return key, (low, high)


def _match_precision(precision: str | None) -> None:
    """Switches JAX to float64 where a case asks for it, before the first array is made."""
    if precision == "float64":
        import jax

        jax.config.update("jax_enable_x64", True)


def _report(solution: Any, path: Path, wanted: tuple[bool, bool], quiet: bool) -> None:
    """Results in the terminal, and as pictures and as a page where they are wanted."""
    if not quiet:
        for notice in getattr(solution, "notices", ()):
            typer.echo(f"note: {notice}", err=True)
        case = getattr(solution, "case", None)
        flat = case is None or case.tank.width is None
        _table(_rows(getattr(solution, "results", None) or {}, flat))
        typer.echo(f"recorded in {path}")
    pictures, page = wanted
    if pictures:
        from jaxsph.output.plot.pictures import plot_run

        written = plot_run(path)
        if written and not quiet:
            typer.echo(f"{len(written)} pictures in {written[0].parent}")
    _write_page(path, page, quiet)


def _write_page(path: Path, wanted: bool, quiet: bool) -> None:
    """Page of a file beside it, where it is wanted; without one the results are as good."""
    if not wanted:
        return
    from jaxsph.report.page import report

    try:
        page = report(path)
    except JaxsphError as error:
        typer.echo(f"note: no page for a browser: {error}", err=True)
        return
    if not quiet:
        typer.echo(f"page for a browser: {page}")


def _rows(results: dict[str, float], flat: bool) -> list[tuple[str, str]]:
    """Labels and values of results; `flat`: in 2-D, where bodies and energies are per metre of width."""
    rows = []
    for name in in_order(results):
        label = label_of(name, flat)
        rows.append((label.text, f"{in_words(results[name]):>10} {label.unit}".rstrip()))
    return rows


def _sweep_rows(done: Any) -> list[tuple[str, str]]:
    """A line per member: where it is, and its efficiency or what else its case gives."""
    name = "xi" if "xi" in done.results else "energy_residual_share"
    if name not in done.results:
        return []
    label = label_of(name, flat=True).text.strip()
    places = sorted(set(done.members) - set(done.failures))
    return [(_place(done, place), f"{label} {done[name][place]:.4g}") for place in places]


def _matrix_rows(done: Any, scatter: Any) -> list[tuple[str, str]]:
    """A line per sea state, and one of the year where there is a scatter table."""
    unit, rows = "W/m" if done.sweep.case.tank.width is None else "W", []
    for i, height in enumerate(done.Hs):
        for j, period in enumerate(done.Tp):
            linear = done.linear[i, j]
            theory = "" if linear != linear else f"; linear theory {linear:.3g}"  # NaN: it has none
            error = "" if math.isnan(done.error[i, j]) else f" +- {done.error[i, j]:.1g}"
            xi = "" if math.isnan(done.xi[i, j]) else f" (xi {done.xi[i, j]:.3g})"
            value = f"{done.P[i, j]:.3g}{error} {unit}{xi}{theory}"
            rows.append((f"Hs = {height:g} m, Tp = {period:g} s", value))
    if scatter is not None:
        mean = done.annual(scatter)
        error = "" if math.isnan(mean.error) else f" +- {mean.error:.1g}"
        rows.append(("mean over the year", f"{mean.value:.3g}{error} {unit}"))
    return rows


def _place(done: Any, place: tuple[int, ...]) -> str:
    pairs = zip(done.axes.items(), place, strict=True)
    return ", ".join(f"{key} = {values[k]:g}" for (key, values), k in pairs)


def _table(rows: list[tuple[str, str]]) -> None:
    width = max((len(label) for label, _ in rows), default=0)
    for label, value in rows:
        typer.echo(f"{label:<{width}}  {value}")


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[Any]:
    """Executor of the Dask cluster at an address; None without one. **Raises** CaseError."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise CaseError('--scheduler: needs Dask: python -m pip install "jaxsph[cluster]"') from None
    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT)
    except (OSError, ValueError) as error:
        raise CaseError(
            f"--scheduler {address}: no Dask scheduler answers there ({error}); see docs/cluster.md"
        ) from None
    with client:
        yield client.get_executor(pure=False)


@contextlib.contextmanager
def _messages() -> Iterator[None]:
    """Turns what a user can act on into a message and an exit code: 2 for input, 1 for a run."""
    try:
        yield
    except JaxsphError as error:
        typer.echo(f"jaxsph: error: {error}", err=True)
        raise typer.Exit(1 if isinstance(error, SimulationError) else 2) from None
    except KeyboardInterrupt:
        typer.echo("jaxsph: interrupted", err=True)
        raise typer.Exit(interrupt.CODE) from None


@contextlib.contextmanager
def _resumable(path: Path) -> Iterator[None]:
    """Says after an interrupted or failed run what is left of it."""

    def words() -> str:
        return f"\njaxsph: interrupted. {_what_is_left(path)}"

    with interrupt.end_at_once(words):
        try:
            yield
        except KeyboardInterrupt:
            typer.echo(words(), err=True)
            raise typer.Exit(interrupt.CODE) from None
        except SimulationError as error:
            text = f"{error}\n{_what_is_left(path)}".replace("resume FILE", f"resume {path}")
            raise SimulationError(text, error.step, error.time, error.where) from None


def _what_is_left(path: Path) -> str:
    """How to go on with a run that was stopped."""
    with contextlib.suppress(JaxsphError):
        if RunFile.open(path).has_checkpoint():
            return f"{path} is whole up to its last checkpoint; go on with: jaxsph resume {path}"
    return f"There was no checkpoint yet; begin again with --overwrite ({path})"
