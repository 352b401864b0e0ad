"""Clips whose sound is a faint tone and three clicks, and where the clicks of a file are."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import Encoding, convert
from fpsboost.contracts import Summary
from support.conversion_options import grouped
from support.video_truth import add_pictures, mux_in_order, sound_packets

RATE = 48000
CLICKS = (0.4, 1.0, 1.6)
CLICK = 0.01  # seconds that a click lasts, at 4000 Hz
TONES = (440, 660, 880)  # Hz of the tone behind the clicks, of the first, second and third track


def wave(track: int, seconds: float, rate: int = RATE) -> NDArray[np.float32]:
    """A faint tone and three clicks."""
    times = np.arange(round(seconds * rate)) / rate
    sound = 0.05 * np.sin(2 * np.pi * TONES[track] * times)
    for click in CLICKS:
        sound += ((times >= click) & (times < click + CLICK)) * 0.6 * np.sin(2 * np.pi * 4000 * times)
    return sound.astype(np.float32)


def write_sounds(
    path: Path,
    layouts: Sequence[str] = ("mono",),
    *,
    codec: str = "pcm_s16le",
    rate: int = RATE,
    start: Fraction = Fraction(0),
    seconds: float = 2.0,
    pictures: int = 10,
    left_out: tuple[float, float] = (0, 0),
) -> Path:
    """Write two seconds of pictures and tracks of sound, which are not there between the times `left_out`."""
    with av.open(str(path), "w") as output:
        _, packets = add_pictures(output, pictures, rate=pictures // 2)
        sounds: list[Any] = [output.add_stream(codec, rate=rate, layout=layout) for layout in layouts]
        for track, sound in enumerate(sounds):
            samples = np.rint(wave(track, seconds, rate) * 32767).astype(np.int16)
            begin = round(start * rate)
            packets += sound_packets(sound, samples, layout=layouts[track], start=begin, left_out=left_out)
        mux_in_order(output, packets)
    return path


def slow(source: Path, target: Path, factor: Fraction | int = 2, **more: Any) -> Summary:
    """Convert in the cheapest way, with sound."""
    encoding = Encoding(preset="8" if target.suffix == ".webm" else "ultrafast")
    options = {"slow_motion_sound": "stretch", "method": "nearest", "encoding": encoding, **more}
    return convert(str(source), str(target), **grouped(factor=factor, slow_motion=True, **options))


def heard(path: Path, track: int = 0) -> tuple[NDArray[np.float64], int]:
    """The samples of a track one after the other, whatever their time stamps, mixed to one channel, and its rate."""
    with av.open(str(path)) as file:
        stream, resampler = file.streams.audio[track], av.AudioResampler(format="flt", layout="mono")
        parts = [each.to_ndarray()[0] for frame in file.decode(stream) for each in resampler.resample(frame)]
        return np.concatenate(parts).astype(np.float64), stream.rate


def band(sound: NDArray[np.float64], rate: int, low: float, high: float) -> NDArray[np.float64]:
    """What of a sound lies between two frequencies."""
    spectrum, frequencies = np.fft.rfft(sound), np.fft.rfftfreq(len(sound), 1 / rate)
    spectrum[(frequencies < low) | (frequencies > high)] = 0
    return np.fft.irfft(spectrum, len(sound))


def assert_clicks(
    path: Path, expected: Sequence[float], reach: float = 0.25, *, tolerance: float = 0.03, track: int = 0
) -> None:
    """The middle of what clicks within `reach` seconds of each of the expected times is at that time."""
    sound, rate = heard(path, track)
    energy = band(sound, rate, 3500, 4500) ** 2
    for time in expected:
        begin, end = (max(0, round((time + side) * rate)) for side in (-reach, reach))
        part = energy[begin:end]
        assert part.sum() > 0.2 * energy.sum() / len(expected)
        middle = (np.arange(begin, begin + len(part)) * part).sum() / part.sum() / rate
        assert middle == pytest.approx(time, abs=tolerance)
