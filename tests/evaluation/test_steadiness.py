"""Metrics of what is seen at speed: constructed differences whose figures follow by hand."""

import cv2
import numpy as np
import pytest

from fpsboost.evaluation.steadiness import (
    DivergenceMeter,
    FlickerMeter,
    StepMeter,
    missing_edges,
    spurious_edges,
    wrong_area,
)
from support.comparison_truth import pan
from support.truth import noise


def measured(meter, truths, images):
    """The values of a meter that is shown the first and the last, and every frame beyond the images."""
    for number, truth in enumerate(truths):
        meter.add(truth, images.get(number, truth), counts=number in images)
    return meter.values()


@pytest.mark.parametrize(
    ("levels", "dtype", "share"), [(24, np.uint8, 0), (25, np.uint8, 62.5), (6500, np.uint16, 62.5)]
)
def test_wrong_area_is_a_share_of_the_picture(levels, dtype, share):
    """A sixteenth of the picture counts from 25 levels on; single pixels do not."""
    truth = np.full((64, 64, 3), 100, dtype) * (np.iinfo(dtype).max // 255)
    image = truth.copy()
    image[16:32, 16:32, 1] += dtype(levels)
    image[40::8, 40::8] = 0
    assert wrong_area(truth, image) == share


@pytest.mark.parametrize(("move", "counts"), [(8, False), (24, True)])
def test_edges_without_a_counterpart_count(move, counts):
    """A bar that is too much, and one that is lacking, by as much; one that is a few pixels off is neither."""
    truth, image = np.zeros((2, 64, 96, 3), np.uint8)
    truth[:, 32:40] = 200
    image[:, 32 + move : 40 + move] = 200
    assert (spurious_edges(truth, image) > 0, missing_edges(truth, image) > 0) == (counts, counts)
    nothing = np.zeros_like(truth)
    assert missing_edges(truth, nothing) == spurious_edges(nothing, truth) > 100
    assert spurious_edges(truth, nothing) == 0


@pytest.mark.parametrize(
    ("changes", "flicker"), [((3, 3), [3, 3]), ((4, 2), [4, 2]), ((3, -3), None), ((0, 0), [0, 0])]
)
def test_what_differs_in_all_frames_alike_pulses(changes, flicker):
    """Interpolated frames that are brighter, by their mean; where one is brighter and one darker, nothing is left."""
    images = {2 * place + 1: np.full((40, 56, 3), 90 + change, np.uint8) for place, change in enumerate(changes)}
    values = measured(FlickerMeter(), [np.full((40, 56, 3), 90, np.uint8)] * 5, images)
    assert np.mean(values) == pytest.approx(np.mean(flicker or 0), abs=1e-4)
    assert flicker is None or values == pytest.approx(flicker, abs=1e-4)


def test_softer_frames_pulse_and_other_noise_does_not():
    """Noise of its own in every frame is steady, and frames without their noise, or blurred, are not."""
    grainy = [noise(96, 128, 3, seed=seed) for seed in range(9)]
    others, soft = ({place: change(grainy[place]) for place in (1, 3, 5, 7)} for change in (np.flipud, blurred))
    steady, noiseless = (np.mean(measured(FlickerMeter(), grainy, images)) for images in (others, soft))
    assert steady < 0.1 * noiseless


def blurred(image):
    """An image without most of its noise."""
    return cv2.GaussianBlur(image, (0, 0), 1)


@pytest.mark.parametrize(
    ("places", "uneven"), [((2, 4, 6), (0, 0, 0)), ((0, 0, 0), (0, 0, 100)), ((2.5, 4, 6), (25, 12.5, 0))]
)
def test_steps_are_compared_with_the_true_ones(places, uneven):
    """Frames in the places of the truth are even; one that lags, and repeats, are uneven by what their steps change."""
    truths = [pan(2 * number, height=96, width=128) for number in range(5)]
    images = {number: pan(place, height=96, width=128) for number, place in enumerate(places, 1)}
    assert measured(StepMeter(), truths, images) == pytest.approx(uneven, abs=2.5)


def test_nothing_moves_evenly():
    """Where nothing moves there are no steps to compare."""
    assert measured(StepMeter(), [pan(0)] * 3, {1: pan(1)}) == [0]


def test_errors_count_where_the_motion_of_the_output_diverges():
    """Without motion all pixels count, equal frames have 120 dB, and a torn frame has less than its PSNR."""
    still, truths = np.full((64, 96, 3), 100, np.uint8), [pan(3 * number, height=96, width=128) for number in range(3)]
    changed = {1: still}, {1: still + np.uint8(10)}
    assert [measured(DivergenceMeter(), [still] * 3, images)[0] for images in changed] == pytest.approx(
        [120, 28.13], abs=0.01
    )
    torn = truths[1].copy()
    torn[32:64, 48:80] = truths[1][32:64, 56:88]
    assert measured(DivergenceMeter(), truths, {1: torn})[0] < cv2.PSNR(truths[1], torn) - 1
