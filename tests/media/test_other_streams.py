"""What survives of a file beside its pictures: attachments, data, timecodes, subtitles, labels, sound in its place."""

import re
import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import pytest

from fpsboost import DecodeOptions, OutputError, RunOptions, convert
from fpsboost.media.tags import timecode_at
from fpsboost.probing import probe
from fpsboost.timing.position import Position, Trim
from support.conversion_options import FAST, double
from support.video_truth import add_pictures, copy_packets, mux_in_order, packets_of, sound_to_picture, tone, write_clip

LINES = [(0, 100, b"one <b>bold</b> word"), (120, 80, "zwei\nZäune".encode()), (300, 90, b"three")]
WORDS = ["one bold word", "zwei\nZäune", "three"]
FONT = bytes(range(256)) * 5


def write_with(path: Path, add: Any, fill: Any = lambda stream: [], rate: Fraction = Fraction(24)) -> Path:
    """Write ten frames beside a stream that `add` makes of the file and `fill` makes packets for."""
    with av.open(str(path), "w") as output:
        video, packets = add_pictures(output, rate=rate)
        output.mux([*packets, *fill(add(output, video))])
    return path


def messages(stream: Any, contents: Sequence[bytes] = (b"message 0", b"message 1", b"message 2")) -> list[Any]:
    """Packets of anything, one every 100 ms."""
    packets = [av.Packet(content) for content in contents]
    for index, packet in enumerate(packets):
        packet.stream, packet.time_base, packet.pts, packet.dts = stream, Fraction(1, 1000), 100 * index, 100 * index
        packet.duration = 100
    return packets


def streams_of(path: Path) -> list[tuple[str, dict[str, str], int]]:
    """Kind, labels in lower case and disposition of every stream."""
    with av.open(str(path)) as file:
        return [
            (each.type, {key.lower(): value for key, value in each.metadata.items()}, int(each.disposition))
            for each in file.streams
        ]


# ------------------------------------------------------------------------------------------------- attachments and data


def test_attachments_go_along(tmp_path):
    """A font keeps its bytes, name and type in Matroska, and is named where it cannot be held."""
    clip = write_with(tmp_path / "in.mkv", lambda output, video: output.add_attachment("Sans.ttf", "font/ttf", FONT))
    assert double(clip, tmp_path / "out.mkv") == []
    with av.open(str(tmp_path / "out.mkv")) as file:
        fonts = [(each.name, each.mimetype, each.data) for each in file.streams if each.type == "attachment"]
    assert fonts == [("Sans.ttf", "font/ttf", FONT)]
    target = tmp_path / "out.mp4"
    assert double(clip, target) == [
        f"{target} does not hold stream 1 (attachment, Sans.ttf) of its source; write .mkv to keep it."
    ]


@pytest.mark.parametrize(("output", "kept"), [("out.mkv", "file"), ("out.mp4", "only the pictures")])
def test_what_is_not_held_is_not_listed_as_kept(fpsboost_, tmp_path, output, kept):
    """Before a conversion it is said that a font would be lost, and it is not among what is kept."""
    write_with(tmp_path / "in.mkv", lambda file, video: file.add_attachment("Sans.ttf", "font/ttf", FONT))
    said = fpsboost_("in.mkv", output, "--method", "nearest", "--no-cuts", "--dry-run").out
    assert re.search(r"keeps +(.*?) *\n", said)[1] == kept
    lost = f"{output} would not hold stream 1 (attachment, Sans.ttf) of its source; write .mkv to keep it."
    assert (lost in said) == (output == "out.mp4")


