"""Pictures of video in their own planes: what they mean, and that methods make of them what they make of BGR."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from fpsboost import Coding, Encoding, Frame, FrameCache, InputError, convert, methods, with_neighbours
from fpsboost.analysis.duplicates import DuplicateDetector
from fpsboost.image import YCbCrImage, view
from fpsboost.image_checks import check_pair
from fpsboost.io.video.source import VideoSource
from fpsboost.io.video.ycc import PLANAR_FORMATS, bgr_of, in_planes, picture_of
from fpsboost.motion.components import contrast_components, contrast_planes, gray, small_copy
from fpsboost.motion.nlm import pyramid
from support.truth import affine
from support.video_truth import pictures_of, planar, samples_of, write_clip

METHODS = sorted(name for name, method in methods.items() if method.takes_planes)
FORMATS = ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le", "yuvj420p"]
LOSSLESS = Encoding(lossless=True, preset="ultrafast")


def smooth(size: tuple[int, int] = (72, 96), **motion: float) -> list[np.ndarray]:
    """Two frames whose chroma loses nothing by half the size."""
    clip = affine(*size, **(motion or {"shift": (5, -3)}))
    return [clip.image0, clip.image1]


@pytest.mark.parametrize("pixel_format", sorted(PLANAR_FORMATS))
def test_a_picture_comes_back_from_its_planes(pixel_format):
    """Every sample, of odd sizes, too; and the shape is that of its BGR."""
    bits = int(pixel_format.rpartition("p")[2].removesuffix("le") or 8)
    coding = Coding(bits, 1, pixel_format.startswith("yuvj"), "left", pixel_format)
    random = np.random.default_rng(0)
    height, width = 35, 51
    down, across = {"420": (2, 2), "422": (1, 2), "444": (1, 1)}[
        pixel_format.removeprefix("yuvj").removeprefix("yuv")[:3]
    ]
    half = -(-height // down), -(-width // across)
    dtype = np.uint8 if bits == 8 else np.uint16
    planes = tuple(random.integers(0, 2**bits, size).astype(dtype) for size in ((height, width), half, half))
    image = YCbCrImage(planes, coding)
    assert image.shape == (height, width, 3)
    assert image.subsampling == (down, across)
    assert image.dtype == dtype
    for before, after in zip(image.planes, in_planes(picture_of(image), coding).planes, strict=True):
        np.testing.assert_array_equal(before, after)
        assert after.flags.c_contiguous
    assert bgr_of(image).shape == (height, width, 3)


@pytest.mark.parametrize("location", ["left", "center", "bottomleft"])
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_planes_without_a_library_become_bgr(pixel_format, location):
    """As FFmpeg converts them, to 1 % of white on average, wherever chroma lies."""
    image = planar(smooth()[0], pixel_format, location)
    converted, expected = image.to_bgr(), bgr_of(image)
    assert converted.dtype == expected.dtype
    assert np.abs(converted.astype(float) - expected).mean() < 0.01 * np.iinfo(expected.dtype).max


@pytest.mark.parametrize("pixel_format", FORMATS)
def test_what_motion_is_looked_for_in_is_that_of_bgr(pixel_format):
    """Luma, its contrast, mean chroma, thumbnails and halves: to the levels that rounding and chroma's size cost."""
    of_planes = planar(smooth()[0], pixel_format)
    of_array = bgr_of(of_planes)
    assert np.abs(gray(of_planes).astype(int) - gray(of_array)).max() <= 20  # the matrix of luma is another
    assert np.abs(small_copy(of_planes, 40) - small_copy(of_array, 40)).mean() < 0.02
    for level, same in zip(pyramid(of_planes, 20), pyramid(of_array, 20), strict=True):
        assert level.pixels.shape == same.pixels.shape
        components, expected = (contrast_components(each.pixels) for each in (level, same))
        assert np.abs(components - expected).mean() < 0.02
        height, width = level.pixels.shape[:2]
        inside = slice(48, 48 + height), slice(48, 48 + width)
        levels = contrast_planes(level.pixels, 48, 0.09).transpose(1, 2, 0)[inside]
        expected = (components * 255 + [0, 128, 0]).clip(0, 255)
        np.testing.assert_allclose(levels[..., :2], expected[..., :2], atol=0.6)
        assert np.abs(levels[..., 2] - expected[..., 2]).mean() < 5


