"""What came through a conversion: two video files read with PyAV alone, past fpsboost's own readers, and compared."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import av.error
import numpy as np
from av.format import Flags

from fpsboost.media.pyav import open_input
from fpsboost.threads import decoder_threads

COMPARED_FRAMES = 40
"""Frames whose colours are compared: the first ones that both files show at one time."""

EXACT_SCALER = 0x4 | 0x2000 | 0x40000
"""FFmpeg's bicubic scaler, whole chroma, accurate rounding: the usual one makes everything half a level darker."""


@dataclass
class Video:
    """A video stream as a player meets it; times are seconds."""

    description: str = ""
    times: list[Fraction] = field(default_factory=list)
    end: Fraction = Fraction(0)
    shown: list[list[np.ndarray]] = field(default_factory=list)
    """The first frames: planes as stored, in levels of 8 bits."""
    first: Any = None
    """The first frame as decoded: its pixel format, matrix and range are those of the file."""
    tags: dict[str, str] = field(default_factory=dict)
    """Colour range, matrix, primaries, transfer and pixel shape."""
    is_rgb: bool = False
    turned: float = 0.0
    """Degrees by which a player turns it."""
    sound: dict[int, list[tuple[Fraction, str]]] = field(default_factory=dict)
    """Packets of each track by the number of its stream: time and hash."""

    @property
    def duration(self) -> Fraction:
        """Seconds from the first frame to the end of the last."""
        return self.end - self.times[0] if self.times else Fraction(0)

    @property
    def longest(self) -> Fraction:
        """Seconds for which the frame that is shown longest is shown."""
        return max(np.diff([*self.times, self.end]), default=Fraction(0))


def read_video(path: Path, keep: int, *, in_rgb: bool = False) -> Video:
    """Read the largest video stream, which players choose, with some frames, as stored or in RGB, and all sound."""
    video = Video()
    with open_input(str(path.absolute())) as file:
        moving = [each for each in file.streams.video if not each.disposition & av.stream.Disposition.attached_pic]
        # of equal ones the longest: animated AVIF has a still picture beside its sequence
        stream = max(moving, key=lambda each: (each.codec_context.width * each.codec_context.height, each.frames))
        video.sound = {each.index: [] for each in file.streams.audio}
        base = Fraction(stream.time_base)
        has_times = Flags.no_timestamps not in Flags(file.format.flags) or file.format.name == "m4v"  # in its codec
        raw_rate = None if has_times else Fraction(stream.guessed_rate)
        # as fpsboost does: what a decoder makes of damage depends on its threads, and with several of them on chance
        stream.thread_type = "AUTO"
        stream.thread_count = decoder_threads()
        for packet in _packets(file):
            if packet.stream.index in video.sound and packet.size and packet.pts is not None:
                time = packet.pts * Fraction(packet.time_base)
                video.sound[packet.stream.index].append((time, hashlib.sha256(_payload(packet)).hexdigest()))
            elif packet.stream.index == stream.index:
                for frame in _decoded(packet):
                    _note(video, frame, base, raw_rate, keeps=len(video.shown) < keep, in_rgb=in_rgb)
        rate = stream.average_rate or stream.guessed_rate or 0
        context = stream.codec_context
        video.description = f"{context.name} {context.width}x{context.height} {context.pix_fmt}, {float(rate):.6g} fps"
        video.tags["pixel shape"] = str(stream.sample_aspect_ratio or 1).replace("0/1", "1")
        if stream.duration is not None and stream.start_time is not None:
            end = (stream.start_time + stream.duration) * base
            # mp4 and mov say how long a picture is shown; AVI counts frames, and a capture's last ones may hold nothing
            # of fragments, whose samples its header does not count, it says the end counted from 0
            if file.format.name.startswith("mov") and stream.frames >= len(video.times):
                video.end = end if end > max(video.times, default=end) else video.end
            elif file.format.name == "avi":
                video.end = max(end, video.end)
    video.times.sort()  # pictures come in order, but not always with their own times
    return video


def _payload(packet: Any) -> bytes:
    """Return the data of a packet; of AAC, without the ADTS header that transport streams store."""
    data = bytes(packet)
    context = packet.stream.codec_context  # None of a codec that FFmpeg does not know
    if context is None or context.name != "aac" or data[0] != 0xFF or data[1] & 0xF0 != 0xF0:
        return data
    return data[7 if data[1] & 1 else 9 :]


def _packets(file: av.container.InputContainer) -> Iterator[Any]:
    """Yield all packets of video, audio and subtitles; continue past damage and samples beyond the end of the file."""
    for stream in file.streams:
        if stream.type not in ("video", "audio", "subtitle"):
            stream.discard = av.stream.Discard.all
    for _ in range(1000 if file.format.name.startswith("mov") else 1):
        for _ in range(10):
            with contextlib.suppress(av.error.FFmpegError):
                yield from (packet for packet in file.demux() if packet.size)
                break
    with contextlib.suppress(av.error.FFmpegError):
        yield from file.demux()  # the packets that flush


def _decoded(packet: Any) -> list[Any]:
    with contextlib.suppress(av.error.FFmpegError):
        return list(packet.decode())
    return []


