"""The weighted mean over candidate motions, against a slow twin, and its parts."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fpsboost.kernels.candidates import Candidates
from fpsboost.kernels.constants import MARGIN, SPARE, VALUES_PER_MOTION, WINDOW, WINDOW_BLOCK
from fpsboost.kernels.multi_hypothesis import (
    Blended,
    ValueRange,
    Weighting,
    blend_hypotheses,
    find_dominant_motion,
    window_shape,
)
from fpsboost.kernels.window_samples import PlaneGroup, Samples
from fpsboost.synthesis.fusion_table import fusion_coefficients
from support.planes import points
from support.truth import moved_waves, noise, waves
from support.twins import blended, finished, heaviest, spline_coefficients


def samples(image):
    """Planes and their coefficients, which the twin finds, so that a fault of the filter is not one of blending."""
    planes = image.transpose(2, 0, 1).astype(np.float32, order="C")
    beyond = 2 * SPARE  # the solver knows nothing of what lies farther out
    coefficients = [
        spline_coefficients(plane, MARGIN + beyond)[beyond:-beyond, beyond:-SPARE] for plane in split(image)
    ]
    return Samples(planes, np.array(coefficients, np.float32), np.float32(1))


def listed(candidates, spacing):
    """Lists of ``[weight, dx, dy, ax, ay, *gradients]`` as the kernel's arrays, with room to spare."""
    room = 2 + max(len(each) for each in candidates.ravel())
    count = np.zeros(candidates.shape, np.int32)
    motions = np.full((*candidates.shape, room, VALUES_PER_MOTION), np.nan, np.float32)
    weights = np.full((*candidates.shape, room), np.nan, np.float32)
    for place in np.ndindex(candidates.shape):
        count[place] = len(candidates[place])
        for k, (weight, *motion) in enumerate(candidates[place]):
            weights[place][k], motions[place][k] = weight, [*motion, 0, 0, 0, 0][:VALUES_PER_MOTION]
    return Candidates(count, motions, weights, spacing)


def split(image):
    """An image's channels as planes."""
    return [image[..., c].astype(float) for c in range(image.shape[2])]


def weighting(spacing, scale, sharpness, enough, negligible=0):
    """How candidates are weighed, with the learnt table, which plain weights do not look at."""
    numbers = map(np.float32, (scale, sharpness, enough, negligible))
    return Weighting(*numbers, window_shape(spacing), *fusion_coefficients())


UNLIMITED = ValueRange(*map(np.float32, (1, 0, -1e30, 1e30)), False)


