"""Motion blur by a shutter: as wide as the motion, in linear light, and without a change of any time."""

from dataclasses import replace
from fractions import Fraction

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost import (
    Frame,
    OptionError,
    OutputRange,
    RunOptions,
    Timing,
    VectorFolder,
    convert,
    find_method,
    methods,
    run_conversion,
)
from fpsboost.synthesis.exposure import Exposure
from fpsboost.timeline import TimelineOptions
from fpsboost.timing.schedule import ByFactor, ByRate
from fpsboost.timing.shutter import Shutter
from support.memory_frames import BLEND, FAST, FakeSink, FakeSource
from support.truth import SCENES, as_type, needs_scenes, waves
from support.video_truth import packets_of, pictures_of, write_clip

SIZE = 48, 96
HALF = Shutter(Fraction(180), 5)


def shown(levels, seconds=Fraction(1, 25)):
    """Flat float frames of these levels, one after another."""
    return [
        Frame(np.full((*SIZE, 3), level, np.float32), k * seconds, seconds, original=object())
        for k, level in enumerate(levels)
    ]


def exposed(frames, schedule, shutter, interpolator=BLEND, skip=0, threads=2, holds_last_frame=True):
    """The output frames and the summary of a conversion."""
    sink = FakeSink()
    sink.holds_last_frame = holds_last_frame
    summary = run_conversion(
        FakeSource(frames),
        interpolator,
        sink,
        replace(schedule, shutter=shutter),
        outputs=OutputRange(skip=skip),
        threads=threads,
        options=TimelineOptions(duplicates=None),
    )
    return sink.frames, summary


@pytest.mark.parametrize("holds_last_frame", [True, False])
@pytest.mark.parametrize("schedule", [ByFactor(Fraction(1)), ByFactor(Fraction(5, 2)), ByRate(Fraction(60))])
@pytest.mark.parametrize("shutter", [HALF, Shutter(Fraction(360), 7)])
def test_frames_and_times_are_those_without(schedule, shutter, holds_last_frame):
    """A shutter changes what frames show, and neither their number, nor their times and durations."""
    frames = shown(np.linspace(0, 1, 7))
    blurred, summary = exposed(frames, schedule, shutter, holds_last_frame=holds_last_frame)
    plain, _ = exposed(frames, schedule, None, holds_last_frame=holds_last_frame)
    assert [(each.time, each.duration) for each in blurred] == [(each.time, each.duration) for each in plain]
    assert summary.frames_out == summary.frames_made == len(plain)
    assert all(each.original is None for each in blurred[1:-1])


@pytest.mark.slow
@settings(max_examples=12)
@given(
    levels=st.lists(st.floats(0, 1, width=16), min_size=3, max_size=6),
    factor=st.fractions(1, 4, max_denominator=3),
    angle=st.integers(1, 360),
)
def test_each_frame_is_the_mean_around_its_time(levels, factor, angle):
    """Of what plain mixing shows at the samples' times, those before the first frame left out."""
    shutter = Shutter(Fraction(angle), 5)
    frames, _ = exposed(shown(levels), ByFactor(factor), shutter, holds_last_frame=False)
    for k, frame in enumerate(frames):
        places = [(k + offset) / factor for offset in shutter.offsets]
        values = [np.interp(float(each), range(len(levels)), levels) for each in places if 0 <= each <= len(levels) - 1]
        if places[-1] < len(levels) - 1:  # the last frame is held as long as its exposure lasts
            assert frame.array[0, 0, 0] == pytest.approx(np.mean(values), abs=1e-5)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_still_picture_stays_as_it_is(dtype):
    """The mean of one picture is the picture, to the level."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    image = as_type(waves(x, y, 4, 1), dtype).copy()
    image[:8, :8, 3] = 0
    exposure = Exposure()
    for _ in range(15):
        exposure.add(image)
    if dtype == np.float32:
        assert np.allclose(exposure.image(), image, atol=1e-6)
    else:
        assert (exposure.image() == image).all()


@pytest.mark.parametrize(
    ("colours", "expected"),
    [([[0], [255]], [188]), ([[200, 200, 200, 255], [0, 0, 0, 0]], [200, 200, 200, 128])],
    ids=["gray", "transparent"],
)
def test_light_is_added_and_not_levels(colours, expected):
    """Black and white for half of the time each are half the light of white, which sRGB stores as 188; not 128.

    What a moving object with alpha leaves free shows nothing of the colour below it.
    """
    exposure = Exposure()
    for colour in colours:
        exposure.add(np.array([[colour]], np.uint8))
    assert exposure.image()[0, 0].tolist() == expected


def step_edge(position):
    """Dark on the left of a vertical edge, bright on the right, in linear light; the edge falls between pixels too."""
    x = np.arange(SIZE[1])
    bright = (x + 1 - position).clip(0, 1)
    return np.broadcast_to((0.1 + 0.8 * bright)[None, :, None], (*SIZE, 3)).astype(np.float32)


@pytest.mark.parametrize(("angle", "samples"), [(90, 9), (180, 17), (360, 33)])
def test_a_moving_edge_is_as_wide_as_the_shutter_times_its_motion(angle, samples):
    """16 pixels per frame at 180 degrees are a ramp of 8 pixels, centred where the sharp edge is."""
    speed, textured = 16, np.random.default_rng(1).uniform(0, 0.05, (SIZE[0], 1, 1)).astype(np.float32)
    frames = [Frame(step_edge(20 + speed * k) + textured, Fraction(k, 25), Fraction(1, 25)) for k in range(4)]
    interpolator = replace(methods["nlm"], cuts=None, compensate_illumination=False)
    made, _ = exposed(frames, ByFactor(Fraction(1)), Shutter(Fraction(angle), samples), interpolator)
    row = ((made[1].array - textured)[SIZE[0] // 2, :, 1] - 0.1) / 0.8
    width = speed * angle / 360
    x = np.arange(SIZE[1])
    truth = ((x + 0.5 - (36 - width / 2)) / width).clip(0, 1)
    assert np.abs(row - truth).max() < 0.12
    # a ramp's variance tells its width
    weights = np.diff(row).clip(0, None)
    centre = np.average(x[1:], weights=weights)
    assert np.sqrt(12 * np.average((x[1:] - centre) ** 2, weights=weights)) == pytest.approx(width, rel=0.15, abs=0.5)
    assert centre == pytest.approx(36, abs=0.6)


@pytest.mark.slow
def test_nothing_is_blurred_across_a_cut():
    """Samples of another scene are left out, on both sides of the cut."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    scenes = [as_type(waves(x, y, 3, seed), np.uint8) for seed in (1, 9)]
    frames = [Frame(scenes[k >= 4], Fraction(k, 25), Fraction(1, 25)) for k in range(8)]
    for factor in (1, 2, 3):
        made, summary = exposed(frames, ByFactor(Fraction(factor)), Shutter(Fraction(360), 7), methods["blend"])
        assert summary.scene_cuts == 1
        assert all(any((each.array == scene).all() for scene in scenes) for each in made)


