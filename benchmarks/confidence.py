"""Does the confidence of a method know where the method errs, and by how much?

``python benchmarks/confidence.py CLIPS`` prints the mean error of pixels by their confidence; without clips, on the
project's own scenes, of which ``--figure FILE`` draws a figure for the documentation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table
from scoring import find_clips, make_hidden, one_thread, read_clip, wide_console

from fpsboost import methods
from fpsboost.image import Image

METHODS = "nlm,nlm-fast,dis,dis-warp,nlm-exhaustive,block,blend"
"""The first three fuse hypotheses; of the others, confidence is the agreement of both frames."""

DRAWN = {"nlm": "#2f6f9f", "dis-warp": "#b5532a", "nlm-exhaustive": "#6a8f3a", "blend": "#777777"}
"""Methods of the figure, and their colours."""

STEPS = np.linspace(0, 1, 11)
"""Edges of the classes of confidence."""

SCENES = Path(__file__).parent.parent / "samples" / "scenes"


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
            made = make_hidden(methods[method], clip, confidence=True)
            for index in clip.scored:
                calibration.add(clip.hidden[index], made.images[index], made.confidences[index])
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
    parser.add_argument("clips", nargs="*", default=[str(SCENES)], help="videos, folders of images, or of such folders")
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
