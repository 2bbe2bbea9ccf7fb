"""Contents of a page about a run: its description, labelled results, warnings, series over time, spectra."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxsph import analysis
from jaxsph.case.case import Case
from jaxsph.case.coarse import COARSE
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import linear_owc, linear_sea, sea_is_linear, why_no_theory
from jaxsph.case.linear_bodies import has_free_bodies, linear_motions
from jaxsph.case.report import in_time
from jaxsph.case.results import two_way_sea
from jaxsph.case.settling import settled_window
from jaxsph.errors import CaseError
from jaxsph.model.meaning import Group
from jaxsph.model.rigid import PLANE
from jaxsph.output.hdf5 import Variable
from jaxsph.output.plot.series import energy_terms, harvested, work_of
from jaxsph.output.plot.spectrum import WITHIN
from jaxsph.output.run_file import RunFile
from jaxsph.problem.results import linear
from jaxsph.report.doubts import doubts
from jaxsph.report.frames import Frames
from jaxsph.report.labels import components_of, in_order, in_words, is_flat, label_of, short
from jaxsph.report.pack import Pack

MOST_SAMPLES = 6000
"""Number of samples above which a line is drawn only through the extremes of groups of samples."""
EXTREMES = {"chamber_level": "level", "flow": "q", "P_a": "P_a_peak"}
"""Names of the series of a chamber, and of the amplitudes of these series in `LinearOWC`."""
PANELS = {
    "eta": "Elevation at the gauges",
    "chamber_level": "Level in the chamber",
    "flow": "Air flow, positive out of the chamber",
    "P_a": "Air pressure, positive when compressed",
    "power_pto": "Power absorbed by the PTO",
    "surge": "Surge of the body",
    "sway": "Sway of the body",
    "heave": "Heave of the body",
    "roll": "Roll of the body",
    "pitch": "Pitch of the body, positive landward",
    "yaw": "Yaw of the body",
    "body_force": "Force and moment of the water on the body",
    "pressure": "Pressure at the sensors",
    "velocity": "Velocity at the sensors",
    "surface": "Free surface",
    "paddle": "Displacement of the paddle",
    "max_speed": "Largest speed of a particle",
    "noise": "Noise of the particles and their RMS speed",
}
"""Titles of the charts over time, by the series that they show, in the order of the page."""
UNSHOWN = (
    "chamber_volume",
    "flow_mean",
    "duct_flow_mean",
    "body_velocity",
    "body_force_mean",
    "force_mean",
    "rms_speed",
    "limited",
)
"""Series without a panel of their own: those closely related to a series with a panel, and counts of the
limiters."""
RUNNING = ("chamber_level", "flow", "P_a", "power_pto", *PLANE.motions)
"""Series whose current values are shown while the particles are played back."""


def run_content(run: RunFile, pack: Pack, frames: Frames | None = None) -> dict[str, Any]:
    """Contents of a page about a run, finished or not. **Raises** FileError if the run cannot be read."""
    keys, series = run.case_keys(), run.series()
    case = case_of(keys)
    results = run.results()
    counting = {n: a[series["time"] >= run.since - 1e-9] for n, a in series.items()}
    name = str(keys.get("name", run.path.stem))
    rows = _result_rows(results, is_flat(keys), run.labels())
    return {
        "name": name,
        "file": run.path.name,
        "description": str(keys.get("description", "")),
        "ended": bool(results),
        "t1": float(keys.get("t1", 0.0)),
        "about": _about(run, keys, series) + _theory(case),
        "warnings": [*run.notices(), *_warnings(keys, case, series, results)],
        "results": rows,
        "answer": _answer(rows),
        "panels": panels(series, run.variables(), run.coordinates(), pack, _extremes(case, series, results)),
        "spectra": _spectrum(case, counting, run.coordinates(), pack),
        "case": run.case_toml,
        "player": (frames or Frames(run)).content(pack, case),
    }


def case_of(keys: dict[str, Any]) -> Case | None:
    """Case of a run's file; None if this version does not know all its keys."""
    try:
        return Case.from_dict(keys)
    except CaseError:
        return None


