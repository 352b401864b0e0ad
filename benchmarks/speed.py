"""How fast, how much memory: ``python benchmarks/speed.py [PART ...]``.

Figures are CPU time as well as wall time, and comparisons are ratios of runs in turn, because machines are noisy.
Frames are drawn here; `stages` resizes those of ``--clip`` instead, and `threads` converts it, if it is given.
``--json FILE`` keeps the figures.

``peers --clip CLIP --mvtools 'PYTHON SCRIPT' --mvutensils 'PYTHON SCRIPT'`` compares with MVTools, MVUtensils or both:
SCRIPT takes a folder of PNG, its frame rate, an output folder and settings, and prints JSON with `cpu_per_interp_ms` as
its last line. So does the command of ``--peer NAME='COMMAND {in} {out}'``, of any other tool.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scaling import convert_together, pinned, serial_share, times_faster, worker_counts
from scoring import one_thread, read_frames, wide_console
from stages import WHOLE, copy_bandwidth, profile_sequence

from fpsboost.colour import colour_components
from fpsboost.errors import FpsboostError, OptionError
from fpsboost.image import Image
from fpsboost.method_table import find_method
from fpsboost.motion.full_search import search_by_passes, search_fused

Figures = dict[str, Any]

SIZES = {"640x360": (360, 640), "1280x720": (720, 1280), "1920x1080": (1080, 1920)}
"""Height and width by name."""

CONVERTED = {"640x360": 48, "1280x720": 32, "1920x1080": 24, "3840x2160": 10}
"""Frames of the videos that `conversions` draws, by width and height."""

FRAMES = 5
"""Frames of a sequence that is timed."""

MVTOOLS_SETTINGS = {
    "MVTools, 4:4:4 16 bit, search 5": "--fmt YUV444P16 --no-scd --search 5 --searchparam 4",
    "MVTools, its defaults": "",
}
MVUTENSILS_SETTINGS = {
    "MVUtensils, 4:4:4 16 bit, 16/8 with recalculation": (
        "--fmt YUV444P16 --blksize 16 --overlap 8 --reblk 8 --no-scd"
    ),
    "MVUtensils, 4:2:0 8 bit, its defaults": "",
}

MANY_CORES = 16
"""For which `threads` says what Amdahl's law expects."""


def textured_pair(height: int, width: int, shift: int = 7) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return two frames of a texture with detail at every scale, the second shifted."""
    generator = np.random.default_rng(0)
    texture = np.zeros((height, width + shift, 3), np.float32)
    for cell in (2, 8, 32, 128):
        noise = generator.random((height // cell + 2, (width + shift) // cell + 2, 3), np.float32)
        texture += cv2.resize(noise, (width + shift, height), interpolation=cv2.INTER_CUBIC)
    frame = np.clip(texture * 64, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(frame[:, shift:]), np.ascontiguousarray(frame[:, :-shift])


def sequence(options: Namespace, height: int, width: int) -> list[Image]:
    """Return frames of one size: those of the clip, or a texture with detail at every scale that rotates and grows."""
    if options.clip:
        frames = read_frames(options.clip, FRAMES)
        return [cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA) for frame in frames]
    texture, _ = textured_pair(height, width)
    return [turned(texture, 1.5 * number, 1.02**number) for number in range(FRAMES)]


def turned(image: Image, degrees: float, scale: float = 1.0) -> Image:
    """Rotate and scale an image around its centre."""
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, scale)
    return cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REFLECT)


def draw_video(path: Path, height: int, width: int, count: int, pixel_format: str = "yuv420p") -> None:
    """Write an H.264 video of 24 frames a second: a rotating texture with detail at every scale."""
    texture, _ = textured_pair(height, width)
    with av.open(str(path), "w") as output:
        stream = output.add_stream("libx264", 24, width=width, height=height, pix_fmt=pixel_format)
        for number in range(count):
            output.mux(stream.encode(av.VideoFrame.from_ndarray(turned(texture, 0.5 * number))))
        output.mux(stream.encode(None))


def timed(run: Callable[[], object]) -> tuple[float, float]:
    """Return the wall and CPU seconds of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - wall, time.process_time() - cpu


