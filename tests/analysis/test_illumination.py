"""Fades, flashes, exposure and lamps: found where the light changes, only there, and followed through."""

from dataclasses import replace
from itertools import pairwise, product

import cv2
import numpy as np
import pytest

from fpsboost import CutDetector, methods, with_neighbours
from fpsboost.analysis.illumination import estimate_illumination
from support.truth import affine, as_type, layers, moved_waves, noise, prepared, translation, white_of

NLM = methods["nlm"]
UNLIT = replace(NLM, compensate_illumination=False, cuts=None)
PLAIN = replace(methods["blend"], cuts=None)

every_type = pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])


def lit_clip(gain, offset=0.0, shift=(6, -4), *, channels=3, dtype=np.uint8, seed=0, size=(96, 128)):
    """A moving smooth texture of middling contrast at any time, in a light that changes to ``gain * c + offset``."""

    def at(t):
        colours = 0.25 + 0.5 * moved_waves(size, t * shift[0], t * shift[1], channels, seed)
        return as_type(colours * (1 + (np.array(gain) - 1) * t) + np.array(offset) * t, dtype)

    return at


def made(interpolator, image0, image1, t=0.5):
    """The one image at t."""
    return interpolator.interpolate(image0, image1, [t])[0]


def error(image, truth, margin=14):
    """The mean absolute difference away from the edges, levels of 255."""
    inner = slice(margin, -margin or None)
    return float(np.abs(image.astype(float) - truth)[inner, inner].mean()) * 255 / white_of(image)


@pytest.mark.parametrize(
    "clip",
    [
        affine(96, 128, seed=1),
        affine(96, 128, shift=(14, -6), seed=2),
        affine(96, 128, zoom=1.1, degrees=3, seed=3),
        layers(96, 128, box=(20, -40, 70, 0), shift=(40, 0), background=(-4, 2)),
        layers(96, 128, box=(20, -40, 70, 0), shift=(40, 0), bright=True),
        translation(96, 128, 6, 4, seed=6),
    ],
    ids=["still", "pan", "zoom", "entering", "bright entering", "noise moving"],
)
def test_constant_light_is_none(clip):
    """Whatever moves, comes or goes, both ways."""
    assert estimate_illumination(*clip.prepared) is None
    assert estimate_illumination(*clip.prepared[::-1]) is None


@pytest.mark.parametrize("seed", range(5))
@every_type
@pytest.mark.parametrize("channels", [1, 3])
def test_noise_is_no_light(dtype, channels, seed):
    """Noise of all levels, different in both frames, and a little on a still picture."""
    assert estimate_illumination(*prepared(*(noise(96, 128, channels, dtype, seed + k) for k in (0, 9)))) is None
    picture = lit_clip(1, shift=(0, 0), channels=channels, dtype=np.float32, seed=seed)(0)
    grain = 0.03 * np.random.default_rng(seed).normal(size=(2, *picture.shape))
    assert estimate_illumination(*prepared(*(as_type(picture + each, dtype) for each in grain))) is None


@pytest.mark.parametrize("channels", [2, 4])
def test_with_alpha_light_is_constant(channels):
    """What is behind a picture does not get darker with it."""
    at = lit_clip(0.5, channels=channels)
    assert estimate_illumination(*prepared(at(0), at(1))) is None


CHANGES = [(0.5, 0.0), (0.5, 0.2), (0.8, 0.0), (1.25, 0.0), (1.25, -0.1), (1.0, 0.15), (1.0, -0.15)]


@every_type
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("gain", "offset"), CHANGES)
def test_the_light_of_a_still_picture_is_found(gain, offset, channels, dtype):
    """The gain to 0.005, the offset to half a level of 255."""
    at = lit_clip(gain, offset, (0, 0), channels=channels, dtype=dtype, seed=1)
    illumination = estimate_illumination(*prepared(at(0), at(1)))
    np.testing.assert_allclose(illumination.gain, [gain] * channels, atol=0.005)
    np.testing.assert_allclose(illumination.offset, [offset] * channels, atol=0.5 / 255)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("shift", [(6, -4), (12, 5)])
@pytest.mark.parametrize(("gain", "offset"), [*CHANGES, ((0.55, 1, 1.17), 0.0), ((1.36, 0.75, 1.36), 0.0)])
def test_the_light_of_a_moving_picture_is_found(gain, offset, shift, seed):
    """Its colour, too, if gray stays: the gain to a twentieth although a part is new, every colour to five levels."""
    at = lit_clip(gain, offset, shift, seed=seed)
    illumination = estimate_illumination(*prepared(at(0), at(1)))
    np.testing.assert_allclose(illumination.gain, np.full(3, gain), rtol=0.05)
    colours = lit_clip(1, shift=shift, dtype=np.float32, seed=seed)(0)
    relit = illumination.apply(colours, 1, np.dtype(np.float32))
    assert np.abs(relit - (np.array(gain) * colours + offset)).max() < 5 / 255