@pytest.mark.parametrize("bits", [8, 10, 16])
@pytest.mark.parametrize("full_range", [False, True])
def test_levels_have_their_meaning(bits, full_range):
    """Black, white and gray of the standard are 0, 255 and 128 of gray, and 255 levels apart in differences."""
    coding = Coding(bits, 1, full_range, "left", "yuv444p" if bits == 8 else f"yuv444p{bits}le")
    unit = 2 ** (bits - 8)
    codes = [0, 2 ** (bits - 1), 2**bits - 1] if full_range else [16 * unit, 126 * unit, 235 * unit]
    dtype = np.uint8 if bits == 8 else np.uint16
    y = np.array([[*codes, 0]], dtype)
    image = YCbCrImage((y, *(np.full_like(y, 128 * unit) for _ in range(2))), coding)
    np.testing.assert_allclose(gray(image)[0, [0, 1, 2]], [0, 128, 255], atol=1)
    assert gray(image)[0, 3] == 0
    frame = FrameCache(image)
    black = FrameCache(replace(image, planes=(np.full_like(y, codes[0]), *image.planes[1:])))
    assert DuplicateDetector(block=1).difference(black, frame) == pytest.approx(255, abs=0.01)
    np.testing.assert_allclose(small_copy(image, 4)[0, :3], np.outer([0, 0.5, 1], [1, 1, 1]), atol=0.01)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_made_images_are_those_of_bgr(method, pixel_format):
    """In planes from the beginning to the end, and by way of BGR: the same to a few levels, at odd sizes, too."""
    frames = [planar(image, pixel_format) for image in smooth((63, 95), shift=(4.5, 2))]
    ((made, _),) = methods[method].images(pair_of(method, *frames), [0.5])
    assert isinstance(made, YCbCrImage)
    assert made.coding == frames[0].coding
    ((expected, _),) = methods[method].images(pair_of(method, *map(bgr_of, frames)), [0.5])
    white = np.iinfo(frames[0].dtype).max
    apart = np.abs(bgr_of(made).astype(float) - expected)[8:-8, 8:-8] / white
    assert apart.mean() < 0.006
    assert np.percentile(apart, 99) < 0.04


def pair_of(method: str, image0: object, image1: object) -> object:
    """A pair of frames."""
    return methods[method].pair(FrameCache(image0), FrameCache(image1))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_what_stands_still_stays_as_it_is(method, pixel_format):
    """Every sample of every plane, of a picture full of noise."""
    noise = np.random.default_rng(1).integers(60, 200, (48, 66, 3), dtype=np.uint8)
    image = planar(noise, pixel_format)
    for t in (0.25, 0.5):
        ((made, _),) = methods[method].images(pair_of(method, image, image.copy()), [t])
        for plane, expected in zip(made.planes, image.planes, strict=True):
            np.testing.assert_array_equal(plane, expected)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p"])
@pytest.mark.parametrize("size", [(1, 1), (5, 1), (2, 2), (3, 3)])
def test_tiny_pictures_have_pictures_between_them(method, pixel_format, size):
    """Also where half the size is the size."""
    frames = [planar(np.full((*size, 3), level, np.uint8), pixel_format) for level in (100, 120)]
    ((made, _),) = methods[method].images(pair_of(method, *frames), [0.5])
    in_planes_still = made if isinstance(made, YCbCrImage) else planar(made, pixel_format)
    for plane, *ends in zip(in_planes_still.planes, *(frame.planes for frame in frames), strict=True):
        assert plane.shape == ends[0].shape
        assert (plane >= np.minimum(*ends) - 1).all()
        assert (plane <= np.maximum(*ends) + 1).all()


