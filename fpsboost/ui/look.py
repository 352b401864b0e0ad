"""One frame between two of a clip, made by a method and by blending."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import islice
from typing import NamedTuple

from fpsboost.errors import OptionError
from fpsboost.frame import Frame
from fpsboost.interpolator import with_neighbours
from fpsboost.method_table import methods
from fpsboost.preparation import ConversionJob, opened_clip
from fpsboost.preview.places import of_part
from fpsboost.preview.views import View
from fpsboost.probing import Findings
from fpsboost.run_options import RunOptions
from fpsboost.streaming import beginning
from fpsboost.timing.position import Position
from fpsboost.timing.trim import Trim


class Look(NamedTuple):
    """A frame between two of a clip as JPEG, the times of the two in the clip, and whether a scene ends there."""

    made: bytes
    blended: bytes
    begin: Fraction
    end: Fraction
    is_cut: bool


def look_between(job: ConversionJob, time: Fraction) -> Look:
    """Make the frame in the middle between the two around a time, or between the last two."""
    run = RunOptions(overwrite=True)  # nothing is written
    with opened_clip(of_part(job, Trim()), run) as clip:
        info, traits = clip.whole.info, clip.whole.stream_info.traits
    if info.duration is not None:
        time = min(time, info.duration - 1 / info.rate)
    start = time - Fraction(3, 2) / info.rate
    with opened_clip(of_part(job, Trim(Position(start) if start > 0 else None)), run) as clip:
        findings = Findings()
        # the pair and one on either side, whose motion says where its own one bends
        pairs = list(islice(findings.pairs(clip.source, job.method), 3))
        if not pairs:
            raise OptionError(f"{info.name} has no two frames at {float(time):g} s; choose an earlier place.")
        begins = beginning(clip.source).seconds - findings.times[0]
        moments = [moment + begins for moment in findings.moments[: len(pairs) + 1]]
        place = max((number for number in range(len(pairs)) if moments[number] <= time), default=0)
        before, pair, after = list(with_neighbours(pairs))[place]
        view = View(traits)
        for method in (job.method, replace(methods["blend"], at_cuts="blend")):
            image = next(iter(method.between(pair, [0.5], before, after).images))
            view.add(Frame(image, Fraction(0)), Fraction(0))
        is_cut = pair.is_cut(before, after)
    made, blended = view.pictures
    return Look(made, blended, moments[place], moments[place + 1], is_cut)
