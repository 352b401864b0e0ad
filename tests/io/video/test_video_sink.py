"""VideoSink: exact times, untouched auxiliary streams, whole files or none."""

import itertools
import re
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from fpsboost import ClipInfo, Frame, OptionError, OutputError, Timing, convert
from fpsboost.io.output import Output
from fpsboost.io.video.encode_options import Encoding, parse_bitrate, parse_encoder_options
from fpsboost.io.video.sink import VideoSink
from fpsboost.io.video.source import VideoSource
from fpsboost.media import OutputTiming
from support.conversion_options import FAST, double
from support.video_truth import QUARTER_TURN, bytes_of, packets_of, pictures_of, png, scene, write_clip

LOSSLESS = Encoding(crf=0, preset="ultrafast")
B_FRAMES = Encoding(preset="veryfast")
INFO = ClipInfo("x", 48, 64, Fraction(25), Fraction(1, 25), None)


def write_images(target: Path, images: list[np.ndarray], encoding: Encoding = FAST) -> list[str]:
    """Write images as a clip of 25 frames per second that has no source."""
    height, width = images[0].shape[:2] if images else (48, 64)
    info = ClipInfo("images", height, width, Fraction(25), Fraction(1, 25), len(images))
    timing = OutputTiming(Fraction(25), Fraction(1, 25))
    with VideoSink(Output(str(target), info, timing, encoding=encoding)) as sink:
        for index, image in enumerate(images):
            sink.write(Frame(image, Fraction(index, 25), Fraction(1, 25)))
    return sink.remarks


def facts(path: Path) -> tuple[Fraction, list[Fraction]]:
    """Length of the first video stream as its container tells it, and the times of its frames."""
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        length = stream.duration * Fraction(stream.time_base) if stream.duration else None
        times = sorted(packet.pts * Fraction(packet.time_base) for packet in file.demux(stream) if packet.size)
    return length, times


def only(folder: Path, *names: str) -> bool:
    return sorted(path.name for path in folder.iterdir()) == sorted(names)


@pytest.mark.parametrize("encoding", [FAST, B_FRAMES], ids=["plain", "b-frames"])
@pytest.mark.parametrize("suffix", [".mp4", ".m4v", ".mov"])
def test_doubling_keeps_times_and_length(tmp_path, suffix, encoding):
    """Twice the frames, each exactly halfway, and the stream as long as before."""
    clip = write_clip(tmp_path / "in.mp4", times=range(30), time_base=Fraction(1001, 24000))
    assert double(clip, tmp_path / f"out{suffix}", encoding) == []
    length, times = facts(tmp_path / f"out{suffix}")
    assert length == facts(clip)[0] == 30 * Fraction(1001, 24000)
    assert times == [k * Fraction(1001, 48000) for k in range(60)]
    assert only(tmp_path, "in.mp4", f"out{suffix}")


@pytest.mark.parametrize("encoding", [FAST, B_FRAMES], ids=["plain", "b-frames"])
def test_variable_rate_keeps_length(tmp_path, encoding):
    """Uneven frames, a long last one and reordering still add up to the source's length."""
    times = [0, 3, 4, 9, 10, 16, 17, 18, 30, 31, 32, 40]
    clip = write_clip(tmp_path / "in.mp4", times=times, end=52, time_base=Fraction(1, 100))
    timing = Timing(keep_timing=True)
    convert(str(clip), str(tmp_path / "out.mp4"), timing=timing, method="nearest", encoding=encoding)
    length, found = facts(tmp_path / "out.mp4")
    assert length == Fraction(52, 100)
    pairs = itertools.pairwise([*times, 52])
    assert found == [t for a, b in pairs for t in (Fraction(a, 100), Fraction(a + b, 200))]


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_what_the_picture_means_is_kept(tmp_path, suffix):
    """Orientation, pixel shape, colour tags, title, chapters and language arrive."""
    tags = {"sample_aspect_ratio": Fraction(4, 3), "colorspace": 1, "color_range": 2, "color_primaries": 1}
    clip = write_clip(
        tmp_path / "in.mp4", matrix=QUARTER_TURN, sound="aac", title="Cranes", chapters=True, color_trc=13, **tags
    )
    assert double(clip, tmp_path / f"out{suffix}") == []
    with VideoSource(clip) as before, VideoSource(tmp_path / f"out{suffix}") as after:
        assert after.traits == before.traits
    with av.open(str(tmp_path / f"out{suffix}")) as file:
        assert {key.lower(): value for key, value in file.metadata.items()}["title"] == "Cranes"
        assert [chapter["metadata"]["title"] for chapter in file.chapters()] == ["opening"]
        assert file.streams.audio[0].metadata["language"] == "fra"
        assert len(file.streams.video) == 1


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_sound_of_a_transport_stream_fits_elsewhere(tmp_path, suffix):
    """AAC loses the header that it has only in transport streams, and nothing else."""
    clip = write_clip(tmp_path / "in.ts", sound="aac")
    double(clip, out := tmp_path / f"out{suffix}", FAST)
    assert [data for _, data in packets_of(out, "audio")] == [data[7:] for _, data in packets_of(clip, "audio")]


