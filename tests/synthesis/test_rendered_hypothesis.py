"""A renderer's motion as one more hypothesis, against constructed truth."""

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fpsboost import FrameCache, InputError, OptionError, VectorFolder, find_method
from fpsboost.motion.field import ZeroMotion
from fpsboost.motion.rendered import UsesVectors
from fpsboost.synthesis import FramePair, InterpolatedImage
from fpsboost.synthesis.multi_hypothesis import Fusion, MultiHypothesis
from support.truth import moved_waves, moving_object, noise, translation, white_of
from support.vector_truth import constant, save_object, save_translation, save_vectors

SIZE = 48, 64
EDGE = 12


def fused(
    vectors: VectorFolder | None,
    image0: Any,
    image1: Any,
    span: int | Fraction = 2,
    t: float = 0.5,
    fusion: Fusion = "plain",
) -> InterpolatedImage:
    """An image between two output frames, whose motion the estimate does not know."""
    placed = FrameCache(image0, Fraction(0)), FrameCache(image1, Fraction(span))
    (made,) = MultiHypothesis(vectors=vectors, fusion=fusion).fuse(
        FramePair(*placed, *ZeroMotion().estimate(*placed)), [t]
    )
    return made


def error(image: Any, truth: Any) -> float:
    """Mean absolute error inside of the frame, as a share of white."""
    return float(np.abs((image.astype(float) - truth)[EDGE:-EDGE, EDGE:-EDGE]).mean() / white_of(image))


@pytest.mark.parametrize(
    ("dtype", "fusion", "span", "number"),
    [(np.uint8, "plain", 4, 1), (np.uint8, "plain", 4, 3), (np.uint16, "learnt", 2, 1), (np.float32, "learnt", 2, 1)],
)
def test_motion_that_no_estimate_knows_is_followed(tmp_path, dtype, fusion, span, number):
    """Moving noise comes out with its vectors, and surely; without them it does not."""
    clip = translation(*SIZE, dx=span * 2, dy=-span, dtype=dtype)
    vectors, t = VectorFolder(save_translation(tmp_path, span + 1, SIZE, 2, -1)), number / span
    made, without = (fused(each, clip.image0, clip.image1, span, t, fusion) for each in (vectors, None))
    assert error(made.image, clip.at(t)) < 0.01 < error(without.image, clip.at(t))
    assert made.confidence[EDGE:-EDGE, EDGE:-EDGE].min() > 0.9


@pytest.mark.parametrize(("kept", "most"), [(range(5), 0.02), (range(0, 5, 4), 0.08)])
def test_what_one_frame_hides_comes_from_the_other(tmp_path, kept, most):
    """An object over noise: right with the vectors of all frames, and but for its edges with those of the two alone."""
    clip = moving_object(60, 80, box=(16, 20, 44, 50), dx=8, dy=4)
    save_object(tmp_path / "v", tmp_path / "d", (60, 80), (16, 20, 44, 50), 5, (2, 1))
    for file in tmp_path.glob("v/*.exr"):
        if int(file.stem[2:]) not in kept:
            file.unlink()
    vectors = VectorFolder(tmp_path / "v").matched(range(5), must_match=True)
    assert len(vectors.remarks) == (len(kept) < 5)
    image = fused(vectors, clip.image0, clip.image1, 4, 0.5).image
    assert (np.abs(image.astype(int) - clip.at(0.5)).max(axis=-1) > 16).mean() < most


def test_curved_paths(tmp_path):
    """Vectors to both sides say how motion changes: over four frames, a parabola is followed."""

    def picture(number: int) -> np.ndarray:
        return np.rint(moved_waves(SIZE, _place(number)) * 255).astype(np.uint8)

    for number in range(5):
        backward, forward = (constant(*SIZE, _place(number + way) - _place(number), 0) for way in (-1, 1))
        save_vectors(tmp_path / f"v_{number}.exr", backward, forward)
    image = fused(VectorFolder(tmp_path), picture(0), picture(4), 4, 0.25).image
    assert error(image, picture(1)) < 0.004


def _place(number: int) -> float:
    return 0.5 * number + 0.5 * number * number


def test_vectors_of_a_motion_that_is_not_there_change_little(tmp_path):
    """A still picture with vectors that say otherwise: what the images show wins."""
    still = noise(*SIZE)
    vectors = VectorFolder(save_translation(tmp_path, 3, SIZE, 5, 3))
    assert error(fused(vectors, still, still).image, still) < 0.002


@pytest.mark.parametrize("channels", [2, 4])
def test_colours_that_alpha_hides_do_not_bleed(tmp_path, channels):
    """A moving hole keeps its alpha, and the colours around it are theirs alone."""
    clip = translation(*SIZE, dx=4, dy=0, channels=channels)
    images = [clip.image0.copy(), clip.image1.copy()]
    for image, left in zip(images, (20, 24), strict=True):
        image[20:30, left : left + 10, :-1], image[20:30, left : left + 10, -1] = 255, 0
    made = fused(VectorFolder(save_translation(tmp_path, 3, SIZE, 2, 0)), *images).image
    expected = clip.at(0.5)[..., -1].copy()
    expected[20:30, 22:32] = 0
    inner = slice(EDGE, -EDGE), slice(EDGE, -EDGE)
    np.testing.assert_allclose(made[..., -1][inner].astype(int), expected[inner], atol=8)


def test_methods_that_mix_hypotheses_take_vectors():
    """They work on arrays then, and leave out no frame; without vectors nothing changes."""
    vectors: Any = SimpleNamespace(step=1, remarks=[], has=len, for_image=len)
    for name in ("nlm", "nlm-fast", "dis"):
        method = find_method(name, vectors)
        assert isinstance(method.synthesizer, UsesVectors)
        assert method.needs_every_frame
        assert not method.takes_planes
    assert not find_method("nlm").needs_every_frame
    assert find_method("nlm").takes_planes


def test_frames_that_have_no_vectors_are_named(tmp_path):
    """Times between output frames, and vectors of another size, are errors."""
    still = noise(*SIZE)
    with pytest.raises(OptionError, match="whole factor"):
        fused(VectorFolder(save_translation(tmp_path / "a", 3, SIZE, 0, 0)), still, still, 2, 0.25)
    with pytest.raises(InputError, match="8x6 pixels, and the frames have 64x48"):
        fused(VectorFolder(save_translation(tmp_path / "b", 3, (6, 8), 0, 0)), still, still)
