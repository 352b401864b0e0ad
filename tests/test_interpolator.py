"""Every method through the same contract: a pair and times in, images out."""

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from fpsboost import (
    CutDetector,
    InputError,
    OptionError,
    SceneCutWarning,
    find_method,
    interpolate,
    interpolate_with_confidence,
    methods,
    with_neighbours,
)
from fpsboost.motion.exhaustive import ExhaustiveSearch
from fpsboost.synthesis.reproject import Reproject
from support.truth import (
    CutsWhere,
    accelerating,
    affine,
    as_type,
    eroded,
    layers,
    moved_waves,
    noise,
    prepared,
    translation,
    waves,
)

every_method = pytest.mark.parametrize("method", methods)
moving_methods = pytest.mark.parametrize("method", [name for name in methods if name not in ("blend", "nearest")])
plain_methods = pytest.mark.parametrize(
    "method", ["nlm-exhaustive", "dis-warp", "farneback-warp", "tvl1-warp", "block", "blend", "nearest"]
)


def test_the_method_loads_no_library_for_files():
    """Two arrays are enough for it, with NumPy and OpenCV."""
    program = """
import sys, numpy, fpsboost.interpolator, fpsboost.streaming
from fpsboost.method_table import methods
methods["blend"].interpolate(*numpy.zeros((2, 32, 48, 3), numpy.uint8), [0.5])
loaded = {"av", "PIL", "OpenEXR", "OpenImageIO", "tifffile"} & set(sys.modules)
sys.exit(f"loaded: {loaded}" if loaded else 0)
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@every_method
@pytest.mark.parametrize(
    ("channels", "dtype"), [(1, np.uint8), (2, np.uint8), (3, np.uint8), (4, np.uint8), (3, np.uint16), (3, np.float32)]
)
def test_identical_frames_give_the_same_frame(method, channels, dtype):
    """At any time, in every type: the in-between image of a still is the still, but for colours nobody can see."""
    image = noise(36, 44, channels, dtype).copy()
    if channels in {2, 4}:
        image[..., -1] = image[..., -1].clip(1)  # what alpha hides may become black
    times = 0.25, Fraction(1, 3), 0.5
    for interpolated, _ in zip(methods[method].interpolate(image, image, times), times, strict=True):
        assert interpolated.dtype == dtype
        if method.startswith("farneback"):  # OpenCV's own motion of a still trembles a little at the frame's edge
            white = 1 if dtype is np.float32 else np.iinfo(dtype).max
            # nothing weighs it in the plain warp, and little alpha makes much of what is off
            most = 0.002 if method == "farneback-warp" else 0.001
            assert np.abs(interpolated.astype(float) - image).mean() < most * white
        else:
            np.testing.assert_allclose(interpolated, image, rtol=1e-6 if dtype is np.float32 else 0)


@every_method
def test_unlike_frames_are_refused(method):
    """Before anything is computed, also where no image is asked for."""
    image = noise(40, 48)
    for other in (noise(40, 47), noise(40, 48, 3, np.uint16), noise(40, 48, 1), image[..., 0]):
        with pytest.raises(InputError):
            methods[method].pair(*prepared(image, other))
        with pytest.raises(InputError):
            methods[method].interpolate(image, other, [])


@every_method
def test_times_outside_of_the_pair_are_refused(method):
    """Even next to good ones, and before the first image."""
    image = noise(40, 48)
    for t in (-0.1, 1.1, Fraction(-1, 1000), float("nan"), float("inf")):
        with pytest.raises(OptionError, match=r"\[0, 1\]"):
            methods[method].images(methods[method].pair(*prepared(image, image)), [0.5, t])


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@every_method
def test_tiny_frames_work(method, channels):
    """Down to a single pixel."""
    for size in ((1, 1), (3, 5), (1, 40), (33, 2)):
        image0, image1 = noise(*size, channels, seed=1), noise(*size, channels, seed=2)
        (image,) = methods[method].interpolate(image0, image1, [0.5])
        assert image.shape == (*size, channels)


@moving_methods
def test_a_translation_is_made_right(method):
    """The middle of a smooth pan, away from the edges: better than a tenth of what mixing the frames gives."""
    clip = affine(96, 128, shift=(6, -4), seed=3)
    inner = eroded(np.ones((96, 128), bool), 14)

    def error(name: str) -> float:
        (image,) = methods[name].interpolate(clip.image0, clip.image1, [0.5])
        return float(np.abs(image.astype(float) - clip.at(0.5))[inner].mean())

    assert error(method) < error("blend") / 10


@moving_methods
def test_swapped_frames_are_the_scene_backwards(method):
    """t one way is 1 - t the other way, but for ties and rounding."""
    clip = translation(64, 80, 4, -2, seed=5)
    interpolator = replace(methods[method], cuts=None)
    for t in (0.25, 0.5):
        (forward,) = interpolator.interpolate(clip.image0, clip.image1, [t])
        (backward,) = interpolator.interpolate(clip.image1, clip.image0, [1 - t])
        # a block at an edge that it leaves through has no place to be found at, and that is another edge backwards
        inner = slice(20, -20) if method == "block" else slice(12, -12)
        difference = np.abs(forward.astype(int) - backward)[inner, inner]
        # of noise, DIS finds vectors that differ a little everywhere, and alike ones join in the order they come
        assert (difference <= 1).mean() > (0.8 if method == "dis" else 0.98)
        assert difference.mean() < 1


def default(image0, image1, t=0.5):
    """The default's in-between image, whatever the cut detector thinks of a constructed scene."""
    return replace(methods["nlm"], cuts=None).interpolate(image0, image1, [t])[0]


