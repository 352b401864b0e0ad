"""A clip for the page: its header, the results of `fpsboost probe`, and a frame interpolated between two of it."""

import math
import subprocess
from dataclasses import asdict, replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from threading import Event
from typing import Any

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
from fpsboost.cli.probe import facts, read_probe
from fpsboost.extension import (
    Findings,
    Remarks,
    TargetRequirements,
    open_source,
    opened_clip,
    stands_for_images,
    trim_source,
)
from fpsboost.pages import data_uri
from fpsboost.preview.view import View
from fpsboost.ui.choices import remarks_on_page
from fpsboost.ui.jobs import start_process

QUICK_PIXELS = 1_500_000_000
"""Number of pixels in all frames of a clip up to which the page reads it to its end by itself, which takes seconds."""


def header(path: str) -> dict[str, Any]:
    """Return the properties of a clip that are known without reading its frames, as plain data."""
    with open_source(path, requirements=TargetRequirements(layers=True)) as source:
        info = source.info
        is_images = source.stream_info.images is not None
        remarks = Remarks(source.remarks)
        streams = source.stream_info.streams
    count = info.frame_count
    duration = info.nominal_duration
    unit = info.rate if is_images else 1  # positions are numbers of images, or seconds
    says = [f"{info.width}x{info.height}", *([f"{count:,} frames"] if count else [])]
    if not is_images:
        says += [f"{float(info.rate):.6g} frames a second", *([format_time(duration)] if duration else [])]
    return {
        "name": Path(path).name,
        "says": ", ".join(says),
        "is_images": is_images,
        "last": None if duration is None else max(0.0, float(duration * unit - unit / info.rate)),
        "length": None if duration is None else float(duration),
        "is_quick": count is not None and count * info.width * info.height <= QUICK_PIXELS,
        "remarks": remarks_on_page(remarks, path),
        "streams": [asdict(each) for each in streams],
    }


def probe(path: str, is_dropped: Event) -> dict[str, Any]:
    """Return the results of `fpsboost probe` as plain data.

    It runs as a process, which is stopped if `is_dropped` is set because no request waits for it any more.
    """
    process = start_process(["probe", path, "--json"], subprocess.PIPE)
    while True:
        try:
            text, messages = process.communicate(timeout=0.25)
            break
        except subprocess.TimeoutExpired:  # check whether the request still waits for it
            if is_dropped.is_set():
                process.terminate()
    if process.returncode != 0:
        raise InputError(messages.strip().removeprefix("fpsboost: ") or f"{path} was not read to its end.")
    result = read_probe(text)
    return {
        "facts": {name: value for name, value in facts(result).items() if not name.startswith("--")},
        "streams": [asdict(each) for each in result.streams],
        "remarks": remarks_on_page([*result.remarks, *result.conversion.remarks], path),
        "length": result.duration,
        "last": result.frames - 1 if stands_for_images(path) else max(0.0, result.duration - 1 / result.rate),
    }


def poster(path: str) -> bytes:
    """Return the frame in the middle of a clip as JPEG, the picture of a result until it is played."""
    with open_source(path) as source:
        shown = View(source.stream_info.traits)
        info = source.info
        place = math.floor((info.nominal_duration or 0) * info.rate / 2) / info.rate
        shown.add(next(iter(trim_source(source, Trim(Position(place)))[0])), Fraction(0))
    return shown.pictures[0]


def place_of(path: str, text: str) -> float:
    """Return a position that was typed, in seconds; of images, counted from 0, where a bare number counts from 1."""
    with open_source(path) as source:
        rate = source.info.rate
        is_images = source.stream_info.images is not None
    place = Position.parse(text, "The text", "f" if is_images else "s")
    if is_images and text.strip() == "0":
        raise OptionError("Images count from 1; give the number of one of them.")
    return float(place.seconds(rate) * (rate if is_images else 1)) - (is_images and text.strip().isdecimal())


def preview_between(job: ConversionJob, time: Fraction) -> dict[str, Any]:
    """Interpolate the frame in the middle between the two around a time, or between the last two.

    Parameters
    ----------
    job : ConversionJob
        Clip and method.
    time : Fraction
        Seconds after the clip's first frame; for images, which have no rate, their number.

    Returns
    -------
    dict
        Both pictures, blended and interpolated, as data URIs of JPEG; the times or names of the two frames; and whether
        a scene ends between them.
    """
    run = RunOptions(overwrite=True)  # nothing is written
    with opened_clip(job.of_part(Trim()), run) as clip:
        info = clip.whole.info
        traits = clip.whole.stream_info.traits
        images = clip.whole.stream_info.images
    time = time if images is None else time / info.rate
    duration = info.nominal_duration
    if duration is not None:
        time = min(time, duration - 1 / info.rate)
    start = time - Fraction(3, 2) / info.rate
    place = Position(start) if images is None else Position(Fraction(math.ceil(start * info.rate)), is_frame=True)
    with opened_clip(job.of_part(Trim(place if start > 0 else None)), run) as clip:
        findings = Findings()
        # the pair and one on either side, whose motion curves its paths
        pairs = list(islice(findings.pairs(clip.source, job.method), 3))
        if not pairs and start <= 0:
            raise InputError(f"{info.name} has only one frame; choose a longer clip.")
        if not pairs:
            raise OptionError(f"{info.name} has no two frames at {float(time):g} s; choose an earlier place.")
        moments = [findings.in_clip(times[0]) for times in findings.pictures[: len(pairs) + 1]]
        nearest = max((number for number in range(len(pairs)) if moments[number] <= time), default=0)
        pair = list(with_neighbours(pairs))[nearest]
        view = View(traits)
        for method in (replace(methods["blend"], at_cuts="blend"), job.method):
            ((image, _),) = method.images(pair, [0.5])
            view.add(Frame(image, Fraction(0)), Fraction(0))
        ends = moments[nearest : nearest + 2]
    names = [format_time(end) if images is None else images.files[round(end * info.rate)].name for end in ends]
    return {
        "images": [data_uri(each, "jpeg") for each in view.pictures],
        "between": f"between {' and '.join(names)}",
        "is_cut": pair.is_cut,
    }
