"""Output of a comparison: rows of tables for the terminal and the page; JSON with everything; CSV by method and frame.

``docs/comparison.md`` describes the files.
"""

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fpsboost.evaluation.further_metrics import STANDARD, choose_metrics
from fpsboost.evaluation.regions import AREAS
from fpsboost.evaluation.results import Column, Comparison, mean
from fpsboost.evaluation.verdict import judge, psnr_of_clips
from fpsboost.io.new_output import write_whole

DATA_VERSION = 1
"""Version of the data. It rises when a name is removed or changes its meaning, and stays when names are added."""


def write_json(path: Path, comparisons: Sequence[Comparison]) -> None:
    """Write all figures as JSON.

    For one clip these are those of `as_json`; for several, ``clips`` is a list of these, and ``mean`` has the means.
    """
    data = [as_json(comparison) for comparison in comparisons]
    means = {
        name: {"psnr": mean(of_clips), "psnr_of_clips": of_clips}
        for name, of_clips in psnr_of_clips(comparisons).items()
    }
    several = {"version": DATA_VERSION, "clips": data, "mean": means}
    write_whole(path, f"{json.dumps(data[0] if len(data) == 1 else several, indent=1)}\n".encode())


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Return a comparison as plain data: the frames of every method, and their means."""
    plain = {
        "version": DATA_VERSION,
        **asdict(replace(comparison, metrics={})),
        "metrics": list(comparison.metrics),
        "hiding": comparison.hold_out.as_json(),
        "verdict": asdict(judge(comparison)),
    }
    del plain["hold_out"]  # the data keep the name that they have had
    for row, method in zip(plain["methods"], comparison.methods, strict=True):
        row["mean"] = {
            **comparison.means(method),
            "metrics": comparison.further(method),
            "inside": {area: comparison.mean_error(method, area) for area in AREAS},
            "outside": {area: comparison.mean_error(method, area, inside=False) for area in AREAS},
        }
    return dict(without_nan(plain))


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
    """Yield the rows of the table as dictionaries, with None where there is no number: an empty cell."""
    for method in comparison.methods:
        counted = {frame.number for frame in comparison.counted(method)}
        for frame, t in zip(method.frames, comparison.times, strict=True):
            yield without_nan(
                {
                    "method": method.name,
                    "frame": frame.number,
                    "t": t,
                    "counted": int(frame.number in counted),
                    **{name: getattr(frame.scores, name) for name in ("psnr", "ssim", "mae", "mse")},
                    "seconds": frame.seconds,
                    "cpu_seconds": frame.cpu_seconds,
                    "search_radius": frame.search_radius,
                    **{f"mae_{area}": error for area, error in frame.inside.items()},
                    **{f"mae_{AREAS[area]}": error for area, error in frame.outside.items()},
                    **frame.metrics,
                }
            )


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


COLUMNS = {
    "psnr": Column("PSNR", "dB", 2, True, "PSNR is the mean of decibels over frames, higher is better."),
    "psnr_p5": Column("PSNR P5", "dB", 2, True, "PSNR P5 is their 5th percentile, which 95 % of the frames reach."),
    "ssim": Column("SSIM", "", 4, True, "SSIM is the structural similarity of Wang et al. (2004), 1 is equal."),
    "mae": Column(
        "MAE",
        "levels",
        2,
        False,
        "MAE is the mean absolute error over pixels and colours, in levels of 255, whatever the depth of the clip.",
    ),
    **choose_metrics(STANDARD),
    "cpu_seconds": Column(
        "CPU time",
        "s a frame",
        3,
        False,
        "CPU time is that of computing a frame on all cores, without reading and writing.",
    ),
    "seconds": Column("Wall time", "s a frame", 3, False, "Wall time is the time that passes meanwhile."),
}
"""Columns of the summary table in its order, by the names of `Comparison.means` and of the metrics."""


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


def named_rows(comparison: Comparison, columns: Mapping[str, Column] = COLUMNS) -> list[Row]:
    """Return the rows of a table of quality and cost, in columns by the names of figures and metrics."""
    means = [comparison.means(method) | comparison.further(method) for method in comparison.methods]
    return _ranked_rows(comparison, list(columns.values()), [[each[name] for name in columns] for each in means])


def area_rows(comparison: Comparison) -> list[Row]:
    """Return errors inside and outside of each area."""
    figures = [
        [comparison.mean_error(method, area, inside) for area, _ in comparison.areas for inside in (True, False)]
        for method in comparison.methods
    ]
    return _ranked_rows(comparison, [COLUMNS["mae"]] * (2 * len(comparison.areas)), figures)


def further_columns(comparison: Comparison) -> dict[str, Column]:
    """Return the metrics by name that were asked for beside those of the summary table."""
    return {name: column for name, column in comparison.metrics.items() if name not in COLUMNS}


def mean_rows(comparisons: Sequence[Comparison]) -> list[Row]:
    """Return the PSNR of every method on every clip, and its mean over the clips, which have equal weights."""
    psnr = psnr_of_clips(comparisons)
    figures = [[mean(of_clips), *of_clips] for of_clips in psnr.values()]
    return _rows(list(psnr), [COLUMNS["psnr"]] * (1 + len(comparisons)), figures, [row[0] for row in figures])


def _ranked_rows(comparison: Comparison, columns: Sequence[Column], figures: Sequence[Sequence[float]]) -> list[Row]:
    """Return the rows of a table about one clip, by decreasing PSNR."""
    psnr = [comparison.means(method)["psnr"] for method in comparison.methods]
    return _rows([method.name for method in comparison.methods], columns, figures, psnr)


def _rows(
    names: Sequence[str], columns: Sequence[Column], figures: Sequence[Sequence[float]], psnr: Sequence[float]
) -> list[Row]:
    """Return the rows of a table, by decreasing PSNR; names, figures and PSNR are by method."""
    cells = [_cells(values, column) for values, column in zip(zip(*figures, strict=True), columns, strict=True)]
    rows = [Row(index, name, [each[index] for each in cells]) for index, name in enumerate(names)]
    return sorted(rows, key=lambda row: -psnr[row.method])


def _cells(values: Sequence[float], column: Column) -> list[Cell]:
    """Return the cells of a column.

    A value that is displayed like the best is marked as best too; a single value is not. Up to two more digits are
    shown if the smallest value would be zero otherwise.
    """
    finite = [value for value in values if math.isfinite(value)]
    smallest = min((abs(value) for value in finite if value), default=1)
    digits = next((more for more in (0, 1) if smallest >= 2 * 10.0 ** -(column.digits + more)), 2) + column.digits
    best = f"{max(finite) if column.high_is_good else min(finite):.{digits}f}" if len(finite) > 1 else None
    texts = [f"{value:.{digits}f}" if math.isfinite(value) else None for value in values]
    return [
        Cell("-", None, False) if text is None else Cell(text, value, text == best)
        for text, value in zip(texts, values, strict=True)
    ]
