"""A clip for the page: what its header says, what `fpsboost probe` says, and one frame between two of it."""

from __future__ import annotations

import json
import subprocess
from dataclasses import asdict, replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from threading import Event
from typing import Any, NamedTuple

from fpsboost import (
    ConversionJob,
    Frame,
    InputError,
    OptionError,
    Position,
    RunOptions,
    Trim,
    format_time,
    methods,
    with_neighbours,
)
from fpsboost.cli.probe import facts
from fpsboost.io.opening import TargetRequirements, open_source
from fpsboost.preparation import opened_clip
from fpsboost.preview.views import View
from fpsboost.probing import Findings, Probe
from fpsboost.ui.choices import first_choices
from fpsboost.ui.jobs import start_process

QUICK_PIXELS = 1_500_000_000
"""Number of pixels in all frames of a clip up to which it is read to its end unasked, which takes seconds."""

DROP_AFTER = 0.25
"""Time after which it is looked whether anybody still waits for a clip that is read, seconds."""


def header(path: str) -> dict[str, Any]:
    """Return the properties of a clip that are known without reading its frames, as plain data."""
    with open_source(path, requirements=TargetRequirements(layers=True)) as source:
        info, is_images = source.info, source.stream_info.images is not None
        remarks = list(source.remarks)
    count = info.frame_count
    duration = info.duration or (count / info.rate if count else None)
    says = [f"{info.width}x{info.height}", *([f"{count:,} frames"] if count else [])]
    if not is_images:
        says += [f"{float(info.rate):.6g} frames a second", *([format_time(duration)] if duration else [])]
    return {
        "name": Path(path).name,
        "says": ", ".join(says),
        "is_images": is_images,
        "last": None if duration is None else max(0.0, float(duration - 1 / info.rate)),
        "is_quick": count is not None and count * info.width * info.height <= QUICK_PIXELS,
        "remarks": remarks,
        "choices": asdict(first_choices(path)),
    }


def probe(path: str, is_dropped: Event) -> dict[str, Any]:
    """Return what `fpsboost probe` says, as plain data; it runs as a process until it ends or is dropped."""
    process = start_process(["probe", path, "--json"], subprocess.PIPE)
    while True:
        try:
            text, messages = process.communicate(timeout=DROP_AFTER)
            break
        except subprocess.TimeoutExpired:
            if is_dropped.is_set():
                process.terminate()
    if process.returncode != 0:
        raise InputError(messages.strip().removeprefix("fpsboost: ") or f"{path} was not read to its end.")
    result = Probe.from_json(json.loads(text))
    return {
        "facts": {name: value for name, value in facts(result).items() if not name.startswith("--")},
        "streams": [
            f"{each.kind}: {' '.join(filter(None, (each.codec, each.details, each.language, each.title)))}"
            for each in result.streams
        ],
        "remarks": [*result.remarks, *result.conversion.remarks],
        "last": max(0.0, result.duration - 1 / result.rate),
    }


class FrameBetween(NamedTuple):
    """A frame between two of a clip as JPEG, the times of the two in the clip, and whether a scene ends there."""

    interpolated: bytes
    blended: bytes
    begin: Fraction
    end: Fraction
    is_cut: bool


def look_between(job: ConversionJob, time: Fraction) -> FrameBetween:
    """Interpolate the frame in the middle between the two around a time, or between the last two."""
    run = RunOptions(overwrite=True)  # nothing is written
    with opened_clip(job.of_part(Trim()), run) as clip:
        info, traits = clip.whole.info, clip.whole.stream_info.traits
    if info.duration is not None:
        time = min(time, info.duration - 1 / info.rate)
    start = time - Fraction(3, 2) / info.rate
    with opened_clip(job.of_part(Trim(Position(start) if start > 0 else None)), run) as clip:
        findings = Findings()
        # the pair and one on either side, whose motion says where its own one bends
        pairs = list(islice(findings.pairs(clip.source, job.method), 3))
        if not pairs:
            raise OptionError(f"{info.name} has no two frames at {float(time):g} s; choose an earlier place.")
        moments = [findings.in_clip(moment) for moment in findings.moments[: len(pairs) + 1]]
        place = max((number for number in range(len(pairs)) if moments[number] <= time), default=0)
        before, pair, after = list(with_neighbours(pairs))[place]
        view = View(traits)
        for method in (job.method, replace(methods["blend"], at_cuts="blend")):
            image = next(iter(method.between(pair, [0.5], before, after).images))
            view.add(Frame(image, Fraction(0)), Fraction(0))
        is_cut = pair.is_cut(before, after)
    interpolated, blended = view.pictures
    return FrameBetween(interpolated, blended, moments[place], moments[place + 1], is_cut)