def test_subtitles_are_copied(tmp_path):
    """Lines keep their words and times, or are left out when that is asked for."""
    lines = [(0, 100, b"one"), (120, 80, b"two"), (300, 90, b"three")]
    clip = write_clip(tmp_path / "in.mkv", subtitles=lines)
    double(clip, tmp_path / "out.mkv")
    expected = [(Fraction(start, 1000), text) for start, _, text in lines]
    assert packets_of(tmp_path / "out.mkv", "subtitle") == expected
    remarks = double(clip, tmp_path / "silent.mp4", Encoding(preset="ultrafast", subtitles=False))
    assert remarks == []
    with av.open(str(tmp_path / "silent.mp4")) as file:
        assert [stream.type for stream in file.streams] == ["video"]


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_cover_art_is_kept(tmp_path, suffix):
    """The attached picture goes along and does not become the video."""
    clip = write_clip(tmp_path / "in.mkv", cover=png(), sound="aac")
    assert double(clip, tmp_path / f"out{suffix}") == []
    with av.open(str(tmp_path / f"out{suffix}")) as file:
        covers = [s for s in file.streams.video if s.disposition & av.stream.Disposition.attached_pic]
        assert [bytes(next(iter(file.demux(cover)))) for cover in covers] == [png()]
    assert packets_of(tmp_path / f"out{suffix}", "audio") == packets_of(clip, "audio")
    assert len(facts(tmp_path / f"out{suffix}")[1]) == 20


@pytest.mark.parametrize("images", [[], [scene(0), scene(0, 64, 64)]], ids=["none", "two sizes"])
def test_what_makes_no_clip_makes_no_file(tmp_path, images):
    """Without frames, or with frames of two sizes, there is an error and not half a video."""
    with pytest.raises(OutputError, match=r"there were no frames|cannot take a frame of 64x64"):
        write_images(tmp_path / "out.mp4", images)
    assert only(tmp_path)


@pytest.mark.parametrize(
    ("encoding", "name", "sentence"),
    [
        (Encoding(codec="h246"), "out.mp4", "`codec='h246'` is neither known here nor .*did you mean 'h264'"),
        (Encoding(codec="aac"), "out.mp4", "`codec='aac'` is neither known here nor"),
        (Encoding(codec="h264"), "out.webm", "cannot go into .*; use vp9 or av1, or write .mp4 or .m4v or .mov"),
        (Encoding(crf=52), "out.mp4", "`crf` must be 0 to 51 for h264, not 52"),
        (Encoding(crf=-1, codec="vp9"), "out.webm", "`crf` must be 0 to 63"),
        (Encoding(preset="turbo"), "out.mp4", "`preset='turbo'` is unknown to h264; choose one of ultrafast"),
        (Encoding(preset="medium", codec="av1"), "out.mp4", "`preset='medium'` is unknown to av1"),
        (Encoding(codec="ffv1", crf=3), "out.mkv", "`crf` means nothing to ffv1"),
        (Encoding(codec="ffv1", bitrate=10**6), "out.mkv", "`bitrate` means nothing to ffv1, which is lossless"),
        (Encoding(codec="av1", lossless=True), "out.mkv", "av1 has no lossless mode for `lossless`; use h264"),
        (
            Encoding(codec="mpeg4", lossless=True),
            "out.mp4",
            "mpeg4 has no lossless mode for `lossless`; use h264, hevc",
        ),
        (Encoding(pixel_format="rgb24"), "out.mp4", "libx264 does not take `pixel_format='rgb24'`; choose one"),
        (Encoding(pixel_format="magic", codec="rawvideo"), "out.mkv", "`pixel_format='magic'` is no pixel format"),
        (Encoding(encoder_options=(("magic", "1"),)), "out.mp4", "`encoder_options=magic` is unknown to libx264"),
        (Encoding(encoder_options=(("aq-mode", "banana"),)), "out.mp4", "check `encoder_options=aq-mode=banana`, or"),
    ],
)
def test_options_that_cannot_work(tmp_path, encoding, name, sentence):
    """Each bad codec, quality or preset is refused with what to use instead, and no file is written."""
    with pytest.raises((OptionError, OutputError), match=sentence):
        write_images(tmp_path / name, [scene(0)], encoding)
    assert only(tmp_path)


