"""Every synthesizer through the same contract, and against true in-between frames."""

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from fpsboost import interpolate
from fpsboost.errors import OptionError
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair, Synthesizer
from fpsboost.synthesis.blend import Blend, Nearest
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis
from fpsboost.synthesis.reproject import Reproject
from fpsboost.synthesis.warp import Splat, Warp
from support.truth import Clip, affine, eroded, layers, moving_object, translation, true_fields, true_transition

synthesizers: dict[str, Synthesizer] = {
    "fuse": MultiHypothesis(),
    "fuse-learnt": MultiHypothesis(fusion="learnt"),
    "fuse-apart": MultiHypothesis(step=16, node_spacing=20, support_radius=32),
    "iterative": Reproject("iterative"),
    "brute-force": Reproject("brute-force"),
    "paint": Splat(),
    "warp": Warp(),
    "blend": Blend(),
    "nearest": Nearest(),
}
every_synthesizer = pytest.mark.parametrize("synthesizer", synthesizers.values(), ids=synthesizers.keys())
moving = "fuse", "fuse-learnt", "fuse-apart", "iterative", "brute-force", "paint"
along_motion = pytest.mark.parametrize("synthesizer", [synthesizers[name] for name in moving], ids=moving)
TIMES = (0.25, 0.5, 0.75)


def made(synthesizer: Synthesizer, clip: Clip, times: Sequence[float] = TIMES) -> list[np.ndarray]:
    """All in-between images along the true motion."""
    return list(synthesizer.synthesize(true_transition(clip), times))


@every_synthesizer
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_images_are_like_the_frames(synthesizer, channels):
    """Shape and type of the frames, in arrays of their own, one for every time."""
    clip = affine(19, 23, shift=(2, 1), channels=channels)
    images = made(synthesizer, clip)
    assert len(images) == len(TIMES)
    for image in images:
        assert image.shape == (19, 23, channels)
        assert image.dtype == np.uint8
        assert image.flags.carray  # contiguous and writeable
        assert not any(np.shares_memory(image, frame) for frame in (clip.image0, clip.image1))
    assert not np.shares_memory(images[0], images[1])


def test_nearest_repeats_the_nearer_frame():
    """The earlier one at the middle, bit by bit."""
    clip = translation(12, 14, 2, 0)
    np.testing.assert_array_equal(made(Nearest(), clip), [clip.image0, clip.image0, clip.image1])


@every_synthesizer
def test_images_are_made_one_at_a_time(synthesizer):
    """Asking for the first does not need the rest, and no times make no images."""
    clip = translation(12, 14, 0, 0)

    def times() -> Iterator[float]:
        yield 0.5
        raise AssertionError("asked for too much")

    assert next(synthesizer.synthesize(true_transition(clip), times())).shape == (12, 14, 3)
    assert made(synthesizer, clip, []) == []


@every_synthesizer
def test_inputs_are_not_modified(synthesizer):
    """Frames and fields are the same bits afterwards."""
    clip = moving_object(30, 40, box=(8, 8, 20, 20), dx=4, dy=4)
    fields = true_fields(clip)
    before = [array.copy() for field in fields for array in (field.flow, field.similarity)]
    images = clip.image0.copy(), clip.image1.copy()
    list(synthesizer.synthesize(FramePair(*clip.prepared, *fields), TIMES))
    after = [array for field in fields for array in (field.flow, field.similarity)]
    for one, other in zip([*before, *images], [*after, clip.image0, clip.image1], strict=True):
        np.testing.assert_array_equal(one, other)


@along_motion
@pytest.mark.parametrize("shift", [(4, 0), (0, -8), (-8, 4)])
def test_whole_translations_are_exact(synthesizer, shift):
    """With whole pixels to every time, all that either frame shows is copied; a mean may round the other way."""
    clip = translation(40, 50, *shift, seed=1)
    for t, image in zip(TIMES, made(synthesizer, clip), strict=True):
        known = eroded(np.ones((40, 50), bool), max(map(abs, shift)))
        off = np.abs(image[known].astype(int) - clip.at(t)[known]).max()
        assert off <= (1 if isinstance(synthesizer, MultiHypothesis) else 0)


@pytest.mark.parametrize("spacing", [16, 20, 24, 28])
@pytest.mark.parametrize(
    "motion", [{"shift": (3.3, -1.7)}, {"zoom": 1.08}, {"degrees": 5}, {"zoom": 0.95, "degrees": 2, "shift": (1, 2)}]
)
def test_fusing_follows_any_smooth_motion(motion, spacing):
    """Along the exact motion, a smooth texture is right to a few levels of 255 (8-bit rounding and cubic sampling)."""
    clip, synthesizer = affine(60, 72, **motion), MultiHypothesis(node_spacing=spacing, support_radius=32)
    for t, image in zip(TIMES, made(synthesizer, clip), strict=True):
        error = np.abs(image.astype(float) - clip.at(t))[eroded(np.ones((60, 72), bool), 8)]
        assert error.mean() < 0.7
        assert np.percentile(error, 99) < 5


