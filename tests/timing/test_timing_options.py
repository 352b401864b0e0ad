"""What a pace means for a clip: constant rates, clocks that round, pauses, ten hours of frames."""

import math
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import av
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost import ClipInfo, Frame, OptionError, Summary, Timing, convert, run_conversion
from fpsboost.timeline import TimelineOptions
from fpsboost.timing.schedule import MAX_FILLED, ByFactor, ByRate, Step, count_frames
from support.conversion_options import grouped
from support.memory_frames import BLEND, LOSSLESS, FakeSink, FakeSource, make_frames
from support.video_truth import copy_packets, read, times_of, write_clip

MILLISECOND = Fraction(1, 1000)
FILM, NTSC = Fraction(24000, 1001), Fraction(60000, 1001)


def info_of(rate: Fraction, time_base: Fraction = Fraction(1, 90000), duration: Fraction | None = None) -> ClipInfo:
    count = None if duration is None else round(duration * rate)
    return ClipInfo("clip.mp4", 4, 6, rate, time_base, count, duration)


def source_of(info: ClipInfo, times: Iterable[Fraction], end: Fraction) -> FakeSource:
    """Flat frames at the given times, each brighter than the one before, with their numbers as originals."""
    frames = make_frames(times, end)
    source = FakeSource([replace(frame, original=number) for number, frame in enumerate(frames)])
    source.info = info
    return source


def play(info: ClipInfo, times: Iterable[Fraction], end: Fraction, pace: Timing) -> tuple[list[Frame], Summary]:
    """What comes out, with the remarks of the pace."""
    source, sink, schedule = source_of(info, times, end), FakeSink(), pace.schedule(info)
    summary = run_conversion(source, BLEND, sink, schedule, options=TimelineOptions(duplicates=None))
    summary.remarks = pace.remarks(info, schedule, summary.frame_intervals)
    return sink.frames, summary


def test_twice_the_rate_unless_told():
    """A factor of the source's rate, a rate, or the frames of each interval; images have no clock."""
    info = info_of(Fraction(24))
    forgiving = ByRate.forgiving
    tick = info.time_base
    assert Timing().schedule(info) == forgiving(Fraction(48), Fraction(24), tick)
    assert Timing(Fraction(5, 2)).schedule(info) == forgiving(Fraction(60), Fraction(24), tick)
    assert Timing(fps=NTSC).schedule(info) == forgiving(NTSC, Fraction(24), tick)
    assert Timing(keep_timing=True).schedule(info) == ByFactor(Fraction(2), Fraction(1))
    assert Timing(Fraction(3)).schedule(info, has_clock=False) == ByFactor(Fraction(3), Fraction(1))
    assert Timing(Fraction(3)).schedule(info_of(Fraction(2)), has_clock=False).longest == 5
    assert Timing(fps=NTSC).schedule(info, has_clock=False) == forgiving(NTSC, Fraction(24), tick)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"factor": 2, "fps": 60}, "`factor` and `fps` cannot be combined: both set the output rate"),
        ({"retime": "0=0 1s=2s", "speed": "2"}, "`retime` and `speed` cannot be combined"),
        ({"speed": "2", "slow_motion": True}, "`speed` and `slow_motion` cannot be combined"),
        ({"fps": 60, "keep_timing": True}, "`fps` and `keep_timing` cannot be combined"),
        ({"gaps": "3", "duplicates": "drop"}, "`gaps` and `duplicates='drop'` cannot be combined"),
        ({"factor": 0}, "`factor` must be"),
        ({"fps": 0}, "`fps` must be"),
    ],
)
def test_contradictions_are_refused(wrong, message):
    """A sentence about the options, before any file is opened."""
    with pytest.raises(OptionError, match=message):
        Timing(**wrong)


def test_a_rate_beyond_all_measure_is_refused():
    """A factor within its bounds can still ask for too much of a clip."""
    with pytest.raises(OptionError, match=r"`factor=900` makes 108000 frames per second of clip\.mp4"):
        Timing(Fraction(900)).schedule(info_of(Fraction(120)))


