"""Every source and every sink keeps the contracts of `fpsboost.io`, whatever kind of file is behind it."""

import os
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from fpsboost import DecodeOptions, Encoding, FpsboostError, Frame, FrameSink, FrameSource, OutputError
from fpsboost.io import new_output
from fpsboost.io.opening import open_source
from fpsboost.io.video.pipe import PipeSource
from fpsboost.io.video.standard_streams import INPUT_NAME
from fpsboost.media import OutputTiming, staging
from support.animation_truth import write_animation
from support.conversion_options import open_output
from support.video_truth import packets_of, scene, write_clip, write_stream

RATE = Fraction(24)
COUNT = 6
UNEVEN = (0, 3, 4, 9, 10, 16)
GOOD_VP9 = {"crf": "4", "b": "0", "deadline": "realtime", "cpu-used": "8"}


def scenes() -> list[np.ndarray]:
    return [scene(index) for index in range(COUNT)]


# How to make a clip of each kind in a folder, whose path is returned.
sources: dict[str, Callable[..., Path]] = {
    "mp4": lambda folder, _: write_clip(folder / "in.mp4", times=range(COUNT)),
    "mov": lambda folder, _: write_clip(folder / "in.mov", times=range(COUNT), sound="aac"),
    "mkv": lambda folder, _: write_clip(folder / "in.mkv", times=range(COUNT), time_base=Fraction(1001, 24000)),
    "webm": lambda folder, _: write_clip(folder / "in.webm", times=range(COUNT), codec="libvpx-vp9", options=GOOD_VP9),
    "uneven": lambda folder, _: write_clip(folder / "in.mp4", times=UNEVEN, end=20, time_base=Fraction(1, 100)),
    "10-bit": lambda folder, _: write_clip(folder / "in.mp4", times=range(COUNT), pixel_format="yuv420p10le"),
    "late": lambda folder, _: write_clip(folder / "in.mp4", times=range(50, 50 + COUNT)),
    "png folder": lambda folder, save: save(folder, count=COUNT) and folder,
    "jpg pattern": lambda folder, save: save(folder, "take{}.jpg", count=COUNT) and folder / "take%d.jpg",
    "tiff16 pattern": lambda folder, save: (
        save(folder, "shot_{:04d}.tif", COUNT, np.uint16) and folder / "shot_####.tif"
    ),
    "gif": lambda folder, _: write_animation(folder / "in.gif", scenes()),
    "apng": lambda folder, _: write_animation(folder / "in.png", scenes()),
    "webp": lambda folder, _: write_animation(folder / "in.webp", scenes()),
    "pipe": lambda folder, _: write_stream(folder / "in.y4m", COUNT),
    "deep pipe": lambda folder, _: write_stream(folder / "in.y4m", COUNT, "420p10"),
    "exr folder": lambda folder, save: save(folder, "shot_{:04d}.exr", COUNT, np.float32) and folder,
}
deep = {"10-bit": np.uint16, "tiff16 pattern": np.uint16, "deep pipe": np.uint16, "exr folder": np.float32}
is_images = {"png folder", "jpg pattern", "tiff16 pattern", "exr folder"}


@pytest.fixture(params=sources)
def clip(request, tmp_path, save_images) -> tuple[str, Path, type]:
    """Each kind of clip: what kind, where it is, the type of its pixels."""
    folder = tmp_path / "in"
    folder.mkdir()
    return request.param, sources[request.param](folder, save_images), deep.get(request.param, np.uint8)


def opened(path: Path, kind: str) -> FrameSource:
    if kind.endswith("pipe"):
        return PipeSource(BytesIO(path.read_bytes()))
    return open_source(str(path), decoding=DecodeOptions(input_fps=RATE if kind in is_images else None))


