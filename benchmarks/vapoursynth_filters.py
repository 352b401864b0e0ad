"""CPU time of VapourSynth filters that raise frame rates: ``python benchmarks/vapoursynth_filters.py [CLIP ...]``.

fpsboost beside MVTools' FlowFPS (``mv``) and MVUtensils' (``mvu``), these with blocks of 8x8 and half pixels, their
defaults, on the same frames in the same format, in one process and in turn. Plugins that are not there are left out:
``pip install '.[vapoursynth]' vapoursynth-mvtools vapoursynth-mvutensils`` with Python 3.12 or newer. All frames of the
doubled clip are asked for, and the time of reading the source alone is taken off.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import vapoursynth as vs
from rich.console import Console
from rich.table import Table
from scoring import SAMPLE, find_clips, read_frames

from fpsboost.image import Image
from fpsboost.integrations.vapoursynth import interpolate

BLOCK = 16
"""Sides are cut to a multiple of it, which blocks that overlap need."""

Filter = Callable[[vs.VideoNode], vs.VideoNode]


def in_host(images: Sequence[Image], format: str) -> vs.VideoNode:
    """Return images as a clip whose frames cost a copy each."""
    height, width = (side // BLOCK * BLOCK for side in images[0].shape[:2])
    rgb = vs.core.std.BlankClip(format=vs.RGB24, width=width, height=height, length=len(images), keep=True)
    clip = filled(rgb, [[image[:height, :width, plane] for plane in (2, 1, 0)] for image in images])
    clip = clip.resize.Bicubic(format=getattr(vs, format), matrix_s="709", range_s="limited")
    planes = [[np.array(frame[plane]) for plane in range(3)] for frame in clip.frames()]
    blank = vs.core.std.BlankClip(clip, keep=True).std.SetFrameProps(_Matrix=vs.MATRIX_BT709)
    return filled(blank, planes)


def filled(blank: vs.VideoNode, planes: Sequence[Sequence[np.ndarray[Any, Any]]]) -> vs.VideoNode:
    """Return a clip with these planes."""

    def fill(n: int, f: vs.VideoFrame) -> vs.VideoFrame:
        frame = f.copy()
        for plane, values in enumerate(planes[n]):
            np.asarray(frame[plane])[:] = values
        return frame

    return blank.std.ModifyFrame(blank, fill)


def mv_flow_fps(clip: vs.VideoNode) -> vs.VideoNode:
    """MVTools with its defaults, which are blocks of 8x8 and half pixels."""
    mv = vs.core.mv
    found = mv.Super(clip)
    vectors = [mv.Analyse(found, isb=backward) for backward in (True, False)]
    return mv.FlowFPS(clip, found, *vectors, num=2 * clip.fps.numerator, den=clip.fps.denominator)


def mvu_flow_fps(clip: vs.VideoNode) -> vs.VideoNode:
    """MVUtensils with what are MVTools' defaults."""
    mvu = vs.core.mvu
    blocks = {"blksize": [8, 8], "overlap": [0, 0]}
    found = mvu.Super(clip, pel=2, **blocks)
    vectors = [mvu.Analyse(found, delta=delta, **blocks) for delta in (1, -1)]
    return mvu.FlowFPS(clip, found, vectors, num=2 * clip.fps.numerator, den=clip.fps.denominator)


def filters(methods: Sequence[str]) -> dict[str, Filter]:
    """Return the filters that can be had, by name."""
    found: dict[str, Filter] = {f"fpsboost, {method}": partial(interpolate, method=method) for method in methods}
    if hasattr(vs.core, "mv"):
        found["mv.FlowFPS"] = mv_flow_fps
    if hasattr(vs.core, "mvu"):
        found["mvu.FlowFPS"] = mvu_flow_fps
    return found


def seconds_of(clip: vs.VideoNode) -> tuple[float, float]:
    """Return the CPU and wall seconds of all frames of a clip."""
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in clip.frames(close=True):
        pass
    return time.process_time() - cpu, time.perf_counter() - wall


def measure(images: Sequence[Image], format: str, methods: Sequence[str], rounds: int) -> dict[str, dict[str, float]]:
    """Return milliseconds a made frame for each filter, the median of rounds in turn."""
    times: dict[str, list[tuple[float, float]]] = {}
    source = in_host(images, format)
    made = len(images) - 1
    for each in filters(methods).values():  # kernels, plans of transforms, threads
        each(source[:3]).get_frame(1)
    for _ in range(rounds):
        reading, _ = seconds_of(in_host(images, format))
        for name, each in filters(methods).items():
            cpu, wall = seconds_of(each(in_host(images, format)))
            times.setdefault(name, []).append((1e3 * (cpu - reading) / made, 1e3 * wall / made))
    return {
        name: {"cpu_ms": median(cpu for cpu, _ in runs), "wall_ms": median(wall for _, wall in runs)}
        for name, runs in times.items()
    }


def main() -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="*", default=[str(SAMPLE)], help="videos, folders of images, or of these")
    parser.add_argument("--frames", type=int, default=13, help="of a clip, at most")
    parser.add_argument("--format", default="YUV420P8", help="VapourSynth's name of a YUV format")
    parser.add_argument("--methods", default="nlm,nlm-fast", help="of fpsboost")
    parser.add_argument("--threads", type=int, default=1, help="of VapourSynth")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path, help="keep the figures here")
    options = parser.parse_args()
    vs.core.num_threads = options.threads
    figures = {}
    table = Table(title=f"Milliseconds a made frame, {options.format}, {options.threads} thread(s)")
    for heading in ("clip", "filter", "CPU", "wall"):
        table.add_column(heading, justify="left" if heading in ("clip", "filter") else "right")
    for name, path in find_clips(options.clips).items():
        images = read_frames(path, options.frames)
        figures[name] = measure(images, options.format, options.methods.split(","), options.rounds)
        size = f"{images[0].shape[1]}x{images[0].shape[0]}"
        for each, row in figures[name].items():
            table.add_row(f"{name}, {size}", each, f"{row['cpu_ms']:.1f}", f"{row['wall_ms']:.1f}")
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
