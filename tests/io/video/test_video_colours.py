"""Colour, depth, mastering display and light levels on the whole way: what was in a clip, and what becomes of it."""

import struct
from dataclasses import replace
from fractions import Fraction
from itertools import cycle
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from av.video.reformatter import VideoReformatter

from fpsboost import DecodeOptions, Encoding, Summary, Timing, convert, methods
from fpsboost.io.video.source import VideoSource
from fpsboost.media.encoder import with_hdr
from fpsboost.media.pixels import SCALER_FLAGS, chroma_location_of, plane_arrays
from fpsboost.media.traits import LightLevel, MasteringDisplay, VideoTraits, parse_mastering_display
from support.video_truth import copy_packets, pictures_of, samples_of, write_clip

SIZE = 48, 64
BT709, BT601, BT2020, PQ, HLG = 1, 6, 9, 16, 18
LIMITED, FULL = 1, 2
LOSSLESS = {
    "libx264": {"qp": "0", "preset": "ultrafast"},
    "libx264rgb": {"qp": "0", "preset": "ultrafast"},
    "libx265": {"preset": "ultrafast", "x265-params": "lossless=1:log-level=error"},
}


def gradients(pixel_format: str, full_range: bool) -> av.VideoFrame:
    """Smooth slopes in every plane, across and down, of colours that RGB can hold."""
    picture = av.VideoFrame(SIZE[1], SIZE[0], pixel_format)
    depth = picture.format.components[0].bits
    unit = 2.0 ** (depth - 8)
    low, high = (0, 2**depth - 1) if full_range or picture.format.is_rgb else (16 * unit, 235 * unit)
    for index, plane in enumerate(plane_arrays(picture)):
        height, width = plane.shape
        y, x = np.mgrid[0:height, 0:width] / np.array([height, width]).reshape(2, 1, 1)
        if index == 0 or picture.format.is_rgb:
            # luma keeps away from black and white, where no chroma is left to RGB
            plane[:] = np.rint(low + (high - low) * (0.35 + 0.3 * (x if index == 0 else y)))
        else:
            plane[:] = np.rint(128 * unit + 28 * unit * ((y if index == 1 else x) - 0.5))
    return picture


def write_still(path: Path, pixel_format: str, codec: str, **tags: int) -> Path:
    """A clip of slopes, coded without loss; `tags` are attributes of pictures."""
    full_range = tags.get("color_range") == FULL or pixel_format.startswith("yuvj")
    return write_pictures(path, gradients(pixel_format, full_range), codec, **tags)


def write_pictures(path: Path, picture: av.VideoFrame, codec: str, **tags: int) -> Path:
    """A clip that shows one picture three times, coded without loss."""
    with av.open(str(path), "w") as output:
        stream = output.add_stream(codec, rate=25, width=picture.width, height=picture.height)
        stream.pix_fmt = picture.format.name
        stream.options = LOSSLESS.get(codec, {})
        for name, value in tags.items():
            setattr(stream.codec_context, name, value)
            setattr(picture, name, value)
        for index in range(3):
            picture.pts, picture.time_base = index, Fraction(1, 25)
            output.mux(stream.encode(picture))
        output.mux(stream.encode(None))
    return path


def doubled(source: Path, target: Path, encoding: Encoding, method: str = "blend") -> list[av.VideoFrame]:
    """The pictures of a clip converted to twice its rate; made ones have odd numbers, but for the last."""
    rate = Fraction(25) if source.is_dir() else None
    convert(
        str(source),
        str(target),
        method=replace(methods[method], cuts=None),
        timing=Timing(duplicates="keep"),
        encoding=encoding,
        decoding=DecodeOptions(input_fps=rate),
    )
    return pictures_of(target)


def differences(one: av.VideoFrame, other: av.VideoFrame) -> list[np.ndarray[Any, Any]]:
    """Of every plane, in levels of its own depth."""
    assert one.format.name.replace("yuvj", "yuv") == other.format.name.replace("yuvj", "yuv")
    return [b.astype(float) - a for a, b in zip(samples_of(one), samples_of(other), strict=True)]


YCC = [f"yuv{layout}p{depth}" for layout in (420, 422, 444) for depth in ("", "10le", "12le")]
RANGES = pytest.mark.parametrize("color_range", [LIMITED, FULL], ids=["limited", "full"])


