"""The rate of a file, where it begins to count, which picture a time belongs to, and what a truncated file holds."""

import re
from fractions import Fraction
from itertools import accumulate, cycle, islice, pairwise, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fpsboost import DecodeOptions, Encoding, convert
from fpsboost.cli.flags import in_flags
from fpsboost.io.video.source import VideoSource
from fpsboost.media.clock import TimedPicture, in_rising_order
from fpsboost.media.frame_rate import measure_rate, nominal_rate
from fpsboost.media.remarks import Damage
from fpsboost.media.reorder_buffer import ReorderBuffer
from fpsboost.probing import probe
from support.video_truth import bytes_of, copy_packets, packets_of, pictures_of, read, sound_to_picture, write_clip

MILLISECOND = Fraction(1, 1000)
WRAP = Fraction(2**33, 90_000)  # seconds after which the clock of a transport stream begins anew
FAST = Encoding(encoder_options=(("preset", "ultrafast"),))


def write_at(path: Path, start: Fraction, video_later: Fraction = Fraction(0), codec: str = "mpeg2video") -> Path:
    """Write ten pictures at 25 a second, B-frames among them, and sound that begins at `start`."""

    def begin_later(number: int, packet: Any) -> None:
        later = start + (video_later if packet.stream.type == "video" else 0)
        packet.pts += round(later / packet.time_base)
        packet.dts += round(later / packet.time_base)

    clip = write_clip(path.with_suffix(".mov"), codec=codec, options={"bf": "2"}, sound="mp2")
    return copy_packets(clip, path, begin_later)


@pytest.mark.parametrize(
    ("name", "start", "video_later"),
    [
        ("in.ts", Fraction(36_000), Fraction(0)),
        ("in.ts", Fraction(36_000), Fraction(1, 2)),
        ("in.mpg", Fraction(36_000), Fraction(0)),
        ("in.mkv", Fraction(500), Fraction(0)),
        ("in.ts", WRAP - 2, Fraction(0)),
        ("in.ts", WRAP - Fraction(8, 5), Fraction(0)),
        ("in.ts", WRAP - Fraction(8, 5), Fraction(1, 2)),
    ],
    ids=["ten hours", "sound first", "program stream", "matroska", "wraps soon", "wraps within", "wraps between"],
)
def test_a_clip_begins_where_its_file_begins(tmp_path, name, start, video_later):
    """Whatever a transmitter's clock says: at 0, sound and picture as far apart as they were, and no word about it."""
    clip = write_at(tmp_path / name, start, video_later, "mpeg2video" if name != "in.mkv" else "libx264")
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=FAST)
    assert (summary.frames_in, summary.frames_out, summary.remarks) == (10, 20, [])
    out = pictures_of(tmp_path / "out.mp4")
    first = min(out[0].pts * Fraction(out[0].time_base), packets_of(tmp_path / "out.mp4", "audio")[0][0])
    assert abs(first) < Fraction(1, 10)
    apart = sound_to_picture(clip)
    if abs(apart) > WRAP / 2:
        apart += WRAP if apart < 0 else -WRAP
    assert abs(sound_to_picture(tmp_path / "out.mp4") - apart) <= Fraction(1, 500)
    assert len(packets_of(tmp_path / "out.mp4", "audio")) == len(packets_of(clip, "audio"))


def test_chapters_and_excerpts_count_from_there(tmp_path):
    """With a late start, chapters move along, and --start counts from the first frame."""
    clip = write_at(tmp_path / "in.mkv", Fraction(500), codec="libx264")
    chapter = {"id": 1, "start": 500_200, "end": 500_400, "time_base": MILLISECOND, "metadata": {}}
    copy_packets(clip, tmp_path / "chapters.mkv", chapters=[chapter])
    with VideoSource(tmp_path / "chapters.mkv") as source:
        first = source.first_time()
        source.skip_to(first + Fraction(3, 25))
        assert next(iter(source)).time <= first + Fraction(3, 25)
    convert(str(tmp_path / "chapters.mkv"), str(tmp_path / "out.mkv"), method="nearest", encoding=FAST)
    with av.open(str(tmp_path / "out.mkv")) as file:
        (found,) = file.chapters()
        assert abs(found["start"] * found["time_base"] - Fraction(1, 5)) < Fraction(1, 10)


