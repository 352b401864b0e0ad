"""Retiming: curves that are exact, frames of the times that they name, and sound that goes with them."""

import math
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost import OptionError, OutputRange, Part, RunOptions, convert, join, run_conversion, stream
from fpsboost.media import TimeMap
from fpsboost.timeline import TimelineOptions
from fpsboost.timing.options import Timing
from fpsboost.timing.retime import parse_curve, parse_speeds
from fpsboost.timing.schedule import count_frames
from support.conversion_options import grouped
from support.memory_frames import BLEND, FAST, FakeSink, FakeSource, regular
from support.video_truth import copy_packets, packets_of, pictures_of, scene, write_clip

RATE = Fraction(24)

steps = st.lists(st.fractions(Fraction(1, 9), 3, max_denominator=9), min_size=2, max_size=6)
rises = st.lists(st.fractions(0, 3, max_denominator=9), min_size=6, max_size=6)


def points_of(lengths, heights):
    """Points that begin at 0, with these distances from one to the next."""
    points = [(Fraction(0), Fraction(0))]
    for length, height in zip(lengths, heights, strict=False):
        points.append((points[-1][0] + length, points[-1][1] + height))
    return points


def retimed(frames, text, skip=0, **options):
    """The output frames of flat frames by a curve."""
    source, sink, rate = FakeSource(frames), FakeSink(), Timing(retime=text, **options)
    curve = rate.time_map(source.info)
    schedule = rate.schedule(source.info, curve=curve)
    options = TimelineOptions(duplicates=None)
    run_conversion(source, BLEND, sink, schedule, options=options, outputs=OutputRange(skip=skip))
    return sink.frames


def levels(frames):
    return [frame.array.mean() / 10 for frame in frames]


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(steps, rises, st.booleans(), st.fractions(0, 20, max_denominator=50))
def test_a_curve_is_exact_at_its_points_and_never_turns_between(lengths, heights, smooth, time):
    """Through every point; monotone; its inverse is the first time of a source time; slope 1 is the identity."""
    points = points_of(lengths, heights)
    curve = TimeMap.through(points, smooth=smooth)
    assert [curve.source(at) for at, _ in points] == [source for _, source in points]
    times = sorted([time, *(at for at, _ in points), *(curve.length * k / 40 for k in range(41))])
    assert all(before <= after for before, after in pairwise(map(curve.source, times)))
    shown = curve.source(time)
    first = curve.time_of(shown)
    assert abs(curve.source(first) - shown) <= (Fraction(1, 20) if smooth else 0)
    assert curve.frames_before(shown, RATE) == sum(
        curve.source(k / RATE) < shown for k in range(math.ceil(curve.length * RATE))
    )
    plain = TimeMap.through(points_of(lengths, lengths), smooth=smooth)
    assert (plain.is_plain(sum(lengths)), plain.is_plain(sum(lengths) + 1)) == (True, False)


