"""A part of a clip: the right frames, the same as of the whole clip, with the sound that belongs to them."""

import os
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from fpsboost import DecodeOptions, InputError, OptionError, Summary, convert
from fpsboost.analysis.scene_cuts import read_cuts
from fpsboost.derived_sources import TrimmedSource, trim_source
from fpsboost.io.opening import open_source
from fpsboost.io.video.source import VideoSource
from fpsboost.timing.position import Gaps, Position, Replacement, Trim
from fpsboost.timing.retime import parse_curve, parse_speeds
from support.memory_frames import BLEND, FAST
from support.video_truth import packets_of, pictures_of, samples_of, spoil_packets, stream_of, write_clip

GROUPS = {"preset": "ultrafast", "crf": "0", "g": "6", "bf": "2", "sc_threshold": "0"}


def trim(start: str | None = None, end: str | None = None) -> Trim:
    """As the command line makes it."""
    return Trim(*[None if text is None else Position.parse(text, "--x") for text in (start, end)])


def convert_part(source: Path, target: Path, start: str | None, end: str | None = None, **options: Any) -> Summary:
    """Convert a part of a clip."""
    decoding = DecodeOptions(trim=trim(start, end), input_fps=options.pop("input_fps", None))
    options = {"method": BLEND, **options}
    return convert(str(source), str(target), encoding=options.pop("encoding", FAST), decoding=decoding, **options)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", Fraction(90)),
        ("0", Fraction(0)),
        (".5", Fraction(1, 2)),
        ("90.25", Fraction(361, 4)),
        ("1:30", Fraction(90)),
        ("00:01:30.5", Fraction(181, 2)),
        ("100:00:00", Fraction(360000)),
        (" 90:59.001 ", Fraction(5459001, 1000)),
        ("2s", Fraction(2)),
        (".5s", Fraction(1, 2)),
        ("1001/24s", Fraction(1001, 24)),
    ],
)
def test_times_are_read_as_people_write_them(text, seconds):
    """Seconds, minutes and hours, exactly."""
    assert Position.parse(text, "--start") == Position(seconds)


@pytest.mark.parametrize(
    "text",
    [
        *("", "f", "s", "-1", "-5f", "1.5f", "1:60", "1:75:00", "1:2:3:4", "1,5", "abc", "1e9", "٣"),
        *("2sf", "2S", "2 s", "1:30s", "1:30f", "1/0s"),
    ],
)
def test_other_words_are_refused(text):
    """The sentence names the option and shows how to write it."""
    with pytest.raises(OptionError, match=r"--end .* is not a position in a clip; write seconds \(90\.5 or 90\.5s\)"):
        Position.parse(text, "--end")


@pytest.mark.parametrize("text", ["2s", "0:02.0", "00:00:02", "48f"])
def test_every_option_takes_the_same_positions(text, tmp_path):
    """Parts, speed ramps, lists of frames, and lists of cuts."""
    place, rate = Position.parse(text, "`start`"), Fraction(24)
    assert Trim(text).start == Trim(None, text).end == place
    assert Replacement.parse(text).ranges == Gaps.parse(f"{text}x2").ranges[:1] == ((place, place),)
    ramp, speeds = parse_curve(f"0=0 {text}={text} 9s=8s", rate, rate), parse_speeds(f"0.5@{text}-4s", rate)
    assert ramp.segments[1].begin == ramp.segments[1].source0 == speeds.segments[1].begin == 2
    (tmp_path / "cuts.txt").write_text(text)
    assert read_cuts(tmp_path / "cuts.txt").positions == (place,)


@pytest.mark.parametrize(
    ("start", "end"), [("2", "1"), ("2", "2"), ("7f", "7f"), (None, "0"), (None, "0f"), ("0f", "0")]
)
def test_an_end_that_is_no_end_is_refused(start, end):
    """It must lie behind the start, where the two can be compared."""
    with pytest.raises(OptionError, match=r"`end=.*` must be after `start=.*`"):
        trim(start, end)
    assert trim("2", "10f").end == Position(Fraction(10), is_frame=True)


def frames_of(path: Path, part: Trim, **options: Any) -> tuple[list[Fraction], list[bytes], TrimmedSource]:
    """Times and pixels of a part of a video."""
    with VideoSource(path) as whole:
        source = TrimmedSource(whole, part, **options)
        frames = list(source)
    return [frame.time for frame in frames], [frame.image.tobytes() for frame in frames], source


