"""Tables of a comparison's page: figures of every method, as texts, with the best of each column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from fpsboost.evaluation.further_metrics import metrics
from fpsboost.evaluation.results import Comparison, MethodResult
from fpsboost.evaluation.verdict import means_over_clips


class Column(NamedTuple):
    """A column of the summary table."""

    title: str
    unit: str
    digits: int
    high_is_good: bool


COLUMNS = (
    Column("PSNR", "dB", 2, True),
    Column("PSNR P5", "dB", 2, True),
    Column("SSIM", "", 4, True),
    Column("MAE", "levels", 2, False),
    Column("MSE", "levels²", 1, False),
    Column("Time", "s a frame", 3, False),
    Column("CPU time", "s a frame", 3, False),
)


class Cell(NamedTuple):
    """A number as a table shows it, and whether none in its column is better."""

    text: str
    value: float | None
    best: bool


class Row(NamedTuple):
    """A method in a table."""

    method: int
    name: str
    cells: list[Cell]


def overall_rows(comparison: Comparison) -> list[Row]:
    """Return quality and cost of every method, the best first."""
    figures = []
    for method in comparison.methods:
        scores = comparison.means(method)
        low = comparison.low_psnr(method)
        figures.append([scores.psnr, low, scores.ssim, scores.mae, scores.mse, *comparison.mean_seconds(method)])
    rows = _rows(comparison.methods, figures, [(each.digits, each.high_is_good) for each in COLUMNS])
    return [rows[index] for index in sorted(range(len(rows)), key=lambda index: -figures[index][0])]


def mean_rows(comparisons: Sequence[Comparison]) -> list[Row]:
    """Return the PSNR of every method on every clip, and its mean over the clips, which are of equal weight."""
    figures = [[mean, *of_clips] for _, mean, of_clips in means_over_clips(comparisons)]
    rows = _rows(comparisons[0].methods, figures, [(2, True)] * (1 + len(comparisons)))
    return sorted(rows, key=lambda row: -figures[row.method][0])


def area_rows(comparison: Comparison) -> list[Row]:
    """Return errors in and out of each area, in the order of `overall_rows`."""
    figures = [
        [comparison.mean_error(method, area, inside) for area, _ in comparison.areas for inside in (True, False)]
        for method in comparison.methods
    ]
    rows = _rows(comparison.methods, figures, [(2, False)] * (2 * len(comparison.areas)))
    return [rows[row.method] for row in overall_rows(comparison)]


def further_rows(comparison: Comparison) -> list[Row]:
    """Return the further metrics, in the order of `overall_rows`."""
    values = [[*comparison.further(method).values()] for method in comparison.methods]
    formats = [(metrics[name].digits, metrics[name].high_is_good) for name in comparison.metrics]
    rows = _rows(comparison.methods, values, formats)
    return [rows[row.method] for row in overall_rows(comparison)]


def _rows(
    methods: Sequence[MethodResult], figures: Sequence[Sequence[float]], formats: Sequence[tuple[int, bool]]
) -> list[Row]:
    columns = [
        _cells(values, digits, high_is_good)
        for values, (digits, high_is_good) in zip(zip(*figures, strict=True), formats, strict=True)
    ]
    return [Row(index, method.name, [column[index] for column in columns]) for index, method in enumerate(methods)]


def _cells(values: Sequence[float], digits: int, high_is_good: bool) -> list[Cell]:
    """Return the cells; what reads the same as the best is the best too, and a lone value is no best."""
    finite = [value for value in values if math.isfinite(value)]
    digits += _more_digits(finite, digits)
    best = f"{max(finite) if high_is_good else min(finite):.{digits}f}" if len(finite) > 1 else None
    texts = [f"{value:.{digits}f}" if math.isfinite(value) else None for value in values]
    return [
        Cell("-", None, False) if text is None else Cell(text, value, text == best)
        for text, value in zip(texts, values, strict=True)
    ]


def _more_digits(values: Sequence[float], digits: int) -> int:
    """Return how many more digits, up to two, keep the smallest value from being a row of zeros."""
    smallest = min((abs(value) for value in values if value), default=1)
    return next((more for more in (0, 1) if smallest >= 2 * 10.0 ** -(digits + more)), 2)
