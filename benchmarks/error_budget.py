"""Where the error of the default method comes from: ``python benchmarks/error_budget.py [CLIP ...]``.

Every second frame of a clip is hidden and made again. The hidden frame then says where the squared error lies, by what
is difficult there, and what the method's own candidates could have made of it at best. ``benchmarks/README.md`` says
what each column means, and what it cannot tell.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from oracles import PATCH, best_of, shifted
from rich.table import Table
from scoring import SAMPLE, Clip, Figures, find_clips, one_thread, read_clip, wide_console

from fpsboost.errors import FpsboostError
from fpsboost.evaluation.making import InterpolatorMaker
from fpsboost.evaluation.metrics import means
from fpsboost.frame import Image
from fpsboost.frame_cache import FrameCache
from fpsboost.interpolator import Interpolator
from fpsboost.kernels.candidates import Candidates
from fpsboost.method_table import methods
from fpsboost.motion.field import MotionField, forward_backward_error
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis

MIDDLE = 0.5
"""When the hidden frame is."""

CONSISTENCY_TOLERANCE = 1.5
"""A pixel is hidden in a frame if the way there and back ends farther than this from where it began, pixels."""

EDGE = 2.0
"""Change of motion from frame to frame within `EDGE_WINDOW` that makes an edge, pixels along x or y."""

EDGE_WINDOW, NEAR = 5, 4
"""Side of the window, and how far from an edge its pixels still count as near, pixels."""

NEAREST, FARTHEST = 3, 40
"""How far away the same patch is looked for, pixels."""

FLAT = 4.0
"""Standard deviation of a patch below which it is flat, levels of 255."""

ALIKE = 0.2
"""Mean squared difference of patches that are alike, as a share of their variance."""

SELF_PATCH = 5
"""Side of these patches in pixels of frames of half the size."""

TIMES = (0.3, 0.4, 0.5, 0.6, 0.7)
"""At which straight paths are tried."""

BLOCK = 32
"""Side of the blocks that choose a time, pixels."""

AROUND = (-8, 0, 8)
"""Where around a node the motion of the hidden frame is taken, pixels along x and y each."""

AREAS = {
    "hidden": "hidden",
    "edges": "edges",
    "flat": "flat",
    "repeated": "repeated",
    "far": "far",
    "none": "none",
}
"""Areas and how the table calls them."""

ORACLES = {
    "time": "time",
    "tried": "tried",
    "node": "node",
    "patch": "patch",
    "node_alone": "node 1",
    "patch_alone": "patch 1",
    "other": "other",
    "motion": "motion",
    "path": "path",
}
"""What the truth chooses, and how the table calls it."""


@dataclass(frozen=True)
class KeepingFramePair:
    """A synthesizer that also keeps the frame pair of each frame that it makes of a clip.

    Attributes
    ----------
    inner : MultiHypothesis
    kept : dict of int to FramePair
        By the number of the shown frame before.
    """

    inner: MultiHypothesis
    kept: dict[int, FramePair] = field(default_factory=dict)

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`."""
        position = frame_pair.image0.source_position
        if position is not None:  # not the noise for which kernels are compiled
            self.kept[position.number] = frame_pair
        yield from self.inner.synthesize(frame_pair, times)


class Case(NamedTuple):
    """A hidden frame, the frame made in its place, and the frame pair that it was made from."""

    truth: Image
    made: Image
    frame_pair: FramePair


def make_cases(method: Interpolator, clip: Clip, largest: int) -> list[Case]:
    """Make the hidden frames that are scored; those without a pair before or after only if there are no others."""
    synthesizer: Any = method.synthesizer
    keeping = KeepingFramePair(synthesizer)
    maker = InterpolatorMaker(replace(method, synthesizer=keeping))
    inner, outer = [], []
    for index, (interval, made) in enumerate(zip(clip.intervals, maker.make(clip.intervals), strict=True)):
        frame_pair = keeping.kept.pop(interval.number, None)
        if index in clip.scored and frame_pair is not None:  # nothing is fused across a cut
            has_neighbours = 0 < index < len(clip.intervals) - 1
            (inner if has_neighbours else outer).append(Case(interval.hidden[0].truth, made.image, frame_pair))
    return (inner or outer)[:largest]


def squared_error(truth: Image, made: Image) -> NDArray[Any]:
    """Return the squared error, (H, W) float64, levels of 255, mean over the colours."""
    error: NDArray[Any] = ((truth.astype(np.float64) - made) ** 2).mean(axis=2)
    return error


def psnr(error: NDArray[Any]) -> float:
    """Return the PSNR in dB of a squared error in levels of 255."""
    return float(10 * np.log10(255**2 / max(error.mean(), 1e-10)))


def motion_of_truth(case: Case) -> list[tuple[MotionField, MotionField]]:
    """Estimate the motion from the hidden frame to each of the shown ones, and back."""
    truth, frame_pair = FrameCache(case.truth), case.frame_pair
    return [Dis("medium").estimate(truth, other) for other in (frame_pair.image0, frame_pair.image1)]