def run_together(function: Callable[[], object], threads: int) -> None:
    """Run a function in several threads at the same time."""
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda _: function(), range(threads)))


def exhaustive(console: Console, options: Namespace) -> Figures:
    """Measure the report's exhaustive search in both directions: the fused kernel against full-image OpenCV passes.

    One pair is searched by one thread, and two pairs by two.
    """
    height, width, radius, patch_radius = 360, 640, 16, 5
    pair = [colour_components(frame) for frame in textured_pair(height, width)]
    evaluations = height * width * (2 * radius + 1) ** 2
    columns = "window", "fused, ns", "fused, CPU ns", "two pairs at once, ns", "passes, ns", "passes, CPU ns", "ratio"
    table = Table(*columns, title="Exhaustive search")
    figures: Figures = {}
    for window in ("box", "gaussian"):
        arguments: tuple[Any, ...] = (*pair, radius, patch_radius, window, 0.25)
        search = partial(search_fused, *arguments)
        search()
        fused, both, passes = [], [], []
        for _ in range(5):
            passes.append(timed(partial(search_by_passes, *arguments)))
            fused += [timed(search) for _ in range(3)]
            both += [timed(partial(run_together, search, 2))[0] / 2 for _ in range(3)]
        figures[window] = {
            "fused_ns": median(wall for wall, _ in fused) / evaluations * 1e9,
            "fused_cpu_ns": median(cpu for _, cpu in fused) / evaluations * 1e9,
            "two_threads_ns": median(both) / evaluations * 1e9,
            "passes_ns": median(wall for wall, _ in passes) / evaluations * 1e9,
            "passes_cpu_ns": median(cpu for _, cpu in passes) / evaluations * 1e9,
            "ratio": median(wall for wall, _ in passes) / median(wall for wall, _ in fused),
        }
        table.add_row(
            window, *(f"{value:.3f}" for value in list(figures[window].values())[:5]), f"{figures[window]['ratio']:.1f}"
        )
    console.print(table, "Per pixel and offset, both directions; 640x360, search radius 16, patch radius 5.")
    return figures


def start(console: Console, options: Namespace) -> Figures:
    """Measure the time of a conversion of two small frames, the least of the rounds."""
    table = Table("method", "seconds", "CPU, s", title="Start to end of a conversion of two small frames")
    figures: Figures = {}
    for method in ("blend", "nlm-fast", "nlm", "nlm-exhaustive"):
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder, "in")
            source.mkdir()
            for number, frame in enumerate(textured_pair(180, 320)):
                cv2.imwrite(str(source / f"{number:04d}.png"), frame)
            runs = []
            for number in range(options.rounds):
                command = ["-m", "fpsboost", str(source), str(Path(folder, str(number))), "-m", method, "-q"]
                begin, before = time.perf_counter(), os.times()
                subprocess.run([sys.executable, *command], check=True)
                wall, after = time.perf_counter() - begin, os.times()
                cpu = after.children_user + after.children_system - before.children_user - before.children_system
                runs.append((wall, cpu))
            wall, cpu = map(min, zip(*runs, strict=True))
            figures[method] = {"seconds": wall, "cpu_s": cpu}
            table.add_row(method, f"{wall:.2f}", f"{cpu:.2f}")
    console.print(table)
    return figures