LOSSLESS_CASES = [
    *((codec, pixel_format) for codec in ("h264", "hevc", "ffv1") for pixel_format in ("yuv420p", "yuv420p10le")),
    ("vp9", "yuv420p"),
    ("h264", "yuvj420p"),
    ("h264", "yuv444p"),
]


@pytest.mark.parametrize(("codec", "pixel_format"), LOSSLESS_CASES)
def test_lossless_is_lossless(tmp_path, codec, pixel_format):
    """Every sample of every original frame comes back as it was."""
    clip = write_clip(tmp_path / "in.mp4", times=range(4), pixel_format=pixel_format)
    assert double(clip, tmp_path / "out.mkv", Encoding(codec=codec, lossless=True)) == []
    before, after = pictures_of(clip), pictures_of(tmp_path / "out.mkv")
    for k, picture in enumerate(after):
        assert picture.format.name == pixel_format
        assert bytes_of(picture) == bytes_of(before[k // 2])


@pytest.mark.parametrize(
    ("pixel_format", "codec", "suffix"),
    [
        ("yuv444p", None, ".mp4"),
        ("yuvj420p", None, ".mp4"),
        ("yuv420p10le", "hevc", ".mp4"),
        ("yuv422p16le", "ffv1", ".mkv"),
        ("gbrp", "hevc", ".mp4"),
        ("bgr24", "libx264rgb", ".mkv"),
    ],
)
def test_pixel_formats(tmp_path, pixel_format, codec, suffix):
    """The format that was asked for is what comes out, nothing is remarked about it, and colours stay."""
    clip = write_clip(tmp_path / "in.mp4", times=range(4))
    encoding = Encoding(codec=codec, pixel_format=pixel_format, lossless=True)
    assert double(clip, tmp_path / f"out{suffix}", encoding) == []
    with VideoSource(clip) as before, VideoSource(tmp_path / f"out{suffix}") as after:
        assert after.traits.pixel_format == {"bgr24": "gbrp"}.get(pixel_format, pixel_format)
        a, b = next(iter(before)).image, next(iter(after)).image
    scale = 257 if b.dtype == np.uint16 else 1
    assert np.abs(a.astype(float) - b / scale).mean() < 2.5


@pytest.mark.parametrize(("codec", "suffix"), [("h264", ".mp4"), ("hevc", ".mkv"), ("vp9", ".webm"), ("av1", ".mkv")])
def test_bitrates(tmp_path, codec, suffix, capfd):
    """More bits per second make a larger file, with every encoder that has a name, and none prints anything."""
    noise = list(np.random.default_rng(0).integers(0, 256, (12, 128, 128, 3), dtype=np.uint8))
    preset = {"h264": "ultrafast", "hevc": "ultrafast", "vp9": "8", "av1": "12"}[codec]
    sizes = []
    for bitrate in (100_000, 4_000_000):
        target = tmp_path / f"{bitrate}{suffix}"
        write_images(target, noise, Encoding(codec, preset=preset, bitrate=bitrate))
        sizes.append(target.stat().st_size)
        assert len(pictures_of(target)) == 12
    assert sizes[0] < sizes[1]
    assert capfd.readouterr() == ("", "")


def test_options_of_the_encoder(tmp_path):
    """They reach it, also those that all encoders have, and win over what is set otherwise."""
    images = [scene(k, 64, 64) for k in range(12)]
    options = (("g", "3"), ("bf", "0"), ("x264-params", "scenecut=0"), ("crf", "40"))
    write_images(tmp_path / "out.mp4", images, Encoding(encoder_options=options))
    write_images(tmp_path / "better.mp4", images, Encoding(encoder_options=options[:3]))
    assert [picture.key_frame for picture in pictures_of(tmp_path / "out.mp4")] == [True, False, False] * 4
    assert (tmp_path / "out.mp4").stat().st_size < (tmp_path / "better.mp4").stat().st_size


@pytest.mark.parametrize("codec", ["h264_nvenc", "hevc_nvenc", "h264_qsv", "h264_amf", "h264_v4l2m2m"])
def test_hardware_that_is_missing(tmp_path, codec):
    """Where its device is there it encodes; else one sentence says what may be missing, and nothing is written."""
    if codec not in av.codecs_available:
        pytest.skip(f"this FFmpeg has no {codec}")
    try:
        write_images(tmp_path / "out.mp4", [scene(k, 256, 256) for k in range(3)], Encoding(codec=codec))
    except OutputError as error:
        assert re.fullmatch(  # noqa: PT017
            rf".*out\.mp4 cannot be encoded by {codec} .* its device or driver may be missing here; .* `codec`\.",
            str(error),
        )
        assert only(tmp_path)


def test_values_as_people_write_them():
    """Suffixes for thousands and millions; a name, an equals sign and anything behind it; a refusal that shows how."""
    assert [parse_bitrate(text) for text in ("8M", "1.5m", "800k", "64000")] == [8_000_000, 1_500_000, 800_000, 64_000]
    for text in ("", "fast", "8G", "-1M", "1e6", "8 M", "٨M"):
        with pytest.raises(OptionError, match=r"`bitrate` .* write it like 8M"):
            parse_bitrate(text)
    assert parse_encoder_options(["a=b", "x264-params=k=1:l=2"]) == (("a", "b"), ("x264-params", "k=1:l=2"))
    for text in ("a", "=b", "a=", ""):
        with pytest.raises(OptionError, match="key=value"):
            parse_encoder_options([text])


def test_contradictions_are_told():
    """Two aims at once, a rate out of range and one option twice are mistakes."""
    for fields, sentence in (
        ({"crf": 20, "bitrate": 10**6}, "`crf` and `bitrate` cannot be combined"),
        ({"crf": 20, "lossless": True}, "`crf` and `lossless` cannot be combined"),
        ({"bitrate": 10**6, "lossless": True}, "`lossless` and `bitrate` cannot be combined"),
        ({"bitrate": 10}, "`bitrate` must be 1000 to 2000000000 bits per second"),
        ({"encoder_options": (("g", "1"), ("g", "2"))}, "`encoder_options=g` is given twice"),
    ):
        with pytest.raises(OptionError, match=sentence):
            Encoding(**fields)


def test_odd_sizes(tmp_path):
    """H.264 cannot halve an odd size and says what it did instead, but for a format that was asked for; VP9 can."""
    with pytest.raises(OptionError, match=r"`pixel_format='yuv420p'` halves an odd size"):
        write_images(tmp_path / "out.mp4", [scene(0, 47, 63)], Encoding(pixel_format="yuv420p"))
    assert only(tmp_path)
    remarks = write_images(tmp_path / "out.mp4", [scene(0, 47, 63)])
    assert "odd size 63x47 and was written as yuv444p" in remarks[0]
    assert write_images(tmp_path / "out.webm", [scene(0, 47, 63)], Encoding(preset="8")) == []
    for name in ("out.mp4", "out.webm"):
        picture = pictures_of(tmp_path / name)[0]
        assert (picture.width, picture.height) == (63, 47)


def test_lost_pixel_shape_is_said(tmp_path):
    """VP9 in .webm cannot say that pixels are not square."""
    clip = write_clip(tmp_path / "in.mp4", sample_aspect_ratio=Fraction(4, 3))
    assert "lost the pixel shape 4/3" in double(clip, tmp_path / "out.webm", Encoding(preset="8"))[0]


def test_times_must_increase(tmp_path):
    """Two frames on one tick of the clock are refused, as are in Matroska more than a thousand per second."""
    timing = OutputTiming(Fraction(25), Fraction(1, 25))
    with VideoSink(Output(str(tmp_path / "out.mp4"), INFO, timing, encoding=FAST)) as sink:
        sink.write(Frame(scene(0), Fraction(0), Fraction(1, 25)))
        with pytest.raises(OutputError, match="choose a lower rate"):
            sink.write(Frame(scene(0), Fraction(1, 100), Fraction(1, 25)))
    with pytest.raises(OutputError, match="counts time in milliseconds and cannot hold 2500"):
        VideoSink(Output(str(tmp_path / "out.mkv"), INFO, OutputTiming(Fraction(2500), Fraction(1, 2500))))


@pytest.mark.parametrize(
    ("width", "given", "wanted"),
    [
        (48, (), "none:info=0:pools=8:cutree=0 "),
        (64, (), "none:info=0:pools=8 "),
        (48, (("x265-params", "rd=2"),), "none:info=0:pools=8:rd=2:cutree=0 "),
    ],
)
def test_x265_keeps_within_its_memory(tmp_path, width, given, wanted):
    """What it does in narrow pictures beyond their edge is off there, whatever else it is told."""
    clip = write_clip(tmp_path / "in.mp4", times=range(4), size=(48, width))
    encoding = Encoding("hevc", preset="ultrafast", encoder_options=given)
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=encoding)
    assert f"x265-params=log-level={wanted}" in summary.details + " "
    assert len(pictures_of(tmp_path / "out.mp4")) == 8
