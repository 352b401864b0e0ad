"""The verdict: who is ahead by more than chance, at what price, and what to take."""

import json
import math
import re

import numpy as np
import pytest

from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.evaluation.results import Comparison, MethodResult
from fpsboost.evaluation.verdict import difference, judge
from support.comparison_truth import save_clip, scored
from support.video_truth import scene


def comparison(cpu_seconds=None, skip=1, **psnr):
    """Methods with these decibels a frame, each frame at so many CPU seconds."""
    seconds = cpu_seconds or {}
    count = len(next(iter(psnr.values())))
    methods = [
        MethodResult(
            name, "", [scored(2 * k + 1, value, 1.0, seconds.get(name, 1.0)) for k, value in enumerate(values)]
        )
        for name, values in psnr.items()
    ]
    hidden = [2 * k + 1 for k in range(count)]
    return Comparison("clip", "", HoldOut(skip), hidden, [], {}, methods, {}, clip_frames=2 * count + 1)


HARD = np.linspace(25, 35, 12)  # frames that differ by 10 dB, so that the mean of one method shows no lead of 0.2 dB


@pytest.mark.parametrize(
    ("a", "b", "level", "sentences"),
    [
        (HARD, HARD + 0.2 + np.random.default_rng(0).normal(0, 0.05, 12), [], "here, 0.2 dB ahead of a; .*"),
        ([30.0] * 10, [29.9] * 9 + [33.0], ["a"], "here, 0.2 dB ahead of a, which is level; .*"),
        ([30.0], [34.0], ["a"], "on one frame, 4.0 dB ahead of a; .* one frame is no evidence for others[.].*"),
    ],
    ids=["every frame shows it", "one frame decides the mean", "one frame"],
)
def test_a_lead_is_more_than_chance(a, b, level, sentences):
    """Methods are level where the lead may be chance: the standard error is as large, or is not known."""
    verdict = judge(comparison(a=list(a), b=list(b)))
    assert (verdict.best, verdict.level) == ("b", level)
    assert re.fullmatch(f"Take b: best picture {sentences}", " ".join(verdict.sentences))


def test_equal_methods_are_level():
    """Their difference is 0."""
    assert judge(comparison(a=[30.0, 31.0], b=[30.0, 31.0])).level == ["b"]


def test_the_standard_error_is_that_of_paired_differences():
    """Deviation of the differences over the root of their number, where they do not follow each other."""
    one, other = [31.0, 33.0, 31.0, 33.0], [30.0] * 4
    known = difference("other", one, other)
    assert (known.mean, known.standard_error) == (2.0, pytest.approx(np.std([1, 3, 1, 3], ddof=1) / 2))


def test_neighbours_that_resemble_each_other_count_less():
    """Of differences that run in an AR(1) process with 0.8, the error is three times that of independent ones."""
    rng = np.random.default_rng(1)
    differences = [0.0]
    for _ in range(4000):
        differences.append(0.8 * differences[-1] + rng.normal())
    known = difference("other", differences, [0.0] * len(differences))
    plain = np.std(differences, ddof=1) / math.sqrt(len(differences))
    assert known.standard_error / plain == pytest.approx(3, rel=0.1)
    assert abs(known.mean) < 3 * known.standard_error


def test_the_cheapest_that_is_about_as_good_is_recommended():
    """Within 0.3 dB of the best by the mean, with what either costs for the whole clip, not for a frame."""
    psnr = {"best": [36.0, 37.0] * 5, "fast": [35.75, 36.75] * 5, "rough": [35.5, 36.7] * 5}
    verdict = judge(comparison({"best": 2.0, "fast": 0.5, "rough": 0.1}, **psnr))
    assert (verdict.best, verdict.cheapest) == ("best", "fast")
    assert verdict.cpu_seconds == {"best": 40.0, "fast": 10.0, "rough": 2.0}
    assert verdict.sentences[2] == "Doubling these 21 frames takes best 40 s and fast 10 s of CPU time."
    assert judge(comparison({"best": 0.2}, **psnr)).cheapest == "best"


