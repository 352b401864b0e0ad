"""Repair: damaged frames are interpolated from good ones, all others are untouched; and single ones are detected."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise

import cv2
import numpy as np
import pytest

from fpsboost import (
    ByFactor,
    Encoding,
    Frame,
    InputError,
    OptionError,
    OutputRange,
    Replacement,
    Timing,
    YCbCrImage,
    convert,
    methods,
    run_conversion,
)
from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.parts.entry import find_entry
from fpsboost.parts.plan import REPLACED_BEFORE
from fpsboost.probing import probe
from fpsboost.repair import find_damaged
from fpsboost.timeline import TimelineOptions
from support.conversion_options import grouped
from support.memory_frames import BLEND, FAST, FakeSink, FakeSource
from support.truth import frozen
from support.video_truth import bytes_of, pictures_of, write_clip

RATE = Fraction(25)
SAME = ByFactor(Fraction(1))


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("3-5, 9f", [3, 4, 5, 9]),
        ("0:00.2,auto", [5]),  # 5 is shown from then on
        ("0.19-0.281", [4, 5, 6, 7]),
        ("1.0,38-0:01.56", [25, 38, 39]),
    ],
)
def test_frames_are_listed_by_numbers_and_times(tmp_path, text, numbers):
    """Inline or in a file with comments; as the words of a command line, the list means the same."""
    found = Replacement.parse(text)
    assert [each for each in range(40) if found.times_listed(each, each / RATE, (each + 1) / RATE)] == numbers
    assert Replacement.parse(found.as_option()) == found
    (tmp_path / "list.txt").write_text("\ufeff" + text.replace(",", "\n") + "  # so\n")
    assert Replacement.parse(str(tmp_path / "list.txt")) == found


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0-2", "frame 0 is the first"),
        ("5-3", "ends before"),
        ("5-13", "9 frames in a row .* at most 8"),
        ("x", "contains no"),
    ],
)
def test_wrong_lists_are_refused(text, says):
    """In one sentence that says how to write it."""
    with pytest.raises(OptionError, match=f"`replace` .*{says}"):
        Replacement.parse(text)


def frames_at(ticks: list[int]) -> list[Frame]:
    """One flat frame per time, 1000 ticks a second, as bright as its time."""
    return [
        Frame(frozen(np.full((8, 12, 3), tick // 4, np.uint8)), Fraction(tick, 1000), original=object())
        for tick in ticks
    ]


def repaired(frames, text, *, interpolator=BLEND, outputs=OutputRange(), start=0):
    """Return the frames that come out, and the summary."""
    sink, source = FakeSink(), FakeSource(frames[start:])
    options = TimelineOptions(replacement=Replacement.parse(text))
    summary = run_conversion(source, interpolator, sink, SAME, options=options, threads=1, outputs=outputs)
    return sink.frames, summary


def test_listed_frames_are_interpolated_at_their_own_times():
    """Between the good ones around them, wherever the clock puts them; all others pass as the decoder's own."""
    frames = frames_at([0, 40, 100, 110, 200, 240, 300, 340])
    frames[2:4] = [replace(frame, image=frozen(np.zeros((8, 12, 3), np.uint8))) for frame in frames[2:4]]
    found, summary = repaired(frames, "2-3,6")
    assert [frame.time for frame in found] == [frame.time for frame in frames]
    assert [int(frame.array.mean()) for frame in found] == [0, 10, 25, 28, 50, 60, 75, 85]  # half a level is rounded
    same = [a.original is b.original for a, b in zip(found, frames, strict=True)]
    assert [number for number, is_same in enumerate(same) if not is_same] == [2, 3, 6]
    assert (summary.replaced, summary.frames_made, summary.duplicates) == ([2, 3, 6], 3, 0)


def test_the_ends_of_a_clip_are_kept():
    """They have no good frame on one side, which is said, as are frames that are not there; no run is too long."""
    found, summary = repaired(frames_at([0, 40, 80, 120]), "0.001,3,7-8")
    assert [frame.array[0, 0, 0] for frame in found] == [0, 10, 20, 30]
    assert not summary.replaced
    for number, said in enumerate(["Frame 0 has no", "No good frame comes after 3", "The last frame is 3"]):
        assert summary.remarks[number].startswith(said)
    with pytest.raises(InputError, match="more frames in a row up to 9, and at most 8"):
        repaired(frames_at(list(range(0, 800, 40))), "0.04-2.0")


def texture(seed: int, shift: int) -> np.ndarray:
    """A texture moved by some pixels; the seed is the scene."""
    coarse = np.random.default_rng(seed).integers(0, 256, (9, 16, 3), dtype=np.uint8)
    return np.roll(cv2.resize(coarse, (160, 90), interpolation=cv2.INTER_CUBIC), shift, axis=1)


def exchanged(image: np.ndarray) -> np.ndarray:
    """The image with both colour differences exchanged: orange becomes azure, and gray stays."""
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)[..., [0, 2, 1]], cv2.COLOR_YCrCb2BGR)


DAMAGE = {
    "flash": lambda image: np.clip(image.astype(int) + 120, 0, 255).astype(np.uint8),
    "dropout": lambda image: np.vstack([image[:50], np.full_like(image[50:70], 128), image[70:]]),
    "black": np.zeros_like,
    "field": lambda image: np.stack([image[::2], np.roll(image[1::2], 40, axis=1)], axis=1).reshape(image.shape),
    "colours": lambda image: np.vstack([image[:40], exchanged(image[40:75]), image[75:]]),
    "tear": lambda image: np.vstack([image[:60], np.roll(image[60:], 50, axis=1)]),
}