def test_data_goes_along_where_it_is_known_again(tmp_path):
    """A camera's measurements keep bytes and times in mp4 and mov, and are named where they cannot be held."""

    def add(output: Any, video: Any) -> Any:
        stream = output.add_data_stream("bin_data")  # as GoPro's gpmd
        stream.time_base = Fraction(1, 1000)
        return stream

    clip = write_with(tmp_path / "in.mp4", add, messages)
    for suffix in (".mp4", ".mov"):
        assert double(clip, tmp_path / f"out{suffix}") == []
        assert packets_of(tmp_path / f"out{suffix}", "data") == packets_of(clip, "data")
        assert [data for _, data in packets_of(clip, "data")] == [b"message 0", b"message 1", b"message 2"]
    target = tmp_path / "out.mkv"
    assert double(clip, target) == [
        f"{target} does not hold stream 1 (data, bin_data) of its source; write .mp4 or .m4v or .mov to keep it."
    ]
    assert [each.carries_over for each in probe(str(clip)).streams] == [True, True]


def test_other_data_is_named(tmp_path):
    """What no container would know again is left out with its kind."""
    clip = write_with(tmp_path / "in.ts", lambda output, video: output.add_data_stream("klv"), messages)
    for suffix in (".mp4", ".mov", ".mkv"):
        target = tmp_path / f"out{suffix}"
        assert double(clip, target) == [
            f"{target} does not hold stream 1 (data, klv) of its source; none of the containers written here does."
        ]


def test_a_timecode_counts_at_the_new_rate(tmp_path):
    """The same moment at twice the frames, in mov, mp4 and Matroska and through all of them."""

    def add(output: Any, video: Any) -> None:
        video.metadata["timecode"] = "01:02:03:12"

    clip = write_with(tmp_path / "in.mov", add)
    assert [kind for kind, *_ in streams_of(clip)] == ["video", "data"]
    for source, target in (("in.mov", "a.mov"), ("in.mov", "b.mp4"), ("in.mov", "c.mkv"), ("c.mkv", "d.mp4")):
        assert double(tmp_path / source, tmp_path / target) == []
        streams = streams_of(tmp_path / target)
        assert streams[0][1]["timecode"] == ("01:02:03:48" if target == "d.mp4" else "01:02:03:24")
        assert [kind for kind, *_ in streams] == (["video"] if target == "c.mkv" else ["video", "data"])
    remarks = convert(str(clip), str(tmp_path / "fast.mov"), factor=20, method="nearest", encoding=FAST).remarks
    assert remarks == [
        f"{tmp_path / 'fast.mov'} lost the timecode 01:02:03:12 of its source, which its rate cannot count."
    ]


@pytest.mark.parametrize(("flags", "rate", "says"), [(0, 30, "00:00:20:88"), (1, 24, None)])
def test_a_timecode_counts_at_its_own_rate(tmp_path, flags, rate, says):
    """That of its track, which may be half of the pictures'; one that nobody can count is said to be lost."""
    clip = write_with(tmp_path / "in.mov", lambda _, video: video.metadata.update(timecode="00:00:10:22"), rate=60)
    data = bytearray(clip.read_bytes())
    at = next(place for place in range(len(data)) if re.match(rb"(?s)stsd.{12}tmcd", data[place : place + 20]))
    struct.pack_into(">3IB", data, at + 32, flags, rate * 1000, 1000, rate)
    clip.write_bytes(data)
    target = tmp_path / "out.mkv"
    lost = [f"{target} lost the timecode of stream 1 of its source, which its rate cannot count."]
    assert double(clip, target) == ([] if says else lost)
    assert streams_of(target)[0][1].get("timecode") == says


@pytest.mark.parametrize(
    ("timecode", "old", "new", "expected"),
    [
        ("00:00:00:00", 24, 48, "00:00:00:00"),
        ("10:59:59:23", 24, 60, "10:59:59:57"),
        ("01:00:00;29", Fraction(30000, 1001), Fraction(60000, 1001), "01:00:00;58"),
        ("01:00:00;02", Fraction(30000, 1001), 50, None),
        ("01:00:00:30", 25, 50, None),
        ("01:00:00:00", 25, 1000, None),
        ("nonsense", 25, 50, None),
    ],
)
def test_timecodes(timecode, old, new, expected):
    """Frames are counted anew, drop-frame only where it exists, and nothing is made up."""
    assert timecode_at(timecode, Fraction(old), Fraction(new)) == expected


