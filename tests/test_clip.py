"""Whole clips of arrays: their types, orders and layouts, iterators; loops of arrays and of files."""

from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import count, islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from fpsboost import InputError, OptionError, Part, convert, find_method, interpolate_clip, stream
from fpsboost.evaluation.steadiness import StepMeter
from support.animation_truth import plays_of, read_animation, write_animation
from support.conversion_options import double
from support.truth import noise
from support.video_truth import scene, turntable, write_clip


class Tensor:
    """Tensor of another library, which offers nothing but DLPack."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.__dlpack__, self.__dlpack_device__ = array.__dlpack__, array.__dlpack_device__


@pytest.mark.parametrize(("kind", "white"), [("uint8", 255), ("uint16", 65535), ("float32", 1)])
@pytest.mark.parametrize("order", ["rgb", "bgr"])
@pytest.mark.parametrize("layout", ["nhwc", "nchw"])
@pytest.mark.parametrize("channels", [3, 4])
def test_frames_are_those_of_stream(kind, white, order, layout, channels):
    """To the bit, in the clip's own type, order and layout, with the times at which they are shown."""
    colours = np.stack([scene(3 * number) for number in range(4)])[..., [0, 1, 2, 0][:channels]]
    bgr = (colours * np.float32(white / 255)).astype(kind)
    places = [2, 1, 0, 3][:channels] if order == "rgb" else slice(None)
    axes = (0, 3, 1, 2) if layout == "nchw" else (0, 1, 2, 3)
    clip = bgr[..., places].transpose(axes)
    frames, times = interpolate_clip(clip, 16, 60, method="nlm-fast", order=order, layout=layout)
    wanted = np.stack(list(stream(list(bgr), fps=60, input_fps=16, method="nlm-fast")))[..., places].transpose(axes)
    assert frames.dtype == kind
    np.testing.assert_array_equal(frames, wanted)
    assert times == [Fraction(number, 60) for number in range(15)]
    lazy = zip(*interpolate_clip(iter(clip), 16, 60, method="nlm-fast", order=order, layout=layout), strict=True)
    np.testing.assert_array_equal(next(lazy), wanted)
    assert list(next(lazy)) == times


@pytest.mark.parametrize(
    "wrap",
    [
        *(Tensor, list, memoryview),
        lambda clip: list(map(Image.fromarray, clip)),
        lambda clip: pytest.importorskip("torch", reason="torch is not installed").from_numpy(clip),
    ],
)
def test_clips_may_be_arrays_of_any_kind(wrap: Callable[[Any], Any]):
    """Tensors, lists of arrays or of PIL's images, buffers; two frames for one unless a rate is given."""
    clip = turntable(4)
    frames, _ = interpolate_clip(wrap(clip), fps=24, method="blend")
    np.testing.assert_array_equal(frames, interpolate_clip(clip, 24, "48", method="blend")[0])
    assert len(frames) == 8


def test_an_iterator_is_read_as_frames_are_made():
    """One without an end; the clip's length is not told."""
    read, told = list[int](), list[tuple[int, int | None]]()

    def endless() -> Iterator[NDArray[np.uint8]]:
        for number in count():
            read.append(number)
            yield scene(number)

    made = interpolate_clip(
        endless(), 25, method="blend", duplicates="keep", loop=True, threads=1, progress=lambda *done: told.append(done)
    )
    assert read == []
    assert len(list(islice(made, 40))) == 40
    assert len(read) <= 20 + 12 + 10
    assert told == [(number, None) for number in range(1, 41)]
    made.close()


