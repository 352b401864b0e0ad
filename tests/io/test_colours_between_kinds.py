"""Colours of images and videos into each other: each says what the other said, and no pixel changes."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from fpsboost import DecodeOptions, Encoding, convert
from fpsboost.io.images.encoder import into_png
from fpsboost.io.images.files import ImageMetadata, metadata_of, read_image
from support.exr_truth import save_exr
from support.video_truth import pictures_of, samples_of, scene

GAMMA22, BT601, BT2020, P3, PQ, HLG, SRGB, LINEAR = 4, 6, 9, 12, 16, 18, 13, 8
LINE, POWER = ({"rTRC": b"para" + bytes(8) + struct.pack(">i", round(power * 65536))} for power in (1, 2.2))
GAMMA = (b"gAMA", struct.pack(">I", 45_455))
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
IN_P3 = {"rXYZ": (0.51512, 0.2412, -0.00105), "gXYZ": (0.29198, 0.69225, 0.04189), "bXYZ": (0.1571, 0.06657, 0.78407)}
IN_ADOBE_RGB = {
    "rXYZ": (0.60974, 0.31111, 0.01947),
    "gXYZ": (0.20528, 0.62567, 0.06087),
    "bXYZ": (0.14919, 0.06322, 0.74457),
}


def profile(tags: dict[str, bytes | tuple[float, ...]]) -> bytes:
    """Pillow's profile of sRGB with other contents of tags: colorants, which are XYZ by D50, or bytes."""
    data = PROFILE
    for name, said in tags.items():
        entry = PROFILE.index(name.encode())
        begin = int.from_bytes(PROFILE[entry + 4 : entry + 8])
        content = said if isinstance(said, bytes) else struct.pack(">8s3i", b"XYZ ", *(round(v * 65536) for v in said))
        data = data[:begin] + content + data[begin + len(content) :]
    return data


HDR = (
    (b"cICP", bytes((BT2020, PQ, 0, 1))),
    (b"mDCV", struct.pack(">8H2I", 35400, 14600, 8500, 39850, 6550, 2300, 15635, 16450, 10_000_000, 50)),
    (b"cLLI", struct.pack(">2I", 10_000_000, 4_000_000)),
)


def write(folder: Path, suffix: str, said: tuple | dict | bytes) -> Path:
    """Write two images: a PNG with chunks, an OpenEXR file with attributes, or one with an ICC profile."""
    folder.mkdir()
    for number in (1, 2):
        path, image = folder / f"{number}{suffix}", scene(number)
        if isinstance(said, dict):
            save_exr(path, ("", {name: image[..., i] / np.float32(255) for i, name in enumerate("BGR")}), **said)
        elif isinstance(said, bytes):
            Image.fromarray(image[..., ::-1]).save(path, icc_profile=said)
        else:
            path.write_bytes(into_png(cv2.imencode(".png", image)[1].tobytes(), ImageMetadata(chunks=said), 3))
    return folder


def converted(source: Path, target: Path, view: str = "none") -> list[str]:
    """Convert, videos without loss, and return the remarks."""
    encoding = Encoding(lossless=True, pixel_format="yuv444p") if target.suffix == ".mkv" else None
    options = DecodeOptions(input_fps=10 if source.is_dir() or "#" in source.name else None, view=view)
    return convert(source, target, method="blend", encoding=encoding, decoding=options).remarks


def tags_of(path: Path) -> tuple[int, int, int]:
    """Primaries, transfer function and matrix of a video."""
    picture = pictures_of(path)[0]
    return picture.color_primaries, picture.color_trc, picture.colorspace


