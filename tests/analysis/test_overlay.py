"""Titles and logos stay as they are in front of a moving picture, and nothing else does."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fpsboost import Coding, methods, with_neighbours
from fpsboost.analysis.overlay import BLOCK_SIZE, DILATION_SIZE, find_overlay
from fpsboost.io.video.ycc import bgr_of, from_bgr, in_planes
from support.truth import CutsWhere, as_type, equal_luma, moved_waves, noise, prepared, waves, white_of

KEEPING = replace(methods["nlm"], cuts=None)
MOVING = replace(KEEPING, overlays=False)

SIZE = 96, 160


def letters(thick=2):
    """Four letters H of thin strokes, further from the frame's sides than a block."""
    mask = np.zeros(SIZE, bool)
    for x in (36, 59, 82, 105):
        mask[32:64, x : x + thick] = mask[32:64, x + 9 : x + 9 + thick] = mask[48 : 48 + thick, x : x + 9] = True
    return mask


def panning(shift, overlay=None, colour=1.0, *, channels=3, dtype=np.uint8, seed=1):
    """A textured background that moves, at any time, and what stands still in front of it."""

    def at(t):
        colours = 0.15 + 0.55 * moved_waves(SIZE, t * shift[0], t * shift[1], channels, seed)
        if overlay is not None:
            colours[overlay] = colour
        return as_type(colours, dtype)

    return at


def three_pairs(at):
    """Before, in and after the first interval."""
    return [KEEPING.pair(*each) for each in pairwise(prepared(*(at(t) for t in (-1, 0, 1, 2))))]


def kept_and_moved(at, t=0.5):
    """The image at t with overlays kept, and without; with word of both neighbours."""
    _, pair, _ = with_neighbours(three_pairs(at))
    return [next(each.images(pair, [t])).image for each in (KEEPING, MOVING)]


def found(at):
    """The overlay of the first interval, all False if there is none."""
    before, pair, after = three_pairs(at)
    overlay = find_overlay(pair.image0, pair.image1, before.image0, after.image1, pair.fields[0])
    return np.zeros(pair.image0.pixels.shape[:2], bool) if overlay is None else overlay


def off_by(image, truth):
    """The largest difference of a pixel's channels, levels of 255."""
    return np.abs(image.astype(float) - truth).max(axis=-1) * 255 / white_of(image)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("colour", [1.0, 0.0])
@pytest.mark.parametrize(
    ("thick", "shift", "otherwise"), [(2, 6, 1), (2, 12, 25), (2, -12, 25), (3, 6, 0.1), (3, 12, 1)]
)
def test_thin_letters_stay(thick, shift, otherwise, colour, seed):
    """Right to half a level on average where they would be off by up to 50, and the rest is as it was, to the bit."""
    mask = letters(thick)
    at = panning((shift, 0), mask, colour, seed=seed)
    (kept, moved), overlay = kept_and_moved(at), found(at)
    error, error_moved = (off_by(image, at(0.5)) for image in (kept, moved))
    assert error_moved[mask].mean() > otherwise
    assert error[mask].mean() < min(0.5, error_moved[mask].mean() / 10)
    np.testing.assert_array_equal(kept[~overlay], moved[~overlay])
    assert overlay[mask].mean() > 0.95
    assert (overlay & ~mask).mean() < 0.01
    assert error[~mask].mean() < error_moved[~mask].mean() + 0.25


@pytest.mark.parametrize(
    ("channels", "dtype"), [(1, np.uint8), (2, np.uint8), (4, np.uint8), (3, np.uint16), (3, np.float32)]
)
def test_letters_stay_in_every_type(channels, dtype):
    """Gray, with alpha, deep and float; the same pixels are found in all that have the same colours."""
    mask = letters()
    at = panning((12, 0), mask, channels=channels, dtype=dtype)
    kept, moved = kept_and_moved(at)
    assert (kept.dtype, kept.shape) == (dtype, at(0).shape)
    assert off_by(kept, at(0.5))[mask].mean() < 0.5
    assert off_by(moved, at(0.5))[mask].mean() > 1
    if channels == 3:
        assert (found(at) != found(panning((12, 0), mask))).mean() < 0.001


@pytest.mark.parametrize("coding", [None, Coding(8, 1, False, "left", "yuv420p")], ids=["BGR", "planes"])
def test_letters_of_the_luma_of_their_background_stay(coding):
    """Magenta in front of shades of green that move, all of one gray level."""
    mask = letters(4)

    def at(t):
        colours = np.where(mask, 0.35, -0.45 + 0.4 * moved_waves(SIZE, 12 * t, 0, 1)[..., 0])
        image = as_type(equal_luma(colours, colours), np.uint8)
        return in_planes(from_bgr(image, coding.pixel_format, 6, False), coding) if coding else image

    assert found(at)[mask].mean() > 0.6


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuvj420p", "yuv420p10le"])
def test_letters_stay_in_planes(pixel_format):
    """Of video, by its luma in any range and depth: nearly the pixels that are found in the same pictures as BGR."""
    mask = letters()
    in_bgr = panning((12, 0), mask)
    coding = Coding(10 if "10" in pixel_format else 8, 1, "j" in pixel_format, "left", pixel_format)

    def in_planes_at(t):
        return in_planes(from_bgr(in_bgr(t), pixel_format, 1, coding.full_range), coding)

    overlay = found(in_planes_at)
    assert overlay[mask].mean() > 0.95
    assert (overlay != found(in_bgr)).mean() < 0.005
    kept, moved = kept_and_moved(in_planes_at)
    luma, white = in_planes_at(0.5).planes[0][mask].astype(float), coding.levels.luma_span
    assert np.abs(kept.planes[0][mask] - luma).mean() < 0.5 * white / 255
    assert np.abs(moved.planes[0][mask] - luma).mean() > 8 * white / 255