def test_a_pause_is_held():
    """Across a pause nothing moves, and nothing is blurred."""
    frames = shown([0, 0.5, 1])
    late = [replace(each, time=each.time + 5 * (k > 1)) for k, each in enumerate(frames)]
    schedule = ByRate.forgiving(Fraction(25), Fraction(25), Fraction(1, 1000))
    blurred, plain = (exposed(late, schedule, shutter)[0] for shutter in (HALF, None))
    assert [each.time for each in blurred] == [each.time for each in plain]
    assert all(each.array[0, 0, 0] == 0.5 for each in blurred[2:-1])


@pytest.mark.parametrize("skip", [1, 3, 6])
def test_a_run_that_goes_on_makes_the_same_frames(skip):
    """What an earlier run has finished is not made again, and the rest is the same with any number of threads."""
    frames = shown([0, 0.3, 0.1, 0.9, 0.5, 1])
    whole, _ = exposed(frames, ByFactor(Fraction(3, 2)), HALF, threads=1)
    rest, _ = exposed(frames, ByFactor(Fraction(3, 2)), HALF, skip=skip, threads=3)
    assert len(whole) == len(rest)
    assert all((one.array == other.array).all() for one, other in zip(whole[skip:], rest[skip:], strict=True))


@pytest.mark.parametrize(("angle", "samples"), [(0, 5), (361, 5), (180, 4), (180, 1), (180, 101), (None, 5)])
def test_a_shutter_has_limits(angle, samples):
    """The angle lies in a turn, and the number of samples, which says nothing without it, is odd."""
    with pytest.raises(OptionError, match="shutter"):
        Timing(shutter=angle, shutter_samples=samples)


def test_images_are_blurred_at_their_own_rate(tmp_path):
    """With a factor of 1 it is motion blur alone: one image for each, the source's own among them."""
    (tmp_path / "in").mkdir()
    for k in range(4):
        cv2.imwrite(str(tmp_path / "in" / f"{k:04d}.png"), as_type(step_edge(20 + 8 * k), np.uint8))
    convert(str(tmp_path / "in"), str(tmp_path / "out"), timing=Timing(1, shutter=180, shutter_samples=5))
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [f"{k:04d}.png" for k in range(4)]
    sharp, blurred = (cv2.imread(str(tmp_path / folder / "0001.png")).astype(int) for folder in ("in", "out"))
    assert len(np.unique(blurred[24])) > len(np.unique(sharp[24]))


def test_a_video_keeps_its_sound_and_its_length(tmp_path):
    """Blurred pictures have the times of the others, and the sound is copied."""
    clip = write_clip(tmp_path / "in.mp4", times=range(6), time_base=Fraction(1001, 24000), sound="aac")
    outputs = [tmp_path / name for name in ("blurred.mp4", "plain.mp4")]
    for output, shutter in zip(outputs, (Fraction(180), None), strict=True):
        timing = Timing(2, shutter=shutter, shutter_samples=3 if shutter else 15)
        convert(str(clip), str(output), timing=timing, method="blend", encoding=FAST)
    blurred, plain = outputs
    assert packets_of(blurred, "audio") == packets_of(plain, "audio")
    assert [each.pts for each in pictures_of(blurred)] == [each.pts for each in pictures_of(plain)]


def test_originals_in_place_cannot_be_blurred(tmp_path):
    """They are never changed, so that half of the frames would be sharp."""
    with pytest.raises(OptionError, match="in_place"):
        convert(str(tmp_path), timing=Timing(shutter=180), run=RunOptions(in_place=True))


@needs_scenes
def test_vectors_say_nothing_of_times_between_frames():
    """They were rendered for the output frames, and samples lie between those."""
    method = find_method("nlm", VectorFolder(str(SCENES / "texture" / "vectors")))
    with pytest.raises(OptionError, match="vectors"):
        convert(str(SCENES / "texture"), "out", method=method, timing=Timing(shutter=180))
