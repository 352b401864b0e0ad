"""The loop: which frames come out, when and how long, what happens to errors; and whole conversions of files."""

import os
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from queue import Empty, Queue
from typing import Any

import av
import cv2
import numpy as np
import pytest

from fpsboost import (
    ClipInfo,
    CutDetector,
    Frame,
    InputError,
    Interpolator,
    RunOptions,
    Summary,
    convert,
    methods,
    run_conversion,
)
from fpsboost.analysis.duplicates import DuplicateDetector
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis.blend import Blend
from fpsboost.timeline import TimelineOptions
from fpsboost.timing.schedule import ByFactor, ByRate, Schedule, count_frames
from support.memory_frames import BLEND, LOSSLESS, SIZE, FakeSink, FakeSource, regular
from support.truth import CutsWhere, accelerating, noise, prepared
from support.video_truth import packets_of, pictures_of, samples_of, times_of, write_clip

pytestmark = pytest.mark.usefixtures("no_thread_left")


def run(
    frames: list[Frame],
    schedule: Schedule,
    *,
    holds: bool = True,
    interpolator: Interpolator = BLEND,
    duplicates: DuplicateDetector | None = DuplicateDetector(),
) -> tuple[list[Frame], Summary]:
    sink = FakeSink(holds)
    summary = run_conversion(
        FakeSource(frames), interpolator, sink, schedule, options=TimelineOptions(duplicates=duplicates)
    )
    assert summary.frames_in == len(frames)
    assert summary.frames_out == len(sink.frames)
    return sink.frames, summary


FACTORS = [Fraction(1), Fraction(2), Fraction(3), Fraction(5, 2), Fraction(3, 2), Fraction(1, 2), Fraction(2, 3)]
RATES = [Fraction(60), Fraction(50), Fraction(60000, 1001), Fraction(25), Fraction(24), Fraction(10)]
SCHEDULES: list[Schedule] = [*map(ByFactor, FACTORS), *map(ByRate, RATES)]


