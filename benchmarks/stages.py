"""Where the time of the default method goes: every function that it calls is timed while it makes a sequence.

The functions are found by the names under which the method's modules know them; one that is no longer there is said and
left out. A stage that calls another is billed for its own share alone.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from scoring import make_between

from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.interpolator import Interpolator

FINISHING, NLM, SYNTHESIS = "fpsboost.finishing", "fpsboost.motion.nlm", "fpsboost.synthesis.multi_hypothesis"


class Stage(NamedTuple):
    """A function of the method."""

    module: str
    name: str
    """As the module knows it; a method is written with its class."""
    width_of: Callable[..., int] | None = None
    """Tells the levels of a pyramid apart: the width of the level, from the function's arguments."""


STAGES = {
    "illumination": Stage("fpsboost.pair", "estimate_illumination"),
    "cut detection": Stage("fpsboost.analysis.scene_cuts", "CutDetector.match_score"),
    "pyramid": Stage(NLM, "pyramid"),
    "components, coarsest": Stage(NLM, "contrast_components"),
    "components, padded": Stage(NLM, "contrast_planes"),
    "coarse search": Stage(NLM, "search_fused"),
    "level search": Stage(NLM, "search_level", width_of=lambda pair, *_: pair.width),
    "residual search": Stage(NLM, "search_residuals_bidirectional"),
    "residual regions": Stage(NLM, "match_residual_regions"),
    "least-squares step": Stage(NLM, "refine_bidirectional"),
    "accelerations": Stage("fpsboost.synthesis.votes", "accelerations_at_points"),
    "votes": Stage(SYNTHESIS, "collect_votes"),
    "context, frames": Stage(SYNTHESIS, "find_context"),
    "context, time": Stage(SYNTHESIS, "context_at"),
    "splines, planes": Stage(SYNTHESIS, "spline_samples"),
    "spline filter": Stage("fpsboost.synthesis.spline_samples", "find_coefficients"),
    "collecting": Stage(SYNTHESIS, "collect_candidates"),
    "listing": Stage(SYNTHESIS, "list_candidates"),
    "blending": Stage(SYNTHESIS, "blend_hypotheses"),
    "overlay": Stage(FINISHING, "find_overlay"),
}
"""By the name in the table."""

LEVEL = " at "
"""Between the name of a stage and a level."""

REST = "everything else"
WHOLE = "in all"


@dataclass
class Cost:
    """Cost of a stage, summed over its calls."""

    cpu: float = 0.0
    """CPU seconds, without the stages inside."""
    touched: int = 0
    """Bytes of the arrays that go in and come out, each counted once: the least that has to be moved."""
    calls: int = 0


@dataclass
class Bill:
    """Costs by stage, and the CPU seconds spent inside of those that are running."""

    costs: dict[str, Cost] = field(default_factory=dict)
    inside: list[float] = field(default_factory=list)

    def timed(self, name: str, run: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function so that the cost of each call is added to a stage."""

        def billed(*arguments: Any, **options: Any) -> Any:
            self.inside.append(0.0)
            begin = time.process_time()
            result = run(*arguments, **options)
            spent = time.process_time() - begin
            within = self.inside.pop()
            if self.inside:
                self.inside[-1] += spent
            cost = self.costs.setdefault(name, Cost())
            cost.cpu += spent - within
            cost.touched += bytes_of((arguments, tuple(options.values()), result))
            cost.calls += 1
            return result

        return billed

    def wrapped(self, name: str, stage: Stage, run: Callable[..., Any], width: int) -> Callable[..., Any]:
        """Wrap a stage's function likewise, by pyramid level if the stage has levels; `width` is the frames' width."""
        width_of = stage.width_of
        if width_of is None:
            return self.timed(name, run)

        def billed(*arguments: Any, **options: Any) -> Any:
            shrunk = 2 ** round(math.log2(width / width_of(*arguments, **options)))
            level = f"1/{shrunk}" if shrunk > 1 else "full size"
            return self.timed(name + LEVEL + level, run)(*arguments, **options)

        return billed


def bytes_of(value: Any) -> int:
    """Return the size in bytes of all arrays and image pixels in nested tuples, lists and dataclasses."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, FrameCache):
        return bytes_of(value.pixels)
    if isinstance(value, tuple | list):
        return sum(bytes_of(each) for each in value)
    if is_dataclass(value):
        return sum(bytes_of(getattr(value, each.name)) for each in fields(value))
    return 0


@contextmanager
def watched(bill: Bill, width: int) -> Iterator[list[str]]:
    """Wrap the functions of all stages within the block; yield the names of the stages that were not found."""
    missing = []
    with ExitStack() as patches:
        for name, stage in STAGES.items():
            owner: Any = importlib.import_module(stage.module)
            *outer, last = stage.name.split(".")
            for each in outer:
                owner = getattr(owner, each, None)
            function = getattr(owner, last, None)
            if function is None:
                missing.append(name)
            else:
                patches.enter_context(patch.object(owner, last, bill.wrapped(name, stage, function, width)))
        yield missing


@dataclass(frozen=True)
class Profile:
    """Costs of a sequence of in-between frames, and the stages that were not found."""

    stages: dict[str, Cost]
    """In the order of `STAGES`; then `REST`, what no stage is billed for, and `WHOLE`."""
    frames: int
    missing: list[str]


def profile_sequence(interpolator: Interpolator, frames: Sequence[Image]) -> Profile:
    """Make a sequence, and return the cost of each stage."""
    bill, whole = Bill(), Cost()
    with watched(bill, frames[0].shape[1]) as missing:
        begin = time.process_time()
        made = sum(1 for _ in make_between(interpolator, frames))
        whole.cpu = time.process_time() - begin
    order = {name: place for place, name in enumerate(STAGES)}
    stages = dict(sorted(bill.costs.items(), key=lambda item: order[item[0].partition(LEVEL)[0]]))
    stages[REST] = Cost(whole.cpu - sum(each.cpu for each in stages.values()))
    return Profile({**stages, WHOLE: whole}, made, missing)


def copy_bandwidth(megabytes: int = 256) -> float:
    """Return the bytes that a plain copy in one thread reads and writes per CPU second, the best of five runs."""
    source, target = np.ones(megabytes * 2**20, np.uint8), np.zeros(megabytes * 2**20, np.uint8)
    seconds = []
    for _ in range(5):
        begin = time.process_time()
        np.copyto(target, source)
        seconds.append(time.process_time() - begin)
    return 2 * source.nbytes / min(seconds)
