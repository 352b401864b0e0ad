"""Made frames are as grainy as the frames around them, and clean ones stay clean."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import cv2
import numpy as np
import pytest

from fpsboost import (
    ByFactor,
    Coding,
    Frame,
    FrameCache,
    Interpolator,
    OutputRange,
    SourcePosition,
    YCbCrImage,
    methods,
    run_conversion,
)
from fpsboost.analysis.grain import match_grain, measure_grain
from fpsboost.cli.options import MethodOptions, TuningOptions
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis.blend import Blend
from fpsboost.timeline import TimelineOptions
from support.memory_frames import FakeSink, FakeSource
from support.truth import as_type, moved_waves, waves, white_of

SIZE = 128, 256
SMOOTH = Interpolator(ZeroMotion(), Blend(), cuts=None, compensate_illumination=False)
GRAINY = replace(SMOOTH, match_grain=True)
CODING = Coding(8, 1, full_range=True, chroma_location="left", pixel_format="yuv420p")


def ramp(size=SIZE, channels=3):
    """A smooth picture, from dark to bright, 0 to 1."""
    across = np.linspace(0.25, 0.75, size[1])
    return np.broadcast_to(across[None, :, None], (*size, channels)).copy()


def film(seed, deviation=8 / 255, radius=0.0, size=SIZE, channels=3):
    """The smooth picture with grain of some size."""
    grain = np.random.default_rng(seed).normal(0, 1, (*size, channels))
    if radius:
        grain = cv2.GaussianBlur(grain, (0, 0), radius).reshape(grain.shape)
    return ramp(size, channels) + grain * (deviation / grain.std())


def noise_of(image, picture):
    """What an image has beside the picture, of its own white."""
    return image.astype(float) / white_of(image) - picture


def middle(interpolator, images, number=0, t=0.5):
    """The image between two, the first of which has a place in its source."""
    first = FrameCache(images[0], None, SourcePosition(number, Fraction(number)))
    ((made, _),) = interpolator.images(interpolator.pair(first, FrameCache(images[1])), [t])
    return made


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("deviation", [4 / 255, 16 / 255])
@pytest.mark.parametrize("radius", [0, 1])
def test_a_made_frame_is_as_noisy_as_its_neighbours(dtype, deviation, radius):
    """A mean of two frames has 0.7 of their noise; with its grain matched, as much as they have."""
    images = [as_type(film(seed, deviation, radius), dtype) for seed in (1, 2)]
    smooth, grainy = (noise_of(middle(each, images), ramp()).std() for each in (SMOOTH, GRAINY))
    assert smooth == pytest.approx(0.71 * deviation, rel=0.05)
    assert grainy == pytest.approx(deviation, rel=0.08)


def test_a_search_for_motion_does_not_hide_it():
    """The default method mixes more than two pixels into one; the noise comes back all the same."""
    images = [as_type(film(seed, 10 / 255), np.uint8) for seed in (1, 2)]
    method = replace(methods["nlm"], cuts=None)
    smooth, grainy = (
        noise_of(middle(replace(method, match_grain=each), images), ramp()).std() for each in (False, True)
    )
    assert smooth < 7 / 255
    assert grainy == pytest.approx(10 / 255, rel=0.1)


def neighbours_alike(noise):
    """Correlation of samples side by side."""
    return (noise[:, 1:] * noise[:, :-1]).mean() / np.square(noise).mean()


@pytest.mark.parametrize("radius", [0, 0.7, 1.5])
def test_grain_keeps_its_size(radius):
    """What is added is as coarse as what is missing."""
    images = [as_type(film(seed, radius=radius), np.float32) for seed in (1, 2)]
    made, source = (neighbours_alike(noise_of(each, ramp())) for each in (middle(GRAINY, images), images[0]))
    assert made == pytest.approx(source, abs=0.07)


def test_grain_follows_the_intensity():
    """Where the picture is brighter and its noise stronger, more is added."""
    weaker = np.where(np.arange(SIZE[1]) < SIZE[1] // 2, 0.5, 1)[None, :, None]
    images = [as_type(ramp() + (film(seed, 12 / 255) - ramp()) * weaker, np.uint8) for seed in (1, 2)]
    noise = noise_of(middle(GRAINY, images), ramp())
    assert noise[:, :96].std() == pytest.approx(6 / 255, rel=0.1)
    assert noise[:, 160:].std() == pytest.approx(12 / 255, rel=0.1)


def test_grain_of_channels_stays_independent():
    """Channels whose noise is their own get noise of their own."""
    images = [as_type(film(seed), np.float32) for seed in (1, 2)]
    correlation = np.corrcoef(noise_of(middle(GRAINY, images), ramp()).reshape(-1, 3).T)
    assert np.abs(correlation - np.eye(3)).max() < 0.1


def in_planes(image):
    """Three channels as luma and chroma, chroma of half the size."""
    y, *chroma = cv2.split(image)
    return YCbCrImage((y, *(np.ascontiguousarray(each[::2, ::2]) for each in chroma)), CODING)


def test_planes_are_matched_one_by_one():
    """Luma and subsampled chroma get back what each of them lacks."""
    images = [in_planes(as_type(film(seed, size=(256, 512)), np.uint8)) for seed in (1, 2)]
    made, picture = middle(GRAINY, images), in_planes(ramp((256, 512)))
    for plane, clean in zip(made.planes, picture.planes, strict=True):
        assert noise_of(plane, clean).std() == pytest.approx(8 / 255, rel=0.1)


@pytest.mark.parametrize("shift", [0, 4, 6.5])
def test_a_clean_clip_stays_as_it_is(shift):
    """Nothing is added where there is no noise, whether it moves or not."""
    images = [as_type(0.2 + 0.6 * moved_waves(SIZE, dx, seed=1), np.uint8) for dx in (0, shift)]
    interpolator = replace(methods["nlm"], cuts=None)
    smooth, grainy = (middle(replace(interpolator, match_grain=each), images).astype(int) for each in (False, True))
    assert np.abs(grainy - smooth).max() <= 1


def test_clipped_white_stays_white():
    """White that is clipped in both frames gets no grain, though the rest does."""
    images = [film(seed) for seed in (1, 2)]
    for image in images:
        image[:, -64:] = 1
    made = middle(GRAINY, [as_type(each, np.uint8) for each in images])
    assert (made[:, -64:] == 255).all()
    assert noise_of(made, ramp())[:, :-64].std() == pytest.approx(8 / 255, rel=0.08)


def test_linear_light_stays_positive_and_as_bright():
    """Noise that grows with linear light is matched, without negative light and without a change of the mean."""
    light = np.linspace(0.002, 0.2, SIZE[1])[None, :, None]
    counts = 100  # photons per unit of light
    images = [
        (np.random.default_rng(seed).poisson(counts * light, (*SIZE, 3)) / counts).astype(np.float32) for seed in (1, 2)
    ]
    made = middle(GRAINY, images)
    assert made.min() >= 0
    assert made.mean() == pytest.approx(light.mean(), rel=0.02)
    bright = (made - light)[:, 128:] / np.sqrt(light[:, 128:] / counts)
    assert bright.std() == pytest.approx(1, rel=0.1)


def test_alpha_has_no_grain():
    """Alpha is left alone, whatever it holds."""
    images = [as_type(film(seed, channels=4), np.float32) for seed in (1, 2)]
    smooth, grainy = (middle(each, images) for each in (SMOOTH, GRAINY))
    assert (grainy[..., 3] == smooth[..., 3]).all()
    assert (grainy[..., :3] != smooth[..., :3]).mean() > 0.9


def test_grain_repeats_itself_and_nothing_else():
    """One place and time has one grain; another place or time another, which is none of the frames' own."""
    images = [as_type(film(seed), np.float32) for seed in (1, 2)]
    smooth, made, again = middle(SMOOTH, images), middle(GRAINY, images), middle(GRAINY, images)
    added = made - smooth
    others = middle(GRAINY, images, number=1) - smooth, *(noise_of(each, ramp()) for each in images)
    assert (made == again).all()
    correlations = np.corrcoef([each.ravel() for each in (added, *others)])
    assert np.abs(correlations[0, 1:]).max() < 0.02


