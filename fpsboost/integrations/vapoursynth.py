"""VapourSynth filter: a clip at a higher frame rate, whose frames are made on request, in any order.

The host calls a function of Python from one thread at a time for each filter, so that a single filter would leave all
other threads idle. `interpolate` returns a ``FrameEval`` that gives every output frame a filter of its own (a
``ModifyFrame`` over the source frames that this one needs), and these run side by side: kernels do not hold Python's
lock. What is found out about a pair of frames is kept for the frames that follow, in a cache of bounded size; threads
that ask for it while another one computes it wait for that one.

A frame depends on its pair and the pairs before and after alone, which is what the host is asked for. So frames are
those of a conversion of the same frames with ``duplicates='keep'``, bit by bit, in whichever order they are asked for.
Duplicates are kept: which frames a conversion groups may depend on all frames before them, and in a script, frame n of
the source is expected to come out unchanged. Remove duplicates before, as with ``vivtc.VDecimate``.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from threading import Lock
from typing import Annotated
from weakref import WeakValueDictionary

import numpy as np
import vapoursynth as vs

from fpsboost import (
    ByFactor,
    ByRate,
    Checked,
    Coding,
    CutDetector,
    FpsboostError,
    FrameCache,
    FrameImage,
    InputError,
    Interpolator,
    OptionError,
    Pair,
    Range,
    SourcePosition,
    YCbCrImage,
    find_method,
)
from fpsboost.extension import VideoTraits, coding_of, in_coding, option, view

MAX_FRAMES = 2**31 - 1
"""Maximum number of frames of a clip; the host counts in 32 bits."""

CHROMA_LOCATIONS = ("left", "center", "topleft", "top", "bottomleft", "bottom")
"""Chroma locations by their number in ``_ChromaLocation``."""

Frames = Mapping[int, vs.VideoFrame]
"""Frames of the host by their numbers in the source."""


def interpolate(
    clip: vs.VideoNode,
    factor_num: int | None = None,
    factor_den: int | None = None,
    fps_num: int | None = None,
    fps_den: int | None = None,
    method: str | Interpolator = "nlm",
    sc: bool = True,
) -> vs.VideoNode:
    """Raise the frame rate of a clip; docs/vapoursynth.md has examples, and the properties of the frames.

    n frames become n times the factor, rounded up: the last one is shown as long as any other. Frames that fall on a
    frame of the source are that frame with its planes; see the module on all others.

    Parameters
    ----------
    clip : vapoursynth.VideoNode
        YUV 4:2:0, 4:2:2 or 4:4:4 of 8, 9, 10, 12, 14 or 16 bits, RGB of 8 to 16 bits, or RGBS; of constant size and
        format. Colour is read from ``_Matrix``, ``_Range`` (or ``_ColorRange``) and ``_ChromaLocation``;
        without them it is that of untagged video: limited range, BT.709 from 720 rows on and BT.601 below, left.
    factor_num, factor_den : int, optional
        Output frames per source frame, as a fraction; 2 by default, and `factor_den` is 1 by default.
    fps_num, fps_den : int, optional
        Output frames per second, as a fraction, instead of the factor; `fps_den` is 1 by default.
    method : str or Interpolator
        A name as `fpsboost.find_method` takes it, with options: ``nlm:fusion=plain``; or an object.
    sc : bool
        Whether scenes end: where ``_SceneChangeNext`` of a frame or ``_SceneChangePrev`` of the next one is set, and,
        between frames that have neither, where the method's own policy finds a cut. False follows motion between any
        two frames.

    Raises
    ------
    vapoursynth.Error
        An option is out of range, or the clip cannot be taken, with a sentence on how to correct it.
    """
    with _host_errors():
        interpolator = find_method(method)
        _check_clip(clip)
        if sc not in (True, False):
            raise OptionError(f"`sc` must be True or False, not {sc!r}.")
        factor = _Rate(factor_num, factor_den, fps_num, fps_den).factor_for(clip)
        interpolator = replace(interpolator, cuts=interpolator.cuts if sc else None)
        outputs = _OutputFrames(clip, interpolator, factor, finds_cuts=sc)
    count = math.ceil(clip.num_frames * factor)
    rate = clip.fps * factor
    output = vs.core.std.BlankClip(clip, length=count, fpsnum=rate.numerator, fpsden=rate.denominator, keep=True)
    return vs.core.std.FrameEval(output, partial(outputs.node, output[0]), clip_src=[clip])


@contextmanager
def _host_errors() -> Iterator[None]:
    """Turn the library's errors into errors of the host."""
    try:
        yield
    except FpsboostError as error:
        raise vs.Error(f"fpsboost: {error}") from error


