"""Every method through the same contract: a pair and times in, images out."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from truth import affine, eroded, moving_object, noise, translation

import fpsboost
from fpsboost.errors import InputError, OptionError
from fpsboost.interpolator import Interpolator, configure, find_method, interpolate, methods
from fpsboost.motion.exhaustive import ExhaustiveSearch
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Still
from fpsboost.scenes import CutDetector
from fpsboost.synthesis.blend import Nearest
from fpsboost.synthesis.reproject import Reproject

every_method = pytest.mark.parametrize("method", methods)
moving_methods = pytest.mark.parametrize("method", ["nlm", "nlm-exhaustive", "dis", "farneback"])


@every_method
@pytest.mark.parametrize(
    ("channels", "dtype"), [(1, np.uint8), (3, np.uint8), (4, np.uint8), (3, np.uint16), (3, np.float32)]
)
def test_identical_frames_give_the_same_frame(method, channels, dtype):
    """At any time, in every type: the in-between image of a still is the still."""
    image = noise(36, 44, channels, dtype)
    image = image if dtype is np.uint8 else image.copy()
    for made in methods[method].interpolate(image, image, [0.25, Fraction(1, 3), 0.5]):
        assert made.dtype == dtype
        if method == "farneback":  # OpenCV's own motion of a still trembles a little at the frame's edge
            white = 1 if dtype is np.float32 else np.iinfo(dtype).max
            assert np.abs(made.astype(float) - image).mean() < 0.001 * white
        else:
            np.testing.assert_allclose(made, image, rtol=1e-6 if dtype is np.float32 else 0)


@every_method
def test_the_ends_are_the_frames_themselves(method):
    """t = 0 and t = 1 give frame 0 and frame 1, unchanged, as copies, in any order and among other times."""
    clip = translation(40, 48, 3, 2)
    start, middle, end, again = methods[method].interpolate(clip.image0, clip.image1, [0, 0.5, Fraction(1), 0.0])
    np.testing.assert_array_equal(start, clip.image0)
    np.testing.assert_array_equal(again, clip.image0)
    np.testing.assert_array_equal(end, clip.image1)
    assert middle.shape == clip.image0.shape
    assert start.flags.writeable
    assert not np.shares_memory(start, clip.image0)


@every_method
def test_several_times_at_once_equal_one_at_a_time(method):
    """No time knows of another, and no state is kept between calls."""
    clip = affine(40, 48, shift=(3, 1))
    times = [0.2, Fraction(1, 2), 0.9]
    together = methods[method].interpolate(clip.image0, clip.image1, times)
    for t, image in zip(times, together, strict=True):
        np.testing.assert_array_equal(methods[method].interpolate(clip.image0, clip.image1, [t]), [image])


@every_method
def test_no_times_give_no_images(method):
    """An empty list for an empty list."""
    image = noise(40, 48)
    assert methods[method].interpolate(image, image, []) == []


@every_method
def test_unlike_frames_are_refused(method):
    """Before anything is computed, also where no image is asked for."""
    image = noise(40, 48)
    for other in (noise(40, 47), noise(40, 48, 3, np.uint16), noise(40, 48, 1), image[..., 0]):
        with pytest.raises(InputError):
            methods[method].between(image, other, [])
    with pytest.raises(InputError, match="float64"):
        methods[method].interpolate(image / 255.0, image / 255.0, [0.5])


@every_method
@pytest.mark.parametrize("t", [-0.1, 1.1, Fraction(-1, 1000), float("nan"), float("inf")])
def test_times_outside_of_the_pair_are_refused(method, t):
    """Even next to good ones, and before the first image."""
    image = noise(40, 48)
    with pytest.raises(OptionError, match=r"\[0, 1\]"):
        methods[method].between(image, image, [0.5, t])


@every_method
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (1, 40), (33, 2)])
def test_tiny_frames_work(method, size):
    """Down to a single pixel."""
    for channels in (1, 3, 4):
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


@pytest.mark.parametrize("method", ["nlm", "nlm-exhaustive"])
def test_whole_motion_of_noise_is_made_exactly(method):
    """The default and the report's method copy a whole-pixel translation, but for the frame's edge."""
    clip = translation(80, 96, 6, -4, seed=3)
    # noise does not survive the thumbnails of the cut detector
    (image,) = replace(methods[method], cuts=None).interpolate(clip.image0, clip.image1, [0.5])
    inner = eroded(np.ones((80, 96), bool), 14)
    np.testing.assert_array_equal(image[inner], clip.at(0.5)[inner])


@pytest.mark.parametrize("method", ["nlm", "nlm-exhaustive"])
def test_an_object_over_a_background_goes_wrong_only_near_its_outline(method):
    """The rest of the frame is exact."""
    clip = moving_object(96, 120, box=(30, 34, 70, 74), dx=8, dy=4)
    (image,) = methods[method].interpolate(clip.image0, clip.image1, [0.5])
    wrong = (image != clip.at(0.5)).any(axis=-1)
    near = np.zeros((96, 120), bool)
    near[19:86, 23:94] = True  # all that it touches, and the patch and the search around it
    near[44:60, 50:66] = False  # the inside of the object at the middle
    assert not wrong[~near].any()
    assert wrong.mean() < 0.2


@moving_methods
def test_swapped_frames_are_the_scene_backwards(method):
    """t one way is 1 - t the other way, but for ties and rounding."""
    clip = translation(64, 80, 4, -2, seed=5)
    interpolator = replace(methods[method], cuts=None)
    for t in (0.25, 0.5):
        (forward,) = interpolator.interpolate(clip.image0, clip.image1, [t])
        (backward,) = interpolator.interpolate(clip.image1, clip.image0, [1 - t])
        inner = slice(12, -12)
        difference = np.abs(forward.astype(int) - backward)[inner, inner]
        assert (difference <= 1).mean() > 0.98


def test_cuts_repeat_the_nearer_frame_or_mix():
    """Repeated: the earlier one up to and at the middle. Mixed: as without motion."""
    image0, image1 = affine(60, 80, seed=1).image0, affine(60, 80, seed=2).image0
    times = [0.25, Fraction(1, 2), 0.75, 1]
    repeated = methods["nlm"].between(image0, image1, times)
    assert repeated.scene_cut
    np.testing.assert_array_equal(list(repeated.images), [image0, image0, image1, image1])
    mixed = replace(methods["nlm"], at_cuts="blend").interpolate(image0, image1, [0.5])
    uncut = replace(methods["blend"], cuts=None).interpolate(image0, image1, [0.5])
    np.testing.assert_array_equal(mixed, uncut)
    assert np.abs(mixed[0] - (image0 / 2 + image1 / 2)).max() <= 0.5


def test_within_a_scene_nothing_is_cut():
    """A pan is one scene, and without a detector everything is."""
    clip = affine(60, 80, shift=(5, 2))
    assert not methods["nlm"].between(clip.image0, clip.image1, [0.5]).scene_cut
    other = affine(60, 80, seed=2).image0
    assert not replace(methods["nlm"], cuts=None).between(clip.image0, other, [0.5]).scene_cut


def test_motion_is_estimated_once_a_pair_and_only_if_needed():
    """Ends and cuts need none."""

    class Counting:
        calls = 0

        def estimate(self, image0, image1):
            self.calls += 1
            return Still().estimate(image0, image1)

    estimator = Counting()
    counting = Interpolator(estimator, Nearest())
    image0, image1 = affine(60, 80, seed=1).image0, affine(60, 80, seed=2).image0
    counting.interpolate(image0, image0, [0, 1])
    counting.interpolate(image0, image1, [0.5])
    assert estimator.calls == 0
    counting.interpolate(image0, image0, [0.25, 0.5, 0.75])
    assert estimator.calls == 1


def test_options_reach_the_estimator_and_the_synthesizer():
    """By field name; what is not named stays."""
    options = {"search_radius": 7, "window": "gaussian", "search": "brute-force", "iterations": 3}
    changed = configure(methods["nlm-exhaustive"], "nlm-exhaustive", options)
    assert changed.estimator == ExhaustiveSearch(search_radius=7, window="gaussian")
    assert changed.synthesizer == Reproject("brute-force", 3)
    assert changed.cuts == CutDetector()
    assert configure(methods["nlm"], "nlm", {}) == methods["nlm"]
    assert configure(methods["nlm"], "nlm", {"v": 0.1}).estimator == CoarseToFine(v=0.1)
    assert methods["nlm-exhaustive"].estimator == ExhaustiveSearch()


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("nlm", {"search_radius": 7}, "--search-radius does not apply to the method 'nlm'"),
        ("blend", {"patch_radius": 3}, "--patch-radius does not apply"),
        ("dis", {"cuts": None}, "--cuts does not apply"),
        ("nlm", {"patch_radius": 99}, "--patch-radius must be"),
        ("nlm-exhaustive", {"iterations": 0}, "iterations must be"),
    ],
)
def test_options_of_other_methods_and_bad_values_are_refused(method, options, message):
    """With the name of the option as the command line knows it."""
    with pytest.raises(OptionError, match=message):
        configure(methods[method], method, options)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Reproject(search="magic"), "search"),
        (lambda: replace(methods["nlm"], at_cuts="fade"), "at"),
        (lambda: CutDetector(thumbnail_side=0), "thumbnail"),
    ],
)
def test_values_that_mean_nothing_are_refused(make, name):
    """Nothing falls back silently."""
    with pytest.raises(OptionError, match=name):
        make()


def test_unknown_methods_are_refused():
    """The message lists the known ones."""
    with pytest.raises(OptionError, match="nlm, nlm-exhaustive, dis, farneback, blend, nearest"):
        find_method("magic")
    with pytest.raises(OptionError, match="magic"):
        interpolate(noise(8, 8), noise(8, 8), method="magic")


def test_methods_cannot_be_changed_by_accident():
    """The table is read-only and its entries are frozen."""
    with pytest.raises(TypeError):
        methods["mine"] = methods["nlm"]
    with pytest.raises(AttributeError):
        methods["nlm"].cuts = None
    assert fpsboost.methods is methods


def test_one_image_is_one_call():
    """Gray images without a channel axis, views, names and objects; the shape comes back."""
    clip = translation(40, 48, 4, 2, channels=1)
    gray = interpolate(clip.image0[..., 0], clip.image1[..., 0], 0.5)
    assert gray.shape == (40, 48)
    np.testing.assert_array_equal(gray[..., np.newaxis], interpolate(clip.image0, clip.image1))
    flipped = interpolate(clip.image0[::-1], clip.image1[::-1], 0.5, method=methods["blend"])
    np.testing.assert_array_equal(flipped[::-1], interpolate(clip.image0, clip.image1, 0.5, method="blend"))
    with pytest.raises(InputError):
        interpolate(clip.image0[..., 0], clip.image1)


@every_method
@pytest.mark.parametrize("channels", [1, 3])
def test_kernels_can_be_compiled_before_they_are_needed(method, channels):
    """Any image of the clip will do, however small, and stays as it is."""
    image = np.full((2, 3, channels), 7, np.uint8)
    methods[method].compile_for(image)
    assert (image == 7).all()