def stages(console: Console, options: Namespace) -> Figures:
    """Measure each stage of a method: CPU time per in-between frame in the best round, and memory traffic."""
    fastest = copy_bandwidth()
    figures: Figures = {"copy_bytes_per_s": fastest}
    interpolator = find_method(options.method[0])
    for size, (height, width) in SIZES.items():
        frames = sequence(options, height, width)
        profiles = [profile_sequence(interpolator, frames) for _ in range(options.rounds)]
        best = min(profiles, key=lambda profile: profile.stages[WHOLE].cpu)
        table = Table(
            *("stage", "calls", "CPU, ms", "share", "MB touched", "GB/s", "of a copy's"),
            title=f"{options.method[0]}, one in-between frame, {size}",
        )
        figures[size] = {}
        for name, cost in best.stages.items():
            row = {
                "calls": cost.calls / best.frames,
                "cpu_ms": cost.cpu * 1e3 / best.frames,
                "bytes": cost.touched / best.frames,
            }
            figures[size][name] = row
            table.add_row(name, *stage_cells(row, cost.cpu / best.stages[WHOLE].cpu, fastest))
        console.print(table)
        for name in best.missing:
            console.print(f"{name}: not found under the name that benchmarks/stages.py knows, hence not told apart.")
    console.print(f"In one thread; a copy moves {fastest / 1e9:.1f} GB/s.")
    return figures


def stage_cells(row: Figures, share: float, fastest: float) -> list[str]:
    """Return the cells of a stage's row in the table, without its name."""
    cells = [f"{row['calls']:.0f}" if row["calls"] else "", f"{row['cpu_ms']:.1f}", f"{share:.1%}"]
    if not row["bytes"]:
        return cells
    speed = row["bytes"] / row["cpu_ms"] * 1e3
    return [*cells, f"{row['bytes'] / 1e6:.1f}", f"{speed / 1e9:.2f}", f"{speed / fastest:.0%}"]


def threads(console: Console, options: Namespace) -> Figures:
    """Measure a conversion with 1, 2, 4 ... workers on as many cores, and as many conversions of one worker each.

    Ratios are medians of those of runs in turn. The time in which cores wait tells what is serial, since other load on
    the machine changes it less than how fast the cores are.
    """
    if sys.platform != "linux":
        raise OptionError("threads pins conversions to cores, which only Linux lets a program do; leave it out.")
    counts = worker_counts()
    runs: dict[int, list[Figures]] = {count: [] for count in counts}
    apart: dict[int, list[float]] = {count: [] for count in counts[1:]}
    with tempfile.TemporaryDirectory() as scratch:
        clip = options.clip or str(Path(scratch, "clip.mp4"))
        if not options.clip:
            draw_video(Path(clip), *SIZES["1920x1080"], max(40, 10 * counts[-1]))
        for _ in range(options.rounds):
            for count in counts:
                runs[count] += convert_together(clip, scratch, options.method[0], workers=count, conversions=1)
                if count > 1:
                    each = convert_together(clip, scratch, options.method[0], workers=1, conversions=count)
                    apart[count].append(sum(one["frames_per_s"] for one in each))
    table = Table(
        *("workers", "frames/s", "CPU, s", "peak, MB", "times faster", "apart, frames/s", "lost to sharing"),
        *("cores busy", "serial", f"times faster with {MANY_CORES}"),
        title=f"{options.method[0]}, a whole conversion",
    )
    figures: Figures = {}
    for count in counts:
        row = {name: median(run[name] for run in runs[count]) for name in ("frames_per_s", "cpu_s", "peak_mb")}
        cells = [f"{row['frames_per_s']:.2f}", f"{row['cpu_s']:.1f}", f"{row['peak_mb']:.0f}"]
        if count > 1:
            speeds = [run["frames_per_s"] for run in runs[count]]
            alone = [run["frames_per_s"] for run in runs[1]]
            row["times_faster"] = median(here / one for here, one in zip(speeds, alone, strict=True))
            row["apart_frames_per_s"] = median(apart[count])
            row["lost_to_sharing"] = 1 - median(here / other for here, other in zip(speeds, apart[count], strict=True))
            row["busy"] = median(run["cpu_s"] / run["seconds"] / count for run in runs[count])
            row["serial_share"] = serial_share(row["busy"], count)
            row["times_faster_on_many"] = times_faster(row["serial_share"], MANY_CORES)
            cells += [f"{row['times_faster']:.2f}", f"{row['apart_frames_per_s']:.2f}", f"{row['lost_to_sharing']:.1%}"]
            cells += [f"{row['busy']:.1%}", f"{row['serial_share']:.1%}", f"{row['times_faster_on_many']:.1f}"]
        figures[str(count)] = row
        table.add_row(str(count), *cells)
    width, height = runs[1][0]["size"]
    console.print(table, f"{runs[1][0]['frames_out']} frames of {width}x{height} written.")
    return figures


