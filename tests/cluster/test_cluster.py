"""Parts that many workers make: the output is that of one process, whatever happens to workers on the way."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from fpsboost import ConversionJob, DecodeOptions, Encoding, Part, RunOptions, Timing, convert_job, find_method, join
from fpsboost.cluster import ClusterError, convert
from fpsboost.contracts import SilentObserver, Summary
from fpsboost.errors import (
    CompleteAlreadyError,
    FpsboostError,
    InputError,
    OptionError,
    OutputError,
    notes_of,
)
from support.command_line import assert_refused
from support.video_truth import packets_of, write_clip

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

from fpsboost.cluster import clients, dask_engine, worker  # noqa: E402 (only where Dask is installed)


def test_largest_parts_go_first():
    """And parts of one size in order."""
    planned = {Part(number, 4): frames for number, frames in enumerate((10, 30, 20, 20), 1)}
    assert [part.number for part in dask_engine.largest_first(planned)] == [2, 3, 4, 1]


@pytest.mark.parametrize(
    ("error", "most", "message"),
    [
        (
            dask_engine.WorkerLostError(),
            dask_engine.MAX_LOST_WORKERS,
            r"10 workers died while they made part 1/2, the last one at b;",
        ),
        (OutputError("The disk is full."), dask_engine.MAX_FAILURES, "The disk is full"),
        *((kind("others would have it"), 1, "others") for kind in (InputError, OptionError, ClusterError)),
    ],
)
def test_a_part_that_fails_everywhere_ends_the_run(error, most, message):
    """After a bounded number of workers or attempts, at once where others would fail too."""
    attempts = dask_engine._Attempts()
    for _ in range(most - 1):
        attempts.fail(Part(1, 2), "a", error)
    with pytest.raises(FpsboostError, match=message):
        attempts.fail(Part(1, 2), "b", error)


FRAMES = 250  # frames of the clip; twice as many are two chunks and a bit


@dataclass
class Clip:
    """A clip, and what one process makes of it."""

    job: ConversionJob
    whole: Path

    def to(self, output: Path) -> ConversionJob:
        """Return the same conversion to another output."""
        return replace(self.job, output=str(output))

    def is_whole(self, output: Path) -> bool:
        """Return whether another output is that of one process, and nothing else is left beside it."""
        made, expected = (
            [each.read_bytes() for each in sorted(path.iterdir())]
            if path.is_dir()
            else [packets_of(path, kind) for kind in ("video", "audio")]
            for path in (output, self.whole)
        )
        return made == expected and [path.name for path in output.parent.iterdir()] == [output.name]


@pytest.fixture(autouse=True)
def few_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut into two parts a worker, and ask the scheduler more often."""
    monkeypatch.setattr("fpsboost.cluster.dask_engine.PARTS_PER_WORKER", 2)
    monkeypatch.setattr("fpsboost.cluster.dask_engine.LOCK_INTERVAL", 0.02)
    monkeypatch.setattr(dask_engine, "WORKERS_INTERVAL", 0.1)
    monkeypatch.setattr(dask_engine, "GROWN_CLUSTER", 2)


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Clip:
    folder = tmp_path_factory.mktemp("video")
    clip = write_clip(folder / "in.mp4", times=range(FRAMES), sound="aac", sound_seconds=3)
    rate, encoding = Timing(Fraction(2)), Encoding(preset="ultrafast")
    job = ConversionJob(str(clip), str(folder / "whole.mp4"), rate, find_method("blend"), encoding=encoding)
    convert_job(job)
    return Clip(job, folder / "whole.mp4")


@pytest.fixture(scope="module")
def images(tmp_path_factory) -> Clip:
    """A clip that becomes a folder of images, whose parts may be small, by a curve that turns back."""
    folder = tmp_path_factory.mktemp("images")
    clip = write_clip(folder / "in.mp4", times=range(20))
    rate = Timing(retime="0=0 20f=19f 39f=.5f")
    job = ConversionJob(str(clip), str(folder / "whole/"), rate, find_method("blend"))
    convert_job(job)
    return Clip(job, folder / "whole")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with clients.local_client(2) as client:
        yield client


