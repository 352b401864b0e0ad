"""The motion in an encoder's stream, against constructed truth."""

from __future__ import annotations

import numpy as np
import pytest
from truth import affine, as_type, noise, prepared

from fpsboost.errors import OptionError
from fpsboost.motion import block
from fpsboost.motion.block import CodecMotion


@pytest.mark.parametrize("shift", [(6, -4), (-5, 3), (2.5, 1.25)])
@pytest.mark.parametrize("size", [(96, 128), (97, 125)])
def test_translations_are_found(size, shift):
    """Half of the frame to half a pixel, in both directions; even and odd sizes."""
    clip = affine(*size, shift=shift, seed=1)
    for field, sign in zip(CodecMotion().estimate(*clip.prepared), (1, -1), strict=True):
        assert field.flow.shape == (*size, 2)
        off = np.median(field.flow, axis=(0, 1)) - np.multiply(sign, shift)
        assert np.abs(off).max() <= 0.5
        assert np.median(field.similarity) > 0.95


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_any_image_can_be_encoded(channels, dtype):
    """Gray, colour, alpha, deep and float: the same motion."""
    clip = affine(64, 96, shift=(5, -3), channels=channels, dtype=dtype, seed=2)
    for field, sign in zip(CodecMotion().estimate(*clip.prepared), (1, -1), strict=True):
        assert np.abs(np.median(field.flow, axis=(0, 1)) - np.multiply(sign, (5, -3))).max() <= 0.5


def test_blocks_without_a_vector_are_not_usable():
    """Where there is nothing to predict from, blocks are stored as they are: no motion, and no similarity."""
    flat, busy = as_type(np.full((64, 96, 3), 0.5), np.uint8), affine(64, 96).image0
    field, _ = CodecMotion().estimate(*prepared(busy, flat))
    without = field.similarity == 0
    assert without.mean() > 0.5
    assert not field.flow[without].any()


def test_blocks_of_all_sizes_have_their_pixels():
    """Whole, halved either way, and quarters; the frame cuts some off."""
    blocks = [(8, 8, 16, 16), (24, 4, 16, 8), (24, 12, 16, 8), (36, 8, 8, 16), (44, 8, 8, 16)]
    blocks += [(4, 20, 8, 8), (12, 20, 8, 8), (4, 28, 8, 8)]
    names = ("dst_x", "dst_y", "w", "h")
    numbers = block._block_numbers(np.array(blocks, [(name, int) for name in names]), 27, 45)
    expected = np.zeros((32, 48), int)
    for number, (x, y, width, height) in enumerate(blocks, 1):
        expected[y - height // 2 : y + height // 2, x - width // 2 : x + width // 2] = number
    np.testing.assert_array_equal(numbers, expected[:27, :45])


def test_a_missing_encoder_is_said(monkeypatch):
    """With what to take instead."""
    monkeypatch.setattr("fpsboost.io.video.block_vectors.ENCODER", "libnothing")
    with pytest.raises(OptionError, match=r"libnothing.*take block"):
        CodecMotion().estimate(*prepared(noise(16, 16), noise(16, 16)))
