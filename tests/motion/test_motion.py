"""Every estimator through one contract and against constructed truth; repeated patterns; and the search radius."""

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost import CutDetector, FrameCache, MotionEstimator, OptionError, VectorFolder, find_method, methods
from fpsboost.colour import colour_components
from fpsboost.kernels.planes import UNIT, PlanePair, colour_scale
from fpsboost.kernels.shortest import ShortestMotion, find_shortest
from fpsboost.motion.block import BlockMatching
from fpsboost.motion.components import contrast_components, padded_planes
from fpsboost.motion.exhaustive import ExhaustiveSearch, choose_search_radius
from fpsboost.motion.field import ZeroMotion
from fpsboost.motion.nlm import CoarseToFine, pyramid
from fpsboost.motion.opencv import Dis, Farneback, TvL1
from fpsboost.motion.rendered import RenderedMotion
from support.truth import (
    SCENES,
    Clip,
    affine,
    as_type,
    eroded,
    frozen,
    layers,
    moving_object,
    needs_scenes,
    noise,
    prepared,
    translation,
    waves,
)
from support.twins import shortest_motions
from support.vector_truth import save_translation

estimators: dict[str, MotionEstimator] = {
    "nlm": CoarseToFine(),
    "exhaustive": ExhaustiveSearch(search_radius=8),
    "exhaustive, own radius": ExhaustiveSearch(),
    "exhaustive, gaussian": ExhaustiveSearch(search_radius=8, patch_radius=2, window="gaussian"),
    "exhaustive, passes": ExhaustiveSearch(search_radius=3, implementation="passes"),
    "dis": Dis(),
    "farneback": Farneback(),
    "tvl1": TvL1(),
    "block": BlockMatching(),
    "block, three-step": BlockMatching(pattern="three-step"),
    "block, diamond": BlockMatching(block_size=8, search_range=5, pattern="diamond"),
    "still": ZeroMotion(),
}
every_estimator = pytest.mark.parametrize("estimator", estimators.values(), ids=estimators.keys())
own = "nlm", "exhaustive"
own_kernels = pytest.mark.parametrize("estimator", [estimators[name] for name in own], ids=own)


def with_truth(estimator, clip):
    """The field of each direction, its exact motion, and which pixels are seen in both frames."""
    fields = estimator.estimate(*clip.prepared)
    return zip(fields, (clip.flow01, clip.flow10), (clip.seen0, clip.seen1), strict=True)


def errors(field, flow) -> np.ndarray:
    """Length of the difference of two flows, per pixel."""
    return np.linalg.norm(field.flow - flow, axis=-1)


@every_estimator
@pytest.mark.parametrize(
    ("channels", "dtype"), [(1, np.uint8), (2, np.uint8), (3, np.uint8), (4, np.uint16), (3, np.float32)]
)
def test_fields_have_the_frames_size(estimator, channels, dtype):
    """(H, W, 2) and (H, W) float32, finite, similarity in [0, 1]; read-only frames of every kind are taken."""
    clip = affine(37, 45, shift=(1, 1), channels=channels, dtype=dtype)
    for field in estimator.estimate(*clip.prepared):
        assert (field.flow.shape, field.similarity.shape) == ((37, 45, 2), (37, 45))
        assert field.flow.dtype == field.similarity.dtype == np.float32
        assert np.isfinite(field.flow).all()
        assert 0 <= field.similarity.min() <= field.similarity.max() <= 1


@every_estimator
def test_identical_frames_do_not_move(estimator):
    """The same picture twice: nothing moves, everything is similar; flat pictures too."""
    for image in (noise(40, 50), frozen(np.full((40, 50, 3), 90, np.uint8))):
        for field in estimator.estimate(*prepared(image, image)):
            if isinstance(estimator, Farneback):  # OpenCV's trembles a little at the frame's edge
                assert np.abs(field.flow).mean() < 0.01
                assert np.abs(field.flow).max() < 0.5
            else:
                assert not field.flow.any()
            np.testing.assert_allclose(field.similarity, 1, atol=1e-5)


