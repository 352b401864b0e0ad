"""Pipes: the text of a stream, its planes to the bit, colours as from a file, and the manners of a filter."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import av
import numpy as np
import pytest

from fpsboost import ClipInfo, Encoding, Frame, InputError, OptionError, OutputError
from fpsboost.cli import app
from fpsboost.io.output import Output
from fpsboost.io.video.pipe import PipeSink, PipeSource, formats
from fpsboost.io.video.source import VideoSource
from fpsboost.media import OutputTiming
from support.command_line import environment
from support.conversion_options import output_of
from support.video_truth import QUARTER_TURN, bytes_of, pictures_of, scene, stream_of, write_clip, write_stream

NAMES = tuple(formats)
ODD = (47, 63)
NEAREST = ("--method", "nearest", "--no-cuts")


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "fpsboost", *map(str, arguments)]


def start(folder: Path, *arguments: object) -> subprocess.Popen[bytes]:
    """Start the command line in a process of its own, between three pipes."""
    pipe = subprocess.PIPE
    return subprocess.Popen(command(*arguments), cwd=folder, env=environment(), stdin=pipe, stdout=pipe, stderr=pipe)


Piped = Callable[..., "subprocess.CompletedProcess[bytes]"]


@pytest.fixture
def piped(monkeypatch, capfdbinary, tmp_path) -> Iterator[Piped]:
    """The command line in this process and in `tmp_path`, between two pipes; most of a process's time is its start."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.chdir(tmp_path)

    def feed(target: BinaryIO, data: bytes) -> None:
        with suppress(BrokenPipeError), target:
            target.write(data)

    def run(data: bytes, *arguments: object) -> subprocess.CompletedProcess[bytes]:
        words, code = ["fpsboost", *map(str, arguments)], 0
        monkeypatch.setattr(sys, "argv", words)
        reader, writer = os.pipe()
        feeding = threading.Thread(target=feed, args=(os.fdopen(writer, "wb"), data))
        capfdbinary.readouterr()
        feeding.start()
        with os.fdopen(reader) as source:
            monkeypatch.setattr(sys, "stdin", source)
            try:
                app.main()
            except SystemExit as stop:
                code = int(stop.code or 0)
        feeding.join()
        return subprocess.CompletedProcess(words, code, *capfdbinary.readouterr())

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def sentences(done: subprocess.CompletedProcess[bytes]) -> list[str]:
    """What was said."""
    return done.stderr.decode().splitlines()


def frames_in(data: bytes) -> tuple[bytes, list[bytes]]:
    """The first line of a stream and its frames' samples."""
    line, rest = data.split(b"\n", 1)
    width, height, name = re.search(rb"W([0-9]+) H([0-9]+) .* C(\w+)", line).groups()
    components = av.VideoFormat(formats[name.decode()], int(width), int(height)).components
    size = sum(part.width * part.height * (2 if part.bits > 8 else 1) for part in components) + len(b"FRAME\n")
    assert len(rest) % size == 0
    chunks = [rest[start : start + size] for start in range(0, len(rest), size)]
    assert all(chunk.startswith(b"FRAME\n") for chunk in chunks)
    return line, [chunk.removeprefix(b"FRAME\n") for chunk in chunks]


def copy(data: bytes, *, strip: bool = False, encoding: Encoding | None = None) -> tuple[bytes, PipeSink]:
    """Send every frame of a stream through a source and a sink; with `strip` as an image only."""
    target = BytesIO()
    with PipeSource(BytesIO(data)) as source:
        timing = OutputTiming(source.info.rate, source.info.time_base)
        with PipeSink(output_of("-", source, timing, encoding=encoding or Encoding()), target) as sink:
            for frame in source:
                sink.write(Frame(frame.image, frame.time, frame.duration, None if strip else frame.original))
    return target.getvalue(), sink


def write_frames(images: list[np.ndarray], encoding: Encoding | None = None) -> tuple[bytes, PipeSink]:
    """Write images as a stream of 24 frames per second that has no source."""
    height, width = images[0].shape[:2] if images else (48, 64)
    info = ClipInfo("images", height, width, Fraction(24), Fraction(1, 24), len(images))
    target = BytesIO()
    timing = OutputTiming(Fraction(24), Fraction(1, 24))
    with PipeSink(Output("-", info, timing, encoding=encoding or Encoding()), target) as sink:
        for index, image in enumerate(images):
            sink.write(Frame(image, Fraction(index, 24)))
    return target.getvalue(), sink


