"""A comparison of a tiny clip, and its page."""

from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from fpsboost import DecodeOptions
from fpsboost.evaluation.compare import compare
from fpsboost.evaluation.compared_methods import ComparedInterpolator
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.evaluation.report.page import write_report
from fpsboost.evaluation.results import ComparedClip
from fpsboost.method_table import methods
from support.comparison_truth import HEIGHT, NAMES, WIDTH, Nobody, save_clip
from support.video_truth import scene


@pytest.fixture(scope="session")
def compared_methods():
    return {name: ComparedInterpolator(methods[name]) for name in NAMES}


@pytest.fixture(scope="session")
def comparison(tmp_path_factory, compared_methods):
    """Of a clip that speeds up, so that no two frames are equally hard."""
    images = (scene(number * (number + 3) // 3, HEIGHT, WIDTH) for number in range(7))
    clip = save_clip(tmp_path_factory.mktemp("clip"), images)
    return compare(clip, compared_methods, HoldOut(), Nobody(), skipped={"minterpolate": "there is no <ffmpeg> here"})


@pytest.fixture(scope="session")
def report_path(comparison, compared_methods, tmp_path_factory):
    return write_report(tmp_path_factory.mktemp("report") / "page", [ComparedClip(comparison, compared_methods)])


@pytest.fixture(scope="session")
def guided(tmp_path_factory, comparison):
    """The same clip, with guides of half the size for all but frame 3, by a method with and without them."""
    folder = tmp_path_factory.mktemp("guide")
    for path in sorted(Path(comparison.clip).iterdir()):
        if path.stem != "0003":
            small = cv2.resize(cv2.imread(str(path)), (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(folder / path.name), small)
    plain = ComparedInterpolator(methods["blend"])
    compared_methods = {"blend": plain, "blend+guide": replace(plain, follows_guides=True)}
    hold_out = HoldOut(decoding=DecodeOptions(guide=str(folder)))
    return ComparedClip(compare(comparison.clip, compared_methods, hold_out, Nobody()), compared_methods)


@pytest.fixture(scope="session")
def several_path(comparison, compared_methods, tmp_path_factory):
    """A page of two clips, of which the second is the first one's end."""
    other = compare(comparison.clip, compared_methods, HoldOut(first=4), Nobody())
    clips = [ComparedClip(each, compared_methods) for each in (comparison, other)]
    return write_report(tmp_path_factory.mktemp("report") / "page", clips)