def test_frames_come_in_order(clip, tmp_path, snapshot):
    """Every frame once, alike, from one to the next at the clock's times; no remark, and no file changed or added.

    Name, size, rate and count are known before the first frame and right after the last.
    """
    kind, path, dtype = clip
    before = snapshot(tmp_path)
    with opened(path, kind) as source:
        info = source.info
        frames = list(source)
        assert source.info == info
    assert len(frames) == COUNT
    assert source.remarks == []
    assert snapshot(tmp_path) == before
    assert all(a.time < b.time for a, b in pairwise(frames))
    assert all((frame.time / source.info.time_base).denominator == 1 for frame in frames)
    assert all(isinstance(value, Fraction) for frame in frames for value in (frame.time, frame.duration))
    truth = [scene(index).astype(float) / 255 for index in range(COUNT)]
    for index, frame in enumerate(frames):
        image = frame.image / (1 if frame.image.dtype == np.float32 else np.iinfo(frame.image.dtype).max)
        assert np.argmin([np.abs(image - other).mean() for other in truth]) == index

    assert {(frame.image.shape, frame.image.dtype) for frame in frames} == {((48, 64, 3), np.dtype(dtype))}
    assert all(frame.image.flags.c_contiguous for frame in frames)
    assert all(abs(a.time + a.duration - b.time) <= source.info.time_base for a, b in pairwise(frames))
    assert frames[-1].duration > 0

    assert info.name == (INPUT_NAME if kind.endswith("pipe") else str(path))
    assert (info.height, info.width) == frames[0].image.shape[:2]
    assert info.frame_count == (None if kind in ("mkv", "webm", "pipe", "deep pipe") else COUNT)
    if kind != "uneven":
        total = frames[-1].time + frames[-1].duration - frames[0].time
        assert abs(total - COUNT / info.rate) <= info.time_base


@pytest.mark.parametrize("frames_read", [0, 2, COUNT])
def test_leaving_closes_the_file(clip, frames_read, tmp_path):
    """Also by an exception, whether nothing, a part or all was read; closing again does no harm."""
    kind, path, _ = clip

    def read_and_fail(source: FrameSource) -> None:
        assert sum(1 for _ in zip(range(frames_read), source, strict=False)) == frames_read
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), opened(path, kind) as source:
        read_and_fail(source)
    assert open_files_below(tmp_path) == []
    source.close()


def open_files_below(folder: Path) -> list[str]:
    if not Path("/proc/self/fd").exists():
        pytest.skip("only Linux tells which files are open")
    links = []
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            links.append(os.readlink(f"/proc/self/fd/{number}"))
    return [link for link in links if link.startswith(str(folder))]


# What to name as the output in a folder, and whether that folder's subfolder `frames` exists before.
targets = {
    "mp4": ("out.mp4", False),
    "mov": ("out.mov", False),
    "mkv": ("out.mkv", False),
    "webm": ("out.webm", False),
    "gif": ("out.gif", False),
    "apng": ("out.apng", False),
    "webp": ("out.webp", False),
    "new folder": ("frames", False),
    "empty folder": ("frames", True),
    "png pattern": ("out_####.png", False),
    "tif pattern": ("frames/out_%02d.tif", True),
}
FAST = {"webm": Encoding(preset="8"), "mov": Encoding(preset="ultrafast", audio=False)}  # .mov takes no Opus


@pytest.fixture(params=["video", "images"])
def source_path(request, tmp_path, save_images) -> Path:
    """A clip to convert, one with sound and one of images."""
    folder = tmp_path / "in"
    folder.mkdir()
    if request.param == "video":
        return write_clip(folder / "in.mkv", times=range(COUNT), sound="libopus")
    save_images(folder, count=COUNT)
    return folder


@pytest.fixture(params=targets)
def target(request, tmp_path) -> tuple[str, Path]:
    """Each kind of target in an otherwise empty folder."""
    name, is_there = targets[request.param]
    (tmp_path / "out").mkdir()
    if is_there:
        (tmp_path / "out" / "frames").mkdir()
    return request.param, tmp_path / "out" / name


def open_pair(source_path: Path, target: tuple[str, Path], overwrite: bool = False) -> tuple[FrameSource, FrameSink]:
    kind, path = target
    source = open_source(str(source_path), decoding=DecodeOptions(input_fps=RATE if source_path.is_dir() else None))
    try:
        timing = OutputTiming(source.info.rate, source.info.time_base)
        encoding = FAST.get(kind, Encoding(preset="ultrafast"))
        sink = open_output(path, source, timing, encoding=encoding, expected_frames=COUNT, overwrite=overwrite)
    except BaseException:
        source.close()
        raise
    return source, sink