def mixed(image0, image1, t=0.5):
    """The two images mixed."""
    return replace(methods["blend"], cuts=None).interpolate(image0, image1, [t])[0]


def off_by(image, truth):
    """The largest difference of a pixel's channels."""
    return np.abs(image.astype(float) - truth).max(axis=-1)


@pytest.mark.parametrize("background", [(0, 0), (-3, 1), (2.5, -1.5)])
@pytest.mark.parametrize("t", [0.25, 0.5, 0.75])
def test_what_crosses_a_background_is_wrong_only_along_its_outline(background, t):
    """13 pixels away, a patch and the distance of two vectors, all is right to 8 levels, and nearly all to 1."""
    clip = layers(120, 160, box=(40, 40, 84, 84), shift=(9, 5), background=background)
    off = off_by(default(clip.image0, clip.image1, t), clip.at(t))
    y, x = np.mgrid[0:120, 0:160]
    outside = np.maximum.reduce([40 + 9 * t - x, x - 84 - 9 * t, 40 + 5 * t - y, y - 84 - 5 * t])
    away = (np.abs(outside) > 13) & eroded(np.ones((120, 160), bool), 8)
    assert off[away].max() <= 8
    assert np.percentile(off[away], 99) <= 1
    assert off.mean() < off_by(mixed(clip.image0, clip.image1, t), clip.at(t)).mean() / 3


