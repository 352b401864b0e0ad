"""Figures drawn by matplotlib as SVG text that a page can colour and read.

Nothing in a figure has a colour of its own that matters: what belongs to a method carries ``class="series method-N"``
and ``data-method="N"``, everything else is frame, and the page's rc_params sheet colours both for light and dark.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from fpsboost.evaluation.report.styles import MARKERS, Style, break_name

MARKED_FRAMES = 80
"""Number of frames up to which each point of a line is marked."""
MARKS_OF_A_LINE = 12
"""Number of marks of a longer line, so that lines can be told apart without colours."""
TITLE_WIDTH = 0.56
"""Mean width of a letter of a title, in font sizes."""

WIDTH, LINE = 0.64, 1.3
"""Width of a letter and height of a line, in sizes of the text: not less than in any font that a page may find."""

MAGNITUDE = 8
"""Ratio of the largest to the smallest value above which a logarithmic scale is used."""

WIDEST = 1e5
"""Ratio of the largest to the smallest value that a logarithmic scale shows: equal frames have next to no error."""

rc_params: Any = {
    "svg.fonttype": "none",  # text stays text: the page's fonts, and readable by machines
    "svg.hashsalt": "fpsboost",  # the same figure gets the same names
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.linewidth": 0.6,
    "axes.linewidth": 0.8,
    "xtick.major.size": 3,
    "ytick.left": False,
    "axes.titlelocation": "left",
    "axes.titlepad": 9,
    "axes.axisbelow": True,
}


class Form(NamedTuple):
    """Size at which a figure is drawn.

    It is scaled to the page's width, so that the size determines that of its text.
    """

    name: str
    size: tuple[float, float]  # width and height, inches
    text: float
    """Font size, points."""


FORMS = (Form("wide", (11.6, 3.9), 9.4), Form("narrow", (4.7, 3.7), 10.6))  # for a screen and for a phone


class Series(NamedTuple):
    """Values of one method for every frame, NaN where there is none."""

    method: int  # place among the methods, by which the page colours it
    values: Sequence[float]
    style: Style
    """Colour, marker and line."""


class Dot(NamedTuple):
    """Position of one method in a scatter plot."""

    method: int
    name: str
    x: float
    """Time per frame, seconds."""
    y: float
    """PSNR, dB."""
    style: Style


class Chart(NamedTuple):
    """A figure, and the position of its axes, so that a page can read values from it."""

    form: str
    """Name of the form."""
    svg: str
    """The figure as SVG."""
    box: tuple[float, float, float, float]  # left, top, width and height of the axes, shares of the figure
    x_range: tuple[float, float]
    """First and last value of x."""
    y_range: tuple[float, float]
    """First and last value of y."""
    logarithmic: bool
    """Whether y is logarithmic."""
    is_labelled: bool = True  # whether every name that belongs into the figure had room there


def draw_lines(
    name: str,
    label: str,
    numbers: Sequence[int],
    series: Sequence[Series],
    cuts: Sequence[int] = (),
    *,
    from_zero: bool = True,
    may_be_logarithmic: bool = False,
) -> list[Chart]:
    """Draw a value for every frame and method, in every form; `name` is a prefix for the names in the SVG.

    Frames of `cuts` do not count: they are marked, and their values left out. The axis may be logarithmic where the
    values differ much.
    """
    counted = np.array([number not in cuts for number in numbers])
    values = [np.where(counted, np.asarray(each.values, float), np.nan) for each in series]
    finite = [each for each in values if np.isfinite(each).any()]
    all_values = np.concatenate([each[np.isfinite(each)] for each in finite])
    medians = [float(np.nanmedian(each)) for each in finite]
    differ_much = float(all_values.min()) > 0 and max(medians) > MAGNITUDE * min(medians)
    logarithmic = may_be_logarithmic and differ_much
    charts = []
    for form in FORMS:
        with mpl.rc_context({**rc_params, "font.size": form.text}):
            figure, axes = _begin(form, f"{label}, logarithmic" if logarithmic else label)
            for (method, _, style), of_method in zip(series, values, strict=True):
                step = len(numbers) // MARKS_OF_A_LINE if len(numbers) > MARKED_FRAMES else 1
                axes.plot(
                    numbers,
                    of_method,
                    linewidth=1.6,
                    linestyle=style.line,
                    marker=MARKERS[style.mark],
                    markersize=5.5,
                    markeredgewidth=0,
                    markevery=(method * step // len(MARKERS) % step, step),  # not all at the same frames
                    gid=f"series-{method}-line",
                )
            for cut in cuts:
                axes.axvline(cut, gid=f"cut-{cut}", linewidth=1, linestyle=(0, (2, 3)))
            _set_limits(axes, numbers, all_values, from_zero=from_zero and not logarithmic, logarithmic=logarithmic)
            axes.set_xlabel("frame")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=12 if form.name == "wide" else 6))
            charts.append(_finish(figure, axes, name, form))
    return charts


def draw_dots(name: str, label: str, across: str, dots: Sequence[Dot]) -> list[Chart]:
    """Draw one labelled dot per method, with logarithmic x, in every form; `across` is the label of x."""
    charts = []
    for form in FORMS:
        with mpl.rc_context({**rc_params, "font.size": form.text}):
            figure, axes = _begin(form, label)
            axes.set_xscale("log")
            axes.grid(axis="x")
            for dot in dots:
                axes.plot(
                    [dot.x],
                    [dot.y],
                    MARKERS[dot.style.mark],
                    markersize=9,
                    markeredgewidth=0,
                    clip_on=False,
                    gid=f"series-{dot.method}-dot",
                )
            left, right = min(dot.x for dot in dots), max(dot.x for dot in dots)
            axes.set_xlim(left / 1.6, right * 1.6)
            axes.margins(y=0.18)
            axes.set_xlabel(across)
            _number_logarithmic(axes.xaxis, right / left)
            figure.draw_without_rendering()
            is_labelled = _label(axes, dots, form.text)
            charts.append(_finish(figure, axes, name, form)._replace(is_labelled=is_labelled))
    return charts


def _begin(form: Form, label: str) -> tuple[Figure, Axes]:
    """Return a new figure with its title, which is wrapped to its width."""
    figure = Figure(figsize=form.size, layout="constrained")
    figure.patch.set_visible(False)
    axes = figure.add_subplot()
    axes.patch.set_visible(False)
    room = 0.86 * 72 * form.size[0] / (TITLE_WIDTH * form.text)  # the title begins where the axes do
    before, comma, behind = label.rpartition(", ")
    axes.set_title(f"{before},\n{behind}" if comma and len(label) > room else label, fontsize=form.text)
    return figure, axes


def _set_limits(
    axes: Axes, numbers: Sequence[int], all_values: NDArray[Any], *, from_zero: bool, logarithmic: bool
) -> None:
    """Set the limits of the axes so that values are visible with a margin; logarithmic scales span at most `WIDEST`."""
    spare = max(0.5, 0.015 * (numbers[-1] - numbers[0]))
    axes.set_xlim(numbers[0] - spare, numbers[-1] + spare)
    lowest, highest = float(all_values.min()), float(all_values.max())
    if logarithmic:
        lowest = max(lowest, highest / WIDEST)
        axes.set_yscale("log")
        axes.set_ylim(lowest / 1.5, highest * 1.5)
        _number_logarithmic(axes.yaxis, highest / lowest)
    else:
        span = (highest - (0 if from_zero else lowest)) or 1.0
        axes.set_ylim(0 if from_zero else lowest - 0.08 * span, highest + 0.08 * span)


def _number_logarithmic(axis: Axis, ratio: float) -> None:
    """Label an axis with plain numbers instead of powers of ten, and enough of them."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if ratio < 200 else (1, 3) if ratio < 5000 else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _label(axes: Axes, dots: Sequence[Dot], text: float) -> bool:
    """Write each name beside its dot where it covers nothing and is not cut off; return whether all fit."""
    is_labelled = True
    pixels = axes.transData.transform([(dot.x, dot.y) for dot in dots])
    scale = axes.figure.dpi / 72
    taken = [_box(x, y, 15 * scale, 15 * scale) for x, y in pixels]
    for dot, (x, y) in sorted(zip(dots, pixels.tolist(), strict=True), key=lambda each: -each[1][1]):
        lines = break_name(dot.name)
        width, height = WIDTH * text * max(map(len, lines)) * scale, LINE * len(lines) * text * scale
        aside = width / 2 + 10 * scale
        above = height / 2 + 8 * scale
        places = [(aside, 0.0), (aside, above), (aside, -above), (0.0, above), (0.0, -above), (-aside, 0.0)]
        places += [(aside, 2 * above), (aside, -2 * above), (-aside, above), (-aside, -above)]
        boxes = {place: _box(x + place[0], y + place[1], width, height) for place in places}
        contains = axes.figure.bbox.contains
        inside = {place: box for place, box in boxes.items() if contains(*box.min) and contains(*box.max)}
        free = [place for place, box in inside.items() if not box.count_overlaps(taken)]
        if not free:
            is_labelled = False
            continue
        taken.append(boxes[free[0]])
        offset = free[0][0] / scale, free[0][1] / scale
        axes.annotate(
            "\n".join(lines),
            (dot.x, dot.y),
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            gid=f"series-{dot.method}-name",
            annotation_clip=False,
        ).set_in_layout(False)
    return is_labelled


