"""Killed, out of space, fed what is no file: a sentence, and never a wrong file under the final name."""

import contextlib
import errno
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import fpsboost
from fpsboost import FpsboostError, InputError, OutputError, RunOptions
from fpsboost.contracts import SilentObserver, Summary
from fpsboost.io.opening import open_source
from support.command_line import assert_refused, environment
from support.video_truth import pictures_of, write_clip

CHEAP = ("--method", "nearest", "--no-cuts")
on_unix = pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals, pipes and limits")


@pytest.fixture
def clip(tmp_path) -> Path:
    """Three frames, in.mp4."""
    return write_clip(tmp_path / "in.mp4", times=range(3))


@contextlib.contextmanager
def files_end_at(size: int) -> Iterator[None]:
    """No file of this process may grow larger; writing beyond fails as on a full disk."""
    import resource  # noqa: PLC0415 (Unix only)

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@on_unix
@pytest.mark.parametrize("share", [0.1, 0.6, 0.97])
@pytest.mark.parametrize("output", ["out.mp4", "out.mov", "out.mkv", "out.webm", "frames/"])
def test_files_that_may_not_grow(fpsboost_, tmp_path, snapshot, output, share):
    """Near the header, within the frames, and near the end: a sentence, the old output, and nothing left behind."""
    write_clip(tmp_path / "in.mp4", size=(96, 128), times=range(8))
    quality = () if output == "frames/" else ("--lossless", "--no-audio")
    arguments = ("in.mp4", output, "--overwrite", *quality, *CHEAP)
    assert fpsboost_(*arguments).code == 0
    before = snapshot(tmp_path)
    whole = max(len(data) for name, data in before.items() if data is not None and name != "in.mp4")
    with files_end_at(int(share * whole)):
        result = fpsboost_(*arguments)
    assert_refused(result, 1, output, "large")
    assert snapshot(tmp_path) == before


