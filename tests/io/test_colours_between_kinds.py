"""Colours of images and videos into each other: each says what the other said, and no pixel changes."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from exr_truth import save_exr
from PIL import Image, ImageCms
from video_truth import pictures_of, samples_of, scene, write_clip

from fpsboost import convert
from fpsboost.io.images.files import read_image
from fpsboost.io.images.metadata import PNG_SIGNATURE, metadata_of
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.source import VideoSource
from fpsboost.run_options import RunOptions

BT2020, P3, PQ, HLG, SRGB, LINEAR = 9, 12, 16, 18, 13, 8
CODE_POINTS = (b"cICP", bytes((BT2020, PQ, 0, 1)))
HDR = (
    CODE_POINTS,
    (b"mDCV", struct.pack(">8H2I", 35400, 14600, 8500, 39850, 6550, 2300, 15635, 16450, 10_000_000, 50)),
    (b"cLLI", struct.pack(">2I", 10_000_000, 4_000_000)),
)
ADOBE_RGB = struct.pack(">8I", 31270, 32900, 64000, 33000, 21000, 71000, 15000, 6000)
SRGB_PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def renamed(name: str) -> bytes:
    """A profile that gives itself another name than ``sRGB built-in``, which has 13 characters."""
    return SRGB_PROFILE.replace("sRGB built-in".encode("utf-16-be"), name.ljust(13).encode("utf-16-be"))


def with_code_points(*numbers: int) -> bytes:
    """A profile with code points in place of its copyright."""
    entry = SRGB_PROFILE.index(b"cprt")
    begin = int.from_bytes(SRGB_PROFILE[entry + 4 : entry + 8])
    named = SRGB_PROFILE[:entry] + b"cicp" + SRGB_PROFILE[entry + 4 : begin]
    return named + b"cicp" + bytes((0, 0, 0, 0, *numbers, 0, 1)) + SRGB_PROFILE[begin + 12 :]


DISPLAY_P3, UNKNOWN, HLG_PROFILE = renamed("Display P3"), renamed("Adobe RGB"), with_code_points(BT2020, HLG)

Save = Callable[[Path, int], None]


def png(*chunks: tuple[bytes, bytes]) -> Save:
    """A PNG with these chunks behind its header."""

    def save(path: Path, number: int) -> None:
        data = cv2.imencode(".png", scene(number))[1].tobytes()
        behind = len(PNG_SIGNATURE) + 25
        coded = (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
            for name, body in chunks
        )
        path.write_bytes(data[:behind] + b"".join(coded) + data[behind:])

    return save


def pillow(profile: bytes | None, **options: Any) -> Save:
    """An image with an ICC profile, of the type that its path says."""
    return lambda path, number: Image.fromarray(scene(number)[..., ::-1]).save(path, icc_profile=profile, **options)


def exr(**header: Any) -> Save:
    """An OpenEXR file with attributes."""
    return lambda path, number: save_exr(
        path, ("", {name: scene(number)[..., i] / np.float32(255) for i, name in enumerate("BGR")}), **header
    )


def write(folder: Path, suffix: str, save: Save) -> Path:
    folder.mkdir()
    for number in (1, 2):
        save(folder / f"{number}{suffix}", number)
    return folder


def converted(source: Path, target: Path, **decoding: Any) -> list[str]:
    """Convert, and return the remarks."""
    encoding = Encoding(lossless=True, pixel_format="yuv444p10le") if target.suffix == ".mkv" else None
    options = DecodeOptions(input_fps=10 if source.is_dir() or "#" in source.name else None, **decoding)
    return convert(
        str(source),
        str(target),
        method="blend",
        encoding=encoding,
        decoding=options,
        run=RunOptions(overwrite=True),
    ).remarks


def tags_of(path: Path) -> tuple[int, int]:
    """Primaries and transfer function of a video or an animation."""
    picture = pictures_of(path)[0]
    return picture.color_primaries, picture.color_trc


@pytest.mark.parametrize(
    ("suffix", "save", "expected", "unnamed"),
    [
        (".png", png(), (1, 1), ""),
        (".png", png(CODE_POINTS), (BT2020, PQ), ""),
        (".png", png((b"cICP", bytes((BT2020, PQ, 0, 0)))), (BT2020, PQ), "limited range"),
        (".png", png((b"cICP", bytes((200, 200, 0, 1)))), (1, 1), "code points"),
        (".png", png((b"sRGB", b"\0")), (1, SRGB), ""),
        (".png", png((b"gAMA", struct.pack(">I", 100_000))), (1, LINEAR), ""),
        (".png", png((b"gAMA", struct.pack(">I", 55_556))), (1, 1), "gamma"),
        (".png", png((b"gAMA", struct.pack(">I", 45_455)), (b"cHRM", ADOBE_RGB)), (1, 4), "chromaticities"),
        *((suffix, pillow(DISPLAY_P3), (P3, SRGB), "") for suffix in (".png", ".jpg", ".tif", ".webp")),
        (".jpg", pillow(HLG_PROFILE), (BT2020, HLG), ""),
        (".jpg", pillow(SRGB_PROFILE), (1, SRGB), ""),
        (".jpg", pillow(with_code_points(200, 200)), (1, 1), "ICC profile"),
        (".tif", pillow(UNKNOWN), (1, 1), "ICC profile"),
        (".exr", exr(), (1, LINEAR), ""),
        (".exr", exr(), (1, SRGB), ""),  # as it is displayed
        (".exr", exr(chromaticities=(0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)), (BT2020, LINEAR), ""),
        (
            ".exr",
            exr(chromaticities=(0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.322, 0.338)),
            (1, LINEAR),
            "chromaticities",
        ),
    ],
)
def test_a_video_says_what_its_images_say(tmp_path, suffix, save, expected, unnamed):
    """Tags follow chunks, profile and attributes, samples are those without them; what has no number is said once."""
    view = "srgb" if (suffix, expected[1]) == (".exr", SRGB) else "none"
    remarks = converted(write(tmp_path / "in", suffix, save), tmp_path / "out.mkv", view=view)
    assert tags_of(tmp_path / "out.mkv") == expected
    assert [f"stands for the {unnamed} of" in remark for remark in remarks].count(True) == bool(unnamed)
    plain = {".png": png(), ".exr": exr()}.get(suffix, pillow(None))
    converted(write(tmp_path / "plain", suffix, plain), tmp_path / "plain.mkv", view=view)
    is_wide = expected[0] == BT2020  # Y, Cb and Cr by another matrix
    for picture, other in zip(pictures_of(tmp_path / "out.mkv"), pictures_of(tmp_path / "plain.mkv"), strict=True):
        pairs = zip(samples_of(picture), samples_of(other), strict=True)
        assert is_wide or all(np.array_equal(*pair) for pair in pairs)


def test_hdr_there_and_back(tmp_path):
    """Code points, mastering display and light levels of PNG become those of a video, of which code points come back.

    So do pixels, through the matrix of BT.2020. The mastering data that images do not get is said.
    """
    source = write(tmp_path / "in", ".png", png(*HDR))
    assert converted(source, tmp_path / "out.mkv") == []
    with VideoSource(str(tmp_path / "out.mkv")) as video:
        assert (video.traits.color_space, video.traits.light_level.brightest_pixel) == (BT2020, 1000)
        assert float(video.traits.mastering_display.red[0]) == pytest.approx(0.708)
    remarks = converted(tmp_path / "out.mkv", tmp_path / "back" / "")
    assert ["HDR mastering data, which images cannot hold" in remark for remark in remarks] == [True]
    for number, path in enumerate(sorted((tmp_path / "back").iterdir())[::4], 1):
        assert metadata_of(path).chunks == (CODE_POINTS,)
        assert np.abs(read_image(path) / 257 - scene(number)).max() < 2


@pytest.mark.parametrize(
    ("numbers", "suffix", "expected", "is_lost"),
    [
        ((P3, SRGB), ".png", (P3, SRGB), False),
        ((P3, SRGB), ".jpg", (1, 1), True),
        ((P3, SRGB), ".bmp", (1, 1), True),
        ((1, 1), ".png", (1, 1), False),
        ((1, 1), ".bmp", (1, 1), False),
    ],
)
def test_images_of_a_tagged_video(tmp_path, numbers, suffix, expected, is_lost):
    """PNG says the tags by cICP, and a video made of it again; of other types one note says that they cannot.

    BT.709 is what images without a word are taken for, and need not be said.
    """
    primaries, transfer = numbers
    clip = write_clip(tmp_path / "in.mp4", color_primaries=primaries, color_trc=transfer, colorspace=1, color_range=1)
    remarks = converted(clip, tmp_path / f"out_######{suffix}")
    assert ["cannot hold the colour tags of its source" in remark for remark in remarks] == [True] * is_lost
    assert bool(metadata_of(tmp_path / f"out_000001{suffix}").chunks) == (expected == (P3, SRGB))
    converted(tmp_path / f"out_######{suffix}", tmp_path / "out.mkv")
    assert tags_of(tmp_path / "out.mkv") == expected


@pytest.mark.parametrize("name", ["out.gif", "out.apng"])
def test_what_animations_cannot_say(tmp_path, name):
    """One note says what is lost, of images and of a video made of them; an animation's profile is said, too."""
    converted(write(tmp_path / "in", ".png", png(*HDR)), tmp_path / "in.mkv")
    lost = "cannot say the colour primaries and the transfer function and the HDR mastering data of its source"
    for source in (tmp_path / "in", tmp_path / "in.mkv"):
        assert [lost in remark for remark in converted(source, tmp_path / name)].count(True) == 1


def test_the_profile_of_an_animation(tmp_path):
    """It is not carried, which is said."""
    images = [Image.fromarray(scene(number)) for number in range(3)]
    images[0].save(tmp_path / "in.webp", save_all=True, append_images=images[1:], icc_profile=DISPLAY_P3)
    assert any("has an ICC profile" in remark for remark in converted(tmp_path / "in.webp", tmp_path / "out.mkv"))
