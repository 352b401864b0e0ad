"""Numbered images: what is read, what is refused, and that output appears whole or not at all."""

import errno
import os
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost import ClipInfo, Frame, InputError, LayeredImage, OutputError
from fpsboost.image import Image
from fpsboost.io.images.encoder import encode_image
from fpsboost.io.images.files import ImageMetadata, read_image
from fpsboost.io.images.sequence import Numbering
from fpsboost.io.images.sink import ImageSink
from fpsboost.io.images.source import ImageReading, ImageSource, is_pattern
from fpsboost.io.output import Output, StreamInfo
from fpsboost.media import OutputTiming

RATE = Fraction(24000, 1001)
HEIGHT, WIDTH = 12, 18


def make_image(channels: int = 3, dtype: type = np.uint8, seed: int = 0) -> Image:
    random = np.random.default_rng(seed)
    shape = (HEIGHT, WIDTH, channels)
    if dtype is np.float32:
        return random.normal(0.5, 2, shape).astype(np.float32)  # below black and far above white
    return random.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def save(path: Path, image: Image | None = None) -> Path:
    path.write_bytes(cv2.imencode(path.suffix, make_image() if image is None else image)[1].tobytes())
    return path


def fill(folder: Path, *names: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for seed, name in enumerate(names):
        save(folder / name, make_image(seed=seed))
    return folder


def make_sink(
    path: Path | str, source: ImageSource | None = None, frame_count: int | None = 2, overwrite: bool = False
) -> ImageSink:
    stream = StreamInfo() if source is None else source.stream_info
    info = ClipInfo("clip.mp4", HEIGHT, WIDTH, RATE, 1 / RATE, 2)
    timing = OutputTiming(RATE, 1 / RATE)
    return ImageSink(Output(str(path), info, timing, stream, expected_frames=frame_count, overwrite=overwrite))


def write(sink: ImageSink, *pictures: Image) -> None:
    with sink:
        for index, image in enumerate(pictures):
            sink.write(Frame(image, index / RATE))


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


PATTERNS = ["shot_%04d.png", "shot_%d.png", "shot_####.png", "shot_#.TIF", "shot_%04d.exr", "shot_####.dpx"]
NAMES = ["a/####/0001.png", "take #2.mp4", "take ##2.MOV", "shot_%04d.mkv", "shot_####/", "100%done.mkv", "frames"]


@pytest.mark.parametrize("path", [*PATTERNS, *NAMES, "50%.png"])
def test_is_pattern(path: str) -> None:
    """Only the last component decides, and ordinary names with # and % stay ordinary."""
    assert is_pattern(path) is (path in PATTERNS)


@given(st.sampled_from(["", "shot ", "-x_", "ü%_", "a.b_"]), st.integers(1, 9), st.integers(0, 10**12))
def test_pattern_round_trip(prefix: str, digits: int, number: int) -> None:
    """A name made by a pattern is read back by it, whether written with % or #."""
    by_hash = Numbering.parse(f"some/{prefix}{'#' * digits}_l.png")
    assert by_hash == Numbering.parse(f"some/{prefix}%0{digits}d_l.png")
    assert by_hash.number_in(by_hash.path(number).name) == number
    assert len(by_hash.path(number).name) >= len(prefix) + digits + len("_l.png")


@pytest.mark.parametrize(
    ("names", "pattern", "first"),
    [
        (["0001.png", "0002.png"], "####.png", 1),
        (["frame_0099.png", "frame_0100.png"], "frame_####.png", 99),
        (["img9.png", "img10.png", "img11.png"], "img#.png", 9),
        (["998.png", "999.png", "1000.png"], "###.png", 998),
        (["shot2_01_v3.png", "shot2_02_v3.png"], "shot2_##_v3.png", 1),
        (["take1.png"], "take#.png", 1),
        (["-0.PNG", "-1.PNG"], "-#.PNG", 0),
    ],
)
def test_folder_naming(tmp_path: Path, names: list[str], pattern: str, first: int) -> None:
    """A folder's naming is found, and numbers decide the order."""
    fill(tmp_path, *names)
    for clutter in (".DS_Store", "._0001.png", "notes.txt", "Thumbs.db"):
        (tmp_path / clutter).write_text("no image")
    (tmp_path / "0007.png.d").mkdir()
    source = ImageSource(str(tmp_path), RATE).images
    assert source.numbering is not None
    assert (source.numbering.pattern, source.first_number) == (pattern, first)
    assert [path.name for path in source.files] == names


def test_names_without_numbers(tmp_path: Path) -> None:
    """Images without any number go by the alphabet, and a folder of output gets numbers."""
    source = ImageSource(str(fill(tmp_path / "in", "c.png", "B.png", "a.png")), RATE)
    assert [path.name for path in source.images.files] == ["a.png", "B.png", "c.png"]
    assert source.images.numbering is None
    write(make_sink(tmp_path / "out", source), make_image(), make_image())
    assert names_in(tmp_path / "out") == ["000001.png", "000002.png"]


@pytest.mark.parametrize(
    ("names", "path", "message"),
    [
        ([], "", "is empty"),
        (["0001.png", "0002.png", "0004.png"], "", "0003.png is missing"),
        (["a_1.png", "a_2.png", "b_1.png"], "", r"several sequences .*\(a_#.png, b_#.png\); choose one .*a_#.png"),
        (["1.png", "2.png", "1.jpg"], "", r"\(#.png, #.jpg\)"),
        (["1.png", "2.png", "thumb.png"], "", r"\(#.png, \*.png\)"),
        (["a.png", "b.jpg"], "", "keep one type of file"),
        (["1.png", "02.png"], "", "different widths"),
        (["001.png", "0002.png"], "", "different widths"),
        (["a1_1.png", "a2_2.png", "b1_1.png", "c.png", "d1.jpg"], "", "and 2 more"),
        ([], "none", "does not exist"),
        (["1.png"], "1.png", "single file"),
        (["1.png"], "x_##.png", "No image is named like"),
        ([], "none/##.png", "No such file"),
        (["1.ppm"], "%01d.ppm", "no type of image"),
    ],
)
def test_refused_inputs(tmp_path: Path, names: list[str], path: str, message: str) -> None:
    """What is no gapless sequence of images is refused, and the message names what is missing or in the way."""
    fill(tmp_path, *names)
    with pytest.raises(InputError, match=message):
        ImageSource(str(tmp_path / path), RATE)


def test_pattern_picks_one_sequence(tmp_path: Path) -> None:
    """A pattern reads its own sequence out of a folder that holds several, and its padding is strict."""
    fill(tmp_path, "a_08.png", "a_09.png", "a_10.png", "a_7.png", "b_1.png", "a_11.tif")
    assert [path.name for path in ImageSource(str(tmp_path / "a_##.png"), RATE).images.files] == [
        "a_08.png",
        "a_09.png",
        "a_10.png",
    ]


def test_unlike_images(tmp_path: Path) -> None:
    """Images of two sizes or types are refused with both names and descriptions, as is a type that is unknown."""
    fill(tmp_path, "1.png", "2.png")
    save(tmp_path / "2.png", make_image(1, np.uint16))
    with pytest.raises(InputError, match=r"2\.png \(18x12, 1 channel, 16-bit\).*1\.png \(18x12, 3 channels, 8-bit\)"):
        list(ImageSource(str(tmp_path), RATE))
    save(tmp_path / "x1.tif", make_image(1, np.uint8).astype(np.float64))
    with pytest.raises(InputError, match=r"1\.tif has 1 channels of double"):
        ImageSource(str(tmp_path / "x#.tif"), RATE)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".bmp"])
