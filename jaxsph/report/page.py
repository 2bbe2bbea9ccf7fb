"""`report`: one self-contained HTML file of a run, a sweep, or several of them side by side."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2

from jaxsph.errors import FileError, JaxsphError
from jaxsph.output.hdf5 import put_file, tell_write_errors
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import SweepFile
from jaxsph.report.content import run_content
from jaxsph.report.frames import Frames
from jaxsph.report.pack import Pack
from jaxsph.report.space import three
from jaxsph.report.sweeps import sweep_content

SCRIPTS = ("record.js", "player.js", "space.js", "charts.js", "sweep.js", "page.js")
"""Scripts of the page, in their order."""


MARK = b"Made by jaxsph."
"""Text that every page contains. An existing file without this text is replaced only with `overwrite`."""


def report(
    files: str | Path | Sequence[str | Path], out: str | Path | None = None, overwrite: bool = False
) -> Path:
    """Writes a page of runs and sweeps, finished or not, as one file that needs a browser but no network.

    **Arguments**: `files`: one file, or several that are shown side by side; `out`: by default the first
    file's path with the suffix .html; `overwrite`: replace `out` even if it is not a page of jaxsph.
    **Returns** the page's path. **Raises** FileError if a file cannot be read or written.
    """
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    if not paths:
        raise FileError("report: no file; give the file of a run or of a sweep")
    out = paths[0].with_suffix(".html") if out is None else Path(out)
    if out.resolve() in {path.resolve() for path in paths}:
        raise FileError(f"{out} is one of the files to be shown; give another name with --out")
    if out.is_dir():
        raise FileError(f"{out} is a folder; give the name of a page, such as {out / 'page.html'}")
    if out.exists() and not overwrite and MARK not in out.read_bytes():
        raise FileError(
            f"{out} exists and is not a page of jaxsph; nothing was changed. Give another name with --out, "
            "or replace the file with --overwrite"
        )
    record = record_of(paths)
    text = render_page(record, title_of(paths), three() if any(map(_in_space, paths)) else None)
    with tell_write_errors(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        put_file(out, text.encode())
    return out


def record_of(paths: Sequence[Path], frames: dict[Path, Frames] | None = None) -> bytes:
    """Contents of a page about these files, compressed; `frames`: snapshots already read, by path."""
    pack, runs, sweeps = Pack(), [], []
    for path in paths:
        try:
            if SweepFile(path).is_one():
                sweeps.append(sweep_content(SweepFile(path), pack))
                continue
            run = RunFile.open(path)
            known = None if frames is None else frames.setdefault(path, Frames(run))
            runs.append(run_content(run, pack, known))
        except JaxsphError:
            raise
        except Exception as error:  # damaged contents raise errors of many kinds
            raise FileError(
                f"{path} cannot be shown ({type(error).__name__}: {error}). Restore the file from a copy, or "
                "use the version of jaxsph that wrote it"
            ) from error
    return pack.compress({"runs": _told_apart(runs), "sweeps": sweeps})


def _told_apart(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Runs with distinct labels: the case's name, or the file's name if several runs have this name."""
    names = [run["name"] for run in runs]
    return [run | {"label": run["name"] if names.count(run["name"]) == 1 else run["file"]} for run in runs]


def title_of(paths: Sequence[Path]) -> str:
    """Title of a page about these files."""
    return " and ".join(path.stem for path in paths)


def _in_space(path: Path) -> bool:
    """Whether a file contains a run in three dimensions with snapshots."""
    if SweepFile(path).is_one():
        return False
    run = RunFile.open(path)
    return run.snapshot_count > 0 and run.snapshot(0)["x"].shape[1] == 3


def render_page(record: bytes | None, title: str, view: bytes | None = None) -> str:
    """HTML text of a page with its contents; a page without contents requests them from its server.

    **Arguments**: `view`: text of the library that draws runs in three dimensions, see `space.three`.
    """
    folder = resources.files("jaxsph.report") / "page"
    read = {
        name: (folder / name).read_text(encoding="utf-8") for name in ("page.html", "style.css", *SCRIPTS)
    }
    plotly = resources.files("plotly.package_data").joinpath("plotly.min.js").read_bytes()
    template = jinja2.Environment(autoescape=True, trim_blocks=True).from_string(read["page.html"])
    return template.render(
        title=title,
        style=read["style.css"],
        scripts=[read[name] for name in SCRIPTS],
        library=_in_text(gzip.compress(plotly, 9, mtime=0)),
        three="" if view is None else _in_text(gzip.compress(view, 9, mtime=0)),
        record="" if record is None else _in_text(record),
    )


def _in_text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
