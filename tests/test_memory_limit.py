"""Sizes that files promise: read before anything is decoded, and refused where the machine is too small for them."""

import struct
import sys
import zlib
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest

from fpsboost import InputError, OptionError, RunOptions, convert, memory, stream
from fpsboost.io.animation.source import AnimationSource
from fpsboost.io.images.exr import encode_exr, read_exr
from fpsboost.io.images.files import read_image
from fpsboost.io.video.pipe import PipeSource
from fpsboost.io.video.source import VideoSource
from fpsboost.memory import (
    ADDRESS_SPACE,
    BASE_BYTES,
    BYTES_PER_PIXEL,
    BYTES_PER_PIXEL_OF_A_THREAD,
    MemoryLimit,
    available_memory,
    parse_memory,
)
from support.animation_truth import write_animation
from support.command_line import assert_refused
from support.video_truth import scene, write_clip

HUGE = 60000
SMALL = MemoryLimit(BASE_BYTES + BYTES_PER_PIXEL * 64 * 48)  # just enough for 64x48


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def promising(width: int, height: int) -> bytes:
    """A PNG file of a few bytes that says it is this large."""
    data = bytearray(cv2.imencode(".png", scene(0))[1].tobytes())
    data[12:33] = chunk(b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0))[4:]
    return bytes(data)


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".tif"])
def test_huge_images_are_refused_before_they_are_decoded(tmp_path, ending):
    """No file of a few bytes holds them; a whole file that is too large is told its size, need and option."""
    path = tmp_path / f"a{ending}"
    path.write_bytes(cv2.imencode(ending, np.zeros((3000, 3000), np.uint8))[1].tobytes())
    assert read_image(path).shape == (3000, 3000, 1)
    with pytest.raises(InputError, match=rf"a{ending} is 3000x3000, which takes about 3\.9 GB .*`limit`\.$"):
        read_image(path, MemoryLimit(10**9))
    path.write_bytes(promising(HUGE, HUGE))
    with pytest.raises(InputError, match=rf"a{ending} is damaged or no image"):
        read_image(path, MemoryLimit(8 * 10**9))


def test_huge_openexr_is_refused_before_it_is_decoded(tmp_path):
    """All chunks of a narrow image are there, and yet it is too large; all channels count, also where one is read."""
    plane = np.zeros((3000, 8), np.float32)
    (tmp_path / "a.exr").write_bytes(encode_exr({"Y": plane}))
    assert read_exr(tmp_path / "a.exr")["Y"].shape == (3000, 8)
    with pytest.raises(InputError, match=r"a\.exr is 8x3000, which takes"):
        read_exr(tmp_path / "a.exr", limit=SMALL)
    path, plane = tmp_path / "a.exr", np.zeros((48, 64), np.float32)
    path.write_bytes(encode_exr({name: plane for name in ("Y", "Z", "id")}, half=False))
    enough = SMALL.bytes + 3 * plane.nbytes
    assert list(read_exr(path, ["Z"], MemoryLimit(enough))) == ["Z"]
    with pytest.raises(InputError, match=r"a\.exr is 64x48, which takes"):
        read_exr(path, ["Z"], MemoryLimit(enough - 1))


def test_videos_are_refused_by_their_headers(tmp_path):
    """A stream in a file, one through a pipe, and a size that only the pictures say."""
    header = b"YUV4MPEG2 W16000 H16000 F25:1\nFRAME\n"
    (tmp_path / "in.y4m").write_bytes(header + bytes(1000))
    with pytest.raises(InputError, match=r"in\.y4m is 16000x16000, which takes about 103 GB"):
        VideoSource(tmp_path / "in.y4m", limit=MemoryLimit(10**9))
    with pytest.raises(InputError, match=r"standard input is 16000x16000"):
        PipeSource(BytesIO(header), limit=MemoryLimit(10**9))
    data = write_clip(tmp_path / "in.avi", codec="mjpeg", pixel_format="yuvj420p", size=(96, 64)).read_bytes()
    place = data.index(b"strf") + 12
    (tmp_path / "in.avi").write_bytes(data[:place] + struct.pack("<2i", 64, 48) + data[place + 8 :])
    with pytest.raises(InputError, match=r"in\.avi is 64x96"):
        _ = VideoSource(tmp_path / "in.avi", limit=SMALL).traits


@pytest.mark.parametrize("suffix", [".gif", ".apng", ".webp"])
def test_animations_are_refused_by_their_headers(tmp_path, suffix):
    """The canvas of each format, before a frame is decoded; just enough is enough."""
    path = write_animation(tmp_path / f"in{suffix}", [scene(0), scene(1)])
    with AnimationSource(str(path), limit=SMALL) as source:
        assert len(list(source)) == 2
    with pytest.raises(InputError, match=rf"in{suffix} is 64x48, which takes"):
        AnimationSource(str(path), limit=MemoryLimit(10**6))


def test_frames_beyond_the_canvas_are_not_decoded(tmp_path):
    """A second frame that says it is huge in a small animation: only the first is kept."""
    path = write_animation(tmp_path / "in.apng", [scene(0), scene(1)])
    data = bytearray(path.read_bytes())
    second = data.index(b"fcTL", data.index(b"fcTL") + 4)
    data[second + 8 : second + 10] = b"\xea\x60"
    path.write_bytes(data)
    with AnimationSource(str(path)) as source:
        assert len(list(source)) == 1
    assert "damaged" in source.remarks[-1]