@pytest.mark.parametrize("t", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("shift", [(24, 0), (0, 20)])
def test_a_smooth_ball_that_jumps_is_seen_once_and_in_its_place(shift, t):
    """By more than its diameter, over what stands still: most of it is where it should be, the rest close by."""
    y, x = np.mgrid[0:128, 0:192].astype(float)
    behind = 0.15 + 0.35 * waves(x, y)

    def distance(t):
        return np.hypot(x - 80 - t * shift[0], y - 56 - t * shift[1])

    def at(t):
        share = (8.5 - distance(t)).clip(0, 1)[..., np.newaxis]
        return as_type(behind * (1 - share) + share * [0.2, 0.6, 1], np.uint8)

    made, truth = (
        np.abs(image - as_type(behind, np.uint8).astype(float)).sum(axis=-1)
        for image in (default(at(0), at(1), t), at(t))
    )
    near = distance(t) <= 12
    assert 0.6 < made[near].sum() / truth.sum() < 1.3
    assert made[~near].sum() / truth.sum() < 0.35
    for place, length in ((x, 0), (y, 1)):
        assert (made * place).sum() / made.sum() == pytest.approx((truth * place).sum() / truth.sum(), abs=2), length


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_colours_that_alpha_hides_do_not_bleed(dtype):
    """Around a green thing that is cut out of bright pink, nothing turns pink, nor does its shape change."""
    y, x = np.mgrid[0:96, 0:128].astype(float)

    def at(t):
        image = np.empty((96, 128, 4))
        image[..., :3] = (0.2 + 0.5 * waves(x - 8 * t, y, 1)) * [0.2, 1, 0.2]
        image[..., 3] = (x >= 30 + 8 * t) & (x < 70 + 8 * t) & (y >= 30) & (y < 66)
        image[image[..., 3] == 0, :3] = 1, 0, 1
        return as_type(image, dtype)

    made, truth, white = default(at(0), at(1)).astype(float), at(0.5).astype(float), np.iinfo(dtype).max
    assert made[made[..., 3] > 0][:, [0, 2]].max() <= 0.15 * white  # of 1 that pink has and 0.14 of the thing itself
    assert (np.abs(made[..., 3] - truth[..., 3]) > 0.02 * white).mean() < 0.001


def test_float_images_may_be_brighter_than_white():
    """Four times white is followed like white, and nothing becomes brighter than it was."""
    clip = affine(96, 128, shift=(5.3, -2.6), dtype=np.float32, seed=2)
    image0, image1, truth = (np.ascontiguousarray(4 * image) for image in (clip.image0, clip.image1, clip.at(0.5)))
    made, inner = default(image0, image1), slice(12, -12)
    assert off_by(made, truth)[inner, inner].mean() < 0.01
    assert made.max() <= max(image0.max(), image1.max())


@pytest.mark.filterwarnings("ignore:image0 has NaN")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_stays_in_its_place(value):
    """One such pixel spoils nothing further away than 24 pixels."""
    clip = affine(96, 128, shift=(5.3, -2.6), dtype=np.float32, seed=2)
    image0 = clip.image0.copy()
    image0[40, 60, 1] = value
    y, x = np.mgrid[0:96, 0:128]
    away = (np.maximum(np.abs(y - 40), np.abs(x - 60)) > 24) & eroded(np.ones((96, 128), bool), 12)
    off = off_by(default(image0, clip.image1), clip.at(0.5))[away]
    assert np.isfinite(off).all()
    assert off.max() < 0.05


def three_pairs(interpolator, **motion):
    """The pairs before, in and after the middle of an accelerating texture, and its truth at 1/2."""
    at = accelerating(96, 128, **motion)
    images = prepared(*(at(t) for t in (-1, 0, 1, 2)))
    return [interpolator.pair(*each) for each in pairwise(images)], at(0.5)


@pytest.mark.parametrize("motion", [((4, -2), (2, 1)), ((3, 1), (-2, 1.5)), ((6, 0), (3, 0))])
def test_neighbouring_pairs_bend_the_path(motion):
    """Where motion speeds up, slows down or turns, either neighbour brings the image nearer to the truth, or both."""
    nlm = replace(methods["nlm"], cuts=None)
    (before, pair, after), truth = three_pairs(nlm, velocity=motion[0], acceleration=motion[1])
    inner = slice(14, -14)
    straight, *bent = (
        off_by(next(nlm.images(pair.between(*neighbours), [0.5])).image, truth)[inner, inner].mean()
        for neighbours in ((None, None), (before, None), (None, after), (before, after))
    )
    assert max(bent[:2]) < straight * 0.5
    assert bent[2] < straight * 0.9


@plain_methods
def test_methods_that_go_straight_ignore_their_neighbours(method):
    """The report's method, what others do, and those without motion make the same image with neighbours and without."""
    (before, pair, after), _ = three_pairs(methods[method], velocity=(4, -2), acceleration=(2, 1))
    alone, among = (methods[method].images(each, [0.5]) for each in (pair, pair.between(before, after)))
    np.testing.assert_array_equal(next(alone).image, next(among).image)


def test_a_cut_is_no_neighbour():
    """A pair that a scene ends in tells nothing about the next one's motion."""
    (other,) = prepared(affine(96, 128, seed=9).image0)
    nlm = replace(methods["nlm"], cuts=CutsWhere(lambda *images: other in images))
    (before, pair, after), _ = three_pairs(nlm, velocity=(4, -2), acceleration=(2, 1))
    cut_before, cut_after = nlm.pair(other, pair.image0), nlm.pair(pair.image1, other)
    neighbours = [(None, None), (cut_before, cut_after), (before, None), (before, cut_after)]
    neighbours += [(None, after), (cut_before, after)]
    images = [next(nlm.images(pair.between(*each), [0.5])).image for each in neighbours]
    assert (images[0] != images[2]).any()
    for one, with_cut in zip(images[::2], images[1::2], strict=True):
        np.testing.assert_array_equal(one, with_cut)


def eventful(scene, dtype=np.uint8):
    """Four frames of a moving texture that gets darker, or has a title of thin strokes."""
    frames = []
    for t in range(4):
        colours = 0.15 + 0.6 * moved_waves((64, 112), 8 * t, -2 * t, seed=1)
        if scene == "fading":
            colours *= 1 - 0.25 * t
        else:
            for left in (40, 51, 66):
                colours[20:44, left : left + 2] = 1
        frames.append(as_type(colours, dtype))
    return frames


eventful_scenes = pytest.mark.parametrize("scene", ["fading", "titled"])


@every_method
@eventful_scenes
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_originals_and_the_order_of_times_survive_light_and_overlays(method, scene, dtype):
    """Frames at t = 0 and 1 come out to the bit, as copies; every image is where its time was, and as it is alone."""
    interpolator = replace(methods[method], cuts=None)
    frames = eventful(scene, dtype)
    _, pair, _ = with_neighbours(interpolator.pair(*each) for each in pairwise(prepared(*frames)))
    times = [1, 0.75, 0, Fraction(1, 4), 0.75, Fraction(1)]
    images = [image for image, _ in interpolator.images(pair, times)]
    assert len(images) == len(times)
    for t, image in zip(times, images, strict=True):
        assert image.dtype == dtype
        assert image.flags.writeable
        if t in {0, 1}:
            np.testing.assert_array_equal(image, frames[1 + int(t)])
            assert not np.shares_memory(image, frames[1 + int(t)])
        else:
            np.testing.assert_array_equal(image, next(interpolator.images(pair, [t])).image)
    np.testing.assert_array_equal(images[1], images[4])
    assert (images[1] != images[3]).any()


@eventful_scenes
@pytest.mark.parametrize("method", ["nlm", "dis-warp", "nlm-exhaustive", "block", "blend", "nearest"])
def test_confidence_belongs_to_the_image_that_interpolate_makes(scene, method):
    """Of two frames alone, by any method: the same image, and for every pixel a share."""
    image0, image1 = eventful(scene)[:2]
    fused = interpolate_with_confidence(image0, image1, 0.25, method=method)
    np.testing.assert_array_equal(fused.image, interpolate(image0, image1, 0.25, method=method))
    assert fused.confidence.shape == image0.shape[:2]
    assert 0 <= fused.confidence.min() <= fused.confidence.max() <= 1 + 1e-5


def test_cuts_repeat_the_nearer_frame_or_mix():
    """Repeated: the earlier one up to and at the middle. Mixed: as without motion."""
    image0, image1 = affine(60, 80, seed=1).image0, affine(60, 80, seed=2).image0
    times = [0.25, Fraction(1, 2), 0.75, 1]
    nlm = methods["nlm"]
    pair = nlm.pair(*prepared(image0, image1))
    assert pair.is_cut
    np.testing.assert_array_equal([image for image, _ in nlm.images(pair, times)], [image0, image0, image1, image1])
    with pytest.warns(SceneCutWarning, match="mixed"):
        mixed = replace(nlm, at_cuts="blend").interpolate(image0, image1, [0.5], cuts=CutDetector())
    uncut = replace(methods["blend"], cuts=None).interpolate(image0, image1, [0.5])
    np.testing.assert_array_equal(mixed, uncut)
    assert np.abs(mixed[0] - (image0 / 2 + image1 / 2)).max() <= 0.5


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_at_cuts_each_scene_can_go_on_by_itself(dtype):
    """Up to the middle the first scene moves on as it did before, then the second comes as it will go after."""
    first, second = (affine(60, 80, shift=(6, -4), seed=seed, dtype=dtype) for seed in (1, 2))
    nlm = replace(methods["nlm"], at_cuts="extrapolate")
    images = prepared(first.image0, first.image1, second.image0, second.image1)
    before, pair, after = (nlm.pair(*each) for each in pairwise(images))
    among = pair.between(before, after)
    made = nlm.images(among, [0.5, 0.75])
    assert among.is_cut
    inner = slice(12, -12)
    white = 1 if dtype is np.float32 else 255
    for (image, _), truth, repeated in zip(
        made, (first.at(1.5), second.at(-0.25)), (first.image1, second.image0), strict=True
    ):
        assert image.dtype == dtype
        off, still = (np.abs(each.astype(float) - truth)[inner, inner].mean() for each in (image, repeated))
        assert off < min(0.3 * still, 0.01 * white)
    alone = [image for image, _ in nlm.images(pair, [0.25, 0.75])]
    for image, original in zip(alone, (first.image1, second.image0), strict=True):
        np.testing.assert_allclose(image, original, atol=1e-6)


def test_at_cuts_no_scene_goes_on_for_longer_than_is_known():
    """Where a cut follows after a long pause, the scene moves on by its last motion once, and not 13 times."""
    first, second = affine(60, 80, shift=(6, -4), seed=1), affine(60, 80, seed=2)
    nlm = replace(methods["nlm"], at_cuts="extrapolate")
    images = prepared(first.image0, first.image1, second.image0)
    before, pair = (nlm.pair(*each, duration) for each, duration in zip(pairwise(images), (1, 26), strict=True))
    ((image, _),) = nlm.images(pair.between(before, None), [0.5])
    assert np.abs(image.astype(float) - first.at(2))[12:-12, 12:-12].mean() < 2.55


def test_a_flash_is_no_cut_and_nothing_moves_across_it():
    """The scene goes on behind a frame burnt out, which is repeated; where it does not, that is a cut."""
    clip = affine(60, 80, shift=(3, -2), seed=1)
    burnt, other = np.full_like(clip.image0, 255), affine(60, 80, seed=2).image0
    nlm = methods["nlm"]
    for last, expected in ((clip.image1, False), (other, True)):
        first, second = (nlm.pair(*prepared(*each)) for each in pairwise((clip.image0, burnt, last)))
        for pair, pictures in zip(with_neighbours([first, second]), [(clip.image0, burnt), (burnt, last)], strict=True):
            assert pair.is_cut == expected
            made = nlm.images(pair, [0.25, 0.75])
            np.testing.assert_array_equal([image for image, _ in made], pictures)


@pytest.mark.parametrize("method", ["nlm-fast", "nlm-exhaustive", "blend"])
def test_two_images_are_never_repeated_unless_asked(method):
    """Not even two that have nothing in common; who asks for cuts is told in a warning, where something was made."""
    image0, image1 = affine(60, 80, seed=1).image0, affine(60, 80, seed=2).image0
    made = interpolate(image0, image1, method=method)
    assert (made != image0).any()
    assert (made != image1).any()
    with pytest.warns(SceneCutWarning, match="nearer one was repeated"):
        repeated = interpolate(image0, image1, method=method, cuts=CutDetector())
    np.testing.assert_array_equal(repeated, image0)
    np.testing.assert_array_equal(interpolate(image0, image1, 1, method=method, cuts=CutDetector()), image1)


def test_options_reach_the_estimator_and_the_synthesizer():
    """By field name: numbers, choices, and a field that may be None; what is not named stays."""
    changed = find_method("nlm-exhaustive:search-radius=7,window=gaussian,v=0.05,search=brute-force,iterations=3")
    assert changed.estimator == ExhaustiveSearch(search_radius=7, window="gaussian", v=0.05)
    assert changed.synthesizer == Reproject("brute-force", 3)
    assert changed.cuts == CutDetector()
    assert find_method("nlm:v=0.1").estimator == replace(methods["nlm"].estimator, v=0.1)
    assert methods["nlm-exhaustive"].estimator == ExhaustiveSearch()


def test_one_image_is_one_call():
    """Gray images without a channel axis, views, names and objects; the shape comes back."""
    clip = translation(40, 48, 4, 2, channels=1)
    gray = interpolate(clip.image0[..., 0], clip.image1[..., 0], 0.5)
    assert gray.shape == (40, 48)
    np.testing.assert_array_equal(gray[..., np.newaxis], interpolate(clip.image0, clip.image1))
    flipped = interpolate(clip.image0[::-1], clip.image1[::-1], 0.5, method=methods["blend"])
    np.testing.assert_array_equal(flipped[::-1], interpolate(clip.image0, clip.image1, 0.5, method="blend"))