def _box(x: float, y: float, width: float, height: float) -> Bbox:
    """Return a rectangle around its centre, pixels of the figure."""
    return Bbox.from_bounds(x - width / 2, y - height / 2, width, height)


def _finish(figure: Figure, axes: Axes, name: str, form: Form) -> Chart:
    """Return the figure as a chart for the page."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    place = axes.get_position()
    return Chart(
        form=form.name,
        svg=_for_page(file.getvalue(), f"{name}-{form.name}"),
        box=(place.x0, 1 - place.y1, place.width, place.height),
        x_range=axes.get_xlim(),
        y_range=axes.get_ylim(),
        logarithmic=axes.get_yscale() == "log",
    )


def _for_page(svg: str, prefix: str) -> str:
    """Make the names in an SVG unique on a page, and add classes for the parts that belong to a method."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    # what is drawn again and again takes the colour of its place, not of its definition
    svg = re.sub(r"<defs>.*?</defs>", lambda match: re.sub(r"stroke: #\w+", "", match[0]), svg, flags=re.DOTALL)
    svg = re.sub(r'id="series-(\d+)-(\w+)"', r'class="series \2 method-\1" data-method="\1"', svg)
    svg = re.sub(r'id="cut-\d+"', 'class="cut"', svg)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\1{prefix}-", svg)
    return svg.replace("<svg ", '<svg aria-hidden="true" ', 1)
