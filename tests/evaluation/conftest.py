"""A comparison of a tiny clip, and its page."""

import pytest

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
def several_path(comparison, compared_methods, tmp_path_factory):
    """A page of two clips, of which the second is the first one's end."""
    other = compare(comparison.clip, compared_methods, HoldOut(first=4), Nobody())
    clips = [ComparedClip(each, compared_methods) for each in (comparison, other)]
    return write_report(tmp_path_factory.mktemp("report") / "page", clips)
