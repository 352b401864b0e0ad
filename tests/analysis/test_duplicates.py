"""Frames shown again: found up to the noise of an encoder, interpolated across, and left alone where nothing moves."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost import ByFactor, ByRate, Frame, Schedule, Summary, methods, run_conversion
from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame, find_pictures, group_duplicates
from fpsboost.io.opening import open_source
from fpsboost.motion.rendered import RenderedMotion
from fpsboost.synthesis.blend import Blend
from fpsboost.synthesis.scene_assisted import SceneAssisted
from fpsboost.timeline import TimelineOptions
from support.held_frames import CADENCES, HEIGHT, RATE, SPEED, WIDTH, encode, held, pan
from support.memory_frames import FakeSink, FakeSource
from support.truth import affine, as_type, equal_luma, frozen, noise, prepared
from support.video_truth import planar

DOUBLE = ByFactor(Fraction(2))


def run(
    frames: list[Frame],
    schedule: Schedule = DOUBLE,
    method: Any = methods["nlm"],
    duplicates: DuplicateDetector | None = DuplicateDetector(),
) -> tuple[list[Frame], Summary]:
    sink = FakeSink()
    options = TimelineOptions(duplicates=duplicates)
    return sink.frames, run_conversion(FakeSource(frames, RATE), method, sink, schedule, options=options)


def lengths(frames: Sequence[Frame]) -> list[int]:
    """How many frames each held picture consists of."""
    shown = map(SourceFrame, frames)
    return [len(each) for each in group_duplicates(shown, DuplicateDetector())]


def error(image: Any, truth: Any) -> float:
    """Mean difference in levels, without the edges, where a pan brings in what nobody has seen."""
    return float(np.abs(image[8:-8, 12:-12].astype(float) - truth[8:-8, 12:-12]).mean())


@pytest.mark.parametrize("schedule", [DOUBLE, ByRate(Fraction(60)), ByFactor(Fraction(1))], ids=str)
@pytest.mark.parametrize("cadence", CADENCES)
def test_held_frames_become_an_even_motion(cadence, schedule):
    """Every output frame, those at the times of duplicates too, shows what was there at its very time."""
    source = held(CADENCES[cadence])
    frames, summary = run(source, schedule)
    assert summary.duplicates == len(source) - 1 - len(CADENCES[cadence])
    for frame in frames:
        position = min(frame.time * RATE, len(source) - 1)
        assert error(frame.image, pan(SPEED * float(position))) < 2


@pytest.mark.parametrize("schedule", [DOUBLE, ByFactor(Fraction(5, 2)), ByRate(Fraction(60))], ids=str)
def test_number_and_times_stay(schedule):
    """As many frames at the same times as without looking for duplicates, and the clip is as long."""
    source = held(CADENCES["threes"])
    frames, summary = run(source, schedule)
    plain, plain_summary = run(source, schedule, duplicates=None)
    assert [(frame.time, frame.duration) for frame in frames] == [(frame.time, frame.duration) for frame in plain]
    counts = summary.frames_in, summary.frames_out, 0
    assert counts == (plain_summary.frames_in, plain_summary.frames_out, plain_summary.duplicates)


def test_uneven_times_keep_their_rhythm():
    """Where the source's intervals differ, its clock says how far a picture has moved."""
    ticks = [0, 1, 4, 5, 8, 10]  # a picture from 0 to 4, one from 4 to 8, and 8 and 10
    images = [pan(SPEED * tick) for tick in (0, 0, 4, 4, 8, 10)]
    times = [tick / RATE for tick in ticks]
    source = [
        Frame(image, time, b - time) for image, time, b in zip(images, times, [*times[1:], 11 / RATE], strict=True)
    ]
    frames, summary = run(source)
    assert summary.duplicates == 2
    assert [frame.time * RATE for frame in frames[:4]] == [0, Fraction(1, 2), 1, Fraction(5, 2)]
    for frame in frames[:-1]:
        assert error(frame.image, pan(SPEED * float(frame.time * RATE))) < 2