@pytest.mark.parametrize(
    ("words", "rate", "aspect", "full_range", "pixel_format"),
    [
        ("W64 H48 F30000:1001", Fraction(30000, 1001), None, False, "yuv420p"),
        ("H48 W64 F0:0 A0:0 I?", 25, None, False, "yuv420p"),
        ("W64 H48 F25:1 It A4:3 C422", 25, Fraction(4, 3), False, "yuv422p"),
        ("W64 H48 F25:1 Ib C444p12 XCOLORRANGE=FULL", 25, None, True, "yuv444p12le"),
        ("W64 H48 F25:1 C420paldv XYSCSS=420PALDV XSOMETHING", 25, None, False, "yuv420p"),
    ],
)
def test_headers_as_programs_write_them(words, rate, aspect, full_range, pixel_format):
    """Words in any order, unknown ones among them, and silence about what need not be said."""
    data = f"YUV4MPEG2 {words}\nFRAME\n".encode() + b"\x20\x00" * (64 * 48 * 3)
    with PipeSource(BytesIO(data)) as source:
        traits = source.stream_info.traits
        assert (source.info.width, source.info.height, source.info.rate) == (64, 48, rate)
        assert (traits.sample_aspect_ratio, traits.full_range) == (aspect, full_range)
        assert traits.pixel_format == pixel_format


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "standard input is empty; pipe a YUV4MPEG2 stream"),
        (b"\n", "is no YUV4MPEG2 stream"),
        (b"YUV4MPEG2 W64 H48", "is no YUV4MPEG2 stream"),
        (b"\x00\x00\x00\x20ftypisom" * 500, "is no YUV4MPEG2 stream"),
        (b"YUV4MPEG2 H48 F25:1\n", "is no YUV4MPEG2 stream"),
        (b"YUV4MPEG2 W0 H48 F25:1\n", "is no YUV4MPEG2 stream"),
        (b"YUV4MPEG2 W32768 H32768 F25:1\n", "is no YUV4MPEG2 stream"),
        (b"YUV4MPEG2 W64 H48 F25:1 C999\n", "is no YUV4MPEG2 stream"),
        (b"YUV4MPEG2 W64 H48 F25:1\nFRAME\nabc", "holds no whole frame"),
    ],
)
def test_streams_that_are_none(data, sentence):
    """Each is refused with its sentence before any frame is read."""
    with pytest.raises(InputError, match=re.escape(sentence)):
        PipeSource(BytesIO(data))


@pytest.mark.parametrize("size", [(48, 64), ODD], ids=["even", "odd"])
@pytest.mark.parametrize("name", NAMES)
def test_planes_pass_bit_by_bit(name, size):
    """Every format comes out as it went in, header and all."""
    data = stream_of(3, name, size=size, rate="30000:1001", more=" XCOLORRANGE=LIMITED")
    out, sink = copy(data)
    assert frames_in(out)[1] == frames_in(data)[1]
    height, width = size
    words = f"YUV4MPEG2 W{width} H{height} F30000:1001 Ip A1:1 C{name} XCOLORRANGE=LIMITED"
    assert out.split(b"\n")[0].decode() == words
    assert sink.remarks == []


@pytest.mark.parametrize("more", ["", " XCOLORRANGE=FULL", " XCOLORRANGE=LIMITED"], ids=["untagged", "full", "limited"])
@pytest.mark.parametrize("name", ["420jpeg", "420paldv", "422", "444p10", "mono", "mono16"])
def test_colours_are_those_of_a_file(tmp_path, name, more):
    """FFmpeg opens the same bytes as a file: the same images, times and meaning of the pictures."""
    (tmp_path / "in.y4m").write_bytes(stream_of(2, name, more=more))
    with VideoSource(tmp_path / "in.y4m") as file, PipeSource(BytesIO((tmp_path / "in.y4m").read_bytes())) as pipe:
        for ours, theirs in zip(pipe, file, strict=True):
            assert (ours.time, ours.duration) == (theirs.time, theirs.duration)
            assert ours.image.dtype == theirs.image.dtype
            assert np.array_equal(ours.image, theirs.image)
        for field in ("pixel_format", "color_space", "full_range", "chroma_location", "sample_aspect_ratio"):
            assert getattr(pipe.stream_info.traits, field) == getattr(file.traits, field), field
        assert (pipe.info.rate, pipe.info.width, pipe.info.height) == (file.info.rate, 64, 48)