def after(act: Callable[[], None], function: Callable[..., None]) -> Callable[..., None]:
    return lambda *arguments: (act(), function(*arguments))[1]


def copy(
    source_path: Path,
    target: tuple[str, Path],
    *,
    overwrite: bool = False,
    fail_at: int | None = None,
    kind: type[BaseException] = RuntimeError,
    while_writing: Callable[[], None] = lambda: None,
) -> FrameSink:
    """Write all frames of a clip unchanged; raise after `fail_at`; act after each and before names are given."""
    source, sink = open_pair(source_path, target, overwrite)
    with pytest.MonkeyPatch.context() as patch, source, sink:
        for module, name in ((staging.StagingDirectory, "publish"), (new_output, "move_all")):
            patch.setattr(module, name, after(while_writing, getattr(module, name)))
        for index, frame in enumerate(source):
            if index == fail_at:
                raise kind
            sink.write(Frame(frame.image, frame.time, frame.duration, frame.original))
            while_writing()
        if fail_at == COUNT:
            raise kind
    return sink


def visible(folder: Path) -> list[str]:
    """Files that a person sees, with their folders if these are not hidden."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return sorted(path.as_posix() for path in paths if not any(part.startswith(".") for part in path.parts))


def frames_of(path: Path) -> int:
    with open_source(str(path), decoding=DecodeOptions(input_fps=None if path.is_file() else RATE)) as source:
        return len(list(source))


def put_something(target: tuple[str, Path]) -> None:
    """Let something precious stand under the target's name."""
    kind, path = target
    if "folder" in kind:
        path.mkdir(exist_ok=True)
        (path / "shot_0001.png").write_bytes(b"precious")
        (path / "000001.png").write_bytes(b"precious")
        (path / "notes.txt").write_bytes(b"precious")
    elif "pattern" in kind:
        name = path.name.replace("####", "0001").replace("%02d", "01")
        (path.parent / name).write_bytes(b"precious")
    else:
        path.write_bytes(b"precious")


def test_output_appears_whole_at_the_end(source_path, target, tmp_path, snapshot):
    """Nothing is to be seen under the final name before the end, everything after it, and nothing else anywhere."""
    source_before = snapshot(tmp_path / "in")
    seen: list[str] = []
    sink = copy(source_path, target, while_writing=lambda: seen.extend(visible(tmp_path / "out")))
    assert seen == []
    assert sink.remarks == []
    assert frames_of(target[1]) == COUNT
    written = snapshot(tmp_path / "out")
    assert not [path for path in written if any(part.startswith(".") for part in path.split("/"))]
    assert len(visible(tmp_path / "out")) == (1 if sink.holds_last_frame else COUNT)
    assert sink.holds_last_frame == (target[0] in ("mp4", "mov", "mkv", "webm", "gif", "apng", "webp"))
    assert snapshot(tmp_path / "in") == source_before


@pytest.mark.parametrize(
    ("fail_at", "kind", "overwrite"),
    [(0, RuntimeError, True), (3, KeyboardInterrupt, False), (3, RuntimeError, True), (COUNT, OutputError, False)],
)
def test_an_exception_leaves_no_trace(source_path, target, tmp_path, snapshot, fail_at, kind, overwrite):
    """Whenever it comes, it goes through, and every folder is as it was, without hidden files and with old ones."""
    if overwrite:
        put_something(target)
    before = snapshot(tmp_path)
    with pytest.raises(kind):
        copy(source_path, target, fail_at=fail_at, kind=kind, overwrite=overwrite)
    assert snapshot(tmp_path) == before