@own_kernels
@pytest.mark.parametrize("shift", [(5, 0), (0, -6), (-7, 3), (4, 8)])
def test_whole_translations_are_found_exactly(estimator, shift):
    """Every pixel whose patch is in both frames has its vector; fractions are right to a twentieth at the edge."""
    clip = translation(72, 90, *shift, seed=1)
    for field, flow, seen in with_truth(estimator, clip):
        inner = eroded(seen, 5)
        to_fractions = isinstance(estimator, CoarseToFine)
        np.testing.assert_allclose(field.flow[inner], flow[inner], rtol=0, atol=0.05 if to_fractions else 0)


def test_sub_pixel_translations_are_found_to_the_pixel():
    """A vector of whole pixels is off by half a pixel an axis at most, and a little where the texture is weak."""
    clip = affine(96, 120, shift=(3.4, -2.3))
    for field, flow, seen in with_truth(ExhaustiveSearch(search_radius=8), clip):
        off = np.abs(field.flow - flow)[eroded(seen, 6)]
        assert (off > 0.61).mean() < 0.01
        assert off.max() < 1


@pytest.mark.parametrize("shift", [(0.1, 0.1), (0.25, 0), (0.5, -0.5), (3.4, -2.3), (-7.7, 4.1), (12.3, 0.9)])
def test_coarse_to_fine_finds_fractions_of_a_pixel(shift):
    """Every translation of a smooth texture is right to a tenth of a pixel on average, and to one everywhere."""
    clip = affine(96, 120, shift=shift)
    for field, flow, seen in with_truth(CoarseToFine(), clip):
        off = errors(field, flow)[eroded(seen, 8)]
        assert off.mean() < 0.1
        assert off.max() < 1


@pytest.mark.parametrize("motion", [{"zoom": 1.05}, {"degrees": 3}, {"zoom": 0.97, "degrees": -2, "shift": (2.5, 1)}])
def test_coarse_to_fine_follows_zoom_and_rotation_closely(motion):
    """Right to a quarter of a pixel on average: most of that is one vector for all the pixels around a point."""
    clip = affine(120, 160, **motion, seed=4)
    for field, flow, seen in with_truth(CoarseToFine(), clip):
        assert errors(field, flow)[eroded(seen, 6)].mean() < 0.25


