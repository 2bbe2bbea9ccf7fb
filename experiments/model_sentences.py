"""Sentences of the pages on fast models and slopes, as in `experiments.sentences`."""

from __future__ import annotations

from experiments.prose import Sentence
from experiments.quantities import lost_in_filter

FAST, SLOPES = "docs/how-to/fast-models.md", "docs/how-to/slopes.md"
FOUND = "loss coefficient of the lip", "additional length of the column, in draughts"
"""Rows of the values that a fast model finds."""
UNSEEN = "error of the model, root mean square of twelve runs"

OF_MODELS = (
    Sentence(
        "errors are {:.1f} % of the efficiency, {:.1f} % of the pressure and {:.1f} % of the flow",
        lambda r: tuple(
            r("fast_owc_0.01", f"{name}: error of the model, root mean square of twelve runs")
            for name in ("xi over the measured incident wave", "amplitude of the pressure", "flow")
        ),
        (FAST,),
    ),
    Sentence(
        "those\nof linear theory {:.0f}, {:.0f} and {:.0f} %",
        lambda r: tuple(
            r("fast_owc_0.01", f"{name}: error of linear theory")
            for name in ("xi over the measured incident wave", "amplitude of the pressure", "flow")
        ),
        (FAST,),
    ),
    Sentence(
        "has {:.0f} % more power over the year than the runs, whose standard error is {:.0f} %; linear "
        "theory has {:.0f} % more",
        lambda r: (
            r("fast_seas_0.02", "annual mean power: error of the model"),
            100.0
            * r("fast_seas_0.02", "annual mean power of the runs: standard error")
            / r("fast_seas_0.02", "annual mean power of the runs"),
            100.0
            * r("fast_seas_0.02", "annual mean power of the model", column="theory")
            / r("fast_seas_0.02", "annual mean power of the runs")
            - 100.0,
        ),
        (FAST,),
    ),
    Sentence(
        "finds a device with {:.2f} times the power of the best of twenty in a grid, from {:.0f} runs",
        lambda r: (
            r("model_search_0.025", "power of the device found over that of the best of the grid"),
            r("model_search_0.025", "runs of the water"),
        ),
        (FAST,),
    ),
    Sentence(
        "device has {:.2f} W/m by the model and {:.2f} W/m in runs of the seas, the case's device {:.2f} W/m",
        lambda r: tuple(
            r("model_search_0.025", f"mean power of the {device}")
            for device in (
                "best device, by the model",
                "best device, in the water",
                "case's device, in the water",
            )
        ),
        (FAST,),
    ),
    Sentence(
        "The loss coefficient is {:.1f}, and the additional length {:.2f} draughts",
        lambda r: tuple(r("fast_owc_0.01", name) for name in FOUND),
        (FAST,),
    ),
    Sentence(
        "at twice the spacing they are {:.1f} and {:.2f}",
        lambda r: tuple(r("fast_owc_0.02", name) for name in FOUND),
        (FAST,),
    ),
    Sentence(
        "| the derivative through one run, with tangents smoothed during the run | {:.1f} times one run",
        lambda r: (r("bench_slopes", "value and slope, filtered: time over that of the run"),),
        (SLOPES,),
    ),
    Sentence(
        "| {:.1f} times one run; in reverse mode {:.1f} times, and {:.0f} GB of memory for a wave period",
        lambda r: (
            r("bench_slopes", "value and slope, exact: time over that of the run"),
            r("bench_slopes", "reverse mode of one wave period: time over that of the run"),
            r("bench_slopes", "reverse mode of one wave period: memory"),
        ),
        (SLOPES,),
    ),
    Sentence(
        "a filtered slope costs {:.1f}\ntimes one run, in reverse mode {:.1f} times",
        lambda r: (
            r("bench_slopes_incompressible", "value and slope, filtered: time over that of the run"),
            r("bench_slopes_incompressible", "reverse mode of one wave period: time over that of the run"),
        ),
        (SLOPES,),
    ),
    Sentence("a bias of {:.0f} to {:.0f} % of the water's response", lost_in_filter, (SLOPES,)),
    *(
        Sentence(
            f"| {shown} | {{:z.{digits}f}}e-4 ± {{:.{digits}f}}e-4 | {{:.{digits}f}}e-4 |",
            lambda r, damping=damping: tuple(
                r("filter_study_0.02", f"K_dm = {damping}: 1e4 times {what}")
                for what in (
                    "the slope of the fit",
                    "the standard error of the slope of the fit",
                    "the filtered slope",
                )
            ),
            (SLOPES,),
        )
        for shown, damping, digits in (("257", "257", 1), ("535", "534.66", 1), ("1300", "1300", 2))
    ),
    *(
        Sentence(
            text,
            lambda r, device=device: tuple(
                r(device, f"{what}: {whose}")
                for whose in (UNSEEN, "error of linear theory")
                for what in ("power", "motion")
            ),
            (FAST,),
        )
        for device, text in (
            (
                "fast_buoy_0.02",
                "mean errors of {:.0f} % of the power and {:.0f} % of the heave; those of linear theory "
                "are {:.0f} and {:.0f} %",
            ),
            (
                "fast_flap_0.03",
                "they are {:.0f} % of the power and {:.0f} % of the pitch, and {:.0f} and {:.0f} % by linear "
                "theory",
            ),
        )
    ),
    Sentence(
        "An answer takes {:.0f} ms in regular waves,\n{:.0f} ms in a sea",
        lambda r: tuple(
            1e3 * r("buoy_control_0.02", f"latching: time of an answer in {waves}")
            for waves in ("regular waves", "a sea")
        ),
        (FAST,),
    ),
    *(
        Sentence(
            text,
            lambda r, name=name: (
                r("buoy_control_0.02", f"{name}: mean power over that with constant damping"),
                r("buoy_control_0.02", f"{name}: standard error of this ratio"),
                r("buoy_control_0.02", f"{name}: mean power by the model")
                / r("buoy_control_0.02", "constant damping: mean power by the model"),
            ),
            (FAST,),
        )
        for name, text in (
            (
                "reactive control",
                "power with reactive control is {:.2f} ± {:.2f} times that with a constant damping, and the "
                "model had\npromised {:.2f} times",
            ),
            ("latching", "power with the latch is {:.2f} ± {:.2f} times that without (promised: {:.2f})"),
            (
                "network",
                "the mean power is {:.2f} ± {:.2f} times that with a constant\ndamping (promised: {:.2f})",
            ),
        )
    ),
    Sentence(
        "is then known to {:.2f} 1/m; a cubic through the same runs gives {:.2f} 1/m",
        lambda r: (
            r("fast_slopes_0.0125", "device.draught: its standard error"),
            r("fast_slopes_0.0125", "device.draught: standard error of a cubic"),
        ),
        (SLOPES,),
    ),
    Sentence(
        "deviates from that of all nine by {:.1f} % if it is interpolated linearly, and by {:.1f} % with the "
        "model, which states an error\nof {:.0f} %",
        lambda r: tuple(
            r("fast_seas_0.02", f"annual mean power from runs in four of the seas, {what}")
            for what in (
                "interpolated linearly: deviation from nine",
                "with the model: deviation from nine",
                "with the model: stated error of the other five seas",
            )
        ),
        (FAST,),
    ),
)
"""Sentences of the pages with numbers from the results."""
