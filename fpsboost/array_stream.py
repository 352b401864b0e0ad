"""Frame-rate conversion to arrays, one by one as they are made, for programs that read and write with OpenCV."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

import cv2

from fpsboost.errors import OptionError
from fpsboost.frame import Image
from fpsboost.interpolator import Interpolator
from fpsboost.io import FrameSource
from fpsboost.io.opening import ASSUMED_IMAGE_RATE, TargetRequirements, open_source
from fpsboost.io.video.capture import ArraySource, captured, rate_of
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.method_table import find_method
from fpsboost.observer import Summary
from fpsboost.streaming import making_frames
from fpsboost.timing.rate import OutputRate


def stream(
    source: str | cv2.VideoCapture | Iterable[Image],
    *,
    factor: Fraction | int | None = None,
    fps: Fraction | int | None = None,
    method: str | Interpolator = "nlm",
    input_fps: Fraction | int | None = None,
    threads: int | None = None,
) -> Iterator[Image]:
    """Raise the frame rate of a source of frames, and yield frames as they are made.

    At most ``8 + 2 * threads`` frames are read ahead of the one that is yielded, and up to 8 more where there are
    duplicates; memory does not grow with length. n frames give n times `factor` frames: the last one is shown as long
    as any other.

    Parameters
    ----------
    source : str, cv2.VideoCapture or iterable of (H, W, C) uint8, uint16 or float32
        A path as `fpsboost.convert` takes it; an open capture of a file, a camera, a pipeline or a network stream,
        which the caller keeps; or arrays in BGR(A) order, which must not be written to afterwards.
    factor : Fraction or int, optional
        Output frames per source frame; 2 if neither `factor` nor `fps` is given.
    fps : Fraction or int, optional
        Output frames per second, instead of `factor`.
    method : str or Interpolator
        A name from `fpsboost.methods`, or an object.
    input_fps : Fraction or int, optional
        Frames per second of images and arrays, and of a capture without a rate.
    threads : int, optional
        Pairs of frames processed in parallel; one per core by default. Frames are the same with any number.

    Yields
    ------
    (H, W, C) uint8, uint16 or float32
        BGR or BGRA, like the source.

    Raises
    ------
    OptionError
        Options contradict each other, or `fps` is given for a source whose own rate is not known.
    InputError
        The source gives fewer than two frames, or frames that differ in size or type.

    Examples
    --------
    >>> import numpy as np
    >>> frames = [np.full((32, 48, 3), level, np.uint8) for level in (0, 40, 80)]
    >>> [int(frame.mean()) for frame in stream(frames, method="blend")]
    [0, 20, 40, 60, 80, 80]
    """
    interpolator = find_method(method) if isinstance(method, str) else method
    rate = OutputRate(_fraction(factor), _fraction(fps))
    requirements = TargetRequirements(linear=interpolator.takes_layers)
    with _as_source(source, _fraction(input_fps), requirements, needs_rate=fps is not None) as opened:
        schedule = rate.schedule(opened.info)
        making = making_frames(
            opened,
            interpolator,
            schedule,
            Summary(),
            holds_last_frame=True,
            threads=threads,
        )
        with making as frames:
            for frame in frames:
                yield frame.array


def _as_source(
    source: str | cv2.VideoCapture | Iterable[Image],
    input_fps: Fraction | None,
    requirements: TargetRequirements,
    *,
    needs_rate: bool,
) -> FrameSource:
    """Return a path, capture or arrays as a frame source."""
    if isinstance(source, str):
        return open_source(source, requirements=requirements, decoding=DecodeOptions(input_fps=input_fps))
    if isinstance(source, cv2.VideoCapture):
        images, rate = captured(source), input_fps or rate_of(source)
    else:
        images, rate = iter(source), input_fps
    if rate is None and needs_rate:
        raise OptionError("fps needs the source's own frame rate; say it with input_fps, or give factor instead.")
    return ArraySource(images, rate or ASSUMED_IMAGE_RATE)


def _fraction(value: Fraction | int | None) -> Fraction | None:
    return None if value is None else Fraction(value)