@pytest.mark.parametrize("holds", [True, False], ids=["video", "images"])
@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_number_of_frames(schedule, holds):
    """A video is filled to its end, images end with the last one; the count told beforehand is the same.

    A source frame whose time is asked for is the very same array and picture, and no other frame claims to be.
    """
    count = 10
    source = regular(count)
    frames, summary = run(source, schedule, holds=holds)
    factor = schedule.rate(Fraction(25)) / 25
    expected = -(-count * factor // 1) if holds else (count - 1) * factor // 1 + 1
    assert len(frames) == expected
    assert count_frames(schedule, ClipInfo("x", 1, 1, Fraction(25), Fraction(1, 25), count), holds) == expected
    assert count_frames(schedule, ClipInfo("x", 1, 1, Fraction(25), Fraction(1, 25), None), holds) is None
    by_time = {frame.time: frame for frame in source}
    hit = [frame for frame in frames if frame.time in by_time]
    assert hit
    assert all(frame.image is by_time[frame.time].image for frame in hit)
    assert all(frame.original is by_time[frame.time].original for frame in hit)
    assert summary.frames_made == len(frames) - len(hit)
    between = [frame for frame in frames if frame.time not in by_time and frame.time < source[-1].time]
    assert all(frame.original is None for frame in between)


@pytest.mark.parametrize("start", [Fraction(0), Fraction(2), Fraction(-1, 50)])
@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_a_video_is_as_long_as_before(schedule, start):
    """Each frame lasts until the next, and the last one until the source ends, so nothing is lost or added."""
    frames, _ = run(regular(10, start=start), schedule)
    assert frames[0].time == start
    assert all(a.time + a.duration == b.time for a, b in pairwise(frames))
    assert frames[-1].time + frames[-1].duration == start + Fraction(10, 25)
    assert sum(frame.duration for frame in frames) == Fraction(10, 25)


@pytest.mark.parametrize("schedule", [ByFactor(Fraction(3)), ByRate(Fraction(60))], ids=str)
def test_made_frames_lie_where_their_times_say(schedule):
    """A made frame mixes the two around it in proportion to its time."""
    frames, _ = run(regular(6), schedule)
    for frame in frames:
        position = min(frame.time * 25, 5)
        assert np.abs(frame.image.astype(float) - float(10 * position)).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("count", [0, 1])
@pytest.mark.parametrize("holds", [True, False], ids=["video", "images"])
def test_two_frames_are_needed(count, holds):
    """No frame or one frame is an InputError that names the clip and says how many there were."""
    sink = FakeSink(holds)
    with pytest.raises(InputError, match=f"fake.mp4 holds {'one' if count else 'no'} frame"):
        run_conversion(FakeSource(regular(count)), BLEND, sink, ByFactor(Fraction(2)))
    assert sink.frames == []


def test_remarks_of_both_sides_are_told():
    """What source and sink have to say is in the summary, also what the source says at its very end."""
    _, summary = run(regular(3), ByFactor(Fraction(2)))
    assert summary.remarks == ["The source was guessed at.", "The target lost something."]


class Counting:
    """Counts the pairs that motion is estimated for."""

    def __init__(self) -> None:
        self.pairs = 0

    def estimate(self, image0: Any, image1: Any) -> Any:
        self.pairs += 1
        return ZeroMotion().estimate(image0, image1)


@pytest.mark.parametrize(
    ("factor", "pairs"), [(Fraction(4), 5), (Fraction(2), 5), (Fraction(1), 0), (Fraction(1, 2), 0)], ids=str
)
def test_motion_is_found_once_for_each_pair(factor, pairs):
    """However many frames lie between two, their motion is estimated once, and never where none lies between."""
    estimator = Counting()
    run(regular(6), ByFactor(factor), interpolator=Interpolator(estimator, Blend(), cuts=None))
    assert estimator.pairs == pairs


def cuts_before(*numbers: int) -> CutsWhere:
    """Every pair whose second frame is one of `numbers` is a cut."""
    values = {10 * number for number in numbers}
    return CutsWhere(lambda _, image1: int(image1.pixels.max()) in values)


@pytest.mark.parametrize("at_cuts", ["repeat", "blend"])
def test_scene_cuts_are_counted_and_not_interpolated(monkeypatch, at_cuts):
    """Across a cut the nearer frame is repeated, or both are mixed where that is asked for, and motion is not used."""
    monkeypatch.setattr("fpsboost.pair.estimate_illumination", lambda *_: None)  # or it explains each of these cuts
    estimator = Counting()
    interpolator = Interpolator(
        estimator, Blend(), cuts=cuts_before(2, 4), at_cuts=at_cuts, compensate_illumination=False
    )
    frames, summary = run(regular(6), ByFactor(Fraction(4)), interpolator=interpolator)
    assert summary.scene_cuts == 2
    assert summary.frames_made == 6 * 3
    assert estimator.pairs == 3
    values = [int(frame.image[0, 0, 0]) for frame in frames[4:9]]
    assert values in ([[10, 10, 10, 20, 20]] if at_cuts == "repeat" else [[10, 12, 15, 18, 20], [10, 13, 15, 17, 20]])


@pytest.mark.parametrize("method", ["nlm", "nlm-exhaustive"])
def test_nothing_depends_on_more_than_the_neighbouring_pairs(method):
    """A clip that starts later or ends earlier is the same but in the pair at its new end, whose neighbour is gone."""
    at = accelerating(48, 64, velocity=(2, 1), acceleration=(0.4, -0.2))
    source = [Frame(at(k), Fraction(k, 25), Fraction(1, 25)) for k in range(7)]
    interpolator = replace(methods[method], cuts=None)
    whole, _ = run(source, ByFactor(Fraction(3)), interpolator=interpolator)
    part, _ = run(source[2:6], ByFactor(Fraction(3)), interpolator=interpolator)
    by_time = {frame.time: frame.image for frame in whole}
    inner = [frame for frame in part if Fraction(3, 25) <= frame.time <= Fraction(4, 25)]
    assert len(inner) == 4
    for frame in inner:
        np.testing.assert_array_equal(frame.image, by_time[frame.time])


def test_a_named_gap_is_no_cut_and_a_cut_in_a_long_interval_is_named():
    """Whatever the frames around a gap look like; elsewhere, the remark says where the cut is, and what to do."""
    one, other = (noise(60, 80, seed=seed) for seed in (1, 2))
    times = [Fraction(number, 25) for number in (0, 1, 2, 7, 8)]
    shown = [Frame(image, time) for image, time in zip((one, one, one, other, other), times, strict=True)]
    named = [*shown[:3], replace(shown[3], ends_gap=True), shown[4]]
    detecting = replace(BLEND, cuts=CutDetector())
    options: dict[str, Any] = {"holds": False, "duplicates": None}
    made, summary = run(shown, ByRate(Fraction(25)), interpolator=detecting, **options)
    assert summary.scene_cuts == 1
    assert summary.remarks[0] == (
        "A scene seems to end between 0:00.080 and 0:00.280, so that no motion is followed there; if it goes on, use "
        "`no_cuts`."
    )
    filled, summary = run(named, ByRate(Fraction(25)), interpolator=detecting, **options)
    assert (summary.scene_cuts, len(summary.remarks)) == (0, 2)
    np.testing.assert_array_equal(made[3].image, one)
    np.testing.assert_allclose(filled[3].image, 0.8 * one + 0.2 * other, atol=0.51)
    listed = replace(detecting, cuts=CutsWhere(lambda image0, image1: (image0.image != image1.image).any()))
    assert run(named, ByRate(Fraction(25)), interpolator=listed, **options)[1].scene_cuts == 1


def test_the_loop_follows_curved_paths():
    """Each pair is made with the pairs before and after it, bit by bit as by hand, unequal intervals and ends too."""
    at = accelerating(48, 64, velocity=(2, 1), acceleration=(1, -0.5))
    times = [Fraction(t, 25) for t in (0, 1, 3, 4, 5)]
    source = [Frame(at(float(t * 25)), t, b - t) for t, b in pairwise([*times, Fraction(6, 25)])]
    interpolator = replace(methods["nlm"], cuts=None)
    pairs = [interpolator.pair(*prepared(a.image, b.image), b.time - a.time) for a, b in pairwise(source)]
    frames, _ = run(source, ByFactor(Fraction(2)), holds=False, interpolator=interpolator)
    for pair, before, after, frame in zip(pairs, [None, *pairs], [*pairs[1:], None], frames[1::2], strict=False):
        ((expected, _),) = interpolator.images(pair.between(before, after), [0.5])
        np.testing.assert_array_equal(frame.image, expected)
    straight, _ = run(source, ByFactor(Fraction(2)), holds=False, interpolator=replace(interpolator, curved=False))
    assert all((a.image != b.image).any() for a, b in zip(straight[1::2], frames[1::2], strict=True))


class OnPurposeError(Exception):
    pass


@dataclass
class FailingSynthesizer:
    """Raises an error after so many images of the clip."""

    left: int
    error: BaseException

    def synthesize(self, frame_pair: Any, times: Any) -> Iterator[Any]:
        for image in Blend().synthesize(frame_pair, times):
            if self.left == 0:
                raise self.error
            self.left -= 1
            yield image


def failing(frames: list[Frame], error: BaseException) -> Iterator[Frame]:
    yield from frames
    raise error


@pytest.mark.parametrize("kind", [OnPurposeError, KeyboardInterrupt])
@pytest.mark.parametrize(
    ("where", "fail_at"),
    [
        *(("source", at) for at in (0, 1, 2, 15, 20)),
        *(("sink", at) for at in (0, 1, 20, 38, 39)),
        *(("interpolator", at) for at in (0, 7, 18)),
    ],
)
def test_an_error_surfaces(where, fail_at, kind):
    """The very error comes out of the loop, wherever it is, also after the last frame.

    What was written before is no more than what came before.
    """
    error = kind("on purpose")
    frames = failing(regular(fail_at), error) if where == "source" else regular(20)
    sink = FakeSink(fail_at=fail_at, error=error) if where == "sink" else FakeSink()
    synthesizer = FailingSynthesizer(fail_at, error) if where == "interpolator" else Blend()
    interpolator = Interpolator(ZeroMotion(), synthesizer, cuts=None, compensate_illumination=False)
    with pytest.raises(kind) as caught:
        run_conversion(FakeSource(frames), interpolator, sink, ByFactor(Fraction(2)))
    assert caught.value is error
    assert where != "sink" or len(sink.frames) == fail_at
    assert len(sink.frames) <= max(0, 2 * fail_at + 1)


LIT_BLEND = replace(BLEND, compensate_illumination=True)  # which keeps more of each frame


class Watching:
    """Writes down what an observer is told."""

    def __init__(self) -> None:
        self.events: list[Any] = []

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        self.events.append(("opened", info.name, expected_frames))

    def ready(self) -> None:
        self.events.append("ready")

    def wrote(self, summary: Summary) -> None:
        self.events.append(summary.frames_out)


@pytest.mark.parametrize("slow_side", ["source", "sink"])
@pytest.mark.parametrize("holds", [True, False], ids=["video", "images"])
@pytest.mark.parametrize(("duplicates", "limit"), [(None, 12), (DuplicateDetector(), 20)], ids=["keep", "interpolate"])
@pytest.mark.parametrize("threads", [1, 3])
def test_memory_does_not_grow(monkeypatch, slow_side, holds, duplicates, limit, threads):
    """Of 60 frames a dozen are alive at any time, one more for each thread, and in a slow fade a held picture's.

    Now and then one side waits for the other: the source until the sink has nothing left to write, or the sink until
    the source has no room left to read ahead.
    """
    alive: set[int] = set()
    most = 0
    waited, read = threading.Event(), threading.Event()
    readers: list[threading.Thread] = []

    class WatchedRoom(threading.Semaphore):
        def acquire(self, *arguments: Any, **options: Any) -> bool:
            has_room = super().acquire(blocking=False)
            if not has_room and slow_side == "sink" and threading.current_thread() in readers:
                waited.set()
            return has_room or super().acquire(*arguments, **options)

    class WatchedQueue(Queue):
        def get(self, *arguments: Any, **options: Any) -> Any:
            try:
                return super().get(*arguments, **options)
            except Empty:
                if slow_side == "source" and threading.current_thread().name == "fpsboost-write":
                    waited.set()
                raise

    def frames() -> Iterator[Frame]:
        nonlocal most
        readers.append(threading.current_thread())
        for index in range(60):
            image = np.full((*SIZE, 3), index, np.uint8)
            alive.add(index)
            weakref.finalize(image, alive.discard, index)
            most = max(most, len(alive))
            if slow_side == "source" and index % 8 == 7:
                waited.clear()
                assert waited.wait(60)
            yield Frame(image, Fraction(index, 25), Fraction(1, 25))
            del image
        read.set()
        waited.set()

    class ForgetfulSink(FakeSink):
        count = 0

        def write(self, frame: Frame) -> None:
            self.count += 1
            if slow_side == "sink" and self.count % 8 == 1:
                waited.clear()
                assert read.is_set() or waited.wait(60)

    monkeypatch.setattr("fpsboost.threads.Queue", WatchedQueue)
    monkeypatch.setattr("fpsboost.threads.Semaphore", WatchedRoom)
    source, sink = FakeSource(frames()), ForgetfulSink(holds)
    options = TimelineOptions(duplicates=duplicates)
    summary = run_conversion(source, LIT_BLEND, sink, ByFactor(Fraction(2)), options=options, threads=threads)
    assert summary.frames_in == 60
    assert most <= limit + threads
    assert not alive


@pytest.mark.slow
def test_the_number_of_threads_does_not_matter():
    """Pictures that move, are held, fade and are cut: the same frames and the same counts, bit by bit."""
    random = np.random.default_rng(1)
    scenes = [cv2.GaussianBlur(random.random((90, 140, 3), np.float32), (0, 0), 2) for _ in range(2)]
    pictures = [scenes[k // 6][10:58, 10 + 3 * (k % 6) : 74 + 3 * (k % 6)] * (1 - 0.05 * k) for k in range(11)]
    images = [np.rint(picture / picture.max() * 255).astype(np.uint8) for picture in pictures]
    order = [0, 1, 2, 2, 3, 3, 4, 5, 6, 7, 8, 9, 10]
    frames = [Frame(images[k], Fraction(n, 25), Fraction(1, 25)) for n, k in enumerate(order)]
    results = []
    for threads in (1, 2, 5):
        sink = FakeSink()
        summary = run_conversion(FakeSource(frames), methods["nlm"], sink, ByFactor(Fraction(5)), threads=threads)
        results.append((sink.frames, replace(summary, seconds=0)))
    for made, counts in results[1:]:
        assert counts == results[0][1]
        for frame, expected in zip(made, results[0][0], strict=True):
            assert (frame.time, frame.duration) == (expected.time, expected.duration)
            np.testing.assert_array_equal(frame.image, expected.image)
    assert results[0][1].scene_cuts == 1


def length_of(path: Path) -> Fraction:
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        return stream.duration * Fraction(stream.time_base)


def read(path: Path) -> Any:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def test_video_to_video(tmp_path, snapshot):
    """Twice the frames at exact times, originals bit by bit, the sound packet by packet, the same length."""
    clip = write_clip(tmp_path / "in.mp4", times=range(12), time_base=Fraction(1001, 24000), sound="aac")
    before = snapshot(tmp_path)
    observer = Watching()
    summary = convert(
        str(clip), str(tmp_path / "out.mp4"), method=BLEND, encoding=LOSSLESS, run=RunOptions(observer=observer)
    )
    assert (summary.frames_in, summary.frames_out, summary.frames_made, summary.remarks) == (12, 24, 12, [])
    assert observer.events == [("opened", str(clip), 24), "ready", *range(1, 25)]
    assert times_of(tmp_path / "out.mp4") == [k * Fraction(1001, 48000) for k in range(24)]
    assert length_of(tmp_path / "out.mp4") == length_of(clip) == 12 * Fraction(1001, 24000)
    assert packets_of(tmp_path / "out.mp4", "audio") == packets_of(clip, "audio")
    for original, kept in zip(pictures_of(clip), pictures_of(tmp_path / "out.mp4")[::2], strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(samples_of(original), samples_of(kept), strict=True))
    after = snapshot(tmp_path)
    del after["out.mp4"]
    assert after == before


def test_video_to_folder(tmp_path):
    """First to last frame as numbered images whose names sort; the decoded originals are exact."""
    clip = write_clip(tmp_path / "in.mp4", times=range(6), codec="ffv1", pixel_format="bgr0", container="matroska")
    summary = convert(str(clip), str(tmp_path / "out"), method=BLEND)
    names = sorted(os.listdir(tmp_path / "out"))
    assert summary.frames_out == len(names) == 11
    originals = [picture.to_ndarray(format="bgr24") for picture in pictures_of(clip)]
    for name, original in zip(names[::2], originals, strict=True):
        assert np.array_equal(read(tmp_path / "out" / name), original)
    mixed = [(a.astype(float) + b) / 2 for a, b in pairwise(originals)]
    for name, image in zip(names[1::2], mixed, strict=True):
        assert np.abs(read(tmp_path / "out" / name) - image).max() <= 0.5


@pytest.mark.parametrize("method", list(methods))
def test_every_method_converts(tmp_path, save_images, method):
    """Each named method makes images of the source's size and type, and the originals are exact."""
    images = save_images(tmp_path / "in", count=2, dtype=np.uint16)
    summary = convert(str(tmp_path / "in"), str(tmp_path / "out"), method=method)
    assert (summary.frames_out, summary.frames_made) == (3, 1)
    written = [read(path) for path in sorted((tmp_path / "out").iterdir())]
    assert all((image.shape, image.dtype) == (images[0].shape, images[0].dtype) for image in written)
    assert np.array_equal(written[0], images[0])
    assert np.array_equal(written[2], images[1])
