"""Scene-linear colours: compared on a scale that exposure does not change, mixed as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from truth import waves

from fpsboost.conversion import convert
from fpsboost.io.images.exr import read_exr, write_exr
from fpsboost.scene_linear import compared_colours

SIZE = 48, 80


def light(number: int) -> np.ndarray:
    """A scene with deep shadows and highlights, moved by 3 pixels a frame; (H, W, 3) float32."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    return (2 ** (8 * waves(x - 3 * number, y) - 6)).astype(np.float32)


def made(folder: Path, exposure: float) -> np.ndarray:
    """The frame between two frames of such a scene, as light of exposure 1."""
    source = folder / "in"
    source.mkdir(parents=True)
    for number in range(3):
        image = light(2 * number) * np.float32(exposure)
        write_exr(source / f"{number:04d}.exr", {name: image[..., i] for i, name in enumerate("BGR")}, half=False)
    convert(str(source), str(folder / "out"))
    planes = read_exr(folder / "out" / "0001.exr")
    return np.dstack([planes[name] for name in "BGR"]) / np.float32(exposure)


def test_the_same_scene_in_any_exposure_moves_the_same(tmp_path):
    """From a thousandth to a thousand times the light; and what comes out is right, in the shadows too."""
    frames = [made(tmp_path / str(exposure), exposure) for exposure in (1 / 1024, 1, 1024)]
    inside = np.s_[8:-8, 12:-12]
    for frame in frames:
        np.testing.assert_allclose(frame[inside], frames[1][inside], rtol=2e-3)
        stops = np.log2(np.maximum(frame[inside], 1e-4)) - np.log2(light(1)[inside])
        assert np.abs(stops).mean() < 0.05


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_alpha_stays_and_all_is_finite(channels):
    """Also with black frames, negative values, infinity and no numbers."""
    image = np.random.default_rng(1).random((5, 7, channels), np.float32)
    image[0, :3] = [[np.nan] * channels, [np.inf] * channels, [-1.0] * channels]
    if channels in {2, 4}:
        image[..., -1] = 0.5
        assert (compared_colours(image)[..., -1] == 0.5).all()
    assert np.isfinite(compared_colours(image)).all()
    assert (compared_colours(np.zeros_like(image))[..., 0] == 0).all()


@given(value=st.floats(1e-3, 1e3), exposure=st.floats(1e-3, 1e3))
def test_brighter_is_brighter(value, exposure):
    """The scale keeps the order of values, and a frame of one value is middle gray."""
    image = np.array([[[value * exposure], [value * 1.5 * exposure]]], np.float32)
    low, high = compared_colours(image)[0, :, 0]
    assert low < high
    assert compared_colours(image[:, :1])[0, 0, 0] == pytest.approx(0.587, abs=0.001)