@pytest.fixture
def output(tmp_path) -> Path:
    """A path in a folder of its own."""
    (tmp_path / "out").mkdir()
    return tmp_path / "out" / "made"


class Once(SilentObserver):
    """An observer that calls a function once when so many frames are written, and keeps the counts."""

    def __init__(self, act: Callable[[], None] | None = None, after: int = 1) -> None:
        self._act, self._after, self.counts, self.expected = act, after, list[int](), None

    def opened(self, info: Any, expected_frames: int | None) -> None:
        self.expected = expected_frames

    def wrote(self, summary: Summary) -> None:
        self.counts.append(summary.frames_out)
        if self._act is not None and summary.frames_out >= self._after:
            act, self._act = self._act, None
            act()


def interrupt() -> None:
    raise KeyboardInterrupt


def test_dask_makes_the_same_images(client, images, output):
    """Byte by byte; progress is that of all workers together."""
    observer = Once()
    summary = convert(images.to(output), client, run=RunOptions(observer=observer))
    assert images.is_whole(output)
    assert summary.frames_out == observer.expected == observer.counts[-1] == 39
    assert observer.counts == sorted(observer.counts)


def test_dask_follows_guides(client, output, tmp_path, monkeypatch):
    """A guide that the client names by a path of its own folder: images and counts are those of one process."""
    clip = write_clip(tmp_path / "in.mp4", times=range(8))
    write_clip(tmp_path / "proxy.mp4", times=range(14), time_base=Fraction(1, 50), size=(24, 32))
    monkeypatch.chdir(tmp_path)
    decoding = DecodeOptions(guide="proxy.mp4")
    job = ConversionJob(str(clip), str(tmp_path / "whole/"), Timing(Fraction(2)), find_method("blend"), decoding)
    whole = convert_job(job)
    clip_made = Clip(job, tmp_path / "whole")
    made = convert(clip_made.to(output), client)
    assert clip_made.is_whole(output)
    assert made.guided_frames == whole.guided_frames == 7
    told, expected = (
        [each.values["found"] for each in summary.remarks if each.kind == "guide-followed"] for summary in (made, whole)
    )
    assert told == expected != []


def test_a_killed_dask_worker_has_its_part_made_again(client, video, output):
    """SIGKILL in the middle of a part of a video, whose packets and sound are those of one process then."""
    target = output.with_suffix(".mp4")

    def kill() -> None:
        address = next(address for address, keys in client.processing().items() if keys)
        os.kill(client.run(os.getpid, workers=[address])[address], signal.SIGKILL)

    convert(video.to(target), client, run=RunOptions(observer=Once(kill)))
    assert video.is_whole(target)
    client.wait_for_workers(2)


def set_largest_file(size: int) -> None:
    """Have this process fail to write larger files, as if its disk were full."""
    import resource  # noqa: PLC0415 (in a worker)

    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


@pytest.mark.skipif(sys.platform == "win32", reason="has no such limits")
def test_a_worker_whose_disk_is_full_is_passed_over(client, images, output, monkeypatch):
    """Its parts are made by the other one."""
    failed, fail = [], dask_engine._Attempts.fail
    monkeypatch.setattr(dask_engine._Attempts, "fail", lambda *found: (failed.append(found[2:]), fail(*found)))
    address = min(client.nthreads())
    client.run(set_largest_file, 100, workers=[address])
    try:
        convert(images.to(output), client)
    finally:
        client.run(set_largest_file, -1, workers=[address])
    assert images.is_whole(output)
    assert {worker for worker, _ in failed} == {address}
    assert all(isinstance(error, OutputError) for _, error in failed)