def conversions(console: Console, options: Namespace) -> Figures:
    """Measure conversions of drawn video by size, depth and method on two cores, and FFmpeg's minterpolate."""
    if sys.platform != "linux":
        raise OptionError("conversions pins them to cores, which only Linux lets a program do; leave it out.")
    table = Table("video", "method", "frames/s", "CPU, ms a made frame", "peak, MB", title="24 to 48 frames a second")
    figures: Figures = {}
    with tempfile.TemporaryDirectory() as scratch:
        for size, count in CONVERTED.items():
            for pixel_format in ("yuv420p", "yuv420p10le"):
                clip = Path(scratch, f"{size}-{pixel_format}.mp4")
                draw_video(clip, *map(int, reversed(size.split("x"))), count, pixel_format)
                rows = {name: partial(convert_one, clip, scratch, name) for name in ("blend", "nlm-fast", "nlm")}
                if shutil.which("ffmpeg"):
                    rows["FFmpeg minterpolate"] = partial(minterpolate, clip, scratch, 2 * count)
                for name, run in rows.items():
                    runs = [run() for _ in range(options.rounds)]
                    best = max(runs, key=lambda each: each["frames_per_s"])
                    figures[f"{clip.stem} {name}"] = best
                    cells = (
                        f"{best['frames_per_s']:.1f}",
                        f"{best['cpu_s'] / count * 1e3:.0f}",
                        f"{best['peak_mb']:.0f}",
                    )
                    table.add_row(clip.stem, name, *cells)
    console.print(table, "Two workers on two cores, H.264 with --preset veryfast; a made frame is one of two written.")
    return figures


def convert_one(clip: Path, folder: str, method: str) -> Figures:
    """Measure one conversion with two workers on two cores."""
    (figures,) = convert_together(str(clip), folder, method, workers=2, conversions=1)
    return figures


def minterpolate(clip: Path, folder: str, frames: int) -> Figures:
    """Measure the same conversion by FFmpeg's minterpolate filter on two cores."""
    out = [*("-vf", "minterpolate=fps=48"), *("-c:v", "libx264", "-preset", "veryfast"), str(Path(folder, "peer.mp4"))]
    with pinned(2):
        begin = time.perf_counter()
        process = subprocess.Popen(["ffmpeg", "-v", "error", "-y", "-threads", "2", "-i", str(clip), *out])
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begin
    if status:
        raise OptionError(f"ffmpeg could not convert {clip.name}; take it off the path, or mend it.")
    cpu = usage.ru_utime + usage.ru_stime
    return {"frames_per_s": frames / seconds, "cpu_s": cpu, "peak_mb": usage.ru_maxrss / 1024}