@pytest.mark.parametrize("more", [" XCOLORRANGE=FULL", " XCOLORRANGE=LIMITED"], ids=["full", "limited"])
@pytest.mark.parametrize("name", NAMES)
def test_made_frames_look_like_originals(name, more):
    """A frame that goes through BGR differs by no more than rounding, and not on average."""
    data = stream_of(2, name, more=more)
    out, _ = copy(data, strip=True)
    assert more.encode() in out.split(b"\n")[0]
    bits = av.VideoFormat(formats[name]).components[0].bits
    dtype = np.dtype("<u2" if bits > 8 else "u1")
    for before, after in zip(frames_in(data)[1], frames_in(out)[1], strict=True):
        difference = np.frombuffer(after, dtype).astype(float) - np.frombuffer(before, dtype)
        assert abs(difference.mean()) < 0.2 * 2 ** (bits - 8)
        assert np.abs(difference).max() <= 3 * 2 ** (bits - 8)


@pytest.mark.parametrize(
    ("data", "remark"),
    [
        (stream_of(2).replace(b" Ip ", b" It ", 1), "standard input is interlaced and its fields were taken as whole"),
        *(
            (
                stream_of(2, rate="1:1").replace(b" F1:1", rate, 1),
                "standard input does not say its frame rate; 25 frames",
            )
            for rate in (b" F0:0", b" F25:0", b"")
        ),
        *(
            (stream_of(3)[:-missing], "standard input ended within frame 3, which was left out.")
            for missing in (1, 4000, 4607, 4609, 4613)
        ),
    ],
    ids=range(9),
)
def test_what_a_stream_lacks_is_told(data, remark):
    """Whole pictures, a rate, for which that of other videos is assumed, or the end of its last frame."""
    with PipeSource(BytesIO(data)) as source:
        assert [frame.time for frame in source] == [0, Fraction(1, 25)]
    (said,) = source.remarks
    assert said.startswith(remark)


def test_something_between_the_frames():
    """What is no frame is an error that says how far it went; words behind FRAME are none."""
    data = stream_of(3)
    second = data.index(b"\n") + 1 + 6 + 64 * 48 * 3 // 2
    for junk in (b"JUNK!\n", b"FRAME " + b"a" * 2000 + b"\n"):
        with (
            PipeSource(BytesIO(data[:second] + junk + data[second:])) as source,
            pytest.raises(InputError, match="something else where frame 2 should begin"),
        ):
            list(source)
    with PipeSource(BytesIO(data.replace(b"FRAME\n", b"FRAME Ip\n"))) as source:
        assert len(list(source)) == 3


def test_images_become_444():
    """Images keep all their colour: 4:4:4 of their own depth, or gray; float becomes 16 bit; alpha is told."""
    colour = scene(0)
    for image, name, more in (
        (colour, "444", "XCOLORRANGE=LIMITED"),
        (colour.astype(np.uint16) * 257, "444p16", "XCOLORRANGE=LIMITED"),
        (colour.astype(np.float32) / 255, "444p16", "XCOLORRANGE=LIMITED"),
        (colour[..., :1], "mono", "XCOLORRANGE=FULL"),
        (colour[..., :1].astype(np.uint16) * 257, "mono16", "XCOLORRANGE=FULL"),
        (np.dstack([colour, colour[..., :1]]), "444", "XCOLORRANGE=LIMITED"),
    ):
        out, sink = write_frames([np.ascontiguousarray(image)] * 2)
        line = f"YUV4MPEG2 W64 H48 F24:1 Ip A0:0 C{name} {more}"
        assert out.startswith(line.encode() + b"\n")
        assert sink.details == f"standard output: {line}"
        assert len(sink.remarks) == (image.shape[2] == 4)
        with PipeSource(BytesIO(out)) as source:
            seen = next(iter(source)).image
        truth = np.repeat(colour[..., :1], 3, axis=2) if image.shape[2] == 1 else colour
        assert np.abs(seen / np.iinfo(seen.dtype).max * 255 - truth).mean() < 1