@pytest.mark.parametrize("kept", [0, 9, 0.7])
def test_damaged_images(tmp_path: Path, suffix: str, kept: float) -> None:
    """An empty, a foreign and a truncated file are refused by name, when their turn comes."""
    fill(tmp_path, f"1{suffix}", f"2{suffix}")
    path = save(tmp_path / f"2{suffix}", make_image())
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data)) if kept < 1 else int(kept)])
    frames = iter(ImageSource(str(tmp_path), RATE))
    next(frames)
    with pytest.raises(InputError, match=f"2{suffix} is damaged"):
        next(frames)


kept = [(suffix, dtype, n) for suffix in (".tif", ".tiff", ".TIF") for dtype in (np.uint8, np.uint16, np.float32)
        for n in (1, 3, 4)]  # fmt: skip
kept += [(".png", dtype, n) for dtype in (np.uint8, np.uint16) for n in (1, 3, 4)]
kept += [(suffix, dtype, n) for suffix in (".jxl", ".dpx") for dtype in (np.uint8, np.uint16) for n in (1, 3, 4)]
kept += [(".tga", np.uint8, 1), (".tga", np.uint8, 3), (".tga", np.uint8, 4)]
kept += [(".bmp", np.uint8, 1), (".bmp", np.uint8, 3), (".webp", np.uint8, 3), (".webp", np.uint8, 4)]


