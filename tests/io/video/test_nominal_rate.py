"""The rate of a video, as its file says it."""

from __future__ import annotations

from fractions import Fraction
from itertools import accumulate, cycle, islice
from types import SimpleNamespace
from typing import Any

import av
import pytest
from conversion_options import keeping_duplicates
from video_truth import add_pictures, write_clip

from fpsboost import convert
from fpsboost.io.video.clock import measured_cadence, nominal_rate
from fpsboost.io.video.source import VideoSource

TICK = Fraction(1, 90_000)
MILLISECOND = Fraction(1, 1000)
NTSC = Fraction(1000, 1001)


def rate_of(path, times, **how):
    with VideoSource(write_clip(path, times=times, time_base=TICK, rate=Fraction(30), size=(16, 16), **how)) as source:
        return source.info.rate


@pytest.mark.parametrize("count", [10, 400])
def test_a_true_rate_is_taken(tmp_path, count):
    """Frames that jitter around 30 per second, or whose last one lasts long, are at 30."""
    times = [3000 * number + (number * 7) % 5 * 5 for number in range(count)]
    assert rate_of(tmp_path / "jitter.mp4", times) == 30
    assert rate_of(tmp_path / "long.mp4", times, end=times[-1] + 5000) == 30


def test_a_clock_that_drifts(tmp_path):
    """A phone that films 29.985 frames per second: its frames pass, up to the last one."""
    times = [round(number * 90_000 / 29.985) for number in range(800)]
    assert float(rate_of(tmp_path / "phone.mp4", times)) == pytest.approx(29.985, abs=1e-4)
    summary = convert(str(tmp_path / "phone.mp4"), str(tmp_path / "out.mp4"), method=keeping_duplicates("nearest"))
    assert (summary.frames_out, summary.frames_made, summary.remarks) == (1600, 800, [])


def rate_by(times, tick, guessed=None, average=None):
    """The rate of a stream with these times, of which FFmpeg says so much."""
    stream: Any = SimpleNamespace(guessed_rate=guessed, average_rate=average)
    return nominal_rate(stream, measured_cadence(times, tick))[0]


@pytest.mark.parametrize("guessed", [Fraction(1000), Fraction(19001, 317), Fraction(4883, 200), None])
@pytest.mark.parametrize("rate", [24 * NTSC, 24, 25, 30 * NTSC, 30, 50, 60 * NTSC, 60, 120 * NTSC, 120, 144, 15 * NTSC])
@pytest.mark.parametrize("tick", [MILLISECOND, TICK, Fraction(1, 600)], ids=["ms", "90 kHz", "1/600"])
def test_real_times_tell_the_rate(rate, tick, guessed):
    """Ten seconds of rounded times give the true rate, whatever the header says."""
    times = [round(number / rate / tick) for number in range(round(10 * rate))]
    assert rate_by(times, tick, guessed, Fraction(1000)) == rate


@pytest.mark.parametrize("rate", [60 * NTSC, 30 * NTSC, Fraction(25)])
@pytest.mark.parametrize("late", [0.16, -0.3, 3.0])
@pytest.mark.parametrize("place", [1, 200, 399])
def test_one_interval_changes_nothing(tmp_path, rate, late, place):
    """Frames that come a part of a frame late from some moment on, or some frames, are at the rate of all others."""
    times = [round((number + (late if number >= place else 0)) / rate / TICK) for number in range(400)]
    mean = (Fraction(399) / (times[-1] * TICK)).limit_denominator(10_000)
    assert rate_by(times, TICK, rate, mean) == rate
    assert rate_by(times, TICK, mean, mean) == rate


def test_most_intervals_decide_where_the_rate_varies():
    """Pauses and bursts do not count; a rate near a round one is that."""
    intervals = islice(cycle([16, 16, 15, 16, 300, 16, 15, 1, 17, 120]), 300)
    assert 60 <= rate_by(list(accumulate(intervals)), MILLISECOND, Fraction(1000)) <= 66
    phone = list(accumulate(islice(cycle([33, 33, 34, 33, 41, 33, 34, 33, 42, 33]), 300)))
    assert rate_by(phone, MILLISECOND, Fraction(1000), Fraction(286, 10)) in (30, 30 * NTSC)


def test_few_frames_are_at_the_rate_that_is_declared():
    """One frame says nothing, and two say what they say."""
    assert rate_by([0], MILLISECOND, Fraction(25)) == 25
    assert rate_by([0, 40], MILLISECOND, Fraction(25)) == 25
    assert rate_by([0, 100], MILLISECOND, Fraction(1000)) == 10
    assert rate_by([], MILLISECOND) == 25


def test_flv_without_metadata(tmp_path):
    """24 frames per second in milliseconds, of which the header says nothing, become 48."""
    with av.open(str(tmp_path / "in.flv"), "w", container_options={"flvflags": "no_metadata"}) as output:
        output.mux(add_pictures(output, 48, rate=24)[1])
    summary = convert(str(tmp_path / "in.flv"), str(tmp_path / "out.mp4"), method=keeping_duplicates("nearest"))
    assert (summary.frames_in, summary.frames_out, summary.remarks) == (48, 96, [])
    with VideoSource(tmp_path / "out.mp4") as source:
        assert source.info.rate == 48
