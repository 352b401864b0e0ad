"""Figures of a page: what stands where in them, for the template that draws them as SVG.

Nothing in a figure has a colour of its own: what belongs to a method has the class ``method-N`` and
``data-method="N"``, everything else is frame, and the style sheet of the page colours both for light and dark.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.report.styles import MARKS

MARKED_FRAMES = 80
"""Number of frames up to which each point of a line is marked."""
MARKS_OF_A_LINE = 12
"""Number of marks of a longer line, so that lines can be told apart without colours."""

WIDTH = 0.64
"""Width of a letter, in sizes of the text: not less than in any font that a page may find."""
LINE = 1.3
"""Height of a line, in sizes of the text."""

MAGNITUDE = 8
"""Ratio of the largest to the smallest value above which a logarithmic scale is used."""

WIDEST = 1e5
"""Ratio of the largest to the smallest value that a logarithmic scale shows: equal frames have next to no error."""


class Form(NamedTuple):
    """Size at which a figure is drawn.

    It is scaled to the page's width, so that the size determines that of its text.
    """

    name: str
    width: int
    height: int
    text: float
    """Font size, in the unit of width and height."""
    x_labels: int
    """Largest number of intervals between labels of x."""


FORMS = (Form("wide", 835, 281, 9.4, 12), Form("narrow", 338, 266, 10.6, 6))  # for a screen and for a phone


class Dot(NamedTuple):
    """Position of one method in a scatter plot."""

    method: int  # place among the methods, by which the page colours it
    x: float
    """Time per frame, seconds."""
    y: float
    """PSNR, dB."""


class Axis(NamedTuple):
    """Range of values of a figure, and where their ends stand in it."""

    low: float
    high: float
    is_logarithmic: bool = False
    start: float = 0.0
    """Position of the lowest value, in the unit of the figure."""
    end: float = 1.0
    """Position of the highest value."""

    def at(self, values: Any) -> Any:
        """Return the positions of values, an array or a number."""
        low, high, inner = (np.log(each) if self.is_logarithmic else each for each in (self.low, self.high, values))
        return self.start + (inner - low) / (high - low) * (self.end - self.start)

    def labels(self, most: int, least_step: float = 0.0) -> list[float]:
        """Return round values to label, with at most that many intervals between them.

        Examples
        --------
        >>> Axis(-0.2, 23.3).labels(6, 1)
        [0.0, 5.0, 10.0, 15.0, 20.0]
        >>> Axis(0.3, 40, is_logarithmic=True).labels(6)
        [0.5, 1.0, 2.0, 5.0, 10.0, 20.0]
        """
        if self.is_logarithmic:
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)))
            ratio = self.high / self.low
            digits = (1, 2, 5) if ratio < 400 else (1, 3) if ratio < 10000 else (1,)
            values = [float(f"{digit}e{decade}") for decade in decades for digit in digits]
        else:
            least = max((self.high - self.low) / most, least_step)
            decade = math.floor(math.log10(least))
            step = next(step for digit in (1, 2, 5, 10) if (step := float(f"{digit}e{decade}")) >= least * (1 - 1e-9))
            values = [step * count for count in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]
        return [each for each in values if self.low <= each <= self.high]


class Curve(NamedTuple):
    """Line of a method, or its dot."""

    method: int
    path: str
    """Data of the line's SVG path."""
    marks: list[tuple[float, float]]
    """Positions of its marks."""


