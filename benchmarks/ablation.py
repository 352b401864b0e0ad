"""What each ingredient of the default method is worth: ``python benchmarks/ablation.py [CLIP ...]``.

Each row is the default method with one ingredient taken away or replaced, scored as in ``quality.py``: clips with every
second frame hidden, figures as means over the frames and then over the clips. The columns with a sign are what the row
has more than the whole method.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scoring import (
    SAMPLE,
    Figures,
    cells,
    find_clips,
    make_hidden,
    one_thread,
    read_clip,
    score_clip,
    wide_console,
)

from fpsboost.colour import colour_components
from fpsboost.errors import FpsboostError
from fpsboost.evaluation.compared_methods import ComparedInterpolator
from fpsboost.evaluation.further_metrics import choose_metrics
from fpsboost.evaluation.results import means
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image
from fpsboost.interpolator import Interpolator
from fpsboost.kernels.candidates import Votes, list_candidates
from fpsboost.kernels.constants import WHITE
from fpsboost.kernels.planes import level_scale
from fpsboost.method_table import methods
from fpsboost.motion import MotionEstimator, nlm
from fpsboost.motion.components import padded_planes
from fpsboost.motion.field import MotionField
from fpsboost.motion.opencv import Dis
from fpsboost.pair import Pair
from fpsboost.synthesis import FramePair, InterpolatedImage, multi_hypothesis, votes
from fpsboost.synthesis.blend import Blend
from fpsboost.synthesis.reproject import Reproject

WHOLE = "the whole method"


@dataclass(frozen=True)
class WholePixels:
    """An estimator without its sub-pixel step: every vector is rounded."""

    inner: MotionEstimator

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`."""
        fields = self.inner.estimate(image0, image1)
        field01, field10 = (replace(field, vectors=np.rint(field.vectors)) for field in fields)
        return field01, field10


def plain_planes(image: Image, padding: int, v: float) -> NDArray[np.uint8]:
    """Return padded 8-bit planes like `contrast_planes` of the package, from the report's colour components."""
    values = padded_planes(colour_components(image), padding, level_scale(v))
    return np.rint(values.clip(0, WHITE)).astype(np.uint8)


PLAIN_COLOURS = {"contrast_components": colour_components, "contrast_planes": plain_planes}
"""The report's colour components, which do not emphasize low contrast."""

UNFILTERED = {"GaussianBlur": lambda image, *_, **__: image}
"""Pyramid levels reduced by the mean of four pixels, without a Gaussian filter."""


@dataclass(frozen=True)
class PatchedSearch:
    """The default search with other values of names in its module, or in one that it uses."""

    inner: nlm.CoarseToFine
    names: dict[str, Any]
    module: ModuleType = nlm

    def estimate(self, image0: FrameCache, image1: FrameCache) -> tuple[MotionField, MotionField]:
        """See `fpsboost.motion.MotionEstimator.estimate`."""
        with patch.multiple(self.module, **self.names):
            return self.inner.estimate(image0, image1)


def collect_votes_of_one(frame_pair: FramePair, step: int) -> list[Votes]:
    """Collect votes like `fpsboost.synthesis.votes.collect_votes`, but those of the second frame weigh nothing."""
    voters0, voters1 = votes.collect_votes(frame_pair, step)
    return [voters0, voters1._replace(trust=np.zeros_like(voters1.trust))]