def _about(run: RunFile, keys: dict[str, Any], series: dict[str, np.ndarray]) -> list[tuple[str, str]]:
    numbers = run.numbers()
    rows = [("particle spacing", f"{numbers['dx'][0]:g} m")] if "dx" in numbers else []
    if "particles" in numbers:
        rows.append(("water particles", f"{numbers['particles'][0]:.0f}"))
    if flume := keys.get("flume"):
        rows.append(
            ("coarse flume", f"up to {flume['length']:g} m, spacing {flume['factor']} times as large")
        )
    if "dt" in numbers:
        rows.append(("time step", f"{numbers['dt'][0]:.4g} s"))
    scheme = keys.get("scheme", {}).get("kind")
    if scheme is not None:
        rows.append(("scheme", str(scheme).replace("_", " ")))
    rows.append(("precision", str(keys.get("precision", "float32"))))
    if len(series.get("time", ())):
        end = f" of {keys['t1']:g} s" if "t1" in keys else ""
        rows.append(("time reached", f"{series['time'][-1]:.4g} s{end}"))
    seconds = run.results().get("wall_seconds", run.progress().get("wall_seconds"))
    if seconds is not None:
        rows.append(("wall time", in_time(seconds)))
    rows.append(("computed on", run.machine or "not recorded"))
    rows.append(("version", f"jaxsph {run.version}"))
    return rows


def _theory(case: Case | None) -> list[tuple[str, str]]:
    """Table row that explains why predictions of linear theory are not shown; empty if they are shown."""
    why = "" if case is None else why_no_theory(case)
    return [("linear theory", f"not drawn: {why}")] if why else []


def coarse_warning(keys: dict[str, Any]) -> list[str]:
    """Warning that a case is coarse; empty for other cases. `keys`: the case as in its file."""
    if not str(keys.get("description", "")).startswith(COARSE):
        return []
    return ["The particles are coarse, for a first look: do not use these numbers for a design."]


def _warnings(
    keys: dict[str, Any], case: Case | None, series: dict[str, np.ndarray], results: dict[str, float]
) -> list[str]:
    """Warnings about the reliability of the numbers on a page."""
    reached = series["time"][-1] if len(series.get("time", ())) else 0.0
    found = coarse_warning(keys)
    if not results:
        found.append(
            f"The run has not ended: it has reached t = {reached:.4g} s, and there are no results yet."
        )
    found += [doubt.text for doubt in doubts(results, bool(keys.get("waves")))]
    return [*found, *([] if case is None else case.notices(ended=bool(results)))]


def _result_rows(
    results: dict[str, float], flat: bool, own: Mapping[str, Sequence[str]]
) -> list[dict[str, Any]]:
    errors = {"xi": results.get("xi_error")}
    rows = []
    for name in in_order(results, own):
        label, error = label_of(name, flat, own), errors.get(name)
        value = in_words(results[name]) + ("" if error is None else f" ± {error:.1g}")
        rows.append(
            {
                "name": name,
                "label": short(label).strip(),
                "part": label.text.startswith(" "),
                "value": value,
                "unit": label.unit,
                "meaning": label.meaning,
                "group": label.group,
            }
        )
    return rows


def _answer(rows: list[dict[str, Any]]) -> dict[str, str] | None:
    """Main result on a page: the device's first result, with linear theory; None without such a result."""
    if not rows or rows[0]["group"] != Group.DEVICE:
        return None
    expected = next((row["value"] for row in rows if row["name"] == linear(rows[0]["name"])), "")
    note = "± from the changes within this run only" if "±" in rows[0]["value"] else ""
    return {name: rows[0][name] for name in ("label", "value", "unit")} | {"expected": expected, "note": note}


