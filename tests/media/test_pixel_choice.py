"""Depth, chroma and alpha on the way into videos: kept where the codec can, said where it cannot; and which codec."""

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import DecodeOptions, Encoding, convert
from fpsboost.io.video.source import VideoSource
from fpsboost.media.containers import MATROSKA, MOV, MP4, WEBM
from fpsboost.media.encoding import default_codec
from fpsboost.media.pixels import LIMITED_RANGE, SMPTE170M
from support.comparison_truth import save_clip
from support.video_truth import QUARTER_TURN, scene, write_clip

DISPLAY = "G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,50)"


def noise(dtype: Any, channels: int = 3) -> NDArray[Any]:
    """Every value of a type alike, so that each lost bit shows."""
    top = np.iinfo(dtype).max
    image = np.random.default_rng(0).integers(0, top, (48, 64, channels), dtype=dtype, endpoint=True)
    if channels == 4:
        image[..., 3] = np.maximum(image[..., 3], 1)
    return image


def to_video(source: str, target: Path, **options: Any) -> list[str]:
    """Convert images without making any; return what was said."""
    encoding, decoding = Encoding(**options), DecodeOptions(input_fps=10)
    return convert(source, str(target), factor=1, method="nearest", encoding=encoding, decoding=decoding).remarks


def first_image(path: Path, *, alpha: bool = False) -> tuple[str, NDArray[Any]]:
    with VideoSource(path, keeps_alpha=alpha) as source:
        return source.traits.pixel_format, next(iter(source)).image


@pytest.mark.parametrize(
    ("codec", "dtype", "channels", "pixel_format"),
    [
        ("ffv1", np.uint16, 3, "gbrp16le"),
        ("ffv1", np.uint16, 4, "gbrap16le"),
        ("ffv1", np.uint16, 1, "gray16le"),
        ("ffv1", np.uint8, 3, "bgr0"),
        ("ffv1", np.uint8, 4, "bgra"),
        ("h264", np.uint8, 3, "yuv444p10le"),
        ("hevc", np.uint8, 3, "gbrp"),
        ("vp9", np.uint8, 3, "gbrp"),
        ("png", np.uint16, 3, "rgb48be"),
        (None, np.uint8, 3, "yuv444p10le"),
    ],
)
def test_lossless_images_come_back(tmp_path, codec, dtype, channels, pixel_format):
    """Every value of every pixel, without a remark: RGB as RGB, or as YCbCr deep enough to give it back."""
    image = noise(dtype, channels)
    target = tmp_path / ("out.mov" if codec == "png" else "out.mkv")
    assert to_video(save_clip(tmp_path / "in", [image] * 2), target, codec=codec, lossless=True) == []
    found, back = first_image(target, alpha=channels == 4)
    assert found == pixel_format
    back = back if back.dtype == image.dtype else np.rint(back / 257).astype(np.uint8)
    if channels == 1:
        image = np.repeat(image, 3, axis=2)
    assert np.array_equal(back, image)


@pytest.mark.parametrize(
    ("options", "suffix", "pixel_format", "lost"),
    [
        ({"codec": "h264", "lossless": True}, ".mkv", "yuv444p10le", "depth"),
        ({"codec": "hevc", "lossless": True}, ".mkv", "gbrp12le", "depth"),
        ({"codec": "h264", "preset": "ultrafast"}, ".mp4", "yuv444p10le", "depth"),
        ({"codec": "prores_ks"}, ".mov", "yuv444p10le", "depth"),
        ({"codec": "vp9", "preset": "8"}, ".webm", "yuv444p", "depth"),
        ({"codec": "hevc", "preset": "ultrafast"}, ".mp4", "yuv444p12le", "depth"),
        ({"codec": "av1", "preset": "12"}, ".mp4", "yuv420p10le", "depth and colour resolution"),
        ({"preset": "ultrafast"}, ".mp4", "yuv420p10le", "depth and colour resolution"),
    ],
    ids=str,
)
def test_deep_images_get_the_deepest_format(tmp_path, options, suffix, pixel_format, lost):
    """Of a codec that was named, or where nothing is to be lost; else what players show; what is lost is said."""
    target = tmp_path / f"out{suffix}"
    smooth = scene(0).astype(np.uint16) * 257 + np.arange(64, dtype=np.uint16)[:, None]
    (remark,) = to_video(save_clip(tmp_path / "in", [smooth] * 2), target, **options)
    assert f"has less {lost} than its source: " in remark
    assert remark.endswith(
        f"wrote {pixel_format} for gbrp16le; `codec='ffv1'` in an .mkv keeps up to 16 bits of every colour."
    )
    found, back = first_image(target)
    assert found == ("yuv444p12le" if suffix == ".mov" else pixel_format)  # what FFmpeg decodes ProRes 4444 to
    scale = 1 if back.dtype == np.uint16 else 257
    assert np.abs(back.astype(float) * scale - smooth).mean() < 600


