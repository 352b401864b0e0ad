"""What libraries print by themselves does not reach the terminal before our own sentence."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from fpsboost.cli.library_texts import library_texts
from fpsboost.io.images import source
from support.exr_truth import write_exr

NOISE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)


def write(path: Path) -> Path:
    if path.suffix == ".exr":
        write_exr(path, {name: NOISE[..., 0].astype(np.float32) for name in "BGR"})
    else:
        path.write_bytes(cv2.imencode(path.suffix, NOISE)[1].tobytes())
    return path


def cut(data: bytearray) -> None:
    del data[len(data) * 2 // 3 :]


def flip(data: bytearray) -> None:
    data[len(data) // 2] ^= 0x55


def blank(data: bytearray) -> None:
    data[-40:-20] = bytes(20)


@pytest.mark.parametrize("command", [("in", "out", "-m", "blend"), ("probe", "in")])
@pytest.mark.parametrize(
    ("suffix", "damage"), [(".png", cut), (".png", flip), (".tif", cut), (".bmp", cut), (".exr", blank)]
)
def test_a_damaged_image_is_one_sentence(tmp_path, fpsboost_, suffix, damage, command):
    """Ours, which names the file; nothing of libpng's, libtiff's, OpenCV's or OpenEXR's."""
    (tmp_path / "in").mkdir()
    _, path = (write(tmp_path / "in" / f"{number}{suffix}") for number in (1, 2))
    data = bytearray(path.read_bytes())
    damage(data)
    path.write_bytes(data)
    result = fpsboost_(*command)
    assert result.code == 1
    assert [line for line in result.lines if line.strip()] == [line for line in result.lines if "2" + suffix in line]
    assert result.err.startswith("fpsboost: in")
    assert command[0] == "probe" or result.out == ""  # where a video may be


def test_what_is_read_nevertheless_is_a_note(tmp_path, fpsboost_, monkeypatch):
    """What a library says while it reads a file is said behind the summary, each text once; --quiet leaves it out."""
    read = source.read_image
    monkeypatch.setattr(source, "read_image", lambda *path, **options: (os.write(2, b"Corrupt data\n"), read(*path))[1])
    (tmp_path / "in").mkdir()
    for number in (1, 2, 3):
        write(tmp_path / "in" / f"{number}.jpg")
    result = fpsboost_("in", "out", "-m", "blend")
    assert (result.code, len(result.lines)) == (0, 3)
    assert result.lines[2] == "Note: A library reports: Corrupt data."
    assert fpsboost_("in", "out2", "-m", "blend", "-q").err == ""


@pytest.mark.slow
def test_nothing_is_printed_at_the_end(tmp_path, save_images):
    """OpenImageIO would name its objects that are left."""
    save_images(tmp_path / "in", count=2)
    command = [sys.executable, "-m", "fpsboost", tmp_path / "in", tmp_path / "out", "-q", "-m", "blend"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""


def test_texts_are_cleaned_and_counted():
    """OpenCV's clock differs from line to line; everything after is as it was before."""
    before = sys.stderr
    with library_texts() as texts:
        for clock in (1, 2):
            os.write(2, f"[ WARN:0@{clock}.5] global grfmt_png.cpp:793 it ends early\n".encode())
        for name in "abc":
            os.write(2, f"{name}\n".encode())
        assert texts.lines() == ["grfmt_png.cpp:793 it ends early", "a", "b", "c"]
        assert texts.sentence().endswith("grfmt_png.cpp:793 it ends early; a; b; and 1 more.")
    assert sys.stderr is before


def test_python_goes_on_to_the_terminal():
    """Also as a process of its own, whose standard error is the terminal; without one nothing happens."""
    program = (
        "import os, sys\n"
        "from fpsboost.cli.library_texts import library_texts\n"
        "with library_texts():\n"
        "    os.write(2, b'library\\n')\n"
        "    print('ours', file=sys.stderr)\n"
        "os.write(2, b'after\\n')\n"
        "print('too', file=sys.stderr)\n"
        "os.close(2)\n"
        "with library_texts() as texts:\n"
        "    assert texts.lines() == []\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.split() == ["ours", "after", "too"]