@pytest.mark.slow
@on_unix
@pytest.mark.parametrize("arguments", [("--report", "page"), ("--json", "results.json")])
def test_reports_that_may_not_grow(fpsboost_, tmp_path, snapshot, arguments):
    """What a comparison keeps for itself and what it writes: a sentence, and nothing left behind."""
    write_clip(tmp_path / "in.mp4", times=range(3), size=(32, 48))
    before = snapshot(tmp_path)
    command = ("compare", "in.mp4", "--methods", "nearest", "--quiet", *arguments)
    assert fpsboost_(*command).code == 0
    written = tmp_path / arguments[1]
    whole = max(path.stat().st_size for path in (written, *written.rglob("*")) if path.is_file())
    for size, place in ((500, tempfile.gettempdir()), (whole * 9 // 10, arguments[1])):
        shutil.rmtree(written) if written.is_dir() else written.unlink(missing_ok=True)
        with files_end_at(size):
            result = fpsboost_(*command)
        assert_refused(result, 1, place, "File too large")
        assert snapshot(tmp_path) == before


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A disk of 100 kilobytes."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


@pytest.mark.parametrize("output", ["out.mp4", "frames/"])
def test_a_disk_without_any_space(fpsboost_, tmp_path, small_disk, output):
    """Not even what says which job it is can be written: a sentence, and nothing is left."""
    write_clip(tmp_path / "in.mp4", times=range(3))
    with (small_disk / "ballast").open("wb", buffering=0) as ballast, contextlib.suppress(OSError):
        while ballast.write(bytes(4096)):
            pass
    assert_refused(fpsboost_("in.mp4", f"disk/{output}", *CHEAP), 1, "disk/", "space")
    assert os.listdir(small_disk) == ["ballast"]


@pytest.mark.parametrize("output", ["out.mp4", "out.mkv", "out.webm", "frames/", "f_####.png"])
def test_a_full_disk(fpsboost_, tmp_path, small_disk, output):
    """A sentence, and only images that are finished stay, out of sight, to go on with."""
    write_clip(tmp_path / "in.mp4", size=(192, 256), times=range(10))
    is_video = output.startswith("out")
    arguments = ("in.mp4", f"disk/{output}", *(["--lossless"] if is_video else []), "--method", "blend")
    assert_refused(fpsboost_(*arguments), 1, "disk/", "space", "" if is_video else "--resume goes on from there")
    assert os.listdir(small_disk) == ([] if is_video else [f".{output.strip('/')}.unfinished"])


NAMES = [
    *(b"two words", "ünï 日本 \N{CLAPPER BOARD}".encode(), b"new\nline", b"-in", b"$(x);'\"`&|*?~", b"100%d"),
    *(b"take ##2", b"shot_%04d", b"[bold]x", b"http:x", b"\xff\xfe", b"x" * 251, "日".encode() * 83, b"concat:a|b"),
]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems forbid some of these names")
@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_names_are_only_names(fpsboost_, tmp_path, name):
    """As an input and an output, as a video and a folder, alone and among several; and in a sentence."""
    text = os.fsdecode(name)
    video, folder = f"{text}.mp4", f"{text}/"
    write_clip(tmp_path / video, times=range(2))
    for source, target in ((video, "a.mp4"), ("a.mp4", f"./{video}"), ("a.mp4", folder), (folder, "frames/")):
        if target.endswith(".mp4"):
            (tmp_path / target).unlink(missing_ok=True)
        result = fpsboost_("--quiet", *CHEAP, "--", source, target)
        assert (result.code, result.err) == (0, "")
    assert len(pictures_of(tmp_path / video)) == 8
    assert len(os.listdir(tmp_path / "frames/")) == 2 * len(os.listdir(tmp_path / text)) - 1 == 13
    assert fpsboost_("--quiet", *CHEAP, "--", video, folder, "many").code == 0
    assert set(os.listdir(tmp_path / "many")) == {video, text}
    assert_refused(fpsboost_(*CHEAP, "--", video, "a.mp4"), 1, "a.mp4 exists already")
    assert [name for name in os.listdir(tmp_path) if name.startswith(".")] == []


@on_unix
@pytest.mark.parametrize(
    "arguments",
    [
        ("{}.mp4", "out.mp4"),
        ("in.mp4", "{}.mp4"),
        ("in.mp4", "{}/"),
        ("in.mp4", "{}_####.png"),
        ("probe", "{}"),
        ("compare", "{}"),
        ("compare", "in.mp4", "--methods", "nearest", "--json", "{}"),
        ("in.mp4", "out.mp4", "--method", "reproject-scene", "--vectors", "{}"),
        ("{}.mp4", "in.mp4", "{}"),
    ],
)
@pytest.mark.usefixtures("clip")
def test_names_that_are_too_long(fpsboost_, tmp_path, arguments):
    """The system's refusal is a sentence, wherever such a name is given."""
    assert_refused(fpsboost_(*(each.format("x" * 300) for each in arguments)), 1, "xxx", "too long")
    assert os.listdir(tmp_path) == ["in.mp4"]


@on_unix
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("fifo.mp4", "is a named pipe"),
        ("folder.mp4", "is empty"),
        ("loop.mp4", "Too many levels|does not exist"),
        ("dangling.mp4", "does not exist"),
        ("/dev/zero", "is not a video file"),
        ("/dev/null", "is not a video file"),
    ],
)
@pytest.mark.parametrize("command", ["convert", "probe", "compare", "many"])
def test_inputs_that_are_no_files(fpsboost_, tmp_path, name, sentence, command):
    """Nothing waits forever, and the sentence names what it is."""
    os.mkfifo(tmp_path / "fifo.mp4")
    (tmp_path / "folder.mp4").mkdir()
    (tmp_path / "loop.mp4").symlink_to("loop.mp4")
    (tmp_path / "dangling.mp4").symlink_to("nothing")
    before = sorted(os.listdir(tmp_path))
    arguments = {"convert": (name, "out"), "many": (name, "none.mp4", "out")}.get(command, (command, name))
    result = fpsboost_(*arguments)
    assert result.code == 1
    assert re.search(rf"{name}.*({sentence}).*\.$", result.lines[0])
    assert sorted(os.listdir(tmp_path)) == before