def panels(
    series: dict[str, np.ndarray],
    variables: Mapping[str, Variable],
    coordinates: dict[str, Any],
    pack: Pack,
    expected: dict[str, list[float]] | None = None,
) -> list[dict[str, Any]]:
    """Time-series panels: title, unit, and lines with their names, times and values.

    **Arguments**: `expected`: values of linear theory for each series, drawn as horizontal dashed lines.
    """
    if len(series.get("time", ())) < 2:
        return []
    t, made = series["time"], []
    for name, title in _titles(series, variables).items():
        if np.ptp(np.nan_to_num(series[name])) > 0.0:
            columns = _columns(name, series, coordinates, variables[name])
            lines = [_line(label, t, values, pack) for label, values in columns]
            for level in (expected or {}).get(name, ()):
                ends = t[[0, -1]]
                lines.append(_line("linear theory", ends, np.full(2, level), pack) | {"dash": True})
            made.append(_panel(name, title, variables[name].units, lines))
    if {"kinetic", "potential", "compression"} <= set(series):
        terms = [
            ("work done by the paddle", work_of(series, "power_paddle"), ""),
            *energy_terms(series, harvested(variables)),
        ]
        lines = [_line(label, t, values, pack) for label, values, _ in terms if np.any(values)]
        made.append(_panel("energy", "Energy since the start", variables["kinetic"].units, lines))
    return made


def _titles(series: Iterable[str], variables: Mapping[str, Variable]) -> dict[str, str]:
    """Titles of the panels by series: the series of `PANELS`, the same series of a named part, and any other
    reading with its long name."""
    found = {name: title for name, title in PANELS.items() if name in series}
    for name in series:
        if name in found or name == "time" or variables[name].group != "series" or _is_of(name, UNSHOWN):
            continue
        known = [base for base in PANELS if name.startswith(f"{base}_")]
        if known:
            base = max(known, key=len)
            found[name] = f"{PANELS[base]}: {name.removeprefix(base + '_')}"
        else:
            words = variables[name].long_name
            found[name] = words[:1].upper() + words[1:]
    return found


def _is_of(name: str, names: Iterable[str]) -> bool:
    """Whether a series has one of these names, alone or followed by the name of a part."""
    return any(name == one or name.startswith(f"{one}_") for one in names)


