"""The least-squares step to fractions of a pixel, against a slow twin and against smooth textures."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fpsboost.kernels.refine import refine_bidirectional
from support.planes import plane_pair, points
from support.truth import moved_waves, noise
from support.twins import refined

PADDING = 40

UNIT = 4 / 255  # widths of the similarity of one level

DAMPING, TAIL = 0.1 / UNIT**2, UNIT**2 / 32


def refine(components0, components1, step, flow, damping=DAMPING, largest=1.0, steps=1, known=None):
    """The kernel on a copy of the flow, from frame 0 to frame 1."""
    out = np.array([flow, np.zeros_like(flow)], np.float32)
    limits = np.float32(TAIL), np.float32(damping), np.float32(largest), steps
    known = np.empty((2, 0, 0, 2), np.float32) if known is None else np.stack([known, known])
    refine_bidirectional(plane_pair(components0, components1, PADDING, 0), step, *limits, known, out)
    return out[0]


def moved(size, shift, seed=5):
    """Levels of a smooth texture in two frames, of some contrast, that shifts by ``(dx, dy)``."""
    frames = [moved_waves(size, k * shift[0], k * shift[1], seed=seed) for k in (0, 1)]
    return [np.rint(255 * frame).clip(0, 255).astype(np.uint8) for frame in frames]


@settings(max_examples=8)
@given(
    st.integers(1, 20),
    st.integers(1, 20),
    st.integers(4, 9),
    st.sampled_from([1, 50]),
    st.sampled_from([1.0, 0.25]),
    st.sampled_from([1, 2, 16]),
    st.sampled_from([6, 500]),
    st.integers(0, 2**32),
)
@example(20, 24, 8, 1, 1.0, 4, 500, 1)
def test_refinement_equals_its_slow_twin(height, width, step, damping, largest, divisor, farthest, seed):
    """Any frames, with the largest differences of bytes too, and vectors that lead anywhere, also beyond the padding.

    Everything out there is the frame's edge.
    """
    random = np.random.default_rng(seed)
    components = [noise(height, width, 3, np.uint8, seed + k) // divisor for k in (0, 1)]
    flow = random.integers(-farthest, farthest + 1, (*points((height, width), step), 2)).astype(np.float32)
    found = refine(*components, step, flow, damping * DAMPING, largest)
    np.testing.assert_allclose(found, refined(*components, step, TAIL, damping * DAMPING, largest, flow), atol=1e-3)


@pytest.mark.parametrize("steps", [2, 3])
def test_further_steps_start_from_the_nearest_whole_pixel(steps):
    """Bit by bit what so many single steps give, each from where the last one led, for those that left their pixel."""
    components = moved((30, 50), (0.4, -0.3))
    flow = np.random.default_rng(3).uniform(-2, 2, (*points((30, 50), 6), 2)).astype(np.float32)
    expected = refine(*components, 6, flow)
    moving = (np.rint(expected) != np.rint(flow)).any(axis=-1)
    assert moving.any()
    assert not moving.all()
    for _ in range(steps - 1):
        again = refine(*components, 6, expected)
        again[~moving] = expected[~moving]
        moving &= (np.rint(again) != np.rint(expected)).any(axis=-1)
        expected = again
    np.testing.assert_array_equal(refine(*components, 6, flow, steps=steps), expected)


@pytest.mark.parametrize("shift", [(0.25, -0.1), (0.4, 0.4), (3.3, -1.8), (-0.45, 0.0)])
def test_fractions_of_a_pixel_are_found(shift):
    """From the nearest whole pixel, a smooth texture's vector is right to 0.05 pixels on average."""
    components = moved((40, 56), shift)
    flow = np.broadcast_to(np.rint(np.float32(shift)), (*points((40, 56), 8), 2))
    off = np.linalg.norm(refine(*components, 8, flow) - np.float32(shift), axis=-1)
    assert off[1:-1, 1:-1].mean() < 0.05


def test_equal_frames_stay_where_they_are():
    """Where nothing changes there is no step, to the bit; nor where there is no gradient."""
    image = noise(24, 30, 3)
    still = np.zeros((*points((24, 30), 8), 2), np.float32)
    assert not refine(image, image, 8, still).any()
    assert not refine(np.full_like(image, 50), np.full_like(image, 80), 8, still).any()


def test_what_is_known_is_not_refined_again():
    """Vectors that begin at the same whole pixels as known ones become those, bit by bit; the others are refined."""
    components = moved((30, 50), (0.4, -0.3))
    flow = np.random.default_rng(3).integers(-1, 2, (*points((30, 50), 6), 2)).astype(np.float32)
    known = flow + np.float32(0.25)
    known[::2] += 3
    found = refine(*components, 6, flow, known=known)
    np.testing.assert_array_equal(found[1::2], known[1::2])
    np.testing.assert_array_equal(found[::2], refine(*components, 6, flow)[::2])


def test_both_directions_are_refined_like_each_by_itself():
    """From frame 0 to frame 1 and back, bit by bit, with what is known of each."""
    components, random = moved((30, 50), (0.4, -0.3)), np.random.default_rng(3)
    flow = random.integers(-1, 2, (2, *points((30, 50), 6), 2)).astype(np.float32)
    known = flow + random.choice(np.float32([0.25, 3]), flow.shape)
    found = flow.copy()
    limits = np.float32(TAIL), np.float32(DAMPING), np.float32(1), 2
    refine_bidirectional(plane_pair(*components, PADDING, 0), 6, *limits, known, found)
    ways = zip((components, components[::-1]), flow, known, strict=True)
    expected = [refine(*both, 6, start, steps=2, known=fixed) for both, start, fixed in ways]
    np.testing.assert_array_equal(found, expected)


def test_what_noise_explains_by_chance_is_no_motion():
    """Most vectors between frames of nothing but noise stay as they are."""
    components = [noise(80, 80, 3, seed=seed) // 4 for seed in (1, 2)]
    assert (refine(*components, 8, np.zeros((*points((80, 80), 8), 2), np.float32)) == 0).mean() > 0.8
