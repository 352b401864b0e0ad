"""Scene-linear colours: compared on a scale that exposure does not change, mixed as they are."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost import DecodeOptions, Encoding, OptionError, convert, methods, stream
from fpsboost.colour import compared_colours
from fpsboost.evaluation.compared_methods import ComparedInterpolator
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.io.images.encoder import encode_image
from fpsboost.io.images.exr import read_exr
from fpsboost.io.video.source import VideoSource
from support.exr_truth import write_exr
from support.truth import moved_waves

SIZE = 48, 80


def light(number: int) -> np.ndarray:
    """A scene with deep shadows and highlights, moved by 3 pixels a frame; (H, W, 3) float32."""
    return (2 ** (8 * moved_waves(SIZE, 3 * number) - 6)).astype(np.float32)


def write_light(path: Path, image: np.ndarray) -> None:
    """Write light as an OpenEXR file of whole floats, in a folder that need not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_exr(path, dict(zip("BGR", np.moveaxis(image, -1, 0), strict=True)), half=False)


def read_light(path: Path) -> np.ndarray:
    """Read light from an OpenEXR file."""
    planes = read_exr(path)
    return np.dstack([planes[name] for name in "BGR"])


def made(folder: Path, exposure: float) -> np.ndarray:
    """The frame between two frames of such a scene, as light of exposure 1."""
    for number in range(3):
        write_light(folder / "in" / f"{number:04d}.exr", light(2 * number) * np.float32(exposure))
    convert(str(folder / "in"), str(folder / "out"))
    return read_light(folder / "out" / "0001.exr") / np.float32(exposure)


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


def test_a_view_transform_for_previews(tmp_path):
    """Light as sRGB shows it, in video; without the option it stays linear, which is said."""
    source = tmp_path / "in"
    for number in range(2):
        write_light(source / f"{number}.exr", np.full((32, 32, 3), 0.18, np.float32))
    encoding, decoding = Encoding(codec="ffv1", pixel_format="gbrp16le"), DecodeOptions(input_fps=24, view="srgb")
    summary = convert(str(source), str(tmp_path / "view.mkv"), encoding=encoding, decoding=decoding)
    assert not any("looks dark" in remark for remark in summary.remarks)
    with VideoSource(tmp_path / "view.mkv") as video:
        assert next(iter(video)).array.mean() / 65535 == pytest.approx(0.4613, abs=1e-3)
    plain = convert(str(source), str(tmp_path / "linear.mkv"), encoding=encoding, decoding=DecodeOptions(input_fps=24))
    assert sum("looks dark" in remark for remark in plain.remarks) == 1
    with VideoSource(tmp_path / "linear.mkv") as video:
        assert next(iter(video)).array.mean() / 65535 == pytest.approx(0.18, abs=1e-3)


def test_views_that_do_not_apply_are_refused(tmp_path):
    """For images, which keep their light, for other types of file, and for videos."""
    for name, suffix in (("exr", ".exr"), ("png", ".png")):
        (tmp_path / name).mkdir()
        for number in range(2):
            path, image = tmp_path / name / f"{number}{suffix}", np.zeros((8, 8, 3), np.uint8)
            path.write_bytes(encode_image(path, image if name == "png" else image.astype(np.float32)))
    view = DecodeOptions(input_fps=24, view="srgb")
    with pytest.raises(OptionError, match="keep their light"):
        convert(str(tmp_path / "exr"), str(tmp_path / "out"), decoding=view)
    with pytest.raises(OptionError, match="is for OpenEXR"):
        convert(str(tmp_path / "png"), str(tmp_path / "out.mp4"), decoding=view)
    with pytest.raises(OptionError, match="`view`"):
        convert(str(tmp_path / "exr" / "0.exr"), str(tmp_path / "out.mp4"), decoding=DecodeOptions(view="srgb"))


def test_comparisons_and_streams_make_what_conversions_make(tmp_path):
    """Frames of dark light, as files, as arrays, and hidden and made again."""
    for folder, numbers in {"in": (0, 1, 2), "half": (0, 2)}.items():
        for number in numbers:
            write_light(tmp_path / folder / f"{number:04d}.exr", light(number) / np.float32(256))
    convert(str(tmp_path / "half"), str(tmp_path / "out"))
    expected = read_light(tmp_path / "out" / "0001.exr")
    (again,) = ComparedInterpolator(methods["nlm"]).interpolate(HoldOut().intervals(str(tmp_path / "in")))
    np.testing.assert_array_equal(again.image, expected)
    np.testing.assert_array_equal(list(stream(str(tmp_path / "half")))[1], expected)
