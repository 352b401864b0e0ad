"""Figures of a page: what stands where in them, for the template that draws them as SVG.

Nothing in a figure has a colour of its own: what belongs to a method has the class ``method-N`` and
``data-method="N"``, everything else is frame, and the style sheet of the page colours both for light and dark.
"""

import math
from collections.abc import Callable, Sequence
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
    points: list[list[float]]
    """Points of the line; it is interrupted where one is not finite."""
    marks: list[list[float]]
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
    values = np.where(np.isin(numbers, cuts), np.nan, np.array(series, float))
    known = values[np.isfinite(values).any(axis=1)]
    medians = np.nanmedian(known, axis=1)
    lowest = float(np.nanmin(known))
    highest = float(np.nanmax(known))
    is_logarithmic = may_be_logarithmic and lowest > 0 and bool(medians.max() > MAGNITUDE * medians.min())
    if is_logarithmic:
        label = f"{label}, logarithmic"
        y = Axis(max(lowest, highest / WIDEST) / 1.5, highest * 1.5, is_logarithmic)
    else:
        bottom = 0.0 if from_zero else lowest
        spare = 0.08 * ((highest - bottom) or 1.0)
        y = Axis(bottom if from_zero else bottom - spare, highest + spare)
    spare = max(0.5, 0.015 * (numbers[-1] - numbers[0]))
    x = Axis(numbers[0] - spare, numbers[-1] + spare)

    def draw(chart: Chart) -> list[Curve]:
        across = chart.x.at(np.array(numbers))
        return [_line(method, across, chart.y.at(of_method)) for method, of_method in enumerate(values)]

    return _laid_out(label, "frame", x, y, draw, cuts)


def _line(method: int, x: np.ndarray, y: np.ndarray) -> Curve:
    """Return the line of a method through points."""
    points = np.column_stack([x, y]).round(2).tolist()
    step = len(points) // MARKS_OF_A_LINE if len(points) > MARKED_FRAMES else 1
    first = method * step // MARKS % step  # not all at the same frames
    return Curve(method, points, [point for point in points[first::step] if math.isfinite(point[1])])


def draw_dots(label: str, across: str, dots: Sequence[tuple[int, float, float]]) -> list[Chart]:
    """Draw one dot per method, with logarithmic x, in every form; `across` is the label of x.

    A dot is the index of its method, by which the page colours it, and its x and y.
    """
    _, times, values = zip(*dots, strict=True)
    x = Axis(min(times) / 1.6, max(times) * 1.6, is_logarithmic=True)
    spare = 0.18 * ((max(values) - min(values)) or 1.0)
    y = Axis(min(values) - spare, max(values) + spare)

    def draw(chart: Chart) -> list[Curve]:
        return [Curve(method, [], [[float(chart.x.at(x)), float(chart.y.at(y))]]) for method, x, y in dots]

    return _laid_out(label, across, x, y, draw)


def _laid_out(
    label: str, across: str, x: Axis, y: Axis, draw: Callable[[Chart], list[Curve]], cuts: Sequence[int] = ()
) -> list[Chart]:
    """Return a chart in every form, whose axes have room for their labels and for the title."""
    y_labels = y.labels(9)
    charts = []
    for form in FORMS:
        left = form.text * WIDTH * max(len(f"{each:g}") for each in y_labels) + 7
        placed = x._replace(start=left, end=form.width - 6)
        risen = y._replace(start=form.height - 2 * LINE * form.text - 10, end=LINE * form.text + 9)
        chart = Chart(form, label, across, placed, risen, x.labels(form.x_labels, 1), y_labels, [], cuts)
        charts.append(chart._replace(curves=draw(chart)))
    return charts
