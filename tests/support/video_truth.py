"""Tiny clips made with PyAV whose every time, pixel and packet is known."""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost import Coding, DecodeOptions, Frame
from fpsboost.image import YCbCrImage
from fpsboost.io.video.pipe import chroma_locations, formats
from fpsboost.io.video.source import VideoSource
from fpsboost.io.video.ycc import from_bgr, in_planes
from fpsboost.media.encoder import undisturbed
from fpsboost.media.pixels import SMPTE170M, plane_arrays

QUARTER_TURN = (0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30)
LOSSLESS = {"preset": "ultrafast", "crf": "0"}


def scene(index: int, height: int = 48, width: int = 64) -> NDArray[np.uint8]:
    """A smooth colourful picture that moves one pixel per frame."""
    rows, columns = np.ogrid[0:height, 0:width]
    waves = [128 + 80 * np.sin((columns + index) / 7 + phase) * np.cos(rows / 9 + phase) for phase in (0, 1, 2)]
    return np.rint(np.stack(waves, axis=-1)).astype(np.uint8)


def turntable(frames: int, step: int = 4) -> NDArray[np.uint8]:
    """A picture that moves to the side and comes in again on the other, BGR; a round takes `frames` of them."""
    noise = np.random.default_rng(1).random((12, frames * step // 4, 3))
    blown = cv2.resize(np.tile(noise, (1, 3, 1)), None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC).clip(0, 1)
    picture = np.rint(blown[:, frames * step :][:, : frames * step] * 255).astype(np.uint8)
    return np.stack([np.roll(picture, number * step, axis=1) for number in range(frames)])


def write_clip(
    path: Path,
    *,
    times: Sequence[int] = tuple(range(10)),
    end: int | None = None,
    time_base: Fraction = Fraction(1, 25),
    rate: Fraction | None = None,
    size: tuple[int, int] = (48, 64),
    pixel_format: str = "yuv420p",
    codec: str = "libx264",
    options: dict[str, str] | None = None,
    sound: str | None = None,
    sound_seconds: float | None = None,
    subtitles: Sequence[tuple[int, int, bytes]] = (),
    cover: bytes | None = None,
    second_video: bool = False,
    matrix: tuple[int, ...] | None = None,
    title: str | None = None,
    chapters: bool = False,
    container: str | None = None,
    picture: Callable[[int, int, int], NDArray[np.uint8]] = scene,
    **tags: Any,
) -> Path:
    """Write a clip; `times` and `end` are ticks of `time_base`, `tags` attributes of the encoder's context."""
    height, width = size
    end = end if end is not None else 2 * times[-1] - times[-2] if len(times) > 1 else times[-1] + 1
    durations = dict(zip(times, np.diff([*times, end]).tolist(), strict=True))
    with av.open(str(path), "w", format=container) as output:
        if title:
            output.metadata["title"] = title
        if chapters:
            second = Fraction(1, 1000)
            output.set_chapters(
                [{"id": 1, "start": 0, "end": 200, "time_base": second, "metadata": {"title": "opening"}}]
            )
        video = output.add_stream(codec, rate=rate or 1 / time_base, width=width, height=height)
        video.time_base = video.codec_context.time_base = time_base
        video.pix_fmt = pixel_format
        video.options = dict(LOSSLESS if options is None and codec == "libx264" else options or {})
        for name, value in tags.items():
            setattr(video.codec_context, name, value)
        if matrix:
            video.set_display_matrix(matrix)
        other_packets = add_pictures(output, 2, rate=5, size=(32, 32))[1] if second_video else []
        if cover:  # Matroska only
            output.add_attachment("cover.png", "image/png", cover)
        audio = output.add_stream(sound, rate=48000) if sound else None
        if audio:
            audio.metadata["language"] = "fra"
        lines = output.add_mux_stream("subrip") if subtitles else None
        packets = []
        with undisturbed():  # the first frame opens the encoder
            for index, pts in enumerate(times):
                frame = av.VideoFrame.from_ndarray(picture(index, height, width), format="bgr24")
                frame = frame.reformat(format=pixel_format)
                frame.pts, frame.time_base, frame.duration = pts, time_base, durations[pts]
                packets += video.encode(frame)
            packets += video.encode(None)
        for packet in packets:
            packet.duration = durations[packet.pts]
        packets += other_packets
        if audio:
            seconds = sound_seconds or float((end - times[0]) * time_base)
            packets += tone(audio, samples=round(seconds * 48000))
        packets += [_line(lines, *line) for line in subtitles]
        mux_in_order(output, packets)
    return path


def add_pictures(
    output: av.container.OutputContainer,
    count: int = 10,
    *,
    rate: int | Fraction = 25,
    start: int = 0,
    codec: str = "libx264",
    size: tuple[int, int] = (48, 64),
    pixel_format: str = "yuv420p",
    options: dict[str, str] | None = None,
) -> tuple[Any, list[Any]]:
    """Add a video stream that begins at frame `start`; return it and all of its packets."""
    height, width = size
    video: Any = output.add_stream(codec, rate=rate, width=width, height=height)
    video.pix_fmt = pixel_format
    video.options = dict(options or ({"preset": "ultrafast"} if codec == "libx264" else {}))
    packets: list[Any] = []
    for index in range(count):
        picture = av.VideoFrame.from_ndarray(scene(index, height, width), format="bgr24").reformat(format=pixel_format)
        picture.pts = start + index
        packets += video.encode(picture)
    return video, packets + video.encode(None)


def mux_in_order(output: av.container.OutputContainer, packets: Sequence[Any]) -> None:
    """Write packets of several streams in the order in which they are decoded."""
    output.mux(sorted(packets, key=lambda packet: packet.dts * Fraction(packet.time_base)))


def copy_packets(
    source: Path,
    target: Path,
    change: Callable[[int, Any], bool | None] = lambda number, packet: None,
    chapters: Sequence[Any] = (),
    sound_headers: bool = True,
    tags: Mapping[str, int] | None = None,
    **options: str,
) -> Path:
    """Copy a clip packet by packet, except those for which `change` returns False, and the side data of its streams.

    `tags` are attributes of the video in its container, `options` the container's.
    """
    with av.open(str(source)) as file, av.open(str(target), "w", container_options=options) as output:
        output.set_chapters(list(chapters))
        streams = {stream.index: output.add_stream_from_template(stream, opaque=True) for stream in file.streams}
        for stream in () if sound_headers else output.streams.audio:
            stream.codec_context.extradata = None
        for name, value in (tags or {}).items():
            setattr(output.streams.video[0].codec_context, name, value)
        for number, packet in enumerate(packet for packet in file.demux() if packet.size):
            if change(number, packet) is not False:
                packet.stream = streams[packet.stream.index]
                output.mux(packet)
    return target


def _line(stream: Any, start: int, length: int, text: bytes) -> Any:
    packet = av.Packet(text)
    packet.pts = packet.dts = start
    packet.duration, packet.time_base, packet.stream = length, Fraction(1, 1000), stream
    return packet


def tone(stream: Any, start: int = 0, samples: int = 19200) -> list[Any]:
    """Encode a tone of 48 kHz that begins at sample `start`."""
    return sound_packets(stream, (np.sin(np.arange(samples) / 20) * 0.3).astype(np.float32), start=start)


def sound_packets(
    stream: Any,
    samples: NDArray[Any],
    *,
    layout: str = "stereo",
    start: int = 0,
    size: int = 960,
    left_out: tuple[float, float] = (0, 0),
) -> list[Any]:
    """Encode samples (N,), int16 or float32, alike in all channels, `size` at a time from sample `start` on.

    Those between the times `left_out`, seconds from the first one, are missing.
    """
    packets, format = list[Any](), "s16" if samples.dtype == np.int16 else "flt"
    for at in range(0, len(samples), size):
        part = np.repeat(samples[None, at : at + size], av.AudioLayout(layout).nb_channels, axis=1)
        frame = av.AudioFrame.from_ndarray(part, format=format, layout=layout)
        frame.sample_rate, frame.pts, frame.time_base = stream.rate, start + at, Fraction(1, stream.rate)
        packets += [] if left_out[0] <= at / stream.rate < left_out[1] else stream.encode(frame)
    return packets + stream.encode(None)


def png() -> bytes:
    """A small PNG file."""
    return cv2.imencode(".png", scene(0, 16, 16))[1].tobytes()


def read(path: Path, decoding: DecodeOptions | None = None) -> tuple[list[Frame], list[str]]:
    """All frames of a video file, and the remarks on it."""
    with VideoSource(path, decoding=decoding or DecodeOptions()) as source:
        return list(source), source.remarks


def packets_of(path: Path, kind: str, number: int = 0) -> list[tuple[Fraction, bytes]]:
    """Times and bytes of one stream's packets."""
    with av.open(str(path)) as file:
        stream = [stream for stream in file.streams if stream.type == kind][number]
        return [
            (packet.pts * Fraction(packet.time_base), bytes(packet)) for packet in file.demux(stream) if packet.size
        ]


def stream_of(
    count: int, name: str = "420jpeg", *, size: tuple[int, int] = (48, 64), rate: str = "25:1", more: str = ""
) -> bytes:
    """A YUV4MPEG2 stream of scenes; `more` are further words of its header."""
    height, width = size
    full = "COLORRANGE=FULL" in more
    chunks = [f"YUV4MPEG2 W{width} H{height} F{rate} Ip A1:1 C{name}{more}\n".encode()]
    for k in range(count):
        location = chroma_locations.get(name, "left")
        picture = from_bgr(scene(k, height, width), formats[name], SMPTE170M, full, chroma_location=location)
        chunks += [b"FRAME\n", *(plane.tobytes() for plane in plane_arrays(picture))]
    return b"".join(chunks)


def write_stream(path: Path, count: int, name: str = "420jpeg") -> Path:
    """Write a YUV4MPEG2 stream of scenes to a file."""
    path.write_bytes(stream_of(count, name))
    return path


def pictures_of(path: Path) -> list[av.VideoFrame]:
    """Every decoded picture of the first video stream."""
    with av.open(str(path)) as file:
        return list(file.decode(video=0))


def samples_of(picture: av.VideoFrame) -> list[NDArray[Any]]:
    """The planes of a planar picture without padding."""
    return [plane.copy() for plane in plane_arrays(picture)]


def bytes_of(picture: av.VideoFrame) -> bytes:
    """All samples of a planar picture, one plane after the other."""
    return b"".join(plane.tobytes() for plane in plane_arrays(picture))


def sound_to_picture(path: Path) -> Fraction:
    """Seconds from the first sound to the first picture."""
    picture = pictures_of(path)[0]
    return picture.pts * Fraction(picture.time_base) - packets_of(path, "audio")[0][0]


def spoil_packets(path: Path, numbers: Sequence[int], kind: str = "video") -> None:
    """Overwrite whole packets of a stream with nonsense."""
    with av.open(str(path)) as file:
        stream = next(stream for stream in file.streams if stream.type == kind)
        places = [(packet.pos, packet.size) for packet in file.demux(stream) if packet.size]
    data = bytearray(path.read_bytes())
    for number in numbers:
        position, length = places[number]
        assert position is not None
        data[position : position + length] = b"\xff" * length
    path.write_bytes(bytes(data))


def times_of(path: Path) -> list[Fraction]:
    return sorted(time for time, _ in packets_of(path, "video"))


def planar(image: np.ndarray, pixel_format: str = "yuv420p", location: str = "left") -> YCbCrImage:
    """An image of BGR in planes, by BT.709."""
    full_range, deep = pixel_format.startswith("yuvj"), pixel_format.endswith("10le")
    coding = Coding(10 if deep else 8, 1, full_range, location, pixel_format)
    return in_planes(from_bgr(image, pixel_format, 1, full_range, chroma_location=location), coding)