def find_areas(case: Case, reach: float) -> dict[str, NDArray[Any]]:
    """Return masks of the difficult areas and of the rest by name, (H, W) bool; difficult areas may overlap."""
    height, width = case.truth.shape[:2]
    y, x = np.arange(height), np.arange(width)
    hidden = np.zeros((height, width), bool)
    both_ways = motion_of_truth(case)
    flows = [there.flow for there, _ in both_ways]
    for there, back in both_ways:
        end_y, end_x = y[:, np.newaxis] + there.flow[..., 1], x + there.flow[..., 0]
        outside = (end_x < -0.5) | (end_x > width - 0.5) | (end_y < -0.5) | (end_y > height - 0.5)
        hidden |= outside | (forward_backward_error(there.flow, y, x, back) > CONSISTENCY_TOLERANCE)
    flat, repeated = find_alike(case.truth)
    areas = {
        "hidden": hidden,
        "edges": find_edges(flows[1] - flows[0]),
        "flat": flat,
        "repeated": repeated,
        "far": np.maximum(*(np.abs(flow).max(axis=2) for flow in flows)) > reach / 2,
    }
    return {**areas, "none": ~np.logical_or.reduce(list(areas.values()))}


def find_edges(motion: NDArray[Any]) -> NDArray[Any]:
    """Return a mask of motion boundaries and the pixels near them, (H, W) bool."""
    window = np.ones((EDGE_WINDOW, EDGE_WINDOW), np.uint8)
    change = (cv2.dilate(motion, window) - cv2.erode(motion, window)).max(axis=2)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * NEAR + 1, 2 * NEAR + 1))
    return cv2.dilate((change > EDGE).astype(np.uint8), disc) > 0


def find_alike(image: Image) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return masks of flat patches and of others that repeat nearby, (H, W) bool each; compare patches at half size."""
    height, width = image.shape[:2]
    half = cv2.resize(image, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA).astype(np.float32)
    rows, columns = half.shape[:2]
    side = (SELF_PATCH, SELF_PATCH)
    variance = (cv2.blur(half * half, side) - cv2.blur(half, side) ** 2).mean(axis=2)
    alike = np.zeros((rows, columns), bool)
    for dy in range(FARTHEST // 2 + 1):
        for dx in range(-(FARTHEST // 2), FARTHEST // 2 + 1):
            distance = 2 * np.hypot(dx, dy)
            if (dy == 0 and dx < 0) or not NEAREST <= distance <= FARTHEST or dy >= rows or abs(dx) >= columns:
                continue
            here = np.s_[: rows - dy, max(-dx, 0) : columns - max(dx, 0)]
            there = np.s_[dy:, max(dx, 0) : columns - max(-dx, 0)]
            difference = half[here] - half[there]
            apart = cv2.blur(np.einsum("yxc,yxc->yx", difference, difference) / half.shape[2], side)
            alike[here] |= apart < ALIKE * variance[here]
            alike[there] |= apart < ALIKE * variance[there]
    flat = variance < FLAT**2
    back = [cv2.resize(each.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
            for each in (flat, alike & ~flat)]  # fmt: skip
    return back[0], back[1]


def with_best_time(case: Case, fusing: MultiHypothesis, error: NDArray[Any]) -> NDArray[Any]:
    """Return the squared error if each block takes the best of the method's frame and straight paths at `TIMES`."""
    straight = replace(case.frame_pair, before=None, after=None)
    errors = [error, *(squared_error(case.truth, image) for image in fusing.synthesize(straight, TIMES))]
    height, width = error.shape
    least = error.copy()
    for top in range(0, height, BLOCK):
        for left in range(0, width, BLOCK):
            block = np.s_[top : top + BLOCK, left : left + BLOCK]
            least[block] = min((each[block] for each in errors), key=np.sum)
    return least


def choose_by_truth(case: Case, fusing: MultiHypothesis) -> dict[str, NDArray[Any]]:
    """Return the squared error of each oracle, which chooses candidates by the hidden frame itself."""
    frame_pair, truth = case.frame_pair, case.truth
    size = truth.shape[0], truth.shape[1]
    candidates = fusing._candidates(fusing._collect_votes(frame_pair), size, MIDDLE)
    count, motions, weights, _ = candidates
    by_weight = np.argsort(-weights, axis=2, kind="stable")[..., np.newaxis]
    tried = candidates._replace(
        listed=(weights > 0).sum(axis=2, dtype=np.int32), motions=np.take_along_axis(motions, by_weight, axis=2)
    )
    node, choice = best_of(frame_pair, truth, MIDDLE, candidates)
    images = {
        "tried": best_of(frame_pair, truth, MIDDLE, tried)[0],
        "node": node,
        "patch": best_of(frame_pair, truth, MIDDLE, candidates, radius=PATCH)[0],
        "node_alone": best_of(frame_pair, truth, MIDDLE, candidates, alone=True)[0],
        "patch_alone": best_of(frame_pair, truth, MIDDLE, candidates, alone=True, radius=PATCH)[0],
        "other": best_of(frame_pair, truth, MIDDLE, with_motion_of_truth(case, candidates, choice))[0],
    }
    for name, paths in (("motion", False), ("path", True)):
        moved = shifted(motions, choice, MIDDLE, paths=paths)
        all_of_them = candidates._replace(listed=np.full_like(count, moved.shape[2]), motions=moved)
        images[name] = best_of(frame_pair, truth, MIDDLE, all_of_them)[0]
    return {name: squared_error(truth, image) for name, image in images.items()}


