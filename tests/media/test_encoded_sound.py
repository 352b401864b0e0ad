"""Sound that a container cannot hold, or that is wanted in another format: encoded anew, in its place and as long."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import Encoding, OptionError, OutputError, RunOptions, convert
from support import conversion_options
from support.conversion_options import FAST
from support.sounds import CLICK, CLICKS, assert_clicks, heard, slow, write_sounds
from support.video_truth import add_pictures, copy_packets, mux_in_order, packets_of, sound_packets, tone, write_clip

RATE = 48000
SAMPLES = RATE + 1234  # of a sound that no encoder's frames divide


def double(source: Path, target: Path, audio_codec: str | None = None) -> list[str]:
    """Convert in the cheapest way, with sound of a codec; return the remarks."""
    return conversion_options.double(source, target, replace(FAST, audio_codec=audio_codec))


def noise(samples: int = SAMPLES) -> NDArray[np.int16]:
    """Noise that sounds alike at no other place, low enough for every encoder."""
    steps = np.random.default_rng(0).normal(size=samples + 400)
    smooth = np.convolve(steps, np.hanning(20), "same")[200:-200]
    return np.rint(smooth / np.abs(smooth).max() * 16000).astype(np.int16)


def write_noise(path: Path, codec: str = "pcm_s16le", rate: int = RATE, packet: int = 960) -> NDArray[np.int16]:
    """Write 25 frames and noise, with the video encoder that every container takes; return the noise."""
    samples = noise()
    with av.open(str(path), "w") as output:
        _, packets = add_pictures(output, 25, codec="mpeg4")
        sound: Any = output.add_stream(codec, rate=rate, layout="mono", bit_rate=96000)
        packets += sound_packets(sound, samples, layout="mono", size=packet)
        mux_in_order(output, packets)
    return samples


def test_aac_without_its_configuration_is_named(tmp_path):
    """The sentence gives the reason, which is not the container, for a file without the packet that describes AAC."""
    with av.open(str(tmp_path / "whole.flv"), "w") as output:
        _, packets = add_pictures(output, 25, codec="flv")
        mux_in_order(output, [*packets, *tone(output.add_stream("aac", rate=44100))])
    data, clip, at = (tmp_path / "whole.flv").read_bytes(), tmp_path / "in.flv", 13
    with clip.open("wb") as file:
        file.write(data[:at])
        while at < len(data):
            tag = data[at : at + 15 + int.from_bytes(data[at + 1 : at + 4])]
            if not (tag[0] == 8 and tag[12] == 0):
                file.write(tag)
            at += len(tag)
    for suffix in (".mp4", ".mkv"):
        with pytest.raises(OutputError, match=r"cannot hold the aac sound of .*, whose headers are missing; encode it"):
            double(clip, tmp_path / f"out{suffix}")
    assert len(double(clip, tmp_path / "out.mp4", "aac")) == 1


def lag(truth: NDArray[Any], found: NDArray[Any]) -> int:
    """How many samples late a sound is."""
    size = 1 << 17
    spectra = np.conj(np.fft.rfft(truth, size)) * np.fft.rfft(found, size)
    place = int(np.argmax(np.fft.irfft(spectra, size)))
    return place if place < size // 2 else place - size


def codec_of_sound(path: Path) -> str:
    with av.open(str(path)) as file:
        return str(file.streams.audio[0].codec_context.codec.canonical_name)


# ---------------------------------------------------------------------------------------------- what muxers really hold


def test_matroska_holds_tta_as_flac(tmp_path):
    """Whole: of TTA in Matroska FFmpeg loses the last packet, unless all streams are as long as it."""
    clip, output = write_clip(tmp_path / "in.mkv", sound="tta", sound_seconds=0.4), tmp_path / "out.mkv"
    assert any("(tta sound) of its source encoded anew as flac" in remark for remark in double(clip, output))
    before, after = (sum(frame.samples for frame in av.open(str(path)).decode(audio=0)) for path in (clip, output))
    assert before == after == 19200


@pytest.mark.parametrize("codec", ["wmav2", "pcm_mulaw", "adpcm_ms", "adpcm_ima_wav"])
def test_matroska_holds_what_its_list_leaves_out(tmp_path, codec):
    """Sound that Matroska names as Windows does is copied into .mkv packet by packet."""
    suffix = ".asf" if codec == "wmav2" else ".avi"
    clip, target = tmp_path / f"in{suffix}", tmp_path / "it's [out] | of.mkv"
    write_noise(clip, codec, 44100 if codec == "wmav2" else RATE)
    assert not [remark for remark in double(clip, target) if "sound" in remark]
    before, after = packets_of(clip, "audio"), packets_of(target, "audio")
    assert [data for _, data in after] == [data for _, data in before]
    assert max(abs(a - b) for (a, _), (b, _) in zip(after, before, strict=True)) <= Fraction(1, 500)
    assert len(packets_of(target, "video")) == 50


def test_chapters_that_do_not_go_along_are_said(tmp_path):
    """What is muxed past the list of codecs loses chapters, and a sentence says so."""
    clip, target = tmp_path / "in.mov", tmp_path / "out.mkv"
    write_clip(tmp_path / "chapters.mp4", sound="aac", chapters=True)
    with av.open(str(tmp_path / "chapters.mp4")) as chapters:
        listed = chapters.chapters()
    write_noise(tmp_path / "sound.mov", "pcm_mulaw")
    copy_packets(tmp_path / "sound.mov", clip, chapters=listed)
    assert double(clip, target) == [
        f"{target} lost the chapters of its source, which its kind of sound rules out here."
    ]


@pytest.mark.parametrize(
    ("codec", "suffix", "ways"),
    [
        ("wmav2", ".mp4", "encode it anew with `audio_codec='aac'`, write .mkv, or leave the sound out"),
        ("aac", ".webm", "encode it anew with `audio_codec='opus'`, write .mp4 or .m4v or .mov or .mkv, or leave"),
    ],
)
def test_what_cannot_be_held_names_the_option_first(tmp_path, codec, suffix, ways):
    """Encoding anew, then other containers, then leaving out; before any frame is read."""
    clip = tmp_path / ("in.asf" if codec == "wmav2" else "in.mp4")
    write_noise(clip, codec, 44100)
    with pytest.raises(OutputError, match=f"cannot hold the {codec} sound of .*; {ways}"):
        double(clip, tmp_path / f"out{suffix}", "copy")
    assert not (tmp_path / f"out{suffix}").exists()


# ---------------------------------------------------------------------------- sound that nobody can decode, and choices


def write_unknown(path: Path, unknown: Sequence[int], sounds: int = 2) -> Path:
    """Write a clip with sounds, some of which are of a codec that FFmpeg does not know."""
    with av.open(str(path), "w") as output:
        _, packets = add_pictures(output)
        streams = [output.add_stream("aac", rate=RATE) for _ in range(sounds)]
        lines = output.add_mux_stream("mov_text")
        text: Any = av.Packet(b"\0\3one")
        text.stream, text.pts, text.dts, text.duration, text.time_base = lines, 0, 0, 200, Fraction(1, 1000)
        mux_in_order(output, [*packets, *(packet for stream in streams for packet in tone(stream)), text])
    first, *parts = path.read_bytes().split(b"mp4a")  # in the description of every sound
    assert len(parts) == sounds
    for number in unknown:
        parts[number] = parts[number].replace(b"\x40\x15", b"\xfe\x15", 1)  # MPEG-4's own number of the codec
    tags = [b"apac" if number in unknown else b"mp4a" for number in range(sounds)]
    path.write_bytes(first + b"".join(tag + part for tag, part in zip(tags, parts, strict=True)))
    return path


def kinds_of(path: Path) -> list[str]:
    """The types of the streams, without those of a timecode."""
    with av.open(str(path)) as file:
        return [stream.type for stream in file.streams]


@pytest.mark.parametrize("unknown", [0, 1])
@pytest.mark.parametrize(("suffix", "codec"), [(".mp4", None), (".mov", None), (".mkv", None), (".mp4", "flac")])
def test_a_sound_of_unknown_codec_is_left_out_beside_others(tmp_path, suffix, codec, unknown):
    """The other one is kept, which is said before any frame is read; alone it is refused."""
    clip, target = write_unknown(tmp_path / "in.mp4", [unknown]), tmp_path / f"out{suffix}"
    remarks = [remark for remark in double(clip, target, codec) if "encoded anew as" not in remark]
    cause = f"The unknown sound of {clip} cannot be encoded anew here" if codec else ""
    cause = cause or f"{target} cannot hold the unknown sound of {clip}"
    assert f"{cause}; stream {1 + unknown} was left out." in remarks
    assert kinds_of(target) == ["video", "audio", "subtitle"]
    if codec is None:
        before, after = packets_of(clip, "audio", 1 - unknown), packets_of(target, "audio")
        assert [data for _, data in after] == [data for _, data in before]
    alone = write_unknown(tmp_path / "alone.mp4", [0, 1])
    with pytest.raises(OutputError, match=r"unknown sound .*; leave .* out with `audio=False`"):
        double(alone, tmp_path / "none.mp4", codec)
    with pytest.raises(OutputError, match=r"The unknown sound of .* cannot be stretched here; .*_sound='drop'`\."):
        slow(alone, tmp_path / "none.mp4")


def test_streams_are_chosen_by_their_numbers(tmp_path):
    """Sound and subtitles, beside the video whether it is named or not; what is asked for is never left out."""
    clip = write_unknown(tmp_path / "in.mp4", [2], sounds=3)

    def kept(streams: tuple[int, ...], **options: Any) -> list[str]:
        encoding = Encoding(preset="ultrafast", streams=streams, **options)
        convert(
            str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=encoding, run=RunOptions(overwrite=True)
        )
        return kinds_of(tmp_path / "out.mp4")

    assert kept((2,)) == ["video", "audio"]
    assert packets_of(tmp_path / "out.mp4", "audio") == packets_of(clip, "audio", 1)
    assert kept((0, 1, 4)) == ["video", "audio", "subtitle"]
    assert kept((1, 4), audio=False) == ["video", "subtitle"]
    assert kept(()) == ["video"]
    with pytest.raises(OutputError, match=r"cannot hold the unknown sound of .*; leave 3 out of `streams`"):
        kept((1, 3))
    with pytest.raises(OptionError, match=r"`streams=7` is no sound .*, which has 1 \(aac audio\), 2 .*, 4 \(mov_text"):
        kept((1, 7))


@pytest.mark.parametrize(("codec", "suffix"), [("alac", ".mov"), ("aac", ".mov"), ("aac", ".nut"), ("flac", ".nut")])
def test_sound_that_lacks_its_headers_is_refused(tmp_path, codec, suffix):
    """Before any frame is read, in every container; encoded anew where its decoder does without them."""
    write_noise(tmp_path / "whole.mp4", codec)
    clip = copy_packets(tmp_path / "whole.mp4", tmp_path / f"in{suffix}", sound_headers=False)
    for target in (tmp_path / "out.mp4", tmp_path / "out.mov", tmp_path / "out.mkv"):
        with pytest.raises(OutputError, match=f"cannot hold the {codec} sound of .*; .*leave the sound out with"):
            double(clip, target)
        assert not target.exists()
    if codec == "alac":
        with pytest.raises(OutputError, match=r"The alac sound of .* cannot be encoded anew here"):
            double(clip, tmp_path / "out.mp4", "aac")
    else:
        double(clip, tmp_path / "out.mp4", codec)
        assert codec_of_sound(tmp_path / "out.mp4") == codec
        assert len(packets_of(tmp_path / "out.mp4", "audio")) > 10


@pytest.mark.parametrize("lost", ["all", "sound"])
def test_a_file_that_cannot_be_read_back_is_not_published(tmp_path, monkeypatch, lost):
    """What no program opens, or lacks the packets of a stream, ends in a sentence and leaves nothing behind."""

    def spoil(path: Path) -> None:
        data = path.read_bytes()
        if data.startswith(b"PK"):  # a chunk of the video, which is a ZIP archive
            return
        path.write_bytes(b"free".join(data.rsplit(b"trak", 1)) if lost == "sound" else data[:100])

    monkeypatch.setattr("fpsboost.media.chunks.sync", spoil)
    clip = write_clip(tmp_path / "in.mp4", sound="aac")
    what = "sound" if lost == "sound" else "video and sound"
    with pytest.raises(OutputError, match=rf"out\.mp4 was not written because its {what} cannot be read from it; try"):
        double(clip, tmp_path / "out.mp4")
    assert not (tmp_path / "out.mp4").exists()


def test_mov_refuses_what_it_lists(tmp_path):
    """Formats that .mov shares with .mp4 in its list and not in fact are refused with what to use."""
    clip = write_clip(tmp_path / "in.mp4", sound="aac")
    with pytest.raises(
        OptionError, match=r"`audio_codec='flac'` cannot go into .*out\.mov; use aac .*, or write \.mp4"
    ):
        double(clip, tmp_path / "out.mov", "flac")
    with pytest.raises(OptionError, match=r"`codec='av1'` cannot go into .*out\.mov; use h264 or hevc, or write \.mp4"):
        convert(str(clip), str(tmp_path / "out.mov"), encoding=Encoding("av1"))


# ---------------------------------------------------------------------------------------------------- where it is heard


@pytest.mark.parametrize(
    ("name", "suffix", "canonical"),
    [
        ("aac", ".mp4", "aac"),
        ("AAC", ".mkv", "aac"),
        ("opus", ".webm", "opus"),
        (None, ".webm", "opus"),
        ("opus", ".mp4", "opus"),
        ("mp3", ".mkv", "mp3"),
        ("ac3", ".mov", "ac3"),
        ("eac3", ".mkv", "eac3"),
        ("flac", ".mkv", "flac"),
        ("alac", ".mov", "alac"),
        ("pcm_s24le", ".mov", "pcm_s24le"),
    ],
)
def test_encoded_sound_is_in_its_place_and_as_long(tmp_path, name, suffix, canonical):
    """To the sample, priming and padding cut off, as Matroska and mp4 say; lossless is exact, and .webm takes Opus."""
    clip, target = tmp_path / "in.mkv", tmp_path / f"out{suffix}"
    truth = write_noise(clip)
    assert double(clip, target, name) == [
        f"{target} holds stream 1 (pcm_s16le sound) of its source encoded anew as {canonical}."
    ]
    assert codec_of_sound(target) == canonical
    found, rate = heard(target)
    rounded = RATE // 1000 if suffix in (".mkv", ".webm") else 0  # Matroska's times
    assert rate == RATE
    assert abs(lag(truth / 32768, found)) <= rounded
    if canonical in ("flac", "alac", "pcm_s24le"):
        assert np.array_equal(np.rint(found * 32768), truth)
    with av.open(str(target)) as file:
        stream = file.streams.audio[0]
        if rounded:
            assert sum(frame.samples for frame in file.decode(stream)) == SAMPLES
        else:
            assert stream.duration * stream.time_base == pytest.approx(SAMPLES / RATE, abs=0.5 / RATE)


def test_a_time_stamp_far_ahead_is_no_silence_of_hours(tmp_path):
    """A gap behind the last picture, as damaged time stamps make it, stays a gap of the time stamps."""
    clip, target = tmp_path / "in.mkv", tmp_path / "out.mkv"
    write_noise(tmp_path / "whole.mkv")
    copy_packets(tmp_path / "whole.mkv", clip, lambda _, it: setattr(it, "pts", it.pts + 10**7 * (it.pts > 1000)))
    double(clip, target, "flac")
    assert 0.9 * SAMPLES < len(heard(target)[0]) <= SAMPLES


@pytest.mark.parametrize("layout", ["mono", "stereo"])
@pytest.mark.parametrize("suffix", [".avi", ".mkv"])
def test_pcm_without_a_named_layout_goes_into_mp4(tmp_path, suffix, layout):
    """AVI and Matroska name no layout of PCM, and mp4 needs one: two channels are stereo, one is mono."""
    clip, target = write_sounds(tmp_path / f"in{suffix}", [layout]), tmp_path / "out.mp4"
    assert av.open(str(clip)).streams.audio[0].layout.name in ("1 channels", "2 channels")
    assert double(clip, target) == []
    assert np.array_equal(heard(target)[0], heard(clip)[0])


def test_packets_shorter_than_the_clock(tmp_path):
    """Sound of which several packets share a millisecond, as TrueHD in Matroska, is encoded whole."""
    clip, target = tmp_path / "in.mkv", tmp_path / "out.mov"
    truth = write_noise(clip, packet=40)
    assert [remark for remark in double(clip, target, "alac") if "out of order" in remark] == []
    assert np.array_equal(np.rint(heard(target)[0] * 32768), truth)


def test_only_what_is_of_another_format(tmp_path):
    """Sound that is in the format already, and all sound with copy, passes packet by packet."""
    clip = write_clip(tmp_path / "in.mp4", sound="aac")
    for name in ("aac", "copy"):
        assert double(clip, tmp_path / f"{name}.mp4", name) == []
        assert packets_of(tmp_path / f"{name}.mp4", "audio") == packets_of(clip, "audio")


def test_rates_and_speakers_that_an_encoder_does_not_take(tmp_path):
    """The next rate and the nearest speakers are taken, and said."""
    clip, target = write_sounds(tmp_path / "in.mkv", ["5.1(side)"], codec="ac3", rate=44100), tmp_path / "out.mkv"
    assert double(clip, target, "opus") == [
        f"{target} holds stream 1 (ac3 sound) of its source encoded anew as opus, its 5.1(side) as 5.1, at 48000 "
        "instead of 44100 Hz."
    ]
    assert_clicks(target, [click + CLICK / 2 for click in CLICKS], tolerance=0.005)


def test_lost_bits_are_said(tmp_path):
    """24 bits become 16 with a word about it, and stay 24 where the encoder has them."""
    clip = tmp_path / "in.mkv"
    write_noise(clip, "pcm_s24le")
    (remark,) = double(clip, tmp_path / "out.mkv", "pcm")
    assert remark.endswith("(pcm_s24le sound) of its source encoded anew as pcm_s16le, in 16 bits.")
    (remark,) = double(clip, tmp_path / "deep.mkv", "flac")
    assert remark.endswith("encoded anew as flac.")
    with av.open(str(tmp_path / "deep.mkv")) as file:
        assert file.streams.audio[0].codec_context.format.name == "s32"


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_sound_has_the_bit_rate_that_was_asked_for(tmp_path, suffix):
    """Sound that the container could hold as it is, too, is encoded with that many bits; less than a fifth are off."""
    codec = "aac" if suffix == ".mp4" else "opus"
    clip = tmp_path / "in.mkv"
    write_noise(clip, "aac")
    for bitrate in (32_000, 64_000):
        target = tmp_path / f"{bitrate}{suffix}"
        (remark,) = conversion_options.double(
            clip, target, replace(FAST, audio_codec=codec, audio_bitrate=bitrate, preset=None)
        )
        assert "encoded anew as" in remark
        bits = 8 * sum(len(data) for _, data in packets_of(target, "audio"))
        assert bits * RATE / SAMPLES == pytest.approx(bitrate, rel=0.2)


def test_a_bit_rate_goes_with_the_sound_that_is_left_out(tmp_path):
    """Slow motion that drops its sound drops the options of sound, too, and names the loss alone."""
    write_noise(tmp_path / "in.mkv", "aac")
    encoding = replace(FAST, audio_codec="opus", audio_bitrate=64_000)
    summary = convert(
        str(tmp_path / "in.mkv"), str(tmp_path / "out.mkv"), method="nearest", encoding=encoding, slow_motion=True
    )
    assert [remark.kind for remark in summary.remarks] == ["sound-left-out"]


def test_options_of_sound_that_cannot_work(tmp_path, fpsboost_):
    """Unknown names, names of pictures, containers that do not hold it, contradictions, and targets without sound."""
    write_clip(tmp_path / "in.mp4", sound="aac")
    wrong = {
        ("out.mp4", "--audio-codec", "ogg"): "--audio-codec ogg is unknown here; use aac, opus, mp3, ac3, eac3, flac, "
        "alac, pcm, copy, or the exact name of an FFmpeg sound encoder.",
        ("out.mp4", "--audio-codec", "libx264"): "--audio-codec libx264 is unknown here; use aac",
        ("out.webm", "--audio-codec", "aac"): "--audio-codec aac cannot go into out.webm; use opus, or write .mp4 or",
        (
            "out.mp4",
            "--audio-codec",
            "aac",
            "--no-audio",
        ): "--no-audio and --audio-codec cannot be combined",
        (
            "out.mp4",
            "--audio-bitrate",
            "64k",
        ): "--audio-bitrate needs --audio-codec or --slow-motion-sound stretch; give",
        (
            "out.mp4",
            "--audio-bitrate",
            "64k",
            "--audio-codec",
            "copy",
        ): "cannot be combined: a copy keeps its bit rate;",
        ("out.mkv", "--audio-bitrate", "64k", "--audio-codec", "flac"): "--audio-codec flac is lossless and takes no",
        ("frames/", "--audio-codec", "aac"): "frames/ will be images, which take no --audio-codec; leave that out.",
        (
            *("out.mp4", "--audio-codec", "copy", "--slow-motion", "--slow-motion-sound", "stretch"),
        ): "--slow-motion-sound stretch and --audio-codec copy contradict each other; give one of them.",
        (
            *("out.mp4", "--slow-motion", "--slow-motion-sound", "stretch", "--no-audio"),
        ): "--no-audio and --slow-motion-sound stretch cannot be combined: there is no sound to write;",
        (
            "out.mp4",
            "--slow-motion-sound",
            "stretch",
        ): "--slow-motion-sound needs --slow-motion or --retime or --speed; give",
    }
    for options, sentence in wrong.items():
        result = fpsboost_("in.mp4", *options)
        assert result.code == 2
        assert sentence in " ".join(result.lines)
        assert not (tmp_path / "out.mp4").exists()
    assert fpsboost_("in.mp4", "good.mkv", "--audio-codec", "flac", "-m", "nearest", "--preset", "ultrafast").code == 0
    assert codec_of_sound(tmp_path / "good.mkv") == "flac"


# ------------------------------------------------------------------------------------------------ stretched sound's end


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_stretched_sound_ends_where_its_source_does(tmp_path, suffix):
    """The padding behind the source's last samples is not stretched along: 4 s for 2 s, and no more."""
    clip, target = write_sounds(tmp_path / "in.mp4", codec="aac", rate=44100), tmp_path / f"out{suffix}"
    with av.open(str(clip)) as file:
        assert file.streams.audio[0].duration * file.streams.audio[0].time_base == 2
    slow(clip, target, 2)
    with av.open(str(target)) as file:
        stream = file.streams.audio[0]
        length = sum(Fraction(frame.samples, frame.sample_rate) for frame in file.decode(stream))
        if suffix == ".mp4":
            length = stream.duration * stream.time_base
    assert length == 4