def test_parts_travel_where_storage_is_not_shared(client, images, output, monkeypatch):
    """Workers that do not see the folder of the parts write into their own, and leave nothing there."""
    order = dask_engine.WorkerOrder
    monkeypatch.setattr(
        dask_engine, "WorkerOrder", lambda task, facts, mark, topic: order(task, facts, mark + "?", topic)
    )
    monkeypatch.setattr(dask_engine, "PIECE_BYTES", 1000)
    convert(images.to(output), client)
    assert images.is_whole(output)
    left = client.run(lambda dask_worker: [str(path) for path in Path(dask_worker.local_directory).rglob("*-of-*")])
    assert list(left.values()) == [[], []]


def test_an_interrupted_client_stops_its_workers(client, images, output):
    """Tasks end at their next frame; a later run goes on with the parts that were complete."""
    with pytest.raises(KeyboardInterrupt) as caught:
        convert(images.to(output), client, run=RunOptions(observer=Once(interrupt, after=21)))
    assert "`resume` goes on" in notes_of(caught.value)
    while any(client.run(lambda dask_worker: dask_worker.state.executing_count).values()):
        pass
    assert convert(images.to(output), client, run=RunOptions(resume=True)).completed_frames > 0
    assert images.is_whole(output)


def test_two_clients_of_one_job_are_one(client, images, output):
    """No part is made twice, and the later one to finish is told that the output is there."""
    both = threading.Barrier(2)

    class Together(SilentObserver):
        def opened(self, info: Any, expected_frames: int | None) -> None:
            both.wait()

    def run(client: Any) -> None:
        with suppress(CompleteAlreadyError):
            convert(images.to(output), client, run=RunOptions(observer=Together()))

    def finished_tasks(dask_scheduler: Any) -> list[str]:
        log = [entry for entry in dask_scheduler.transition_log if entry[1:3] == ("processing", "memory")]
        return [entry[0] for entry in log if entry[0].startswith("fpsboost-")]

    before = len(client.run_on_scheduler(finished_tasks))
    with distributed.Client(client.scheduler.address, set_as_default=False) as other, ThreadPoolExecutor(2) as pool:
        list(pool.map(run, (client, other)))  # any other error is raised here
    made = client.run_on_scheduler(finished_tasks)[before:]
    assert len(made) == len(set(made))
    assert images.is_whole(output)


def test_an_output_just_made_by_another_client_is_complete(images, output):
    """Even before that client has removed the parts, which it does a moment later."""
    parts = [Part(number, 2) for number in (1, 2)]
    for part in parts:
        convert_job(images.to(output), run=RunOptions(chunk=part))
    join(output, [part.folder(output) for part in parts])
    with pytest.raises(CompleteAlreadyError, match="was written by another run"):
        dask_engine._join(str(output), [part.folder(output) for part in parts], overwrite=False)
    assert parts[0].folder(output).is_dir()


@pytest.mark.parametrize(
    ("fact", "message"),
    [
        ("fpsboost", r"The worker at tcp://[\d.:]+ has fpsboost \S+, and the client another; install the same"),
        ("libraries", r"The worker at tcp://[\d.:]+ has PyAV .+, and the client another; install the same"),
        ("input", r"The worker at tcp://[\d.:]+ has a different file under the name of the input; copy"),
        ("self_test", r"The worker at tcp://[\d.:]+ computes different pixels than the client; leave it out"),
    ],
)
def test_a_worker_that_differs_is_refused(client, images, output, monkeypatch, fact, message):
    """In one sentence with its address: versions, the content of the input, and the bits of a frame must agree."""
    facts = worker.job_facts
    monkeypatch.setattr(dask_engine, "job_facts", lambda job: {**facts(job), fact: "another"})
    with pytest.raises(ClusterError, match=message):
        convert(images.to(output), client)
    assert list(output.parent.iterdir()) == []