def test_what_cannot_be_shown_is_no_beginning(tmp_path):
    """A recording that starts in the middle of a group of pictures begins at its first key frame."""
    clip = write_clip(tmp_path / "whole.ts", times=range(40), options={"preset": "ultrafast", "g": "20", "bf": "0"})
    copy_packets(clip, tmp_path / "in.ts", lambda number, packet: number >= 5)
    frames, remarks = read(tmp_path / "in.ts")
    assert (len(frames), frames[0].time) == (20, 0)
    assert not any("promises" in remark for remark in remarks)


@pytest.mark.parametrize("second", [Fraction(0), Fraction(50_000), Fraction(5)], ids=["back", "far ahead", "behind"])
def test_joined_recordings_go_on(tmp_path, second):
    """Two transport streams, one behind the other: all pictures and all sound, as far apart as in each of them."""
    parts = [write_at(tmp_path / f"{k}.ts", start) for k, start in enumerate((Fraction(36_000), second))]
    clip = tmp_path / "in.ts"
    clip.write_bytes(b"".join(part.read_bytes() for part in parts))
    for path, length in ((clip, None), (parts[0], Fraction(2, 5))):
        with VideoSource(path) as source:
            assert source.info.duration == length
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=FAST)
    assert summary.frames_in == 20
    assert 40 <= summary.frames_out <= 42  # the sound of the first one lasts longer than its pictures
    assert summary.remarks[0] == (
        f"The clock of {clip} jumps at 1 place, as where recordings were joined; pictures, sound and subtitles go on "
        "from there."
    )
    assert not any("promises" in remark for remark in summary.remarks)
    sound = packets_of(tmp_path / "out.mp4", "audio")
    before = [packets_of(part, "audio") for part in parts]
    assert [data for _, data in sound] == [data for part in before for _, data in part]
    assert abs(sound[len(before[0])][0] - sound[0][0] - Fraction(2, 5)) <= Fraction(1, 20)
    gaps = {one - other for (one, _), (other, _) in zip(sound[1:], sound, strict=False)}
    assert max(gaps) - min(gaps) <= Fraction(1, 100)


@pytest.mark.parametrize("name", ["in.avi", "in.mp4", "in.mkv", "in.asf"])
def test_times_follow_the_order_of_showing(tmp_path, name):
    """Where B-frames have the times of decoding, every picture is there, in order, evenly, and nothing is said."""
    options = {"preset": "veryfast", "bf": "3", "b_strategy": "0", "b-pyramid": "strict"}
    how = {"codec": "mpeg4", "options": {"bf": "2"}} if name == "in.avi" else {"options": options}
    whole = write_clip(tmp_path / "whole.mp4", times=range(40), **how)

    def present_when_decoded(number: int, packet: Any) -> None:
        packet.pts = packet.dts = round(Fraction(number, 25) / packet.time_base)

    frames, remarks = read(copy_packets(whole, tmp_path / name, present_when_decoded))
    assert [frame.time - frames[0].time for frame in frames] == [Fraction(number, 25) for number in range(40)]
    assert remarks == []
    assert [bytes_of(frame.original) for frame in frames] == [bytes_of(picture) for picture in pictures_of(whole)]


@given(st.lists(st.integers(-100, 3000) | st.none(), max_size=60), st.integers(1, 100))
def test_no_picture_is_lost(times, interval):
    """Whatever the times: every picture comes out once, in the order of the decoder."""
    order = ReorderBuffer(interval)
    for pts in reversed(times):
        order.expect(pts)
    pictures: list[Any] = [SimpleNamespace(pts=pts) for pts in times]
    ready = [each for picture in pictures for each in order.push(picture)] + order.flush()
    assert all(one is other for one, other in zip(ready, pictures, strict=True))


def test_sound_behind_the_end_ends_no_pictures(tmp_path):
    """Where samples of one stream lie behind the end of a file, all others are read."""
    clip = write_clip(tmp_path / "in.mp4", times=range(60), sound="aac")
    whole = len(packets_of(clip, "audio"))
    data = clip.read_bytes()
    place = data.rindex(b"stco") + 12 + 4 * 20  # of the 20th chunk in the index of the sound, which comes last
    clip.write_bytes(data[:place] + (1 << 30).to_bytes(4) + data[place + 4 :])
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=FAST)
    assert (summary.frames_in, summary.frames_out) == (60, 120)
    assert whole / 2 < len(packets_of(tmp_path / "out.mp4", "audio")) < whole