class Chart(NamedTuple):
    """A figure in one form, as the template ``chart.html.j2`` draws it, and a page reads values from it."""

    form: Form
    title: str
    """Name of what y is, short enough for one line of the narrow form."""
    across: str
    """Label of x."""
    x: Axis
    y: Axis
    x_labels: list[float]
    y_labels: list[float]
    curves: list[Curve]
    cuts: Sequence[int] = ()
    """Frames that are marked, as they do not count."""

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the axes, shares of the figure."""
        width = self.form.width
        height = self.form.height
        sides = self.x.start / width, self.y.end / height
        return *sides, (self.x.end - self.x.start) / width, (self.y.start - self.y.end) / height


def draw_lines(
    label: str,
    numbers: Sequence[int],
    series: Sequence[Sequence[float]],
    cuts: Sequence[int] = (),
    *,
    from_zero: bool = True,
    may_be_logarithmic: bool = False,
) -> list[Chart]:
    """Draw a value for every frame and method, in every form; `label` is the title.

    `series` are the values of each method, in the order of the methods; NaN or None where there is none. Frames of
    `cuts` do not count: they are marked, and their values left out. The axis may be logarithmic where the values differ
    much; it spans at most `WIDEST`.
    """
    counted = ~np.isin(numbers, cuts)
    values = [np.where(counted, np.asarray(each, float), np.nan) for each in series]
    finite = [each[np.isfinite(each)] for each in values]
    medians = [float(np.median(each)) for each in finite if each.size]
    lowest = float(np.concatenate(finite).min())
    highest = float(np.concatenate(finite).max())
    is_logarithmic = may_be_logarithmic and lowest > 0 and max(medians) > MAGNITUDE * min(medians)
    if is_logarithmic:
        label = f"{label}, logarithmic"
        y = Axis(max(lowest, highest / WIDEST) / 1.5, highest * 1.5, is_logarithmic)
    else:
        bottom = 0.0 if from_zero else lowest
        spare = 0.08 * ((highest - bottom) or 1.0)
        y = Axis(bottom if from_zero else bottom - spare, highest + spare)
    spare = max(0.5, 0.015 * (numbers[-1] - numbers[0]))
    x = Axis(numbers[0] - spare, numbers[-1] + spare)
    charts = []
    for form in FORMS:
        chart = _laid_out(form, label, "frame", x, y)
        across = chart.x.at(np.array(numbers))
        curves = [_line(method, across, chart.y.at(of_method)) for method, of_method in enumerate(values)]
        charts.append(chart._replace(curves=curves, cuts=cuts))
    return charts


def _line(method: int, x: np.ndarray, y: np.ndarray) -> Curve:
    """Return the line of a method through points, interrupted where one is not finite."""
    points = [(round(across, 2), round(down, 2)) for across, down in zip(x.tolist(), y.tolist(), strict=True)]
    path = ""
    command = "M"
    for across, down in points:
        if math.isfinite(down):
            path += f"{command}{across} {down}"
        command = "L" if math.isfinite(down) else "M"
    step = len(points) // MARKS_OF_A_LINE if len(points) > MARKED_FRAMES else 1
    first = method * step // MARKS % step  # not all at the same frames
    return Curve(method, path, [point for point in points[first::step] if math.isfinite(point[1])])


def draw_dots(label: str, across: str, dots: Sequence[Dot]) -> list[Chart]:
    """Draw one dot per method, with logarithmic x, in every form; `across` is the label of x."""
    times = [dot.x for dot in dots]
    values = [dot.y for dot in dots]
    x = Axis(min(times) / 1.6, max(times) * 1.6, is_logarithmic=True)
    spare = 0.18 * ((max(values) - min(values)) or 1.0)
    y = Axis(min(values) - spare, max(values) + spare)
    charts = []
    for form in FORMS:
        chart = _laid_out(form, label, across, x, y)
        curves = [Curve(dot.method, "", [(float(chart.x.at(dot.x)), float(chart.y.at(dot.y)))]) for dot in dots]
        charts.append(chart._replace(curves=curves))
    return charts


def _laid_out(form: Form, label: str, across: str, x: Axis, y: Axis) -> Chart:
    """Return a chart without curves, whose axes have room for their labels and for the title."""
    y_labels = y.labels(9)
    left = form.text * WIDTH * max(len(f"{each:g}") for each in y_labels) + 7
    x = x._replace(start=left, end=form.width - 6)
    y = y._replace(start=form.height - 2 * LINE * form.text - 10, end=LINE * form.text + 9)
    return Chart(form, label, across, x, y, x.labels(form.x_labels, 1), y_labels, [])
