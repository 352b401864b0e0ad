"""Measure what the stages of a conversion cost on this machine, CPU seconds of one process with one thread. Linux only.

Stages are timed in this process, on frames of several sections of a clip. What they leave out is the difference to
conversions of the same frames, which are commands of their own. All is pinned to one core, which decoder and encoder
keep to as well.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice, pairwise
from pathlib import Path
from statistics import mean, median, pstdev
from subprocess import PIPE, Popen
from typing import Any
from unittest.mock import patch

import av
import numpy as np
from film_parts import Costs

from fpsboost.errors import InputError, OptionError
from fpsboost.frame import FrameImage
from fpsboost.frame_cache import FrameCache
from fpsboost.interpolator import Interpolator, with_neighbours
from fpsboost.io.opening import open_source
from fpsboost.io.prefetch import available_cores
from fpsboost.io.target import Target
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoding import choose_encoder
from fpsboost.method_table import find_method
from fpsboost.parts.self_test import self_test

SECTION_FRAMES = 16
"""Consecutive frames of a section whose stages are timed, at most."""

PIXELS_TIMED = 25e6
"""Of the source, in each section that is converted by a command."""

FEWEST_TIMED = 6
FIRST_TIMED = 4
"""Source frames that the shorter of two commands converts; the difference to the longer one counts."""


@dataclass(frozen=True)
class Usage:
    """Wall and CPU seconds of a command."""

    wall: float
    cpu: float


class Command:
    """Command line of fpsboost that runs on one core.

    Parameters
    ----------
    arguments : sequence of str
    core : int
        Number of the core, below the number of available cores.
    cache : str
        Folder of compiled kernels; that of the installation by default.
    """

    def __init__(self, arguments: Sequence[str], core: int = 0, cache: str = "") -> None:
        environment = {**os.environ, **({"NUMBA_CACHE_DIR": cache} if cache else {})}
        command = [sys.executable, "-m", "fpsboost", *arguments, "--quiet"]
        with on_core(core):
            self._begin = time.perf_counter()
            self._process = Popen(command, env=environment, stderr=PIPE)

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self._process.pid

    def stop(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.communicate()

    def wait(self) -> Usage:
        """Wait for its end.

        Raises
        ------
        OptionError
            It failed.
        """
        assert self._process.stderr is not None
        said = self._process.stderr.read().decode(errors="replace")
        _, status, usage = os.wait4(self._process.pid, 0)
        wall = time.perf_counter() - self._begin
        self._process.returncode = os.waitstatus_to_exitcode(status)
        self._process.stderr.close()
        if self._process.returncode:
            raise OptionError(f"A conversion ended with code {self._process.returncode}: {said.strip()[-300:]}")
        return Usage(wall, usage.ru_utime + usage.ru_stime)


@contextmanager
def on_core(number: int) -> Iterator[None]:
    """Pin this process, and those that it starts in the block, to one of its cores."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {sorted(cores)[number]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def convert_section(clip: str, output: str, start: int, frames: int, options: Sequence[str]) -> list[str]:
    """Return the arguments that convert some source frames in one thread."""
    section = ["--start", f"{start}f", "--end", f"{start + frames}f"]
    return [clip, output, *section, "--threads", "1", "--overwrite", "--no-audio", *options]


