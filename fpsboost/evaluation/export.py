"""Output of a comparison: rows of tables for the terminal and the page; JSON with everything; CSV by method and frame.

``docs/comparison.md`` describes the files.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.further_metrics import metrics
from fpsboost.evaluation.regions import AREAS, COMPLEMENTS
from fpsboost.evaluation.results import Comparison, MethodResult
from fpsboost.evaluation.verdict import judge, means_over_clips
from fpsboost.io.new_output import write_whole

DATA_VERSION = 1
"""Version of the data. It rises when a name is removed or changes its meaning, and stays when names are added."""


def write_json(path: Path, comparisons: Sequence[Comparison]) -> None:
    """Write all figures as JSON.

    For one clip these are those of `as_json`; for several, ``clips`` is a list of these, and ``mean`` has the means.
    """
    data = [as_json(comparison) for comparison in comparisons]
    means = {each.method: {"psnr": each.mean, "psnr_of_clips": each.of_clips} for each in means_over_clips(comparisons)}
    several = {"version": DATA_VERSION, "clips": data, "mean": means}
    write_whole(path, f"{json.dumps(data[0] if len(data) == 1 else several, indent=1)}\n".encode())


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Return a comparison as plain data: the frames of every method, and their means."""
    plain = {
        "version": DATA_VERSION,
        **asdict(comparison),
        "hiding": comparison.hold_out.as_json(),
        "verdict": asdict(judge(comparison)),
    }
    del plain["hold_out"]  # the data keep the name that they have had
    for row, method in zip(plain["methods"], comparison.methods, strict=True):
        row["mean"] = {
            **asdict(comparison.means(method)),
            "psnr_p5": comparison.low_psnr(method),
            "metrics": comparison.further(method),
            **comparison.mean_seconds(method),
            "inside": {area: comparison.mean_error(method, area) for area in AREAS},
            "outside": {area: comparison.mean_error(method, area, inside=False) for area in AREAS},
        }
    finite: dict[str, Any] = without_nan(plain)
    return finite


def write_csv(path: Path, comparisons: Sequence[Comparison]) -> None:
    """Write a row for each method and frame, below a header; for several clips, the first column is the clip."""
    clips = [{"clip": each.clip} if len(comparisons) > 1 else {} for each in comparisons]
    rows = [clip | row for clip, each in zip(clips, comparisons, strict=True) for row in rows_of(each)]
    text = StringIO(newline="")
    table = csv.DictWriter(text, list(rows[0]))
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue().encode())


def rows_of(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Yield the rows of the table as dictionaries; a cell is empty where there is no number."""
    for method in comparison.methods:
        counted = {frame.number for frame in comparison.counted(method)}
        for frame, t in zip(method.frames, comparison.times, strict=True):
            row = {
                "method": method.name,
                "frame": frame.number,
                "t": t,
                "counted": int(frame.number in counted),
                **{name: getattr(frame.scores, name) for name in ("psnr", "ssim", "mae", "mse")},
                "seconds": frame.seconds,
                "cpu_seconds": frame.cpu_seconds,
                "search_radius": "" if frame.search_radius is None else frame.search_radius,
                **{f"mae_{area}": error for area, error in frame.inside.items()},
                **{f"mae_{COMPLEMENTS[AREAS.index(area)]}": error for area, error in frame.outside.items()},
                **frame.metrics,
            }
            yield {name: "" if isinstance(each, float) and math.isnan(each) else each for name, each in row.items()}


def without_nan(value: Any) -> Any:
    """Return plain data with None for NaN and infinity, which JSON does not have.

    Examples
    --------
    >>> without_nan({"psnr": [30.5, float("nan")]})
    {'psnr': [30.5, None]}
    """
    if isinstance(value, dict):
        return {key: without_nan(each) for key, each in value.items()}
    if isinstance(value, list):
        return [without_nan(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


class Column(NamedTuple):
    """A column of the summary table."""

    title: str
    unit: str
    """Unit of the numbers; empty if they have none."""
    digits: int
    """Decimals of the numbers."""
    high_is_good: bool
    """Whether larger numbers are better."""


COLUMNS = (
    Column("PSNR", "dB", 2, True),
    Column("PSNR P5", "dB", 2, True),
    Column("SSIM", "", 4, True),
    Column("MAE", "levels", 2, False),
    Column("MSE", "levels²", 1, False),
    Column("CPU time", "s a frame", 3, False),
    Column("Wall time", "s a frame", 3, False),
)
"""Columns of the summary table, in its order."""


class Cell(NamedTuple):
    """A number as a table shows it, and whether it is the best of its column."""

    text: str
    value: float | None
    """The number; None if there is none."""
    best: bool


class Row(NamedTuple):
    """A method in a table."""

    method: int
    """Index of the method in the comparison."""
    name: str
    cells: list[Cell]
    """Cells in the order of the columns."""


def overall_rows(comparison: Comparison) -> list[Row]:
    """Return quality and cost of every method, by decreasing PSNR."""
    figures = []
    for method in comparison.methods:
        scores = comparison.means(method)
        quality = scores.psnr, comparison.low_psnr(method), scores.ssim, scores.mae, scores.mse
        figures.append([*quality, *comparison.mean_seconds(method).values()])
    rows = _rows(comparison.methods, figures, [(each.digits, each.high_is_good) for each in COLUMNS])
    return [rows[index] for index in sorted(range(len(rows)), key=lambda index: -figures[index][0])]


def mean_rows(comparisons: Sequence[Comparison]) -> list[Row]:
    """Return the PSNR of every method on every clip, and its mean over the clips, which have equal weights."""
    figures = [[mean, *of_clips] for _, mean, of_clips in means_over_clips(comparisons)]
    rows = _rows(comparisons[0].methods, figures, [(2, True)] * (1 + len(comparisons)))
    return sorted(rows, key=lambda row: -figures[row.method][0])


def area_rows(comparison: Comparison) -> list[Row]:
    """Return errors inside and outside of each area, in the order of `overall_rows`."""
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
    """Return the rows of a table, by its figures and by (decimals, whether high is good) of each column."""
    columns = [
        _cells(values, digits, high_is_good)
        for values, (digits, high_is_good) in zip(zip(*figures, strict=True), formats, strict=True)
    ]
    return [Row(index, method.name, [column[index] for column in columns]) for index, method in enumerate(methods)]


def _cells(values: Sequence[float], digits: int, high_is_good: bool) -> list[Cell]:
    """Return the cells of a column.

    A value that is displayed like the best is marked as best too; a single value is not. Up to two more digits are
    shown if the smallest value would be zero otherwise.
    """
    finite = [value for value in values if math.isfinite(value)]
    smallest = min((abs(value) for value in finite if value), default=1)
    digits += next((more for more in (0, 1) if smallest >= 2 * 10.0 ** -(digits + more)), 2)
    best = f"{max(finite) if high_is_good else min(finite):.{digits}f}" if len(finite) > 1 else None
    texts = [f"{value:.{digits}f}" if math.isfinite(value) else None for value in values]
    return [
        Cell("-", None, False) if text is None else Cell(text, value, text == best)
        for text, value in zip(texts, values, strict=True)
    ]