def peers(console: Console, options: Namespace) -> Figures:
    """Compare CPU time with other tools: the same frames, in memory, one thread, runs in turn."""
    others = [(options.mvtools, MVTOOLS_SETTINGS), (options.mvutensils, MVUTENSILS_SETTINGS)]
    if not options.clip or not (options.mvtools or options.mvutensils or options.peer):
        raise OptionError(
            "peers needs --clip CLIP and --mvtools 'PYTHON SCRIPT', --mvutensils 'PYTHON SCRIPT' or --peer."
        )
    with tempfile.TemporaryDirectory() as scratch:
        source = Path(scratch, "in")
        source.mkdir()
        for number, frame in enumerate(read_frames(options.clip, 31)):
            resized = cv2.resize(frame, options.size, interpolation=cv2.INTER_CUBIC) if options.size else frame
            cv2.imwrite(str(source / f"{number:04d}.png"), resized)
        own = [sys.executable, str(Path(__file__).with_name("sequence_cost.py")), str(source)]
        commands: dict[str, list[str]] = {}
        for method in options.method:
            commands[f"{method}, BGR"] = [*own, "--method", method]
            commands[f"{method}, 4:2:0 8 bit"] = [*own, "--method", method, "--video"]
        arrays, video = list(commands)[:2]
        out = str(Path(scratch, "out"))
        for script, by_name in others:
            if script:
                call = [*shlex.split(script), str(source), "25", out, "--no-write"]
                commands |= {name: [*call, *settings.split()] for name, settings in by_name.items()}
        for name, _, command in (each.partition("=") for each in options.peer):
            words = shlex.split(command)
            commands[name] = [word.replace("{in}", str(source)).replace("{out}", out) for word in words]
        runs: dict[str, list[Figures]] = {name: [] for name in commands}
        for _ in range(options.rounds):
            for name, command in commands.items():
                runs[name].append(last_json(command))
    table = Table(
        "one thread", "CPU, ms", "all rounds, ms", "BGR over it", "4:2:0 over it", title="One in-between frame"
    )
    middles = {name: median(run["cpu_per_interp_ms"] for run in each) for name, each in runs.items()}
    figures: Figures = {"frames": runs[arrays][0]["n_interp"], "size": runs[arrays][0]["size"]}
    for name, each in runs.items():
        rounds = [run["cpu_per_interp_ms"] for run in each]
        ratios = [middles[ours] / middles[name] for ours in (arrays, video)]
        told = ", ".join(f"{value:.0f}" for value in rounds)
        table.add_row(name, f"{middles[name]:.1f}", told, *(f"{ratio:.2f}" for ratio in ratios))
        figures[name] = {"cpu_ms": middles[name], "rounds": rounds, "ratios": ratios}
    width, height = figures["size"]
    console.print(table, f"{figures['frames']} in-between frames of {width}x{height}, made as a sequence.")
    return figures


def last_json(command: list[str]) -> Figures:
    """Run a command and parse the last line that it prints as JSON."""
    ended = subprocess.run(command, check=False, capture_output=True, text=True)
    if ended.returncode:
        raise OptionError(f"{shlex.join(command)} ended with code {ended.returncode}: {ended.stderr.strip()[-300:]}")
    figures: Figures = json.loads(ended.stdout.splitlines()[-1])
    return figures


parts = {
    "exhaustive": exhaustive,
    "start": start,
    "stages": stages,
    "threads": threads,
    "conversions": conversions,
    "peers": peers,
}


def main() -> None:
    """Run the parts that were asked for; by default all that need nothing from elsewhere."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", choices=[*parts, []], default=[])
    parser.add_argument("--clip", help="frames for stages and peers, video for threads")
    parser.add_argument(
        "--method", action="append", help="for stages, threads and peers, such as nlm:fusion=plain; peers takes several"
    )
    parser.add_argument("--mvtools", metavar="'PYTHON SCRIPT'", help="for peers")
    parser.add_argument("--mvutensils", metavar="'PYTHON SCRIPT'", help="for peers")
    parser.add_argument("--peer", action="append", default=[], metavar="NAME='COMMAND {in} {out}'", help="for peers")
    parser.add_argument(
        "--size", type=lambda text: tuple(map(int, text.split("x"))), help="of frames for peers: 1920x1080"
    )
    parser.add_argument("--rounds", type=int, default=3, help="of runs in turn, for stages to peers")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    options.method = options.method or ["nlm"]
    console = wide_console()
    one_thread()
    on_linux = sys.platform == "linux"
    possible = {
        "threads": on_linux,
        "conversions": on_linux,
        "peers": options.mvtools or options.mvutensils or options.peer,
    }
    chosen = options.part or [name for name in parts if possible.get(name, True)]
    try:
        figures = {name: parts[name](console, options) for name in chosen}
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