def test_fusing_finds_the_right_motion_among_wrong_ones():
    """Where every second point is wrong about it, by the same vector, the image is as good as exact."""
    clip = affine(60, 72, shift=(3.3, -1.7), seed=2)
    wrong = (np.indices((60, 72)) // 8).sum(axis=0) % 2 == 1
    field01, field10 = (
        MotionField(np.where(wrong[..., np.newaxis], np.float32(9), field.flow), field.similarity)
        for field in true_fields(clip)
    )
    inner = eroded(np.ones((60, 72), bool), 8)
    images = MultiHypothesis().synthesize(FramePair(*clip.prepared, field01, field10), TIMES)
    for t, image in zip(TIMES, images, strict=True):
        assert np.abs(image.astype(float) - clip.at(t))[inner].mean() < 0.7


@along_motion
def test_an_object_is_in_its_place_and_what_it_uncovers_is_filled(synthesizer):
    """Object and background are right to two levels but for some pixels near the outline."""
    clip = moving_object(60, 80, box=(20, 20, 40, 44), dx=8, dy=4)
    for t, image in zip(TIMES, made(synthesizer, clip), strict=True):
        wrong = (np.abs(image.astype(int) - clip.at(t)) > 2).any(axis=-1)
        path = np.zeros((60, 80), bool)
        path[17:48, 17:56] = True  # all that the object touches on its way, and three pixels
        assert not wrong[~path].any()
        assert not wrong[24 + round(4 * t) : 36 + round(4 * t), 30:42].any()
        assert wrong.mean() < 0.11


def test_confidence_is_high_but_where_nothing_fits():
    """Within [0, 1]: all of it for a still, little where an object hides and uncovers, much elsewhere."""
    still, clip = translation(40, 50, 0, 0), layers(80, 112, box=(26, 30, 54, 60), shift=(14, 0))
    (fused,) = MultiHypothesis().fuse(true_transition(still), [0.5])
    np.testing.assert_array_equal(fused.image, still.image0)
    np.testing.assert_allclose(fused.confidence, 1, atol=1e-4)
    (fused,) = MultiHypothesis().fuse(true_transition(clip), [0.5])
    np.testing.assert_array_equal(fused.image, made(MultiHypothesis(), clip, [0.5])[0])
    assert fused.confidence.shape == (80, 112)
    assert fused.confidence.dtype == np.float32
    assert 0 <= fused.confidence.min() <= fused.confidence.max() <= 1 + 1e-5
    off = np.abs(fused.image.astype(float) - clip.at(0.5)).max(axis=-1)
    assert fused.confidence[off > 24].mean() < fused.confidence[off <= 2].mean() - 0.1


@pytest.mark.parametrize("spacing", [16, 20, 24, 28])
def test_votes_reach_from_node_to_node(spacing):
    """A smaller support radius than the distance between nodes is refused, by its name and with what is needed."""
    assert MultiHypothesis(node_spacing=spacing, support_radius=spacing).node_spacing == spacing
    with pytest.raises(OptionError, match=rf"support_radius must be at least {spacing} pixels"):
        MultiHypothesis(node_spacing=spacing, support_radius=spacing - 0.1)


@pytest.mark.parametrize("quarters", [(3, 13), (2, 6), (10, 18)])
def test_texture_keeps_its_detail_between_pixels(quarters):
    """Half-way between two pixels and two frames, where a mean is softest, it is nearly as sharp as the truth."""
    random = np.random.default_rng(3)
    canvas = np.full((4 * 72, 4 * 96), 100.0)  # four times as fine as pixels
    for _ in range(3000):
        (y, x), (height, width) = random.integers(0, canvas.shape), random.integers(8, 24, 2)
        canvas[y : y + height, x : x + width] = random.integers(40, 216)

    def seen(moved: int) -> np.ndarray:
        finer = np.roll(canvas, (moved * quarters[0], moved * quarters[1]), (0, 1))
        pixels = finer.reshape(72, 4, 96, 4).mean(axis=(1, 3))
        return np.repeat(pixels[..., np.newaxis], 3, axis=2).round().astype(np.uint8)

    before, truth, after = map(seen, range(3))
    assert 0.75 < detail(interpolate(before, after)) / detail(truth) < 1


def detail(image: np.ndarray) -> float:
    """The energy of the Laplacian, away from the border."""
    inner = image[10:-10, 10:-10, 0].astype(float)
    around = inner[2:, 1:-1] + inner[:-2, 1:-1] + inner[1:-1, 2:] + inner[1:-1, :-2]
    return float(np.square(around - 4 * inner[1:-1, 1:-1]).mean())