@pytest.mark.parametrize(
    ("start", "end", "numbers"),
    [
        ("0.4", None, range(10, 30)),
        ("0.41", None, range(11, 30)),
        ("0.4", "0.8", range(10, 20)),
        (None, "0.8", range(20)),
        (None, "0.81", range(21)),
        ("10f", "20f", range(10, 20)),
        ("0.4", "20f", range(10, 20)),
        ("10f", "99", range(10, 30)),
        ("29f", None, range(29, 30)),
    ],
)
@pytest.mark.parametrize("first", [0, 125], ids=["starts at 0", "starts at 5 s"])
def test_frames_in_the_range(tmp_path, start, end, numbers, first):
    """From the start to before the end, counted from the first frame, shown from 0 on, pixels as in the whole clip."""
    clip = write_clip(tmp_path / "in.mp4", times=range(first, first + 30), options=GROUPS)
    with VideoSource(clip) as source:
        whole = [frame.image.tobytes() for frame in source]
    times, pixels, part = frames_of(clip, trim(start, end))
    assert times == [Fraction(k, 25) for k in range(len(numbers))]
    assert pixels == [whole[number] for number in numbers]
    assert part.window.begin == Fraction(first + numbers[0], 25)


@pytest.mark.parametrize("name", ["in.mp4", "in.mkv", "in.mov", "in.webm", "in.avi", "in.ts", "in.flv", "in.h264"])
@pytest.mark.parametrize("start", [1, 12, 17])
def test_going_there_gives_the_frames_of_reading_there(tmp_path, name, start):
    """With an index or without: the same frames at the same times as if everything before had been decoded."""
    codec: dict[str, Any] = {"codec": "libvpx", "options": {"g": "6"}} if name == "in.webm" else {"options": GROUPS}
    clip = write_clip(tmp_path / name, times=range(30), container="h264" if name == "in.h264" else None, **codec)
    part = trim(str(start / 25))
    assert frames_of(clip, part)[:2] == frames_of(clip, part, may_skip=False)[:2]


@pytest.mark.parametrize("name", ["in.mp4", "in.mkv"])
def test_what_lies_before_is_not_decoded(tmp_path, name):
    """Of 30 frames in groups of 6, those of the last group are read, and the very first one."""
    clip = write_clip(tmp_path / name, times=range(30), options=GROUPS)
    with VideoSource(clip) as source:
        source.skip_to(Fraction(26, 25))
        assert next(iter(source)).time == Fraction(24, 25)


def test_the_last_frame_ends_where_the_range_does(tmp_path):
    """A picture that is shown beyond the end is cut off there; one before the clip's own end keeps its duration."""
    clip = write_clip(tmp_path / "in.mp4", times=[0, 4, 8, 12, 50, 54], end=58, time_base=Fraction(1, 100))
    with VideoSource(clip) as whole:
        frames = list(TrimmedSource(whole, trim("0.04", "0.3")))
    assert [frame.time for frame in frames] == [0, Fraction(4, 100), Fraction(8, 100)]
    assert frames[-1].time + frames[-1].duration == Fraction(26, 100)
    with VideoSource(clip) as whole:
        frames = list(TrimmedSource(whole, trim("0.5", "99")))
    assert frames[-1].time + frames[-1].duration == Fraction(8, 100)


def test_what_is_known_beforehand(tmp_path):
    """Count and duration of the part, and nothing where the whole clip does not say."""
    clip = write_clip(tmp_path / "in.mp4", times=range(30))
    with VideoSource(clip) as whole:
        info = TrimmedSource(whole, trim("0.41", "20f")).info
        assert (info.frame_count, info.duration) == (9, Fraction(39, 100))
        info = TrimmedSource(whole, trim("10f", "99")).info
        assert (info.frame_count, info.duration) == (20, Fraction(20, 25))
    raw = write_clip(tmp_path / "in.h264", times=range(30), container="h264")
    with VideoSource(raw) as whole:
        info = TrimmedSource(whole, trim("0.4", "0.8")).info
        assert (info.frame_count, info.duration) == (None, None)


@pytest.mark.parametrize("start", ["2", "30f", "1:00:00"])
@pytest.mark.parametrize("name", ["in.mp4", "in.avi"])
def test_a_start_behind_the_end_is_an_error(tmp_path, snapshot, name, start):
    """The sentence names the file and the option, and nothing is written."""
    clip = write_clip(tmp_path / name, times=range(30))
    before = snapshot(tmp_path)
    with pytest.raises(InputError, match=rf"{name} has ended where `start=.*` would be; name an earlier one"):
        convert_part(clip, tmp_path / "out.mp4", start)
    assert snapshot(tmp_path) == before