STILLS: list[tuple[str, str, str, dict[str, int]]] = [
    *(
        (pixel_format, "ffv1", "blend", {"colorspace": matrix, "color_range": color_range})
        for pixel_format, matrix in zip(
            [*YCC, "gray", "gray10le", "gray12le"], cycle([BT601, BT709, BT2020]), strict=False
        )
        for color_range in (LIMITED, FULL)
    ),
    *((name, "ffv1", "blend", {}) for name in ("gbrp10le", "gbrp12le", "bgr0")),
    ("yuvj420p", "libx264", "blend", {}),
    ("gbrp", "libx265", "blend", {}),
    *((name, "ffv1", "nlm", {}) for name in ("yuv420p", "yuv420p10le", "yuv444p12le", "gray10le", "gbrp10le")),
]


@pytest.mark.parametrize(("pixel_format", "codec", "method", "tags"), STILLS)
def test_made_frames_have_the_colours_of_their_originals(tmp_path, pixel_format, codec, method, tags):
    """Of a still: in every layout, depth and range, with every matrix in some of them, and by the default method.

    Originals pass to the bit; made ones are off by 0.1 of a level at the mean of each plane, and by 2 at most.
    """
    clip = write_still(tmp_path / "in.mkv", pixel_format, codec, **tags)
    original = pictures_of(clip)[0]
    pictures = doubled(clip, tmp_path / "out.mkv", Encoding(codec=codec, lossless=True), method)
    assert len(pictures) == 6
    for index, picture in enumerate(pictures):
        for off in differences(original, picture):
            assert abs(off.mean()) < (0.1 if index % 2 else 1e-9)
            assert np.abs(off).max() <= (2 if index % 2 else 0)


def with_palette(alpha: int = 255) -> av.VideoFrame:
    """Noise of 256 colours, of which one has this alpha."""
    random = np.random.default_rng(0)
    palette = random.integers(0, 256, (256, 4), np.uint8)
    palette[:, 0], palette[7, 0] = 255, alpha  # ARGB
    return av.VideoFrame.from_ndarray((random.integers(0, 256, SIZE, np.uint8), palette), format="pal8")


def colours(picture: av.VideoFrame, pixel_format: str = "bgr24") -> np.ndarray[Any, Any]:
    """What FFmpeg shows of a picture."""
    shown = VideoReformatter().reformat(picture, format=pixel_format, interpolation=SCALER_FLAGS).to_ndarray()
    return shown.astype(float)


@pytest.mark.parametrize("encoding", [Encoding(codec="ffv1"), Encoding(lossless=True)], ids=["ffv1", "h264"])
@pytest.mark.parametrize(
    ("codec", "pixel_format"),
    [
        *(("png", kind) for kind in ("pal8", "gray", "ya8", "rgb24", "monob")),
        *(("rawvideo", kind) for kind in ("pal8", "gray", "ya8", "monow", "bgr8", "rgb565le", "rgb4_byte")),
        ("amv", "yuvj420p"),
    ],
)
def test_every_frame_has_the_colours_that_ffmpeg_shows(tmp_path, codec, pixel_format, encoding):
    """Of a still with a palette, in gray, in packed samples, in planes from bottom to top with chroma in the centre."""
    still = gradients("bgr0" if pixel_format != "yuvj420p" else pixel_format, full_range=True)
    still = with_palette() if pixel_format == "pal8" else still.reformat(format=pixel_format)
    clip = write_pictures(tmp_path / "in.nut", still, codec)
    expected = colours(pictures_of(clip)[0])
    pictures = doubled(clip, tmp_path / "out.mkv", encoding)
    assert len(pictures) == 6
    for picture in pictures:
        off = colours(picture) - expected
        assert (abs(off.mean()) < 0.2, np.abs(off).max() <= 4) == (True, True)
        assert codec != "amv" or chroma_location_of(picture, VideoReformatter()) == "center"


def test_transparent_colours_of_a_palette_are_kept_or_said_to_be_lost(tmp_path):
    """As alpha of BGRA; a palette without any gives no alpha."""
    clip = write_pictures(tmp_path / "in.nut", with_palette(alpha=70), "rawvideo")
    with VideoSource(clip, keeps_alpha=True) as source:
        np.testing.assert_array_equal(next(iter(source)).image, colours(pictures_of(clip)[0], "bgra"))
        assert not source.remarks
    for alpha in (70, 255):
        with VideoSource(write_pictures(clip, with_palette(alpha), "rawvideo")) as source:
            assert next(iter(source)).image.shape[2] == 3
            assert ["alpha" in remark for remark in source.remarks] == [True] * (alpha < 255)


TAGS = [
    (BT709, 1, 1, LIMITED),
    (BT601, 6, 6, LIMITED),
    (5, 5, 6, FULL),
    (BT2020, 9, PQ, LIMITED),
    (BT2020, 9, HLG, FULL),
]


