"""A comparison as files for other programs: JSON with everything, CSV with a row for each method and frame.

``docs/comparison.md`` describes both.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from fpsboost.evaluation.regions import AREAS, COMPLEMENTS
from fpsboost.evaluation.results import Comparison
from fpsboost.evaluation.verdict import judge, means_over_clips
from fpsboost.io.new_output import write_whole

DATA_VERSION = 1
"""Version of the data, which rises where a name goes or changes its meaning, and stays where names are added."""


def write_json(path: Path, comparisons: Sequence[Comparison]) -> None:
    """Write all figures: of one clip those of `as_json`; of several ``clips``, a list of these, and their ``mean``."""
    data = [as_json(comparison) for comparison in comparisons]
    means = {each.method: {"psnr": each.mean, "psnr_of_clips": each.of_clips} for each in means_over_clips(comparisons)}
    several = {"version": DATA_VERSION, "clips": data, "mean": means}
    write_whole(path, f"{json.dumps(data[0] if len(data) == 1 else several, indent=1)}\n".encode())


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Return a comparison as plain data: the frames of every method, and their means."""
    plain = {
        "version": DATA_VERSION,
        **asdict(comparison),
        "hiding": comparison.hiding.as_json(),
        "verdict": asdict(judge(comparison)),
    }
    for row, method in zip(plain["methods"], comparison.methods, strict=True):
        seconds, cpu_seconds = comparison.mean_seconds(method)
        row["mean"] = {
            **asdict(comparison.means(method)),
            "psnr_p5": comparison.low_psnr(method),
            "metrics": comparison.further(method),
            "seconds": seconds,
            "cpu_seconds": cpu_seconds,
            "inside": {area: comparison.mean_error(method, area) for area in AREAS},
            "outside": {area: comparison.mean_error(method, area, inside=False) for area in AREAS},
        }
    finite: dict[str, Any] = _without_nan(plain)
    return finite


def write_csv(path: Path, comparisons: Sequence[Comparison]) -> None:
    """Write a row for each method and frame, under plain headings; of several clips the first column is the clip."""
    rows = [row for each in comparisons for row in rows_of(each)]
    if len(comparisons) > 1:
        rows = [{"clip": each.clip, **row} for each in comparisons for row in rows_of(each)]
    text = StringIO(newline="")
    table = csv.DictWriter(text, list(rows[0]))
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue().encode())


def rows_of(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Yield the rows of the table; a cell is empty where there is no number."""
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
                **{f"mae_{COMPLEMENTS[AREAS.index(area)]}": error for area, error in frame.outside.items()},
                **frame.metrics,
            }
            yield {name: "" if isinstance(each, float) and math.isnan(each) else each for name, each in row.items()}


def _without_nan(value: Any) -> Any:
    """Return plain data with None for NaN and infinity, for which JSON has no word."""
    if isinstance(value, dict):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
