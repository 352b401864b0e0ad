"""A comparison as files for other programs: JSON with everything, CSV with a row for each method and frame.

What stands in them is told in ``docs/comparison.md``.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fpsboost.evaluation.compare import Comparison
from fpsboost.evaluation.regions import NAMES, OUTSIDES
from fpsboost.evaluation.writing import appearing


def write_json(path: Path, comparison: Comparison) -> None:
    """Write all figures; the file appears whole or not at all.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with appearing(path) as unfinished:
        unfinished.write_text(json.dumps(comparison.as_json(), indent=1) + "\n", encoding="utf-8")


def write_csv(path: Path, comparison: Comparison) -> None:
    """Write a row for each method and frame, under plain headings; the file appears whole or not at all.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    rows = list(rows_of(comparison))
    with appearing(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def rows_of(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """The rows of the table; a cell is empty where there is no number."""
    for method in comparison.methods:
        counted = {frame.number for frame in comparison.counted(method)}
        for frame, t in zip(method.frames, comparison.times, strict=True):
            scores = frame.scores
            row = {
                "method": method.name,
                "frame": frame.number,
                "t": t,
                "counted": int(frame.number in counted),
                "psnr": scores.psnr,
                "ssim": scores.ssim,
                "mae": scores.mae,
                "mse": scores.mse,
                "seconds": frame.seconds,
                "cpu_seconds": frame.cpu_seconds,
                "search_radius": "" if frame.search_radius is None else frame.search_radius,
                **{f"mae_{area}": error for area, error in frame.inside.items()},
                **{f"mae_{OUTSIDES[NAMES.index(area)]}": error for area, error in frame.outside.items()},
                **frame.metrics,
            }
            yield {name: "" if isinstance(each, float) and math.isnan(each) else each for name, each in row.items()}