@pytest.mark.parametrize("method", ["nlm", "blend"])
def test_a_clip_without_duplicates_is_the_same_either_way(method):
    """Bit by bit."""
    source = held([1] * 5)
    frames, summary = run(source, method=methods[method])
    plain, _ = run(source, method=methods[method], duplicates=None)
    assert summary.duplicates == 0
    for one, other in zip(frames, plain, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
        assert one.original is other.original


@pytest.mark.parametrize(("source", "until"), [(held([1, 1, 12, 1, 1]), 26), (held([1, 1, 3])[:-1], 8)])
def test_a_still_is_left_alone(source, until):
    """What stands for longer than a quarter of a second, or until the clip ends, passes frame by frame."""
    frames, summary = run(source)
    assert summary.duplicates == 0
    assert [frame.original for frame in frames[::2]] == [frame.original for frame in source]
    for frame in frames[4:until]:
        assert np.abs(frame.image.astype(int) - source[2].image).max() <= 1


def test_what_ends_in_a_cut_stays_held():
    """Nothing is interpolated across a cut, also from the first frame of a held picture."""
    source = held([2, 2, 3, 2, 2], lambda first: pan(SPEED * first, seed=1 if first < 7 else 2))
    frames, summary = run(source)
    before = [frame for frame in frames if Fraction(4) <= frame.time * RATE < Fraction(13, 2)]
    assert (summary.scene_cuts, summary.duplicates, len(before)) == (1, 4, 5)
    np.testing.assert_array_equal([frame.image for frame in before], [source[4].image] * 5)
    assert [frame.original for frame in before[::2]] == [frame.original for frame in source[4:7]]
    np.testing.assert_array_equal(frames[14].image, source[7].image)


def test_rendered_motion_needs_every_frame(monkeypatch):
    """A renderer's vectors lead from each frame to the very next, so there duplicates are not looked for."""
    no_vectors: Any = SimpleNamespace(step=1, remarks=[], has=len, for_image=len)
    rendered = replace(methods["blend"], synthesizer=SceneAssisted(no_vectors))
    assert rendered.needs_every_frame
    assert replace(methods["blend"], estimator=RenderedMotion(no_vectors)).needs_every_frame
    assert not any(method.needs_every_frame for method in methods.values())
    monkeypatch.setattr(SceneAssisted, "synthesize", lambda self, *arguments: Blend().synthesize(*arguments))
    assert run(held([2, 2]), method=rendered)[1].duplicates == 0


@pytest.mark.parametrize("cadence", [[2, 2, 2], [3, 3, 3], [4, 4], [1, 1, 2, 1], [6, 1], [3, 2, 3, 2]])
def test_frames_are_found_however_long_they_are_held(cadence):
    """Twos, threes, fours and what a capture missed."""
    assert lengths(held(cadence)) == [*cadence, 1]


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (4, np.uint8), (3, np.uint16), (3, np.float32)])
def test_images_of_every_kind(channels, dtype):
    """Gray, with alpha, deep and float, noise of half a level included; and motion is none of them."""
    clip = affine(HEIGHT, WIDTH, shift=(2, 0), channels=channels, dtype=dtype)
    assert DuplicateDetector().difference(*prepared(clip.image0, clip.image0)) == 0
    assert 5 < DuplicateDetector().difference(*clip.prepared) < 100


@pytest.mark.parametrize(
    "form",
    [
        *(partial(as_type, dtype=dtype) for dtype in (np.uint8, np.uint16, np.float32)),
        *(lambda image, name=name: planar(as_type(image, np.uint8), name) for name in ("yuv420p", "yuv444p10le")),
        lambda image: as_type(np.dstack([0 * image, image[..., :1]]), np.uint8),
    ],
    ids=["8-bit", "16-bit", "float", "4:2:0", "10-bit", "alpha"],
)
def test_colour_alone_tells_frames_apart(form):
    """Red and green, azure and orange, or alpha alone: frames that are the same in gray are no duplicates."""
    detector, plain = DuplicateDetector(), np.ones((HEIGHT, WIDTH))
    for blue, red in ((-0.25, 0.25), (-0.2, -0.2)):
        images = prepared(*(form(equal_luma(sign * blue * plain, sign * red * plain)) for sign in (-1, 1)))
        frames = [SourceFrame(Frame(image.pixels, k / RATE)) for k, image in enumerate(images * 3)]
        assert [len(each) for each in group_duplicates(frames, detector)] == [1] * 6
        assert detector.difference(*images) > detector.noise
        assert detector.difference(images[0], images[0]) == 0


