"""Colours, marks and lines that stand for methods."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

from fpsboost.cli.options import ContestOptions
from fpsboost.evaluation.contestants import method_names
from fpsboost.evaluation.report.styles import (
    DASH_DOTTED,
    DASHED,
    MAX_LINE,
    NAMED,
    SOLID,
    break_name,
    colours_of,
    styles_of,
)

MANY = [f"nlm-exhaustive:patch-radius={r},v={v}" for r in range(1, 13) for v in (0.05, 0.1, 0.2)] + [
    "rife",
    "film",
    "flow",
]

# Machado et al. 2009 (doi:10.1109/TVCG.2009.113), complete loss, on linear light
LOSSES = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(colour):
    values = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def seen(colour, loss):
    """CIELAB of a colour as someone with this loss sees it."""
    rgb = (np.array(LOSSES[loss]) @ linear(colour)).clip(0, 1)
    rgb = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    return cv2.cvtColor(rgb[np.newaxis, np.newaxis].astype(np.float32), cv2.COLOR_RGB2Lab)[0, 0]


def test_a_method_keeps_its_colour_in_every_company():
    """The same alone, first or last, among few or many; options in another order are the same method."""
    for name in [*method_names(), *MANY]:
        alone = styles_of([name])[0]
        beside = styles_of(["blend", *MANY, *method_names(), name])[-1]
        assert (beside.on_light, beside.on_dark, beside.line) == (alone.on_light, alone.on_dark, alone.line)
    assert colours_of("nlm:v=0.1,patch-radius=3") == colours_of("nlm:patch-radius=3,v=0.1")


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("paper", [0, 1])
def test_the_usual_methods_are_told_apart_with_any_colour_vision(loss, paper):
    """A distance in CIELAB of 25 between any two of those that are compared by default, and of 15 among the others."""
    for names, least in ((ContestOptions().methods[0].split(","), 25), (NAMED, 15)):
        for one, other in itertools.combinations(names, 2):
            distance = np.linalg.norm(seen(colours_of(one)[paper], loss) - seen(colours_of(other)[paper], loss))
            assert distance > least, (one, other)


def test_colours_stand_out_from_the_paper():
    """A contrast of 3 to 1 on light and on dark paper, as WCAG wants of figures."""
    papers = [np.dot(linear(each), [0.2126, 0.7152, 0.0722]) for each in ("#fcfcfb", "#15171a")]
    for name in [*method_names(), *MANY]:
        for colour, paper in zip(colours_of(name), papers, strict=True):
            light = np.dot(linear(colour), [0.2126, 0.7152, 0.0722])
            assert (max(light, paper) + 0.05) / (min(light, paper) + 0.05) > 2.9, (name, colour)


def test_nine_methods_have_nine_marks():
    """Whoever they are, and solid lines are methods as they are, dashed ones have options, others are dotted, too."""
    for names in (method_names()[:9], MANY[:9], [*MANY[-3:], "nlm", "dis", "nlm:v=1", "dis-warp", "block", "blend"]):
        assert len({style.mark for style in styles_of(names)}) == 9
    assert [style.line for style in styles_of(["nlm", "nlm:v=1", "rife"])] == [SOLID, DASHED, DASH_DOTTED]


def test_method_names_differ():
    """No two of them have the same colour and the same mark."""
    names = method_names()
    styles = [styles_of([name])[0] for name in names]
    assert len({(style.on_light, style.mark) for style in styles}) == len(names)


def test_long_names_are_broken_behind_their_punctuation():
    """Nothing is lost, and lines are short where they can be."""
    for name in MANY:
        lines = break_name(name)
        assert "".join(lines) == name
        assert all(len(line) <= MAX_LINE for line in lines)
    assert break_name("a-very-long-name-without-punctuation") == ["a-very-long-name-without-punctuation"]