def test_what_exists_is_replaced_only_if_told_and_at_the_end(source_path, target, tmp_path, snapshot):
    """Without `overwrite=True`, an `OutputError` names it, and it stays; with it, it stands until the new one is whole.

    Other files in a folder stay for good.
    """
    put_something(target)
    before = snapshot(tmp_path)
    with pytest.raises(OutputError, match=r"`overwrite=True`") as caught:
        copy(source_path, target)
    assert str(tmp_path / "out") in str(caught.value)
    assert snapshot(tmp_path) == before
    old = {name for name in visible(tmp_path / "out") if not name.endswith(".txt")}
    watched: list[bytes] = []

    def watch() -> None:
        watched.extend((tmp_path / "out" / name).read_bytes() for name in old)

    copy(source_path, target, overwrite=True, while_writing=watch)
    assert set(watched) == {b"precious"}
    written = snapshot(tmp_path / "out")
    assert b"precious" not in [written[name] for name in old if name in written and is_of_this_run(name, source_path)]
    assert "folder" not in target[0] or written["frames/notes.txt"] == b"precious"
    assert not [path for path in written if any(part.startswith(".") for part in path.split("/"))]


def is_of_this_run(name: str, source_path: Path) -> bool:
    """In a folder, frames of images are named like them and those of a video by number alone; the others stay."""
    if not name.startswith("frames/") or "out_" in name:
        return True
    return name.startswith("frames/shot_") == source_path.is_dir()


def test_without_frames_there_is_no_output(source_path, target, tmp_path, snapshot):
    """A sink that is never entered leaves no trace, nor does one that gets no frame, with an error or without."""
    before = snapshot(tmp_path)
    source, sink = open_pair(source_path, target)
    assert snapshot(tmp_path) == before
    with source, suppress(FpsboostError), sink:
        pass
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize(
    "kind",
    ["video", "video by link", "animation", "animation by link", "folder", "folder by link", "pattern", "one image"],
)
def test_the_source_is_never_the_target(tmp_path, save_images, snapshot, kind, overwrite):
    """Writing over what is being read is refused, also with `overwrite=True` and under another name for it."""
    path = tmp_path / "in"
    if kind.startswith("video"):
        path.mkdir()
        path = write_clip(path / "in.mp4", times=range(COUNT))
    elif kind.startswith("animation"):
        path.mkdir()
        path = write_animation(path / "in.webp", scenes())
    else:
        save_images(path, "shot_{:04d}.webp" if kind == "one image" else "shot_{:04d}.png", count=COUNT)
    same = path
    if kind.endswith("link"):
        same = tmp_path / f"link{path.suffix}"
        same.symlink_to(path)
    elif kind == "pattern":
        path = same = path / "shot_%04d.png"
    elif kind == "one image":
        same = path / "shot_0002.webp"
    before = snapshot(tmp_path)
    source = open_source(str(path), decoding=DecodeOptions(input_fps=None if path.is_file() else RATE))
    timing = OutputTiming(RATE, 1 / RATE)
    with source, pytest.raises(OutputError, match=r"input"):
        open_output(same, source, timing, expected_frames=COUNT, overwrite=overwrite)
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm"])
@pytest.mark.parametrize("sound", ["aac", "libopus", "flac", "pcm_s16le"])
def test_sound_is_copied_or_refused_by_name(tmp_path, snapshot, sound, suffix):
    """Sound that is to be copied arrives as it is, or the message says that it does not fit and names the option."""
    clip = write_clip(tmp_path / "in.mkv", times=range(COUNT), sound=sound)
    before = snapshot(tmp_path)
    path = tmp_path / f"out{suffix}"
    encoding = Encoding(preset="8" if suffix == ".webm" else "ultrafast", audio_codec="copy")
    refusal = ""
    try:
        with open_source(str(clip)) as source:
            timing = OutputTiming(source.info.rate, source.info.time_base)
            with open_output(path, source, timing, encoding=encoding) as sink:
                for frame in source:
                    sink.write(frame)
    except OutputError as error:
        refusal = str(error)
    if path.exists():
        assert sound_of(path) == sound_of(clip)
    else:
        assert "`audio=False`" in refusal
        assert snapshot(tmp_path) == before


def sound_of(path: Path) -> bytes:
    """All sound in one piece: demuxers cut raw samples into packets as they like."""
    return b"".join(data for _, data in packets_of(path, "audio"))