@given(
    size=st.tuples(st.integers(1, 300), st.integers(1, 40)),
    block=st.integers(1, 16),
    share=st.sampled_from([0, 0.25]),
    seed=st.integers(0, 2**32 - 1),
)
def test_differences_are_those_of_whole_frames(size, block, share, seed):
    """Bands miss no block, and none is left out unless the limit is passed."""
    random = np.random.default_rng(seed)
    image0, image1 = random.integers(0, 256, (2, *size, 1), dtype=np.uint8)
    changed = np.zeros(size, bool)
    row, column = random.integers(size)
    changed[row : row + block, column : column + 4] = True
    image1 = np.where(changed[..., None], image1, image0)
    sums = cv2.boxFilter(cv2.absdiff(image0, image1), cv2.CV_32S, (block, block), normalize=False)
    detector = DuplicateDetector(share=share, block=block)
    found, whole = detector.difference(*prepared(image0, image1)), float(sums.max()) / block**2
    assert found == whole or detector.difference_limit < found < whole


@pytest.mark.parametrize("size", [2, 4, 8])
def test_a_small_thing_that_moves_is_no_duplicate(size):
    """In a large picture that stands still, something of a few pixels moves along."""
    ground = pan(0)

    def picture(time: float) -> Any:
        image = ground.copy()
        left = 10 + size * int(time)
        image[30 : 30 + size, left : left + size] = 255 - image[30 : 30 + size, left : left + size] // 2
        return frozen(image)

    assert lengths(held([1] * 8, picture)) == [1] * 9


@pytest.mark.parametrize("levels", [0.3, 1, 2, 4])
def test_a_slow_fade_is_no_duplicate(levels):
    """Every frame differs a little, by less than an encoder's noise, and it adds up."""
    frames = held([1] * 20, lambda time: np.rint(pan(0) * 0.5 + levels * time).astype(np.uint8))
    assert lengths(frames) == [1] * 21


@pytest.mark.parametrize("crf", [18, 28])
@pytest.mark.parametrize("cadence", CADENCES)
def test_encoded_duplicates_are_found(tmp_path, cadence, crf):
    """Repeated frames are not the same any more after encoding, and are found all the same."""
    grain = noise(HEIGHT, WIDTH, seed=5).astype(float) - 127.5

    def picture(time: float) -> Any:
        return (pan(SPEED * time) + 0.06 * np.roll(grain, int(7 * time), axis=1)).clip(0, 255).astype(np.uint8)

    source = held(CADENCES[cadence], picture)
    clip = encode(tmp_path / "clip.mp4", [frame.image for frame in source], crf)
    with open_source(str(clip)) as opened:
        frames = list(opened)
    assert any((a.image != b.image).any() for a, b in pairwise(frames))
    assert lengths(frames) == [*CADENCES[cadence], 1]


def repeats(frames: Sequence[Frame]) -> list[tuple[int, bool, int]]:
    """Of each picture: how many frames are told together, whether it is a still, and how many repeat another."""
    shown = map(SourceFrame, frames)
    return [(len(each.frames), each.is_still, each.repeats) for each in find_pictures(shown, DuplicateDetector())]


def test_every_repeat_is_told_in_stills_too() -> None:
    """Of a picture held between moves all frames but the first; of a still, told in pieces, as well."""
    found = repeats(held([1, 2, 1, 12, 1, 3]))
    assert found[:3] == [(1, False, 0), (2, False, 1), (1, False, 0)]
    assert sum(count for count, _, _ in found) == 21
    assert sum(again for *_, again in found) == 1 + 11 + 2
    assert [again for _, is_still, again in found if is_still][-1] == 0  # the clip's last frame, which is a new one


def test_frames_that_move_slowly_to_the_end_repeat_nothing() -> None:
    """They are as much alike as an encoder's repeats, but so were those before."""
    frames = held([1] * 12, lambda time: pan(0.3 * time))
    assert sum(again for *_, again in repeats(frames)) == 0