# ------------------------------------------------------------------------------------------------------------ subtitles


@pytest.mark.parametrize(("rate", "separator", "dropped"), [(30000, ";", 2), (60000, ";", 4), (30000, ":", 0)])
def test_timecodes_go_on_frame_by_frame(rate, separator, dropped):
    """Through minutes that leave out numbers and those that do not, one after the other, and past midnight."""
    rate = Fraction(rate, 1001)
    per_second = round(rate)
    every = [
        f"{minute // 60:02d}:{minute % 60:02d}:{second:02d}{separator}{frame:02d}"
        for minute in range(12)
        for second in range(60)
        for frame in range(dropped if second == 0 and minute % 10 else 0, per_second)
    ]
    for first in (0, 1234):
        assert every[first:] == [timecode_at(every[first], rate, rate, count) for count in range(len(every) - first)]
    assert timecode_at(f"23:59:59{separator}{per_second - 1}", rate, rate, 3) == every[2]


def test_a_timecode_goes_along_with_the_start(tmp_path):
    """A part that begins later says a later timecode, counted at the new rate."""
    clip = write_with(tmp_path / "in.mov", lambda _, video: video.metadata.update(timecode="01:02:03:22"))
    for start in ("3f", "0.12"):
        part = Trim(Position.parse(start, "--start"))
        convert(
            str(clip),
            str(tmp_path / "out.mov"),
            method="nearest",
            encoding=FAST,
            decoding=DecodeOptions(trim=part),
            run=RunOptions(overwrite=True),
        )
        assert streams_of(tmp_path / "out.mov")[0][1]["timecode"] == "01:02:04:02"


def shown(path: Path) -> list[tuple[int, int, str]]:
    """Start and length in milliseconds, and words, of every line of the first subtitles."""
    lines = []
    with av.open(str(path)) as file:
        for packet in file.demux(next(each for each in file.streams if each.type == "subtitle")):
            times = [round(1000 * each * packet.time_base) for each in (packet.pts or 0, packet.duration or 0)]
            words = [line.dialogue.decode() for line in packet.decode()] if packet.size else []
            lines += [(*times, re.sub(r"\{\\[^}]*\}", "", "".join(words)))] if words else []
    return lines


@pytest.mark.parametrize(
    ("suffix", "codec"), [(".mp4", "mov_text"), (".mov", "mov_text"), (".webm", "webvtt")], ids=str
)
def test_text_becomes_the_text_of_the_container(tmp_path, suffix, codec):
    """Words and times stay, and so they do on the way back; both is said."""
    clip = write_clip(tmp_path / "in.mkv", subtitles=LINES)
    expected = [(start, length, words) for (start, length, _), words in zip(LINES, WORDS, strict=True)]
    assert shown(clip) == expected
    target, back = tmp_path / f"out{suffix}", tmp_path / "back.mkv"
    assert double(clip, target) == [
        f"{target} holds stream 1 (subrip subtitles) of its source as {codec}; styles may differ."
    ]
    assert shown(target) == expected
    remarks = double(target, back)
    assert shown(back) == expected
    if codec == "mov_text":
        assert remarks == [f"{back} holds stream 1 (mov_text subtitles) of its source as subrip; styles may differ."]
    assert [each.carries_over for each in probe(str(clip)).streams] == [True, True]


