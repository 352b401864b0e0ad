"""A comparison as one page that needs nothing but a browser: figures, tables, and pictures to look at closely.

The page shows the data of a `Comparison`; frames are interpolated again to be shown, but not scored again.
"""

import math
import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from markupsafe import Markup

from fpsboost.evaluation.compared_methods import MINTERPOLATE, method_names
from fpsboost.evaluation.export import (
    COLUMNS,
    area_rows,
    further_columns,
    mean_rows,
    named_rows,
    without_nan,
)
from fpsboost.evaluation.further_metrics import metrics
from fpsboost.evaluation.hidden_frames import read_samples
from fpsboost.evaluation.report.charts import Chart, draw_dots, draw_lines
from fpsboost.evaluation.report.pictures import (
    MAX_DRAWN_ERROR,
    MAX_EXACT_PIXELS,
    MAX_PIXELS,
    MotionView,
    Strip,
    choose_exact,
    choose_passages,
    count_for,
    view_frame,
    view_motion,
    view_passages,
)
from fpsboost.evaluation.report.styles import styles_of
from fpsboost.evaluation.results import TIMES, Column, ComparedClip, Comparison
from fpsboost.evaluation.verdict import judge, judge_all
from fpsboost.image import Image
from fpsboost.io.new_output import new_folder, write_whole
from fpsboost.pages import templates_of

PAGE = "index.html"
"""Name of the page in its folder."""

DIFFERENT = "where the methods differ most"
"""Reason for which a frame is shown."""


class Plot(NamedTuple):
    """A figure with a value for every frame."""

    key: str
    """Name in the data of the page."""
    title: str
    unit: str
    charts: list[Chart]
    """The figure in every form."""


def write_report(folder: Path, clips: Sequence[ComparedClip]) -> Path:
    """Write the page of comparisons of the same methods into a new folder, and return its path."""
    with new_folder(folder) as unfinished:
        write_whole(unfinished / PAGE, make_page(clips).encode())
    return folder / PAGE


def make_page(clips: Sequence[ComparedClip]) -> str:
    """Return the page of comparisons as HTML text; see `write_report`."""
    environment = templates_of("fpsboost.evaluation.report")
    environment.filters["breakable"] = breakable
    comparisons = [each.comparison for each in clips]
    written = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
    styles = styles_of([method.name for method in comparisons[0].methods])
    bodies = [
        environment.get_template("clip.html.j2").render(
            _clip_values(each, f"-{number}" if number > 1 else "", len(clips)), date=written, styles=styles
        )
        for number, each in enumerate(clips, 1)
    ]
    one = clips[0].comparison if len(clips) == 1 else None
    return environment.get_template("compare.html.j2").render(
        command_name="compare",
        name=_name_of(one) if one else f"{len(clips)} clips",
        names=[_name_of(each) for each in comparisons],
        sentences=judge(one).sentences if one else judge_all(comparisons),
        has_times=bool(comparisons[0].known_times),
        means=mean_rows(comparisons),
        bodies=[Markup(each) for each in bodies],
        styles=styles,
    )


def _name_of(comparison: Comparison) -> str:
    """Return the name of a clip for headings."""
    return Path(comparison.clip).name or comparison.clip


