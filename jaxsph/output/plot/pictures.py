"""Every picture that a run has data for, as PNG files, and the animation of the run (`plot_run`)."""

from __future__ import annotations

from pathlib import Path

from jaxsph.output.plot.particles import (
    PRESSURE,
    SPEED,
    animate,
    particles,
)
from jaxsph.output.plot.series import (
    body,
    chamber,
    energy,
    gauges,
    pressures,
)
from jaxsph.output.plot.spectrum import spectrum
from jaxsph.output.plot.style import (
    STYLE,
    Overlay,
)
from jaxsph.output.run_file import RunFile
from jaxsph.waves.linear_owc import LinearOWC


def plot_run(
    run: RunFile | str | Path,
    folder: str | Path | None = None,
    animation: bool = True,
    overlay: Overlay | None = None,
    linear: LinearOWC | None = None,
) -> list[Path]:
    """Writes every picture that the run has data for, and the animation of its snapshots.

    **Arguments**: `folder`: by default the run's path with "_plots" in place of the suffix; `overlay`:
    theoretical elevation to draw over the gauges; `linear`: prediction of linear theory for the chamber.
    **Returns** the files written: PNG, GIF, and MP4 if ffmpeg is found.
    **Raises** FileError if the run cannot be read.
    """
    run = run if isinstance(run, RunFile) else RunFile.open(run)
    folder = Path(folder) if folder is not None else run.path.with_name(run.path.stem + "_plots")
    figures = {
        "gauges": gauges(run, overlay),
        "spectrum": spectrum(run),
        "chamber": chamber(run, linear),
        "body": body(run),
        "pressure_sensors": pressures(run),
        "energy": energy(run),
        "particles_pressure": particles(run, PRESSURE),
        "particles_speed": particles(run, SPEED),
    }
    written = []
    for name, figure in figures.items():
        if figure is not None:
            folder.mkdir(parents=True, exist_ok=True)
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], dpi=STYLE["savefig.dpi"])
    if animation:
        written += animate(run, folder / "animation")
    return written
