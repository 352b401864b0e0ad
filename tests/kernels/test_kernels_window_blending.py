"""The weighted mean over candidate motions, against a slow twin, and its parts."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from planes import compiled
from truth import noise, waves
from twins import blended, finished, heaviest, spline_coefficients, uncompiled

from fpsboost.kernels.candidates import VALUES_PER_MOTION, Candidates
from fpsboost.kernels.dominant_motion import find_dominant_motion
from fpsboost.kernels.multi_hypothesis import (
    SPARE,
    Blended,
    SampledImage,
    Target,
    ValueRange,
    blend_hypotheses,
    finish_rows,
    window_shape,
)
from fpsboost.kernels.pixel_weights import Weighting
from fpsboost.kernels.spline import MARGIN
from fpsboost.kernels.window_rows import SQUARES_PER_ROW
from fpsboost.kernels.window_samples import (
    AREA,
    BLOCK,
    WINDOW,
    Room,
    Samples,
    WindowPlace,
    fetch_window,
    flat_planes,
    make_layer,
    sample_layer,
)
from fpsboost.synthesis.fusion_table import fusion_coefficients


def samples(image):
    """Planes and their coefficients, which the twin finds: uncompiled, the kernel would take most of the time."""
    planes = image.transpose(2, 0, 1).astype(np.float32)
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


def blend(image0, image1, t, candidates, *, scale, sharpness, enough, negligible=0, chroma=None, spacing=16):
    """Call the kernels; the mean as an image, and the confidence; with chroma or layers of both, their mean, too."""
    image = np.full(np.moveaxis(image0, 2, 0).shape, np.nan, np.float32)
    confidence = np.full(image0.shape[:2], np.nan, np.float32)
    numbers = map(np.float32, (scale, sharpness, enough, negligible))
    bounds = map(np.float32, (1, 0, -1e30, 1e30))
    nothing = Samples(np.empty((0, 1, 1), np.float32), np.empty((0, 1, 1), np.float32), np.float32(1))
    further0, further1 = (nothing, nothing) if chroma is None else (samples(each) for each in chroma)
    further = np.full((0, 0, 0) if chroma is None else np.moveaxis(chroma[0], 2, 0).shape, np.nan, np.float32)
    blend_hypotheses(
        SampledImage(samples(image0), further0),
        SampledImage(samples(image1), further1),
        (1, 1)
        if chroma is None
        else tuple(-(-a // b) for a, b in zip(image0.shape[:2], chroma[0].shape[:2], strict=True)),
        np.float32(t),
        listed(candidates, spacing),
        Weighting(*numbers, window_shape(spacing), *fusion_coefficients()),
        None,
        ValueRange(*bounds, False),
        Blended(Target.of(image), Target.of(further), confidence),
    )
    image, further = (np.moveaxis(each, 0, 2) for each in (image, further))
    return (image, confidence) if chroma is None else (image, further, confidence)


def nodes_of(size, candidates=(), spacing=16):
    """The same candidates for each node of a frame."""
    nodes = np.empty([-(-length // spacing) for length in size[:2]], object)
    for place in np.ndindex(nodes.shape):
        nodes[place] = [list(each) for each in candidates]
    return nodes


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
    ],
)
def test_blending_equals_its_slow_twin(size, channels, t, largest, most, spacing):
    """Within the frame, across its borders and far out, along straight and bent paths, in windows that prefetch."""
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


@pytest.mark.parametrize(
    ("size", "t", "largest", "spacing"), [((24, 36), 0.5, 3, 16), ((19, 33), 0.3, 9, 16), ((23, 33), 0.3, 3, 20)]
)
def test_layers_are_mixed_by_the_weights_of_others(size, t, largest, spacing):
    """Planes of full size that are sampled along have no say in the weights."""
    candidates = random_candidates(np.random.default_rng(5), size, 2, largest, spacing)
    layers = [10 * layer for layer in two_frames(size, 2, seed=3)]
    assert_planes_blend(two_frames(size, 1), layers, t, candidates, spacing, compared=1)


@pytest.mark.parametrize(
    ("size", "down", "t", "largest", "spacing"),
    [
        ((24, 36), 2, 0.5, 3, 16),
        ((19, 33), 1, 0.3, 9, 16),
        ((2, 2), 2, 0.75, 5, 16),
        ((25, 33), 2, 0.3, 9, 20),
        ((2, 50), 1, 0.75, 5, 24),
        ((29, 39), 2, 0.5, 3, 28),
    ],
)
def test_planes_of_half_the_size_equal_their_slow_twin(size, down, t, largest, spacing):
    """Chroma has a say in the weights, and is mixed by those of luma; sizes are even and odd."""
    candidates = random_candidates(np.random.default_rng(down), size, 2, largest, spacing)
    assert_planes_blend(two_frames(size, 1), two_frames(size, 2, 3, (down, 2)), t, candidates, spacing)


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
    numbers = map(np.float32, (4, 10, 2, 0))
    find_dominant_motion(
        samples(image0),
        samples(image1),
        np.float32(t),
        listed(candidates, spacing),
        Weighting(*numbers, window_shape(spacing), *fusion_coefficients()),
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
    y, x = np.mgrid[0:16, 0:16].astype(float)
    image0, image1 = (waves(x - k, y, 1, seed=2).astype(np.float32) for k in (0, 2))
    candidates = nodes_of((16, 16), [(shares[0], 2, 0, 0, 0), (shares[1], other, 0, 0, 0)])
    options = {"scale": 1.0, "sharpness": sharpness}
    alone, _ = blend(image0, image1, 0.5, candidates, **options, **limit)
    expected, _ = blended(split(image0), split(image1), 0.5, candidates, **options, **limit)
    np.testing.assert_allclose(alone, np.dstack(expected), atol=1e-4)
    np.testing.assert_allclose(alone[:, 6:-6], waves(x - 1, y, 1, seed=2)[:, 6:-6], atol=1e-4)
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
    assert off[0] < off[1] / 2


def test_a_window_is_not_torn_by_motion_that_changes_too_fast():
    """What changes by more than half a pixel from pixel to pixel borders another motion: windows move as a whole."""
    y, x = np.mgrid[0:32, 0:48].astype(float)
    image0, image1 = (waves(x - k, y, 1, seed=2).astype(np.float32) for k in (0, 3))
    options = {"scale": 0.0, "sharpness": 0.0, "enough": 2.0}
    rigid, steep, zoomed = (
        blend(image0, image1, 0.5, nodes_of((32, 48), [(1, 3, 0, 0, 0, change, 0, 0, 0)]), **options)[0]
        for change in (0, 0.6, 0.4)
    )
    np.testing.assert_array_equal(steep, rigid)
    assert np.abs(zoomed - rigid).max() > 0.01


@pytest.mark.parametrize("share", [-0.25, 0.75])
def test_the_blocks_of_a_window_move_as_their_middles_do(share):
    """On ramps, which a spline reproduces, every sample tells where it was taken."""
    motion = np.float32([9, 9, 9, 9, 0.05, -0.02, 0.03, 0.1])
    y, x = np.mgrid[0:60, 0:70]
    away = np.arange(WINDOW) // BLOCK * BLOCK + BLOCK / 2 - WINDOW / 2  # of the blocks' middles
    shift_x = share * (0.05 * away + 0.03 * away[:, np.newaxis])
    shift_y = share * (-0.02 * away + 0.1 * away[:, np.newaxis])
    for ramp, expected in (
        (x, 12.25 + np.arange(WINDOW) + shift_x),
        (y, 9.5 + np.arange(WINDOW)[:, np.newaxis] + shift_y),
    ):
        planes = flat_planes(samples(ramp[..., np.newaxis].astype(np.float32)))
        out, rows = np.empty(AREA, np.float32), np.empty((WINDOW + 3) * WINDOW, np.float32)
        place = np.float32(9.5 + MARGIN), np.float32(12.25 + MARGIN)
        window = np.float32(share), motion, WINDOW, WINDOW
        uncompiled(fetch_window)(planes, 0, *place, *window, rows, out)
        np.testing.assert_allclose(out.reshape(WINDOW, WINDOW), expected, atol=2e-3)


@pytest.mark.parametrize("motion", [(2.5, 1.25, 0, 0, 0, 0, 0, 0), (2.5, 1.25, 0, 0, 0.05, -0.02, 0.03, 0.1)])
@pytest.mark.parametrize("wide", [WINDOW, SQUARES_PER_ROW])
def test_windows_inside_are_mixed_as_they_are_fetched(motion, wide):
    """In one go as one by one, for windows that move as a whole and for those that zoom and turn."""
    frames = [samples(noise(60, 70, 1, np.float32, seed=seed)) for seed in (1, 2)]
    motion, t = np.float32(motion), np.float32(0.25)
    places = np.float32([9.5 + MARGIN, 12.25 + MARGIN, 10.75 + MARGIN, 14.75 + MARGIN])
    found = []
    for within in (True, False):
        everywhere = np.ones((4, WINDOW), np.float32)
        room = Room(
            *(np.empty((WINDOW + 3) * WINDOW, np.float32) for _ in range(3)), np.empty(16, np.float32), everywhere
        )
        layer = make_layer(*frames, (WINDOW // wide, WINDOW // wide), 0, 0)
        uncompiled(sample_layer)(layer, WindowPlace(*places, t, within), motion, room)
        found.append(np.stack([layer.distance, layer.mixed[0], layer.change[0]]))
    np.testing.assert_allclose(found[0], found[1], atol=1e-5)


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint8, 219), (np.uint16, 65535), (np.float32, 1)])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_finished_rows_equal_their_slow_twin(dtype, white, channels):
    """Sums become values of the image's type, the nearest ones, straight alpha too; other rows are left alone."""
    random, first, last, top = np.random.default_rng(channels), 2, 7, 11
    band = random.uniform(-0.2, 1.2, (channels + 2, 9, 13)).astype(np.float32)
    band[channels] = random.uniform(0.1, 3, band.shape[1:])
    band[channels - 1, 3, :5] = 0  # which is no alpha at all
    straight_alpha = channels in (2, 4) and dtype != np.float32
    lowest, highest = (-0.5, 5) if dtype == np.float32 else (0, np.iinfo(dtype).max)
    expected = finished(band[:channels, first:last], band[channels, first:last], white, lowest, highest, straight_alpha)
    image = np.full((24, 13, channels), 77, dtype)
    half = 0 if dtype == np.float32 else 0.5
    bounds = (np.float32(value) for value in (white, half, lowest, highest))
    target = Target.of(image.transpose(2, 0, 1))
    compiled(finish_rows)(band, first, last, top, ValueRange(*bounds, straight_alpha), target)
    found = image[top + first : top + last].astype(float).transpose(2, 0, 1)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=half + 1e-5)
    assert (np.delete(image, range(top + first, top + last), axis=0) == 77).all()