def test_smooth_slopes_are_those_of_pchip():
    """Values of scipy.interpolate.PchipInterpolator([0, 1, 3, 4], [0, 1, 2, 5])."""
    curve = parse_curve("smooth 0s=0s 1s=1s 3s=2s 4s=5s", RATE, RATE)
    values = [float(curve.source(Fraction(k, 2))) for k in (1, 3, 5, 7)]
    assert values == pytest.approx([0.5592948717948718, 1.2636770557029178, 1.6468003978779842, 3.1372126436781613])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0=0 2s=2s 3s=2.25s", [(0, 0), (2, 2), (3, Fraction(9, 4))]),
        ("# ramp\n0 0\n\n48f 24f  # half\n0:03 1.5s\n", [(0, 0), (2, 1), (3, Fraction(3, 2))]),
        ("smooth 0s 0s\r\n2s\t2s\r\n", [(0, 0), (2, 2)]),
        ("0=0,2s=1s,3s=1s", [(0, 0), (2, 1), (3, 1)]),
        ("1 1\n24 12.5\n48 36", [(0, 0), (Fraction(23, 24), Fraction(23, 48)), (Fraction(47, 24), Fraction(35, 24))]),
    ],
)
def test_points_are_times_or_frames(text, expected):
    """Of both sides; bare numbers are Nuke's, of which the last one is shown as a frame."""
    curve = parse_curve(text, RATE, RATE)
    assert [curve.source(Fraction(at)) for at, _ in expected] == [source for _, source in expected]
    assert curve.length == expected[-1][0] + (0 if "s" in text else 1 / RATE)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("0 0\n# once\n2s", "line 3: '2s' must be an output time and a source time"),
        ("0 0\n2s 1s\n1s 3s", "line 3: 1s is not after the point before it"),
        ("0=0 2s=3", "point 2: '2s=3' has no unit"),
        ("0=0 2s=three", "point 2 'three' is not a position"),
        ("0=0s", "at least two points"),
        ("0=0s x0", "never reaches the source's end"),
        ("0=0s x2 1s=1s", "point 2: 'x2' must be an output time"),
        ("\ufeff0s 0s\n9s 18s\nx1", "goes to 0:18.000"),
        ("0=0 1=1", "point 1: 0 is before Nuke's first frame, 1; write seconds"),
        ("0=0 9s=9s", "ends at 0:02.000"),
    ],
)
def test_a_bad_curve_is_refused(tmp_path, text, reason):
    """With the line, or the point, and the reason."""
    clip, path = write_clip(tmp_path / "in.mkv", times=range(50)), tmp_path / "curve.txt"
    path.write_text(text)
    with pytest.raises(OptionError, match=reason):
        convert(str(clip), str(tmp_path / "out.mkv"), timing=Timing(retime=str(path) if "\n" in text else text))


@pytest.mark.parametrize("text", ["0.25@1-1.5", "1@0-1,0.25@1-1.5"])
def test_speeds_are_a_curve(text):
    """Speed 1 but for the parts named, to the end; what overlaps is refused."""
    curve = parse_speeds(text, RATE)
    assert [curve.source(Fraction(time)) for time in (1, 2, 3, 9)] == [
        1,
        Fraction(5, 4),
        Fraction(3, 2),
        Fraction(15, 2),
    ]
    info = replace(FakeSource(regular(9)).info, frame_count=50, duration=None)
    assert count_frames(Timing(speed=text).schedule(info, curve=curve), info, holds_last_frame=True) == 88
    for wrong in ("2@1-2,2@1.5-3", "2@2-1", "0", "2,2@3-", "2@1-2-3"):
        with pytest.raises(OptionError, match="`speed`"):
            parse_speeds(wrong, RATE)


def test_frames_show_the_times_of_the_curve():
    """Slow, frozen and fast; one after another at the source's rate, or at another one; the last one is held."""
    frames = retimed(regular(10), "0=0 4f=2f 6f=2f 8f=6f 11f=12f")
    assert levels(frames) == pytest.approx([0, 0.5, 1, 1.5, 2, 2, 2, 4, 6, 8, 9], abs=0.06)
    assert [frame.time for frame in frames] == [Fraction(k, 25) for k in range(11)]
    assert {frame.duration for frame in frames} == {Fraction(1, 25)}
    resumed = retimed(regular(10), "0=0 4f=2f 6f=2f 8f=6f 11f=12f", skip=5)
    assert levels(resumed)[5:] == levels(frames)[5:]
    assert levels(retimed(regular(10), "0=0 4f=2f", fps=50)) == pytest.approx([0, 0.5, 1, 1.5], abs=0.06)
    images = [frame.array for frame in regular(10)]
    assert [image.mean() for image in stream(images, retime="0=2f 3f=8f", method="blend")] == [20, 40, 60]
    with pytest.raises(OptionError, match="backwards"):  # images that are read once
        list(stream(images, retime="0=8f 8f=0", method="blend"))


def test_a_shutter_is_open_for_what_the_speed_shows():
    """The faster, the wider the blur; none while the picture is frozen, whose frames stay as they are."""
    frames = regular(20)
    ramp = [replace(frame, image=np.float32(frame.image) ** 2) for frame in frames]
    blurred, plain = (retimed(ramp, "0=4f 4f=6f 8f=6f 12f=14f", **options) for options in ({"shutter": 360}, {}))
    difference = [abs(a - b) for a, b in zip(levels(blurred), levels(plain), strict=True)]
    assert max(difference[5:7]) < 1e-3
    assert difference[10] > 3 * difference[2] > 0


