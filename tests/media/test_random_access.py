"""Beginning in the middle: the same frames, bit by bit, as reading from the start."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import av
import numpy as np
import pytest

from fpsboost import DecodeOptions, Frame, FrameSource, InputError
from fpsboost.derived_sources import TrimmedSource
from fpsboost.io.images.source import ImageReading, ImageSource
from fpsboost.io.video.source import VideoSource
from fpsboost.timeline import positions_of
from fpsboost.timing.position import Position, Trim
from support.video_truth import bytes_of, copy_packets, spoil_packets, write_clip

FAST = {"preset": "ultrafast"}
B_FRAMES = {**FAST, "bf": "2", "g": "6", "sc_threshold": "0"}
OPEN_GROUPS = {**B_FRAMES, "preset": "veryfast", "bf": "3", "x264-params": "open-gop=1:b-pyramid=normal"}
REFRESHED = {"preset": "veryfast", "g": "8", "sc_threshold": "0", "x264-params": "intra-refresh=1"}
X265 = "log-level=none:keyint=6:min-keyint=6:bframes=3:frame-threads=1:pools=1"
LATER = {"auto-alt-ref": "1", "lag-in-frames": "16", "g": "8", "b": "200k", "deadline": "realtime", "cpu-used": "8"}
ONE_THREAD = {"threads": "1"}  # those of VP8 wait by spinning, for seconds where cores are busy
CODECS: dict[str, dict[str, Any]] = {
    "B-frames.mp4": {"options": B_FRAMES},
    "B-frames.mov": {"options": B_FRAMES},
    "B-frames.mkv": {"options": B_FRAMES},
    "open groups.mp4": {"options": OPEN_GROUPS},
    "open groups.mkv": {"options": OPEN_GROUPS},
    "hevc.mp4": {"codec": "libx265", "options": {**FAST, "x265-params": X265}},
    "hevc.mkv": {"codec": "libx265", "options": {**FAST, "x265-params": X265}},
    "vp8.webm": {"codec": "libvpx", "options": LATER | ONE_THREAD},
    "vp9.webm": {"codec": "libvpx-vp9", "options": LATER},
    "vp9.mp4": {"codec": "libvpx-vp9", "options": LATER},
    "av1.mkv": {"codec": "libsvtav1", "options": {"preset": "12", "g": "8", "svtav1-params": "lp=1"}},
    "mpeg2.mov": {"codec": "mpeg2video", "options": {"g": "6", "bf": "2"}},
    "mpeg2.mkv": {"codec": "mpeg2video", "options": {"g": "6", "bf": "2"}},
    "mpeg4.mp4": {"codec": "mpeg4", "options": {"g": "6", "bf": "2", "b": "4M"}},
    "prores.mov": {"codec": "prores_ks", "pixel_format": "yuv422p10le"},
    "mjpeg.mov": {"codec": "mjpeg", "pixel_format": "yuvj420p"},
    "ffv1.mkv": {"codec": "ffv1", "options": {"g": "4"}},
}
UNEVEN = [0, 1, 2, 5, 6, 7, 8, 13, 14, 15, 16, 17, 18, 30, 31, 32, 33, 34, 35, 36, 37, 38, 41, 42, 43, 44]


def content(frame: Frame) -> tuple[Any, ...]:
    """What must not change: time, duration, and every sample of the image and of the decoder's picture."""
    original = frame.original
    planes = bytes_of(original) if isinstance(original, av.VideoFrame) else original
    return frame.time, frame.duration, np.asarray(frame.image).tobytes(), planes


def read(source: FrameSource) -> list[tuple[Any, ...]]:
    """All frames that a source yields."""
    return [content(frame) for frame in source]


def check(opened: Callable[[], Any], numbers: list[int], said: str = "") -> None:
    """Compare reading from the start with reading from some frames; `said` is in the remarks of the latter alone."""
    with opened() as source:
        whole = read(source)
        remarks = source.remarks
    for number in [each % len(whole) for each in numbers]:
        with opened() as source:
            times = source.frame_times()
            is_known = not said or "cannot begin" in said
            assert list(times) == [frame[0] for frame in whole] if is_known else times is None
            source.begin_at(number)
            assert read(source) == whole[number:], number
            more = [remark for remark in source.remarks if remark not in remarks]
            assert (bool(more) and said in more[0]) if said else not more


@pytest.mark.parametrize(
    ("name", "times"),
    [(name, range(26)) for name in CODECS] + [(name, UNEVEN) for name in ("open groups.mp4", "vp9.webm", "hevc.mkv")],
)
def test_frames_are_those_of_reading_from_the_start(tmp_path, name, times):
    """In every container with an index, whatever hangs on what: groups that are open, frames that are hidden."""
    clip = write_clip(tmp_path / name, times=times, **CODECS[name])
    check(lambda: VideoSource(clip), [0, 1, 7, 12, 16, -2, -1])


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_a_key_frame_that_is_none_is_not_believed(tmp_path, suffix):
    """Pictures that are refreshed little by little are marked as key frames, and are not like those of reading all."""
    clip = write_clip(tmp_path / f"in{suffix}", times=range(100), options=REFRESHED)
    check(lambda: VideoSource(clip), [0, 1, 8, 9, 50, -1])
    slower = {**REFRESHED, "bf": "0"}
    clip = write_clip(tmp_path / f"slower{suffix}", times=range(100), options=slower)
    check(lambda: VideoSource(clip), [-1], "read from its beginning, because decoding cannot begin at the key frame")