def test_images_of_8_bits_stay_what_players_show(tmp_path):
    """4:2:0 of 8 bits in H.264, as before, whether a codec is named or not, and nothing is said."""
    source = save_clip(tmp_path / "in", [scene(0)] * 2)
    for number, options in enumerate(({}, {"codec": "h264"}, {"codec": "hevc"})):
        target = tmp_path / f"{number}.mp4"
        assert to_video(source, target, preset="ultrafast", **options) == []
        assert first_image(target)[0] == "yuv420p"


def test_deep_alpha(tmp_path):
    """16 bits of colour and alpha in FFV1; VP9 keeps alpha at 8 bits and says so."""
    (remark,) = to_video(save_clip(tmp_path / "in", [noise(np.uint16, 4)] * 2), tmp_path / "out.webm", preset="8")
    assert "has less depth and colour resolution than its source: libvpx-vp9 wrote yuva420p for gbrap16le" in remark
    assert first_image(tmp_path / "out.webm", alpha=True)[0] == "yuva420p"


def test_light_beyond_white_is_said(tmp_path):
    """Floats become 16 bits where the codec has them, and what lies outside 0 to 1 is clipped; both are said once."""
    image = scene(0).astype(np.float32) / 255
    bright = image.copy()
    bright[0, 0] = 3
    target = tmp_path / "out.mkv"
    remarks = to_video(save_clip(tmp_path / "in", [image, bright, bright], ".tif"), target, codec="ffv1")
    assert remarks == [
        f"{target} holds the floating-point values of its source in 16 bits.",
        f"{target} holds no light beyond white or below black, which was clipped; images as .exr keep it.",
    ]
    assert np.array_equal(first_image(target)[1], np.rint(image * np.float32(65535)))


RGB_SOURCES = [
    *((codec, "rgb24", ".mov", "yuv420p") for codec in ("qtrle", "png")),
    *(("rawvideo", kind, ".nut", "yuv420p") for kind in ("bgr24", "rgb555le", "bgr8")),
    *(("ffv1", "bgr0", ".mkv", "yuv420p"), ("utvideo", "gbrp", ".avi", "yuv420p")),
    *(("zmbv", "bgr0", ".avi", "yuv420p"), ("libx264rgb", "bgr24", ".mkv", "yuv420p")),
    *(("ffv1", kind, ".mkv", "yuv420p10le") for kind in ("gbrp10le", "gbrp16le")),
]
"""Codec, pixel format and suffix of screen recordings and other RGB video, and what most players show of it."""


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
@pytest.mark.parametrize(("codec", "pixel_format", "ending", "expected"), RGB_SOURCES)
def test_rgb_video_becomes_what_players_show(tmp_path, codec, pixel_format, ending, expected, suffix):
    """4:2:0 of limited range, by the matrix of its size, in its own colours; the lost colour resolution is said."""
    rows, columns = np.mgrid[:48, :64]
    ramps = np.uint8(np.dstack([columns * 3 + 20, rows * 4 + 20, 220 - columns * 2]))
    clip = write_clip(
        tmp_path / f"in{ending}", times=range(2), codec=codec, pixel_format=pixel_format, picture=lambda *_: ramps
    )
    target = tmp_path / f"out{suffix}"
    (remark,) = convert(str(clip), str(target), method="nearest").remarks
    assert "colour resolution than its source" in remark
    assert f"wrote {expected} for" in remark
    with VideoSource(target) as source:
        traits, image = source.traits, next(iter(source)).image
    assert (traits.pixel_format, traits.tagged_color_space, traits.color_range) == (expected, SMPTE170M, LIMITED_RANGE)
    before, after = (each / np.float64(257 if each.dtype == np.uint16 else 1) for each in (first_image(clip)[1], image))
    off = after - before
    assert np.abs(off.mean((0, 1))).max() < 1
    assert np.abs(off).mean() < (20 if pixel_format == "bgr8" else 5)


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_rgb_video_of_odd_size(tmp_path, suffix):
    """4:2:0 where the encoder takes it; H.264, which does not, says what few players show."""
    clip = write_clip(tmp_path / "in.mkv", times=range(2), codec="ffv1", pixel_format="bgr0", size=(47, 63))
    (remark,) = convert(str(clip), str(tmp_path / f"out{suffix}"), method="nearest").remarks
    found, image = first_image(tmp_path / f"out{suffix}")
    assert image.shape == (47, 63, 3)
    assert found == ("yuv444p" if suffix == ".mp4" else "yuv420p")
    assert ("has the odd size 63x47" if suffix == ".mp4" else "has less colour resolution") in remark


@pytest.mark.parametrize(
    ("suffix", "options", "expected"),
    [
        (".mp4", {}, "yuv444p"),
        (".webm", {}, "yuv444p"),
        (".webm", {"pixel_format": "gbrp"}, "gbrp"),
        (".mp4", {"codec": "hevc", "pixel_format": "gbrp"}, "gbrp"),
    ],
)
def test_full_colour_resolution_of_rgb_video_on_request(tmp_path, suffix, options, expected):
    """4:4:4 and RGB are written if they are asked for, with a note on players."""
    clip = write_clip(tmp_path / "in.mkv", times=range(2), codec="ffv1", pixel_format="bgr0")
    target, encoding = tmp_path / f"out{suffix}", Encoding(**{"pixel_format": "yuv444p", **options})
    remarks = convert(str(clip), str(target), method="nearest", encoding=encoding).remarks
    assert remarks == [f"{target} was written as {expected}, as asked for, which few players show."]
    assert first_image(target)[0] == expected