@pytest.mark.parametrize("at_cuts", ["repeat", "blend", "extrapolate"])
def test_cuts_are_treated_in_planes(at_cuts):
    """Repeated and mixed as they are; what goes on along its motion becomes BGR."""
    random = np.random.default_rng(2)
    same = [planar(image) for image in smooth((72, 96), shift=(3, 0))]
    other = planar(random.integers(0, 256, (72, 96, 3), dtype=np.uint8))
    nlm = replace(methods["nlm"], at_cuts=at_cuts)
    frames = [FrameCache(image) for image in (*same, other, other.copy())]
    pairs = [nlm.pair(first, second) for first, second in pairwise(frames)]
    assert [pair.is_cut for pair in with_neighbours(pairs)] == [False, True, False]
    ((made, _),) = nlm.images(pairs[1].between(pairs[0], pairs[2]), [0.25])
    assert isinstance(made, YCbCrImage) == (at_cuts != "extrapolate")
    if at_cuts == "repeat":
        np.testing.assert_array_equal(made.planes[0], same[1].planes[0])


def test_light_that_changes_is_followed_by_way_of_bgr():
    """A fade between two frames is made as it is of arrays, as an array."""
    image0, image1 = (image.astype(float) for image in smooth())
    frames = [planar(np.rint(image).astype(np.uint8)) for image in (image0 * 0.5, image1)]
    pair = pair_of("nlm", *frames)
    assert pair.illumination is not None
    ((made, _),) = methods["nlm"].images(pair, [0.5])
    ((expected, _),) = methods["nlm"].images(pair_of("nlm", *map(bgr_of, frames)), [0.5])
    assert np.abs(view(made).array().astype(int) - expected).mean() < 2


def test_pictures_of_different_coding_are_refused():
    """And what works on arrays only says so."""
    image = planar(smooth()[0])
    other = replace(image, coding=replace(image.coding, full_range=True))
    with pytest.raises(InputError, match="must be alike"):
        check_pair(image, other)
    with pytest.raises(InputError, match="must be an array"):
        assert Frame(image, Fraction(0)).array is not None


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le"])
def test_conversions_stay_in_planes(tmp_path, pixel_format):
    """Without loss, what was read is what is written, and made frames are those of the library, sample by sample."""
    clip = write_clip(tmp_path / "in.mkv", times=[0, 1, 2, 3], pixel_format=pixel_format, options={"crf": "0"})
    convert(str(clip), str(tmp_path / "out.mkv"), factor=2, method="nlm", encoding=LOSSLESS)
    with VideoSource(clip, keeps_planes=True) as source:
        frames = [FrameCache(frame.image) for frame in source]
    assert all(isinstance(frame.pixels, YCbCrImage) for frame in frames)
    nlm = methods["nlm"]
    pairs = [nlm.pair(first, second) for first, second in pairwise(frames)]
    expected = []
    for frame, pair in zip(frames, with_neighbours(pairs), strict=False):
        expected += [frame.pixels, *(image for image, _ in nlm.images(pair, [0.5]))]
    written = pictures_of(tmp_path / "out.mkv")
    assert written[0].format.name == pixel_format
    for picture, image in zip(written, expected, strict=False):
        for plane, samples in zip(samples_of(picture), image.planes, strict=True):
            np.testing.assert_array_equal(plane, samples)


@pytest.mark.parametrize("keeps_planes", [False, True])
def test_sources_yield_bgr_unless_asked(tmp_path, keeps_planes):
    """And BGR where a picture has no planes of luma and chroma."""
    clip = write_clip(tmp_path / "in.mkv", times=[0, 1])
    rgb = write_clip(tmp_path / "rgb.mkv", times=[0, 1], pixel_format="rgb24", codec="libx264rgb")
    with VideoSource(clip, keeps_planes=keeps_planes) as source:
        assert {isinstance(frame.image, YCbCrImage) for frame in source} == {keeps_planes}
    with VideoSource(rgb, keeps_planes=keeps_planes) as source:
        assert not any(isinstance(frame.image, YCbCrImage) for frame in source)