@pytest.mark.parametrize("container", ["mp4", "fragments", "mkv"])
def test_frames_before_the_beginning_are_not_counted(tmp_path, container):
    """An edit list that begins within a group: its frames before that are decoded, and not shown."""
    whole = write_clip(tmp_path / "whole.mkv", times=range(40), options=B_FRAMES)
    clip = tmp_path / f"in.{'mkv' if container == 'mkv' else 'mp4'}"
    options = {"movflags": "frag_keyframe+default_base_moof"} if container == "fragments" else {}

    def begin_earlier(number: int, packet: Any) -> None:
        packet.dts = 40 * number - 80 - 120
        packet.pts -= 120

    copy_packets(whole, clip, begin_earlier, **options)
    check(lambda: VideoSource(clip), [0, 1, 4, 20, -1])


@pytest.mark.parametrize("name", ["in.avi", "in.ts", "in.flv", "in.h264", "in.mp4"])
def test_pictures_without_an_index_of_their_times(tmp_path, name):
    """What comes before is decoded and dropped, and that is said; of .mp4, because fields hang on those before."""
    clip = write_clip(tmp_path / name, times=range(12), options=B_FRAMES, container=name[3:] if "264" in name else None)
    reason = "packets tell nothing of fields" if name == "in.mp4" else "container has no index"
    decoding = DecodeOptions(deinterlace=name == "in.mp4")
    check(lambda: VideoSource(clip, decoding=decoding), [1, 9, -1], f"from its beginning, because its {reason}")


def test_damage_at_the_start_is_no_index(tmp_path):
    """A packet that becomes no picture: all is decoded."""
    clip = write_clip(tmp_path / "in.mp4", times=range(26), options=B_FRAMES)
    spoil_packets(clip, [3])
    check(lambda: VideoSource(clip), [1, 9, -1], "because its packets and its pictures have different times")


def test_damage_that_no_check_has_found_is_an_error(tmp_path):
    """Times that were promised are kept, or it is said."""
    clip = write_clip(tmp_path / "in.mp4", times=range(80), options={**FAST, "crf": "0", "g": "1"})
    spoil_packets(clip, [60])
    for number in (0, 59, 60):
        with VideoSource(clip) as source:
            assert len(source.frame_times() or ()) == 80
            source.begin_at(number)
            with pytest.raises(InputError, match=r"in\.mp4 is damaged: its frame 60 is not at the time"):
                list(source)
    with VideoSource(clip) as source:
        source.begin_at(70)
        assert [frame.time for frame in source] == [Fraction(k, 25) for k in range(70, 80)]


@pytest.mark.parametrize("number", [10, 99])
def test_a_frame_that_is_not_there(tmp_path, number):
    """With times or without, in images and in a range."""
    clip = write_clip(tmp_path / "in.mp4")
    for source in (VideoSource(clip), TrimmedSource(VideoSource(clip), Trim(Position.parse("2f", "--start"), None))):
        with source, pytest.raises(InputError, match=f"none has the number {number}"):
            source.begin_at(number)
    raw = write_clip(tmp_path / "in.avi")
    with VideoSource(raw) as source:
        source.begin_at(number)
        with pytest.raises(InputError, match=f"has ended before frame {number}"):
            list(source)


@pytest.mark.parametrize(
    ("start", "end"),
    [(None, None), ("7f", None), ("0.3", "0.9"), ("0.31", "20f"), (None, "0.81"), ("9f", "0.81"), ("0", "99")],
)
@pytest.mark.parametrize(
    ("name", "may_skip"), [("B-frames.mp4", True), ("B-frames.mp4", False), ("B-frames.mkv", True), ("in.avi", False)]
)
def test_ranges(tmp_path, name, start, end, may_skip):
    """Frames count from the start of the range, and its place on the clip's clock is told as by reading it whole."""
    clip = write_clip(tmp_path / name, times=range(5, 31), options=B_FRAMES)
    places = [None if text is None else Position.parse(text, "--x") for text in (start, end)]
    opened = lambda: TrimmedSource(VideoSource(clip), Trim(*places), may_skip=may_skip)  # noqa: E731
    check(opened, [1, 4, -1], "because the times of its frames" if name == "in.avi" else "")
    with opened() as whole, opened() as part:
        part.begin_at(len(read(whole)) - 1)
        read(part)
        skipped = part.window.skipped if may_skip else whole.window.skipped
        assert replace(whole.window, skipped=skipped) == part.window
        assert positions_of(whole)(2, Fraction(1)) == positions_of(part)(2, Fraction(1))


@pytest.mark.parametrize("fill_gaps", [False, True])
def test_images(tmp_path, save_images, fill_gaps):
    """By their files, from the part on that is kept, and compared with its first image."""
    save_images(tmp_path, count=9)
    if fill_gaps:
        (tmp_path / "shot_0004.png").unlink()

    def opened() -> ImageSource:
        source = ImageSource(str(tmp_path), Fraction(24), ImageReading(fill_gaps=fill_gaps))
        source.keep(2, None)
        return source

    check(opened, [0, 1, 3, -1])
    with opened() as source:
        source.begin_at(3)
        assert source.position_of(2, Fraction(1)) == opened().position_of(2, Fraction(1))
    with opened() as source, pytest.raises(InputError, match="none has the number 7"):
        source.begin_at(7)


def test_an_image_unlike_the_first_is_an_error(tmp_path, save_images):
    """Whatever image reading begins at."""
    save_images(tmp_path, count=3)
    save_images(tmp_path, "shot_{:04d}.png", count=1, dtype=np.uint16)
    with ImageSource(str(tmp_path), Fraction(24)) as source:
        source.begin_at(2)
        with pytest.raises(InputError, match=r"0003.* is unlike .*0001"):
            list(source)