@pytest.mark.parametrize(
    ("pace", "source"),
    [
        (Timing(fps=NTSC), FILM),
        (Timing(Fraction(5, 2)), FILM),
        (Timing(Fraction(3, 2)), Fraction(25)),
        (Timing(Fraction(2, 3)), Fraction(60)),
        (Timing(fps=Fraction(24)), Fraction(30000, 1001)),
        (Timing(Fraction(5, 2), keep_timing=True), FILM),
    ],
    ids=str,
)
@pytest.mark.parametrize("clock", [Fraction(1, 24000 * 25), MILLISECOND], ids=["exact", "milliseconds"])
def test_ten_hours_stay_exact(pace, source, clock):
    """All frames counted by arithmetic, thousands looked at: times on the grid, in order, t exact, to the very end."""
    count = math.floor(36000 * source)
    info = info_of(source, clock)
    schedule = pace.schedule(info)
    rate = schedule.rate(source)
    exact = clock != MILLISECOND

    def time_of(index: int) -> Fraction:
        return schedule.presentation_time(
            Fraction(0), index / source if exact else Fraction(round(index / source * 1000), 1000)
        )

    total = math.ceil(count * rate / source)
    assert count_frames(schedule, info_of(source, clock, count / source), True) == total
    seen = 0
    for index in [*range(0, count, 997), *range(count - 300, count)]:
        steps = list(schedule.steps(index, Fraction(0), time_of(index), time_of(index + 1)))
        numbers = range(math.ceil(index * rate / source), math.ceil((index + 1) * rate / source))
        if exact or not pace.keep_timing:
            assert steps == [Step(k / rate, k * source / rate - index) for k in numbers]
        assert len(steps) == len(numbers)
        assert all(a.time < b.time for a, b in pairwise(steps))
        seen += len(steps)
    assert seen > 500
    assert numbers.stop == total


@given(
    st.sampled_from([Fraction(15), FILM, Fraction(25), Fraction(30), NTSC]),
    st.sampled_from([Fraction(1, 2), Fraction(3, 2), Fraction(2), Fraction(5, 2), Fraction(8)]),
    st.sampled_from([MILLISECOND, Fraction(1, 600), Fraction(1, 90000)]),
    st.lists(st.integers(1, 400), min_size=1, max_size=30),
)
def test_times_increase_whatever_the_clock(rate, factor, tick, intervals):
    """Where a frame is taken to be is never before the place of an earlier one, and half a frame away at most."""
    schedule = Timing(factor).schedule(info_of(rate, tick))
    times = [Fraction(0)]
    for interval in intervals:
        times.append(times[-1] + interval * tick)
    moments = [schedule.presentation_time(Fraction(0), time) for time in times]
    assert all(a <= b for a, b in pairwise(moments))
    bound = min(1 / rate, 1 / (rate * factor)) / 2
    assert all(abs(moment - time) < bound for moment, time in zip(moments, times, strict=True))


@pytest.mark.parametrize("start", [Fraction(0), Fraction(23, 1000), Fraction(-1, 50)])
@pytest.mark.parametrize("factor", [Fraction(2), Fraction(3), Fraction(8)])
def test_milliseconds_mean_the_rate_that_was_rounded(start, factor):
    """23.976 frames a second in whole milliseconds: every original is there, at its true place, and none is mixed."""
    count = 26  # what is rounded off comes around after 24 frames
    times = [start + Fraction(round(k / FILM * 1000), 1000) for k in range(count)]
    end = start + Fraction(round(count / FILM * 1000), 1000)
    frames, summary = play(info_of(FILM, MILLISECOND), times, end, Timing(factor))
    assert [frame.time for frame in frames] == [start + k / (FILM * factor) for k in range(count * int(factor))]
    assert [frame.original for frame in frames[:: int(factor)]] == list(range(count))
    assert all(frame.original is None for k, frame in enumerate(frames[:-1]) if k % factor and k < (count - 1) * factor)
    assert summary.remarks == []


def test_a_variable_rate_becomes_constant_and_is_said():
    """Even times, each frame mixed by its true time, as long as the source, and a remark that says so."""
    times = [Fraction(t, 100) for t in (0, 4, 8, 18, 22, 30, 34)]
    info = info_of(Fraction(25), Fraction(1, 100))
    frames, summary = play(info, times, Fraction(38, 100), Timing())
    assert [frame.time for frame in frames] == [Fraction(k, 50) for k in range(19)]
    assert frames[-1].time + frames[-1].duration == Fraction(38, 100)
    assert [int(frame.image[0, 0, 0]) for frame in frames[4:10]] == [20, 22, 24, 26, 28, 30]
    assert summary.remarks == [
        "clip.mp4 varies from 10 to 25 frames per second; the output is constant at 50, and `keep_timing` keeps it "
        "variable."
    ]
    assert play(info, times, Fraction(38, 100), Timing(keep_timing=True))[1].remarks == []
    assert play(info, times, Fraction(38, 100), Timing(fps=Fraction(60)))[1].remarks == []


def test_across_a_pause_the_picture_is_repeated():
    """Three seconds without a frame: no motion is made up for them, the picture stands, and that is said."""
    times = [Fraction(k, 25) for k in range(5)] + [3 + Fraction(k, 25) for k in range(5, 10)]
    frames, summary = play(info_of(Fraction(25)), times, 3 + Fraction(10, 25), Timing())
    assert [frame.time for frame in frames] == [Fraction(k, 50) for k in range(170)]
    assert {frame.original for frame in frames[8:160]} == {4}
    assert frames[160].original == 5
    assert summary.frames_made == summary.frames_out - 10
    assert any(
        "clip.mp4 shows nothing new for 3.0 s from 0.2 s on; the picture was held there" in remark
        for remark in summary.remarks
    )