def blend(image0, image1, t, candidates, *, chroma=None, spacing=16, values=UNLIMITED, dtype=np.float32, **options):
    """Call the kernels; the mean as an image, and the confidence; with chroma or layers of both, their mean, too."""
    image = np.full(image0.shape, np.nan if dtype == np.float32 else 77, dtype)
    confidence = np.full(image0.shape[:2], np.nan, np.float32)
    nothing = Samples(*[np.empty((0, 0, 0), np.float32)] * 2, np.float32(1))
    further0, further1 = (nothing, nothing) if chroma is None else (samples(each) for each in chroma)
    further = np.full((0, 0, 0) if chroma is None else np.moveaxis(chroma[0], 2, 0).shape, np.nan, np.float32)
    further_size = image0.shape if chroma is None else chroma[0].shape
    blend_hypotheses(
        PlaneGroup(samples(image0), samples(image1), 1, 1),
        PlaneGroup(further0, further1, *(-(-image0.shape[axis] // further_size[axis]) for axis in (0, 1))),
        np.float32(t),
        listed(candidates, spacing),
        weighting(spacing, **options),
        None,
        values,
        Blended(image.transpose(2, 0, 1), further, confidence),
    )
    return (image, confidence) if chroma is None else (image, np.moveaxis(further, 0, 2), confidence)


def nodes_of(size, candidates=(), spacing=16):
    """The same candidates for each node of a frame."""
    each_alone = np.vectorize(lambda _: [list(each) for each in candidates], otypes=[object])
    return each_alone(np.zeros(points(size[:2], spacing)))


def random_candidates(random, size, most, largest, spacing=16):
    """Up to `most` motions a node, whole and not, straight and bent, some of them without any weight, and none."""
    candidates = nodes_of(size, spacing=spacing)
    for place in np.ndindex(candidates.shape):
        number = random.integers(0, most + 1) if any(place) else most
        motions, bends = random.uniform(-largest, largest, (number, 2)), random.normal(size=(number, 2)) * 4
        motions[1::2], bends[1::2] = np.rint(motions[1::2]), 0
        weights = random.choice([0, 0.25, 0.5, 1], number)
        candidates[place] = [*np.column_stack([weights, motions, bends]).tolist(), [0.125, 0, 0, 0, 0]]
    return candidates


def two_frames(size, channels, seed=2, step=(1, 1)):
    """A smooth texture that moves by a pixel and a half, as it is seen in both frames, by samples a step apart."""
    down, across = step
    y, x = np.mgrid[0 : -(-size[0] // down), 0 : -(-size[1] // across)].astype(float)
    return [waves(across * x + k, down * y, channels, seed=seed).astype(np.float32) for k in (0, 1.5)]


OPTIONS = {"scale": 4.0, "sharpness": 10.0, "enough": 2.0}


@pytest.mark.parametrize(
    ("size", "channels", "t", "largest", "most", "spacing"),
    [
        ((16, 16), 3, 0.5, 3, 2, 16),
        ((19, 9), 1, 0.3, 6, 3, 16),
        ((5, 34), 4, 0.75, 60, 1, 16),
        ((24, 36), 1, 0.5, 3, 1, 16),
        ((1, 1), 3, 0.5, 4, 1, 20),
        ((25, 61), 1, 0.3, 6, 1, 20),
        ((5, 44), 2, 0.75, 60, 2, 24),
        ((29, 58), 3, 0.5, 3, 1, 28),
        ((41, 58), 2, 0.3, 3, 2, 16),
    ],
)
def test_blending_equals_its_slow_twin(size, channels, t, largest, most, spacing):
    """Within the frame, across its borders and far out, along straight and bent paths."""
    image0, image1 = two_frames(size, channels)
    candidates = random_candidates(np.random.default_rng(channels), size, most, largest, spacing)
    mean, confidence = blend(image0, image1, t, candidates, **OPTIONS, spacing=spacing)
    expected, expected_confidence = blended(split(image0), split(image1), t, candidates, **OPTIONS, spacing=spacing)
    np.testing.assert_allclose(mean, np.dstack(expected), atol=2e-4)
    np.testing.assert_allclose(confidence, expected_confidence, atol=2e-4)


def assert_planes_blend(luma, further, t, candidates, spacing, compared=None, atol=2e-4):
    """One plane of full size and further ones that are sampled along are blended as the twin does it."""
    mean, mean_of_further, confidence = blend(*luma, t, candidates, **OPTIONS, spacing=spacing, chroma=further)
    planes = [split(full) + split(other) for full, other in zip(luma, further, strict=True)]
    expected, expected_confidence = blended(*planes, t, candidates, **OPTIONS, spacing=spacing, compared=compared)
    np.testing.assert_allclose(mean[..., 0], expected[0], atol=atol)
    np.testing.assert_allclose(mean_of_further, np.dstack(expected[1:]), atol=atol if compared is None else 10 * atol)
    np.testing.assert_allclose(confidence, expected_confidence, atol=atol)


CHROMA, LAYERS = None, 1  # how many planes have a part in the weights: all, or the first alone


@pytest.mark.parametrize(
    ("size", "step", "compared", "t", "largest", "spacing"),
    [
        ((24, 36), (1, 1), LAYERS, 0.5, 3, 16),
        ((19, 33), (1, 1), LAYERS, 0.3, 9, 16),
        ((23, 33), (1, 1), LAYERS, 0.3, 3, 20),
        ((24, 36), (2, 2), CHROMA, 0.5, 3, 16),
        ((19, 33), (1, 2), CHROMA, 0.3, 9, 16),
        ((2, 2), (2, 2), CHROMA, 0.75, 5, 16),
        ((25, 33), (2, 2), CHROMA, 0.3, 9, 20),
        ((2, 50), (1, 2), CHROMA, 0.75, 5, 24),
        ((29, 39), (2, 2), CHROMA, 0.5, 3, 28),
    ],
)
def test_further_planes_equal_their_slow_twin(size, step, compared, t, largest, spacing):
    """Chroma of half the size has a part in the weights, layers of full size have none; both are mixed by them."""
    candidates = random_candidates(np.random.default_rng(sum(step)), size, 2, largest, spacing)
    further = [(1 if compared is CHROMA else 10) * plane for plane in two_frames(size, 2, 3, step)]
    assert_planes_blend(two_frames(size, 1), further, t, candidates, spacing, compared)


@settings(max_examples=3)
@given(
    st.integers(2, 40),
    st.integers(2, 40),
    st.sampled_from([16, 20, 24, 28]),
    st.sampled_from([1, 2]),
    st.integers(0, 2**32),
)
@example(60, 41, 20, 2, 1)
def test_nodes_may_lie_farther_apart(height, width, spacing, down, seed):
    """Frames of any size equal those of the twin, in 4:2:2 and 4:2:0, also where the last cell of nodes is cut off."""
    random, size = np.random.default_rng(seed), (height, width)
    luma = [random.random((*size, 1), np.float32) for _ in range(2)]
    chroma = [random.random((-(-height // down), -(-width // 2), 2), np.float32) for _ in range(2)]
    assert_planes_blend(luma, chroma, 0.25, random_candidates(random, size, 2, 5, spacing), spacing, atol=5e-4)


@pytest.mark.parametrize(
    ("size", "channels", "t", "largest", "spacing"),
    [
        ((40, 36), 3, 0.5, 3, 16),
        ((19, 9), 1, 0.3, 6, 16),
        ((5, 34), 4, 0.75, 40, 16),
        ((45, 43), 1, 0.3, 6, 20),
        ((9, 57), 3, 0.5, 3, 28),
    ],
)
def test_the_dominant_motion_equals_its_slow_twin(size, channels, t, largest, spacing):
    """The largest weight of every pixel, and where the pixel lies along that motion."""
    image0, image1 = two_frames(size, channels)
    candidates = random_candidates(np.random.default_rng(channels), size, 2, largest, spacing)
    weights, places = np.zeros(size, np.float32), np.zeros((4, *size), np.float32)
    find_dominant_motion(
        PlaneGroup(samples(image0), samples(image1), 1, 1),
        np.float32(t),
        listed(candidates, spacing),
        weighting(spacing, **OPTIONS),
        weights,
        places,
    )
    expected, expected_places = heaviest(
        split(image0), split(image1), t, candidates, scale=4.0, sharpness=10.0, spacing=spacing
    )
    np.testing.assert_allclose(weights, expected, atol=2e-4)
    apart = np.abs(places - expected_places).max(axis=0) > 1e-3
    assert apart.mean() < 0.01  # where two weigh the same to rounding


@pytest.mark.parametrize("down", [1, 2])
def test_chroma_zooms_and_turns_with_luma(down):
    """On ramps, which a spline reproduces, chroma of half the width tells where it was taken: where luma was."""
    y, x = np.mgrid[0:48, 0:48].astype(np.float32)
    luma, chroma = np.dstack([x]), np.dstack([x, y])[::down, ::2]
    candidates = nodes_of((48, 48))
    matrix = np.array([[0.05, 0.08], [-0.06, 0.04]])  # d(dx, dy) / d(x, y)
    for row, column in np.ndindex(*candidates.shape):
        middle = np.array([16 * column + 8 - 24, 16 * row + 8 - 24])
        candidates[row, column] = [[1, *(matrix @ middle), 0, 0, *matrix.T.ravel()]]
    options = {"scale": 0.0, "sharpness": 0.0, "enough": 2.0}
    # frame 1 alone is looked at, so that the mean is where its samples were taken
    mean, mean_of_chroma, _ = blend(luma * 0, luma, 0.5, candidates, **options, chroma=[chroma * 0, chroma])
    apart = 2 * mean_of_chroma[..., 0] - 2 * mean[::down, ::2, 0]
    np.testing.assert_allclose(apart[6:-6, 6:-6], 0, atol=0.3)
    moved_y = 2 * mean_of_chroma[..., 1] - chroma[..., 1]
    v, u = np.mgrid[0:48:down, 0:48:2]
    expected = 0.5 * (matrix[1, 0] * (u - 23.5) + matrix[1, 1] * (v - 23.5))
    np.testing.assert_allclose(moved_y[6:-6, 6:-6], expected[6:-6, 6:-6], atol=0.4)


@pytest.mark.parametrize(
    ("shares", "other", "sharpness", "limit"),
    [((0.8, 0.2), 4, 2.0, {"enough": 0.5}), ((0.95, 0.05), 9, 0.0, {"enough": 2.0, "negligible": 0.2})],
)
def test_the_rest_is_left_out(shares, other, sharpness, limit):
    """Once all pixels are similar enough, or already have five times as much; the true motion comes first."""
    image0, image1 = (moved_waves((16, 16), k, 0, 1, seed=2).astype(np.float32) for k in (0, 2))
    candidates = nodes_of((16, 16), [(shares[0], 2, 0, 0, 0), (shares[1], other, 0, 0, 0)])
    options = {"scale": 1.0, "sharpness": sharpness}
    alone, _ = blend(image0, image1, 0.5, candidates, **options, **limit)
    expected, _ = blended(split(image0), split(image1), 0.5, candidates, **options, **limit)
    np.testing.assert_allclose(alone, np.dstack(expected), atol=1e-4)
    np.testing.assert_allclose(alone[:, 6:-6], moved_waves((16, 16), 1, 0, 1, seed=2)[:, 6:-6], atol=1e-4)
    together, _ = blend(image0, image1, 0.5, candidates, **options, enough=2.0)
    assert np.abs(together - alone).max() > 0.01


@pytest.mark.parametrize("gradient", [(0.1, 0, 0, 0.1), (0, 0.06, -0.06, 0), (-0.05, 0.02, 0.04, 0.08)])
def test_a_window_zooms_and_turns_with_its_motion(gradient):
    """What is zoomed, turned or sheared comes out half-way; windows that moved as a whole would be farther off."""
    y, x = np.mgrid[0:48, 0:48].astype(float)
    matrix = np.reshape(gradient, (2, 2)).T  # d(dx, dy) / d(x, y)
    away = np.stack([x - 23.5, y - 23.5])
    # where the pixels of each frame lie at time 1/2, when nothing is zoomed or turned
    ways = [np.linalg.inv(np.eye(2) - sign * matrix / 2) for sign in (1, -1)]
    shown = [waves(*np.tensordot(way, away, 1), 1, seed=2) for way in ways]
    image0, image1 = (each.astype(np.float32) for each in shown)
    off = []
    for gradients in (gradient, (0, 0, 0, 0)):
        candidates = nodes_of((48, 48))
        for row, column in np.ndindex(*candidates.shape):
            middle = np.array([16 * column + 8 - 24, 16 * row + 8 - 24])
            candidates[row, column] = [[1, *(matrix @ middle), 0, 0, *gradients]]
        mean, _ = blend(image0, image1, 0.5, candidates, scale=0.0, sharpness=0.0, enough=2.0)
        off.append(np.abs(mean - waves(*away, 1, seed=2))[12:-12, 12:-12].max())
    assert off[0] < 0.6 * off[1]


def test_a_window_is_not_torn_by_motion_that_changes_too_fast():
    """What changes by more than half a pixel from pixel to pixel borders another motion: windows move as a whole."""
    image0, image1 = (moved_waves((32, 48), k, 0, 1, seed=2).astype(np.float32) for k in (0, 3))
    options = {"scale": 0.0, "sharpness": 0.0, "enough": 2.0}
    rigid, steep, zoomed = (
        blend(image0, image1, 0.5, nodes_of((32, 48), [(1, 3, 0, 0, 0, change, 0, 0, 0)]), **options)[0]
        for change in (0, 0.6, 0.4)
    )
    np.testing.assert_array_equal(steep, rigid)
    assert np.abs(zoomed - rigid).max() > 0.01


@pytest.mark.parametrize("t", [0.25, 0.75])
def test_the_blocks_of_a_window_move_as_their_middles_do(t):
    """On ramps, which a spline reproduces, every sample of a window within both frames tells where it was taken."""
    dx, dy, *gradients = motion = 2.25, -1.5, 0, 0, 0.05, -0.02, 0.03, 0.1
    ramps = np.dstack(np.mgrid[0:60, 0:70][::-1]).astype(np.float32)
    candidates = nodes_of(ramps.shape)
    candidates[1, 1] = [[1, *motion]]  # whose window begins at (8, 8)
    middles = np.arange(WINDOW) // WINDOW_BLOCK * WINDOW_BLOCK + WINDOW_BLOCK / 2 - WINDOW / 2
    changes = np.reshape(gradients[2:], (2, 2)).T @ np.stack(np.meshgrid(middles, middles)).reshape(2, -1)
    begin = np.stack(np.meshgrid(8 + np.arange(WINDOW), 8 + np.arange(WINDOW))).reshape(2, -1)
    for images, share, weight in (((ramps, 0 * ramps), -t, 1 - t), ((0 * ramps, ramps), 1 - t, t)):
        mean, _ = blend(*images, t, candidates, scale=0.0, sharpness=0.0, enough=2.0)
        found = mean[8 : 8 + WINDOW, 8 : 8 + WINDOW].reshape(-1, 2).T / weight
        expected = begin + share * (np.array([[dx], [dy]]) + changes)
        np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint8, 219), (np.uint16, 65535), (np.float32, 1)])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_finished_values_equal_their_slow_twin(dtype, white, channels):
    """Means become values of the image's type, the nearest ones, straight alpha too."""
    images = [noise(21, 37, channels, np.float32, seed=seed).copy() for seed in (1, 2)]
    for image in images:
        image[5:15, :20, -1] = 0  # which is no alpha at all
    straight_alpha = channels in (2, 4) and dtype != np.float32
    lowest, highest = (-0.5, 5) if dtype == np.float32 else (0, np.iinfo(dtype).max)
    half = 0 if dtype == np.float32 else 0.5
    values = ValueRange(*map(np.float32, (white, half, lowest, highest)), straight_alpha)
    moving = images[0] - 0.2, 1.3 * images[1], 0.25, nodes_of((21, 37), [(1, 1.5, 0.5, 0, 0)])
    mean, _ = blend(*moving, **OPTIONS)
    found, _ = blend(*moving, **OPTIONS, values=values, dtype=dtype)
    mean = mean.transpose(2, 0, 1)
    expected = finished(mean, np.ones(mean.shape[1:]), white, lowest, highest, straight_alpha)
    np.testing.assert_allclose(found.astype(float).transpose(2, 0, 1), expected, rtol=1e-5, atol=half + 1e-5)