@pytest.mark.parametrize("sound_seconds", [0.3, 0.5])
@pytest.mark.parametrize("name", ["in.asf", "in.avi", "in.mkv"])
def test_the_last_picture_is_shown_for_one_interval(tmp_path, name, sound_seconds):
    """A header that counts from before the first picture, or to the end of the sound, lengthens no last one."""
    clip = write_clip(tmp_path / name, times=range(2, 12), codec="mpeg4", sound="mp2", sound_seconds=sound_seconds)
    frames, _ = read(clip)
    assert abs(frames[-1].duration - Fraction(1, 25)) <= MILLISECOND


@pytest.mark.slow
def test_an_absurd_rate_is_refused_with_the_ways_out(tmp_path, fpsboost_):
    """24 frames, most of them a millisecond apart, never become 2000, but for someone who says the rate."""
    pauses = (237, 411, 163, 307, 89, 223, 149)
    times = [0, *accumulate(step for pause in pauses for step in (1, 1, pause)), 1594, 1595]
    clip = write_clip(
        tmp_path / "in.asf", times=times, time_base=MILLISECOND, rate=Fraction(1000), size=(16, 16), codec="wmv2"
    )
    refused = fpsboost_(clip, "out.mp4", "-m", "nearest")
    assert refused.code == 1
    (sentence,) = refused.lines
    assert "plays at 1000 frames per second by its clock" in sentence
    assert "--fps 60" in sentence
    assert "--keep-timing" in sentence
    assert in_flags(probe(str(clip)).conversion.refused) in sentence
    for option in (["--fps", "60"], ["--keep-timing"]):
        assert fpsboost_(clip, "out.mp4", "-m", "nearest", "--overwrite", *option).code == 0
        assert len(pictures_of(tmp_path / "out.mp4")) <= 97


INTERVAL = Fraction(1, 25)


def ordered(milliseconds, damage=None):
    """Numbers and times, in milliseconds, of the frames that come out; only the last says that it is the last."""
    timed = [TimedPicture(number, Fraction(time, 1000), INTERVAL) for number, time in enumerate(milliseconds)]
    found = list(in_rising_order(timed, INTERVAL, MILLISECOND, damage or Damage()))
    assert [is_last for _, is_last in found] == [number == len(found) for number in range(1, len(found) + 1)]
    return [(number, int(time * 1000)) for (number, time, _), _ in found]


def test_good_times_pass():
    """Whatever rises comes out as it is, however uneven; a second recording goes on where the first one ends."""
    times = [-40, 0, 1, 2, 500, 90_000, 90_001]
    damage = Damage()
    assert ordered(times, damage) == list(enumerate(times))
    assert damage == Damage()
    times = [*range(0, 400, 40), *range(0, 800, 40), *range(0, 400, 40)]
    assert ordered(times, damage) == list(enumerate(range(0, 1600, 40)))
    assert damage == Damage(jumps=2)


@pytest.mark.parametrize(
    ("times", "expected", "counts"),
    [
        ([0, 40, 80, 70, 160], [0, 40, 80, 120, 160], {"displaced": 1}),
        ([0, 40, 30, 20, 160], [0, 40, 80, 120, 160], {"displaced": 2}),
        ([0, 40, 40, 80], [0, 40, None, 80], {"misplaced": 1}),
        ([0, 40, 20], [0, 40, None], {"misplaced": 1}),
        ([0, 40, 99_000, 120, 160], [0, 40, 80, 120, 160], {"far_ahead": 1}),
        ([99_000, 40, 80], [0, 40, 80], {"far_ahead": 1}),
    ],
    ids=["late", "two late", "no room", "at the end", "far ahead", "first far ahead"],
)
def test_bad_times_are_put_right(times, expected, counts):
    """A frame with a wrong time goes where its neighbours leave room, or is left out, and is counted."""
    damage = Damage()
    assert ordered(times, damage) == [(number, time) for number, time in enumerate(expected) if time is not None]
    assert damage == Damage(**counts)


@given(st.lists(st.integers(-200, 3000), max_size=60))
@example([433, 1434, 434])
def test_times_rise_whatever_comes(times):
    """In any order: times strictly increase, frames keep their order, and each is there or counted."""
    damage = Damage()
    found = ordered(times, damage)
    assert all(one[0] < other[0] and one[1] < other[1] for one, other in pairwise(found))
    assert len(found) + damage.misplaced == len(times)