def _panel(name: str, title: str, units: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    if units.startswith("N") and ", " in units:  # forces, followed by moments
        force, *_, moment = units.split(", ")
        units = f"{force} (force), {moment} (moment)"
    shown = {"1": "", "rad": "rad"}.get(
        units, units.replace("-1", "⁻¹").replace("-2", "⁻²").replace("2", "²")
    )
    return {"name": name, "title": title, "unit": shown, "lines": lines, "running": _is_of(name, RUNNING)}


def _columns(
    name: str,
    series: dict[str, np.ndarray],
    coordinates: dict[str, Any],
    variable: Variable | None = None,
) -> Iterable[tuple[str, np.ndarray]]:
    """(label, values) of every line of a panel."""
    values = series[name]
    if name == "noise" and "rms_speed" in series:
        yield from (("noise", values), ("RMS speed", series["rms_speed"]))
    elif values.ndim == 1:
        yield PANELS.get(name, name), values
    elif name == "eta" and "gauge_x" in coordinates:
        yield from (
            (f"x = {x:.4g} m", row) for x, row in zip(coordinates["gauge_x"][1], values.T, strict=True)
        )
    elif variable is not None and (words := components_of(variable, values.shape[1])):
        yield from zip(words.values(), values.T, strict=True)
    else:
        yield from ((f"{k + 1}", row) for k, row in enumerate(values.reshape(len(values), -1).T))


def _line(label: str, t: np.ndarray, values: np.ndarray, pack: Pack) -> dict[str, Any]:
    """Line of a panel; a long line is reduced to the extremes of groups of samples."""
    every = -(-2 * len(t) // MOST_SAMPLES)
    if every > 2:
        t, values = extremes_of(t, values, every)
    return {"name": label, "t": pack.array(t, "f8"), "y": pack.array(values)}


def extremes_of(t: np.ndarray, values: np.ndarray, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of the smallest and the largest sample of each group of `every`, in time order."""
    whole = len(t) // every * every
    groups = values[:whole].reshape(-1, every)
    pick = np.sort(np.stack([np.argmin(groups, axis=1), np.argmax(groups, axis=1)], axis=1), axis=1)
    index = (pick + every * np.arange(len(groups))[:, None]).ravel()
    index = np.concatenate([index, np.arange(whole, len(t))])
    return t[index], values[index]


def _extremes(
    case: Case | None, series: dict[str, np.ndarray], results: dict[str, float]
) -> dict[str, list[float]]:
    """Values of linear theory by series: mean power; in regular waves also peaks of level, flow and air
    pressure, and of the bodies' heave and pitch."""
    if case is None:
        return {}
    try:
        if has_free_bodies(case):
            return linear_motions(case).levels
        if "chamber_level" not in series:
            return {}
        if sea_is_linear(case):
            return {"power_pto": [linear_sea(case).P_owc]}
        found = linear_owc(case)
    except CaseError:
        return {}
    peaks = {name: float(np.abs(getattr(found, of))) for name, of in EXTREMES.items()}
    return {name: [-peak, peak] for name, peak in peaks.items()} | {"power_pto": [float(found.P_owc)]}


def _spectrum(
    case: Case | None, series: dict[str, np.ndarray], coordinates: dict[str, Any], pack: Pack
) -> list[dict[str, Any]]:
    """Spectra of incident, reflected and target waves of a sea; otherwise, spectra of gauges and chamber."""
    if len(series.get("time", ())) < 64:
        return []
    of_sea = None if case is None else _of_sea(case, series, pack)
    if of_sea is not None:
        return [of_sea]
    shown = []
    for name, title in (
        ("eta", "Spectra of the elevations"),
        ("chamber_level", "Spectrum of the chamber's level"),
    ):
        if name in series and np.ptp(series[name]) > 0.0:
            lines = []
            for label, values in _columns(name, series, coordinates):
                found = analysis.spectrum(series["time"], values, bands=1)
                lines.append({"name": label, "f": found.f, "S": found.S})
            shown.append(_spectral(title, lines, pack))
    return shown


def _of_sea(case: Case, series: dict[str, np.ndarray], pack: Pack) -> dict[str, Any] | None:
    """Spectrum of an irregular sea; None for other waves, or if incident waves cannot be separated."""
    if case.waves is None or case.waves.kind != "irregular" or "eta" not in series:
        return None
    try:
        t = series["time"]
        # one repetition of the sea, or its recorded part, from the beginning of the series
        over = settled_window(case, t, (), float(t[0])).over
        sea = two_way_sea(case, t[over], series["eta"][over], Geometry.of(case).depth)
    except ValueError:
        return None
    f, asked = sea.incident.f, case.waves.shape(case.waves.height)
    low, high = sea.incident.band(WITHIN)
    lines = [
        {"name": "incident", "f": f, "S": sea.incident.S},
        {"name": "reflected", "f": f, "S": sea.reflected.S},
        {"name": "target spectrum", "f": f, "S": asked.density(np.maximum(f, 1e-9)), "dash": True},
    ]
    band = {"f": pack.array(f), "low": pack.array(low), "high": pack.array(high)}
    about = (
        f"Hm0 = {sea.incident.Hm0:.3g} m, reflection coefficient {sea.coefficient:.2g}; "
        f"{100 * WITHIN:g} % confidence band"
    )
    return _spectral(f"Spectrum of the sea: {about}", lines, pack) | {"band": band}


def _spectral(title: str, lines: list[dict[str, Any]], pack: Pack) -> dict[str, Any]:
    """Spectrum for a page, cut off slightly above the frequency below which 99.9 % of the variance lies."""
    top = 0.0
    for line in lines:
        share = np.cumsum(line["S"]) / max(float(np.sum(line["S"])), 1e-300)
        top = max(top, float(line["f"][min(int(np.searchsorted(share, 0.999)), len(share) - 1)]))
    packed = [line | {"f": pack.array(line["f"]), "S": pack.array(line["S"])} for line in lines]
    return {"title": title, "unit": "m²/Hz", "top": 1.1 * top, "lines": packed}