def test_sizes_as_people_write_them():
    """Letters in any case, with and without B; others are refused with the option's name."""
    sizes = {"8G": 8e9, "500M": 5e8, "1.5g": 15e8, "16 GB": 16e9, "2T": 2e12, "7": 7}
    assert {text: parse_memory(text).bytes for text in sizes} == sizes
    for text in ("", "much", "8X", "-1G", "G", "1e9", "0", "0G", "nan", "8GG", "9" * 30):
        with pytest.raises(OptionError, match="`limit`"):
            parse_memory(text)


def test_available_memory_of_any_system(monkeypatch):
    """What Linux says is available; else most of the machine's; else a fixed number."""
    monkeypatch.setattr(Path, "read_text", lambda _: "MemTotal: 2048 kB\nMemAvailable:    1000 kB\n")
    assert available_memory() == 1_024_000
    monkeypatch.setattr(Path, "read_text", lambda _: "")
    monkeypatch.setattr(memory.os, "sysconf", {"SC_PHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}.__getitem__)
    assert available_memory() == 3_072_000
    monkeypatch.delattr(memory.os, "sysconf")
    assert available_memory() == memory.UNKNOWN_MACHINE


def test_the_option_reaches_every_kind_of_input(fpsboost_, tmp_path, save_images):
    """Refused with it, converted with more of it; nothing is left behind."""
    write_clip(tmp_path / "in.mp4", times=range(3))
    save_images(tmp_path / "in", count=2)
    for arguments, size in ((("in.mp4", "out.mp4"), 301), (("in", "out"), 300), (("in.mp4", "out/"), 300)):
        refused = fpsboost_(*arguments, "--method", "nearest", "--max-memory", "1M")
        assert (refused.code, refused.lines[0][:12]) == (1, "fpsboost: in")
        assert refused.lines[0].endswith(
            f"is 64x48, which takes about {size} MB of memory where 1 MB may be taken; "
            "scale it down, or allow more with --max-memory."
        )
        assert not (tmp_path / arguments[1]).exists()
    assert fpsboost_("in.mp4", "out.mp4", "--method", "nearest", "--max-memory", "1G").code == 0
    assert fpsboost_("in.mp4", "x.mp4", "--max-memory", "lots").code == 2


@pytest.mark.skipif(sys.platform == "win32", reason="it has no such limit")
@pytest.mark.parametrize(
    ("left", "said"), [(0, "more than 1.6 GB with ulimit -v."), (1, "or allow more with ulimit -v.")]
)
def test_where_the_address_space_ends(fpsboost_, tmp_path, save_images, monkeypatch, left, said):
    """Too little for the libraries, or for a clip, is one sentence, and nothing is begun."""
    limit = ADDRESS_SPACE + BASE_BYTES + left
    monkeypatch.setattr("resource.getrlimit", lambda _: (limit, limit))
    save_images(tmp_path / "in", count=2)
    assert_refused(fpsboost_("in", "out", "--method", "blend"), 1, said)


def test_as_many_threads_as_memory_reaches_for(tmp_path, monkeypatch):
    """One always, and one more for each time that its share is left; a conversion takes no more unless it is told."""
    pixels, taken = 640 * 480, []
    for cores, further, threads in ((8, 0, 1), (8, -5, 1), (8, 2, 3), (2, 100, 2)):
        left = further * BYTES_PER_PIXEL_OF_A_THREAD * pixels
        limit = MemoryLimit(BASE_BYTES + BYTES_PER_PIXEL * pixels + left)
        assert limit.affordable_threads(640, 480, cores) == threads

    def take(*_: object, threads: int, **__: object) -> None:
        taken.append(threads)
        raise InterruptedError

    with monkeypatch.context() as limited:
        limited.setattr(memory, "address_space", lambda: BASE_BYTES)
        assert MemoryLimit(10**10).affordable_threads(640, 480, 8) == 1
    monkeypatch.setattr("fpsboost.conversion.run_conversion", take)
    monkeypatch.setattr("fpsboost.conversion.available_cores", lambda: 9)
    write_clip(tmp_path / "in.mp4")
    limit = MemoryLimit(
        BASE_BYTES + (150 + 270 + 3 * BYTES_PER_PIXEL_OF_A_THREAD) * 64 * 48
    )  # of `nlm`, and the encoder
    for number in (None, 7):
        with pytest.raises(InterruptedError):
            convert(str(tmp_path / "in.mp4"), str(tmp_path / "out.mp4"), run=RunOptions(limit=limit, threads=number))
    assert taken == [4, 7]


def test_stream_takes_no_more_than_its_method_needs(tmp_path, save_images, monkeypatch):
    """What suffices for blending is too little for a method whose need was not measured."""
    save_images(tmp_path / "in", count=2)
    monkeypatch.setattr(memory, "address_space", lambda: BASE_BYTES + 70 * 64 * 48)
    assert len(list(stream(tmp_path / "in", method="blend"))) == 4
    with pytest.raises(InputError, match="64x48, which takes about"):
        list(stream(tmp_path / "in", method="dis"))