def test_pixel_format_of_a_stream():
    """What is asked for is written; what the stream cannot hold is refused with what it can."""
    out, _ = copy(stream_of(2), encoding=Encoding(pixel_format="yuv422p10le"))
    assert b" C422p10 " in out.split(b"\n")[0] + b" "
    with pytest.raises(OptionError, match="YUV4MPEG2 does not hold `pixel_format='rgb24'`; use one of yuv420p"):
        write_frames([scene(0)], Encoding(pixel_format="rgb24"))


@pytest.mark.parametrize(
    "encoding",
    [Encoding(codec="h264"), Encoding(crf=3, preset="slow"), Encoding(lossless=True), Encoding(bitrate=10**6)],
)
def test_a_stream_has_no_encoder(encoding):
    """Options of encoders are refused by name."""
    with pytest.raises(OptionError, match=rf"takes no {' or '.join(encoding.given)}; leave that out"):
        write_frames([scene(0)], encoding)


@pytest.mark.parametrize(
    ("pixel_format", "codec", "name"),
    [
        ("yuvj420p", "libx264", "C420mpeg2 XCOLORRANGE=FULL"),
        ("nv12", "libx264", "C420mpeg2"),
        ("yuv422p10le", "libx264", "C422p10"),
        ("gray", "ffv1", "Cmono"),
        ("bgr0", "ffv1", "C444 XCOLORRANGE=LIMITED"),
        ("yuv440p", "ffv1", "C444"),
    ],
)
def test_pixel_formats_of_files(tmp_path, pixel_format, codec, name):
    """A format of the stream's stays, another one becomes the nearest that loses nothing."""
    options = {"preset": "ultrafast", "crf": "0"} if codec == "libx264" else {}
    clip = write_clip(
        tmp_path / "in.mkv", times=range(3), pixel_format=pixel_format, codec=codec, options=options,
        color_range=2 if pixel_format == "yuvj420p" else 0,
    )  # fmt: skip
    target = BytesIO()
    timing = OutputTiming(Fraction(25), Fraction(1, 25))
    with VideoSource(clip) as source, PipeSink(output_of("-", source, timing), target) as sink:
        for frame in source:
            sink.write(frame)
    line, frames = frames_in(target.getvalue())
    assert name in line.decode()
    assert sink.remarks == []
    if pixel_format in ("yuvj420p", "yuv422p10le", "gray"):
        assert frames == [bytes_of(picture) for picture in pictures_of(clip)]


def test_what_a_stream_cannot_say_is_said(tmp_path):
    """Rotation, a matrix of its own and HDR colours are lost with one remark, sound and subtitles with another."""
    clip = write_clip(
        tmp_path / "in.mkv", times=range(3), matrix=QUARTER_TURN, sound="aac", subtitles=[(0, 50, b"one")],
        colorspace=9, color_primaries=9, color_trc=16,
    )  # fmt: skip
    with VideoSource(clip) as source:
        timing = OutputTiming(Fraction(25), Fraction(1, 25))
        with PipeSink(output_of("-", source, timing), BytesIO()) as sink:
            for frame in source:
                sink.write(frame)
        assert sink.remarks == [
            f"{clip} has sound and subtitles, which YUV4MPEG2 cannot hold; left out.",
            f"standard output cannot say the colour matrix and colour primaries and transfer function and rotation of "
            f"{clip}; say it again behind the pipe.",
        ]
        silent = PipeSink(output_of("-", source, timing, encoding=Encoding(audio=False, subtitles=False)), BytesIO())
        assert silent.remarks == []


def test_uneven_times_are_told(piped, tmp_path):
    """A stream has one rate; frames that do not keep it are told once, and --fps is the way out."""
    clip = write_clip(tmp_path / "in.mp4", times=[0, 3, 4, 9, 10, 16], end=20, time_base=Fraction(1, 100))
    done = piped(b"", clip, "-", "--keep-timing", *NEAREST)
    assert done.returncode == 0
    assert [line for line in sentences(done) if "equally long" in line and "--fps" in line] == sentences(done)[1:]
    done = piped(b"", clip, "-", "--fps", "50", *NEAREST)
    assert len(sentences(done)) == 1