@dataclass(frozen=True)
class WithConstants:
    """The default synthesizer with other values of names in its module, or in one that it uses."""

    inner: multi_hypothesis.MultiHypothesis
    constants: dict[str, Any]
    module: ModuleType = multi_hypothesis

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`."""
        with patch.multiple(self.module, **self.constants):
            images = list(self.inner.synthesize(frame_pair, times))
        yield from images


def list_moving_candidates(*arguments: Any) -> None:
    """List candidates like `fpsboost.kernels.candidates.list_candidates`, but zero motion only if there is no other."""
    list_candidates(*arguments)
    *_, listed, _, _ = arguments
    listed[listed > 1] -= 1  # the last one is no motion


@dataclass(frozen=True)
class NextPairOnly(Interpolator):
    """An interpolator that curves its paths by the following pair of frames only."""

    def images(self, pair: Pair, times: Sequence[float | Fraction], **options: Any) -> Iterator[InterpolatedImage]:
        """See `fpsboost.interpolator.Interpolator.images`."""
        return super().images(pair.between(None, pair.after), times, **options)


MOTION: dict[str, dict[str, Any]] = {
    "every point chooses alone": {"smoothness": 0.0},
    "smoothness of the search doubled": {"smoothness": 2.0},
    "a change of motion costs half": {"steepness": 8.0},
    "one offset a point": {"labels": 1},
    "three offsets a point": {"labels": 3},
    "patch radius 3": {"patch_radius": 3},
    "patch radius 8": {"patch_radius": 8},
    "fewer levels": {"coarsest_side": 240},
    "half the search range": {"max_motion_share": 1 / 16},
    "a vector for every 4th pixel": {"step": 4},
    "a vector for every 16th pixel": {"step": 16},
}
"""Options of the estimator that differ."""

SYNTHESIS: dict[str, dict[str, Any]] = {
    "similarity does not count": {"sharpness": 0.0},
    "the most similar takes all": {"sharpness": 1000.0},
    "candidates from near by": {"support_radius": 16.0},
    "candidates from far": {"support_radius": 32.0},
    "candidates 0.8 pixels apart": {"merge_distance": 0.8},
    "five candidates a node": {"max_candidates": 5},
    "every 4th pixel asked": {"step": 4},
    "every 16th pixel asked": {"step": 16},
    "bandwidth of the report, v = 0.25": {"bandwidth": 0.25},
    "every candidate tried": {"sufficient_similarity": 2.0, "min_vote_share": 0.0},
    "unlikely candidates tried": {"min_weight": 0.0},
}
"""Options of the synthesizer that differ."""

CONSTANTS: dict[str, dict[str, Any]] = {
    "no candidate without motion": {
        "ZERO_MOTION_PRIOR": 1e-30,
        "list_candidates": list_moving_candidates,
    },
    "one direction's candidates": {"collect_votes": collect_votes_of_one},
    "paths bent however votes scatter": {"ACCELERATION_TOLERANCE": 1e6},
}
"""Names of the synthesizer's module that stand for something else."""


def list_variants(full: Interpolator) -> dict[str, Interpolator]:
    """Return the variants to measure by name; edit the list at will."""
    search: Any = full.estimator
    fusing: Any = full.synthesizer
    return {
        WHOLE: full,
        "whole pixels only": replace(full, estimator=WholePixels(search)),
        "plain colours": replace(full, estimator=PatchedSearch(search, PLAIN_COLOURS)),
        "plain colours, v = 0.25": replace(full, estimator=PatchedSearch(replace(search, v=0.25), PLAIN_COLOURS)),
        **{name: replace(full, estimator=each) for name, each in changed(search, MOTION).items()},
        "halves not filtered": replace(full, estimator=PatchedSearch(search, UNFILTERED, cv2)),
        "no residual search": replace(full, estimator=PatchedSearch(search, {"MIN_SIMILARITY": ()})),
        "one residual search": replace(
            full, estimator=PatchedSearch(search, {"MIN_SIMILARITY": nlm.MIN_SIMILARITY[:1]})
        ),
        "plain weights": replace(full, synthesizer=replace(fusing, fusion="plain")),
        "DIS instead of the search": replace(full, estimator=Dis()),
        "straight paths": replace(full, curved=False),
        "paths curved by the next pair alone": NextPairOnly(**options_of(full)),
        "light not matched": replace(full, compensate_illumination=False),
        "overlays move along": replace(full, overlays=False),
        "votes not weighed by the way back": replace(
            full, synthesizer=WithConstants(fusing, {"CONSISTENCY_TOLERANCE": 1e6}, votes)
        ),
        **{name: replace(full, synthesizer=WithConstants(fusing, each)) for name, each in CONSTANTS.items()},
        **{name: replace(full, synthesizer=each) for name, each in changed(fusing, SYNTHESIS).items()},
        "the report's reprojection": replace(full, synthesizer=Reproject()),
        "frames mixed, no motion": replace(full, synthesizer=Blend()),
    }


def options_of(part: Any) -> dict[str, Any]:
    """Return the values of a dataclass's fields by name."""
    return {each.name: getattr(part, each.name) for each in fields(part)}


def changed(part: Any, variants: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return a part with each variant's options, by variant; leave out variants that do not apply or change nothing."""
    known = options_of(part)
    return {
        name: replace(part, **options)
        for name, options in variants.items()
        if options.keys() <= known.keys() and any(known[key] != value for key, value in options.items())
    }


def measure(paths: Sequence[str], variants: dict[str, Interpolator], largest: int) -> dict[str, dict[str, Figures]]:
    """Score every variant on every clip; return the scores by variant, then by clip."""
    figures: dict[str, dict[str, Figures]] = {name: {} for name in variants}
    for clip_name, path in find_clips(paths).items():
        clip = read_clip(clip_name, path, largest)
        if not clip.scored:
            continue
        for name, interpolator in variants.items():
            figures[name][clip_name] = score_clip(
                clip, make_hidden(ComparedInterpolator(interpolator), clip), choose_metrics(["missing"])
            )
    return figures


def ablation_table(title: str, rows: dict[str, Figures]) -> Table:
    """Return a table of every variant's mean scores and their differences from the whole method."""
    table = Table("variant", "PSNR, dB", "SSIM", "MAE", "CPU, ms", "PSNR +", "SSIM +", "MAE +", title=title)
    whole = rows[WHOLE]
    for name, row in rows.items():
        more = {key: row[key] - whole[key] for key in row}
        table.add_row(name, *cells(row), f"{more['psnr']:+.2f}", f"{more['ssim']:+.4f}", f"{more['mae']:+.3f}")
    return table


def main() -> None:
    """Print a table of means, and write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="*", default=[str(SAMPLE)])
    parser.add_argument("--only", default="", help="variants whose names hold one of these words, separated by commas")
    parser.add_argument("--frames", type=int, default=6, help="hidden frames at most, per clip")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    one_thread()
    variants = list_variants(methods["nlm"])
    if arguments.only:
        words = [WHOLE, *arguments.only.split(",")]
        variants = {name: each for name, each in variants.items() if any(word in name for word in words)}
    try:
        by_clip = measure(arguments.clip, variants, arguments.frames)
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    if not by_clip[WHOLE]:
        raise SystemExit("There is nothing to score: a scene cut in every pair.")
    rows = {name: means(list(each.values())) for name, each in by_clip.items()}
    wide_console().print(ablation_table(f"Mean of {len(by_clip[WHOLE])} clips", rows))
    if arguments.json:
        arguments.json.write_text(json.dumps({"mean": rows, "clips": by_clip}, indent=1) + "\n")


if __name__ == "__main__":
    main()
