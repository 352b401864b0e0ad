"""The VapourSynth filter makes the frames of a conversion, in any order and on all threads."""

import gc
import os
import random
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import Encoding, Interpolator, Pair, Timing, convert, stream
from fpsboost.io.video.ycc import from_bgr
from fpsboost.media import plane_arrays
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis.blend import Blend
from support.video_truth import scene

vs = pytest.importorskip("vapoursynth", reason="VapourSynth needs Python 3.12 or newer, and fpsboost[vapoursynth]")

from fpsboost.integrations.vapoursynth import interpolate  # noqa: E402

SIZE = 48, 64
PIXEL_FORMATS = {
    **{"YUV420P8": "yuv420p", "YUV420P10": "yuv420p10le", "YUV422P8": "yuv422p"},
    **{"YUV422P12": "yuv422p12le", "YUV444P16": "yuv444p16le"},
}
UNTAGGED = {"_ChromaLocation": 1}
"""What FFmpeg takes untagged video of this size for, where VapourSynth takes it for something else."""

Planes = list[NDArray[Any]]


@dataclass
class Source:
    """A clip of VapourSynth with known planes, and how often each of its frames was asked for."""

    clip: Any
    asked: Counter[int]


def source_of(frames: Sequence[Planes], format: str, props: Sequence[dict[str, Any]] = (), fps: int = 24) -> Source:
    """Return a clip of these planes, with properties of all frames or of each."""
    height, width = frames[0][0].shape
    asked: Counter[int] = Counter()
    blank = vs.core.std.BlankClip(
        format=getattr(vs, format), width=width, height=height, length=len(frames), fpsnum=fps, fpsden=1, keep=True
    )

    def fill(n: int, f: Any) -> Any:
        asked[n] += 1
        filled = f.copy()
        for plane, values in enumerate(frames[n]):
            np.asarray(filled[plane])[:] = values
        for name, value in (props[n] if len(props) > 1 else props[0] if props else {}).items():
            filled.props[name] = value
        return filled

    return Source(vs.core.std.ModifyFrame(blank, blank, fill), asked)


def planes_of(frame: Any) -> Planes:
    """Return the planes of a frame of the host."""
    return [np.array(frame[plane]) for plane in range(3)]


def all_planes(clip: Any) -> list[Planes]:
    """Return the planes of all frames of a clip."""
    return [planes_of(frame) for frame in clip.frames()]


def assert_equal(made: Sequence[Planes], expected: Sequence[Planes]) -> None:
    """Two clips have the same planes, bit by bit."""
    assert len(made) == len(expected)
    for number, (frame, other) in enumerate(zip(made, expected, strict=True)):
        for plane, values in zip(frame, other, strict=True):
            np.testing.assert_array_equal(plane, values, err_msg=f"frame {number}")


