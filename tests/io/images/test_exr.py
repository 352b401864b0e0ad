"""OpenEXR: what is read and written, through the file format and as images of a sequence."""

import struct
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from fpsboost import Frame, InputError
from fpsboost.io.images.exr import encode_exr, read_exr, read_exr_header
from fpsboost.io.images.files import read_image
from fpsboost.io.images.sink import ImageSink
from fpsboost.io.images.source import ImageSource
from fpsboost.media import OutputTiming
from support.conversion_options import output_of
from support.exr_truth import save_exr, window, write_exr

HEIGHT, WIDTH = 40, 60
RATE = Fraction(24)


def plane(seed: int = 0, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Numbers that a half holds exactly, below black and above white."""
    return np.random.default_rng(seed).normal(0.5, 3, (height, width)).astype(np.float16).astype(np.float32)


def planes(names: str) -> dict[str, np.ndarray]:
    return {name: plane(seed) for seed, name in enumerate(names)}


def save(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    return save_exr(path, ("", channels), **header)


def test_what_is_no_number_and_what_is_too_much_for_a_half(tmp_path):
    """NaN and infinity are read as they are; beyond 65504 a half is infinite."""
    values = np.array([[np.nan, np.inf, -np.inf, 1e9, -65504]], np.float32)
    for half in (False, True):
        write_exr(tmp_path / "a.exr", {"Z": values}, half=half)
        expected = values.copy()
        expected[0, 3] = np.inf if half else 1e9
        np.testing.assert_array_equal(read_exr(tmp_path / "a.exr")["Z"], expected)


def test_only_the_chosen_channels_are_read(tmp_path):
    """In the order in which they are named."""
    write_exr(tmp_path / "a.exr", planes("RGBAZ"))
    again = read_exr(tmp_path / "a.exr", ["Z", "B"])
    assert list(again) == ["Z", "B"]
    np.testing.assert_array_equal(again["Z"], planes("RGBAZ")["Z"])


@pytest.mark.parametrize("name", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA", "DWAB"])
def test_every_compression_is_read(tmp_path, name):
    """Smooth pictures come back, by the lossy ones nearly so."""
    smooth = np.linspace(0, 1, 300 * WIDTH, dtype=np.float32).reshape(300, WIDTH).astype(np.float16)
    path = save(tmp_path / "a.exr", {"Y": smooth}, compression=getattr(OpenEXR, f"{name}_COMPRESSION"))
    np.testing.assert_allclose(read_exr(path)["Y"], smooth, atol=0.01 if name in {"B44", "DWAA", "DWAB"} else 0)


@pytest.mark.parametrize(
    ("data", "display"),
    [
        ((5, 7, WIDTH, HEIGHT), (0, 0, 100, 80)),  # a crop
        ((-5, -7, WIDTH, HEIGHT), (0, 0, 30, 20)),  # more than is shown
        ((-5, 10, WIDTH, HEIGHT), (-20, -10, 60, 40)),  # across an edge, with an origin of its own
        ((200, 0, WIDTH, HEIGHT), (0, 0, 50, 40)),  # nothing of it is shown
    ],
)
def test_data_has_its_place_in_the_display_window(tmp_path, data, display):
    """What is shown counts: zeros where there is no data, and no data from outside."""
    path = save(tmp_path / "a.exr", planes("Y"), dataWindow=window(*data), displayWindow=window(*display))
    canvas = np.zeros((400, 400), np.float32)
    canvas[100 + data[1] :, 100 + data[0] :][:HEIGHT, :WIDTH] = plane()
    expected = canvas[100 + display[1] :, 100 + display[0] :][: display[3], : display[2]]
    np.testing.assert_array_equal(read_exr(path)["Y"], expected)


def deep(path: Path) -> Path:
    pixels = np.empty((4, 4), object)
    for place in np.ndindex(4, 4):
        pixels[place] = np.ones(2, np.float32)
    kind = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with OpenEXR.File(kind, {"Z": pixels}) as file:
        file.write(str(path))
    return path


@pytest.mark.parametrize("parts", [("",), ("a", "b")], ids=len)
@pytest.mark.parametrize("kept", [0, 3, 8, 100, 200, 600, 0.1, 0.5, -1, None])
def test_damaged_files_are_refused(tmp_path, parts, kept):
    """Wherever they are cut, in one part or several; and whole ones with bytes that do not unpack."""
    path = save_exr(tmp_path / "a.exr", *((part, planes("BGR")) for part in parts))
    data = bytearray(path.read_bytes())
    if kept is None:
        middle = len(data) // 2
        data[middle : middle + 40] = b"\xff" * 40
    path.write_bytes(data[: int(kept * len(data)) if isinstance(kept, float) else kept])
    with pytest.raises(InputError, match=r"a\.exr is damaged or no image; replace it\."):
        read_exr(path)


def subsampled(path: Path) -> None:
    """Luminance and chroma need not be of one size."""
    write_exr(path, planes("UY"))
    data = bytearray(path.read_bytes())
    place = data.index(b"U\0" + struct.pack("<i", 1)) + 2 + 8
    data[place : place + 8] = struct.pack("<ii", 2, 2)
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (deep, "has deep pixels; save it as one flat image"),
        (subsampled, "has channels with fewer pixels"),
        (lambda path: None, ".No such file"),
        (lambda path: write_exr(path, planes("XZ")), r"has no colours among its channels \(X, Z\)"),
    ],
)
def test_what_is_no_flat_image_is_named(tmp_path, make, sentence):
    """Each in a sentence; of passes alone, what there is."""
    make(tmp_path / "a.exr")
    with pytest.raises(InputError, match=rf"a\.exr {sentence}"):
        read_image(tmp_path / "a.exr")


def with_window(data: bytes, name: bytes, *corners: int) -> bytes:
    place = data.index(name + b"\0box2i\0") + len(name) + 7 + 4
    return data[:place] + struct.pack("<4i", *corners) + data[place + 16 :]


@pytest.mark.parametrize("name", [b"dataWindow", b"displayWindow"])
@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ((0, 0, 99_999, 99_999), r"100000x100000, which takes about 4 TB of memory|damaged"),
        ((-(2**31), -(2**31), 2**31 - 1, 2**31 - 1), r"4294967296x4294967296, which takes|damaged"),
        ((0, 0, -1, 10), "damaged"),
        ((10, 10, 0, 0), "damaged"),
    ],
)
def test_impossible_sizes_are_refused(tmp_path, name, corners, message):
    """Before any memory is taken for them."""
    (tmp_path / "a.exr").write_bytes(with_window(encode_exr(planes("Y")), name, *corners))
    with pytest.raises(InputError, match=rf"a\.exr is ({message})"):
        read_exr(tmp_path / "a.exr")


def test_images_are_in_the_packages_order(tmp_path):
    """BGR, BGRA, gray, and gray with alpha as BGRA, beyond black and white too."""
    expected = {"RGB": "BGR", "RGBA": "BGRA", "Y": "Y", "depth": None, "YA": "YYYA", "RGBZ": "BGR"}
    for names, order in expected.items():
        channels = {"depth": plane()} if order is None else planes(names)
        write_exr(tmp_path / "a.exr", channels)
        image = read_image(tmp_path / "a.exr")
        assert image.dtype == np.float32
        assert image.flags.c_contiguous
        np.testing.assert_array_equal(image, np.dstack([channels[each] for each in order or ["depth"]]))


def convert(source: ImageSource, path: Path, frames: int = 2) -> list[np.ndarray]:
    """Copy all images of a source; read them again."""
    sink = ImageSink(output_of(path, source, OutputTiming(RATE, 1 / RATE), expected_frames=frames))
    with sink:
        for index, frame in enumerate(source):
            sink.write(Frame(frame.image, index / RATE))
    return [frame.image for frame in ImageSource(str(path), RATE)]


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("names", ["Y", "BGR", "BGRA"])
def test_a_sequence_keeps_every_value_and_its_precision(tmp_path, names, half):
    """Half stays half and float stays float, so that originals pass exactly."""
    (tmp_path / "in").mkdir()
    for number in (1, 2):
        channels = {name: each + (0 if half else np.float32(1e-5)) for name, each in planes(names).items()}
        write_exr(tmp_path / "in" / f"a_{number:04d}.exr", channels, half=half)
    source = ImageSource(str(tmp_path / "in"), RATE)
    again = convert(source, tmp_path / "out")
    for image, frame in zip(again, source, strict=True):
        np.testing.assert_array_equal(image, frame.image)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a_0001.exr", "a_0002.exr"]
    header = read_exr_header(tmp_path / "out" / "a_0001.exr")
    assert header.channels == dict.fromkeys(sorted(names), "half" if half else "float")
    assert source.remarks == []
