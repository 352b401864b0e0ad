"""What images carry beside their pixels: passed frames keep their file, made ones say the same."""

import shutil
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms, ImageOps

import fpsboost
from fpsboost import DecodeOptions, InputError, RunOptions
from fpsboost.io.images.encoder import encode_image
from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.files import ImageMetadata, metadata_of, png_chunks
from support.exr_truth import save_exr
from support.video_truth import pictures_of, scene

PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
XMP = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'>\nwords</x:xmpmeta>"
KINDS = {".png": "PNG", ".jpg": "JPEG", ".webp": "WEBP", ".tif": "TIFF"}
ORIENTATION, DESCRIPTION = 0x0112, 0x010E


def exif(orientation: int = 1) -> bytes:
    data = Image.Exif()
    data[ORIENTATION], data[DESCRIPTION] = orientation, "made for a test"
    return data.tobytes()


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def write(folder: Path, suffix: str, count: int = 3, mode: str = "RGB", **options: Any) -> list[Path]:
    """Write scenes as images with metadata, by Pillow."""
    folder.mkdir()
    paths = [folder / f"shot_{index:04d}{suffix}" for index in range(1, count + 1)]
    for index, path in enumerate(paths):
        image = Image.fromarray(cv2.cvtColor(scene(index), cv2.COLOR_BGR2RGB)).convert(mode)
        image.save(path, KINDS[suffix], **options)
    return paths


def double(folder: Path, out: Path) -> tuple[list[Path], list[str]]:
    """Convert a folder; the images that come out, and the remarks."""
    out.parent.mkdir(exist_ok=True)
    summary = fpsboost.convert(str(folder), str(out), method="blend", run=RunOptions(overwrite=True))
    return sorted(path for path in out.parent.iterdir() if path.match(out.name.replace("####", "*"))), summary.remarks


@pytest.mark.parametrize("suffix", KINDS)
def test_frames_that_pass_keep_their_file(tmp_path, suffix):
    """A frame that goes into a file of the same type is that file, to the byte; the made ones have its EXIF data."""
    sources = write(tmp_path / "in", suffix, icc_profile=PROFILE, dpi=(300, 200), exif=exif())
    outputs, remarks = double(tmp_path / "in", tmp_path / "out" / f"new_####{suffix}")
    assert remarks == []
    assert [path.read_bytes() for path in outputs[::2]] == [path.read_bytes() for path in sources]
    for path in outputs[1::2]:
        with Image.open(path) as image:
            assert suffix == ".tif" or image.getexif()[DESCRIPTION] == "made for a test"


@pytest.mark.parametrize("source", KINDS)
@pytest.mark.parametrize("target", KINDS)
def test_from_type_to_type(tmp_path, source, target):
    """Profile and resolution go along from each type to each other; what does not is said once."""
    write(tmp_path / "in", source, icc_profile=PROFILE, **({} if source == ".webp" else {"dpi": (300, 200)}))
    outputs, remarks = double(tmp_path / "in", tmp_path / "out" / f"new_####{target}")
    for path in outputs:
        with Image.open(path) as image:
            image.load()  # it is whole
            assert image.info["icc_profile"] == PROFILE
            if ".webp" not in (source, target):
                assert np.allclose([float(dots) for dots in image.info["dpi"]], (300, 200), atol=0.02)
    is_lost = target == ".webp" and source in (".png", ".jpg", ".tif")
    assert len(remarks) == is_lost
    assert all("cannot hold the resolution" in remark for remark in remarks)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_xmp_is_kept(tmp_path, suffix):
    """XMP is read again where it was written; a TIFF cannot get it, which is said."""
    path = tmp_path / f"one{suffix}"
    path.write_bytes(encode_image(path, scene(0), metadata=ImageMetadata(xmp=XMP)))
    assert metadata_of(path).xmp == XMP
    with Image.open(path) as file:
        assert file.info["xmp"] in (XMP, XMP.decode())
    (tmp_path / "in").mkdir()
    for number in (1, 2):
        shutil.copy(path, tmp_path / "in" / f"{number}{suffix}")
    _, remarks = double(tmp_path / "in", tmp_path / "out" / "new_####.tif")
    assert any("cannot hold the XMP data" in remark for remark in remarks)


def test_words_on_colour_of_png(tmp_path):
    """Gamma, primaries, sRGB, coding-independent points and the shape of pixels stand in the made images too."""
    sources = write(tmp_path / "in", ".png")
    words = [
        (b"cICP", bytes((9, 16, 0, 1))),
        (b"gAMA", struct.pack(">I", 45455)),
        (b"cHRM", struct.pack(">8I", *range(31270, 31278))),
        (b"pHYs", struct.pack(">IIB", 2, 1, 0)),
    ]
    for path in sources:
        data = path.read_bytes()
        path.write_bytes(data[:33] + b"".join(chunk(*word) for word in words) + data[33:])
    outputs, remarks = double(tmp_path / "in", tmp_path / "out" / "new_####.png")
    assert remarks == []
    for path in outputs:
        assert set(words) <= set(png_chunks(path))  # before the pixels
    (_, remarks) = double(tmp_path / "in", tmp_path / "out" / "other_####.tif")
    assert len([remark for remark in remarks if "cannot hold the colour tags" in remark]) == 1


