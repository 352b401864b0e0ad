"""Ranges of output frames, made by themselves, are those that the whole run makes."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fpsboost import CutDetector, Frame, FrameCache, Interpolator, OutputRange, Summary, methods, run_conversion
from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, find_synchronised
from fpsboost.parts.entry import find_entry
from fpsboost.timing.schedule import ByFactor, ByRate, Schedule
from fpsboost.timing.shutter import Shutter
from support.memory_frames import FakeSink, FakeSource
from support.truth import frozen

RATE = Fraction(25)
SIZE = (32, 48)


@dataclass(frozen=True)
class PlainCuts(CutDetector):
    """Detector whose match score is that of single pixels, for speed."""

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        difference = float(np.abs(image0.array[::4, ::4].astype(float) - image1.array[::4, ::4]).mean())
        return max(0.0, 1 - difference / 255 * 3)


BLEND = replace(methods["blend"], cuts=PlainCuts())


def picture(seed: int, shift: int) -> NDArray[Any]:
    """A texture moved by some pixels; the seed is the scene."""
    coarse = np.random.default_rng(seed).integers(0, 256, (8, 12, 3), dtype=np.uint8)
    return frozen(np.roll(np.kron(coarse, np.ones((4, 4, 1), np.uint8)), shift, axis=1))


def images_of(draw: st.DrawFn, scene: int) -> list[NDArray[Any]]:
    """Return the frames of one scene: motion, held pictures, a still, or a slow drift."""
    kind = draw(st.sampled_from(["motion", "twos", "threes", "still", "drift"]))
    length = draw(st.integers(3, 20))
    hold = {"twos": 2, "threes": 3, "still": length}.get(kind, 1)
    if kind == "drift":
        start = picture(scene, 0).astype(int)
        return [frozen(np.clip(start + 2 * index, 0, 255).astype(np.uint8)) for index in range(length)]
    return [picture(scene, 3 * (index // hold)) for index in range(length)]


@st.composite
def clips(draw: st.DrawFn) -> list[Frame]:
    """Clips of some scenes, at regular or irregular times, some with a pause that is filled, or too long for that."""
    images = [image for scene in range(draw(st.integers(1, 4))) for image in images_of(draw, scene)]
    jitter = draw(st.sampled_from([0, 0, 3, 18]))
    pause, begin = draw(st.sampled_from([0, 0, 2000, 700_000])), draw(st.integers(1, len(images) - 1))
    shifts = np.random.default_rng(draw(st.integers(0, 9))).integers(-jitter, jitter + 1, len(images)).tolist()
    ticks = [40 * index + (shifts[index] + pause * (index >= begin)) * (index > 0) for index in range(len(images))]
    times = [Fraction(tick, 1000) for tick in ticks]
    spans = [*(after - time for time, after in pairwise(times)), 1 / RATE]
    return [
        Frame(image, *shown, original=object(), captions=bytes([number]))
        for number, (image, *shown) in enumerate(zip(images, times, spans, strict=True))
    ]


SCHEDULES: dict[str, Schedule] = {
    "factor 2": ByFactor(Fraction(2)),
    "factor 5/2": ByFactor(Fraction(5, 2)),
    "60 per second": ByRate.forgiving(Fraction(60), RATE, Fraction(1, 1000)),
    "10 per second": ByRate.forgiving(Fraction(10), RATE, Fraction(1, 1000)),
    "blurred": replace(ByRate.forgiving(Fraction(50), RATE, Fraction(1, 1000)), shutter=Shutter(Fraction(360), 3)),
}


def run(
    frames: list[Frame], schedule: Schedule, interpolator: Interpolator, outputs: OutputRange = OutputRange()
) -> tuple[list[Frame], Summary]:
    """Return the frames that a sink gets, and the summary."""
    sink = FakeSink()
    sink.holds_last_frame = True
    begin = 0 if outputs.entry is None else outputs.entry.number
    source = FakeSource(frames[begin:], RATE)
    summary = run_conversion(source, interpolator, sink, schedule, outputs=outputs, threads=1)
    return sink.frames, summary


def entered(frames: list[Frame], schedule: Schedule, outputs: OutputRange) -> OutputRange:
    """Return a range that begins at the entry that is found for it."""

    @contextmanager
    def read_from(number: int) -> Iterator[Iterator[Frame]]:
        yield iter(frames[number:])

    times = [frame.time for frame in frames]
    return replace(outputs, entry=find_entry(times, schedule, DuplicateDetector(), outputs.first, read_from))


def facts(frame: Frame) -> tuple[object, ...]:
    return frame.time, frame.duration, frame.original, frame.preceding, frame.captions, frame.array.tobytes()


@pytest.mark.slow
@given(clip=clips(), data=st.data())
@settings(max_examples=8)
@pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES)
def test_ranges_are_parts_of_the_whole(schedule, clip, data):
    """Frames, times, captions and counts of all ranges together are those of the whole, wherever reading begins."""
    whole, of_all = run(clip, schedule, BLEND)
    cuts = sorted(data.draw(st.sets(st.integers(1, max(1, len(whole) - 1)), max_size=2)))
    ranges = [OutputRange(first, stop) for first, stop in pairwise([0, *cuts, None])]
    found = []
    for outputs in ranges:
        chosen = entered(clip, schedule, outputs) if outputs.first else outputs
        found.append(run(clip, schedule, BLEND, chosen))
    assert [facts(frame) for frames, _ in found for frame in frames] == [facts(frame) for frame in whole]
    for count in ("frames_out", "frames_made", "scene_cuts", "duplicates"):
        assert sum(getattr(summary, count) for _, summary in found) == getattr(of_all, count)
    for (_, summary), (_, following), outputs in zip(found, found[1:], ranges, strict=False):
        assert summary.boundaries[outputs.stop] == following.boundaries[outputs.stop]


@pytest.mark.parametrize(("kind", "expected"), [(1, 0.9), (2, 0.4), (3, 0.3)])
def test_grouping_is_certain_at_most_moves(kind, expected):
    """In ordinary motion nearly everywhere, and in animation at each new picture; never within a still."""
    images = [picture(0, 3 * (index // kind)) for index in range(40)]
    shown = [SourceFrame(Frame(image, index / RATE)) for index, image in enumerate(images)]
    found = [frame for frame, _ in find_synchronised(shown, DuplicateDetector())]
    assert len(found) >= expected * 38
    assert not list(find_synchronised([shown[0]] * 9, DuplicateDetector()))