def test_frames_that_do_not_fit():
    """A frame of another size, and no frame at all, are OutputErrors."""
    with pytest.raises(OutputError, match="cannot take a frame of 64x64"):
        write_frames([scene(0), scene(0, 64, 64)])
    with pytest.raises(OutputError, match="there were no frames"):
        write_frames([])


def test_from_pipe_to_pipe(piped, tmp_path):
    """Twice the frames at twice the rate, originals to the bit, one line on stderr, only the stream on stdout."""
    data = stream_of(5, "420p10", rate="24000:1001")
    done = piped(data, "-", "-", *NEAREST)
    assert done.returncode == 0
    line, frames = frames_in(done.stdout)
    assert line == b"YUV4MPEG2 W64 H48 F48000:1001 Ip A1:1 C420p10"
    assert len(frames) == 10
    assert frames[::2] == frames_in(data)[1]
    assert len(sentences(done)) == 1
    assert re.fullmatch(r"standard output: 5 -> 10 frames in .*", sentences(done)[0])
    assert list(tmp_path.iterdir()) == []


def test_from_pipe_to_file(piped, tmp_path):
    """Rate, pixel shape, range and every sample of the originals reach a lossless file."""
    data = stream_of(4, "420mpeg2", rate="30000:1001", more=" XCOLORRANGE=FULL").replace(b"A1:1", b"A4:3", 1)
    done = piped(data, "-", "out.mp4", "--lossless", *NEAREST)
    assert (done.returncode, done.stdout) == (0, b"")
    with VideoSource(tmp_path / "out.mp4") as source:
        assert source.info.rate == Fraction(60000, 1001)
        assert (source.stream_info.traits.sample_aspect_ratio, source.traits.full_range) == (Fraction(4, 3), True)
        assert source.stream_info.traits.chroma_location == "left"
    assert [bytes_of(picture) for picture in pictures_of(tmp_path / "out.mp4")][::2] == frames_in(data)[1]


def test_from_pipe_to_images(piped, tmp_path):
    """A stream becomes images, and its pixel shape is told as lost."""
    done = piped(stream_of(4, "444").replace(b"A1:1", b"A4:3", 1), "-", "frames/", *NEAREST)
    assert done.returncode == 0
    assert len(list((tmp_path / "frames").iterdir())) == 7
    assert "which images cannot say" in sentences(done)[1]


def test_from_file_to_pipe(piped, tmp_path):
    """The decoder's planes, and one note about the sound, which --no-audio silences."""
    clip = write_clip(tmp_path / "in.mp4", times=range(4), sound="aac")
    done = piped(b"", "in.mp4", "-", *NEAREST)
    assert frames_in(done.stdout)[1][::2] == [bytes_of(picture) for picture in pictures_of(clip)]
    assert sentences(done)[1:] == ["Note: in.mp4 has sound, which YUV4MPEG2 cannot hold; left out."]
    assert len(sentences(piped(b"", "in.mp4", "-", "--no-audio", *NEAREST))) == 1


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows shells differ")
def test_from_file_to_file_by_redirection(tmp_path):
    """Files behind standard input and output do as well as pipes."""
    write_stream(tmp_path / "in.y4m", 5)
    with (tmp_path / "in.y4m").open("rb") as source, (tmp_path / "out.y4m").open("wb") as target:
        subprocess.run(
            command("-", "-", *NEAREST), cwd=tmp_path, env=environment(), stdin=source, stdout=target, timeout=100,
            check=True,
        )  # fmt: skip
    assert len(frames_in((tmp_path / "out.y4m").read_bytes())[1]) == 10