@pytest.mark.parametrize(("suffix", "dtype", "channels"), kept)
def test_exact_round_trip(tmp_path: Path, suffix: str, dtype: type, channels: int) -> None:
    """Depth, channels and every value survive writing and reading."""
    pictures = [make_image(channels, dtype, seed) for seed in range(2)]
    if channels == 4:
        pictures[0][:4, :, 3] = 0  # transparent, but not without colour
    sink = make_sink(tmp_path / f"x_##{suffix}")
    write(sink, *pictures)
    again = [frame.image for frame in ImageSource(str(tmp_path), RATE)]
    assert sink.remarks == []
    for image, expected in zip(again, pictures, strict=True):
        assert image.dtype == dtype
        assert image.flags.c_contiguous
        np.testing.assert_array_equal(image, expected)


def test_dpx_keeps_its_depth(tmp_path: Path) -> None:
    """The frames between have 10 bits a value where the originals have, and no time that would change every file."""
    (tmp_path / "in").mkdir()
    deep = make_image(3, np.uint16) >> 6
    image = deep << 6 | deep >> 4  # as 10 bits are read as 16
    for number in (1, 2):
        data = encode_image(Path("x.dpx"), image ^ (np.uint16(number - 1) << 6), metadata=ImageMetadata(bits=10))
        (tmp_path / "in" / f"{number}.dpx").write_bytes(data)
    write(make_sink(tmp_path / "out", ImageSource(str(tmp_path / "in"), RATE)), image, image)
    assert (tmp_path / "out" / "1.dpx").read_bytes() == (tmp_path / "in" / "1.dpx").read_bytes()
    np.testing.assert_array_equal(read_image(tmp_path / "out" / "1.dpx"), image)


def test_hdr_is_light(tmp_path: Path) -> None:
    """It is read as float, as scene-linear as OpenEXR, and written as exactly as it stores colours."""
    image = np.abs(make_image(3, np.float32)) + np.float32(0.5)
    for number in (1, 2):
        (tmp_path / f"{number}.hdr").write_bytes(encode_image(Path("x.hdr"), image))
    (frame, _) = ImageSource(str(tmp_path), RATE, ImageReading(linear=True))
    assert isinstance(frame.image, LayeredImage)
    np.testing.assert_allclose(frame.image.colour, image, rtol=0.01, atol=0.04)
    assert encode_image(Path("x.hdr"), frame.array) == (tmp_path / "1.hdr").read_bytes()


def test_gray_webp(tmp_path: Path) -> None:
    """WebP has no gray, and it is said that it becomes colour."""
    sink = make_sink(tmp_path / "b_#.webp")
    write(sink, make_image(1), make_image(1))
    np.testing.assert_array_equal(read_image(tmp_path / "b_1.webp"), np.repeat(make_image(1), 3, axis=2))
    assert len(sink.remarks) == 1