def test_metadata_follow_their_frames(tmp_path):
    """Where files differ, a made frame says what the frame before it does."""
    sources = write(tmp_path / "in", ".png", dpi=(100, 100))
    with Image.open(sources[1]) as image:
        image.save(sources[1], dpi=(200, 200))
    outputs, _ = double(tmp_path / "in", tmp_path / "out" / "new_####.png")
    assert [round(metadata_of(path).dots_per_inch[0]) for path in outputs] == [100, 100, 200, 200, 100]


@pytest.mark.parametrize(("suffix", "mode"), [(".png", "LA"), (".jpg", "CMYK")])
def test_profiles_that_no_longer_fit(tmp_path, suffix, mode):
    """Gray with alpha is read as colour, print colours as RGB: their profiles would be wrong, and are left out."""
    profile = bytearray(PROFILE)
    profile[16:20] = b"GRAY" if mode == "LA" else b"CMYK"
    sources = write(tmp_path / "in", suffix, mode=mode, icc_profile=bytes(profile))
    outputs, remarks = double(tmp_path / "in", tmp_path / "out" / f"new_####{suffix}")
    assert any("cannot hold the colour profile" in remark for remark in remarks)
    with Image.open(outputs[1]) as image:
        assert "icc_profile" not in image.info
    if mode == "CMYK":
        assert outputs[0].read_bytes() != sources[0].read_bytes()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation(tmp_path, orientation):
    """Images keep the orientation of their EXIF; a video, which has none, shows them upright as Pillow does."""
    sources = write(tmp_path / "in", ".jpg", exif=exif(orientation), quality=95)
    for suffix in (".jpg", ".png", ".webp", ".tif"):
        for path in double(tmp_path / "in", tmp_path / "out" / f"new_####{suffix}")[0]:
            with Image.open(path) as image:
                assert image.getexif().get(ORIENTATION, 1) == orientation
                assert image.size == (64, 48) or suffix == ".tif"  # Pillow turns TIFF by itself
    fpsboost.convert(
        str(tmp_path / "in"), str(tmp_path / "out.mkv"), method="blend", factor=1, decoding=DecodeOptions(input_fps=10)
    )
    with Image.open(sources[0]) as image:
        truth = np.asarray(ImageOps.exif_transpose(image))
    shown = pictures_of(tmp_path / "out.mkv")[0].to_ndarray(format="rgb24")
    assert shown.shape == truth.shape
    assert np.abs(shown.astype(float) - truth).mean() < 4


def test_a_turned_tiff_is_written_anew(tmp_path):
    """OpenCV turns a TIFF while it reads: all images come out upright, of one size, with no word of turning."""
    write(tmp_path / "in", ".tif", tiffinfo={ORIENTATION: 6})
    outputs, _ = double(tmp_path / "in", tmp_path / "out" / "new_####.tif")
    for path in outputs:
        with Image.open(path) as image:
            assert (image.size, image.getexif().get(ORIENTATION, 1)) == ((48, 64), 1)


def test_attributes_of_exr(tmp_path):
    """Primaries and the shape of pixels stand in the made images too; square pixels are nothing that a TIFF loses."""
    said = {"chromaticities": (0.7, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3), "pixelAspectRatio": 2.0}
    for name, header in (("in", said), ("plain", {})):
        (tmp_path / name).mkdir()
        for index in range(3):
            planes = {"Y": scene(index)[..., 0] / np.float32(255)}
            save_exr(tmp_path / name / f"shot_{index}.exr", ("", planes), **header)
    outputs, _ = double(tmp_path / "in", tmp_path / "out" / "new_####.exr")
    for path in outputs:
        attributes = read_exr_header(path).parts[0].attributes
        assert attributes["chromaticities"] == pytest.approx(said["chromaticities"])
        assert attributes["pixelAspectRatio"] == 2
    assert outputs[2].read_bytes() == (tmp_path / "in" / "shot_1.exr").read_bytes()
    _, remarks = double(tmp_path / "in", tmp_path / "out" / "new_####.tif")
    assert any("cannot hold the OpenEXR attributes" in remark for remark in remarks)
    assert double(tmp_path / "plain", tmp_path / "out" / "new_####.tif")[1] == []


@pytest.mark.parametrize("suffix", KINDS)
def test_damaged_metadata(tmp_path, suffix):
    """Whatever stands where metadata should be, reading it raises nothing."""
    (path,) = write(tmp_path / "in", suffix, count=1, icc_profile=PROFILE, exif=exif(3))
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(200):
        data = bytearray(whole[: int(rng.integers(1, len(whole)))])
        for place in rng.integers(0, len(data), 3):
            data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        with suppress(InputError):  # of the image itself
            assert metadata_of(path).orientation in range(1, 9)