CUES = {
    "one after the other begins": [(100 * number, 500, b"%d" % number) for number in range(10)],
    "together, three at once": [(0, 300, b"a"), (0, 100, b"b"), (50, 250, b"c"), (300, 50, b"d"), (301, 0, b"e")],
    "for hours": [(0, 9_000_000, b"long"), (50, 100, b"<i>a</i>"), (150, 100, b"b"), (8_000_000, 100, b"c")],
    "more than a text holds": [(0, 300, b"a" * 40_000), (100, 100, b"b" * 40_000)],
}


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm"])
@pytest.mark.parametrize("name", CUES)
def test_cues_that_overlap_keep_their_times(tmp_path, name, suffix):
    """One text of all lines shown at a time in mp4 and mov, each cue for itself elsewhere; lines lost are said."""
    cues = CUES[name]
    source, target = write_clip(tmp_path / "in.mkv", subtitles=cues), tmp_path / f"out{suffix}"
    lost = [remark for remark in double(source, target) if " lost lines of stream 1 " in remark]
    result = shown(target)
    if suffix in (".mkv", ".webm"):
        assert result == shown(source)
        return
    moments = {start + part * length // 2 for start, length, _ in cues for part in range(3)} - {301}  # of no length
    for moment in sorted(moments):
        expected, lines = (
            [words for start, length, words in texts if start <= moment < start + length]
            for texts in (shown(source), result)
        )
        assert "\n".join(lines) == "\n".join(expected[-1:] if name.startswith("more") else expected)
    assert bool(lost) == name.startswith("more")


def test_ticks_of_nanoseconds_do_not_move_cues(tmp_path):
    """A Matroska clock too fine for an mp4 track gives cues their times all the same."""
    million = 10**6
    lines = [(0, 100 * million, b"a"), (3000 * million, 100 * million, b"b")]
    times = [40 * million * number for number in range(5)]
    clip = write_clip(tmp_path / "in.mkv", times=times, time_base=Fraction(1, 1000), rate=Fraction(25), subtitles=lines)
    data = clip.read_bytes()
    assert data.count(b"\x2a\xd7\xb1\x83\x0f\x42\x40") == 1  # TimestampScale
    clip.write_bytes(data.replace(b"\x2a\xd7\xb1\x83\x0f\x42\x40", b"\x2a\xd7\xb1\x83\0\0\x01"))
    double(clip, tmp_path / "out.mp4")
    assert shown(tmp_path / "out.mp4") == [(0, 100, "a"), (3000, 100, "b")]


def test_pictures_of_text_are_no_text(tmp_path):
    """What mp4 cannot hold and nothing can convert is refused before any frame is read."""
    clip = write_with(tmp_path / "in.mkv", lambda output, video: output.add_mux_stream("hdmv_pgs_subtitle"), messages)
    with pytest.raises(
        OutputError, match=r"cannot hold the .*pgs.* subtitles of .*; write .mkv, or .* `subtitles=False`"
    ):
        double(clip, tmp_path / "out.mp4")
    assert double(clip, tmp_path / "out.mkv") == []
    assert packets_of(tmp_path / "out.mkv", "subtitle") == packets_of(clip, "subtitle")
    assert not probe(str(clip)).streams[1].carries_over

    def beside_text(output: Any, video: Any) -> Any:
        output.add_mux_stream("subrip")
        return output.add_mux_stream("hdmv_pgs_subtitle")

    clip = write_with(tmp_path / "both.mkv", beside_text, messages)
    remarks = double(clip, tmp_path / "both.mp4")
    assert any(
        re.search(r"pgs.* subtitles of .*; stream 2 was left out; to keep it, write .mkv.$", each) for each in remarks
    )
    assert [kind for kind, *_ in streams_of(tmp_path / "both.mp4")] == ["video", "subtitle"]


CAPTIONS = [b"\x14\x20\x14\x70One\0\x14\x2f", b"\x14\x20\x14\x70Two\0\x14\x2f", b"\x14\x2c\x14\x25\x14\x70up"]
"""Commands and letters of CEA-608: two captions that are loaded and then shown at once, and one that is painted."""


def closed_captions(stream: Any) -> list[Any]:
    """Packets of pairs of bytes of the first field, with odd parity."""
    odd = bytes(code | (code.bit_count() + 1) % 2 << 7 for code in range(128))
    pairs = [[text[at : at + 2].translate(odd + bytes(128)) for at in range(0, len(text), 2)] for text in CAPTIONS]
    return messages(stream, [b"".join(b"\xfc" + pair for pair in each) for each in pairs])


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".webm"])
def test_closed_captions_are_shown_when_they_were(tmp_path, suffix):
    """Each at its own time, though a decoder gives it with the next one, the last one too, and in a part as well."""
    clip = write_with(tmp_path / "in.mov", lambda output, video: output.add_mux_stream("eia_608"), closed_captions)
    double(clip, tmp_path / f"out{suffix}")
    assert shown(tmp_path / f"out{suffix}") == [(0, 100, "One"), (100, 100, "Two"), (200, 100, "up")]
    part = DecodeOptions(trim=Trim(Position.parse("0.125", "--start"), Position.parse("0.25", "--end")))
    convert(str(clip), str(tmp_path / f"part{suffix}"), method="nearest", decoding=part)
    assert shown(tmp_path / f"part{suffix}") == [(0, 75, "Two"), (75, 50, "up")]