def _check_clip(clip: vs.VideoNode) -> None:
    """Raise `InputError` unless frames can be made of a clip."""
    if not isinstance(clip, vs.VideoNode):
        raise InputError(f"A clip must be a video node of VapourSynth, not {type(clip).__name__}.")
    if not clip.format.id or not clip.width:
        raise InputError(
            "The clip changes its format or its size on the way; make its frames alike with "
            "resize.Bicubic(format=..., width=..., height=...) first."
        )
    _layout_of(clip.format)
    if clip.num_frames < 2:
        raise InputError("The clip has one frame; interpolation needs at least two.")


@dataclass(frozen=True)
class _Rate(Checked):
    """Frame rate of the output, in the fractions of `interpolate`."""

    factor_num: int | None = option(None, "Numerator of the factor; else 2.")
    factor_den: Annotated[int, Range(1)] | None = option(None, "Denominator of the factor; else 1.")
    fps_num: int | None = option(None, "Numerator of the frames per second.")
    fps_den: Annotated[int, Range(1)] | None = option(None, "Denominator of the frames per second; else 1.")

    def factor_for(self, clip: vs.VideoNode) -> Fraction:
        """Return the number of output frames per frame of a clip."""
        if self.fps_num is None:
            factor = ByFactor(Fraction(2 if self.factor_num is None else self.factor_num, self.factor_den or 1)).factor
        else:
            rate = ByRate(Fraction(self.fps_num, self.fps_den or 1)).frames_per_second
            if not clip.fps:
                raise OptionError(
                    "`fps_num` needs the clip's own frame rate; set it with std.AssumeFPS, or give `factor_num` "
                    "instead."
                )
            factor = ByFactor(rate / clip.fps).factor
        if clip.num_frames * factor > MAX_FRAMES:
            raise OptionError(
                f"`factor={factor}` makes more frames of the clip than VapourSynth counts; choose a smaller one, or "
                "shorten the clip with std.Trim."
            )
        return factor


def _layout_of(format: vs.VideoFormat) -> _Rgb | _Ycc:
    """Return the layout of a format; raise `InputError` if it is not supported."""
    bits = format.bits_per_sample
    is_float = format.sample_type == vs.FLOAT
    chroma = {(1, 1): "420", (1, 0): "422", (0, 0): "444"}.get((format.subsampling_w, format.subsampling_h))
    name = f"yuv{chroma}p" + ("" if bits == 8 else f"{bits}le")
    if format.color_family == vs.RGB and (bits == 32 if is_float else bits <= 16):
        return _Rgb(bits)
    if format.color_family == vs.YUV and coding_of(VideoTraits(name)) is not None and not is_float:
        return _Ycc(name)
    raise InputError(
        f"The clip is {format.name}; convert it with resize.Bicubic(format=...) to YUV 4:2:0, 4:2:2 or 4:4:4 of 8, 9, "
        "10, 12, 14 or 16 bits, RGB of 8 to 16 bits, or RGBS first."
    )


@dataclass(frozen=True)
class _Rgb:
    """RGB as BGR arrays; integers that fill no type are scaled to 16 bits, and rounded back, which gives them again."""

    bits: int

    def image(self, frame: vs.VideoFrame) -> np.ndarray:
        image = np.stack([np.asarray(frame[plane]) for plane in (2, 1, 0)], axis=-1)
        return image if self.bits in (8, 16, 32) else _scaled(image, (1 << self.bits) - 1, 65535)

    def planes(self, image: FrameImage, like: vs.VideoFrame) -> Sequence[np.ndarray]:
        """Return the planes that an image has in a frame of the host, coded like another frame."""
        values = view(image).array()
        values = values if self.bits in (8, 16, 32) else _scaled(values, 65535, (1 << self.bits) - 1)
        return [values[..., channel] for channel in (2, 1, 0)]