def test_infinite_values_stay_where_they_are():
    """A pixel that is no number takes no other pixel's grain away."""
    images = [as_type(film(seed), np.float32) for seed in (1, 2)]
    made, grain = (
        images[0] / 2 + images[1] / 2,
        measure_grain(*images, *ZeroMotion().estimate(*map(FrameCache, images))),
    )
    made[40, 50] = np.inf, np.nan, 0.5
    grainy = match_grain(made, grain, 0.5, (0,))
    assert np.isinf(grainy[40, 50, 0])
    assert np.isnan(grainy[40, 50, 1])
    assert np.isfinite(grainy).sum() == grainy.size - 2
    assert noise_of(grainy[:, :32], ramp()[:, :32]).std() == pytest.approx(8 / 255, rel=0.1)


def test_threads_and_earlier_runs_change_no_grain():
    """The grain of a frame follows from its place, whoever makes it, and when."""
    frames = [Frame(as_type(film(k, size=(64, 128)), np.uint8), Fraction(k, 25), Fraction(1, 25)) for k in range(5)]

    def made(threads, skip=0):
        sink = FakeSink()
        run_conversion(
            FakeSource(frames),
            GRAINY,
            sink,
            ByFactor(Fraction(3)),
            threads=threads,
            outputs=OutputRange(skip=skip),
            options=TimelineOptions(duplicates=None),
        )
        return [frame.array for frame in sink.frames]

    whole = made(1)
    assert all((one == other).all() for one, other in zip(whole, made(3), strict=True))
    assert all((one == other).all() for one, other in zip(whole[7:], made(2, skip=7)[7:], strict=True))
    added = [whole[k] - np.rint((whole[0] * (3 - k) + whole[3] * np.float64(k)) / 3) for k in (1, 2)]
    assert abs(np.corrcoef(added[0].ravel(), added[1].ravel())[0, 1]) < 0.05


def test_overlays_have_no_grain():
    """What stands still in front of a moving picture stays as it is, and does not begin to flicker."""
    y, x = np.mgrid[:128, :256].astype(float)
    title = np.zeros((128, 256), bool)
    for left in (60, 90, 120, 150):
        title[40:80, left : left + 3] = title[40:80, left + 12 : left + 15] = title[58:61, left : left + 15] = True
    images = []
    for k in range(4):
        colours = 0.2 + 0.4 * waves(x / 4 - 6 * k / 4, y / 4, 3, 1)
        colours += np.random.default_rng(k).normal(0, 8 / 255, colours.shape)
        colours[title] = 1
        images.append(FrameCache(as_type(colours, np.uint8), None, SourcePosition(k, Fraction(k))))
    method = replace(methods["nlm"], cuts=None, match_grain=True)
    before, pair, after = (method.pair(*each) for each in pairwise(images))
    ((made, _),) = method.images(pair.between(before, after), [0.5])
    assert (made[title] >= 254).mean() > 0.98


@pytest.mark.parametrize("method", ["nlm", "blend"])
def test_the_command_line_has_it(method):
    """A flag turns it on, for any method."""
    assert MethodOptions(method, match_grain=True).interpolator(TuningOptions()).match_grain
    assert not MethodOptions(method).interpolator(TuningOptions()).match_grain