# --------------------------------------------------------------------------------------------------------------- labels


def test_labels_survive_two_changes_of_container(tmp_path):
    """Title, chapters, languages, names and roles arrive from mp4 over Matroska in mp4."""
    start = tmp_path / "in.mp4"
    with av.open(str(start), "w") as output:
        output.metadata["title"] = "Cranes"
        second = Fraction(1, 1000)
        chapters = [("opening", 0, 160), ("rest", 160, 400)]
        output.set_chapters(
            [
                {"id": number, "start": begin, "end": end, "time_base": second, "metadata": {"title": title}}
                for number, (title, begin, end) in enumerate(chapters, 1)
            ]
        )
        _, packets = add_pictures(output)
        sounds = [output.add_stream("aac", rate=48000) for _ in range(2)]
        for sound, language, title, role in zip(sounds, ("fra", "deu"), ("main", "remarks"), (1, 0), strict=True):
            sound.metadata.update({"language": language, "title": title})
            sound.disposition = role
        mux_in_order(output, packets + [packet for sound in sounds for packet in tone(sound)])
    assert double(start, tmp_path / "over.mkv") == []
    assert double(tmp_path / "over.mkv", tmp_path / "end.mp4") == []
    for path in (tmp_path / "over.mkv", tmp_path / "end.mp4"):
        with av.open(str(path)) as file:
            assert {key.lower(): value for key, value in file.metadata.items()}["title"] == "Cranes"
            found = [
                (each["metadata"]["title"], *(round(1000 * each[end] * each["time_base"]) for end in ("start", "end")))
                for each in file.chapters()
            ]
            assert found == chapters
        labels = [(each["language"], role) for kind, each, role in streams_of(path) if kind == "audio"]
        assert labels == [("fra", 1), ("deu", 0)]
    assert [each["title"] for _, each, _ in streams_of(tmp_path / "over.mkv")[1:]] == ["main", "remarks"]
    assert [each["name"] for _, each, _ in streams_of(tmp_path / "end.mp4")[1:3]] == ["main", "remarks"]
    assert [each.title for each in probe(str(tmp_path / "end.mp4")).streams[1:3]] == ["main", "remarks"]
    sound, ends = (packets_of(path, "audio", 1) for path in (start, tmp_path / "end.mp4"))
    assert [data for _, data in ends] == [data for _, data in sound]
    assert double(start, tmp_path / "straight.mp4") == []
    assert streams_of(tmp_path / "straight.mp4") == streams_of(start)


def element(identifier: str, *contents: bytes) -> bytes:
    """An element of Matroska, whose size takes eight bytes."""
    return bytes.fromhex(identifier) + (1 << 56 | sum(map(len, contents))).to_bytes(8) + b"".join(contents)


def chapter(begin: int, *contents: bytes) -> bytes:
    """A chapter of 100 ms, with an identifier."""
    start, end = (element(name, (10**6 * time).to_bytes(8)) for name, time in (("91", begin), ("92", begin + 100)))
    return element("b6", element("73c4", bytes([1 + begin % 97])), start, end, *contents)


def named(name: bytes, language: bytes = b"eng") -> bytes:
    """A name of a chapter."""
    return element("80", element("85", name), element("437c", language))


FIRST, SECOND = chapter(0, named(b"a")), chapter(200, named(b"b"))