SHAKY, FIRM = [0.5, -0.5] * 20, [0.01, -0.01] * 20  # deviations of forty frames that leave a lead unknown, and known


@pytest.mark.parametrize(
    ("behind", "cpu_seconds", "advice"),
    [
        (
            {"dis": (0.1, SHAKY), "nlm-fast": (0.28, FIRM), "blend": (5, FIRM)},
            {"nlm": 1.0, "dis": 1.2, "nlm-fast": 0.5, "blend": 0.01},
            "0.1 dB ahead of dis, which is level; nlm-fast is 0.3 dB behind at half the time.",
        ),
        (
            {"dis": (0.1, SHAKY)},
            {"nlm": 1.0, "dis": 0.21},
            "0.1 dB ahead of dis, which is level; dis takes a fifth of the time.",
        ),
        (
            {"dis": (0.02, SHAKY), "block": (0.14, SHAKY)},
            {"nlm": 1.0, "dis": 0.97, "block": 9.0},
            "up to 0.1 dB ahead of dis and block, which are level; dis takes about the same time.",
        ),
        ({"dis": (0.6, FIRM)}, {"nlm": 1.0, "dis": 0.5}, "0.6 dB ahead of dis; nothing cheaper comes within 0.3 dB."),
        ({"dis": (0.6, FIRM)}, {"nlm": 1.0, "dis": 1.5}, "0.6 dB ahead of dis; nothing is cheaper."),
        ({"dis": (0.6, FIRM)}, {"nlm": math.nan, "dis": 1.5}, "0.6 dB ahead of dis."),
        ({"dis": (0.2, FIRM)}, {"nlm": math.nan, "dis": 1.5}, "0.2 dB ahead of dis; dis takes the least known time."),
    ],
)
def test_first_sentence_says_what_to_take_and_why(behind, cpu_seconds, advice):
    """The best, who is level with it, and what is about as good for less time; errors come after it."""
    psnr = {name: list(34 - lead + np.array(shaky)) for name, (lead, shaky) in behind.items()}
    verdict = judge(comparison(cpu_seconds, nlm=[34.0] * 40, **psnr))
    assert verdict.sentences[0] == f"Take nlm: best picture here, {advice}"
    assert "±" in verdict.sentences[1]


def test_hiding_more_prices_more():
    """Two of three hidden: the price is that of three frames for one."""
    verdict = judge(comparison({"a": 1.0}, skip=2, a=[30.0, 31.0]))
    assert (verdict.factor, verdict.cpu_seconds["a"]) == (3, 8.0)
    assert verdict.sentences == [
        "a reaches 30.5 dB over 2 frames.",
        "Making 3 of each of these 5 frames takes a 8.0 s of CPU time.",
    ]


def test_terminal_data_and_page_say_the_same(fpsboost_, tmp_path):
    """Word for word, and what the data say can be computed from their own frames."""
    folder = save_clip(tmp_path / "clip", (scene(number * (number + 3) // 3) for number in range(9)))
    result = fpsboost_("compare", folder, "-m", "dis,blend", "--json", "figures.json", "--report", "page")
    assert result.code == 0
    figures = json.loads((tmp_path / "figures.json").read_text())
    first, *others = figures["verdict"]["sentences"]
    assert result.out.splitlines()[0] == first
    assert " ".join(others) in " ".join(result.out.split())
    page = (tmp_path / "page" / "index.html").read_text()
    assert f'<p class="outcome">{first}</p>' in page
    assert f'<p class="advice">{" ".join([first, *others])}</p>' in page
    dis, blend = ([frame["scores"]["psnr"] for frame in method["frames"]] for method in figures["methods"])
    (ahead,) = figures["verdict"]["ahead"]
    assert ahead["mean"] == pytest.approx(np.mean(np.subtract(dis, blend)))
