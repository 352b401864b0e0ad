"""Sound of slow motion: clicks where their pictures are, the same pitch, the same tracks, and what is said of it."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from fpsboost import Encoding, Position, Trim, convert
from fpsboost.contracts import SilentObserver, Summary
from support.conversion_options import grouped
from support.sounds import CLICK, CLICKS, RATE, TONES, assert_clicks, heard, slow, write_sounds
from support.video_truth import packets_of, pictures_of, spoil_packets, write_clip

TWICE_AS_LATE = [2 * click + CLICK for click in CLICKS]  # middles of the clicks of sound that is twice as long


def pitch_of(path: Path, track: int = 0) -> float:
    """The strongest frequency below the clicks, Hz."""
    sound, rate = heard(path, track)
    spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound))))
    frequencies = np.fft.rfftfreq(len(sound), 1 / rate)
    return float(frequencies[np.argmax(spectrum * (frequencies < 2000))])


@pytest.mark.parametrize(
    ("factor", "suffix", "layout", "codec"),
    [
        (Fraction(2), ".mp4", "mono", "aac"),
        (Fraction(2), ".mkv", "5.1", "libopus"),
        (Fraction(2), ".webm", "stereo", "libopus"),
        (Fraction(5, 2), ".mov", "5.1", "aac"),
        (Fraction(8), ".mkv", "mono", "libopus"),
        (Fraction(8), ".mp4", "stereo", "aac"),
        (Fraction(1, 2), ".m4v", "stereo", "aac"),
        (Fraction(1, 2), ".mkv", "mono", "libopus"),
    ],
    ids=str,
)
def test_clicks_fall_on_their_pictures(tmp_path, factor, suffix, layout, codec):
    """Clicks at factor x their times, to 30 ms or 5 ms of the source; the tone as high, the whole factor x as long."""
    clip, target = write_sounds(tmp_path / "in.mkv", [layout]), tmp_path / f"out{suffix}"
    summary = slow(clip, target, factor)
    expected = [float(factor) * (click + CLICK / 2) for click in CLICKS]
    assert_clicks(target, expected, 0.25 * float(factor), tolerance=max(0.03, 0.005 * float(factor)))
    assert pitch_of(target) == pytest.approx(TONES[0], rel=0.02)
    sound, rate = heard(target)
    assert len(sound) / rate == pytest.approx(2 * factor, abs=1024 / rate)
    with av.open(str(target)) as file:
        context = file.streams.audio[0].codec_context
        assert (context.layout.name, context.sample_rate) == (layout, RATE)
    encoder = {"aac": "aac", "libopus": "opus"}[codec]
    assert summary.remarks == [
        f"{target} holds stream 1 (pcm_s16le sound) of its source stretched to {factor} times its length and encoded "
        f"anew as {encoder}."
    ]
    assert pictures_of(target)[0].pts == 0


@pytest.mark.slow
def test_tracks_stay_apart(tmp_path):
    """Two tracks of other layouts and rates: each its own tone, and AAC's delay no matter."""
    clip = write_sounds(tmp_path / "in.mp4", ["stereo", "mono"], codec="aac", rate=44100)
    for suffix in (".mp4", ".mkv"):
        target = tmp_path / f"out{suffix}"
        summary = slow(clip, target)
        assert [remark.split("(")[0] for remark in summary.remarks] == [
            f"{target} holds stream {number} " for number in (1, 2)
        ]
        for track in (0, 1):
            assert_clicks(target, TWICE_AS_LATE, 0.5, track=track)
            assert pitch_of(target, track) == pytest.approx(TONES[track], rel=0.02)
        with av.open(str(target)) as file:
            contexts = [each.codec_context for each in file.streams.audio]
            assert [each.layout.name for each in contexts] == ["stereo", "mono"]
            assert {each.sample_rate for each in contexts} == {44100 if suffix == ".mp4" else 48000}


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_a_part_of_it(tmp_path, suffix):
    """--start and --end cut the sound to the sample, and what clicked between them clicks in its place."""
    clip, target = write_sounds(tmp_path / "in.mkv"), tmp_path / f"out{suffix}"
    slow(clip, target, 3, trim=Trim(Position(Fraction(4, 5)), Position(Fraction(9, 5))))
    assert_clicks(target, [3 * (click - 0.8 + CLICK / 2) for click in CLICKS[1:]], 0.5)
    sound, rate = heard(target)
    assert len(sound) / rate == pytest.approx(3, abs=1024 / rate)


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.parametrize("start", [Fraction(1, 2), Fraction(-1, 4)], ids=["late", "early"])
def test_sound_that_starts_at_another_time(tmp_path, start, suffix):
    """Before late sound there is silence; of early sound nothing is heard before the first picture."""
    clip, target = write_sounds(tmp_path / "in.mp4", codec="aac", start=start), tmp_path / f"out{suffix}"
    slow(clip, target)
    assert_clicks(target, [2 * float(start) + time for time in TWICE_AS_LATE])
    with av.open(str(target)) as file:
        assert next(file.decode(video=0)).pts == 0