@pytest.mark.parametrize(
    ("editions", "unread"),
    [
        ([element("45b9", FIRST, SECOND)], ""),
        ([element("45b9", chapter(0, named(b"a"), chapter(50, named(b"c"))), SECOND)], "1 of 3 chapters"),
        ([element("45b9", FIRST, SECOND), element("45b9", FIRST)], "1 of 3 chapters"),
        ([element("45b9", chapter(0), chapter(200, named(b"b"), named(b"c")))], "second names"),
        ([element("45b9", chapter(0, named(b"a", b"fra")), SECOND)], "languages"),
        ([element("45b9", FIRST, chapter(200, element("98", b"\1")))], "flags of hidden chapters"),
        ([element("45b9", element("45dd", b"\1"), FIRST, SECOND)], "the order of editions"),
    ],
)
def test_what_ffmpeg_does_not_read_of_chapters_is_said(tmp_path, editions, unread):
    """Chapters of Matroska inside others and of further editions, names, languages, flags; `probe` says an order."""
    long = {"id": 1, "start": 0, "end": 200, "time_base": Fraction(1, 1000), "metadata": {"title": "x" * 2000}}
    clip = copy_packets(write_clip(tmp_path / "plain.mkv"), tmp_path / "in.mkv", chapters=[long])
    data = clip.read_bytes()
    size = data.rindex(b"\x10\x43\xa7\x70", 0, data.index(b"x" * 2000)) + 4  # of two bytes
    begin, end = size + 2, size + 2 + (int.from_bytes(data[size : size + 2]) & 0x3FFF)
    void = bytes(end - begin - sum(map(len, editions)) - 9)
    clip.write_bytes(b"".join([data[:begin], *editions, element("ec", void), data[end:]]))
    said = " ".join([*probe(str(clip)).remarks, *double(clip, tmp_path / "out.mkv")])
    assert (f"lost the parts of its source's chapters that FFmpeg cannot read: {unread}." in said) == bool(unread)
    assert said.count(f"{clip} has ordered chapters") == (2 if unread == "the order of editions" else 0)


# ----------------------------------------------------------------------------------------------- where the sound stands


def write_sound(path: Path, sound_start: int, video_start: int, sound_first: bool = False, size: int = 19200) -> Path:
    """Write picture and sound that start at their own times, samples of 48 kHz and frames of 25 a second."""
    with av.open(str(path), "w") as output:
        sound = output.add_stream("aac", rate=48000) if sound_first else None
        _, packets = add_pictures(output, start=video_start)
        sound = sound or output.add_stream("aac", rate=48000)
        mux_in_order(output, packets + tone(sound, sound_start, size))
    return path


@pytest.mark.parametrize("sound_first", [True, False], ids=["sound first", "video first"])
@pytest.mark.parametrize(
    ("sound_start", "video_start"),
    [(0, 0), (24000, 0), (0, 25), (-2048, 0)],
    ids=["together", "late", "early", "minus"],
)
def test_sound_stays_beside_its_pictures(tmp_path, sound_start, video_start, sound_first):
    """Whichever comes first in the file or in time: same packets, same times against the pictures."""
    clip = write_sound(tmp_path / "in.mp4", sound_start, video_start, sound_first=sound_first)
    for suffix in (".mp4", ".mov", ".mkv"):
        target = tmp_path / f"out{suffix}"
        assert double(clip, target) == []
        before, after = packets_of(clip, "audio"), packets_of(target, "audio")
        assert [data for _, data in after] == [data for _, data in before]
        assert abs(sound_to_picture(target) - sound_to_picture(clip)) <= (Fraction(1, 500) if suffix == ".mkv" else 0)


