"""Runs that are stopped: what stays, who may go on with it, and that nobody can tell from the result."""

import json
import os
import subprocess
import sys
import threading
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

import fpsboost
from fpsboost import (
    ByFactor,
    ClipInfo,
    Encoding,
    Frame,
    Interpolator,
    Mask,
    RunOptions,
    Timing,
    VectorFolder,
    convert,
    find_method,
    methods,
    run_conversion,
)
from fpsboost.contracts import ClosesOnExit, OutputRange, SilentObserver, Summary
from fpsboost.conversion import fingerprint_job
from fpsboost.errors import CompleteAlreadyError, OutputError
from fpsboost.io.images.sink import ImageSink
from fpsboost.io.images.source import ImageSource
from fpsboost.io.side.flow import encode_flow
from fpsboost.io.video.sink import VideoSink
from fpsboost.io.video.source import VideoSource
from fpsboost.media import JobFingerprint, OutputTiming, StagingDirectory, Writer, chunks
from fpsboost.media.chunks import ChunkWriter, find_chunks, timed_packets
from fpsboost.media.locks import lock_file
from fpsboost.motion.field import ZeroMotion
from fpsboost.parts.manifest import fingerprint_options
from fpsboost.preparation import ConversionJob
from fpsboost.synthesis.blend import Blend
from support.conversion_options import output_of
from support.video_truth import packets_of, pictures_of, samples_of, scene, write_clip

FRAMES = 25
CHUNK = 10
FACTOR = ByFactor(Fraction(2))
FAST = Encoding(preset="ultrafast")
B_FRAMES = Encoding(preset="veryfast")


class StoppedError(Exception):
    """Raised on purpose."""


class Stop(SilentObserver):
    """An observer that stops the run after so many frames."""

    def __init__(self, after: int | None) -> None:
        self._after = after

    def wrote(self, summary: Summary) -> None:
        if summary.frames_out == self._after:
            raise StoppedError


class Kept(nullcontext[None]):
    """A sink that keeps what it is given."""

    holds_last_frame, remarks = True, list[str]()

    def __init__(self) -> None:
        self.images: list[Any] = []

    def write(self, frame: Frame) -> None:
        self.images.append((frame.image.copy(), frame.time, frame.duration))


class Counting:
    """A synthesizer that counts the images that it makes."""

    def __init__(self) -> None:
        self.count = 0

    def synthesize(self, frame_pair: Any, times: Any) -> Any:
        for image in Blend().synthesize(frame_pair, times):
            self.count += 1
            yield image


def run(
    clip: Path,
    target: Path,
    *,
    resume: bool = False,
    stop_after: int | None = None,
    encoding: Encoding = FAST,
    overwrite: bool = False,
    interpolator: Interpolator | None = None,
) -> Summary:
    """Double a clip in chunks of ten frames."""
    job = JobFingerprint(fingerprint_options(encoding=encoding), resume)
    with VideoSource(clip) as source:
        info = source.info
        timing = OutputTiming(FACTOR.rate(info.rate), FACTOR.time_base(info.time_base))
        sink = VideoSink(
            output_of(target, source, timing, encoding=encoding, overwrite=overwrite, job=job), chunk_frames=CHUNK
        )
        with sink:
            interpolator = interpolator or replace(find_method("blend"), cuts=None)
            return run_conversion(
                source, interpolator, sink, FACTOR, Stop(stop_after), outputs=OutputRange(skip=sink.completed_frames)
            )


def stop(clip: Path, target: Path, after: int, **options: Any) -> str:
    """Stop a run, and return what it says about going on."""
    with pytest.raises(StoppedError) as caught:
        run(clip, target, stop_after=after, **options)
    return " ".join(getattr(caught.value, "__notes__", ()))


def contents(path: Path) -> tuple[Any, ...]:
    """Everything of a video: its packets with their times, its decoded samples, and the sound."""
    pictures = pictures_of(path)
    samples = [[plane.tobytes() for plane in samples_of(picture)] for picture in pictures]
    times = [(picture.pts, picture.duration, picture.time_base) for picture in pictures]
    with_sound = VideoSource(path).file.auxiliary_streams == ["sound"]
    return packets_of(path, "video"), samples, times, packets_of(path, "audio") if with_sound else None