def _scaled(values: np.ndarray, top: int, new_top: int) -> np.ndarray:
    return ((values.astype(np.uint32) * new_top + top // 2) // top).astype(np.uint16)


@dataclass(frozen=True)
class _Ycc:
    """YUV as images in planes, with the methods of `_Rgb`."""

    pixel_format: str

    def image(self, frame: vs.VideoFrame) -> YCbCrImage:
        y, cb, cr = (np.array(frame[plane]) for plane in range(3))
        return YCbCrImage((y, cb, cr), self._coding(frame))

    def planes(self, image: FrameImage, like: vs.VideoFrame) -> Sequence[np.ndarray]:
        return view(in_coding(view(image).picture, self._coding(like))).arrays()

    def _coding(self, frame: vs.VideoFrame) -> Coding:
        props = frame.props
        matrix = int(props.get("_Matrix", vs.MATRIX_UNSPECIFIED))
        if matrix in (0, 2, 3):  # they name no matrix of luma and chroma
            matrix = vs.MATRIX_BT709 if frame.height >= 720 else vs.MATRIX_ST170_M
        # before release 73, the numbers of the range were the other way round and had another name
        full_range = props["_Range"] == 1 if "_Range" in props else props.get("_ColorRange") == 0
        location = CHROMA_LOCATIONS[int(props.get("_ChromaLocation", 0))]
        traits = VideoTraits(self.pixel_format, int(matrix), full_range=full_range, chroma_location=location)
        coding = coding_of(traits)
        if coding is None:
            raise InputError(
                f"The clip uses the colour matrix number {matrix}, which is not supported; convert it to BT.709 or "
                "BT.2020 first."
            )
        return coding


class _OutputFrames:
    """Output frames of a clip by their numbers, and the pairs of consecutive frames between which they lie.

    Of these, all that are in use by some thread are kept, and as many of those that were asked for last as it takes.
    """

    def __init__(self, clip: vs.VideoNode, interpolator: Interpolator, factor: Fraction, *, finds_cuts: bool) -> None:
        self._clip = clip
        self._interpolator = interpolator
        self._factor = factor
        self._finds_cuts = finds_cuts
        self._layout = _layout_of(clip.format)
        self._last = int(clip.num_frames) - 1
        # frames that are made at once lie in so many pairs, each needs those beside its own, and threads lag
        self._recent: deque[Pair] = deque(maxlen=math.ceil(vs.core.num_threads / factor) + 4)
        self._lock = Lock()
        self._pairs: WeakValueDictionary[int, Pair] = WeakValueDictionary()
        self._images: WeakValueDictionary[int, FrameCache] = WeakValueDictionary()

    def node(self, like: vs.VideoNode, n: int) -> vs.VideoNode:
        """Return a clip of one frame, output frame `n`, for `FrameEval`; `like` has its format."""
        numbers = self._needed(n)
        return like.std.ModifyFrame([self._clip[each] for each in numbers], partial(self._frame, n, numbers))

    def _frame(
        self, number: int, numbers: Sequence[int], n: int, f: vs.VideoFrame | list[vs.VideoFrame]
    ) -> vs.VideoFrame:
        """Return an output frame, for `ModifyFrame`, which gives the frames of `numbers` as `f`."""
        frames = dict(zip(numbers, f if isinstance(f, list) else [f], strict=True))
        index, t = self._position(number)
        output_frame = frames[index].copy()
        with _host_errors():
            if self._is_between(number):
                pair = self._pair(index, frames)  # in use, so that it is kept
                ((image, _),) = self._interpolator.images(pair.between(*self._neighbours(index, frames)), [t])
                for plane, values in enumerate(self._layout.planes(image, output_frame)):
                    np.asarray(output_frame[plane])[:] = values
            self._set_scene_changes(number, output_frame, frames)
        self._set_times(number, output_frame, frames)
        return output_frame

    def _position(self, number: int) -> tuple[int, Fraction]:
        """Return the source frame at or before an output frame, and t between it and the next one."""
        index, t = divmod(number / self._factor, 1)
        return int(index), t

    def _is_between(self, number: int) -> bool:
        index, t = self._position(number)
        return t > 0 and index < self._last

    def _needed(self, number: int) -> range:
        index, _ = self._position(number)
        pairs = [index] if self._is_between(number) else []
        if self._finds_cuts:
            pairs += [pair for side in self._pairs_beside(number) for pair in side]
        first = min([index, *(pair - 1 for pair in pairs)])
        last = max([index, *(pair + 2 for pair in pairs), *([] if self._clip.fps else self._shares(number))])
        return range(max(first, 0), min(last, self._last) + 1)

    def _neighbours(self, index: int, frames: Frames) -> tuple[Pair | None, Pair | None]:
        """Return the pairs before and after another one, where there are any."""
        before = self._pair(index - 1, frames) if index > 0 else None
        return before, self._pair(index + 1, frames) if index + 1 < self._last else None

    def _pair(self, number: int, frames: Frames) -> Pair:
        """Return a pair by the number of its first frame, made of two of the frames unless it exists."""
        with self._lock:
            pair = self._pairs.get(number)
            if pair is None:
                image0, image1 = (self._image(each, frames[each]) for each in (number, number + 1))
                interpolator = self._interpolator_of(frames[number], frames[number + 1])
                pair = self._pairs[number] = interpolator.pair(image0, image1)
            if pair in self._recent:
                self._recent.remove(pair)
            self._recent.append(pair)
        return pair

    def _image(self, number: int, frame: vs.VideoFrame) -> FrameCache:
        """Return a frame as an image, the same one for both of its pairs."""
        image = self._images.get(number)
        if image is None:
            stored = self._layout.image(frame)
            pixels = stored if self._interpolator.takes_planes else view(stored).to_bgr()
            place = SourcePosition(number, number / (self._clip.fps or Fraction(1)))
            image = self._images[number] = FrameCache(pixels, number * self._factor, place)
        return image

    def _interpolator_of(self, frame0: vs.VideoFrame, frame1: vs.VideoFrame) -> Interpolator:
        """Return the interpolator of a pair, which goes by the properties about cuts where there are any."""
        marks = [frame0.props.get("_SceneChangeNext"), frame1.props.get("_SceneChangePrev")]
        if not self._finds_cuts or marks == [None, None]:
            return self._interpolator
        return replace(self._interpolator, cuts=CutDetector(threshold=1) if any(marks) else None)

    def _pairs_beside(self, number: int) -> tuple[range, range]:
        """Return the pairs in whose middle a cut would lie between an output frame and the one before, and the next."""
        before, here, after = ((number + step) / self._factor - Fraction(1, 2) for step in (-1, 0, 1))
        first, middle, stop = (min(max(math.ceil(each), 0), self._last) for each in (before, here, after))
        return range(first, middle), range(middle, stop)

    def _set_scene_changes(self, number: int, output_frame: vs.VideoFrame, frames: Frames) -> None:
        """Say whether a scene ends between an output frame and the one before, and the next."""
        for name, pairs in zip(("_SceneChangePrev", "_SceneChangeNext"), self._pairs_beside(number), strict=True):
            if self._finds_cuts:
                known = (self._pair(each, frames).between(*self._neighbours(each, frames)) for each in pairs)
                output_frame.props[name] = int(any(pair.is_cut for pair in known))
            elif name in output_frame.props:
                del output_frame.props[name]

    def _shares(self, number: int) -> dict[int, Fraction]:
        """Return the share of each source frame during which an output frame is displayed."""
        begin = number / self._factor
        end = min((number + 1) / self._factor, Fraction(self._last + 1))
        frames = range(math.floor(begin), math.ceil(end))
        return {each: min(Fraction(each + 1), end) - max(Fraction(each), begin) for each in frames}

    def _set_times(self, number: int, output_frame: vs.VideoFrame, frames: Frames) -> None:
        index, t = self._position(number)
        if self._clip.fps:
            lasts = 1 / self._clip.fps
            duration = lasts / self._factor
        else:
            lasts = _duration_of(frames[index])
            shares = self._shares(number)
            duration = sum((_duration_of(frames[each]) * share for each, share in shares.items()), Fraction(0))
        if duration:
            output_frame.props["_DurationNum"], output_frame.props["_DurationDen"] = duration.as_integer_ratio()
        if "_AbsoluteTime" in output_frame.props:
            output_frame.props["_AbsoluteTime"] += float(t * lasts)


def _duration_of(frame: vs.VideoFrame) -> Fraction:
    """Return how long a frame is shown by its properties, seconds; 0 if they have none."""
    return Fraction(frame.props.get("_DurationNum", 0), frame.props.get("_DurationDen") or 1)