@pytest.mark.parametrize(
    ("suffix", "dtype", "channels", "advice"),
    [
        (".jpg", np.uint16, 3, "16-bit.*png or .tif"),
        (".webp", np.uint16, 3, "16-bit.*png or .tif"),
        (".bmp", np.uint16, 1, "16-bit"),
        (".png", np.float32, 3, "float.*use .tif or .exr"),
        (".exr", np.uint8, 3, "8-bit.*png or .tif"),
        (".exr", np.uint16, 1, "16-bit.*png or .tif"),
        (".jpeg", np.uint8, 4, "alpha"),
        (".bmp", np.uint8, 4, "alpha"),
    ],
)
def test_refused_formats(tmp_path: Path, suffix: str, dtype: type, channels: int, advice: str) -> None:
    """A format that would lose depth or alpha is refused at the first frame, and nothing is left."""
    with pytest.raises(OutputError, match=advice):
        write(make_sink(tmp_path / f"x_##{suffix}"), make_image(channels, dtype))
    assert names_in(tmp_path) == []


def test_folder_continues_source(tmp_path: Path) -> None:
    """A folder takes over prefix, file type, padding and first number, a pattern that alone; digits grow as needed."""
    source = ImageSource(str(fill(tmp_path / "in", "img9.png", "img10.png")), RATE)
    write(make_sink(tmp_path / "out", source, frame_count=3), *[make_image()] * 3)
    assert names_in(tmp_path / "out") == ["img09.png", "img10.png", "img11.png"]
    source = ImageSource(str(fill(tmp_path / "in2", "s_0004_left.jpg", "s_0005_left.jpg")), RATE)
    write(make_sink(tmp_path / "out2", source), *[make_image()] * 2)
    assert names_in(tmp_path / "out2") == ["s_0004_left.jpg", "s_0005_left.jpg"]
    source = ImageSource(str(fill(tmp_path / "in3", "0999.png", "1000.png")), RATE)
    write(make_sink(tmp_path / "in3" / "new_###.png", source), *[make_image()] * 2)
    assert names_in(tmp_path / "in3") == ["0999.png", "1000.png", "new_1000.png", "new_999.png"]


def test_names_for_video(tmp_path: Path) -> None:
    """Frames of a video are counted from 1 with at least six digits; a pattern is taken as given.

    A padded pattern with too few digits is remarked; an unpadded one is the user's wish.
    """
    write(make_sink(tmp_path / "out", frame_count=None), make_image())
    assert names_in(tmp_path / "out") == ["000001.png"]
    assert make_sink(tmp_path / "new", frame_count=10**6).names.numbering.digits == 7
    assert make_sink(tmp_path / "new", frame_count=10**6 - 1).names.numbering.digits == 6
    write(make_sink(tmp_path / "out" / "f%d.tif"), make_image(), make_image())
    assert names_in(tmp_path / "out") == ["000001.png", "f1.tif", "f2.tif"]
    assert "too few digits" in make_sink(tmp_path / "##.png", frame_count=100).remarks[0]
    assert make_sink(tmp_path / "##.png", frame_count=99).remarks == []
    assert make_sink(tmp_path / "%d.png", frame_count=100).remarks == []


@pytest.mark.parametrize("comes_back", [True, False])
def test_failed_moves_are_undone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, comes_back: bool) -> None:
    """If a file cannot get its name, earlier frames stand as before, or are kept where they cannot get theirs."""
    fill(tmp_path, "x_01.png", "x_02.png", "x_03.png")
    true_replace = os.replace

    def fail(here: Path, there: Path) -> None:
        is_new = there.name == "x_02.png" and here.parent.name != "replaced"
        if there.parent == tmp_path and (is_new or not comes_back):
            raise PermissionError(errno.EACCES, "Permission denied")
        true_replace(here, there)

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError, match="Permission denied"):
        write(make_sink(tmp_path / "x_##.png", overwrite=True), make_image(seed=8), make_image(seed=9))
    if comes_back:
        assert names_in(tmp_path) == ["x_01.png", "x_02.png", "x_03.png"]
    folder = tmp_path if comes_back else next(tmp_path.rglob("replaced"))
    for i in range(3):
        np.testing.assert_array_equal(read_image(folder / f"x_0{i + 1}.png"), make_image(seed=i))