def _note(video: Video, frame: Any, base: Fraction, raw_rate: Fraction | None, *, keeps: bool, in_rgb: bool) -> None:
    """Add a frame; one of a raw stream begins where the one before it ends and lasts as `raw_rate` says.

    Nothing in such a stream says when a frame is shown: FFmpeg's times are guesses, and where the parameters of the
    stream change, its durations are single ticks. They are right where fields or frames are repeated (pulldown).
    """
    time = video.end if frame.pts is None or raw_rate is not None else frame.pts * Fraction(frame.time_base or base)
    if not video.times:
        video.first = frame
        video.turned = float(frame.rotation or 0)
        video.is_rgb = frame.format.is_rgb or frame.format.has_palette
        if not video.is_rgb and len(frame.format.components) > 2:  # RGB and gray need not say what they mean
            video.tags |= {
                "range": "full" if frame.color_range == 2 or frame.format.name.startswith("yuvj") else "limited",
                "matrix": str(frame.colorspace),
                "primaries": str(frame.color_primaries),
                "transfer": str(frame.color_trc),
            }
    lasted = time - video.times[-1] if video.times else Fraction(0)
    video.times.append(time)
    duration = frame.duration * Fraction(frame.time_base or base) if frame.duration else lasted
    if raw_rate is not None and duration * raw_rate not in (Fraction(3, 2), 2, 3):
        duration = 1 / raw_rate
    video.end = max(video.end, time + duration)  # of AVI, times are not always in order
    if keeps:
        video.shown.append(_rgb(frame) if in_rgb or video.is_rgb else _planes(frame))


def _rgb(frame: Any) -> list[np.ndarray]:
    return list(frame.to_ndarray(format="rgb24", interpolation=EXACT_SCALER).astype(np.float32).transpose(2, 0, 1))


def _held(planes: list[np.ndarray], like: Any) -> list[np.ndarray]:
    """Return what the pixel format, matrix and range of another frame keep of RGB without any encoder."""
    frame = av.VideoFrame.from_ndarray(np.stack(planes, axis=-1).astype(np.uint8), "rgb24")
    return _rgb(
        frame.reformat(
            format=like.format.name,
            dst_colorspace=like.colorspace,
            dst_color_range=like.color_range,
            interpolation=EXACT_SCALER,
        )
    )


def _planes(frame: Any) -> list[np.ndarray]:
    """Return up to three planes as stored, in levels of 8 bits, with chroma not upsampled."""
    bits = frame.format.components[0].bits
    kind = np.uint8 if bits == 8 else np.uint16
    planes = []
    for plane in frame.planes[:3]:
        rows = np.frombuffer(bytes(plane), kind).reshape(plane.height, -1)
        planes.append(rows[:, : plane.width].astype(np.float32) / 2 ** (bits - 8))
    return planes


@dataclass(frozen=True)
class Colours:
    """Differences of colour where both files show the same frame."""

    shift: float
    """The largest difference between means of a plane, levels of 8 bits."""
    change: float
    """The part of it that the pixel format of the result does not explain: of RGB in YCbCr, the difference from what
    is left of the source's own frames there, of all others the whole."""
    psnr: float
    """Of the first plane (luma, or red) in the median frame, dB; infinite where nothing differs."""


def compare_colours(before: Video, after: Video) -> Colours | None:
    """Compare frames shown at the same time since each file's first frame; return None if there are none."""
    if not before.shown or not after.shown or before.shown[0][0].shape != after.shown[0][0].shape:
        return None
    clock = np.array([float(time - after.times[0]) for time in after.times[: len(after.shown)]])
    near = float(np.median(np.diff(clock))) / 50 if len(clock) > 1 else 0.0
    pairs = []
    for time, planes in zip(before.times, before.shown, strict=False):
        place = int(np.abs(clock - float(time - before.times[0])).argmin())
        if abs(clock[place] - float(time - before.times[0])) <= near + 0.0011:  # Matroska counts milliseconds
            pairs.append((planes, after.shown[place]))
    if not pairs:
        return None
    error = float(np.median([np.square(planes[0] - others[0]).mean() for planes, others in pairs]))
    psnr = float("inf") if error == 0 else 10 * float(np.log10(255**2 / error))
    held = [(_held(planes, after.first), others) for planes, others in pairs] if before.is_rgb else pairs
    return Colours(_mean_shift(pairs), _mean_shift(held), psnr)


def _mean_shift(pairs: list[tuple[list[np.ndarray], list[np.ndarray]]]) -> float:
    """Return the largest difference between means of a plane, in the median frame."""
    shifts = [[one.mean() - other.mean() for one, other in zip(*pair, strict=False)] for pair in pairs]
    return float(np.abs(np.median(shifts, axis=0)).max())


def compare_sound(before: Video, after: Video, left_out: Collection[int] = ()) -> str:
    """Say in a word or two whether every packet of every track came through at its time, but for those `left_out`."""
    if not before.sound:
        return "none"
    tracks = [track for index, track in before.sound.items() if index not in left_out]
    if len(tracks) != len(after.sound):
        return f"{len(after.sound)} of {len(tracks)} tracks"
    for track0, track1 in zip(tracks, after.sound.values(), strict=True):
        if [digest for _, digest in track0] != [digest for _, digest in track1]:
            return f"{len(track1)} packets of {len(track0)}" if len(track0) != len(track1) else "other packets"
        apart = [
            abs((time1 - after.times[0]) - (time0 - before.times[0]))
            for (time0, _), (time1, _) in zip(track0, track1, strict=True)
        ]
        if apart and max(apart) > Fraction(2, 1000):
            return f"{float(max(apart)):.3f} s off"
    return "identical"