@pytest.mark.parametrize(("name", "sound"), [("in.mkv", "alac"), ("in.ogv", "libopus")])
def test_sound_is_whole_where_its_container_says_less(tmp_path, name, sound):
    """The last packet where there are no durations, and what decoders are to skip, which Ogg puts before 0."""
    clip = write_clip(tmp_path / name, codec="libx264" if name == "in.mkv" else "libvpx", sound=sound)
    double(clip, tmp_path / "out.mp4")
    before, after = packets_of(clip, "audio"), packets_of(tmp_path / "out.mp4", "audio")
    assert [data for _, data in after] == [data for _, data in before]
    assert abs(after[0][0] - before[0][0]) < Fraction(1, 1000)


def test_sound_that_an_edit_list_hides_is_not_heard(tmp_path):
    """In mp4 and mov it stays hidden; Matroska, which hides none, gets what decoders need to begin with."""
    clip = write_sound(tmp_path / "in.mp4", -96000, 0, size=120_000)
    for suffix in (".mp4", ".mov", ".mkv"):
        target = tmp_path / f"out{suffix}"
        assert double(clip, target) == []
        hidden = sound_to_picture(target)
        assert (0 < hidden < Fraction(1, 5)) if suffix == ".mkv" else (hidden > 1)


# ----------------------------------------------------------------------------------------------------------------- tags

CAMERA = {
    "com.apple.quicktime.make": "Apple",
    "com.apple.quicktime.model": "iPhone 15",
    "com.apple.quicktime.software": "17.4",
    "com.apple.quicktime.creationdate": "2024-05-06T07:08:09+0200",
    "com.apple.quicktime.location.ISO6709": "+48.1351+011.5820+520.000/",
}


def tags_of(path: Path) -> dict[str, str]:
    """The tags of a file in lower case."""
    with av.open(str(path)) as file:
        return {key.lower(): value for key, value in file.metadata.items()}


def write_tags(path: Path, tags: dict[str, str], languages: Sequence[str] = (), **options: str) -> Path:
    """Write two frames with tags, and silence in some languages."""
    with av.open(str(path), "w", container_options=options) as output:
        output.metadata.update(tags)
        _, packets = add_pictures(output, 2, rate=5)
        sounds = [output.add_stream("aac", rate=48000) for _ in languages]
        for sound, language in zip(sounds, languages, strict=True):
            sound.metadata["language"] = language
        mux_in_order(output, packets + [packet for sound in sounds for packet in tone(sound)])
    return path


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm"])
def test_what_a_phone_says_goes_along(tmp_path, suffix):
    """Make, model, software, date and place arrive in every container, word by word."""
    tags = {**CAMERA, "creation_time": "2024-05-06T05:08:09.000000Z"}
    clip = write_tags(tmp_path / "in.mov", tags, movflags="use_metadata_tags")
    assert double(clip, tmp_path / f"out{suffix}") == []
    found = tags_of(tmp_path / f"out{suffix}")
    assert {key: found.get(key.lower()) for key in CAMERA} == CAMERA
    assert found["creation_time"].startswith("2024-05-06T05:08:09")


def test_what_a_camera_says_changes_containers(tmp_path):
    """QuickTime's own make, model and place arrive in .mp4, a title stays where players look for it without them."""
    tags = {"make": "Canon", "model": "R5", "location": "+48.1351+011.5820/", "date": "2024-05-06", "title": "Cranes"}
    clip = write_tags(tmp_path / "in.mov", tags)
    for target in ("a.mp4", "b.mkv"):
        assert double(clip, tmp_path / target) == []
    assert double(tmp_path / "b.mkv", tmp_path / "c.mp4") == []
    for target in ("a.mp4", "b.mkv", "c.mp4"):
        assert {key: tags_of(tmp_path / target).get(key) for key in tags} == tags
    plain = write_tags(tmp_path / "plain.mkv", {"title": "Cranes", "software": "Lavf59.27.100"})
    assert double(plain, tmp_path / "plain.mp4") == []
    assert b"\xa9nam" in (tmp_path / "plain.mp4").read_bytes()