@pytest.mark.parametrize(
    ("size", "shift", "bright"),
    [(12, (30, 0), True), (12, (0, 30), True), (16, (24, -18), True), (32, (24, 0), False), (40, (20, -12), False)],
)
def test_small_fast_things_are_found(size, shift, bright):
    """To the pixel: 12 pixels that stand out and move by 30; 32 of the background's own contrast, by 24."""
    clip = layers(160, 240, box=(60, 100, 60 + size, 100 + size), shift=shift, bright=bright)
    for field, flow, _ in with_truth(CoarseToFine(), clip):
        thing = eroded(flow.any(axis=-1), size // 4)
        assert np.median(errors(field, flow)[thing]) < 1


@own_kernels
def test_an_object_moves_over_a_still_background(estimator):
    """Away from its outline, old and new, the object has its motion and the background none."""
    clip = moving_object(96, 120, box=(30, 34, 70, 74), dx=8, dy=-6)
    for field, flow, seen in with_truth(estimator, clip):
        moving = flow.any(axis=-1)
        sure = eroded(moving, 5) | eroded(seen & ~moving, 5)
        assert eroded(moving, 5).sum() > 500
        wrong = errors(field, flow) > 0.1  # the step to fractions of a pixel never is exactly none
        assert wrong[sure].mean() < 0.01
        assert wrong.any()  # what is hidden cannot be found


@pytest.mark.parametrize("shift", [(32, 0), (-24, 18)])
def test_large_motion_is_found_coarse_to_fine(shift):
    """Motion up to an eighth of the frame survives the pyramid."""
    clip = affine(180, 260, shift=shift, seed=6)
    field, _ = CoarseToFine().estimate(*clip.prepared)
    assert np.median(errors(field, clip.flow01)[eroded(clip.seen0, 6)]) <= 0.5


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@own_kernels
def test_the_type_of_the_pixels_does_not_matter(estimator, dtype):
    """The same colours in 8 bits, in 16 and as floats give the same motion."""
    clip = translation(48, 56, 3, -2, seed=2)
    others = [as_type(image / 255.0, dtype) for image in (clip.image0, clip.image1)]
    for field, other in zip(estimator.estimate(*clip.prepared), estimator.estimate(*prepared(*others)), strict=True):
        assert (errors(field, other.flow) <= 1e-3).mean() > 0.999
        np.testing.assert_allclose(field.similarity, other.similarity, atol=1e-4)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_colours_are_normalised_and_premultiplied(dtype):
    """White is 1, gray fills one component, a transparent pixel has no colour."""
    white = 1 if dtype is np.float32 else np.iinfo(dtype).max
    np.testing.assert_allclose(colour_components(np.full((2, 3, 3), white, dtype)), 1, rtol=1e-6)
    gray = colour_components(np.full((2, 3, 1), white, dtype))
    assert gray.shape == (2, 3, 3)
    np.testing.assert_allclose(gray, np.broadcast_to([1, 0, 0], (2, 3, 3)), rtol=1e-6)
    see_through = np.full((2, 3, 4), white, dtype)
    see_through[..., 3] = 0
    assert not colour_components(see_through).any()


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(
    ("size", "expected"),
    [((119, 80), 1), ((120, 80), 2), ((101, 333), 3), ((4000, 2000), 5), ((1, 1), 1), ((1, 500), 4)],
)
def test_pyramids_halve_down_to_the_coarsest_side(size, expected, channels):
    """Odd sizes round up, the longer side stays above the limit, and there are five levels at most."""
    levels = pyramid(np.zeros((*size, channels), np.uint8), 60)
    assert len(levels) == expected
    for finer, coarser in pairwise(level.pixels for level in levels):
        assert coarser.shape == ((finer.shape[0] + 1) // 2, (finer.shape[1] + 1) // 2, channels)
    assert max(levels[-1].pixels.shape[:2]) >= min(60, max(size))


@pytest.mark.parametrize("size", [(1, 1), (40, 50), (96, 131)])
@pytest.mark.parametrize("estimator", [CoarseToFine(), CoarseToFine(step=2, finest_level=1)])
def test_motion_onward_alone_is_that_of_both(estimator, size):
    """To the bit on the last level; those before it have fewer vectors of the same motion."""
    clip = affine(*size, shift=(3.4, -2.3))
    field, _ = estimator.estimate(*clip.prepared)
    *coarser, last = estimator.estimate_onward(*clip.prepared)
    np.testing.assert_array_equal(last.vectors, field.vectors)
    np.testing.assert_array_equal(last.similarities, field.similarities)
    assert all(each.shape == field.shape for each in coarser)
    if coarser:
        assert np.abs(coarser[-1].flow - np.float32([3.4, -2.3]))[16:-16, 16:-16].mean() < 0.3


@pytest.mark.parametrize("width", [18, 24])
@pytest.mark.parametrize("shift", [(14, 27), (-30, 6), (20, -20), (2, 28)])
def test_a_small_disc_keeps_its_motion_to_the_finest_level(width, shift):
    """Plain, and of a few points only, it is found by the second look; its detailed surroundings must not win again."""
    random = np.random.default_rng(1)
    waves = [cv2.GaussianBlur(random.normal(size=(240, 400, 3)), (0, 0), s) * s for s in (1, 3, 9)]
    ground = (110 + 40 * sum(waves) / np.std(sum(waves))).clip(0, 255).astype(np.uint8)
    middles = (200, 120), (200 + shift[0], 120 + shift[1])
    images = [cv2.circle(ground.copy(), middle, width // 2, (30, 200, 230), -1, cv2.LINE_AA) for middle in middles]
    field, _ = CoarseToFine().estimate(*(FrameCache(image) for image in images))
    inner = slice(120 - width // 4, 120 + width // 4), slice(200 - width // 4, 200 + width // 4)
    assert np.mean(np.abs(field.flow[inner] - np.float32(shift)).max(axis=-1) < 1.5) > 0.6


@pytest.mark.parametrize("gain", [4, 100])
def test_motion_is_followed_in_bright_light(gain):
    """Float images far above white: to a tenth of a pixel, as below it."""
    clip = affine(96, 128, shift=(5.3, -2.6), dtype=np.float32, seed=2)
    bright = prepared(*(image * np.float32(gain) for image in (clip.image0, clip.image1)))
    field01, _ = CoarseToFine().estimate(*bright)
    assert np.abs(field01.flow - np.float32([5.3, -2.6]))[16:-16, 16:-16].mean() < 0.1
    dim = CutDetector().match_score(*clip.prepared)
    assert CutDetector().match_score(*bright) > 0.7 * dim


LOWEST, HIGHEST = 0.8, 1.6  # of the true largest motion plus 20 %


@needs_scenes
@pytest.mark.parametrize("number", [0, 6, 14, 20])
@pytest.mark.parametrize("scene", ["glass", "reflective", "texture"])
def test_the_radius_of_rendered_scenes_is_near_the_renderers(scene, number):
    """Mirrors, glass and patterns: what looks most alike far away in a pattern does not count as motion."""
    image0, image1 = (
        FrameCache(cv2.imread(str(SCENES / scene / f"{each:04d}.png")), Fraction(each)) for each in (number, number + 2)
    )
    vectors = VectorFolder(SCENES / scene / "vectors")
    true = 1.2 * max(float(np.abs(field.flow).max()) for field in RenderedMotion(vectors).estimate(image0, image1))
    assert LOWEST * true <= choose_search_radius(image0, image1) <= HIGHEST * true
    least = max(image0.pixels.shape[:2]) / 32  # the radius that no motion is too small for
    assert choose_search_radius(image0, image1, vectors) == math.ceil(max(true, least))


@pytest.mark.parametrize(
    "make",
    [
        partial(affine, 216, 384, shift=(15, 5)),
        partial(affine, 216, 384, shift=(-30, 10)),
        partial(affine, 216, 384, shift=(20, -60)),
        partial(translation, 180, 320, -24, 12),
        partial(affine, 216, 384, zoom=1.1),
        partial(affine, 216, 384, zoom=0.8),
        partial(affine, 216, 384, degrees=8),
        partial(affine, 96, 800, shift=(60, 5)),
        partial(layers, 216, 384, box=(80, 100, 96, 116), shift=(45, -22), bright=True),
        partial(layers, 216, 384, box=(80, 100, 104, 124), shift=(25, -12), background=(3, 1)),
        partial(layers, 216, 384, box=(80, 100, 120, 140), shift=(-45, 20), background=(3, 1)),
        partial(moving_object, 216, 384, box=(80, 100, 104, 124), dx=25, dy=-12),
    ],
    ids=[
        "pan", "fast pan", "steep pan", "pan over noise", "zoom in", "zoom out", "rotation", "large frame",
        "small bright thing", "small thing", "thing", "small thing of noise",
    ],
)  # fmt: skip
def test_the_radius_is_near_the_constructed_motion(make: Callable[[], Clip]):
    """Pans, zooms, turns and small fast things: 0.8 to 1.6 times the largest motion plus 20 %."""
    clip = make()
    true = 1.2 * max(np.abs(clip.flow01[clip.seen0]).max(), np.abs(clip.flow10[clip.seen1]).max())
    assert LOWEST * true <= choose_search_radius(*clip.prepared) <= HIGHEST * true


def test_vectors_choose_the_radius_of_the_reports_method(tmp_path):
    """The renderer's largest motion plus 20 %, whatever the image does; the field says what was chosen."""
    vectors = VectorFolder(save_translation(tmp_path, 3, (60, 80), 5.5, -1))
    image0, image1 = FrameCache(noise(60, 80), Fraction(0)), FrameCache(noise(60, 80, seed=1), Fraction(2))
    for name in ("nlm-exhaustive", "nlm-brute-force"):
        estimator = find_method(name, vectors).estimator
        assert [field.search_radius for field in estimator.estimate(image0, image1)] == [14, 14]
    with pytest.raises(OptionError, match="whole factor"):
        choose_search_radius(FrameCache(noise(60, 80)), image1, vectors)


@pytest.mark.slow
@given(st.integers(0, 2**32), st.integers(0, 2), st.sampled_from([2, 4]))
def test_shortest_motions_equal_their_slow_twin(seed, around, step):
    """The shortest motion around each point that explains it nearly as well, and the best similarity there is."""
    random = np.random.default_rng(seed)
    height, width, radius, padding = 14, 18, 2, 40
    image0, image1 = noise(height, width, seed=seed % 1000), noise(height, width, seed=seed % 1000)
    components = [
        contrast_components(frozen(np.roll(image, shift, axis=1))) for image, shift in ((image0, 0), (image1, 3))
    ]
    planes = [padded_planes(each, padding, colour_scale(0.3)) for each in components]
    flow = random.integers(-6, 7, (-(-height // step), -(-width // step), 2)).astype(np.float32)
    flow[random.random(flow.shape[:2]) < 0.5] = (3, 0)
    results = [np.empty(flow.shape[:2], np.float32) for _ in range(3)]
    tolerance = np.float32(0.2)
    pair = PlanePair(*planes, padding, height, width, UNIT)
    find_shortest(pair, step, radius, around, tolerance, flow, ShortestMotion(*results))
    expected = shortest_motions(*components, step, radius, around, 0.2, 0.3, flow)
    np.testing.assert_allclose(results, expected, atol=2e-3)


NLM = replace(methods["nlm"], cuts=None)
EACH_ALONE = replace(NLM, estimator=replace(NLM.estimator, smoothness=0))  # the same, but nobody listens to neighbours

MIXED = replace(methods["blend"], cuts=None)


def bars(period, shift, *, degrees=0.0, box=(26, 28, 102, 144), background=(0, 0)):
    """Bright bars with dark gaps of three pixels at any time, turned, within a box that moves over a smooth texture."""
    y, x = np.mgrid[0:128, 0:192].astype(float)
    angle = np.radians(degrees)
    top, left, bottom, right = box

    def at(t):
        u, v = x - t * shift[0], y - t * shift[1]
        place = (np.cos(angle) * u + np.sin(angle) * v) % period
        bright = 0.15 + 0.7 * (np.minimum(place, period - place) - 1).clip(0, 1)[..., np.newaxis]
        across = (u - left + 0.5).clip(0, 1) * (right - u + 0.5).clip(0, 1)
        down = (v - top + 0.5).clip(0, 1) * (bottom - v + 0.5).clip(0, 1)
        share = (across * down)[..., np.newaxis]
        behind = 0.2 + 0.6 * waves(x - t * background[0], y - t * background[1])
        return as_type(behind * (1 - share) + bright * [1, 0.95, 0.9] * share, np.uint8)

    return at


INNER = slice(40, 88), slice(50, 132)  # within the bars at the middle of their way


def off(interpolator, at):
    """Mean largest difference of a pixel's channels within the bars, halfway."""
    (image,) = interpolator.interpolate(at(0), at(1), [0.5])
    return float(np.abs(image.astype(float) - at(0.5)).max(axis=-1)[INNER].mean())


@pytest.mark.parametrize(
    ("period", "shift", "degrees", "of_mixed", "of_alone"),
    [
        *((period, shift, 0, 1 / 8, 1 / 5) for period, shift in ((16, 10), (20, 12), (24, 14))),
        *((period, shift, 8, 1 / 15, 1.05) for period, shift in ((16, 10), (20, 12))),
        *((period, shift, 20, 1 / 15, 1.05) for period, shift in ((16, 10), (24, 14))),
    ],
)
def test_bars_go_where_their_bounds_go(period, shift, degrees, of_mixed, of_alone):
    """By more than half a period, where a shorter way back is as similar: their ends tell, each alone cannot.

    Turned by some degrees, where the way along the bars costs nothing, a grille is right, and no worse than each alone.
    """
    at = bars(period, (shift, 0), degrees=degrees)
    made, alone, mixed = (off(each, at) for each in (NLM, EACH_ALONE, MIXED))
    assert made < mixed * of_mixed
    assert made <= max(alone * of_alone, 0.01)


@pytest.mark.parametrize(("period", "shift"), [(16, 10), (20, 12)])
def test_bars_from_top_to_bottom_go_where_their_ends_go(period, shift):
    """Also where nothing but their left and right ends can be seen, and the background moves: to a tenth of a level."""
    at = bars(period, (shift, 0), box=(-50, 28, 200, 144), background=(-2, 1))
    made, mixed = (off(each, at) for each in (NLM, MIXED))
    assert made < min(mixed / 4, 0.1)


def test_bars_that_stand_still_stay():
    """No motion is a motion like any other: still bars before a moving background are hardly touched."""
    at = bars(16, (0, 0), background=(6, 2))
    assert off(NLM, at) < 0.5