TICK = Fraction(1, 90_000)
NTSC = Fraction(1000, 1001)


def rate_of(path, times, **how):
    with VideoSource(write_clip(path, times=times, time_base=TICK, rate=Fraction(30), size=(16, 16), **how)) as source:
        return source.info.rate


@pytest.mark.parametrize("count", [10, 400])
def test_a_true_rate_is_taken(tmp_path, count):
    """Frames that jitter around 30 per second, or whose last one lasts long, are at 30."""
    times = [3000 * number + (number * 7) % 5 * 5 for number in range(count)]
    assert rate_of(tmp_path / "jitter.mp4", times) == 30
    assert rate_of(tmp_path / "long.mp4", times, end=times[-1] + 5000) == 30


@pytest.mark.slow
def test_a_clock_that_drifts(tmp_path):
    """A phone that films 29.985 frames per second: its frames pass, up to the last one."""
    times = [round(number * 90_000 / 29.985) for number in range(800)]
    assert float(rate_of(tmp_path / "phone.mp4", times)) == pytest.approx(29.985, abs=1e-4)
    summary = convert(str(tmp_path / "phone.mp4"), str(tmp_path / "out.mp4"), method="nearest", duplicates="keep")
    assert (summary.frames_out, summary.frames_made, summary.remarks) == (1600, 800, [])


@pytest.mark.parametrize("rate", [Fraction(1001), Fraction(1200), 2400 * NTSC, Fraction(30_000)])
def test_a_high_speed_camera_keeps_its_frames(tmp_path, rate):
    """A file of more than 1000 frames per second is at its rate, and so is its conversion when it is read again."""
    clip, out = tmp_path / "in.mov", tmp_path / "out.mp4"
    write_clip(clip, times=range(20), time_base=1 / rate, rate=rate, size=(16, 16))
    summary = convert(str(clip), str(out), method="nearest", duplicates="keep")
    assert (summary.frames_in, summary.frames_out, summary.remarks) == (20, 40, [])
    with VideoSource(out) as source:
        assert source.info.rate == 2 * rate
        assert [frame.time * 2 * rate for frame in source] == list(range(40))


def rate_by(times, tick, guessed=None, average=None):
    """The rate of a stream with these times, of which FFmpeg says so much."""
    stream: Any = SimpleNamespace(guessed_rate=guessed, average_rate=average)
    return nominal_rate(stream, measure_rate(times, tick))[0]


@pytest.mark.parametrize("rate", [24 * NTSC, 24, 25, 30 * NTSC, 30, 50, 60 * NTSC, 60, 120 * NTSC, 120, 144, 15 * NTSC])
@pytest.mark.parametrize("tick", [MILLISECOND, TICK, Fraction(1, 600)], ids=["ms", "90 kHz", "1/600"])
def test_real_times_tell_the_rate(rate, tick):
    """Ten seconds of rounded times give the true rate, whatever the header says."""
    times = [round(number / rate / tick) for number in range(round(10 * rate))]
    for guessed in (Fraction(1000), Fraction(19001, 317), Fraction(4883, 200), None):
        assert rate_by(times, tick, guessed, Fraction(1000)) == rate


@pytest.mark.parametrize("rate", [60 * NTSC, 30 * NTSC, Fraction(25)])
def test_one_interval_changes_nothing(rate):
    """Frames that come a part of a frame late from some moment on, or some frames, are at the rate of all others."""
    for late, place in product([0.16, -0.3, 3.0], [1, 200, 399]):
        times = [round((number + (late if number >= place else 0)) / rate / TICK) for number in range(400)]
        mean = (Fraction(399) / (times[-1] * TICK)).limit_denominator(10_000)
        assert rate_by(times, TICK, rate, mean) == rate
        assert rate_by(times, TICK, mean, mean) == rate


def test_most_intervals_decide_where_the_rate_varies():
    """Pauses and bursts do not count; a rate near a round one is that; few frames are at the rate that is declared."""
    intervals = islice(cycle([16, 16, 15, 16, 300, 16, 15, 1, 17, 120]), 300)
    assert 60 <= rate_by(list(accumulate(intervals)), MILLISECOND, Fraction(1000)) <= 66
    phone = list(accumulate(islice(cycle([33, 33, 34, 33, 41, 33, 34, 33, 42, 33]), 300)))
    assert rate_by(phone, MILLISECOND, Fraction(1000), Fraction(286, 10)) in (30, 30 * NTSC)
    assert rate_by([0], MILLISECOND, Fraction(25)) == 25
    assert rate_by([0, 40], MILLISECOND, Fraction(25)) == 25
    assert rate_by([0, 100], MILLISECOND, Fraction(1000)) == 10
    assert rate_by([], MILLISECOND) == 25