def test_tags_without_a_place_are_said(tmp_path):
    """What mp4 has no key for is named; what only described the old file is dropped in silence."""
    clip = write_tags(tmp_path / "in.mkv", {"title": "Cranes", "DIRECTOR": "Ana", "totalframes": "7"})
    target = tmp_path / "out.mp4"
    assert double(clip, target) == [
        f"{target} lost tags of its source, which its container has no place for: DIRECTOR."
    ]
    assert "totalframes" not in tags_of(target)


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_texts_that_are_not_utf_8_are_read(tmp_path, suffix):
    """Bytes of another encoding become U+FFFD in titles of files and chapters, and stop nothing."""
    clip, target = write_clip(tmp_path / "in.mp4", title="Kräne", chapters=True), tmp_path / f"out{suffix}"
    data = clip.read_bytes()
    assert data.count(b"Kr\xc3\xa4ne") == 1
    clip.write_bytes(data.replace(b"Kr\xc3\xa4ne", b"Kr\xe4\xe4ne").replace(b"opening", b"open\xe4ng"))
    assert double(clip, target) == []
    assert tags_of(target)["title"] == "Kr\ufffd\ufffdne"
    with av.open(str(target)) as file:
        assert [chapter["metadata"]["title"] for chapter in file.chapters()] == ["open\ufffdng"]


@pytest.mark.parametrize(
    ("suffix", "expected"),
    [
        (".mp4", ["spa", "deu", "por", "zho"]),
        (".mov", ["spa", "ger", "por", "chi"]),
        (".mkv", ["spa", "deu", "pt-BR", "zh-Hans"]),
    ],
)
def test_languages_get_three_letters(tmp_path, suffix, expected):
    """Two letters become what the container wants, and .mov the spelling that it knows; lost regions are said."""
    clip, target = write_tags(tmp_path / "in.mkv", {}, ["es", "deu", "pt-BR", "zh-Hans"]), tmp_path / f"out{suffix}"
    assert double(clip, target) == [
        f"{target} lost the language {language} of stream {index} of its source."
        for index, language in ((3, "pt-BR"), (4, "zh-Hans"))
        if suffix != ".mkv"
    ]
    assert [
        labels["language"] for kind, labels, _ in streams_of(tmp_path / f"out{suffix}") if kind == "audio"
    ] == expected


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_a_region_that_ffmpeg_does_not_read_is_said(tmp_path, suffix):
    """Matroska's element for it is read from the file, and the three letters beside it are kept."""
    clip, target = tmp_path / "in.mkv", tmp_path / f"out{suffix}"
    with av.open(str(clip), "w") as output:
        _, packets = add_pictures(output)
        sound = output.add_stream("aac", rate=48000)
        sound.metadata.update({"language": "por", "title": "region"})
        mux_in_order(output, packets + tone(sound))
    data = clip.read_bytes()
    assert data.count(b"Sn\x86region") == 1
    clip.write_bytes(data.replace(b"Sn\x86region", b"\x22\xb5\x9d\x85pt-BR"))  # in place of its title
    assert double(clip, target) == [f"{target} lost the language pt-BR of stream 1 of its source."]
    assert streams_of(target)[1][1]["language"] == "por"


def test_lost_labels_are_said(tmp_path):
    """A language that the container cannot say is named with its stream."""
    clip = write_tags(tmp_path / "in.mkv", {}, ["Klingon", "bre"])
    target = tmp_path / "out.mov"
    assert double(clip, target) == [
        f"{target} lost the language Klingon of stream 1 of its source.",
        f"{target} lost the language bre of stream 2 of its source.",
    ]


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_labels_are_those_of_the_same_stream(tmp_path, suffix):
    """A picture or a font before the sound, which other containers keep elsewhere, takes no label from it."""
    clip = tmp_path / "in.mp4"
    with av.open(str(clip), "w") as output:
        _, packets = add_pictures(output)
        packets += add_pictures(output, 1, codec="png", pixel_format="rgb24")[1]
        sound = output.add_stream("aac", rate=48000)
        sound.metadata["language"] = "fra"
        mux_in_order(output, packets + tone(sound))
    assert [kind for kind, *_ in streams_of(clip)] == ["video", "video", "audio"]
    assert double(clip, tmp_path / f"out{suffix}") == []
