"""Scores of constructed differences, which follow by hand, and of the rendered scenes, which nothing may lower."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from fpsboost import InputError, find_method
from fpsboost.colour import composite_on_black
from fpsboost.evaluation.compared_methods import ComparedInterpolator
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.evaluation.results import Scores, absolute_error, mean, means, score
from support.truth import SCENES, needs_scenes, noise


def test_equal_images_have_the_best_scores():
    """No error, the largest PSNR there is, and a structural similarity of 1."""
    image = noise(9, 12)
    assert score(image, image) == Scores(pytest.approx(0, abs=1e-6), 120, pytest.approx(1), 0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_structural_similarity_of_flat_images_is_that_of_their_luminance(dtype):
    """(2 a b + C) / (a a + b b + C) with C = 0.01 squared, for white = 1."""
    white = 1 if dtype == np.float32 else np.iinfo(dtype).max
    a, b = 0.2, 0.6
    truth, made = (np.full((9, 12, 3), level * white, dtype) for level in (a, b))
    expected = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
    assert score(truth, made).ssim == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("dtype", "step"), [(np.uint8, 2), (np.uint16, 514), (np.float32, 2 / 255)])
def test_scores_do_not_depend_on_the_type_of_the_image(dtype, step):
    """Two levels of 255 off everywhere: an MAE of 2, an MSE of 4, and the PSNR of that."""
    truth = np.full((8, 8, 3), 100 * step, dtype)
    scores = score(truth, truth + dtype(step))
    assert scores.mae == pytest.approx(2, rel=1e-5)
    assert scores.mse == pytest.approx(4, rel=1e-5)
    assert scores.psnr == pytest.approx(10 * math.log10(255**2 / 4), rel=1e-5)


@pytest.mark.parametrize("channels", [2, 4])
def test_colours_that_cannot_be_seen_do_not_count(channels):
    """Where alpha is 0 any two colours are alike; where it is half, differences count half."""
    truth = noise(8, 8, channels).copy()
    truth[..., -1] = 0
    made = truth.copy()
    made[..., :-1] += 7
    assert score(truth, made).mae == 0
    values = np.array([[[100] * (channels - 1) + [51]]], np.uint8)
    np.testing.assert_allclose(composite_on_black(values)[0, 0], [100 / 255 / 5] * (channels - 1) + [0.2], rtol=1e-6)


def test_the_error_of_each_pixel_is_the_mean_over_its_channels():
    """In levels of 255."""
    truth, made = np.zeros((2, 3, 3), np.uint8), np.zeros((2, 3, 3), np.uint8)
    made[1, 2] = 3, 6, 0
    error = absolute_error(truth, made)
    assert error[1, 2] == pytest.approx(3)
    assert error.sum() == pytest.approx(3)


def test_frames_smaller_than_the_window_are_refused():
    """In one sentence, with their size."""
    with pytest.raises(InputError, match="Frames of 6x9 are too small"):
        score(np.zeros((9, 6, 1), np.uint8), np.zeros((9, 6, 1), np.uint8))


def test_means_leave_out_what_is_no_number():
    """And are none themselves where there is no number at all."""
    assert mean([1.0, math.nan, 3.0]) == 2
    assert math.isnan(mean([math.nan]))
    assert means([{"a": 1.0, "b": math.nan}, {"a": 2.0, "b": 4.0}]) == {"a": 1.5, "b": 4.0}


GOLDEN = json.loads(Path(__file__).with_name("golden_scores.json").read_text())
"""Mean PSNR in dB, by method and scene; to be raised with the change that earns it."""

HIDING = HoldOut(first=8, last=15, duplicates="keep")
LOSS = 0.05  # dB, more than processors and libraries differ by


@needs_scenes
@pytest.mark.parametrize("scene", GOLDEN["nlm"])
@pytest.mark.parametrize("method", GOLDEN)
def test_no_quality_is_lost(method, scene):
    """Hidden frames of a rendered scene are in the mean made as well as they were, to a twentieth of a decibel."""
    path = str(SCENES / scene / "####.png")
    truths = [hidden.truth for interval in HIDING.intervals(path) for hidden in interval.hidden]
    made = ComparedInterpolator(find_method(method)).interpolate(HIDING.intervals(path))
    psnr = [score(truth, each.image).psnr for truth, each in zip(truths, made, strict=True)]
    assert mean(psnr) >= GOLDEN[method][scene] - LOSS