@pytest.mark.slow
@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize(("fps", "turn"), [(24, 3), (60, 6), (90, 4), (70, 0)])
def test_a_loop_has_no_first_frame(tmp_path, fps, turn, repeated):
    """Turned folders give the frames of the array in turned order, to the bit, with repeated pictures across the seam
    too; and so is the motion beside them. Of multiples that are not whole, the last step is shorter.
    """
    clip, motions = turntable(8).repeat(1 + repeated, axis=0), list[list[bytes]]()
    frames, times = interpolate_clip(clip, 24, fps, loop=True, order="bgr", method="nlm-fast")
    for source, first in ((tmp_path / "in", 0), (tmp_path / "turned", turn)):
        source.mkdir()
        for number, image in enumerate(np.roll(clip, -first, axis=0)):
            cv2.imwrite(str(source / f"{number:02}.png"), image)
        options = {"loop": True, "fps": fps, "input_fps": 24, "method": "nlm-fast"}
        summary = convert(source, source / "out", **options, save_motion=source / "motion")
        made = np.stack([cv2.imread(str(path)) for path in sorted((source / "out").glob("*.png"))])
        np.testing.assert_array_equal(made, np.roll(frames, -first * fps // 24, axis=0))
        motions.append([path.read_bytes() for path in sorted((source / "motion").glob("*.flo"))])
        assert (summary.frames_in, summary.frames_out) == (len(clip), len(times))
    assert len(motions[0]) == (0 if fps == 24 and not repeated else 16)
    assert repeated or motions[1] == motions[0][2 * turn :] + motions[0][: 2 * turn]


def test_a_gap_in_a_loop_is_no_cut(tmp_path):
    """Images that the user knows to be missing lie between two that differ, as without a loop."""
    (tmp_path / "in").mkdir()
    for number, image in {1: noise(48, 64), 2: noise(48, 64), 5: 255 - noise(48, 64), 6: 255 - noise(48, 64)}.items():
        cv2.imwrite(str(tmp_path / "in" / f"{number:02}.png"), image)
    summary = convert(tmp_path / "in", tmp_path / "out", loop=True, fill_gaps=True, method="nlm-fast")
    assert (summary.scene_cuts, summary.frames_made) == (0, 2)


@pytest.mark.parametrize("target", ["out.gif", "out.webp"])
@pytest.mark.parametrize("options", [{}, {"fps": 15}, {"keep_timing": True}, {"speed": "0.5@0-"}], ids=str)
def test_a_loop_lasts_as_long_as_its_source(tmp_path, target, options):
    """With delays that vary, and a rate of which no whole number of frames fits; what was shown once plays for ever."""
    delays = [80, 160] * 4
    write_animation(tmp_path / "in.gif", turntable(8), delays)
    convert(tmp_path / "in.gif", tmp_path / target, loop=True, method="nlm-fast", **options)
    length = sum(delay for _, delay in read_animation(tmp_path / target))
    assert length == pytest.approx(sum(delays) * (2 if "speed" in options else 1), abs=12)
    assert plays_of(tmp_path / target) == 0


@pytest.mark.parametrize("loop", [True, False])
def test_the_seam_of_a_loop_is_as_even_as_the_rest(tmp_path, loop):
    """By the steps of motion, in percent, against the turntable itself; without `loop` it stands still there. Frames of
    iterators are the same after the first interval, and end in time.
    """
    clip, meter = turntable(12), StepMeter()
    write_clip(tmp_path / "in.mkv", times=range(12), codec="ffv1", size=(48, 48), picture=lambda k, *_: clip[k])
    convert(tmp_path / "in.mkv", tmp_path / "out.apng", loop=loop, factor=4)
    frames = [image[..., :3] for image, _ in read_animation(tmp_path / "out.apng")]
    for number, image in enumerate(np.roll(frames, 20, axis=0), -20):  # the seam in the middle
        meter.add(np.roll(clip[0], number, axis=1), image, counts=number % 4 != 0)
    steps = meter.values()
    assert (max(steps[12:15]) < 1.2 * max(steps[:12] + steps[15:]) < 20) == loop
    eager, _ = interpolate_clip(clip, 24, factor=4, loop=loop)
    lazy = [frame for frame, _ in interpolate_clip(iter(clip), 24, factor=4, loop=loop)]
    np.testing.assert_array_equal(lazy[4:], eager[4:])


def test_nothing_is_made_across_the_cut_of_a_loop(tmp_path):
    """The last frame and the first of two scenes are repeated, each for half of the interval."""
    clip = [*map(scene, range(4)), *(scene(40 + 2 * number)[::-1, :, ::-1] for number in range(4))]
    summary = convert(write_animation(tmp_path / "in.apng", clip), tmp_path / "out.apng", loop=True, factor=4)
    seam = [image[..., :3] for image, _ in read_animation(tmp_path / "out.apng")[28:]]
    np.testing.assert_array_equal(seam, [clip[number] for number in (7, 7, 7, 0)])
    assert summary.scene_cuts == 2


@pytest.mark.parametrize(("end", "count", "seconds"), [("30f", 40, 20 / 25), ("9", 80, 3 - 10 / 25)])
def test_sound_of_a_loop_stays_and_is_said(tmp_path, end, count, seconds):
    """Of a part between two frames, that of this part; where the pictures end before, all; what it means is said."""
    write_clip(tmp_path / "in.mkv", times=range(50), sound="flac", sound_seconds=3)
    said = double(tmp_path / "in.mkv", tmp_path / "out.mkv", loop=True, start="10f", end=end)
    assert [remark for remark in said if f"does not become a loop; where it outlasts the {count} frames" in remark]
    with av.open(str(tmp_path / "out.mkv")) as file:
        assert sum(frame.samples for frame in file.decode(audio=0)) == pytest.approx(48000 * seconds, abs=4096)


@pytest.mark.parametrize(
    ("name", "options", "sentence"),
    [
        ("in.264", {}, r"`loop` reads .*in\.264 again from its beginning, and needs a file"),
        (
            "in.mkv",
            {"retime": "0=1s 1s=0"},
            r"`retime` that plays backwards and `loop` cannot be combined",
        ),
        ("in.mkv", {"start": "3"}, r".*in\.mkv has ended where `start=3 s` would be; name an earlier one"),
        (
            "in.mkv",
            {"replace": "2"},
            "`loop` and `replace` cannot be combined: a loop goes on beyond the frames that `replace` counts",
        ),
        (
            "in.mkv",
            {"chunk": Part(1, 2)},
            "`chunk` and `loop` cannot be combined",
        ),
    ],
)
def test_what_cannot_loop_is_refused(tmp_path, name, options, sentence):
    """Before anything is written, in a sentence that names the option."""
    source = write_clip(tmp_path / name, times=range(50))
    with pytest.raises((OptionError, InputError), match=rf"{sentence}.*\.$"):
        convert(source, tmp_path / "out.mp4", loop=True, **options)
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize(
    ("frames", "options", "error", "sentence"),
    [
        (turntable(4), {"factor": 2, "to_fps": 60}, OptionError, "`factor` and `to_fps` cannot be combined"),
        (turntable(4), {"fps": "0"}, OptionError, "`fps` and `to_fps` must be above 0"),
        (turntable(4), {"to_fps": "soon"}, OptionError, "`to_fps` 'soon' is not a number"),
        (turntable(4), {"order": "grb"}, OptionError, "`order` must be one of rgb, bgr"),
        (turntable(4), {"layout": "nchw"}, InputError, "`frames`, read as `layout=nchw`, must have the shape"),
        (turntable(4).astype(float), {}, InputError, "`frames`.*uint8, uint16 or float32, not float64"),
        (turntable(4)[:1], {}, InputError, "`frames` holds one frame"),
        ([], {"loop": True}, InputError, "`frames` gives no frame"),
        (iter([]), {"loop": True}, InputError, "`frames` gives no frame"),
        (turntable(4)[:, :0], {}, InputError, "`frames`.* must have the shape"),
        (5, {}, InputError, "`frames`.* must have the shape"),
        ("clip.mp4", {}, InputError, "`frames` are arrays, not the file clip.mp4; give it to"),
        ([Path("0.png")], {}, InputError, "`frames` are arrays, not the file 0.png"),
        *(
            ([Image.new(mode, (8, 8))] * 2, {}, InputError, f"`frames` has an image of PIL in mode {mode}; give {cure}")
            for mode, cure in {"L": "image.convert", "P": ".*'RGBA'", "CMYK": ".*'RGB'", "I;16": "its values"}.items()
        ),
        ([turntable(4)[0], turntable(5)[0]], {}, InputError, "must be alike"),
    ],
)
def test_what_is_no_clip_is_refused(frames, options, error, sentence):
    """In a sentence that names the argument."""
    with pytest.raises(error, match=rf"{sentence}.*\.$"):
        list(interpolate_clip(frames, **{"fps": 16, "method": "blend", **options}))


LEVELS = turntable(4).astype(np.float32)
"""Frames of whole numbers from 0 to 255 in floats."""

MISTAKEN = {
    "8-bit levels": (LEVELS, OptionError, "divide them by the value of white"),
    "16-bit levels": (LEVELS * 257, OptionError, "divide them by the value of white"),
    "-1 to 1": (LEVELS / 127.5 - 1, OptionError, "values / 2 \\+ 0.5"),
    "dark, -1 to 1": (LEVELS / 510 - 1, OptionError, "values / 2 \\+ 0.5"),
    "8-bit levels, resized": (LEVELS * np.float32(0.99), UserWarning, "divide them by 255"),
    "NaN": (np.where(LEVELS > 250, np.nan, LEVELS / 255), UserWarning, "has NaN"),
}
"""Float clips on another scale than 0 to 1, with what is raised or said."""

LINEAR = turntable(4).astype(np.float32) / 255
SPARKS = LINEAR > 0.98
LIGHT = {
    "black": LINEAR * 0,
    "masks of 0 and 1": np.rint(LINEAR),
    "overshoots of a filter": LINEAR * np.float32(1.2) - np.float32(0.09),
    "outside of the gamut": LINEAR * np.float32(1.3) - np.float32(0.1) * (LINEAR < 0.3),
    "bright light": LINEAR * np.float32(20),
    "candela per square metre": LINEAR**4 * np.float32(4000),
    "highlights": np.where(SPARKS, np.float32(1000), LINEAR),
    "highlights on black": np.where(SPARKS, np.float32(1000), np.float32(0)),
    "infinite": np.where(SPARKS, np.inf, LINEAR),
}
"""Float clips of light, brighter than white, too."""


def by_clip(frames: NDArray) -> list[NDArray]:
    return list(interpolate_clip(frames.astype(np.float32), 16, method="nearest")[0])


def by_iterator(frames: NDArray) -> list[NDArray]:
    return [frame for frame, _ in interpolate_clip(iter(frames.astype(np.float32)), 16, method="nearest")]


def by_stream(frames: NDArray) -> list[NDArray]:
    return list(stream(frames.astype(np.float32), method="nearest"))


def by_pairs(frames: NDArray) -> list[NDArray]:
    return find_method("nearest").interpolate(*frames[:2].astype(np.float32), [0.5])


WAYS = pytest.mark.parametrize("way", [by_clip, by_iterator, by_stream, by_pairs])


@WAYS
@pytest.mark.parametrize("kind", MISTAKEN)
def test_floats_on_another_scale_are_refused_or_warned_of(kind, way):
    """Refused with the cure where they are certain to be, else warned of; a black frame before hides nothing."""
    frames, expected, sentence = MISTAKEN[kind]
    black = [] if way is by_pairs else [np.zeros_like(frames[:1])]
    for clip in (frames, np.concatenate([*black, frames])):
        with (
            pytest.raises(expected, match=sentence)
            if expected is OptionError
            else pytest.warns(expected, match=sentence)
        ):
            way(clip)


@WAYS
@pytest.mark.parametrize("kind", LIGHT)
def test_light_is_taken_as_it_is(kind, way):
    """Of any brightness, with values a little below 0, without a word."""
    assert len(way(LIGHT[kind])) > 0