@pytest.mark.parametrize("tags", TAGS, ids=["709", "601", "601 full", "PQ", "HLG full"])
@pytest.mark.parametrize(
    ("codec", "suffix"),
    [
        ("h264", ".mp4"),
        ("h264", ".mov"),
        ("hevc", ".mp4"),
        ("hevc", ".mkv"),
        ("vp9", ".webm"),
        ("av1", ".mkv"),
        ("ffv1", ".mkv"),
    ],
)
def test_tags_are_what_a_reader_sees(tmp_path, codec, suffix, tags):
    """Matrix, primaries, transfer and range are on every picture as they were on the source's."""
    named = dict(zip(("colorspace", "color_primaries", "color_trc", "color_range"), tags, strict=True))
    clip = write_still(tmp_path / "in.mkv", "yuv420p10le", "libx265", **named)
    preset = {"vp9": "8", "av1": "12", "ffv1": None}.get(codec, "ultrafast")
    for picture in [
        *pictures_of(clip),
        *doubled(clip, tmp_path / f"out{suffix}", Encoding(codec=codec, preset=preset)),
    ]:
        assert (picture.colorspace, picture.color_primaries, picture.color_trc, picture.color_range) == tags


@pytest.mark.parametrize(
    ("codec", "pixel_format", "suffix", "target"),
    [
        ("libx264", "yuv420p", ".mkv", ".mp4"),
        ("libx265", "yuv420p10le", ".mkv", ".mkv"),
        ("libx265", "yuv420p10le", ".mkv", ".mp4"),
        ("libx265", "yuv420p10le", ".mp4", ".mkv"),
        ("libvpx-vp9", "yuv420p", ".webm", ".mkv"),
        ("libvpx-vp9", "yuva420p", ".webm", ".webm"),
        ("prores_ks", "yuv422p10le", ".mov", ".mp4"),
        ("ffv1", "yuv420p", ".mkv", ".mkv"),
    ],
)
def test_tags_of_the_container_count_where_the_stream_has_none(tmp_path, codec, pixel_format, suffix, target):
    """Matrix, primaries and transfer that no coded picture says are on every picture of the output."""
    plain = write_still(tmp_path / f"plain{suffix}", pixel_format, codec)
    tags = {"colorspace": BT2020, "color_primaries": 9, "color_trc": PQ}
    clip = copy_packets(plain, tmp_path / f"in{suffix}", tags=tags)
    preset = "8" if target == ".webm" else "ultrafast"
    for picture in doubled(clip, tmp_path / f"out{target}", Encoding(preset=preset)):
        assert {name: getattr(picture, name) for name in tags} == tags


@RANGES
@pytest.mark.parametrize("pixel_format", ["yuv444p", "yuv444p10le", "gray", "gray10le"])
def test_images_of_a_video_span_the_whole_range(tmp_path, pixel_format, color_range):
    """White is white and black is black in PNG, of 16 bits where there were more than 8, and made ones agree."""
    clip = tmp_path / "in.mkv"
    picture = av.VideoFrame(SIZE[1], SIZE[0], pixel_format)
    unit = 2 ** (picture.format.components[0].bits - 8)
    # FFmpeg takes gray for full range whatever it says of itself
    full = color_range == FULL or pixel_format.startswith("gray")
    black, white = (0, 256 * unit - 1) if full else (16 * unit, 235 * unit)
    for index, plane in enumerate(plane_arrays(picture)):
        plane[:] = 128 * unit
        if index == 0:
            plane[:, :32], plane[:, 32:] = black, white
    write_pictures(clip, picture, "ffv1", color_range=color_range)
    convert(str(clip), str(tmp_path / "out"), method="blend", duplicates="keep")
    images = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((tmp_path / "out").iterdir())]
    assert len(images) == 5
    for image in images:
        assert image.dtype == (np.uint8 if unit == 1 else np.uint16)
        assert (image[:, :32] == 0).all()
        assert (image[:, 32:] == np.iinfo(image.dtype).max).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_video_of_images_says_how_its_colours_are_meant(tmp_path, dtype):
    """Tagged with a matrix and a range, and back in images within two levels of the video's depth."""
    (tmp_path / "in").mkdir()
    rows, columns = np.mgrid[0 : SIZE[0], 0 : SIZE[1]] / 64
    image = np.rint(np.stack([0.2 + 0.5 * rows, 0.3 + 0.4 * columns, 0.5 + 0 * rows], -1) * np.iinfo(dtype).max)
    for index in range(3):
        cv2.imwrite(str(tmp_path / "in" / f"{index}.png"), image.astype(dtype))
    encoding = Encoding(codec="ffv1" if dtype is np.uint16 else "h264", pixel_format=None, lossless=True)
    pictures = doubled(tmp_path / "in", tmp_path / "out.mkv", encoding)
    for picture in pictures:
        assert picture.format.is_rgb or (picture.colorspace in (BT601, BT709) and picture.color_range == LIMITED)
    convert(str(tmp_path / "out.mkv"), str(tmp_path / "back"), method="blend", duplicates="keep", factor=1)
    step = np.iinfo(dtype).max / (2 ** pictures[0].format.components[0].bits - 1)
    for path in (tmp_path / "back").iterdir():
        back = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        off = (back.astype(float) * np.iinfo(dtype).max / np.iinfo(back.dtype).max - image) / step
        assert np.abs(off.mean(axis=(0, 1))).max() < 0.6
        assert np.abs(off[4:-4, 4:-4]).max() <= 3