def test_a_damaged_time_does_not_fill_the_disk():
    """Days without a frame become one long frame and a remark; what comes after keeps its times."""
    gap = 100 * MAX_FILLED
    times = [Fraction(k, 25) for k in range(5)] + [gap + Fraction(k, 25) for k in range(5)]
    frames, summary = play(info_of(Fraction(25)), times, gap + Fraction(5, 25), Timing())
    assert len(frames) == 9 + 10
    assert frames[8].duration == gap - Fraction(4, 25)
    assert any("59999.8 s" in remark and "as one long frame" in remark for remark in summary.remarks)


@pytest.mark.parametrize(
    ("pace", "rate", "stretch"),
    [
        (Timing(slow_motion=True), FILM, Fraction(2)),
        (Timing(Fraction(4), slow_motion=True), FILM, Fraction(4)),
        (Timing(Fraction(5, 2), slow_motion=True), FILM, Fraction(5, 2)),
        (Timing(Fraction(4), Fraction(60), slow_motion=True), Fraction(60), Fraction(4)),
        (Timing(None, Fraction(60), slow_motion=True), Fraction(60), Fraction(2)),
        (Timing(Fraction(3), keep_timing=True, slow_motion=True), FILM, Fraction(3)),
    ],
    ids=str,
)
@pytest.mark.parametrize("start", [Fraction(0), Fraction(1, 3)])
def test_slow_motion_keeps_the_rate_and_lasts_longer(pace, rate, stretch, start):
    """Frames at the rate of the source, or at --fps, from its first time on, and originals at their stretched times."""
    info = info_of(FILM, Fraction(1, 24000))
    times = [start + k / FILM for k in range(12)]
    source, sink, schedule = source_of(info, times, start + 12 / FILM), FakeSink(), pace.schedule(info)
    run_conversion(source, BLEND, sink, schedule, options=TimelineOptions(pace.stretch))
    assert pace.output_timing(info, schedule).rate == rate
    assert [frame.time for frame in sink.frames] == [
        start + k / rate for k in range(math.ceil(12 / FILM * stretch * rate))
    ]
    assert sink.frames[-1].time + sink.frames[-1].duration == start + 12 / FILM * stretch
    shown = [(frame.time - start, frame.original) for frame in sink.frames]
    passed = [(time, number) for time, number in shown if number is not None and time <= 11 / FILM * stretch]
    assert passed
    assert all(time == number / FILM * stretch for time, number in passed)


def test_slow_motion_of_a_file(tmp_path):
    """Four times as long at the same rate, subtitles and chapters in step, sound left out and said."""
    clip = write_clip(
        tmp_path / "in.mkv", times=range(25), sound="aac", subtitles=[(100, 200, b"words")], chapters=True
    )
    pace: dict[str, Any] = {"factor": 4, "slow_motion": True}
    summary = convert(str(clip), str(tmp_path / "out.mkv"), **grouped(**pace), method="nearest", encoding=LOSSLESS)
    assert times_of(tmp_path / "out.mkv") == [Fraction(k, 25) for k in range(100)]
    assert summary.remarks == [f"{clip} has sound, which slow motion leaves out."]
    with av.open(str(tmp_path / "out.mkv")) as file:
        assert [(p.pts, p.duration) for p in file.demux(subtitles=0) if p.size] == [(400, 800)]
        assert [(each["start"], each["end"]) for each in file.chapters()] == [(0, 800 * 10**6)]
        assert not file.streams.audio
    turned = grouped(retime="0=0s .5s=.25s 1s=0s")  # turns back amid the words, which end where they began
    convert(str(clip), str(tmp_path / "turned.mkv"), **turned, method="nearest", encoding=LOSSLESS)
    with av.open(str(tmp_path / "turned.mkv")) as file:
        assert [(p.pts, p.duration) for p in file.demux(subtitles=0) if p.size] == [(200, 600)]


def test_one_time_far_ahead_loses_nothing(tmp_path):
    """A single damaged time is put back between its neighbours, and the frames after it are not too late."""
    clip = write_clip(tmp_path / "in.mkv", times=range(12), codec="ffv1")

    def damage(number: int, packet: Any) -> None:
        packet.pts = 9_000_000 if number == 5 else packet.pts

    copy_packets(clip, tmp_path / "damaged.mkv", damage)
    frames, remarks = read(tmp_path / "damaged.mkv")
    assert [frame.time for frame in frames] == [Fraction(k, 25) for k in range(12)]
    assert any("gives 1 frame a time far ahead of the next" in remark for remark in remarks)
