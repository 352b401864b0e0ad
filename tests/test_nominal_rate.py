"""The rate of a video, as its file says it."""

from __future__ import annotations

from fractions import Fraction

import pytest
from video_truth import write_clip

from fpsboost import convert
from fpsboost.media.video.source import VideoSource

TICK = Fraction(1, 90_000)


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
    summary = convert(str(tmp_path / "phone.mp4"), str(tmp_path / "out.mp4"), method="nearest", duplicates="keep")
    assert (summary.frames_out, summary.frames_made, summary.remarks) == (1600, 800, [])