def test_a_scheduler_that_is_gone_is_said(client, images, output, tmp_path):
    """In one sentence; what is complete then is taken over by a later run."""
    place = tmp_path / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_{}", "--scheduler-file", str(place), "--no-dashboard"]

    def start(role: str, *more: str) -> subprocess.Popen[bytes]:
        arguments = [each.format(role) for each in command] + [*more]
        return subprocess.Popen(arguments, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    started = [start("scheduler", "--port", "0"), start("worker", "--no-nanny", "--nthreads", "1")]
    try:
        with (
            distributed.utils.silence_logging_cmgr("critical"),
            suppress(OSError),
            distributed.Client(scheduler_file=str(place)) as far,
        ):
            far.wait_for_workers(1)
            with pytest.raises(ClusterError, match=r"^The scheduler at tcp://[\d.:]+ is gone;") as caught:
                convert(images.to(output), far, run=RunOptions(observer=Once(started[0].kill, after=11)))
        assert "`resume` goes on" in notes_of(caught.value)
    finally:
        for process in started:
            process.kill()
            process.wait()
    convert(images.to(output), client, run=RunOptions(resume=True))
    assert images.is_whole(output)


def test_parts_of_another_job_are_not_joined(client, images, output):
    """They are refused, and replaced if the output may be."""
    other = replace(images.to(output), timing=Timing(Fraction(4)))
    convert_job(other, RunOptions(chunk=Part(1, 2)))
    with pytest.raises(
        OutputError, match=r"contains parts with a different factor; remove it, or give `overwrite=True`"
    ):
        convert(images.to(output), client)
    convert(images.to(output), client, run=RunOptions(overwrite=True))
    assert images.is_whole(output)


@pytest.mark.parametrize("run", [RunOptions(chunk=Part(1, 2)), RunOptions(in_place=True)])
def test_what_has_no_parts_is_refused(client, images, output, run):
    """Parts of parts, and images beside the input."""
    with pytest.raises(OptionError, match=r"`(cluster|in_place)` and .* cannot be combined"):
        convert(images.to(output), client, run=run)


def test_an_output_that_exists_is_refused_before_anything_is_made(client, video, output):
    """Not when hours of work are to be joined."""
    target = output.with_suffix(".mp4")
    target.touch()
    with pytest.raises(OutputError, match="exists"):
        convert(video.to(target), client)
    assert not Part(1, 1).folder(str(target)).parent.exists()


def test_workers_of_this_machine_on_the_command_line(fpsboost_, client, images, output, monkeypatch):
    """The same images, by as many workers as the memory has room for."""
    asked = []

    @contextmanager
    def local_client(workers: int) -> Iterator[Any]:
        asked.append(workers)
        yield client

    monkeypatch.setattr(clients, "local_client", local_client)
    curve = images.job.timing.retime
    result = fpsboost_(images.job.input, f"{output}/", "--retime", curve, "--method", "blend", "--cluster", "local")
    assert result.code == 0, result.err
    assert images.is_whole(output)
    assert len(asked) == 1
    assert 1 <= asked[0] <= (os.cpu_count() or 1)


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--cluster", "tcp://127.0.0.1:1"], 1, "There is no scheduler at tcp://127.0.0.1:1"),
        (["--cluster", "tls://127.0.0.1:1"], 1, "tls://127.0.0.1:1 needs certificates"),
        (["--cluster", "host:8786"], 2, "such as tls://host:8786, not host:8786"),
    ],
)
def test_what_the_command_line_refuses(fpsboost_, images, output, monkeypatch, arguments, code, sentence):
    """A scheduler that is not there, encryption without certificates, and no address."""
    monkeypatch.setattr(clients, "CONNECT_SECONDS", 0.2)
    assert_refused(fpsboost_(images.job.input, f"{output}/", *arguments), code, sentence)


def test_dask_that_is_not_installed(fpsboost_, images, output, monkeypatch):
    """The sentence says what to install."""
    monkeypatch.setitem(sys.modules, "fpsboost.cluster.dask_engine", None)
    monkeypatch.delattr("fpsboost.cluster.dask_engine")
    sentence = "--cluster needs Dask; install it with: pip install 'fpsboost[cluster]'."
    assert_refused(fpsboost_(images.job.input, f"{output}/", "--cluster", "local"), 2, sentence)
