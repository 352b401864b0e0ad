"""How fast, how much memory: ``python benchmarks/speed.py [exhaustive] [methods] [memory] [start]``.

Figures are CPU time as well as wall time, and comparisons are ratios of runs in turn, because machines are noisy. All
frames are drawn here. ``--json FILE`` keeps the figures.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from fpsboost.interpolator import methods
from fpsboost.motion.colour import colour_components
from fpsboost.motion.exhaustive import search_by_passes, search_fused

Figures = dict[str, Any]


def textured_pair(height: int, width: int, shift: int = 7) -> tuple[NDArray[Any], NDArray[Any]]:
    """Two frames of a texture with detail at every scale, the second shifted."""
    generator = np.random.default_rng(0)
    texture = np.zeros((height, width + shift, 3), np.float32)
    for cell in (2, 8, 32, 128):
        noise = generator.random((height // cell + 2, (width + shift) // cell + 2, 3), np.float32)
        texture += cv2.resize(noise, (width + shift, height), interpolation=cv2.INTER_CUBIC)
    frame = np.clip(texture * 64, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(frame[:, shift:]), np.ascontiguousarray(frame[:, :-shift])


def timed(run: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU seconds of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - wall, time.process_time() - cpu


def exhaustive(console: Console) -> Figures:
    """The report's search: the fused kernel against full-image passes of OpenCV, both directions each."""
    height, width, radius, patch_radius = 360, 640, 16, 5
    pair = [colour_components(frame) for frame in textured_pair(height, width)]
    evaluations = height * width * (2 * radius + 1) ** 2
    table = Table(
        "window", "fused, ns", "fused, CPU ns", "passes, ns", "passes, CPU ns", "ratio", title="Exhaustive search"
    )
    figures: Figures = {}
    for window in ("box", "gaussian"):
        arguments = (*pair, radius, patch_radius, window, 0.25)
        search_fused(*arguments)
        fused, passes = [], []
        for _ in range(5):
            passes.append(timed(lambda arguments=arguments: search_by_passes(*arguments)))
            fused += [timed(lambda arguments=arguments: search_fused(*arguments)) for _ in range(3)]
        figures[window] = {
            "fused_ns": median(wall for wall, _ in fused) / evaluations * 1e9,
            "fused_cpu_ns": median(cpu for _, cpu in fused) / evaluations * 1e9,
            "passes_ns": median(wall for wall, _ in passes) / evaluations * 1e9,
            "passes_cpu_ns": median(cpu for _, cpu in passes) / evaluations * 1e9,
            "ratio": median(wall for wall, _ in passes) / median(wall for wall, _ in fused),
        }
        table.add_row(
            window, *(f"{value:.3f}" for value in list(figures[window].values())[:4]), f"{figures[window]['ratio']:.1f}"
        )
    console.print(table, "Per pixel and offset, both directions; 640x360, search radius 16, patch radius 5.")
    return figures


def by_method(console: Console) -> Figures:
    """Every method: milliseconds per in-between frame, frames in memory."""
    table = Table("method", "size", "wall, ms", "CPU, ms", "in-between frames/s", title="One in-between frame a pair")
    figures: Figures = {}
    for name, interpolator in methods.items():
        for height, width in ((360, 640), (720, 1280)):
            if name == "nlm-exhaustive" and height > 360:
                continue
            frame0, frame1 = textured_pair(height, width)
            interpolator.interpolate(frame0, frame1, [0.5])
            runs = [timed(lambda i=interpolator, a=frame0, b=frame1: i.interpolate(a, b, [0.5])) for _ in range(9)]
            wall, cpu = median(run[0] for run in runs), median(run[1] for run in runs)
            figures[f"{name} {width}x{height}"] = {"wall_ms": wall * 1e3, "cpu_ms": cpu * 1e3}
            table.add_row(name, f"{width}x{height}", f"{wall * 1e3:.1f}", f"{cpu * 1e3:.1f}", f"{1 / wall:.1f}")
    console.print(table)
    return figures


def memory(console: Console) -> Figures:
    """Peak memory of a whole conversion of 30 and of 300 frames."""
    table = Table("size", "frames", "peak memory, MB", title="Conversion of a folder of images")
    figures: Figures = {}
    for height, width in ((360, 640), (720, 1280)):
        for count in (30, 300):
            with tempfile.TemporaryDirectory() as folder:
                frame, _ = textured_pair(height, width)
                source = Path(folder, "in")
                source.mkdir()
                for number in range(count):
                    cv2.imwrite(str(source / f"{number:04d}.png"), np.roll(frame, number, axis=1))
                peak = peak_of(
                    [str(source), str(Path(folder, "out.mp4")), "--input-fps", "24", "--preset", "ultrafast"]
                )
            figures[f"{width}x{height} {count}"] = peak
            table.add_row(f"{width}x{height}", str(count), f"{peak:.0f}")
    console.print(table)
    return figures


def peak_of(arguments: list[str]) -> float:
    """Peak resident memory of one run of the command line, MB, measured by a process of its own."""
    code = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    command = [sys.executable, "-c", code, sys.executable, "-m", "fpsboost", *arguments, "--quiet"]
    kilobytes = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return kilobytes * resource.getpagesize() / 4096 / 1024


def start(console: Console) -> Figures:
    """Time to a first two-frame conversion, with kernels to compile and with kernels cached."""
    table = Table("method", "kernels", "seconds", title="Start to end of a conversion of three small frames")
    figures: Figures = {}
    for method in ("nlm", "nlm-exhaustive"):
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder, "in")
            source.mkdir()
            for number, frame in enumerate(textured_pair(180, 320)):
                cv2.imwrite(str(source / f"{number:04d}.png"), frame)
            environment = {**os.environ, "NUMBA_CACHE_DIR": str(Path(folder, "cache"))}
            for kernels in ("compiled", "cached"):
                command = [
                    sys.executable,
                    "-m",
                    "fpsboost",
                    str(source),
                    str(Path(folder, kernels)),
                    "-m",
                    method,
                    "-q",
                ]
                begin = time.perf_counter()
                subprocess.run(command, check=True, env=environment)
                figures[f"{method} {kernels}"] = time.perf_counter() - begin
                table.add_row(method, kernels, f"{figures[f'{method} {kernels}']:.1f}")
    console.print(table)
    return figures


parts = {"exhaustive": exhaustive, "methods": by_method, "memory": memory, "start": start}


def main() -> None:
    """Run the parts that were asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", choices=[*parts, []], default=[])
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    console = Console()
    figures = {name: parts[name](console) for name in arguments.part or parts}
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
