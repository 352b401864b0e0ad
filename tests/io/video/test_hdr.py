"""Mastering display and light levels: read, told to encoders, and read again."""

from __future__ import annotations

import struct
from fractions import Fraction
from pathlib import Path

import pytest
from video_truth import write_clip

from fpsboost.contracts import Summary
from fpsboost.conversion import convert
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoder import with_hdr
from fpsboost.io.video.source import VideoSource
from fpsboost.io.video.traits import LightLevel, MasteringDisplay, VideoTraits, parse_mastering_display

DISPLAY = MasteringDisplay(
    red=(Fraction(34, 50), Fraction(16, 50)),
    green=(Fraction(13250, 50000), Fraction(34500, 50000)),
    blue=(Fraction(7500, 50000), Fraction(3000, 50000)),
    white=(Fraction(15635, 50000), Fraction(16450, 50000)),
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
    for name in ("red", "green", "blue", "white"):
        assert getattr(found, name) == pytest.approx(getattr(DISPLAY, name), abs=2**-16)
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
    clip = write_hdr(tmp_path / "in.mp4")
    traits, summary = converted(clip, tmp_path / "out.mkv", Encoding(codec="ffv1"))
    assert (traits.mastering_display, traits.light_level) == (None, None)
    assert summary.remarks == [f"{tmp_path / 'out.mkv'} lost the HDR mastering data of its source."]
    assert with_hdr({"a": "b"}, "ffv1", None, None) == ({"a": "b"}, True)


def test_half_a_display_is_not_invented():
    """Luminance without colours has no words in an encoder's option, so it counts as lost."""
    numbers = [0, 1] * 8 + [50, 10000, 1000, 1]
    display = parse_mastering_display(struct.pack("=22i", *numbers, 0, 1))
    assert display == MasteringDisplay(None, None, None, None, Fraction(1000), Fraction(1, 200))
    assert with_hdr({}, "libx264", display, LIGHT) == ({"x264-params": "cll=1000,400"}, False)