def _clip_values(each: ComparedClip, at: str, clips: int) -> dict[str, Any]:
    """Return the values for the sections about one of several clips; `at` is a suffix of its element names."""
    comparison = each.comparison
    choices = choose_frames(comparison)
    first = next(iter(choices))
    opening = next((number for number, reasons in choices.items() if DIFFERENT in reasons), first)
    strips, motion = _view_frames(each, choices)
    count = count_for(comparison, MAX_PIXELS // clips)
    passages = choose_passages(comparison, count, list(choices))
    exact = choose_exact(comparison, [*dict.fromkeys([opening, first])], MAX_EXACT_PIXELS // clips)
    played = view_passages(each, passages, exact)
    played.opening = opening
    return {
        "at": at,
        "comparison": comparison,
        "name": _name_of(comparison),
        "verdict": judge(comparison),
        "notes": each.notes(),
        "columns": COLUMNS.values(),
        "overall": named_rows(comparison),
        "by_area": area_rows(comparison),
        "further_metrics": further_columns(comparison).values(),
        "further": named_rows(comparison, further_columns(comparison)),
        "plots": frame_plots(comparison, {"psnr": COLUMNS["psnr"], "mae": COLUMNS["mae"], **comparison.metrics}),
        "timing": frame_plots(comparison, {name: COLUMNS[name] for name in comparison.known_times}),
        "quality": quality_plots(comparison),
        "values": frame_values(comparison),
        "shared_out": shared_out(comparison),
        "choices": choices,
        "different": DIFFERENT,
        "strips": strips,
        "motion": motion,
        "exact": exact,
        "played": played,
        "plays_all": len(passages) == 1 and len(passages[0]) == len(comparison.hidden),
        "command": command(comparison),
        "brightest": MAX_DRAWN_ERROR,
    }


def _view_frames(clip: ComparedClip, choices: Collection[int]) -> tuple[dict[int, list[Strip]], MotionView | None]:
    """Return close-ups of chosen frames by their numbers, and the motion at the first of them."""
    comparison = clip.comparison
    images: dict[int, dict[str, Image]] = {number: {} for number in choices}
    for name, compared_method in clip.compared_methods.items():
        for frame in compared_method.interpolate(comparison.hold_out.intervals(comparison.clip), choices):
            images[frame.number][name] = frame.image
    samples = read_samples(comparison.clip, comparison.hold_out, choices)
    strips = {number: view_frame(samples[number], images[number]) for number in choices}
    first = next(iter(choices))
    return strips, view_motion(samples[first], images[first], clip.compared_methods)


def choose_frames(comparison: Comparison) -> dict[int, list[str]]:
    """Choose the worst, the median and the best frame of the first method, and the one where methods differ most.

    Returns the reasons for showing each, such as "the worst", by the numbers of the frames.
    """
    first = comparison.methods[0]
    ranked = sorted(comparison.counted(first), key=lambda frame: frame.scores.psnr)
    reasons = {
        "the worst": ranked[0].number,
        "the median": ranked[(len(ranked) - 1) // 2].number,
        "the best": ranked[-1].number,
    }
    if len(comparison.methods) > 1:
        frames = zip(*(comparison.counted(method) for method in comparison.methods), strict=True)
        errors = {each[0].number: [frame.scores.mae for frame in each] for each in frames}
        # not from the worst: a method that fails everywhere would decide alone
        reasons[DIFFERENT] = max(errors, key=lambda number: median(errors[number]) - min(errors[number]))
    return {number: [why for why, which in reasons.items() if which == number] for number in reasons.values()}


def frame_plots(comparison: Comparison, columns: Mapping[str, Column]) -> list[Plot]:
    """Return figures of every frame to choose from, by their names in the data."""
    values = frame_values(comparison)["methods"]
    plots = []
    for name, column in columns.items():
        label = f"{column.title}, {column.unit}" if column.unit else column.title
        label += " (higher is better)" if column.high_is_good else ""
        series = [each[name] for each in values]
        how = {"from_zero": not column.high_is_good, "may_be_logarithmic": name in {"mae", *TIMES}}
        charts = draw_lines(label, comparison.hidden, series, [*comparison.cuts, *comparison.doubtful], **how)
        plots.append(Plot(name, column.title, column.unit, charts))
    return plots


def shared_out(comparison: Comparison) -> list[str]:
    """Return the methods whose time is that of another program's whole run, and unknown for single frames."""
    return [
        method.name
        for method in comparison.methods
        if method.name.partition(":")[0].removesuffix("+guide") not in {*method_names()} - {MINTERPOLATE}
        and math.isfinite(comparison.means(method)["seconds"])
    ]


def quality_plots(comparison: Comparison) -> list[Plot]:
    """Return quality against time, one dot per method, by each clock that is known."""
    plots = []
    for key, title in comparison.known_times.items():
        means = [comparison.means(method) for method in comparison.methods]
        dots = [(index, each[key], each["psnr"]) for index, each in enumerate(means) if math.isfinite(each[key])]
        charts = draw_dots("PSNR, dB (higher is better)", f"{title}, s a frame (farther left is faster)", dots)
        plots.append(Plot(key, title, "", charts))
    return plots


def frame_values(comparison: Comparison) -> dict[str, Any]:
    """Return the values of the figures for the script of the page."""
    return {
        "frames": comparison.hidden,
        "cuts": comparison.cuts,
        "doubtful": comparison.doubtful,
        "methods": [
            {
                "name": method.name,
                **{name: [getattr(frame.scores, name) for frame in method.frames] for name in ("mae", "psnr")},
                **{name: without_nan([getattr(frame, name) for frame in method.frames]) for name in TIMES},
                **{name: [frame.metrics[name] for frame in method.frames] for name in comparison.metrics},
            }
            for method in comparison.methods
        ],
    }


def command(comparison: Comparison) -> str:
    """Return the command line of the comparison."""
    known = method_names()
    names = [*(method.name for method in comparison.methods), *comparison.skipped]
    names = [name for name in names if name.partition(":")[0] in known]
    words = ["fpsboost", "compare", comparison.clip, "-m", ",".join(names)]
    words += comparison.hold_out.as_options()
    if further := [name for name in further_columns(comparison) if name in metrics]:
        words += ["--metrics", ",".join(further)]
    return shlex.join([*words, *comparison.others, *comparison.rendered, *comparison.cut_options, "--report", "DIR"])


def breakable(name: str) -> Markup:
    """Return a name that a browser may break behind its punctuation.

    Examples
    --------
    >>> breakable("nlm:v=0.1,reach=<1>")
    Markup('nlm:<wbr>v=0.1,<wbr>reach=&lt;1&gt;')
    """
    return Markup("<wbr>").join(re.findall(r"[^:,]*[:,]+|[^:,]+", name))