def picture(seed, contrast=1.0, mean=0.5, size=(90, 120)):
    """One of any number of different smooth pictures."""
    return as_type(mean + contrast * (moved_waves(size, seed=seed) - 0.5), np.uint8)


def ends(pair):
    """Whether a scene ends in a pair, before which motion was easy to follow."""
    return CutDetector().is_cut(pair.match_score, 0.95)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("contrast", "mean"), [(1, 0.5), (0.5, 0.3), (0.25, 0.7), (0, 0), (0, 1)])
def test_a_cut_is_no_change_of_light(contrast, mean, seed):
    """Pictures of nothing in common, as bright or not, of more contrast or less, and black or white, are cuts."""
    assert ends(NLM.pair(*prepared(picture(seed), picture(seed + 100, contrast, mean))))


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 0), (0.25, 0), (0.5, 0.5), (0.2, 0.1)])
def test_a_fade_is_no_cut(gain, offset):
    """To a fifth of the light, to fog or out of it, while everything moves, whatever the method."""
    for seed, name in product(range(3), ("nlm", "blend")):
        at = lit_clip(gain, offset, seed=seed)
        assert not ends(methods[name].pair(*prepared(at(0), at(1))))
        assert not ends(methods[name].pair(*prepared(at(1), at(0))))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("shift", [(6, -4), (4.5, 2.5)])
@pytest.mark.parametrize(("gain", "offset"), [(0.5, 0), (0.3, 0), (1, 0.202)])  # of 0.2, half is half a level more
def test_motion_goes_on_through_a_fade(gain, offset, shift, seed):
    """Gray pictures, right to half a level: far better than with the light left alone, and than mixing."""
    at = lit_clip(gain, offset, shift, channels=1, seed=seed)
    times = 0.25, 0.5, 0.75
    for t, *images in zip(times, *(each.interpolate(at(0), at(1), times) for each in (NLM, UNLIT, PLAIN)), strict=True):
        lit, unlit, plain = (error(image, at(t)) for image in images)
        assert lit < min(0.5, unlit / 2, plain / 4)


@every_type
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("gain", "offset"), [(0.5, 0.25), (1.25, 0), (1, -0.15)])
def test_every_type_goes_through_a_fade(gain, offset, channels, dtype):
    """Right to half a level in 8 bits, to a tenth of one in 16 and in floats, in the frames' own type."""
    at = lit_clip(gain, offset, channels=channels, dtype=dtype)
    image = made(NLM, at(0), at(1))
    assert (image.dtype, image.shape) == (dtype, at(0).shape)
    assert error(image, at(0.5)) < (0.5 if dtype is np.uint8 else 0.1)


@pytest.mark.parametrize(("gain", "offset"), [(1.5, 0), (2, 0), (1, 0.3), (1, 0.6), (1.5, 0.3)])
def test_a_flash_on_a_still_picture_is_mixed(gain, offset):
    """Into it and out of it, with up to a third of the picture burnt out: at most 0.7 of a level worse than mixing."""
    for still in (*(0.6 * picture(seed).astype(float) / 255 for seed in range(3)), 0.6 * noise(90, 120) / 255):
        before, flash = as_type(still, np.uint8), as_type(gain * still + offset, np.uint8)
        for image0, image1 in ((before, flash), (flash, before)):
            times = 0.25, 0.5
            for t, *images in zip(
                times, *(each.interpolate(image0, image1, times) for each in (NLM, PLAIN)), strict=True
            ):
                lit, plain = (error(image, (1 - t) * image0 + t * image1, 0) for image in images)
                assert lit < plain + 0.7


def test_a_fade_over_several_frames_is_one_scene():
    """With word of the neighbouring pairs, each in a light of its own, every pair is right to half a level."""
    at = lit_clip(0.5, 0, (4, -2))
    images = prepared(*(at(t) for t in (0, 0.5, 1, 1.5)))  # to a quarter of the light
    pairs = [NLM.pair(*each) for each in pairwise(images)]
    for k, pair in enumerate(with_neighbours(pairs)):
        assert not pair.is_cut
        assert error(next(NLM.images(pair, [0.5])).image, at(k / 2 + 0.25)) < 0.5


# ----------------------------------------------------------------------------------------------------------- one place


