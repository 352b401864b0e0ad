"""A comparison as JSON and CSV, and the description of both."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from fpsboost.evaluation.export import DATA_VERSION, as_json, write_csv, write_json
from fpsboost.evaluation.further_metrics import metrics
from fpsboost.evaluation.hidden_frames import Hiding
from fpsboost.evaluation.regions import AREAS, COMPLEMENTS
from fpsboost.evaluation.results import Comparison, FrameResult, MethodResult, Scores

DESCRIPTION = (Path(__file__).parents[2] / "docs" / "comparison.md").read_text(encoding="utf-8")


@pytest.fixture
def comparison():
    """Two methods on three frames, the last of which does not count; of one method nobody knows the time."""

    def frame(number, seconds):
        areas = dict.fromkeys(AREAS, 2.0), dict.fromkeys(AREAS, np.nan)
        radius = None if np.isnan(seconds) else 15
        further = dict.fromkeys(metrics, 1.0)
        return FrameResult(number, Scores(4.0, 42.1, 0.9, 1.5), seconds, seconds, *areas, radius, further)

    methods = [
        MethodResult("nlm:v=0.1,patch-radius=4", "options", [frame(number, 0.5) for number in (1, 3, 5)]),
        MethodResult("other, tool", "images", [frame(number, np.nan) for number in (1, 3, 5)]),
    ]
    shares = dict.fromkeys(AREAS, 0.3)
    more = {"times": [0.5, 0.25, 0.5], "clip_frames": 7, "metrics": tuple(metrics)}
    return Comparison("clip", "8x8", Hiding(), [1, 3, 5], [5], shares, methods, {}, **more)


def names_in(value):
    """Every name of plain data, however deep."""
    if isinstance(value, dict):
        return set(value).union(*map(names_in, value.values()))
    return set().union(*map(names_in, value)) if isinstance(value, list) else set()


def test_every_name_in_the_data_is_described(comparison):
    """The version too; names of methods and programs are data themselves."""
    data = as_json(comparison)
    assert data["version"] == DATA_VERSION
    assert f"`version` is {DATA_VERSION};" in DESCRIPTION
    described = set(re.findall(r"[\w-]+", " ".join(re.findall(r"`([^`\n]+)`", DESCRIPTION.replace("```", "")))))
    data["verdict"]["cpu_seconds"] = data["made_with"] = data["skipped"] = {}
    assert names_in(data) <= described


def test_the_data_are_json_for_everyone(comparison, tmp_path):
    """No NaN, which JSON has not: what nobody knows is null."""
    write_json(tmp_path / "x.json", [comparison])
    text = (tmp_path / "x.json").read_text()
    data = json.loads(text, parse_constant=pytest.fail)
    assert data["methods"][1]["mean"]["seconds"] is None
    assert data["methods"][1]["frames"][0]["cpu_seconds"] is None
    assert data["verdict"]["cheapest"] == "nlm:v=0.1,patch-radius=4"


def test_the_table_has_a_row_for_each_method_and_frame(comparison, tmp_path):
    """Plain headings, each described; names with commas survive; what nobody knows is an empty cell."""
    write_csv(tmp_path / "x.csv", [comparison])
    with (tmp_path / "x.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["frame"]) for row in rows] == [
        (name, number) for name in ("nlm:v=0.1,patch-radius=4", "other, tool") for number in ("1", "3", "5")
    ]
    assert [row["counted"] for row in rows[:3]] == ["1", "1", "0"]
    assert (rows[1]["t"], rows[1]["psnr"], rows[1]["seconds"]) == ("0.25", "42.1", "0.5")
    assert (rows[3]["seconds"], rows[3]["mae_still"]) == ("", "")
    assert (rows[1]["search_radius"], rows[3]["search_radius"]) == ("15", "")
    assert set(rows[0]) >= {f"mae_{name}" for name in (*AREAS, *COMPLEMENTS)}
    assert rows[0]["xpsnr"] == "1.0"
    for name in rows[0]:
        assert f"`{name}`" in DESCRIPTION