def test_lossless_rgb_video(tmp_path):
    """A screen capture in RGB comes back from H.264 and FFV1, without a remark; 4:2:0 on request needs none either."""
    image = noise(np.uint8)
    clip = write_clip(tmp_path / "in.mkv", times=range(2), codec="ffv1", pixel_format="bgr0", picture=lambda *_: image)
    encoding = Encoding(pixel_format="yuv420p")
    assert convert(str(clip), str(tmp_path / "plain.mp4"), factor=1, encoding=encoding).remarks == []
    for codec, pixel_format in (("h264", "yuv444p10le"), ("ffv1", "bgr0")):
        target = tmp_path / f"{codec}.mkv"
        encoding = Encoding(codec=codec, lossless=True)
        assert convert(str(clip), str(target), factor=1, encoding=encoding).remarks == []
        found, back = first_image(target)
        assert found == pixel_format
        assert np.array_equal(back if back.dtype == np.uint8 else np.rint(back / 257), image)
    for codec, pixel_format in (("prores_ks", "yuv444p12le"), ("qtrle", "rgb24"), ("png", "rgb24")):
        target = tmp_path / f"{codec}.mov"
        convert(str(clip), str(target), factor=1, encoding=Encoding(codec=codec))
        assert first_image(target)[0] == pixel_format


@pytest.mark.parametrize(
    ("container", "pixel_format", "source_codec", "expected"),
    [
        (MP4, "yuv420p", "hevc", "h264"),
        (MP4, "yuv420p10le", "hevc", "hevc"),
        (MOV, "yuv422p10le", "prores", "hevc"),
        (MP4, "yuv420p10le", "h264", "h264"),
        (MP4, "yuv420p10le", "av1", "av1"),
        (MOV, "yuv420p10le", "av1", "hevc"),
        (MATROSKA, "yuv444p10le", "av1", "hevc"),
        (MATROSKA, "gbrp16le", "", "hevc"),
        (WEBM, "yuv420p", "vp9", "vp9"),
        (WEBM, "yuv420p10le", "hevc", "av1"),
        (WEBM, "yuva444p12le", "prores", "vp9"),
    ],
)
def test_default_codecs_by_depth(container, pixel_format, source_codec, expected):
    """H.264 for 8 bits; beyond that what players of such clips show; .webm as deep as it can."""
    assert default_codec(container, pixel_format, source_codec) == expected


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm"])
def test_a_phone_clip_stays_what_it_is(tmp_path, suffix):
    """10-bit HEVC becomes 10-bit HEVC that Apple's players take, with its HDR tags, mastering data and rotation."""
    clip, target = tmp_path / "in.mov", tmp_path / f"out{suffix}"
    tags = {"color_primaries": 9, "color_trc": 18, "colorspace": 9, "color_range": 1}
    options = {"preset": "ultrafast", "x265-params": f"log-level=none:master-display={DISPLAY}:max-cll=1000,400"}
    phone = {"codec": "libx265", "pixel_format": "yuv420p10le", "matrix": QUARTER_TURN, "options": options}
    write_clip(clip, times=range(4), size=(64, 64), **phone, **tags)
    preset = "12" if suffix == ".webm" else "ultrafast"
    assert convert(str(clip), str(target), method="nearest", encoding=Encoding(preset=preset)).remarks == []
    with av.open(str(target)) as file:
        context = file.streams.video[0].codec_context
        assert context.codec.canonical_name == ("av1" if suffix == ".webm" else "hevc")
        if suffix in (".mp4", ".mov"):
            assert context.codec_tag == "hvc1"
    with VideoSource(clip) as before, VideoSource(target) as after:
        a, b = before.traits, after.traits
    assert (b.pixel_format, b.display_matrix, b.light_level) == ("yuv420p10le", a.display_matrix, a.light_level)
    assert (b.color_primaries, b.color_transfer, b.tagged_color_space) == (9, 18, 9)
    assert b.mastering_display is not None
    assert float(b.mastering_display.brightest or 0) == pytest.approx(1000, abs=0.01)


def test_a_format_of_8_bits_needs_no_hevc(tmp_path):
    """--pix-fmt decides the depth, and so the codec."""
    clip = write_clip(tmp_path / "in.mkv", times=range(4), codec="ffv1", pixel_format="yuv420p10le")
    encoding = Encoding(preset="ultrafast", pixel_format="yuv420p")
    convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=encoding)
    with av.open(str(tmp_path / "out.mp4")) as file:
        assert file.streams.video[0].codec_context.codec.canonical_name == "h264"