def gray(count: int = 6, format: str = "YUV420P8", **options: Any) -> Source:
    """Return a clip of frames that get brighter."""
    sizes = SIZE, (SIZE[0] // 2, SIZE[1] // 2), (SIZE[0] // 2, SIZE[1] // 2)
    frames = [[np.full(size, 10 * n % 250, np.uint8) for size in sizes] for n in range(count)]
    return source_of(frames, format, **options)


def write_lossless(path: Path, pixel_format: str, pictures: Sequence[NDArray[np.uint8]]) -> Path:
    """Write pictures as a lossless video."""
    with av.open(str(path), "w") as file:
        video = file.add_stream("ffv1", rate=24, width=SIZE[1], height=SIZE[0], pix_fmt=pixel_format)
        for number, image in enumerate(pictures):
            picture = from_bgr(image, pixel_format, 6, False)
            picture.pts, picture.time_base = number, Fraction(1, 24)
            file.mux(video.encode(picture))
        file.mux(video.encode(None))
    return path


def read_planes(path: Path) -> list[Planes]:
    """Return the planes of a video's frames."""
    with av.open(str(path)) as file:
        return [[np.array(plane) for plane in plane_arrays(picture)] for picture in file.decode(video=0)]


def converted(path: Path, method: str, factor: Fraction) -> list[Planes]:
    """Return the planes of our own conversion of a video."""
    output = path.with_name("converted.mkv")
    timing = Timing(factor, duplicates="keep")
    convert(str(path), str(output), timing=timing, method=method, encoding=Encoding(codec="ffv1"))
    return read_planes(output)


@pytest.mark.parametrize("format", PIXEL_FORMATS)
def test_yuv_equals_our_own_conversion(format, tmp_path):
    """Bit by bit, in the clip's own planes and depth, the frame that is held at the end included."""
    path = write_lossless(tmp_path / "in.mkv", PIXEL_FORMATS[format], [scene(4 * n) for n in range(5)])
    output = interpolate(source_of(read_planes(path), format).clip, 5, 2, method="blend")
    assert_equal(all_planes(output), converted(path, "blend", Fraction(5, 2)))


@pytest.mark.parametrize(("options", "props"), [({}, []), ({"method": "dis-warp"}, [UNTAGGED])])
def test_methods_equal_our_own_conversion(tmp_path, options, props):
    """With motion and a cut; one that takes no planes gets BGR by the clip's matrix, range and chroma location."""
    pictures = [scene(3 * n) for n in range(5)] + [scene(40 + 3 * n)[::-1, ::-1] ** 2 for n in range(4)]
    path = write_lossless(tmp_path / "in.mkv", "yuv420p", pictures)
    output = interpolate(source_of(read_planes(path), "YUV420P8", props).clip, **options)
    method = options.get("method", "nlm")
    assert_equal(all_planes(output), converted(path, method, Fraction(2)))


@pytest.mark.parametrize(
    ("format", "dtype", "gain"), [("RGB24", np.uint8, 1), ("RGB48", np.uint16, 257), ("RGBS", np.float32, 0.01)]
)
def test_rgb_equals_our_own_conversion(format, dtype, gain):
    """Planes are BGR arrays of the clip's own type."""
    images = [scene(4 * n).astype(dtype) * dtype(gain) for n in range(4)]
    clip = source_of([[image[..., plane] for plane in (2, 1, 0)] for image in images], format).clip
    made = stream(images, method="blend", duplicates="keep")
    expected = [[image[..., plane] for plane in (2, 1, 0)] for image in made]
    assert_equal(all_planes(interpolate(clip, method="blend")), expected)


def test_rgb30_is_scaled_and_rounded_back_exactly():
    """All 1,024 values come out of a frame between two equal ones, which is made in 16 bits."""
    values = np.arange(1024, dtype=np.uint16).reshape(16, 64)
    clip = source_of([[values, values[::-1], values[:, ::-1]]] * 3, "RGB30").clip
    made = planes_of(interpolate(clip, method="blend").get_frame(1))
    assert_equal([made], [[values, values[::-1], values[:, ::-1]]])


def test_frames_do_not_depend_on_the_order_of_requests():
    """Asked for backward, at random and all at once, they are those asked for in order."""
    frames = [[scene(5 * n)[..., plane] for plane in range(3)] for n in range(8)]
    clip = source_of(frames, "RGB24").clip
    in_order = all_planes(interpolate(clip, 3, method="dis-warp"))
    numbers = list(range(len(in_order)))
    for shuffle in (reversed(numbers), random.Random(1).sample(numbers, len(numbers))):
        output = interpolate(clip, 3, method="dis-warp")
        assert_equal(*zip(*[(planes_of(output.get_frame(n)), in_order[n]) for n in shuffle], strict=True))
    output = interpolate(clip, 3, method="dis-warp")
    at_once = [output.get_frame_async(n) for n in numbers]
    assert_equal([planes_of(each.result()) for each in at_once], in_order)


def test_frames_are_made_side_by_side():
    """Two threads make frames of two pairs at the same time: each waits until the other one makes its own."""
    meeting = threading.Barrier(2, timeout=60)

    @dataclass(frozen=True)
    class Meets(Blend):
        def synthesize(self, frame_pair, times):
            meeting.wait()
            return super().synthesize(frame_pair, times)

    frames = [[np.full((24, 32), 50 * n, np.uint8)] * 3 for n in range(4)]
    output = interpolate(source_of(frames, "RGB24").clip, method=Interpolator(ZeroMotion(), Meets(), cuts=None))
    at_once = [output.get_frame_async(n) for n in (1, 3)]
    assert [int(planes_of(each.result())[0][0, 0]) for each in at_once] == [25, 75]


def test_motion_is_found_once_a_pair():
    """Several threads ask for the same pairs, and the first one finds the motion for all."""
    found: Counter[int] = Counter()

    @dataclass(frozen=True)
    class Counts(ZeroMotion):
        def estimate(self, image0, image1):
            found[int(image0.array[0, 0, 0])] += 1
            return super().estimate(image0, image1)

    frames = [[np.full((24, 32), n, np.uint8)] * 3 for n in range(5)]
    counting = Interpolator(Counts(), Blend(), cuts=None)
    output = interpolate(source_of(frames, "RGB24").clip, 8, method=counting)
    for each in [output.get_frame_async(n) for n in range(output.num_frames)]:
        each.result()
    assert found == Counter(range(4))


def test_memory_does_not_grow_with_length():
    """Of 39 pairs, a few are left after the last frame."""
    output = interpolate(gray(40).clip, method="blend")
    for _ in output.frames(close=True):
        pass
    assert sum(isinstance(each, Pair) for each in gc.get_objects()) <= vs.core.num_threads + 4


@pytest.mark.parametrize(
    ("number", "needed"),
    [(0, {0, 1, 2}), (1, {0, 1, 2}), (9, {3, 4, 5, 6}), (10, {3, 4, 5, 6}), (18, {7, 8, 9}), (19, {7, 8, 9})],
)
def test_only_the_frames_around_are_asked_for(number, needed):
    """A frame needs its pair and the pairs beside that; one of the source needs those that tell a cut before it."""
    source = gray(10)
    interpolate(source.clip, method="blend").get_frame(number)
    assert set(source.asked) <= needed
    source = gray(10)
    interpolate(source.clip, method="blend", sc=False).get_frame(number)
    assert set(source.asked) <= (needed if number % 2 else {number // 2})


def test_durations_at_a_constant_rate():
    """The rate is exact, the length that of n times as many frames, and every frame lasts as long."""
    output = interpolate(gray(6, fps=25).clip, fps_num=60000, fps_den=1001, method="blend")
    assert output.fps == Fraction(60000, 1001)
    assert output.num_frames == 15  # 6 frames of 1/25 s hold 14.4
    props = [frame.props for frame in output.frames()]
    assert {(each["_DurationNum"], each["_DurationDen"]) for each in props} == {(1001, 60000)}


def test_durations_at_a_variable_rate():
    """Each frame's interval is divided evenly, by the properties of the frames; times lie where frames do."""
    seconds = [Fraction(1, 24), Fraction(1, 10), Fraction(1, 30)]
    props = [
        {"_DurationNum": each.numerator, "_DurationDen": each.denominator, "_AbsoluteTime": float(sum(seconds[:n]))}
        for n, each in enumerate(seconds)
    ]
    source = gray(3, props=props).clip
    clip = vs.core.std.FrameEval(vs.core.std.BlankClip(source, fpsnum=0, fpsden=1), lambda n: source)
    output = [frame.props for frame in interpolate(clip, 5, 2, method="blend").frames()]
    lasts = [Fraction(each["_DurationNum"], each["_DurationDen"]) for each in output]
    assert sum(lasts) == sum(seconds)
    begins = [sum(lasts[:n], Fraction(0)) for n in range(len(lasts))]
    assert [each["_AbsoluteTime"] for each in output] == pytest.approx([float(each) for each in begins])


def test_scene_changes_of_the_clip_are_honoured_and_passed_on():
    """Frames before a marked cut repeat the one scene, those after it the other; marks lie where the cut does."""
    marks = [{"_SceneChangePrev": int(n == 3), "_SceneChangeNext": int(n == 2)} for n in range(6)]
    output = list(interpolate(gray(6, props=marks).clip, 4, method="blend").frames())
    assert [int(planes_of(frame)[0][0, 0]) for frame in output[7:14]] == [18, 20, 20, 20, 30, 30, 32]
    assert [n for n, frame in enumerate(output) if frame.props["_SceneChangeNext"]] == [10]
    assert [n for n, frame in enumerate(output) if frame.props["_SceneChangePrev"]] == [11]


def test_scene_changes_are_found_and_set():
    """As by a conversion; without `sc`, there are none, and no properties that were true of the source alone."""
    noise = np.random.default_rng(1).integers(0, 256, (2, *SIZE, 3), dtype=np.uint8)
    frames = [[noise[n // 4][..., plane] for plane in range(3)] for n in range(8)]
    source = source_of(frames, "RGB24")
    output = list(interpolate(source.clip, method="blend").frames())
    assert [n for n, frame in enumerate(output) if frame.props["_SceneChangeNext"]] == [7]
    assert [n for n, frame in enumerate(output) if frame.props["_SceneChangePrev"]] == [8]
    assert_equal([planes_of(output[7])], [frames[3]])
    marked = source.clip.std.SetFrameProps(_SceneChangePrev=1, _SceneChangeNext=1)
    mixed = interpolate(marked, method="blend", sc=False).get_frame(7)
    assert "_SceneChangePrev" not in mixed.props
    assert "_SceneChangeNext" not in mixed.props
    assert not np.array_equal(planes_of(mixed)[0], frames[3][0])


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"method": "best"}, "There is no method 'best'; choose one of nlm, "),
        ({"factor_num": 0}, "`factor` must be above 0 and at most 1000, not 0."),
        ({"factor_den": 0}, "`factor_den` must be at least 1, not 0."),
        (
            {"factor_num": 2, "fps_num": 60},
            "`fps_num` and `factor_num` cannot be combined: both set the output rate; leave one of them out.",
        ),
        (
            {"factor_den": 2, "fps_num": 60},
            "`fps_num` and `factor_den` cannot be combined: both set the output rate; leave one of them out.",
        ),
        ({"sc": "no"}, "`sc` must be True or False, not 'no'."),
        ({"factor_num": 2.5}, "`factor_num` must be a whole number, not 2.5."),
        ({"fps_den": 1001}, "`fps_den` needs `fps_num`; give that too, or leave it out."),
        ({"fps_num": 0}, "`fps` must be above 0 and at most 100000, not 0."),
    ],
)
def test_options_are_refused_with_the_command_lines_sentences(options, sentence):
    """As an error of the host, when the script is read."""
    with pytest.raises(vs.Error, match=f"^fpsboost: {sentence}"):
        interpolate(gray().clip, **options)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"length": 1}, "The clip has one frame; interpolation needs at least two"),
        ({"varsize": True}, "The clip changes its format or its size on the way"),
        ({"varformat": True}, "The clip changes its format or its size on the way"),
        ({"format": "GRAY8"}, "The clip is Gray8; convert it"),
        ({"format": "YUV410P8"}, "The clip is YUV410P8; convert it"),
        ({"format": "RGBH"}, "The clip is RGBH; convert it"),
        ({"format": "YUV444PS"}, "The clip is YUV444PS; convert it"),
        ({"length": 2**30}, "`factor=2` makes more frames of the clip than VapourSynth counts"),
    ],
)
def test_clips_are_refused(options, sentence):
    """With what is wrong, and what to do."""
    options = {**options, "format": getattr(vs, options.get("format", "YUV420P8"))}
    with pytest.raises(vs.Error, match=sentence.replace("(", r"\(")):
        interpolate(vs.core.std.BlankClip(**options))