@pytest.mark.parametrize(
    ("kind", "codec", "said", "how"),
    [
        (
            "hevc",
            "libx265",
            None,
            {"options": {"x265-params": "log-level=none:pools=none:frame-threads=1:vui-timing-info=0"}},
        ),
        ("hevc", "libx265", 30, {"options": {"x265-params": "log-level=none:pools=none:frame-threads=1:bframes=0"}}),
        ("h264", "libx264", 120, {"options": {"preset": "ultrafast", "bf": "2"}}),
        ("mpeg1video", "mpeg1video", 30, {"options": {"bf": "2"}}),
        ("dirac", "vc2", 50, {"options": {"b": "20M"}}),
        ("mjpeg", "mjpeg", None, {"pixel_format": "yuvj420p"}),
    ],
)
def test_pictures_of_a_raw_stream_are_counted(tmp_path, kind, codec, said, how):
    """Each lasts as long as the stream or the user says, whatever FFmpeg guesses; a rate that is assumed is told."""
    rate = Fraction(said or 30)
    clip = write_clip(
        tmp_path / f"in.{kind}",
        times=range(70),
        time_base=1 / rate,
        rate=rate,
        codec=codec,
        container=kind,
        **how,
    )
    told = f"{clip} does not say its frame rate; 25 frames per second were assumed; pass `input_fps` to set it."
    for chosen, used, expected in ((None, said or 25, [] if said else [told]), (7, 7, [])):
        frames, remarks = read(clip, DecodeOptions(input_fps=chosen))
        times = [(frame.time, frame.duration) for frame in frames]
        assert (times, remarks) == ([(Fraction(k, used), Fraction(1, used)) for k in range(70)], expected)


def test_pictures_that_a_raw_stream_repeats_last_longer(tmp_path):
    """As where film became television (pulldown): MPEG-2 says so in the header of a picture."""
    clip = write_clip(tmp_path / "in.m2v", codec="mpeg2video", container="mpeg2video")
    header = re.compile(rb"(\x00\x00\x01\xb5[\x80-\x8f]..)(.)", re.DOTALL)
    clip.write_bytes(header.sub(lambda match: match[1] + bytes([match[2][0] | 2]), clip.read_bytes()))
    assert [frame.time for frame in read(clip)[0]] == [Fraction(2 * number, 25) for number in range(10)]


def test_fragments_begin_with_their_first_picture(tmp_path):
    """Those of a stream that has played for a while: at 0, as long as they are, with nothing said to be missing."""
    whole = write_clip(tmp_path / "whole.mp4", times=range(100), options={"preset": "ultrafast", "g": "25", "bf": "0"})
    clip = copy_packets(whole, tmp_path / "in.mp4", movflags="frag_keyframe+empty_moov+default_base_moof")
    data = clip.read_bytes()
    fragments = [match.start() - 4 for match in re.finditer(b"moof", data)]
    clip.write_bytes(data[: fragments[0]] + data[fragments[2] : data.index(b"mfra") - 4])
    with VideoSource(clip) as source:
        assert (source.info.duration, source.info.frame_count) == (2, None)
    frames, remarks = read(clip)
    assert ([frame.time for frame in frames], remarks) == ([Fraction(number, 25) for number in range(50)], [])


def test_flv_without_metadata(tmp_path):
    """24 frames per second in milliseconds, of which the header says nothing, become 48."""
    whole = write_clip(tmp_path / "whole.mp4", times=range(48), time_base=Fraction(1, 24))
    copy_packets(whole, tmp_path / "in.flv", flvflags="no_metadata")
    summary = convert(str(tmp_path / "in.flv"), str(tmp_path / "out.mp4"), method="nearest", duplicates="keep")
    assert (summary.frames_in, summary.frames_out, summary.remarks) == (48, 96, [])
    with VideoSource(tmp_path / "out.mp4") as source:
        assert source.info.rate == 48