def test_damage_in_the_range_is_told_though_the_rest_is_not_read(tmp_path):
    """What was wrong with the part that was read is said also where reading ends early."""
    clip = write_clip(tmp_path / "in.mp4", times=range(60), options={"preset": "ultrafast", "crf": "0", "g": "1"})
    spoil_packets(clip, [5])
    summary = convert_part(clip, tmp_path / "o.mp4", None, "1")
    assert any("in.mp4 is damaged" in remark for remark in summary.remarks)


def clicks_and_flashes(path: Path, seconds: int = 6) -> Path:
    """A clip whose picture flashes and whose sound clicks at each whole second."""
    with av.open(str(path), "w") as output:
        video = output.add_stream("libx264", rate=25, width=64, height=48, options={**GROUPS, "bf": "0"})
        video.pix_fmt = "yuv420p"
        audio: Any = output.add_stream("pcm_s16le", rate=48000, layout="mono")
        second = Fraction(1, 1000)
        chapters: Any = [
            {"id": k, "start": 2000 * k, "end": 2000 * (k + 1), "time_base": second, "metadata": {"title": f"part {k}"}}
            for k in range(3)
        ]
        output.set_chapters(chapters)
        for number in range(25 * seconds):
            level = 235 if number % 25 == 0 else 16
            frame = av.VideoFrame.from_ndarray(np.full((48, 64), level, np.uint8), format="gray")
            frame = frame.reformat(format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            output.mux(video.encode(frame))
            samples = np.zeros((1, 1920), np.int16)
            samples[0, :20] = 30000 if number % 25 == 0 else 0
            sound = av.AudioFrame.from_ndarray(samples, format="s16", layout="mono")
            sound.sample_rate, sound.pts, sound.time_base = 48000, number * 1920, Fraction(1, 48000)
            output.mux(audio.encode(sound))
        output.mux(video.encode(None))
        output.mux(audio.encode(None))
    return path


@pytest.fixture(scope="module")
def flashing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of clicks and flashes."""
    return clicks_and_flashes(tmp_path_factory.mktemp("clip") / "in.mkv")


def flashes(path: Path) -> list[Fraction]:
    """When bright pictures begin."""
    pictures = [(p.pts * Fraction(p.time_base), samples_of(p)[0].mean() > 100) for p in pictures_of(path)]
    return [time for k, (time, bright) in enumerate(pictures) if bright and (k == 0 or not pictures[k - 1][1])]


def clicks(path: Path) -> list[float]:
    """When the sound gets loud after silence."""
    found: list[float] = []
    with av.open(str(path)) as file:
        for frame in file.decode(audio=0):
            assert frame.time is not None
            loud = np.flatnonzero(np.abs(frame.to_ndarray()[0].astype(float)) > 3000)
            if loud.size and (not found or frame.time + loud[0] / 48000 > found[-1] + 0.5):
                found.append(frame.time + float(loud[0]) / 48000)
    return found


@pytest.mark.parametrize("name", ["out.mkv", "out.mov"])
@pytest.mark.parametrize(
    ("start", "end"), [("1.5", "4.5"), ("37f", "113f"), ("0.01", "3.99"), (None, "3"), ("2.04", None)]
)
def test_sound_stays_in_step(tmp_path, flashing, name, start, end):
    """Every click of the part comes with its flash, to a sample or the container's millisecond, and no other one."""
    convert_part(flashing, tmp_path / name, start, end, method="nearest")
    seen, heard = flashes(tmp_path / name), clicks(tmp_path / name)
    assert len(seen) == len(heard) >= 2
    assert all(abs(float(flash) - click) < 0.0015 for flash, click in zip(seen, heard, strict=True))
    assert packets_of(tmp_path / name, "video")[0][0] == 0


def test_packets_of_sound_are_those_that_overlap(tmp_path):
    """Copied bit for bit, from the packet that the pictures begin in to the one that they end in."""
    clip = write_clip(tmp_path / "in.mp4", times=range(100), sound="aac")
    convert_part(clip, tmp_path / "out.mp4", "1", "3", method="nearest")
    length = Fraction(1024, 48000)
    overlapping = [(t - 1, data) for t, data in packets_of(clip, "audio") if t + length > 1 and t < 3]
    assert packets_of(tmp_path / "out.mp4", "audio") == overlapping
    with av.open(str(tmp_path / "out.mp4")) as file:
        video = file.streams.video[0]
        assert (video.duration or 0) * Fraction(video.time_base or 1) == 2


def test_chapters_of_the_part(tmp_path, flashing):
    """Those that overlap it, cut to it."""
    convert_part(flashing, tmp_path / "out.mkv", "1.4", "3.2", method="nearest")
    with av.open(str(tmp_path / "out.mkv")) as file:
        found = [
            (each["metadata"]["title"], each["start"] * each["time_base"], each["end"] * each["time_base"])
            for each in file.chapters()
        ]
    assert found == [("part 0", 0, Fraction(6, 10)), ("part 1", Fraction(6, 10), Fraction(18, 10))]


def test_subtitles_of_the_part(tmp_path):
    """Lines that overlap it are shown as long as they did within it; the others are left out."""
    texts = (b"before", b"into", b"within", b"out of", b"after")
    lines = list(zip((0, 800, 1500, 1900, 3000), (500, 600, 200, 900, 500), texts, strict=True))
    clip = write_clip(tmp_path / "in.mkv", times=range(100), subtitles=lines)
    convert_part(clip, tmp_path / "out.mkv", "1", "2", method="nearest")
    with av.open(str(tmp_path / "out.mkv")) as file:
        found = [(p.pts, p.duration, bytes(p)) for p in file.demux(subtitles=0) if p.size]
    assert found == [(0, 400, b"into"), (500, 200, b"within"), (900, 100, b"out of")]


def test_images_of_the_part(tmp_path, save_images):
    """Only those files are read; numbering begins as the input's does; seconds, unlike numbers, need --input-fps."""
    images = save_images(tmp_path / "in", count=8)
    (tmp_path / "in" / "shot_0002.png").write_bytes(b"broken")
    summary = convert_part(tmp_path / "in", tmp_path / "out", "3f", "6f", encoding=None)
    names = sorted(os.listdir(tmp_path / "out"))
    assert (summary.frames_in, names) == (3, [f"shot_{number:04d}.png" for number in range(1, 6)])
    for name, image in zip(names[::2], images[3:6], strict=True):
        assert np.array_equal(cv2.imread(str(tmp_path / "out" / name), cv2.IMREAD_UNCHANGED), image)
    with pytest.raises(OptionError, match="`input_fps`"):
        convert_part(tmp_path / "in", tmp_path / "more", "0.1", encoding=None)
    summary = convert_part(tmp_path / "in", tmp_path / "more", "0.1", input_fps=25, encoding=None)
    assert summary.frames_in == 5
    with pytest.raises(InputError, match="has 8 images and ends before `start`"):
        trim_source(open_source(str(tmp_path / "in")), trim("8f"))


def test_a_part_of_a_pipe(fpsboost_, tmp_path, monkeypatch):
    """What comes in is counted, what lies outside is passed over."""
    (tmp_path / "in.y4m").write_bytes(stream_of(20))
    with (tmp_path / "in.y4m").open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        result = fpsboost_("-", "out.mp4", "--start", "0.2", "--end", "10f", "-m", "nearest", "--preset", "ultrafast")
    assert result.code == 0
    assert len(pictures_of(tmp_path / "out.mp4")) == 10


def test_a_clock_of_milliseconds_hides_no_frame(tmp_path):
    """Matroska puts frames of 1/30 s up to a millisecond off; whole seconds are whole seconds all the same."""
    clock = {"time_base": Fraction(1, 1000), "rate": Fraction(30)}
    clip, late = (
        write_clip(tmp_path / f"{first}.mkv", times=[first, 33, 67, 100, 133, 167, 200, 233], **clock)
        for first in (0, 1)
    )
    for path in (clip, late):
        times, _, source = frames_of(path, trim("0.1", "0.2"))
        assert times == [0, Fraction(33, 1000), Fraction(67, 1000)]
        assert source.window.skipped == 3


def test_looking_for_the_start_damages_nothing(tmp_path):
    """What does not decode where a seek leads first is counted once, as where every frame is read."""
    clip = write_clip(tmp_path / "in.mp4", times=range(40), options={"preset": "ultrafast", "g": "10"})
    spoil_packets(clip, [20])
    near, far = (frames_of(clip, trim(start))[2].remarks for start in ("0.04", "1.04"))
    assert far == near
    assert "in.mp4 is damaged: 1 packet" in far[0]


@pytest.mark.parametrize("sound", ["aac", "libopus"])
def test_a_clip_that_only_ends_earlier_begins_as_the_whole_one(tmp_path, sound):
    """With the sound before its first frame, also in Matroska."""
    clip = write_clip(tmp_path / "in.mp4", times=range(20), sound=sound)
    outputs = tmp_path / "whole.mkv", tmp_path / "part.mkv"
    for output, end in zip(outputs, (None, "0.6"), strict=True):
        convert_part(clip, output, None, end)
    whole, part = (packets_of(output, "audio") for output in outputs)
    assert whole[: len(part)] == part
    first, other = (packets_of(output, "video")[0][0] for output in outputs)
    assert first == other
