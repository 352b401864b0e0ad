"""Guided synthesis against constructed truth: a moving texture whose in-between frame is known."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from fpsboost import FrameCache, find_method
from fpsboost.colour import srgb_encoded
from fpsboost.image import view
from fpsboost.layered import FrameImage, Layer, LayeredImage
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.guide_calibration import Rendition, calibrate
from fpsboost.synthesis.guide_colours import Colours
from fpsboost.synthesis.guided import GuidedPair, GuideFindings, describe_findings

HEIGHT, WIDTH = 96, 160


def texture() -> np.ndarray:
    """Return a smooth random texture, twice as wide as a frame."""
    noise = np.random.default_rng(5).random((HEIGHT, 2 * WIDTH, 3), np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    return np.rint((smooth - smooth.min()) * (255 / np.ptp(smooth))).astype(np.uint8)


def scene(shifts: tuple[int, int, int]) -> list[np.ndarray]:
    """Return three frames: of a texture before which a square of another one jumps to any place in the middle."""
    wide = texture()
    square = texture()[20:52, 40:72, ::-1]
    frames = []
    for shift in shifts:
        frame = wide[:, :WIDTH].copy()
        frame[30:62, 20 + shift : 52 + shift] = square
        frames.append(frame)
    return frames


def small(frame: np.ndarray, factor: int = 4) -> np.ndarray:
    return cv2.resize(frame, (WIDTH // factor, HEIGHT // factor), interpolation=cv2.INTER_AREA)


def decibels(truth: np.ndarray, made: np.ndarray) -> float:
    difference = truth.astype(np.float64) - made
    return float(10 * np.log10(np.iinfo(truth.dtype).max ** 2 / np.mean(difference**2)))


def without_guide(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    (made,) = find_method("nlm").interpolate(first, last, [0.5])
    return made


def follow(
    frames: tuple[FrameImage, FrameImage], made: InterpolatedImage, guides: Sequence[FrameImage | None]
) -> tuple[InterpolatedImage, GuideFindings]:
    """Make a frame with its guide and those of the two frames, if there are some."""
    images = [FrameCache(each) for each in frames]
    picture, *of_frames = guides
    for image, guide in zip(images, of_frames, strict=False):
        image.guide = guide
    assert picture is not None
    return GuidedPair(*images).follow(made, picture, 0.5)


def guided(first: np.ndarray, last: np.ndarray, *guides: np.ndarray | None) -> np.ndarray:
    made = InterpolatedImage(without_guide(first, last))
    image = follow((first, last), made, guides)[0].image
    assert isinstance(image, np.ndarray)
    return image


@pytest.mark.parametrize("with_key_guides", [False, True])
def test_small_guides_show_where_things_are(with_key_guides: bool) -> None:
    """A guide of a quarter of the width puts an object that does not move evenly where it is."""
    first, truth, last = scene((0, 60, 80))
    of_keys = (small(first), small(last)) if with_key_guides else (None, None)
    made = guided(first, last, small(truth), *of_keys)
    assert decibels(truth, made) > 34
    assert decibels(truth, without_guide(first, last)) < 28


def test_noisy_guides_leave_no_noise() -> None:
    """A guide with noise shows where things are, and its noise is not in the result."""
    first, truth, last = scene((0, 60, 80))
    noise = np.random.default_rng(1).normal(0, 20, truth.shape)
    guide = (truth + noise).clip(0, 255).astype(np.uint8)
    assert decibels(truth, guided(first, last, guide)) > 32
    assert decibels(truth, guide) < 23


def test_an_offset_is_found_by_the_guides_of_the_frames() -> None:
    """Guides that lie beside the frames are put in place if those of both frames show it."""
    first, truth, last = scene((0, 60, 80))
    first_guide, guide, last_guide = (small(np.roll(each, 2, axis=1)) for each in (first, truth, last))
    made = InterpolatedImage(without_guide(first, last))
    result, findings = follow((first, last), made, (guide, first_guide, last_guide))
    assert findings.offset_x == pytest.approx(2, abs=0.3)
    assert decibels(truth, result.image) > 33
    assert "offset (" in describe_findings(findings._asdict())


@pytest.mark.parametrize("factor", [1, 4])
def test_guides_may_have_an_exposure_each(factor: int) -> None:
    """Guides of both frames that show an exposure each leave their light out of the result, clipped or not."""
    first, truth, last = scene((0, 60, 80))
    gains = {0.8: first, 1.15: truth, 1.4: last}
    of_first, guide, of_last = (
        np.rint((small(each, factor) * np.float32(gain)).clip(0, 255)).astype(np.uint8) for gain, each in gains.items()
    )
    made = guided(first, last, guide, of_first, of_last)
    assert decibels(truth, made) > 33
    assert abs(np.mean(made - truth.astype(float))) < 0.5


@pytest.mark.parametrize("is_told", [False, True])
def test_pictures_may_be_views_of_others(is_told: bool) -> None:
    """Frames and guides whose channels are planes in memory give what their copies give."""
    pictures = [*scene((0, 60, 80)), *(small(each, 1) for each in scene((0, 60, 80)))]
    views = [np.ascontiguousarray(each.transpose(2, 0, 1)).transpose(1, 2, 0) for each in pictures]
    first, _, last, of_first, guide, of_last = range(6)
    order = (first, last, guide, *((of_first, of_last) if is_told else ()))
    results = [guided(*(each[number] for number in order)) for each in (pictures, views)]
    np.testing.assert_array_equal(*results)


def test_what_no_frame_shows_comes_from_the_guide() -> None:
    """Something that is in neither frame is in the result as the guide shows it."""
    first, truth, last = scene((0, 40, 80))
    truth[70:90, 100:140] = (250, 20, 30)
    made = guided(first, last, small(truth), small(first), small(last))[72:88, 104:136].astype(int)
    assert abs(made - truth[72:88, 104:136]).mean() < 12


def test_damage_is_not_in_a_repair_that_it_guides() -> None:
    """A damaged frame shows where things are in its repair, and nothing of its damage is in there."""
    first, truth, last = scene((0, 60, 80))
    damaged = truth.copy()
    damaged[66:90, 100:140] = np.random.default_rng(3).integers(0, 256, (24, 40, 3))
    made = guided(first, last, damaged, first, last)
    assert decibels(truth, made) > decibels(truth, without_guide(first, last)) + 3
    assert decibels(truth[64:, 96:144], made[64:, 96:144]) > 35


@pytest.mark.parametrize("kind", ["uint16", "gray", "alpha"])
def test_kinds_of_frames_keep_type_and_channels(kind: str) -> None:
    """Frames of 16 bits, gray ones and those with alpha come out as they are, with a guide of 8 bits in colour."""
    first, truth, last = scene((0, 60, 80))
    guide = small(truth)
    change = {
        "uint16": lambda frame: frame.astype(np.uint16) * 257,
        "gray": lambda frame: cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)[..., np.newaxis],
        "alpha": lambda frame: np.dstack([frame, np.full(frame.shape[:2], 255, np.uint8)]),
    }[kind]
    first, truth, last = (change(each) for each in (first, truth, last))
    if kind == "gray":
        guide = np.repeat(small(truth)[..., np.newaxis], 3, axis=2)
    made = guided(first, last, guide)
    assert (made.shape, made.dtype) == (truth.shape, truth.dtype)
    assert decibels(truth, made) > 33


def test_sums_of_linear_layers_stay_sums() -> None:
    """Linear layers have the weights of the picture, and object numbers are never mixed."""
    frames = [each.astype(np.float32) / 255 for each in scene((0, 60, 80))]

    def layered(colour: np.ndarray) -> LayeredImage:
        parts = {"A.R": colour[..., 2] * np.float32(0.25), "B.R": colour[..., 2] * np.float32(0.75)}
        numbers = {"Id.X": np.where(colour[..., 0] > 0.5, 7, 3).astype(np.float32)}
        return LayeredImage(colour, (Layer("L", "linear", parts), Layer("Id", "nearest", numbers)))

    first, truth, last = (layered(each) for each in frames)
    made = InterpolatedImage(layered((frames[0] + frames[2]) / 2))
    guide = LayeredImage(cv2.resize(truth.colour, (WIDTH // 4, HEIGHT // 4), interpolation=cv2.INTER_AREA), ())
    image = follow((first, last), made, [guide])[0].image
    assert isinstance(image, LayeredImage)
    planes = image.planes()
    np.testing.assert_allclose(planes["A.R"] * 3, planes["B.R"], atol=1e-5)
    assert set(np.unique(planes["Id.X"])) <= {3, 7}
    assert np.abs(image.colour - truth.colour).mean() < 0.02


def light(frame: np.ndarray) -> np.ndarray:
    """Return light of which a screen clips the brightest."""
    return np.asarray(2 ** (frame.astype(np.float32) / 32 - 7))


def on_a_screen(colours: np.ndarray) -> np.ndarray:
    return np.rint(255 * srgb_encoded(colours)).astype(np.uint8)


def test_light_guides_code_values() -> None:
    """Light of which a screen clips the brightest guides frames as the screen shows it."""
    lights = [light(each) for each in scene((0, 60, 80))]
    first, truth, last = map(on_a_screen, lights)
    guides = [LayeredImage(small(lights[1]), ()), on_a_screen(small(lights[1]))]
    made = InterpolatedImage(without_guide(first, last))
    results = [decibels(truth, view(follow((first, last), made, [each])[0].image).array()) for each in guides]
    assert results[0] == pytest.approx(results[1], abs=1)
    assert results[0] > decibels(truth, view(made.image).array()) + 3


def test_fireflies_of_a_guide_are_no_brighter_than_what_is_nearby() -> None:
    """Light of single pixels that a path tracer has caught is not in the result."""
    first, truth, last = map(light, scene((0, 60, 80)))
    guide = truth.copy()
    guide[::16, ::16] *= 1000
    made = InterpolatedImage(LayeredImage((first + last) / 2, ()))
    frames = LayeredImage(first, ()), LayeredImage(last, ())
    result = follow(frames, made, [LayeredImage(guide, ())])[0].image
    assert isinstance(result, LayeredImage)
    assert result.colour.max() <= max(first.max(), last.max()) * 1.01


def test_confidence_is_given_where_it_was_asked_for() -> None:
    """Confidence is high where the frames explain the guide, and None if the frame came without."""
    first, truth, last = scene((0, 60, 80))
    made = InterpolatedImage(without_guide(first, last), np.ones((HEIGHT, WIDTH), np.float32))
    result, findings = follow((first, last), made, [small(truth)])
    assert result.confidence is not None
    assert result.confidence.shape == (HEIGHT, WIDTH)
    assert result.confidence.mean() > 0.9
    assert findings.from_frames > 0.9


def test_guides_full_of_errors_do_not_spoil_a_good_frame() -> None:
    """Where guides have large errors, as guides of the frames show, a frame that is right without stays as it is."""
    first, middle, last = (texture()[:, 8 + shift : 8 + shift + WIDTH] for shift in (-2, 0, 2))
    noise = np.random.default_rng(2)

    def coarse(frame: np.ndarray) -> np.ndarray:
        blurred = cv2.GaussianBlur(small(frame).astype(np.float32), (0, 0), 1.5)
        errors = cv2.GaussianBlur(noise.normal(0, 40, blurred.shape).astype(np.float32), (0, 0), 2)
        return np.rint((blurred + errors).clip(0, 255)).astype(np.uint8)

    guides = [coarse(each) for each in (middle, first, last)]
    assert decibels(small(middle), guides[0]) < 24
    assert decibels(middle, guided(first, last, *guides)) > 42


@pytest.mark.parametrize("in_light", [False, True])
def test_the_filter_of_guides_is_found(in_light: bool) -> None:
    """A blur of small guides, of light or of code values, is found by the guides of the frames."""
    frames = scene((0, 40, 80))[::2]

    def shown(frame: np.ndarray) -> np.ndarray:
        values = frame.astype(np.float32) / 255
        means = cv2.GaussianBlur(small(values**2.2 if in_light else values), (0, 0), 0.6)
        return 255 * (means ** (1 / 2.2) if in_light else means)

    guides = [shown(each) for each in frames]
    rendition = Rendition(Colours(), (WIDTH, HEIGHT), (WIDTH // 4, HEIGHT // 4))
    pictures = [each.astype(np.float32) for each in frames]
    found = calibrate(rendition, pictures, guides, are_frames=True)
    assert found.rendition.in_light is in_light
    for picture, guide in zip(pictures, guides, strict=True):
        assert np.abs(found.rendition.shown(picture) - guide).mean() < 0.4
        assert np.abs(rendition.shown(picture) - guide).mean() > 0.8
