"""How motion changes from point to point: exact for zooms and rotations, nothing at the edges of things."""

from __future__ import annotations

import numpy as np
import pytest

from fpsboost.motion.field import motion_gradients

SPACING = 8


@pytest.mark.parametrize("matrix", [[[0.1, 0], [0, 0.1]], [[0, -0.2], [0.2, 0]], [[0.05, -0.1], [0.02, 0]]])
def test_even_change_is_found_exactly(matrix):
    """A zoom, a rotation and a shear, at all points but the outermost, of which one side is not known."""
    y, x = SPACING * np.mgrid[0:6, 0:7]
    vectors = np.float32(np.stack([x, y], axis=-1) @ np.transpose(matrix))
    gradients = motion_gradients(vectors, SPACING)
    inner = gradients[1:-1, 1:-1]
    np.testing.assert_allclose(inner, np.broadcast_to(np.transpose(matrix), inner.shape), atol=1e-5)
    assert not gradients[:, [0, -1], 0].any()
    assert not gradients[[0, -1], :, 1].any()


def test_the_edge_of_a_thing_is_no_zoom():
    """One thing moves over another: next to the edge the difference is large on one side and none on the other."""
    vectors = np.zeros((5, 8, 2), np.float32)
    vectors[:, 4:] = 12, -5
    assert not motion_gradients(vectors, SPACING).any()


def test_a_vector_that_stands_out_has_no_gradient():
    """What rises on one side and falls on the other is noise, or a thing by itself."""
    vectors = np.zeros((5, 5, 2), np.float32)
    vectors[2, 2] = 3
    assert not motion_gradients(vectors, SPACING).any()


@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (5, 2), (1, 9)])
def test_too_few_points_say_nothing(shape):
    """Along an axis of one or two points there are no neighbours on both sides."""
    vectors = np.random.default_rng(0).normal(size=(*shape, 2)).astype(np.float32)
    gradients = motion_gradients(vectors, SPACING)
    assert gradients.shape == (*shape, 2, 2)
    for place, length in enumerate(shape[::-1]):
        assert length > 2 or not gradients[..., place, :].any()