def detected(images: list[np.ndarray]) -> list[int]:
    """Return the numbers of the images that are taken for damaged."""
    shown = (SourceFrame(Frame(image, Fraction(0))) for image in images)
    return [number for number, (_, is_damaged) in enumerate(find_damaged(shown)) if is_damaged]


@pytest.mark.parametrize("kind", DAMAGE)
def test_single_damaged_frames_are_detected(kind):
    """In motion, with nothing else beside them."""
    images = [texture(1, 4 * number) for number in range(8)]
    images[4] = DAMAGE[kind](images[4])
    assert detected(images) == [4]


@pytest.mark.parametrize(("step", "scene"), [(25, 99), (3, 3), (0, 1)], ids=["fast motion", "cuts", "other pictures"])
def test_nothing_else_is_taken_for_damaged(step, scene):
    """What films have: a neighbour explains each frame of these, or nothing explains any."""
    assert not detected([texture(1 + number // scene, step * number) for number in range(9)])


@pytest.mark.slow
def test_parts_are_the_same():
    """Wherever reading begins, a list and detection give the frames of one run; damage meets the ends of parts."""
    images = [texture(1 + number // 50, 3 * number) for number in range(70)]
    for number in (24, 30, 33, 49, 51):
        images[number] = DAMAGE["black"](images[number])
    frames = [Frame(frozen(image), number / RATE, original=object()) for number, image in enumerate(images)]
    times = [frame.time for frame in frames]
    options = {"text": "auto,35-42,44-47", "interpolator": methods["blend"]}

    @contextmanager
    def unread(number: int) -> Iterator[Iterator[Frame]]:
        raise AssertionError(number)
        yield

    whole, summary = repaired(frames, **options)
    assert summary.replaced == [24, 30, 33, *range(35, 43), *range(44, 48)]
    found, replaced = list[Frame](), list[int]()
    for first, stop in pairwise([0, 30, 33, 38, 47, 60, None]):
        entry = find_entry(times, SAME, None, first, unread, REPLACED_BEFORE) if first else None
        start = entry.number if entry else 0
        part, of_part = repaired(frames, **options, outputs=OutputRange(first, stop, entry=entry), start=start)
        found += part
        replaced += of_part.replaced
    assert replaced == summary.replaced
    facts = [[(each.time, each.original, each.array.tobytes()) for each in frames] for frames in (found, whole)]
    assert facts[0] == facts[1]


def test_good_frames_of_a_video_stay_bit_for_bit(tmp_path, monkeypatch):
    """Without loss, with the sound; with a factor, repair and conversion are one run; `probe` sees what they see."""
    clip = write_clip(tmp_path / "in.mkv", times=[0, 1, 2, 4, 5, 9, 10, 11], codec="ffv1", sound="aac")
    options = {"method": "blend", "encoding": Encoding(codec="ffv1")}
    convert(str(clip), str(tmp_path / "out.mkv"), **options, **grouped(replace="3,6"))
    before, after = pictures_of(clip), pictures_of(tmp_path / "out.mkv")
    assert [picture.time for picture in after] == [picture.time for picture in before]
    same = [bytes_of(a) == bytes_of(b) for a, b in zip(before, after, strict=True)]
    assert [number for number, is_same in enumerate(same) if not is_same] == [3, 6]
    options["encoding"] = FAST
    summary = convert(str(clip), str(tmp_path / "two.mp4"), **options, **grouped(factor=2, replace="3"))
    assert (summary.frames_out, summary.replaced) == (24, [3])
    spoilt = write_clip(
        tmp_path / "bad.mkv",
        picture=lambda index, *_: texture(1, 4 * index) if index != 5 else DAMAGE["black"](texture(1, 0)),
        size=(90, 160),
    )
    kinds = set()
    noted = partial(map, lambda each: kinds.add(type(each.frame.image)) or each)
    monkeypatch.setattr("fpsboost.probing.find_damaged", lambda frames: find_damaged(noted(frames)))
    assert (probe(str(spoilt)).damaged, kinds) == ([5], {YCbCrImage})


def test_good_images_are_passed_on(tmp_path, save_images):
    """As their files; the summary names the others, and the last one cannot be among them."""
    save_images(tmp_path / "in", count=7)
    options = partial(grouped, method="blend")
    summary = convert(str(tmp_path / "in"), str(tmp_path / "out"), **options(replace="2-3"))
    same = [path.read_bytes() == (tmp_path / "out" / path.name).read_bytes() for path in (tmp_path / "in").iterdir()]
    assert (sum(same), summary.replaced) == (5, [2, 3])
    Replacement(detect=True).check("replace", replace(FakeSource(frames_at([0])).info, frame_count=1))  # it names none
    with pytest.raises(OptionError, match=r"`replace` has 6, and the last frame of .* is 6; end"):
        convert(str(tmp_path / "in"), str(tmp_path / "late"), **options(replace="6"))
    info = replace(FakeSource(frames_at([0])).info, frame_count=7, duration=Fraction(7, 25))
    with pytest.raises(OptionError, match=r"`replace` has 2\.0, and the last frame of .* is 6; end"):
        Replacement.parse("2s").check("replace", info)
    with pytest.raises(OptionError, match="`fill_gaps` and `replace` cannot be combined"):
        Timing(fill_gaps=True, replace="3")