def spot(size=(180, 240), radius=0.3, place=(0.5, 0.5)):
    """A Gaussian spot of light, its standard deviation and its place in heights and shares of the picture."""
    y, x = np.mgrid[: size[0], : size[1]]
    squared = (y - place[0] * size[0]) ** 2 + (x - place[1] * size[1]) ** 2
    return np.exp(-squared / (2 * (radius * size[0]) ** 2))[..., np.newaxis]


def lamp_clip(gain, lamp, shift=(6, -4), **options):
    """A moving texture of which a lamp lights up a part, at any time."""
    at = lit_clip(1, shift=shift, size=lamp.shape[:2], dtype=np.float32, **options)
    return lambda t, dtype=np.uint8: as_type(0.7 * at(t) * (1 + (gain - 1) * lamp * t), dtype)


@pytest.mark.parametrize("shift", [(6, -4), (0, 0)])
@pytest.mark.parametrize(
    ("radius", "gain"),
    [(0.05, 1.3), (0.05, 2), *((radius, gain) for radius in (0.15, 0.3, 0.5) for gain in (1.3, 2, 3))],
)
def test_a_spot_of_light_is_as_good_as_by_any_other_method(radius, gain, shift):
    """At most half a decibel worse than the better of `dis` and mixing, or too near to the truth for anyone to see."""
    at = lamp_clip(gain, spot(radius=radius), shift)
    others = replace(methods["dis"], compensate_illumination=False, cuts=None), PLAIN
    lit, *plain = (cv2.PSNR(made(each, at(0), at(1)), at(0.5)) for each in (NLM, *others))
    assert lit > min(max(plain) - 0.5, 45)


@pytest.mark.parametrize("radius", [0.15, 0.5])
def test_nothing_jumps_under_a_spot_of_light(radius):
    """What does not move has hardly any motion in it, though the middle is burnt out; else vectors lead far away."""
    at = lamp_clip(3, spot(radius=radius), (0, 0))
    lit, unlit = (
        max(abs(field.flow).max() for field in each.pair(*prepared(at(0), at(1))).fields) for each in (NLM, UNLIT)
    )
    assert 5 * lit < 10 < unlit


@every_type
@pytest.mark.parametrize("channels", [1, 3])
def test_every_type_is_lit_in_one_place(dtype, channels):
    """Right to 1.6 levels of 255 and nearer than mixing, in the frames' own type."""
    at = lamp_clip(2, spot(), channels=channels)
    images = [made(each, at(0, dtype), at(1, dtype)) for each in (NLM, PLAIN)]
    assert {image.dtype for image in images} == {np.dtype(dtype)}
    lit, plain = (error(image, at(0.5, dtype)) for image in images)
    assert lit < min(1.6, plain / 2)


@pytest.mark.parametrize("gain", [1.5, 2, 3])
@pytest.mark.parametrize("is_hard", [False, True])
def test_a_lamp_over_a_third_of_the_picture_is_no_cut(gain, is_hard):
    """Switched on or off while everything moves, whatever the method, also if it leaves the light as it is."""
    lamp = np.zeros((180, 240, 1))
    lamp[:, :80] = 1
    lamp = lamp if is_hard else cv2.GaussianBlur(lamp, (0, 0), 12)[..., np.newaxis]
    at = lamp_clip(gain, lamp)
    for name, images in product(("nlm", "nlm-passes", "blend"), ((at(0), at(1)), (at(1), at(0)))):
        pair = methods[name].pair(*prepared(*images))
        assert (ends(pair), pair.illumination is None) == (False, name != "nlm")


def test_a_flash_in_one_place_is_followed_into_and_out_of():
    """A flash of one frame, a lamp that fades up over three and a headlight that passes: no cut, nearer than mixing."""
    at, shift = lit_clip(1, shift=(5, 2), size=(180, 240), dtype=np.float32), [0.3, 0.4, 0.5, 0.6]
    lights = {
        "flash": [0 * spot(), spot(), 0 * spot(), 0 * spot()],
        "fade": [n / 3 * spot() for n in range(4)],
        "headlight": [spot(radius=0.2, place=(0.6, x)) for x in shift],
    }
    for name, light in lights.items():
        clip = [as_type(0.6 * at(n) * (1 + each), np.uint8) for n, each in enumerate(light)]
        pairs = [NLM.pair(*each) for each in pairwise(prepared(*clip))]
        for n, pair in enumerate(with_neighbours(pairs)):
            truth = as_type(0.6 * at(n + 0.5) * (1 + (light[n] + light[n + 1]) / 2), np.uint8)
            assert not pair.is_cut, name
            ((image, _),) = NLM.images(pair, [0.5])
            assert error(image, truth) < error(made(PLAIN, *clip[n : n + 2]), truth) / 2, name