@dataclass(frozen=True)
class Material:
    """A clip that costs are measured on.

    Attributes
    ----------
    path : str
    width, height : int
    frames : int
    sections : int
        Places, evenly spread, that are looked at.
    """

    path: str
    width: int
    height: int
    frames: int
    sections: int

    @property
    def starts(self) -> list[int]:
        """First frame of each section."""
        return [self.frames * (2 * number + 1) // (2 * self.sections) for number in range(self.sections)]

    @property
    def timed(self) -> int:
        """Source frames of a section that the longer command converts."""
        longest = self.frames - self.starts[-1]
        wanted = max(FEWEST_TIMED, int(PIXELS_TIMED / (self.width * self.height)))
        return FIRST_TIMED + min(wanted, longest - FIRST_TIMED)

    @property
    def staged(self) -> int:
        """Source frames of a section whose stages are timed."""
        return min(SECTION_FRAMES, self.timed)

    @property
    def size(self) -> str:
        """Width and height as text."""
        return f"{self.width}x{self.height}"


def material_of(path: str, sections: int) -> Material:
    """Return what is known of a clip.

    Raises
    ------
    InputError
        It is too short.
    """
    with av.open(path) as file:
        stream = file.streams.video[0]
        width, height = stream.codec_context.width, stream.codec_context.height
        frames = sum(packet.size > 0 for packet in file.demux(stream))
    if frames < 2 * sections * (FIRST_TIMED + FEWEST_TIMED):
        raise InputError(f"{path} has {frames} frames, too few for {sections} sections; give a longer clip.")
    return Material(path, width, height, frames, sections)


@dataclass(frozen=True)
class Sections:
    """Frames of a clip's sections as a conversion decodes them, and what decoding took a frame."""

    frames: list[list[FrameImage]]
    decoding: float


def read_sections(material: Material) -> Sections:
    """Decode a clip and keep the frames of its sections."""
    requirements = Target.parse("out.mp4").requirements(
        Encoding(), needs_rate=False, takes_planes=True, takes_layers=False
    )
    starts = set(material.starts)
    frames: list[list[FrameImage]] = []
    with open_source(material.path, requirements=requirements) as source:
        last = material.starts[-1] + material.staged
        begin = time.process_time()
        number = -1
        for number, frame in enumerate(islice(source, last)):
            if number in starts:
                frames.append([])
            if frames and len(frames[-1]) < material.staged:
                frames[-1].append(frame.image)
        seconds = time.process_time() - begin
    return Sections(frames, seconds / (number + 1))


@dataclass(frozen=True)
class Making:
    """What a pair of a section takes: its motion, and the rest of making a frame in it; and the section with those."""

    motion: float
    synthesis: float
    shown: list[FrameImage]


def time_making(interpolator: Interpolator, frames: Sequence[FrameImage]) -> Making:
    """Make a frame between every two, as a conversion does: it estimates no motion across a cut."""
    interpolator.compile_for(frames[0])
    estimating = 0.0
    estimator = type(interpolator.estimator)
    estimate = estimator.estimate

    def timed(*arguments: Any, **options: Any) -> Any:
        nonlocal estimating
        begin = time.process_time()
        fields = estimate(*arguments, **options)
        estimating += time.process_time() - begin
        return fields

    shown: list[FrameImage] = []
    seconds = 0.0
    with patch.object(estimator, "estimate", timed):
        pairs = (interpolator.pair(*each) for each in pairwise(map(FrameCache, frames)))
        for before, pair, after in with_neighbours(pairs):
            begin = time.process_time()
            made = list(interpolator.between(pair, [0.5], before, after).images)
            pair.release_caches()
            seconds += time.process_time() - begin
            shown += [frames[len(shown) // 2], *made]
    count = len(frames) - 1
    return Making(estimating / count, (seconds - estimating) / count, shown)


def time_encoding(shown: Sequence[FrameImage], preset: str) -> float:
    """Return what an encoder takes for a frame, with its opening."""
    pictures = [_as_picture(image) for image in shown]
    pixels = pictures[0].width * pictures[0].height
    encoder, options = choose_encoder(Encoding(preset=preset), "mp4", "out.mp4", pixels=pixels)
    begin = time.process_time()
    with av.open(os.devnull, "w", format="null") as nowhere:
        stream = nowhere.add_stream(encoder, rate=48)
        stream.width, stream.height, stream.pix_fmt = pictures[0].width, pictures[0].height, "yuv420p"
        stream.options = options
        for number, picture in enumerate(pictures):
            picture.pts = number
            stream.encode(picture)
        stream.encode(None)
    return (time.process_time() - begin) / len(pictures)


def _as_picture(image: Any) -> av.VideoFrame:
    """Return an image of three planes of 8 bits as a picture for an encoder."""
    planes = getattr(image, "planes", None)
    if planes is None:
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(image)).reformat(format="yuv420p")
    height = planes[0].shape[0]
    stacked = np.concatenate([planes[0].ravel(), planes[1].ravel(), planes[2].ravel()])
    return av.VideoFrame.from_ndarray(stacked.reshape(height * 3 // 2, -1), format="yuv420p")


def time_opening(material: Material) -> float:
    """Return what it takes to open a clip."""
    begin = time.process_time()
    with open_source(material.path):
        return time.process_time() - begin


def time_indexing(material: Material) -> float:
    """Return what it takes a frame to read the packets of a clip."""
    begin = time.process_time()
    with av.open(material.path) as file:
        for packet in file.demux(file.streams.video[0]):
            _ = packet.pts
    return (time.process_time() - begin) / material.frames


def measure_methods(
    material: Material, methods: Sequence[str], presets: Sequence[str], rounds: int, say: Callable[[str], None]
) -> dict[str, Costs]:
    """Measure the costs of a size.

    Parameters
    ----------
    material : Material
    methods, presets : sequence of str
        The first preset is that of the conversions by commands.
    rounds : int
        Of all commands in turn; medians count.
    say : callable
        Is told what is being measured.

    Returns
    -------
    dict of str to Costs
        By ``method preset``; what is the same for all sizes is missing.
    """
    say(f"{material.size}: decoding")
    with on_core(0):
        sections = read_sections(material)
        opening = median(time_opening(material) for _ in range(5))
        indexing = median(time_indexing(material) for _ in range(3))
    costs: dict[str, Costs] = {}
    for name in methods:
        say(f"{material.size}: stages of {name}")
        interpolator = find_method(name)
        with on_core(0):
            making = [time_making(interpolator, frames) for frames in sections.frames]
            again = [time_making(interpolator, frames) for frames in sections.frames]
            shown = [image for each in making for image in each.shown]
            encoding = {preset: median(time_encoding(shown, preset) for _ in range(rounds)) for preset in presets}
            self_test(interpolator, sections.frames[0][0])  # compiles what is compiled for its size
            begin = time.process_time()
            self_test(interpolator, sections.frames[0][0])
            tested = time.process_time() - begin
        base = Costs(
            opening=opening,
            indexing=indexing,
            self_test=tested,
            decoding=sections.decoding,
            motion=mean(min(one.motion, two.motion) for one, two in zip(making, again, strict=True)),
            synthesis=mean(min(one.synthesis, two.synthesis) for one, two in zip(making, again, strict=True)),
            encoding=encoding[presets[0]],
        )
        say(f"{material.size}: conversions with {name}")
        whole = time_conversions(material, ["--method", name, "--preset", presets[0]], rounds)
        base = replace(
            base,
            rest=whole.frame - base.frames(1, Fraction(2)),
            variation=whole.variation,
            # the frames before a section are decoded, and the last frame of all is held
            starting=whole.beginning - opening,
            slowdown=time_together(material, ["--method", name, "--preset", presets[0]], rounds, whole.beginning),
        )
        for preset in presets:
            costs[f"{name} {preset}"] = replace(base, encoding=encoding[preset])
    return costs


@dataclass(frozen=True)
class Conversions:
    """CPU seconds of whole conversions: an output frame, how much that varies, and what remains for no frames."""

    frame: float
    variation: float
    beginning: float


def time_conversions(material: Material, options: Sequence[str], rounds: int) -> Conversions:
    """Convert few and more frames of each section, by commands, in turn."""
    with tempfile.TemporaryDirectory() as scratch:
        output = str(Path(scratch, "out.mp4"))

        def cpu(start: int, frames: int) -> float:
            return Command(convert_section(material.path, output, start, frames, options)).wait().cpu

        few: dict[int, list[float]] = {start: [] for start in material.starts}
        more: dict[int, list[float]] = {start: [] for start in material.starts}
        first = []
        for _ in range(rounds):
            first.append(cpu(0, FIRST_TIMED))
            for start in material.starts:
                few[start].append(cpu(start, FIRST_TIMED))
                more[start].append(cpu(start, material.timed))
    outputs = 2 * (material.timed - FIRST_TIMED)
    frames = [(median(more[start]) - median(few[start])) / outputs for start in material.starts]
    # frames and their pairs in the shortest conversion: without motion between the last one and the next
    beginning = median(first) - (2 * FIRST_TIMED - 1) * mean(frames)
    return Conversions(mean(frames), pstdev(frames) / mean(frames), max(0.0, beginning))


def time_together(material: Material, options: Sequence[str], rounds: int, beginning: float) -> tuple[float, ...]:
    """Return how much CPU time 1, 2 ... commands at once take, each on its core, over that of one alone."""
    counts = range(1, available_cores() + 1)
    seconds: dict[int, list[float]] = {count: [] for count in counts}
    start = material.starts[0]
    with tempfile.TemporaryDirectory() as scratch:
        outputs = [str(Path(scratch, f"{number}.mp4")) for number in counts]
        for _ in range(rounds):
            for count in counts:
                running = [
                    Command(convert_section(material.path, outputs[core], start, material.timed, options), core)
                    for core in range(count)
                ]
                seconds[count] += [each.wait().cpu - beginning for each in running]
    alone = median(seconds[1])
    return tuple(max(1.0, median(seconds[count]) / alone) for count in counts)


def measure_compiling(material: Material, method: str) -> float:
    """Return the CPU seconds that a conversion of few frames takes to compile its kernels."""
    with tempfile.TemporaryDirectory() as scratch:
        arguments = convert_section(material.path, str(Path(scratch, "out.mp4")), 0, 3, ["--method", method])
        cold = Command(arguments, cache=str(Path(scratch, "cache"))).wait().cpu
        warm = Command(arguments, cache=str(Path(scratch, "cache"))).wait().cpu
    return cold - warm


def measure_parts(rounds: int) -> Costs:
    """Measure what a part takes beyond a plain conversion, and what `join` takes, on small drawn videos."""
    with tempfile.TemporaryDirectory() as scratch:
        runs = [
            _parts_and_join(scratch, frames, quality, rounds)
            for frames, quality in ((24, "40"), (240, "40"), (240, "0"))
        ]
    equations = np.array([[1.0, run.frames, run.size] for run in runs])
    joining, frame, byte = np.linalg.solve(equations, [run.join for run in runs])
    part = median(run.part for run in runs)
    return Costs(part=max(0.0, part), joining=joining, joining_frame=max(0.0, frame), joining_byte=max(0.0, byte))


@dataclass(frozen=True)
class _Joined:
    frames: int
    size: int
    part: float
    join: float


def _parts_and_join(scratch: str, frames: int, quality: str, rounds: int) -> _Joined:
    """Convert a drawn video plainly, as one part, and join that."""
    clip, output = Path(scratch, f"{frames}.mp4"), Path(scratch, f"{frames}-{quality}.mp4")
    if not clip.exists():
        draw_noise(clip, frames)
    options = ["--method", "nearest", "--preset", "ultrafast", "--crf", quality, "--threads", "1", "--overwrite"]
    plain, parts, joins = [], [], []
    for _ in range(rounds):
        plain.append(Command([str(clip), str(output), *options]).wait().cpu)
        parts.append(Command([str(clip), str(output), *options, "--chunk", "1/1"]).wait().cpu)
        joins.append(Command(["join", str(output), f"{output}.parts", "--overwrite"]).wait().cpu)
    size = sum(path.stat().st_size for path in Path(f"{output}.parts").rglob("*.chunk"))
    return _Joined(2 * frames, size, median(parts) - median(plain), median(joins))


def draw_noise(path: Path, frames: int) -> None:
    """Write a small video of noise, whose size as a video hangs on nothing but the quality."""
    random = np.random.default_rng(0)
    with av.open(str(path), "w") as output:
        stream = output.add_stream("libx264", 24, width=640, height=360, pix_fmt="yuv420p")
        stream.options = {"preset": "ultrafast", "crf": "10"}
        for _ in range(frames):
            image = random.integers(0, 256, (360, 640, 3), np.uint8)
            output.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
        output.mux(stream.encode(None))


def machine() -> dict[str, Any]:
    """Return what is known of this machine."""
    text = Path("/proc/cpuinfo").read_text()
    model = re.search(r"model name\s*:\s*(.*)", text)
    return {"processor": model[1] if model else "unknown", "cores": available_cores(), "load": os.getloadavg()[0]}