@pytest.mark.parametrize(
    ("suffix", "said", "expected", "unnamed"),
    [
        (".png", (), (1, 1), ""),
        (".png", ((b"cICP", bytes((BT2020, PQ, 0, 0))),), (BT2020, PQ), "limited range"),
        (".png", ((b"cICP", bytes((200, 200, 0, 1))),), (1, 1), "code points"),
        (".png", ((b"sRGB", b"\0"),), (1, SRGB), ""),
        (".png", ((b"gAMA", struct.pack(">I", 100_000)),), (1, LINEAR), ""),
        (".png", ((b"gAMA", struct.pack(">I", 55_556)),), (1, 1), "gamma"),
        (
            ".png",
            (GAMMA, (b"cHRM", struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000))),
            (P3, GAMMA22),
            "",
        ),
        (
            ".png",
            (GAMMA, (b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 21000, 71000, 15000, 6000))),
            (1, GAMMA22),
            "chromaticities",
        ),
        *((suffix, profile(IN_P3), (P3, SRGB), "") for suffix in (".png", ".jpg", ".tif", ".webp")),
        (".jpg", profile(IN_P3 | LINE), (P3, LINEAR), ""),
        (".jpg", profile({"cprt": b"cicp" + bytes((0, 0, 0, 0, BT2020, HLG, 0, 1))}), (BT2020, HLG), ""),
        (".jpg", PROFILE, (1, SRGB), ""),
        (".jpg", profile({"cprt": b"cicp" + bytes((0, 0, 0, 0, 200, 200, 0, 1))}), (1, 1), "ICC profile"),
        (
            ".tif",
            profile(IN_ADOBE_RGB | POWER),
            (1, GAMMA22),
            "ICC profile",
        ),
        (".exr", {}, (1, LINEAR), ""),
        (".exr", {}, (1, SRGB), ""),  # as it is displayed
        (
            ".exr",
            {"chromaticities": (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)},
            (BT2020, LINEAR),
            "",
        ),
        (
            ".exr",
            {"chromaticities": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)},
            (1, LINEAR),
            "chromaticities",
        ),
    ],
)
def test_a_video_says_what_its_images_say(tmp_path, suffix, said, expected, unnamed):
    """Tags follow chunks, profile and attributes, samples are those without them; what has no number is said once."""
    view = "srgb" if (suffix, expected[1]) == (".exr", SRGB) else "none"
    remarks = converted(write(tmp_path / "in", suffix, said), tmp_path / "out.mkv", view)
    converted(write(tmp_path / "plain", suffix, type(said)()), tmp_path / "plain.mkv", view)
    is_wide = expected[0] == BT2020  # Y, Cb and Cr by another matrix
    assert tags_of(tmp_path / "out.mkv") == (*expected, BT2020 if is_wide else 1)
    assert [f"stands for the {unnamed} of" in remark for remark in remarks].count(True) == bool(unnamed)
    samples, plain = ([*map(samples_of, pictures_of(tmp_path / name))] for name in ("out.mkv", "plain.mkv"))
    assert is_wide or np.array_equal(samples, plain)


@pytest.mark.parametrize(
    ("said", "suffix", "is_lost"),
    [
        (HDR, ".png", False),
        (HDR, ".jpg", True),
        (((b"cICP", bytes((BT2020, HLG, 0, 1))),), ".png", False),
        (((b"cICP", bytes((P3, SRGB, 0, 1))),), ".png", False),
        (((b"cICP", bytes((P3, SRGB, 0, 1))),), ".bmp", True),
        (((b"cICP", bytes((BT601, BT601, 0, 1))),), ".png", False),
        ((), ".png", False),  # BT.709, for which images without a word are taken
        ((), ".bmp", False),
    ],
)
def test_there_and_back(tmp_path, said, suffix, is_lost):
    """Code points, mastering display and light levels of PNG come back from a video, and so do pixels.

    Of other types of images one note says that they cannot say them.
    """
    assert converted(write(tmp_path / "in", ".png", said), tmp_path / "there.mkv") == []
    remarks = converted(tmp_path / "there.mkv", tmp_path / f"######{suffix}")
    assert ["cannot hold the colour tags of its source" in remark for remark in remarks] == [True] * is_lost
    converted(tmp_path / f"######{suffix}", tmp_path / "back.mkv")
    assert tags_of(tmp_path / "back.mkv") == ((1, 1, 1) if is_lost else tags_of(tmp_path / "there.mkv"))
    first = tmp_path / f"000001{suffix}"
    assert metadata_of(first).chunks == (said if suffix == ".png" else ())
    assert np.abs(read_image(first).astype(int) - scene(1)).max() < (30 if suffix == ".jpg" else 3)


@pytest.mark.parametrize("is_video", [False, True])
@pytest.mark.parametrize(
    ("suffix", "lost"),
    [
        (".gif", "colour primaries and the transfer function and the HDR mastering data"),
        (".apng", "HDR mastering data"),
    ],
)
def test_what_animations_say(tmp_path, is_video, suffix, lost):
    """APNG says the code points of images and of a video, and what is made of it says them; one note names the rest."""
    source, target = write(tmp_path / "in", ".png", HDR), tmp_path / f"out{suffix}"
    converted(source, tmp_path / "in.mkv")
    remarks = converted(tmp_path / "in.mkv" if is_video else source, target)
    assert [f"cannot say the {lost} of its source" in remark for remark in remarks].count(True) == 1
    converted(target, tmp_path / "######.png")
    converted(target, tmp_path / "out.mkv")
    chunks, tags = (HDR[:1], (BT2020, PQ, BT2020)) if suffix == ".apng" else ((), (1, 1, 1))
    assert (metadata_of(tmp_path / "000001.png").chunks, tags_of(tmp_path / "out.mkv")) == (chunks, tags)


@pytest.mark.parametrize(("tags", "primaries"), [(IN_P3, P3), (IN_ADOBE_RGB, 1)])
@pytest.mark.parametrize("name", ["in.webp", "in.png"])
def test_the_profile_of_an_animation(tmp_path, name, tags, primaries):
    """It becomes tags, or a note."""
    first, second = (Image.fromarray(scene(number)) for number in range(2))
    first.save(tmp_path / name, save_all=True, append_images=[second], icc_profile=profile(tags))
    remarks = converted(tmp_path / name, tmp_path / "out.mkv")
    assert tags_of(tmp_path / "out.mkv") == (primaries, SRGB, 1)
    assert any("No colour tag stands for the ICC profile" in remark for remark in remarks) == (primaries == 1)
