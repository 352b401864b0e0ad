"""Does the confidence of a method know where the method errs, and by how much?

``python benchmarks/confidence.py CLIPS`` prints the mean error of pixels by their confidence; without clips, on the
project's own scenes, of which ``--figure docs/figures/calibration.svg`` draws the figure of the documentation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table
from scoring import SAMPLE, find_clips, make_hidden, one_thread, read_clip, wide_console

from fpsboost import methods
from fpsboost.evaluation.compared_methods import ComparedInterpolator
from fpsboost.image import Image, view
from fpsboost.synthesis import FramePair, FusesHypotheses, InterpolatedImage, Synthesizer
from fpsboost.synthesis.agreement import measure_agreement

METHODS = "nlm,nlm-fast,dis,dis-warp,nlm-exhaustive,block,blend"
"""The first three fuse hypotheses; of the others, confidence is the agreement of both frames."""

DRAWN = {"nlm": "#2f6f9f", "dis-warp": "#b5532a", "nlm-exhaustive": "#6a8f3a", "blend": "#777777"}
"""Methods of the figure, and their colours."""

STEPS = np.linspace(0, 1, 11)
"""Edges of the classes of confidence."""


@dataclass(frozen=True)
class KeepingConfidence:
    """A synthesizer like another one that also keeps the confidence of each frame that it makes of a clip."""

    inner: Synthesizer
    kept: dict[int, NDArray[Any]]
    """By the number of the shown frame before."""

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """See `fpsboost.synthesis.Synthesizer.synthesize`."""
        position = frame_pair.image0.source_position
        for image, confidence in _with_confidence(self.inner, frame_pair, times):
            assert position is not None, "a frame of a clip"
            self.kept[position.number] = confidence
            yield view(image).array()


def _with_confidence(
    synthesizer: Synthesizer, frame_pair: FramePair, times: Sequence[float]
) -> Iterator[InterpolatedImage]:
    """Yield images with the synthesizer's own confidence, or with the agreement of both frames."""
    if isinstance(synthesizer, FusesHypotheses):
        yield from synthesizer.fuse(frame_pair, times)
        return
    for image, t in zip(synthesizer.synthesize(frame_pair, times), times, strict=True):
        yield InterpolatedImage(image, measure_agreement(frame_pair, t))


class Calibration:
    """Errors of the pixels of frames by their confidence; every frame counts the same."""

    def __init__(self) -> None:
        # share of the frames, absolute error and squared error in each class
        self.sums = np.zeros((3, len(STEPS) - 1))

    def add(self, truth: Image, image: Image, confidence: NDArray[Any]) -> None:
        """Add a frame."""
        difference = image.astype(np.float32) - truth
        place = np.clip(np.digitize(confidence, STEPS) - 1, 0, len(STEPS) - 2).ravel()
        weights = np.ones(place.size), np.abs(difference).mean(axis=-1), (difference**2).mean(axis=-1)
        self.sums += [np.bincount(place, weight.ravel(), len(STEPS) - 1) / place.size for weight in weights]

    @property
    def shares(self) -> NDArray[Any]:
        """Share of the pixels in each class."""
        shares: NDArray[Any] = self.sums[0] / self.sums[0].sum()
        return shares

    @property
    def errors(self) -> NDArray[Any]:
        """Mean absolute and mean squared error in each class, (2, 10); NaN where there are no pixels."""
        with np.errstate(invalid="ignore"):
            errors: NDArray[Any] = self.sums[1:] / self.sums[0]
        return errors


def calibrate(clips: Iterable[str], names: Iterable[str], frames: int) -> dict[str, Calibration]:
    """Make the hidden frames of clips by each method, and sum up their errors by confidence."""
    found = {name: Calibration() for name in names}
    for name, path in find_clips(clips).items():
        clip = read_clip(name, path, frames)
        for method, calibration in found.items():
            kept: dict[int, NDArray[Any]] = {}
            synthesizer = KeepingConfidence(methods[method].synthesizer, kept)
            made = make_hidden(ComparedInterpolator(replace(methods[method], synthesizer=synthesizer)), clip)
            unknown = np.zeros(made.images[0].shape[:2], np.float32)  # nothing is fused across a cut
            for index in clip.scored:
                confidence = kept.get(clip.intervals[index].shown0.position.number, unknown)
                calibration.add(clip.hidden[index], made.images[index], confidence)
    return found


def calibration_table(title: str, found: Mapping[str, Calibration]) -> Table:
    """Return a table of shares and errors by confidence."""
    table = Table("from ... on", "", *(f"{low:.1f}" for low in STEPS[:-1]), title=title)
    for name, calibration in found.items():
        absolute, squared = calibration.errors
        table.add_row(name, "pixels, %", *(f"{share * 100:.1f}" for share in calibration.shares))
        table.add_row("", "MAE", *(f"{error:.1f}" for error in absolute))
        table.add_row("", "MSE", *(f"{error:.0f}" for error in squared))
    return table


def draw_calibration(path: Path, found: Mapping[str, Calibration]) -> None:
    """Draw the mean absolute and the root mean square (RMS) error against confidence, as an SVG."""
    centres = (STEPS[:-1] + STEPS[1:]) / 2
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "fpsboost", "font.family": "sans-serif"}):
        figure = Figure(figsize=(8, 3.2), layout="constrained")
        panels = figure.subplots(1, 2, sharex=True)
        labels = "mean absolute error, levels", "RMS error, levels"
        for axes, label, which in zip(panels, labels, (0, 1), strict=True):
            for name, colour in DRAWN.items():
                errors = found[name].errors[which]
                axes.plot(centres, errors if which == 0 else np.sqrt(errors), color=colour, marker="o", markersize=3,
                          linewidth=1, label=name)  # fmt: skip
            axes.axvline(0.5, color="#bbbbbb", linewidth=1, linestyle="--")
            axes.set(xlabel="confidence", ylabel=label, xlim=(0, 1), ylim=(0, None))
            axes.spines[["top", "right"]].set_visible(False)
        panels[0].legend(frameon=False)
        figure.savefig(path, metadata={"Date": None, "Creator": None})


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "clips",
        nargs="*",
        default=[str(SAMPLE.parent / "scenes")],
        help="videos, folders of images, or of such folders",
    )
    parser.add_argument("--methods", default=METHODS, help="with commas between them")
    parser.add_argument("--frames", type=int, default=12, help="hidden frames of each clip, at most")
    parser.add_argument("--figure", type=Path, help="an SVG to draw")
    arguments = parser.parse_args()
    one_thread()
    found = calibrate(arguments.clips, arguments.methods.split(","), arguments.frames)
    wide_console().print(calibration_table("Error by confidence", found))
    if arguments.figure:
        draw_calibration(arguments.figure, found)


if __name__ == "__main__":
    main()