@on_unix
@pytest.mark.parametrize("options", [(), ("--overwrite",)])
@pytest.mark.usefixtures("clip")
def test_outputs_that_are_no_files(fpsboost_, tmp_path, options):
    """Pipes stay pipes, and links are not followed to nowhere nor replaced unasked."""
    os.mkfifo(tmp_path / "fifo.mp4")
    assert_refused(fpsboost_("in.mp4", "fifo.mp4", *options, *CHEAP), 1, "fifo.mp4 is a device or a pipe")
    assert (tmp_path / "fifo.mp4").is_fifo()
    assert_refused(fpsboost_("in.mp4", "/dev/null", *options, *CHEAP), 1, "/dev/null is a file")
    (tmp_path / "link.mp4").symlink_to("nothing")
    if not options:
        assert_refused(fpsboost_("in.mp4", "link.mp4", *CHEAP), 1, "link.mp4 exists already")
        assert (tmp_path / "link.mp4").is_symlink()
        assert not (tmp_path / "nothing").exists()


@on_unix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may read everything")
def test_what_may_not_be_read_or_written(fpsboost_, tmp_path, clip):
    """A file, a folder, and what lies in it."""
    shutil.copy(clip, tmp_path / "secret.mp4")
    (tmp_path / "secret.mp4").chmod(0)
    (tmp_path / "closed").mkdir(mode=0)
    for source, target, place in (
        ("secret.mp4", "out.mp4", "secret.mp4"),
        ("closed/in.mp4", "out.mp4", "closed/in.mp4"),
        ("closed", "out", "closed"),
        ("in.mp4", "closed/", "closed/"),
        ("in.mp4", "closed/out.mp4", "closed/out.mp4"),
    ):
        assert_refused(fpsboost_(source, target, *CHEAP), 1, place)
    (tmp_path / "closed").chmod(0o700)


def test_reasons_of_the_system_are_told(monkeypatch, tmp_path):
    """Also where only looking at a name is forbidden, which root never sees."""

    def forbidden(path: Path) -> bool:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "is_dir", forbidden)
    with pytest.raises(InputError, match=r"Cannot read .*in\.mp4 \(Permission denied\); check the name"):
        open_source(str(tmp_path / "in.mp4"))


def convert(source: Path, target: Path | str, act: Callable[[], object]) -> Summary:
    """Convert, and do something when the first frame is written."""
    observer = SilentObserver()
    observer.wrote = lambda summary: act() if summary.frames_out == 1 else None
    return fpsboost.convert(str(source), str(target), method="nearest", run=RunOptions(observer=observer))


@on_unix
@pytest.mark.parametrize("output", ["out.mp4", "out.mkv", "frames/", "f_##.png"])
def test_the_output_folder_goes_away(tmp_path, output):
    """A sentence about the output."""
    source, folder = write_clip(tmp_path / "in.mp4", times=range(30)), tmp_path / "out"
    folder.mkdir()
    with pytest.raises(OutputError, match=re.escape(output.rstrip("/").split("#")[0])):
        convert(source, f"{folder}/{output}", lambda: folder.rename(tmp_path / "elsewhere"))
    assert not (tmp_path / "out").exists()
    assert all(path.name.startswith(".") for path in (tmp_path / "elsewhere").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["h264.mkv", "y4m"])
def test_the_input_is_cut_short(tmp_path, kind):
    """What could be read is converted and the rest told, or it is refused: no third way."""
    source, target = tmp_path / f"in.{kind}", tmp_path / "out.mkv"
    container, codec = {"h264.mkv": ("matroska", "libx264"), "y4m": ("yuv4mpegpipe", "wrapped_avframe")}[kind]
    write_clip(source, times=range(400), size=(96, 128), container=container, codec=codec)
    whole = source.stat().st_size
    try:
        summary = convert(source, target, lambda: os.truncate(source, whole // 2))
    except FpsboostError:
        assert not target.exists()
        return
    assert len(pictures_of(target)) == summary.frames_out == 2 * summary.frames_in
    assert summary.frames_in < 400


@pytest.mark.slow
@on_unix
def test_the_writer_of_a_pipe_dies(tmp_path):
    """Within its first frame: the reader says so and ends by itself."""
    done = subprocess.run(
        [sys.executable, "-m", "fpsboost", "-", "out.mp4"],
        input=b"YUV4MPEG2 W64 H48 F25:1\nFRAME\n" + bytes(100),
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr == b"fpsboost: standard input holds no whole frame; check the program that writes it.\n"
    assert os.listdir(tmp_path) == []