SLOW = {"speed": "0.25@0.7-1.3"}
TWICE = {"factor": 2, "slow_motion": True, "slow_motion_sound": "stretch"}
NEITHER = {"start": Fraction(1, 2), "seconds": 1.2}


@pytest.mark.parametrize(
    ("suffix", "codec", "source", "curve", "silent", "clicks", "reasons"),
    [
        (".mp4", None, {}, SLOW, [(0.7, 3.1)], [0.405, 3.405], "from 0:00.700 to 0:03.100 (speed 0.25)"),
        (".mp4", "ac3", {"layouts": ["5.1"]}, SLOW, [(0.7, 3.1)], [0.405, 3.405], "from 0:00.700 to 0:03.100 (speed"),
        (".mkv", "flac", {}, {**SLOW, "slow_motion_sound": "stretch"}, [], [0.405, 1.92, 3.405], None),
        (".mp4", None, {"left_out": (0.5, 0.8)}, TWICE, [(1, 1.6)], [0.81, 2.01, 3.21], None),
        (".mkv", None, {"left_out": (0.5, 0.8)}, TWICE, [(1, 1.6)], [0.81, 2.01, 3.21], None),
        (
            *(".mov", "pcm", {}, {"retime": "0=0 2s=2s 3.6s=2s"}),
            *([(2, 3.6)], [0.405, 1.005, 1.605], "from 0:02 to 0:03.600 (speed 0)"),
        ),
        (
            *(".mkv", "opus", {}, {"retime": "0=0 1.3s=1.3s 2s=.6s 2.7s=1.3s 3.4s=2s"}),
            *([(1.3, 2.7)], [0.405, 1.005, 3.005], "from 0:01.300 to 0:02.700 (speed -1, shown again, or too short)"),
        ),
        (
            *(".webm", None, {}, {"retime": "0=0 1s=0 1.5s=.5s 2.5s=.75s 3.75s=2s"}, [(0, 1), (1.5, 2.5), (3.75, 3.8)]),
            *([1.405, 2.755, 3.355], "from 0:00 to 0:01 (speed 0), from 0:01.500 to 0:02.500 (speed 0.25)"),
        ),
        (
            *(".mkv", "mp3", NEITHER, {"retime": "0=0 1s=1s 2s=1s 3s=2s"}),
            *([(0, 0.5), (1, 2), (2.7, 3)], [0.905, 2.505], "from 0:01 to 0:02 (speed 0)"),
        ),
        (
            *(".mov", "pcm", NEITHER, {"retime": "0=0 1s=1s 15s=1s 16s=2s"}),
            *([(0, 0.5), (1, 15), (15.7, 16)], [0.905, 15.505], "from 0:01 to 0:15 (speed 0)"),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_a_curve_leaves_out_is_silence(tmp_path, suffix, codec, source, curve, silent, clicks, reasons):
    """Samples, decoded one after the other, are silent there, and in the source's own pauses; clicks are in place."""
    clip = write_sounds(tmp_path / "in.mkv", **{"layouts": ["mono", "stereo"], **source})
    target, encoding = tmp_path / f"out{suffix}", Encoding(preset="8" if suffix == ".webm" else "ultrafast")
    summary = convert(
        str(clip), str(target), method="nearest", **grouped(**curve, encoding=replace(encoding, audio_codec=codec))
    )
    notes = [remark for remark in summary.remarks if "has no sound" in remark]
    assert notes == [] if reasons is None else notes[0].startswith(f"{target} has no sound {reasons}")
    length = len(pictures_of(target)) / 5
    for track in range(len(source.get("layouts", "12"))):
        sound, rate = heard(target, track)
        assert len(sound) / rate == pytest.approx(length, abs=1536 / rate)
        assert_clicks(target, clicks, track=track)
        for begin in np.arange(0.1, length - 0.1, 0.05):
            level = np.sqrt(np.mean(sound[round(begin * rate) : round((begin + 0.05) * rate)] ** 2))
            inside, near = (any(b - d < begin < e + d - 0.05 for b, e in silent) for d in (-0.05, 0.1))
            assert (level < 1e-3) if inside else (near or level > 0.01)


@pytest.mark.parametrize(
    ("layout", "codec", "encoder", "becomes"),
    [
        ("5.1", "pcm_s16le", "aac", ""),  # of which Matroska says no more than six channels
        ("12 channels", "pcm_s16le", "flac", "flac, its 12 channels as stereo"),
        ("7.1.4", "wavpack", "flac", "flac, its 7.1.4 as stereo"),
    ],
)
def test_channels_without_names_and_too_many(tmp_path, layout, codec, encoder, becomes):
    """Six are taken for 5.1; twelve become two, no louder than they may be, and that is said."""
    clip, target = write_sounds(tmp_path / "in.mkv", [layout], codec=codec), tmp_path / "out.mkv"
    (remark,) = slow(clip, target, encoding=Encoding(preset="ultrafast", audio_codec=encoder)).remarks
    assert f"encoded anew as {becomes}" in remark
    with av.open(str(target)) as file:
        assert file.streams.audio[0].codec_context.layout.name == ("stereo" if becomes else "5.1")
    assert not becomes or np.abs(heard(target)[0]).max() < 1
    assert_clicks(target, TWICE_AS_LATE)


def test_damaged_sound(tmp_path):
    """What decodes is in its place, what does not is silent, and that is said."""
    clip = write_sounds(tmp_path / "in.mp4", codec="aac")
    spoil_packets(clip, range(52, 62), "audio")  # about 1.1 to 1.3 s
    target = tmp_path / "out.mp4"
    summary = slow(clip, target)
    assert_clicks(target, TWICE_AS_LATE)
    [remark] = [remark for remark in summary.remarks if " is damaged" in remark]
    assert remark == (
        f"{clip} is damaged: 10 packets of sound in stream 1 could not be decoded, where {target} is silent; listen to "
        "it."
    )


@pytest.mark.slow
def test_a_resumed_run_makes_the_same_sound(tmp_path):
    """Stopped in the middle and gone on with, the sound is the same to the bit."""
    clip = write_sounds(tmp_path / "in.mkv", seconds=2.5, pictures=50)

    class Stops(SilentObserver):
        def wrote(self, summary: Summary) -> None:
            if summary.frames_out == 260:
                raise KeyboardInterrupt

    whole, stopped = tmp_path / "whole.mp4", tmp_path / "stopped.mp4"
    slow(clip, whole, 8)
    with pytest.raises(KeyboardInterrupt):
        slow(clip, stopped, 8, observer=Stops())
    assert slow(clip, stopped, 8, resume=True).completed_frames == 240
    assert packets_of(stopped, "audio") == packets_of(whole, "audio")


def test_sound_is_left_out_unless_told(tmp_path):
    """Neither without the option nor with drop is there sound; at factor 1 it passes untouched."""
    clip = write_clip(tmp_path / "in.mp4", sound="aac")
    for choice in (None, "drop"):
        target = tmp_path / f"{choice}.mp4"
        summary = slow(clip, target, slow_motion_sound=choice)
        assert summary.remarks == [f"{clip} has sound, which slow motion leaves out."]
        with av.open(str(target)) as file:
            assert not file.streams.audio
    target = tmp_path / "same.mp4"
    assert slow(clip, target, 1).remarks == []
    assert packets_of(target, "audio") == packets_of(clip, "audio")