def folder_of(target: Path) -> Path:
    return target.with_name(f".{target.name}.unfinished")


def facts(summary: Summary) -> Summary:
    return replace(summary, seconds=0, completed_frames=0)


def without_texts(summary: Summary) -> Summary:
    return replace(summary, remarks=[], details="")


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Path:
    """A second of pictures and a longer sound; x264 is not the same twice for pictures much smaller than these."""
    folder = tmp_path_factory.mktemp("clip")
    return write_clip(folder / "in.mp4", times=range(FRAMES), sound="aac", sound_seconds=1.3, size=(96, 128))


@pytest.fixture(scope="module")
def whole(tmp_path_factory, clip) -> Path:
    """What a run that nothing stops makes of the clip."""
    target = tmp_path_factory.mktemp("whole") / "whole.mp4"
    run(clip, target)
    return target


ENCODINGS = {
    "h264": (B_FRAMES, ".mp4"),
    "h264 mkv": (FAST, ".mkv"),
    "h264 intra": (Encoding(preset="ultrafast", encoder_options=(("g", "1"),)), ".mp4"),
    "h264 bitrate": (Encoding(preset="veryfast", bitrate=300_000), ".mp4"),
    "hevc": (Encoding("hevc", preset="veryfast"), ".mp4"),
    "vp9": (Encoding("vp9", preset="8", audio=False), ".webm"),
    "vp9 alpha": (Encoding("vp9", preset="8", pixel_format="yuva420p", audio=False), ".webm"),
    "av1": (Encoding("av1", preset="12"), ".mkv"),
    "ffv1": (Encoding("ffv1"), ".mkv"),
    "prores": (Encoding("prores_ks"), ".mov"),
    "mpeg4": (Encoding("mpeg4", bitrate=500_000, encoder_options=(("bf", "2"),)), ".mp4"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ENCODINGS)
def test_going_on_makes_the_same_file(tmp_path, clip, kind):
    """Stopped in the middle and taken up again: the same file, byte by byte, and the same summary."""
    encoding, suffix = ENCODINGS[kind]
    whole, broken = tmp_path / f"whole{suffix}", tmp_path / "broken" / f"whole{suffix}"
    broken.parent.mkdir()
    expected = run(clip, whole, encoding=encoding)
    said = stop(clip, broken, 37, encoding=encoding)
    assert said in [f"{count} frames are finished, and `resume` goes on from there." for count in (20, 30)]
    summary = run(clip, broken, resume=True, encoding=encoding)
    assert contents(broken) == contents(whole)
    assert broken.read_bytes() == whole.read_bytes() or suffix in (".mkv", ".webm")  # which number a file by chance
    assert summary.completed_frames in (20, 30)
    assert [remark.replace("broken/", "") for remark in facts(summary).remarks] == expected.remarks
    assert without_texts(facts(summary)) == without_texts(facts(expected))
    assert os.listdir(broken.parent) == [broken.name]


@pytest.mark.parametrize("kind", ["h264", "hevc", "vp9", "av1", "ffv1"])
def test_chunks_are_one_clip(tmp_path, clip, kind):
    """Over the seams every picture is there at its time, decoded in order, and the clip is as long as its source."""
    encoding, suffix = ENCODINGS[kind]
    encoding = replace(encoding, audio=False)  # Matroska begins with the sound, which is early by what AAC needs
    target = tmp_path / f"out{suffix}"
    run(clip, target, encoding=encoding)
    assert len(pictures_of(target)) == 2 * FRAMES
    with fpsboost.media.opening.open_video(target, "out") as file:
        stream = file.streams.video[0]
        length = stream.duration
        packets = [(packet.dts, packet.pts) for packet in file.demux(stream) if packet.size]
        base = stream.time_base
    decoded = [dts for dts, _ in packets]
    assert all(a < b for a, b in pairwise(decoded))
    assert all(dts <= pts for dts, pts in packets)
    times = sorted(pts * base for _, pts in packets)
    wanted = [Fraction(k, 50) for k in range(2 * FRAMES)]
    assert max(abs(a - b) for a, b in zip(times, wanted, strict=True)) <= (0 if suffix == ".mp4" else Fraction(1, 2000))
    assert suffix != ".mp4" or length * base == 1


def test_frames_that_are_there_are_not_made(tmp_path, clip):
    """Only the images of unfinished chunks are made when a run goes on."""
    counting = Counting()
    method = Interpolator(
        ZeroMotion(), counting, cuts=None, curved=False, compensate_illumination=False, overlays=False
    )
    stop(clip, tmp_path / "out.mp4", 45, interpolator=method)
    there = 10 * len(find_chunks(folder_of(tmp_path / "out.mp4")))
    assert there >= 30
    counting.count = 0
    run(clip, tmp_path / "out.mp4", resume=True, interpolator=method)
    assert counting.count == (2 * FRAMES - there) // 2 - 1  # the last one is held


@pytest.mark.parametrize("resumed_at", [1, 10, 11, 20, 29, 49])
def test_the_default_method_goes_on_the_same(tmp_path, resumed_at):
    """Pairs that are skipped bend the paths of the next ones as ever: every frame from there on is the same."""
    path = write_clip(tmp_path / "in.mp4", times=range(14))
    results = []
    for skip in (0, resumed_at):
        sink, schedule = Kept(), ByFactor(Fraction(7, 2))
        with VideoSource(path) as source:
            summary = run_conversion(source, find_method("nlm-fast"), sink, schedule, outputs=OutputRange(skip=skip))
        assert summary.completed_frames == skip
        results.append((sink.images, facts(summary)))
    (whole, expected), (resumed, found) = results
    assert found == expected
    assert [frame[1:] for frame in resumed] == [frame[1:] for frame in whole]
    for (a, *_), (b, *_) in zip(whole[resumed_at:], resumed[resumed_at:], strict=True):
        assert np.array_equal(a, b)


def test_cuts_and_duplicates_are_counted_the_same(tmp_path):
    """A run that goes on behind cuts and held frames counts them as if it had been there."""
    images = [scene(k // 2, 48, 64) if k < 12 else 255 - scene(3 * k, 48, 64)[:, ::-1] for k in range(24)]
    frames = [Frame(image, Fraction(k, 25), Fraction(1, 25)) for k, image in enumerate(images)]

    class Source(ClosesOnExit):
        info, remarks = ClipInfo("x", 48, 64, Fraction(25), Fraction(1, 25), 24), list[str]()

        def __iter__(self) -> Any:
            return iter(frames)

        def close(self) -> None: ...

    method = replace(find_method("nlm-fast"), synthesizer=Blend())
    found = [
        facts(run_conversion(Source(), method, Kept(), FACTOR, outputs=OutputRange(skip=skip)))
        for skip in (0, 17, 30, 48)
    ]
    assert found[0].scene_cuts == 1
    assert found[0].duplicates > 2
    assert found == [found[0]] * 4


@pytest.mark.slow
def test_all_may_be_there(tmp_path, clip, whole, monkeypatch):
    """A run that is stopped while its file is put together goes on with that alone."""
    monkeypatch.setattr("fpsboost.media.chunks.Assembly.finish", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError) as caught:
        run(clip, tmp_path / "out.mp4")
    assert caught.value.__notes__ == ["50 frames are finished, and `resume` goes on from there."]
    monkeypatch.undo()
    assert run(clip, tmp_path / "out.mp4", resume=True).completed_frames == 50
    assert contents(tmp_path / "out.mp4") == contents(whole)


def test_each_index_is_parsed_once(tmp_path, clip, monkeypatch):
    """When its chunk is muxed, since that of a long film takes a while."""
    parsed = []
    monkeypatch.setattr(chunks, "_index_of", lambda path, of=chunks._index_of: parsed.append(path.name) or of(path))
    run(clip, tmp_path / "out.mp4")
    assert parsed == [f"{number:08d}.chunk" for number in range(2 * FRAMES // CHUNK)]


@pytest.mark.parametrize("damage", ["torn", "flipped", "empty", "missing"])
def test_a_damaged_chunk_is_made_again(tmp_path, clip, whole, damage):
    """What a power cut has left of a chunk counts for nothing, nor does what comes after it."""
    stop(clip, tmp_path / "out.mp4", 49)
    chunk = sorted(folder_of(tmp_path / "out.mp4").glob("*.chunk"))[1]
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 1
    if damage == "missing":
        chunk.unlink()
    else:
        chunk.write_bytes({"torn": data[:-7], "flipped": data, "empty": b""}[damage])
    assert run(clip, tmp_path / "out.mp4", resume=True).completed_frames == 10
    assert (tmp_path / "out.mp4").read_bytes() == whole.read_bytes()


def test_starting_anew_says_so(tmp_path, clip):
    """Without `--resume` what is there goes, in one line, and the result is the same."""
    stop(clip, tmp_path / "out.mp4", 30)
    summary = run(clip, tmp_path / "out.mp4")
    assert summary.completed_frames == 0
    assert summary.remarks == [
        f"{tmp_path / 'out.mp4'} was begun anew, and what an earlier run had finished was thrown away; `resume` goes "
        "on with it."
    ]
    assert os.listdir(tmp_path) == ["out.mp4"]


def test_another_job_is_refused(tmp_path, clip):
    """The sentence names what differs, and what is finished stays for the job that it belongs to."""
    stop(clip, tmp_path / "out.mp4", 30, encoding=replace(FAST, crf=20))
    before = sorted(folder_of(tmp_path / "out.mp4").iterdir())
    with pytest.raises(
        OutputError, match=r"out\.mp4 was begun with crf 20 and not 30; give the same input and options, or start anew"
    ):
        run(clip, tmp_path / "out.mp4", resume=True, encoding=replace(FAST, crf=30))
    assert sorted(folder_of(tmp_path / "out.mp4").iterdir()) == before
    run(clip, tmp_path / "out.mp4", resume=True, encoding=replace(FAST, crf=20))


def test_an_existing_target_still_needs_overwriting(tmp_path, clip):
    """What an unfinished run would replace is replaced only where that is said again."""
    (tmp_path / "out.mp4").write_bytes(b"precious")
    stop(clip, tmp_path / "out.mp4", 30, overwrite=True)
    with pytest.raises(OutputError, match="pass `overwrite=True`"):
        run(clip, tmp_path / "out.mp4", resume=True)
    assert (tmp_path / "out.mp4").read_bytes() == b"precious"
    assert run(clip, tmp_path / "out.mp4", resume=True, overwrite=True).completed_frames >= 10
    assert len(pictures_of(tmp_path / "out.mp4")) == 2 * FRAMES


def test_two_at_once(tmp_path, clip):
    """A second run to the same output is refused while the first one writes, and disturbs nothing."""
    held = StagingDirectory(folder_of(tmp_path / "out.mp4"), "output.mp4", "out.mp4", JobFingerprint({}))
    held.open()
    before = sorted(folder_of(tmp_path / "out.mp4").iterdir())
    for resume in (False, True):
        with pytest.raises(OutputError, match=r"out\.mp4 is being written by another run; wait for it, or choose"):
            run(clip, tmp_path / "out.mp4", resume=resume)
    assert sorted(folder_of(tmp_path / "out.mp4").iterdir()) == before
    held.close(keep=False)
    run(clip, tmp_path / "out.mp4")
    assert os.listdir(tmp_path) == ["out.mp4"]


@pytest.mark.parametrize("given", [(0, 2), (-1, -1), (1, 0), (-219043332147, -219043332146)])
def test_no_picture_is_decoded_after_it_is_shown(tmp_path, given):
    """As mp4 cannot hold it: x265 may say so of two pictures, or give both one time."""
    writer = ChunkWriter(tmp_path, 0, b"")
    for pts, dts in enumerate(given):
        packet = av.Packet(b"picture")
        packet.pts, packet.dts = pts, dts
        writer.add(packet, 1, b"")
    first, second = (packet.dts for packet in timed_packets([writer.finish(2)]))
    assert first < second
    assert (-2 <= first <= 0, second <= 1) == (True, True)


KILLING = """
import itertools, os, random, signal, sys, threading
from pathlib import Path

from fpsboost.errors import CompleteAlreadyError
from test_resume import run

clip, folder, whole = Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]).read_bytes()


def attempt(target, last=None):
    # in a process that is killed at its last call of a function, in whichever thread; how it ended, and all its calls
    reader, writer = os.pipe()
    process = os.fork()  # before anything has started a thread
    if not process:
        calls = itertools.count(1)

        def count(*_):
            if next(calls) == last:
                os.kill(os.getpid(), signal.SIGKILL)

        threading.setprofile(count)
        sys.setprofile(count)
        try:
            run(clip, target, resume=True)
        except CompleteAlreadyError:
            pass
        sys.setprofile(None)
        os.write(writer, str(next(calls)).encode())
        os._exit(0)
    os.close(writer)
    with open(reader) as said:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), said.read()


code, calls = attempt(folder / "0.mp4")
assert code == 0, code
chance, kills, target = random.Random(5), 0, folder / "1.mp4"
while kills < 6 or code != 0:
    code, _ = attempt(target, chance.randrange(1, int(calls)) if kills < 6 else None)
    kills += code != 0
    assert code in (0, -signal.SIGKILL), code
    assert code != 0 or target.exists()
    assert not target.exists() or target.read_bytes() == whole
    if code == 0:
        target = folder / f"{kills + 1}.mp4"
for target in folder.iterdir():
    assert target.read_bytes() == whole, target
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_killed_at_random_moments(tmp_path):
    """However often a run is killed, no file has the final name before it is whole, and then it is the same."""
    clip = write_clip(tmp_path / "in.mp4", times=range(25), sound="aac", size=(96, 128))
    run(clip, tmp_path / "whole.mp4")
    folders = Path(__file__).parent, Path(__file__).parents[1], Path(fpsboost.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, folders))}
    (tmp_path / "out").mkdir()
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", KILLING, clip, tmp_path / "out", tmp_path / "whole.mp4"],
        env=environment,
        stderr=subprocess.PIPE,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()


def write_images(source: Path, target: Path, *, stop_after: int | None = None, **options: Any) -> ImageSink:
    """Copy images, and stop after some."""
    images = ImageSource(str(source), Fraction(24))
    job = JobFingerprint({"input": "same"}, options.pop("resume", False))
    timing = OutputTiming(Fraction(24), Fraction(1, 24))
    count = len(images.images.files)
    sink = ImageSink(output_of(target, images, timing, expected_frames=count, **{"job": job, **options}))
    with sink:
        for index, frame in enumerate(images):
            if index == stop_after:
                raise StoppedError
            there = frame.image if index >= sink.completed_frames else np.zeros_like(frame.image)
            sink.write(replace(frame, image=there))
    return sink


@pytest.fixture
def images(tmp_path, save_images) -> Path:
    """Ten images."""
    save_images(tmp_path / "in", count=10)
    return tmp_path / "in"


@pytest.mark.parametrize("name", ["out", "empty", "empty/x_###.png"])
def test_images_go_on(tmp_path, images, snapshot, name):
    """Finished images stay hidden, torn ones count for nothing, and the rest is added."""
    (tmp_path / "empty").mkdir()
    with pytest.raises(StoppedError) as caught:
        write_images(images, tmp_path / name, stop_after=4)
    assert caught.value.__notes__ == ["4 of 10 frames are finished, and `resume` goes on from there."]
    (stage,) = tmp_path.rglob("output")
    torn = sorted(stage.iterdir())[3]
    torn.rename(torn.with_name(torn.name + ".part"))
    assert write_images(images, tmp_path / name, resume=True).completed_frames == 3
    found = snapshot(tmp_path)
    assert not [path for path in found if any(part.startswith(".") for part in path.split("/"))]
    written = [data for path, data in sorted(found.items()) if data is not None and not path.startswith("in/")]
    assert written == [data for path, data in sorted(snapshot(images).items())]
    with pytest.raises(CompleteAlreadyError, match="exists already and no run of it is unfinished"):
        write_images(images, tmp_path / name, resume=True)
    assert snapshot(tmp_path) == found


@pytest.mark.parametrize("has_left", ["whole and manifest.json", "whole", ""])
@pytest.mark.parametrize("kind", ["video", "images"])
def test_what_a_run_left_that_was_killed_after_naming_is_removed(tmp_path, clip, images, monkeypatch, kind, has_left):
    """By the next run, though it is refused because the output exists; while another run holds it, it stays."""
    target = tmp_path / ("out.mp4" if kind == "video" else "out")

    def convert_it() -> None:
        run(clip, target) if kind == "video" else write_images(images, target)

    with monkeypatch.context() as patch:
        patch.setattr(StagingDirectory, "_empty", lambda _: None)  # killed before
        patch.setattr(StagingDirectory, "_remove_emptied", lambda _: None)
        convert_it()
    (left,) = tmp_path.glob(".*.unfinished")
    if "manifest.json" in has_left:
        (left / "manifest.json").write_text("{}")
    if not has_left:
        (left / "whole").unlink()
    with (left / "lock").open("a+b") as lock:
        lock_file(lock)
        with pytest.raises(OutputError, match=r"exists|not empty"):
            convert_it()
        assert left.is_dir()
    with pytest.raises(OutputError, match=r"exists|not empty"):
        convert_it()
    assert not left.exists()


@pytest.mark.parametrize("moved", [0, 3, 10])
def test_moving_goes_on(tmp_path, images, snapshot, monkeypatch, moved):
    """A run that is killed while its images get their names in a folder goes on with that, also at a second attempt."""
    (tmp_path / "out").mkdir()

    class Killed(BaseException): ...

    def move_some(moves: list[tuple[Path, Path]], _: object) -> None:
        for here, there in moves[:moved]:
            here.rename(there)
        monkeypatch.setattr("fpsboost.io.images.sink.ImageSink._leave", lambda sink, _: sink._unfinished._release())
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr("fpsboost.io.new_output.move_all", move_some)
        patch.setattr(Path, "unlink", lambda *_, **__: None)
        with pytest.raises(Killed):
            write_images(images, tmp_path / "out")
    monkeypatch.undo()
    with pytest.raises(StoppedError):
        write_images(images, tmp_path / "out", resume=True, stop_after=0)
    assert write_images(images, tmp_path / "out", resume=True).completed_frames == 10
    assert sorted(snapshot(tmp_path / "out").values()) == sorted(snapshot(images).values())


def stop_after(monkeypatch: pytest.MonkeyPatch, frames: int, reporter: str = "Reporter") -> None:
    """Let Ctrl-C come when so many frames are on their way and a chunk is finished."""
    finished, finish = threading.Event(), Writer._finish_chunk

    def finish_chunk(writer: Writer) -> None:
        finish(writer)
        finished.set()

    def wrote(_: object, summary: Summary) -> None:
        if summary.frames_out >= frames:
            assert finished.wait(60)
            raise KeyboardInterrupt

    monkeypatch.setattr(Writer, "_finish_chunk", finish_chunk)
    monkeypatch.setattr(f"fpsboost.cli.messages.{reporter}.wrote", wrote)


COMMAND = ("in.mp4", "out.mp4", "--factor", "40", "-m", "nearest", "--preset", "ultrafast", "--duplicates", "keep")


def test_the_command_line_goes_on(fpsboost_, tmp_path, monkeypatch):
    """Ctrl-C says how much is finished; --resume says how much was there; a third time there is nothing to do."""
    write_clip(tmp_path / "in.mp4", times=range(8))
    with monkeypatch.context() as patch:
        stop_after(patch, 260)
        result = fpsboost_(*COMMAND)
    assert (result.code, result.err) == (
        130,
        "Stopped; 240 of 320 frames are finished, and --resume goes on from there.\n",
    )
    result = fpsboost_(*COMMAND, "--resume", "--crf", "30")
    assert result.err.startswith(
        "fpsboost: out.mp4 was begun with crf None and not 30; give the same input and options, or start anew "
    )
    result = fpsboost_(*COMMAND, "--resume")
    assert result.code == 0
    assert result.err.startswith("out.mp4: 8 -> 320 frames, 240 of which were there already in ")
    assert sorted(os.listdir(tmp_path)) == ["in.mp4", "out.mp4"]
    result = fpsboost_(*COMMAND, "--resume")
    assert (result.code, result.err) == (
        0,
        "out.mp4 exists already and no run of it is unfinished, so it was left as it is.\n",
    )
    assert fpsboost_(*COMMAND, "--resume", "--quiet").err == ""


def test_programs_hear_how_much_is_finished(fpsboost_, tmp_path, monkeypatch):
    """The last object of a run that is stopped has the number of finished frames; the sentence follows."""
    write_clip(tmp_path / "in.mp4", times=range(8))
    stop_after(monkeypatch, 260, "JsonReporter")
    *_, stopped, sentence = fpsboost_(*COMMAND, "--progress", "json").lines
    assert {"stage": "stopped", "finished": 240, "frames": 320}.items() <= json.loads(stopped).items()
    assert sentence == "Stopped; 240 of 320 frames are finished, and --resume goes on from there."


def test_another_input_is_refused(fpsboost_, tmp_path, monkeypatch):
    """A file that was changed meanwhile is another job, also under the same name."""
    write_clip(tmp_path / "in.mp4", times=range(8))
    with monkeypatch.context() as patch:
        stop_after(patch, 260)
        fpsboost_(*COMMAND)
    write_clip(tmp_path / "in.mp4", times=range(9))
    result = fpsboost_(*COMMAND, "--resume")
    assert result.code == 1
    assert "out.mp4 was begun with input files that have changed since; give the same" in result.err


def test_every_option_belongs_to_the_job(tmp_path):
    """Whatever `convert` is told is part of the job, but for how it is run."""
    clip = write_clip(tmp_path / "in.mp4")
    job = ConversionJob(clip, tmp_path / "out.mp4", Timing(3), methods["nlm"])
    with VideoSource(clip) as source:
        facts = fingerprint_job(job, RunOptions(), source).facts
    assert (facts["timing.factor"], facts["in_place"]) == ("3", "False")
    arguments = set(convert.__annotations__) - {"return"}
    noted = {name.partition(".")[0] for name in facts if name != "decoding_files"}  # those of a guide
    assert noted == arguments - {"output", "options", "run"} | {"in_place", "input_files", "fpsboost"}


@pytest.mark.parametrize(
    ("names", "sentence"), [(("-", "out.mp4"), "came through a pipe"), (("in.mp4", "-"), "went into")]
)
def test_pipes_cannot_go_on(fpsboost_, tmp_path, monkeypatch, names, sentence):
    """What was piped is gone, and the sentence says so."""
    from support.video_truth import stream_of  # noqa: PLC0415

    (tmp_path / "in.y4m").write_bytes(stream_of(4))
    write_clip(tmp_path / "in.mp4")
    with (tmp_path / "in.y4m").open() as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        result = fpsboost_(*names, "--resume", "-m", "nearest")
    assert result.code == 2
    assert sentence in result.err
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize(
    ("option", "file", "method_of"),
    [
        ("vectors", "a_forward.flo", lambda folder: find_method("reproject-scene", VectorFolder(folder))),
        ("mask", "a.png", lambda folder: replace(methods["nlm"], mask=Mask(folder / "a.png"))),
    ],
)
def test_files_of_an_option_belong_to_the_job(tmp_path, option, file, method_of):
    """Motion vectors and masks that were made again are another job, though they have the same names."""
    for name in ("a_backward.flo", "a_forward.flo", "a.png"):
        (tmp_path / name).write_bytes(encode_flow(np.zeros((4, 4, 2), np.float32)))
    before = fingerprint_options(method=method_of(tmp_path))
    assert fingerprint_options(method=method_of(tmp_path)) == before
    os.utime(tmp_path / file, (1, 1))
    after = fingerprint_options(method=method_of(tmp_path))
    assert not [value for value in before.values() if " at 0x" in value]
    differing = {key.rpartition(".")[2] for key in before if before[key] != after[key]}
    assert differing == {f"{option}_files"}
