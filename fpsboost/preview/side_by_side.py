"""Passages before and after a conversion, beside each other in a video."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import OptionError, OutputError
from fpsboost.frame import ClipInfo, Frame
from fpsboost.io.output import Output
from fpsboost.io.target import Target
from fpsboost.preview.trial import Preview
from fpsboost.preview.views import View
from fpsboost.timing.schedule import OutputTiming

SPEEDS = (Fraction(1), Fraction(1, 4))

LABEL_HEIGHT = 32
"""Height of the line of text above the pictures, pixels."""


def write_video(path: str, shown: Preview, *, overwrite: bool = False) -> None:
    """Write every passage at full and at quarter speed, at the rate of the output, without sound.

    Frames of the source are repeated until the next one is due.

    Parameters
    ----------
    path : str
        A video file.
    shown : Preview
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OptionError
        The path names no video.
    OutputError
        It exists, or cannot be written.
    """
    target = Target.parse(path)
    check_video(target, overwrite=overwrite)
    parts = [(views, speed) for views in shown.views() for speed in SPEEDS]
    counts = [round(views["before"].end * shown.stretch / speed * shown.rate) for views, speed in parts]
    first = _beside(parts[0][0], Fraction(0), "")
    size = ClipInfo(path, first.shape[0], first.shape[1], shown.rate, 1 / shown.rate, sum(counts))
    timing = OutputTiming(shown.rate, 1 / shown.rate)
    number = 0
    with target.open(Output(path, size, timing, expected_frames=sum(counts), overwrite=overwrite)) as sink:
        for (views, speed), count in zip(parts, counts, strict=True):
            label = "" if speed == 1 else f", {speed} of the speed"
            for place in range(count):
                image = _beside(views, place * speed / shown.rate / shown.stretch, label)
                sink.write(Frame(image, number / shown.rate, 1 / shown.rate))
                number += 1


def check_video(target: Target, *, overwrite: bool) -> None:
    """Raise an error if the video cannot be written, before anything is made for it."""
    if target.kind != "video":
        raise OptionError(f"`side_by_side` writes a video, and {target.path} names none; end it with .mp4 or .mkv.")
    if Path(target.path).exists() and not overwrite:
        raise OutputError(f"{target.path} exists; name another file, or replace it with `overwrite`.")


def _beside(views: dict[str, View], time: Fraction, label: str) -> NDArray[Any]:
    """Return what all views show at a time, each under its name."""
    return np.concatenate([_labelled(view.image_at(time), name + label) for name, view in views.items()], axis=1)


def _labelled(image: NDArray[Any], text: str) -> NDArray[Any]:
    """Return a picture under a line of text, as wide as encoders ask for."""
    height, width = (each + each % 2 for each in image.shape[:2])
    canvas = np.zeros((height + LABEL_HEIGHT, width, 3), np.uint8)
    canvas[LABEL_HEIGHT : LABEL_HEIGHT + image.shape[0], : image.shape[1]] = image
    (across, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)
    scale = 0.6 * min(1.0, (width - 16) / max(across, 1))
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas
