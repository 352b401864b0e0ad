"""Figures of a page: what stands where in them, for the template that draws them as SVG.

Nothing in a figure has a colour of its own: what belongs to a method has the class ``method-N`` and
``data-method="N"``, everything else is frame, and the style sheet of the page colours both for light and dark.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fpsboost.evaluation.report.styles import MARKS, break_name

MARKED_FRAMES = 80
"""Number of frames up to which each point of a line is marked."""
MARKS_OF_A_LINE = 12
"""Number of marks of a longer line, so that lines can be told apart without colours."""

WIDTH, LINE = 0.64, 1.3
"""Width of a letter and height of a line, in sizes of the text: not less than in any font that a page may find."""
TITLE_WIDTH = 0.56
"""Mean width of a letter of a title, in sizes of the text."""

MAGNITUDE = 8
"""Ratio of the largest to the smallest value above which a logarithmic scale is used."""

WIDEST = 1e5
"""Ratio of the largest to the smallest value that a logarithmic scale shows: equal frames have next to no error."""

Box = tuple[float, float, float, float]
"""Left, top, right and bottom of a rectangle."""


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
    name: str
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


class Label(NamedTuple):
    """Name of a method in a figure."""

    method: int
    lines: list[str]
    x: float
    """Centre of the lines."""
    y: float
    """Top of the first line."""


class Chart(NamedTuple):
    """A figure in one form, as the template ``chart.html.j2`` draws it, and a page reads values from it."""

    form: Form
    title: list[str]
    """Lines of the title, which names what y is."""
    across: str
    """Label of x."""
    x: Axis
    y: Axis
    x_labels: list[float]
    y_labels: list[float]
    curves: list[Curve]
    cuts: Sequence[int] = ()
    """Frames that are marked, as they do not count."""
    names: Sequence[Label] = ()
    """Names of methods beside their dots."""

    @property
    def is_labelled(self) -> bool:
        """Whether every dot has its name beside it."""
        return len(self.names) == len(self.curves)

    @property
    def box(self) -> Box:
        """Left, top, width and height of the axes, shares of the figure."""
        width, height = self.form.width, self.form.height
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
    lowest, highest = float(np.concatenate(finite).min()), float(np.concatenate(finite).max())
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


def _line(method: int, x: NDArray[Any], y: NDArray[Any]) -> Curve:
    """Return the line of a method through points, interrupted where one is not finite."""
    points = [(round(across, 2), round(down, 2)) for across, down in zip(x.tolist(), y.tolist(), strict=True)]
    is_known = np.isfinite(y)
    starts = is_known & ~np.concatenate([[False], is_known[:-1]])
    path = [
        f"{'M' if start else 'L'}{point[0]} {point[1]}"
        for point, known, start in zip(points, is_known, starts, strict=True)
        if known
    ]
    step = len(points) // MARKS_OF_A_LINE if len(points) > MARKED_FRAMES else 1
    first = method * step // MARKS % step  # not all at the same frames
    marks = [point for point, known in zip(points[first::step], is_known[first::step], strict=True) if known]
    return Curve(method, "".join(path), marks)


def draw_dots(label: str, across: str, dots: Sequence[Dot]) -> list[Chart]:
    """Draw one dot with its name per method, with logarithmic x, in every form; `across` is the label of x."""
    times, values = [dot.x for dot in dots], [dot.y for dot in dots]
    x = Axis(min(times) / 1.6, max(times) * 1.6, is_logarithmic=True)
    spare = 0.18 * ((max(values) - min(values)) or 1.0)
    y = Axis(min(values) - spare, max(values) + spare)
    charts = []
    for form in FORMS:
        chart = _laid_out(form, label, across, x, y)
        curves = [Curve(dot.method, "", [(float(chart.x.at(dot.x)), float(chart.y.at(dot.y)))]) for dot in dots]
        charts.append(chart._replace(curves=curves, names=_labels(form, dots, [each.marks[0] for each in curves])))
    return charts


def _laid_out(form: Form, label: str, across: str, x: Axis, y: Axis) -> Chart:
    """Return a chart without curves, whose axes have room for their labels and for the title."""
    y_labels = y.labels(9)
    left = form.text * WIDTH * max(len(f"{each:g}") for each in y_labels) + 7
    before, comma, behind = label.rpartition(", ")
    is_long = TITLE_WIDTH * form.text * len(label) > form.width - left
    title = [f"{before},", behind] if comma and is_long else [label]
    x = x._replace(start=left, end=form.width - 6)
    y = y._replace(start=form.height - 2 * LINE * form.text - 10, end=LINE * form.text * len(title) + 9)
    return Chart(form, title, across, x, y, x.labels(form.x_labels, 1), y_labels, [])


def _labels(form: Form, dots: Sequence[Dot], points: Sequence[tuple[float, float]]) -> list[Label]:
    """Return the names of dots where each covers nothing and is not cut off; others are left out."""
    taken = [_box(x, y, 15, 15) for x, y in points]
    labels = []
    for dot, (x, y) in sorted(zip(dots, points, strict=True), key=lambda each: each[1][1]):
        lines = break_name(dot.name)
        width, height = WIDTH * form.text * max(map(len, lines)), LINE * form.text * len(lines)
        aside, above = width / 2 + 10, -height / 2 - 8
        places = [(aside, 0.0), (aside, above), (aside, -above), (0.0, above), (0.0, -above), (-aside, 0.0)]
        places += [(aside, 2 * above), (aside, -2 * above), (-aside, above), (-aside, -above)]
        boxes = [_box(x + right, y + down, width, height) for right, down in places]
        inside = [box for box in boxes if min(box) >= 0 and box[2] <= form.width and box[3] <= form.height]
        free = next((box for box in inside if not any(_overlap(box, other) for other in taken)), None)
        if free is not None:
            taken.append(free)
            labels.append(Label(dot.method, lines, (free[0] + free[2]) / 2, free[1]))
    return labels


def _box(x: float, y: float, width: float, height: float) -> Box:
    """Return a rectangle around its centre."""
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def _overlap(one: Box, other: Box) -> bool:
    """Return whether two rectangles have points in common."""
    return one[0] <= other[2] and other[0] <= one[2] and one[1] <= other[3] and other[1] <= one[3]