@pytest.fixture
def clip(tmp_path):
    return write_clip(tmp_path / "in.mkv", times=range(50), sound="aac")


@pytest.mark.slow
def test_a_curve_of_slope_one_gives_the_plain_output(tmp_path, clip):
    """Packets of pictures and of sound, at another rate, too."""
    for name, speed in {"plain": {}, "curve": {"retime": "0=0 1s=1s 2s=2s"}, "speed": {"speed": "1"}}.items():
        options = grouped(factor=2, **speed)
        convert(str(clip), str(tmp_path / f"{name}.mp4"), method="blend", encoding=FAST, **options)
    for name in ("curve", "speed"):
        for kind in ("video", "audio"):
            assert packets_of(tmp_path / f"{name}.mp4", kind) == packets_of(tmp_path / "plain.mp4", kind)


@pytest.mark.slow
def test_sound_is_stretched_where_the_speed_allows_it(tmp_path, clip):
    """Silent while the picture stands or repeats, in parts, too; dropped if asked, and always said."""
    curve = {"retime": "0=0 1s=.5s 1.5s=.5s 2s=0s 3s=2s"}
    whole, parts = tmp_path / "out.mkv", tmp_path / "parts.mkv"
    summary = convert(str(clip), str(whole), method="nearest", encoding=FAST, **grouped(**curve))
    reasons = "speed 0, speed -1, shown again, or too short"
    assert f"{whole} has no sound from 0:01 to 0:02.250 ({reasons})." in summary.remarks
    assert len(pictures_of(whole)) == 75
    for number in (1, 2):
        part = RunOptions(chunk=Part(number, 2))
        convert(str(clip), str(parts), method="nearest", encoding=FAST, timing=Timing(**curve), run=part)
    join(str(parts), [f"{parts}.parts"])
    assert packets_of(parts, "audio") == packets_of(whole, "audio")
    for number, options in enumerate([curve | {"slow_motion_sound": "drop"}, {"retime": "0=1s 1s=0"}]):
        path = tmp_path / f"{number}.mkv"
        summary = convert(str(clip), str(path), method="nearest", encoding=FAST, **grouped(**options))
        with av.open(str(path)) as file:
            assert not file.streams.audio
        assert any("sound, which the retime curve leaves out" in remark for remark in summary.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("curve", ["0=1.99s 2s=0", "0=0 24f=40f 40f=24.5f 60f=49f", "smooth 0=1s 9f=.3s 40f=.3s 50f=0"])
def test_a_clip_plays_backwards(tmp_path, curve):
    """Every frame shows the time of the curve; in parts, the packets are the same."""
    pictures = [np.full((48, 64, 3), 20 + 4 * number, np.uint8) for number in range(50)]
    clip = write_clip(tmp_path / "in.mkv", times=range(50), picture=lambda number, *_: pictures[number])
    timing = Timing(Fraction(6), retime=curve, duplicates="keep")
    options: dict[str, Any] = {"method": BLEND, "encoding": FAST, "timing": timing}
    assert not convert(str(clip), str(tmp_path / "out.mkv"), **options).remarks
    rate, wanted = Fraction(150), parse_curve(curve, Fraction(150), Fraction(25))
    times = [float(wanted.source(k / rate) * 25) for k in range(math.ceil(wanted.length * rate))]
    before, after = (
        [picture.to_ndarray(format="bgr24").mean() for picture in pictures_of(path)]
        for path in (clip, tmp_path / "out.mkv")
    )
    assert after == pytest.approx(np.interp(times, range(50), before).tolist(), abs=1.5)
    for number in (1, 2):
        convert(str(clip), str(tmp_path / "parts.mkv"), **options, run=RunOptions(chunk=Part(number, 2)))
    join(str(tmp_path / "parts.mkv"), [str(tmp_path / "parts.mkv.parts")])
    assert packets_of(tmp_path / "parts.mkv", "video") == packets_of(tmp_path / "out.mkv", "video")


turns = st.lists(st.tuples(st.integers(1, 9), st.integers(0, 9)), min_size=1, max_size=5)


@settings(deadline=None, max_examples=60)
@given(turns, st.booleans(), st.integers(0, 9), st.integers(0, 9), st.integers(1, 6))
def test_a_part_of_the_source_is_shown_whenever_the_curve_passes_it(turns, smooth, first, begin, length):
    """By brute force: an output time lies in a passage if and only if its source time lies in the part."""
    points = [(Fraction(0), Fraction(first))]
    for step, source in turns:
        points.append((points[-1][0] + step, Fraction(source)))
    curve, end = TimeMap.through(points, smooth=smooth), begin + length
    passages = curve.passages(Fraction(begin), Fraction(end))
    assert all(before[0] < before[1] < after[0] for before, after in pairwise(passages))
    for number in range(round(curve.length * 7)):
        time = Fraction(number, 7) + Fraction(1, 100)
        source, near = (
            curve.source(time),
            any(abs(time - each) < Fraction(1, 500) for both in passages for each in both),
        )
        assert near or any(time0 <= time < time1 for time0, time1 in passages) == (begin <= source < end)


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
@pytest.mark.parametrize(
    ("curve", "cues", "chapters"),
    [
        ("0=4s 4s=0", [(1.0, 2.0, b"second"), (2.5, 3.5, b"first")], [(0.0, 2.0, "two"), (2.0, 4.0, "one")]),
        (
            "0=0 2s=2s 4s=0 7s=3s",
            [(0.5, 1.5, b"first"), (2.5, 3.5, b"first"), (4.5, 5.5, b"first"), (6.0, 7.0, b"second")],
            [(0.0, 6.0, "one"), (6.0, 7.0, "two")],
        ),
        (
            "0=3.5s 1s=3.5s 3s=1.5s 4s=2.5s",
            [(1.5, 2.5, b"second"), (3.5, 4.0, b"second")],
            [(0.0, 2.5, "two"), (2.5, 3.5, "one"), (3.5, 4.0, "two")],
        ),
    ],
)
def test_cues_and_chapters_come_wherever_the_curve_passes_them(tmp_path, suffix, curve, cues, chapters):
    """Backwards too: each as often as its part of the source is shown, from and until when it is."""
    lines = [(500, 1000, b"first"), (2000, 1000, b"second")]
    whole = write_clip(tmp_path / "whole.mkv", times=range(100), subtitles=lines)
    marks = [
        {"id": 7 + begin, "start": begin, "end": begin + 2, "time_base": Fraction(1), "metadata": {"title": title}}
        for begin, title in ((0, "one"), (2, "two"))
    ]
    clip = copy_packets(whole, tmp_path / "in.mkv", chapters=marks)
    out = tmp_path / f"out{suffix}"
    summary = convert(str(clip), str(out), method="nearest", encoding=FAST, **grouped(retime=curve))
    assert not any("lost" in remark for remark in summary.remarks)
    with av.open(str(out)) as file:
        packets = [packet for packet in file.demux(file.streams.subtitles) if packet.size > 2]
        tick = Fraction(packets[0].time_base)
        shown = [(packet.pts * tick, (packet.pts + packet.duration) * tick, bytes(packet)) for packet in packets]
        found = [(each["start"], each["end"], each["time_base"], each["metadata"]["title"]) for each in file.chapters()]
    assert [
        (float(begin), float(end), text.lstrip(b"\0\5\6")) for begin, end, text in shown
    ] == cues  # mp4 counts bytes
    assert [(float(begin * base), float(end * base), title) for begin, end, base, title in found] == chapters


def test_what_lies_long_before_a_curve_is_not_decoded(tmp_path, monkeypatch):
    """The packets are those of reading from the beginning, where frames repeat, too."""
    picture = {"picture": lambda number, *size: scene(9 * (number // 3), *size), "options": {"g": "12"}}
    clip, read = write_clip(tmp_path / "in.mkv", times=range(120), **picture), []
    for late, name in ((99, "all.mkv"), (0, "few.mkv")):
        monkeypatch.setattr("fpsboost.parts.plan.LATE", late)
        options = grouped(retime="smooth 0=91f 9f=95.5f 30f=101f")
        read.append(convert(str(clip), str(tmp_path / name), method="blend", encoding=FAST, **options).frames_in)
    assert packets_of(tmp_path / "few.mkv", "video") == packets_of(tmp_path / "all.mkv", "video")
    assert read[1] < 60 < read[0]