def test_dark_letters_pass_for_no_change_of_light():
    """They stay in planes, which a local change of light would make BGR."""
    mask = letters(3)
    in_bgr = panning((12, 0), mask, 0.0, seed=4)
    coding = Coding(8, 1, False, "left", "yuv420p", bgr_of)

    def in_planes_at(t):
        return in_planes(from_bgr(in_bgr(t), "yuv420p", 1, coding.full_range), coding)

    assert three_pairs(in_planes_at)[1].illumination is None
    kept, moved = kept_and_moved(in_planes_at)
    luma = in_planes_at(0.5).planes[0][mask].astype(float)
    assert np.abs(kept.planes[0][mask] - luma).mean() < 0.5 < np.abs(moved.planes[0][mask] - luma).mean()


@pytest.mark.parametrize("with_letters", [False, True])
def test_in_a_still_clip_there_is_no_overlay(with_letters):
    """Nothing moves that anything could stand still in front of."""
    at = panning((0, 0), letters() if with_letters else None)
    assert not found(at).any()
    np.testing.assert_array_equal(kept_and_moved(at), [at(0)] * 2)


@pytest.mark.parametrize("texture", ["smooth", "flat", "noise"])
@pytest.mark.parametrize(("width", "speed", "lean"), [(2, 12, 0), (3, 20, 0.4), (4, 8, 0), (3, 6, 1)])
def test_a_fast_thin_line_is_not_erased(width, speed, lean, texture):
    """Although the background that it crosses is the same in all four frames, no pixel is taken for an overlay."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    textures = {"smooth": 0.15 + 0.55 * waves(x, y, seed=3), "flat": 0.4, "noise": noise(*SIZE, dtype=np.float32)}

    def at(t):
        behind = x - (60 + speed * t + lean * (y - SIZE[0] / 2))
        covered = (behind >= 0) & (behind < width)
        return as_type(np.where(covered[..., np.newaxis], 0.95, textures[texture]) * np.ones(3), np.uint8)

    assert not found(at).any()
    np.testing.assert_array_equal(*kept_and_moved(at))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_slats_that_move_by_their_distance_are_no_overlay(seed):
    """Their gaps are dark in the same places of all frames; boards are seen to move unless they leave the picture."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]

    def at(t):
        boards = 0.6 + 0.35 * moved_waves(SIZE, 0, 14 * t, 3, seed)
        slats = np.where(((y - 14 * t) % 14 < 4)[..., np.newaxis], 0.05, boards)
        surroundings = 0.15 + 0.55 * moved_waves(SIZE, 0, 5 * t, 3, seed + 10)
        return as_type(np.where((abs(x - 80) < 32)[..., np.newaxis], slats, surroundings), np.uint8)

    stays_inside = np.s_[: SIZE[0] - BLOCK_SIZE]
    assert not found(at)[stays_inside].any()
    kept, moved = kept_and_moved(at)
    np.testing.assert_array_equal(kept[stays_inside], moved[stays_inside])


def test_neighbours_in_another_scene_tell_nothing():
    """Across a cut there is no neighbour."""
    images = prepared(*(panning((12, 0), letters())(t) for t in (-1, 0, 1, 2)))
    interpolator = replace(KEEPING, cuts=CutsWhere(lambda *two: list(two) != images[1:3]))
    before, pair, after = (interpolator.pair(*each) for each in pairwise(images))
    assert [each.is_cut for each in (before, pair, after)] == [True, False, True]
    among, alone = (next(interpolator.images(each, [0.5])) for each in (pair.between(before, after), pair))
    np.testing.assert_array_equal(among.image, alone.image)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_no_overlay(value):
    """A few broken pixels in the same place of every frame get into no frame in between, as without overlays."""
    pan = panning((6, 0), dtype=np.float32)

    def at(t):
        image = pan(t).copy()
        image[40:43, 80:83] = value
        return image

    assert np.isfinite(kept_and_moved(at)).all()


def test_a_pixel_on_its_own_is_no_overlay():
    """Chance makes single pixels stay: two of them side by side are none either, three are."""
    mask = np.zeros(SIZE, bool)
    mask[40, 50] = mask[40, 80:82] = True
    assert not found(panning((12, 0), mask, seed=2)).any()
    mask[41, 80] = True
    overlay = found(panning((12, 0), mask, seed=2))
    assert overlay[mask].tolist() == [False, True, True, True]
    y, x = np.argwhere(overlay).T
    assert np.abs(y - 40.5).max() <= 0.5 + DILATION_SIZE // 2
    assert np.abs(x - 80.5).max() <= 0.5 + DILATION_SIZE // 2