DISPLAY = MasteringDisplay(
    colours=(
        (Fraction(34, 50), Fraction(16, 50)),
        (Fraction(13250, 50000), Fraction(34500, 50000)),
        (Fraction(7500, 50000), Fraction(3000, 50000)),
        (Fraction(15635, 50000), Fraction(16450, 50000)),
    ),
    brightest=Fraction(1000),
    darkest=Fraction(1, 200),
)
LIGHT = LightLevel(1000, 400)
TEXT = "G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,50)"


def write_hdr(path: Path, parameters: str = f"mastering-display={TEXT}:cll=1000,400") -> Path:
    """Four frames in PQ of a display and a light level."""
    options = {"preset": "ultrafast", "x264-params": parameters}
    tags = {"color_primaries": 9, "color_trc": 16, "colorspace": 9}
    return write_clip(path, times=range(4), pixel_format="yuv420p10le", size=(64, 64), options=options, **tags)


def converted(source: Path, target: Path, encoding: Encoding) -> tuple[VideoTraits, Summary]:
    """What a conversion writes, read from its decoded frames, and what it says."""
    summary = convert(str(source), str(target), method="nearest", encoding=encoding)
    with VideoSource(target) as written:
        return written.traits, summary


@pytest.mark.parametrize(("codec", "suffix"), [("h264", ".mp4"), ("h264", ".mkv"), ("hevc", ".mp4"), ("av1", ".mkv")])
def test_both_arrive(tmp_path, codec, suffix):
    """Numbers are the same in the output, to the digits that its format keeps, and nothing is said to be lost."""
    encoding = Encoding(codec=codec, preset="12" if codec == "av1" else "ultrafast")
    traits, summary = converted(write_hdr(tmp_path / "in.mp4"), tmp_path / f"out{suffix}", encoding)
    found = traits.mastering_display
    assert found is not None
    assert summary.remarks == []
    assert traits.light_level == LIGHT
    if codec != "av1":
        assert found == DISPLAY
    assert found.colours is not None
    for point, expected in zip(found.colours, DISPLAY.colours or (), strict=True):
        assert point == pytest.approx(expected, abs=2**-16)
    assert (found.brightest, found.darkest) == pytest.approx((1000, 0.005), abs=2**-14)


def test_parameters_of_the_user_stay_and_win(tmp_path):
    """Further parameters of the same encoder are joined, and a light level that is given replaces the source's."""
    options = (("x265-params", "keyint=2:max-cll=600,200"),)
    encoding = Encoding(codec="hevc", preset="ultrafast", encoder_options=options)
    traits, summary = converted(write_hdr(tmp_path / "in.mp4"), tmp_path / "out.mp4", encoding)
    assert traits.light_level == LightLevel(600, 200)
    assert traits.mastering_display == DISPLAY
    assert "keyint=2" in summary.details


def test_what_cannot_keep_them_says_so(tmp_path):
    """An encoder that is not told about either loses them with a remark, and one that has nothing to lose is quiet."""
    traits, summary = converted(write_hdr(tmp_path / "in.mp4"), tmp_path / "out.mkv", Encoding(codec="ffv1"))
    assert (traits.mastering_display, traits.light_level) == (None, None)
    assert summary.remarks == [f"{tmp_path / 'out.mkv'} lost the HDR mastering data of its source."]
    assert with_hdr({"a": "b"}, "ffv1", None, None) == ({"a": "b"}, True)


def test_half_a_display_is_not_invented():
    """Luminance without colours has no words in an encoder's option, so it counts as lost."""
    numbers = [0, 1] * 8 + [50, 10000, 1000, 1]
    display = parse_mastering_display(struct.pack("=22i", *numbers, 0, 1))
    assert display == MasteringDisplay(None, Fraction(1000), Fraction(1, 200))
    assert with_hdr({}, "libx264", display, LIGHT) == ({"x264-params": "cll=1000,400"}, False)
