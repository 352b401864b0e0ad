"""Conversion of any source of frames to arrays: as a stream, or of a whole clip."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, count, cycle, islice, takewhile
from typing import Any, Literal, overload

import cv2
import numpy as np

from fpsboost.analysis.duplicates import detector_of
from fpsboost.colour import with_red_and_blue_swapped
from fpsboost.conflicts import check_together
from fpsboost.contracts import Entry, OutputRange, Summary
from fpsboost.edits import LOOP_CONTEXT
from fpsboost.errors import InputError, OptionError
from fpsboost.guides import guides_of
from fpsboost.image import Image
from fpsboost.image_checks import check_image
from fpsboost.interpolator import Interpolator
from fpsboost.io import DescribedSource
from fpsboost.io.opening import ASSUMED_IMAGE_RATE, TargetRequirements, open_source
from fpsboost.io.video.capture import ArraySource, captured, rate_of
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.memory import BYTES_PER_PIXEL, MemoryLimit
from fpsboost.method_table import BYTES_PER_PIXEL_OF, find_method
from fpsboost.options import Duplicates, PathName, PositiveInt, Rate, checked
from fpsboost.run_options import Progress
from fpsboost.streaming import interpolate_frames
from fpsboost.timeline import TimelineOptions
from fpsboost.timing.options import Factor, OutputRate, Timing
from fpsboost.timing.schedule import parse_rate


@checked
def stream(
    source: PathName | cv2.VideoCapture | Iterable[Image],
    *,
    factor: Rate | None = None,
    fps: Rate | None = None,
    retime: PathName | None = None,
    method: str | Interpolator = "nlm",
    input_fps: Rate | None = None,
    duplicates: Duplicates = "interpolate",
    threads: PositiveInt | None = None,
    guide: Iterable[Image] | None = None,
) -> Iterator[Image]:
    """Raise the frame rate of a source of frames, and yield frames as they are made.

    At most ``8 + 2 * threads`` frames are read ahead of the one that is yielded, and up to 8 more where there are
    duplicates; memory does not grow with length. n frames give n times `factor` frames: the last one is shown as long
    as any other.

    Parameters
    ----------
    source : str, os.PathLike, cv2.VideoCapture or iterable of (H, W, C) uint8, uint16 or float32
        A path as `fpsboost.convert` takes it; an open capture of a file, a camera, a pipeline or a network stream,
        which the caller keeps; or arrays in BGR(A) order, which must not be written to afterwards. White is 1 in
        float32, and light may be brighter.
    factor : Fraction, int, float or str, optional
        Output frames per source frame; 2 if neither `factor` nor `fps` is given.
    fps : Fraction, int, float or str, optional
        Output frames per second, instead of `factor`.
    retime : str or os.PathLike, optional
        Which time of the source each output time shows, as in `fpsboost.convert`; the source cannot play backwards.
    method : str or Interpolator
        A name from `fpsboost.methods`, or an object.
    input_fps : Fraction, int, float or str, optional
        Frames per second of images and arrays, and of a capture without a rate.
    duplicates : {'interpolate', 'keep'}
        Whether frames that repeat the one before are replaced by interpolated ones, or kept.
    threads : int, optional
        Pairs of frames processed in parallel; one per core by default. Frames are the same with any number.
    guide : iterable of (h, w, C) uint8, uint16 or float32, optional
        Cheap picture of every output frame, in order, which shows where everything is.

    Yields
    ------
    (H, W, C) uint8, uint16 or float32
        BGR or BGRA, like the source.

    Raises
    ------
    OptionError
        Options contradict each other, `fps` is given for a source whose own rate is not known, or float arrays are
        surely on another scale: from -1 to 1, or whole numbers; the first one that is not of one value decides. Where
        they have NaN, or are probably 8-bit levels, a `UserWarning` says so.
    InputError
        The source gives fewer than two frames, or frames that differ in size or type.

    Examples
    --------
    >>> import numpy as np
    >>> frames = [np.full((32, 48, 3), level, np.uint8) for level in (0, 40, 80)]
    >>> [int(frame.mean()) for frame in stream(frames, method="blend")]
    [0, 20, 40, 60, 80, 80]
    >>> small = [np.full((16, 24, 3), level, np.uint8) for level in (0, 20, 40, 60, 80, 80)]
    >>> len(list(stream(frames, method="blend", guide=small)))
    6
    """
    interpolator = find_method(method)
    timing = Timing(factor, fps, retime=retime)
    decoding = DecodeOptions(input_fps=input_fps)
    limit = MemoryLimit(bytes_per_pixel=BYTES_PER_PIXEL_OF.get(type(interpolator.estimator), BYTES_PER_PIXEL))
    linear = interpolator.takes_layers
    if guide is not None:
        check_together(interpolator.names_given() | {"guide"})
    with _as_source(source, decoding, limit, linear=linear, needs_rate=fps is not None) as opened:
        curve = timing.time_map(opened.info)
        if curve is not None and curve.reverses:
            raise OptionError("retime plays a stream of frames backwards, which is read only once; use convert.")
        schedule = timing.schedule(opened.info, curve=curve)
        options = TimelineOptions(duplicates=detector_of(duplicates), guides=guides_of(guide))
        with interpolate_frames(opened, interpolator, schedule, Summary(), options=options, threads=threads) as frames:
            for frame in frames:
                yield frame.array


def _as_source(
    source: PathName | cv2.VideoCapture | Iterable[Image],
    decoding: DecodeOptions,
    limit: MemoryLimit,
    *,
    linear: bool,
    needs_rate: bool,
) -> DescribedSource:
    if isinstance(source, str | os.PathLike):
        requirements = TargetRequirements(linear=linear)
        return open_source(os.fspath(source), requirements=requirements, decoding=decoding, limit=limit)
    rate = None if decoding.input_fps is None else Fraction(decoding.input_fps)
    if isinstance(source, cv2.VideoCapture):
        images = captured(source)
        rate = rate or rate_of(source)
    else:
        images = iter(source)
    if rate is None and needs_rate:
        raise OptionError("fps needs the source's own frame rate; say it with input_fps, or give factor instead.")
    return ArraySource(images, rate or ASSUMED_IMAGE_RATE)


@overload
def interpolate_clip(
    frames: Iterator[Any],
    fps: Rate,
    to_fps: Rate | None = ...,
    factor: Rate | None = ...,
    loop: bool = ...,
    method: str | Interpolator = ...,
    *,
    order: Literal["rgb", "bgr"] = ...,
    layout: Literal["nhwc", "nchw"] = ...,
    duplicates: Duplicates = ...,
    threads: int | None = ...,
    guides: Any = ...,
    progress: Progress | None = ...,
) -> Iterator[tuple[Image, Fraction]]: ...
@overload
def interpolate_clip(
    frames: Any,
    fps: Rate,
    to_fps: Rate | None = ...,
    factor: Rate | None = ...,
    loop: bool = ...,
    method: str | Interpolator = ...,
    *,
    order: Literal["rgb", "bgr"] = ...,
    layout: Literal["nhwc", "nchw"] = ...,
    duplicates: Duplicates = ...,
    threads: int | None = ...,
    guides: Any = ...,
    progress: Progress | None = ...,
) -> tuple[Image, list[Fraction]]: ...
@checked
def interpolate_clip(
    frames: Any,
    fps: OutputRate,
    to_fps: OutputRate | None = None,
    factor: Factor | None = None,
    loop: bool = False,
    method: str | Interpolator = "nlm",
    *,
    order: Literal["rgb", "bgr"] = "rgb",
    layout: Literal["nhwc", "nchw"] = "nhwc",
    duplicates: Duplicates = "interpolate",
    threads: PositiveInt | None = None,
    guides: Any = None,
    progress: Progress | None = None,
) -> Any:
    """Raise the frame rate of a whole clip of arrays, such as one that a program has generated.

    The frames are those of `fpsboost.stream`, to the bit: scene cuts and repeated frames are treated as in a
    conversion, and n frames give n times the factor, rounded up: the last one is shown as long as any other.

    Parameters
    ----------
    frames : array-like, sequence or iterator
        Frames of uint8, uint16, or float32 from 0 to 1, with 1 to 4 channels: one array (N, H, W, C), of NumPy or
        anything else with DLPack or NumPy's array protocol, such as a tensor of PyTorch on the CPU; a list of images,
        such as PIL's; or an iterator of images, which is read as frames are made. Arrays must not be written to while
        they are used.
    fps : Fraction, int, float or str
        Frames per second of the clip.
    to_fps : Fraction, int, float or str, optional
        Output frames per second.
    factor : Fraction, int, float or str, optional
        Output frames per frame, instead of `to_fps`; 2 if neither is given.
    loop : bool
        The last frame leads to the first one again, and the frames between these two are made, too. Every frame has
        the same place in the loop whichever frame comes first, if n times the factor is a whole number; otherwise the
        last step is shorter. What comes before the first frame of an iterator is not known when it is read: frames of
        its first interval may differ slightly from those of a whole clip, and a picture that is repeated across the
        seam is not found.
    method : str or Interpolator
        A name from `fpsboost.methods`, or an object.
    order : {'rgb', 'bgr'}
        Order of the colours in `frames` and in the result; alpha is last in both.
    layout : {'nhwc', 'nchw'}
        Axes of `frames` and of the result; each image of a list or an iterator lacks the first one.
    duplicates : {'interpolate', 'keep'}
        Whether frames that repeat the one before are replaced by interpolated ones, or kept.
    threads : int, optional
        Pairs of frames processed in parallel; one per core by default. Frames are the same with any number.
    guides : array-like, sequence or iterator, optional
        Cheap pictures of all output frames, like `frames`, and at most as large; see `fpsboost.stream`. Not of a loop.
    progress : callable, optional
        Called after each frame with the number of frames that are done, and the number of all, which is None for an
        iterator.

    Returns
    -------
    frames : (M, H, W, C) or (M, C, H, W) ndarray
        The output frames, in the layout, order and type of the clip.
    times : list of Fraction
        Their presentation times, seconds from the first frame.

    For an iterator, an iterator over pairs of a frame and its time instead; memory does not grow with its length.

    Raises
    ------
    OptionError
        `to_fps` and `factor` are both given, an argument is out of range, or float frames are surely on another scale:
        from -1 to 1, or whole numbers; the first one that is not of one value decides. Where they have NaN, or are
        probably 8-bit levels, a `UserWarning` says so.
    InputError
        `frames` has fewer than two frames (of a loop, none), frames that are no images or that differ in size or type,
        or a tensor that is not in the computer's own memory.

    Examples
    --------
    >>> import numpy as np
    >>> clip = np.stack([np.full((32, 48, 3), level, np.uint8) for level in (0, 40, 80)])
    >>> frames, times = interpolate_clip(clip, fps=16, factor=2, method="blend")
    >>> frames.shape, [str(time) for time in times]
    ((6, 32, 48, 3), ['0', '1/32', '1/16', '3/32', '1/8', '5/32'])
    >>> frames, times = interpolate_clip(clip, fps=16, factor=2, loop=True, method="blend")
    >>> [int(frame.mean()) for frame in frames]
    [0, 20, 40, 60, 80, 40]
    """
    rate = parse_rate(str(fps), "`fps`")
    target = rate * Timing(factor).multiple if to_fps is None else parse_rate(str(to_fps), "`to_fps`")
    given = {"to_fps": to_fps, "factor": factor, "guide": guides, "loop": loop or None}
    check_together({name for name, value in given.items() if value is not None})
    if min(rate, target) <= 0:
        raise OptionError("`fps` and `to_fps` must be above 0.")
    pixels = _Pixels(order, layout)
    clip = _as_images(frames)
    cheap = None if guides is None else map(pixels.read, _as_images(guides))
    before = list[Image]()
    total = None
    if not isinstance(clip, Iterator):
        if len(clip) == 0:
            raise InputError("`frames` gives no frame; give at least two.")
        total = math.ceil(len(clip) * target / rate)
        if loop:
            before = [pixels.read(clip[number % len(clip)]) for number in range(-LOOP_CONTEXT, 0)]
    made = _clip_frames(
        clip,
        pixels,
        before,
        total,
        rate,
        target,
        find_method(method),
        loop=loop,
        options=TimelineOptions(duplicates=detector_of(duplicates), guides=guides_of(cheap)),
        threads=threads,
        progress=progress,
    )
    if total is None:
        return made
    like = pixels.write(pixels.read(next(iter(clip))))
    frames = np.fromiter((image for image, _ in made), (like.dtype, like.shape), total)
    return frames, [number / target for number in range(total)]


@dataclass(frozen=True)
class _Pixels:
    """How a clip holds its pixels, which are (H, W, C) and BGR here."""

    order: str
    layout: str

    def read(self, frame: Any) -> Image:
        """Return a frame of the clip as an image; raises `InputError` if it is none."""
        array = _as_array(frame)
        image = np.moveaxis(array, 0, -1) if self.layout == "nchw" and array.ndim == 3 else array
        check_image(image, f"Each of `frames`, read as `layout={self.layout}`,")
        return self._swapped(image)

    def write(self, image: Image) -> Image:
        """Return an image as a frame of the clip."""
        frame = self._swapped(image)
        return np.ascontiguousarray(np.moveaxis(frame, -1, 0)) if self.layout == "nchw" else frame

    def _swapped(self, image: Image) -> Image:
        return with_red_and_blue_swapped(image) if self.order == "rgb" else image


def _as_images(frames: Any) -> Any:
    """Return what `interpolate_clip` takes as a sequence or an iterator of frames."""
    return frames if isinstance(frames, Iterator | list | tuple) else np.atleast_1d(_as_array(frames))


def _as_array(frames: Any) -> Image:
    """Return an array or a tensor of any library as one of NumPy, which shares its memory where it can."""
    if isinstance(frames, str | os.PathLike):
        raise InputError(f"`frames` are arrays, not the file {frames}; give it to fpsboost.stream or fpsboost.convert.")
    mode = getattr(frames, "mode", "RGB")  # of an image of PIL; of a tensor, a method
    if isinstance(mode, str) and mode not in ("RGB", "RGBA", "LA"):
        cure = f"image.convert({'RGBA' if mode in ('P', 'PA', 'La', 'RGBa') else 'RGB'!r})"
        if mode.startswith(("I", "F")):  # which Pillow would cut off at 255
            cure = "its values as an array of uint16 or float32"
        raise InputError(f"`frames` has an image of PIL in mode {mode}; give {cure} instead.")
    try:
        is_numpy = isinstance(frames, np.ndarray) or not hasattr(frames, "__dlpack__")
        return np.asarray(frames) if is_numpy else np.from_dlpack(frames)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(
            "`frames` cannot be read as an array; of a tensor, give `frames.detach().float().cpu()`."
        ) from error


def _clip_frames(
    clip: Iterable[Any],
    pixels: _Pixels,
    before: Sequence[Image],
    total: int | None,
    rate: Fraction,
    target: Fraction,
    interpolator: Interpolator,
    *,
    loop: bool,
    options: TimelineOptions,
    threads: int | None,
    progress: Progress | None,
) -> Iterator[tuple[Image, Fraction]]:
    """Yield the output frames of a clip with their times; see `interpolate_clip`.

    Of a loop, `before` are its last images, if they are known. `total` is the number of output frames, or None.
    """
    images = map(pixels.read, clip)
    start = len(before) / rate
    ends = list[Fraction]()
    source = ArraySource(chain(before, _continued(images, rate, ends)) if loop else images, rate, "`frames`")
    with interpolate_frames(
        source,
        interpolator,
        Timing(fps=target).schedule(source.info),
        Summary(),
        options=options,
        threads=threads,
        outputs=OutputRange(stop=total, entry=Entry(-len(before), start, math.ceil(-start * target))),
    ) as frames:
        for done, frame in enumerate(takewhile(lambda each: not ends or each.time < start + ends[0], frames), 1):
            if progress is not None:
                progress(done, total)
            yield pixels.write(frame.array), frame.time - start


def _continued(images: Iterator[Image], rate: Fraction, ends: list[Fraction]) -> Iterator[Image]:
    """Yield the images of a loop, and then its first ones again; before these, append the time when a round ends."""
    first = list(islice(images, LOOP_CONTEXT))
    numbers = count()
    yield from (image for image, _ in zip(chain(first, images), numbers, strict=False))
    ends.append(next(numbers) / rate)  # of the image after the last one
    yield from islice(cycle(first), LOOP_CONTEXT)