@pytest.mark.parametrize(
    ("data", "arguments", "code", "word"),
    [
        (b"", ("-", "-"), 1, "standard input is empty"),
        (b"junk\n", ("-", "out.mp4"), 1, "YUV4MPEG2"),
        (stream_of(1), ("-", "-"), 1, "one frame"),
        (stream_of(2)[:5000] + b"x" * 9000, ("-", "out.mp4"), 1, "where frame 3 should begin"),
        (stream_of(2), ("-", "-", "--crf", "20"), 2, "--crf"),
        (stream_of(2), ("-", "-", "--pix-fmt", "magic"), 2, "--pix-fmt"),
        (stream_of(2), ("-", "out.mp4", "--input-fps", "24"), 2, "--input-fps"),
        (stream_of(2), ("compare", "-"), 1, "Standard input can be read only once"),
    ],
)
def test_refusals(piped, tmp_path, data, arguments, code, word):
    """One sentence, its exit code, and no file."""
    method = () if arguments[0] == "compare" else NEAREST
    done = piped(data, *arguments, *method)
    assert done.returncode == code
    assert len(sentences(done)) == 1, done.stderr
    assert re.fullmatch(r"fpsboost: [^\x00-\x1f]+\.", sentences(done)[0])
    assert word in sentences(done)[0]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such terminals")
def test_terminals_are_refused(tmp_path):
    """A person who forgot the pipe is told, on either side."""
    controller, terminal = os.openpty()
    write_stream(tmp_path / "in.y4m", 3)
    try:
        for arguments, ends in ((("in.y4m", "-"), {"stdout": terminal}), (("-", "out.mp4"), {"stdin": terminal})):
            done = subprocess.run(
                command(*arguments, *NEAREST), cwd=tmp_path, env=environment(), stderr=subprocess.PIPE, timeout=100,
                check=False, **ends,
            )  # fmt: skip
            assert done.returncode == 1
            assert re.fullmatch(rb"fpsboost: standard \w+ is a terminal[^\n]*\n", done.stderr)
    finally:
        os.close(controller)
        os.close(terminal)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="pipes end in another way on Windows")
def test_a_closed_pipe_ends_quietly(tmp_path):
    """A reader that has enough ends the run without a word, and not as a success."""
    with start(tmp_path, "-", "-", "--factor", "50", *NEAREST) as source:
        source.stdin.write(stream_of(6, "444p16"))
        source.stdin.close()
        source.stdout.read(100)
        source.stdout.close()
        assert source.stderr.read() == b""
        assert source.wait(60) == 1


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows sends no such signals")
@pytest.mark.parametrize("waits_for", ["header", "frames", "reader"])
def test_a_stopped_run_does_not_wait(tmp_path, waits_for):
    """Asked to end while the program at either end of the pipe sleeps, it ends at once and says so."""
    with start(tmp_path, "-", "-", "--factor", "50" if waits_for == "reader" else "2", *NEAREST) as process:
        try:
            if waits_for == "header":
                # a word of an unfinished first line, so that the pipe is open and nothing more comes
                process.stdin.write(b"YUV4MPEG2 W64")
                process.stdin.flush()
                wait_for_reading(process)
            else:
                process.stdin.write(stream_of(4, "444p16"))
                process.stdin.flush()
                assert process.stdout.read(50).startswith(b"YUV4MPEG2")
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 130
            assert process.stderr.read() == b"Stopped.\n"
        finally:
            process.kill()


def wait_for_reading(process: subprocess.Popen[bytes]) -> None:
    """Return when a process has read what was piped into it."""
    fcntl = pytest.importorskip("fcntl")
    termios = pytest.importorskip("termios")
    waiting = bytearray(4)
    while process.poll() is None:
        fcntl.ioctl(process.stdin, termios.FIONREAD, waiting)
        if not any(waiting):
            return


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="pipes are asked in another way on Windows")
def test_frames_come_out_as_they_are_made(tmp_path):
    """The first frames are there while the input is still open."""
    with start(tmp_path, "-", "-", *NEAREST) as process:
        try:
            data = stream_of(5)
            process.stdin.write(data)
            process.stdin.flush()
            assert process.stdout.readline().startswith(b"YUV4MPEG2 W64 H48 F50:1")
            first = process.stdout.read(6 + 64 * 48 * 3 // 2)
            assert first == b"FRAME\n" + frames_in(data)[1][0]
            process.stdin.close()
            assert len(process.stdout.read()) == 9 * len(first)
            assert process.wait(60) == 0
        finally:
            process.kill()