def test_what_cannot_be_known_or_taken_is_an_error_of_the_host():
    """`fps_num` needs the clip's rate; a colour matrix that nobody can mix in stops the request for the frame."""
    with pytest.raises(vs.Error, match=r"set it with std\.AssumeFPS"):
        interpolate(vs.core.std.BlankClip(fpsnum=0, fpsden=1), fps_num=60)
    output = interpolate(gray(props=[{"_Matrix": 14}]).clip, method="blend")
    with pytest.raises(vs.Error, match="colour matrix number 14, which is not supported"):
        output.get_frame(1)


def test_vspipe_writes_what_a_conversion_does(tmp_path):
    """A script of two lines behind its source, as YUV4MPEG2, against our own conversion."""
    path = write_lossless(tmp_path / "in.mkv", "yuv420p", [scene(4 * n) for n in range(5)])
    script = tmp_path / "script.vpy"
    script.write_text(SCRIPT.format(path=str(path)))
    # vspipe finds this Python by a file in the user's configuration
    environment = {**os.environ, "XDG_CONFIG_HOME": str(tmp_path), "APPDATA": str(tmp_path)}
    subprocess.run([sys.executable, "-m", "vapoursynth", "config"], env=environment, check=True)
    vspipe = Path(vs.__file__).parent / "vspipe"
    command = [str(vspipe), "-c", "y4m", str(script), str(tmp_path / "out.y4m")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert_equal(read_planes(tmp_path / "out.y4m"), converted(path, "blend", Fraction(2)))


SCRIPT = """
import av, numpy as np, vapoursynth as vs
from fpsboost.integrations.vapoursynth import interpolate

pictures = list(av.open({path!r}).decode(video=0))

def fill(n, f):
    filled = f.copy()
    for plane, values in enumerate(pictures[n].planes):
        stored = np.frombuffer(values, np.uint8).reshape(values.height, values.line_size)
        np.asarray(filled[plane])[:] = stored[:, : values.width]
    return filled

blank = vs.core.std.BlankClip(format=vs.YUV420P8, width=64, height=48, length=len(pictures), fpsnum=24, keep=True)
clip = blank.std.ModifyFrame(blank, fill)
interpolate(clip, method="blend").set_output()
"""