def test_existing_is_refused(tmp_path: Path) -> None:
    """A folder with anything visible in it needs --overwrite, also where no image would be replaced."""
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="`overwrite=True`"):
        make_sink(tmp_path)


def test_empty_folder_is_kept(tmp_path: Path) -> None:
    """An empty folder, and one with hidden files only, is filled and stays the same folder."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / ".DS_Store").write_text("")
    before = folder.stat().st_ino
    write(make_sink(folder), make_image())
    assert names_in(folder) == [".DS_Store", "000001.png"]
    assert folder.stat().st_ino == before


def test_folder_that_fills_meanwhile(tmp_path: Path) -> None:
    """What appears under the final name while frames are made is not replaced."""
    sink = make_sink(tmp_path / "out").__enter__()
    sink.write(Frame(make_image(seed=1), Fraction(0)))
    fill(tmp_path / "out", "000001.png")
    with pytest.raises(OutputError, match="`overwrite=True`"):
        sink.__exit__(None, None, None)
    assert names_in(tmp_path) == ["out"]
    np.testing.assert_array_equal(read_image(tmp_path / "out" / "000001.png"), make_image())


@pytest.mark.parametrize(
    ("target", "replaced", "kept", "written"),
    [
        ("", ["0001.png", "0002.png", "000003.png"], ["other_0001.png", "0001.jpg", "0001_small.png"], "000002.png"),
        ("x_##.png", ["x_01.png", "x_02.png", "x_100.png"], ["x_0002.png"], "x_02.png"),
    ],
)
def test_overwrite(tmp_path: Path, target: str, replaced: list[str], kept: list[str], written: str) -> None:
    """Frames of the same naming go, in a folder whatever their padding; of a pattern another padding is another one."""
    fill(tmp_path, *replaced, *kept)
    (tmp_path / "notes.txt").write_text("mine")
    write(make_sink(tmp_path / target, overwrite=True), make_image(seed=7), make_image(seed=8))
    assert names_in(tmp_path) == sorted([written.replace("2", "1"), written, "notes.txt", *kept])
    np.testing.assert_array_equal(read_image(tmp_path / written), make_image(seed=8))


def test_inputs_are_never_touched(tmp_path: Path) -> None:
    """Output into the input's folder or over its names is refused, with --overwrite and through links too.

    Another naming in the input's folder, and a folder within it, are fine.
    """
    folder = fill(tmp_path / "in", "x_01.png", "x_02.png")
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    source = ImageSource(str(folder), RATE)
    for target in ("in", "link", "in/../in", "in/x_##.png", "link/x_##.png", "in/x_%02d.png", "in/X_##.PNG"):
        with pytest.raises(OutputError, match=r"also the input|would replace the input"):
            make_sink(tmp_path / target, source, overwrite=True)
    write(make_sink(folder / "out", source), make_image())
    write(make_sink(folder / "y_##.png", source), make_image())
    assert names_in(folder) == ["out", "x_01.png", "x_02.png", "y_01.png"]
    fill(tmp_path / "far", "x_01.png")
    (tmp_path / "near").mkdir()
    (tmp_path / "near" / "x_01.png").symlink_to(tmp_path / "far" / "x_01.png")
    source = ImageSource(str(tmp_path / "near"), RATE)
    with pytest.raises(OutputError, match="would replace the input"):
        make_sink(tmp_path / "far", source, overwrite=True)


def test_refused_places(tmp_path: Path) -> None:
    """A missing parent, a file in the way and an unknown type are refused before anything is made."""
    (tmp_path / "file").write_text("")
    for target, message in {
        "none/out": "create it first",
        "none/x_##.png": "create it first",
        "file": "is a file",
        "file/x_##.png": "is a file",
        "x_##.gif": "no type of image",
    }.items():
        with pytest.raises(OutputError, match=message):
            make_sink(tmp_path / target, overwrite=True)
    assert names_in(tmp_path) == ["file"]