def with_motion_of_truth(case: Case, candidates: Candidates, choice: NDArray[Any]) -> Candidates:
    """Add motions estimated from the hidden frame around each node, before the node's own candidates.

    Their accelerations and gradients are those of the node's choice, so that they differ from it in motion only.
    """
    (to_first, _), (to_second, _) = motion_of_truth(case)
    flow = to_second.flow - to_first.flow
    (rows, columns), (count, motions, _, spacing) = choice.shape, candidates
    chosen = np.take_along_axis(motions, choice[..., np.newaxis, np.newaxis], axis=2)[:, :, 0]
    added = []
    for down in AROUND:
        for across in AROUND:
            y = (np.arange(rows) * spacing + spacing // 2 + down).clip(0, flow.shape[0] - 1)
            x = (np.arange(columns) * spacing + spacing // 2 + across).clip(0, flow.shape[1] - 1)
            added.append(np.concatenate([flow[np.ix_(y, x)], chosen[..., 2:]], axis=2))
    together = np.ascontiguousarray(np.concatenate([np.stack(added, axis=2), motions], axis=2))
    return candidates._replace(listed=count + len(added), motions=together)


def budget(case: Case, fusing: MultiHypothesis, reach: float) -> Figures:
    """Return a hidden frame's PSNR, the share of squared error and pixels of each area, and the gain of each oracle."""
    error = squared_error(case.truth, case.made)
    whole = psnr(error)
    figures = {"psnr": whole}
    for name, area in find_areas(case, reach).items():
        figures[f"{name}_error"] = float(error[area].sum() / max(error.sum(), 1e-10))
        figures[f"{name}_area"] = float(area.mean())
    chosen = {"time": with_best_time(case, fusing, error), **choose_by_truth(case, fusing)}
    return figures | {f"{name}_gain": psnr(each) - whole for name, each in chosen.items()}


def measure(paths: Sequence[str], method: Interpolator, largest: int) -> dict[str, Figures]:
    """Return the mean figures over the hidden frames of each clip."""
    fusing, search = method.synthesizer, method.estimator
    if not isinstance(fusing, MultiHypothesis) or not isinstance(search, CoarseToFine):
        raise TypeError("Only a method that searches coarse to fine and fuses has such a budget.")
    figures = {}
    for name, path in find_clips(paths).items():
        clip = read_clip(name, path, largest + 2)
        reach = search.max_motion_share * max(clip.shown[0].shape[:2])
        rows = [budget(case, fusing, reach) for case in make_cases(method, clip, largest)]
        if rows:
            figures[name] = means(rows)
    return figures


def budget_table(figures: dict[str, Figures]) -> Table:
    """Return a table with a row for each clip, for the means, and for the mean share of pixels of each area."""
    table = Table("clip", "PSNR", *AREAS.values(), *ORACLES.values(), box=None, padding=(0, 1, 0, 0))
    for name, row in {**figures, "mean": means(list(figures.values()))}.items():
        shares = [f"{row[f'{area}_error']:.0%}" for area in AREAS]
        gains = [f"{row[f'{oracle}_gain']:+.2f}" for oracle in ORACLES]
        table.add_row(name, f"{row['psnr']:.2f}", *shares, *gains)
    mean = means(list(figures.values()))
    table.add_row("of the area", "", *(f"{mean[f'{area}_area']:.0%}" for area in AREAS), *("" for _ in ORACLES))
    return table


def main() -> None:
    """Print a table, and write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="*", default=[str(SAMPLE)])
    parser.add_argument("--frames", type=int, default=2, help="hidden frames at most, per clip")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    one_thread()
    method = replace(methods["nlm"], compensate_illumination=False, overlays=False)
    try:
        figures = measure(arguments.clip, method, arguments.frames)
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    if not figures:
        raise SystemExit("There is nothing to judge: a scene cut in every pair.")
    wide_console().print(budget_table(figures))
    if arguments.json:
        arguments.json.write_text(
            json.dumps({"mean": means(list(figures.values())), "clips": figures}, indent=1) + "\n"
        )


if __name__ == "__main__":
    main()
