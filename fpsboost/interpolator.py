"""A pair of frames and times in, in-between frames out: estimator, synthesizer, and what happens at a scene cut."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from fpsboost.errors import OptionError, check_choice
from fpsboost.frame import Image, check_pair
from fpsboost.lighting import Lighting, find_lighting
from fpsboost.motion import MotionEstimator
from fpsboost.motion.colour import normalised
from fpsboost.motion.exhaustive import ExhaustiveSearch
from fpsboost.motion.field import MotionField
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis, Farneback, Still
from fpsboost.motion.trajectory import Neighbour, find_acceleration
from fpsboost.prepared import PreparedImage
from fpsboost.scenes import CutDetector
from fpsboost.synthesis import Synthesizer, Transition
from fpsboost.synthesis.blend import Blend, Nearest
from fpsboost.synthesis.fuse import Fuse, Fused
from fpsboost.synthesis.overlay import find_overlay, keep_overlay
from fpsboost.synthesis.reproject import Reproject

AtCuts = Literal["repeat", "blend"]


class InBetween(NamedTuple):
    """The frames between two frames, and whether a scene ends there."""

    images: Iterator[Image]
    scene_cut: bool


class Pair:
    """Two frames that follow each other, and what an interpolator finds out about them, once, when it is asked for.

    Parameters
    ----------
    interpolator : Interpolator
    image0, image1 : PreparedImage
        Two frames of one size and type.
    duration : Fraction or float
        Time between them, in any unit that neighbouring pairs share.

    Raises
    ------
    InputError
        The two are no images of one size and type.
    """

    def __init__(
        self,
        interpolator: Interpolator,
        image0: PreparedImage,
        image1: PreparedImage,
        duration: Fraction | float = 1,
    ) -> None:
        check_pair(image0.pixels, image1.pixels)
        self.image0, self.image1, self.duration = image0, image1, duration
        self._interpolator = interpolator

    @cached_property
    def lighting(self) -> Lighting | None:
        """How the light changes from one to the other; None where it does not."""
        return find_lighting(self.image0, self.image1) if self._interpolator.relight else None

    @cached_property
    def in_one_light(self) -> tuple[PreparedImage, PreparedImage]:
        """The two frames, both in the light of the first."""
        if self.lighting is None:
            return self.image0, self.image1
        return PreparedImage(normalised(self.image0.pixels)), PreparedImage(self.lighting.undo(self.image1.pixels))

    @cached_property
    def is_cut(self) -> bool:
        """Whether a scene ends between the two."""
        cuts = self._interpolator.cuts
        return cuts is not None and cuts.is_cut(*self.in_one_light)

    @cached_property
    def fields(self) -> tuple[MotionField, MotionField]:
        """Motion in both directions."""
        fields = self._interpolator.estimator.estimate(*self.in_one_light)
        self.in_one_light[0].forget()  # in a sequence, the pair before has had its motion: saves memory
        return fields

    def settle(self) -> None:
        """Keep only what the next pair asks for: called once its own frames are made, saves memory."""
        self.image0.forget()
        self.__dict__.pop("in_one_light", None)
        if "fields" in self.__dict__:
            field01, field10 = self.fields
            self.__dict__["fields"] = replace(field01, alternatives=()), replace(field10, alternatives=())


@dataclass(frozen=True)
class Interpolator:
    """Makes the frames between two frames.

    Parameters
    ----------
    estimator : MotionEstimator
        Finds the motion, once for each pair.
    synthesizer : Synthesizer
        Makes the image at each time.
    cuts : CutDetector or None
        Finds scene cuts; None takes every pair for one scene.
    at_cuts : {'repeat', 'blend'}
        Across a cut, repeat the nearer frame or mix the two.
    curved : bool
        Follow curved paths where the pairs before and after are known, straight ones otherwise.
    relight : bool
        Where the light changes between two frames, search for motion in the same light.
    overlays : bool
        Leave alone what stands still in front of a moving picture; the pairs before and after must be known.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> (middle,) = methods["blend"].interpolate(noise, noise, [0.5])
    >>> bool((middle == noise).all())
    True
    """

    estimator: MotionEstimator
    synthesizer: Synthesizer
    cuts: CutDetector | None = CutDetector()
    at_cuts: AtCuts = "repeat"
    curved: bool = True
    relight: bool = True
    overlays: bool = True

    def __post_init__(self) -> None:
        check_choice("--at-cuts", self.at_cuts, get_args(AtCuts))

    def interpolate(self, image0: Image, image1: Image, times: Sequence[float | Fraction]) -> list[Image]:
        """Make one image for every time.

        Parameters
        ----------
        image0, image1 : (H, W, C) uint8, uint16 or float32
            Two frames of one size and type.
        times : sequence of float or Fraction
            Each in [0, 1]; 0 gives frame 0 and 1 gives frame 1, unchanged.

        Returns
        -------
        list of (H, W, C), dtype of the frames

        Raises
        ------
        InputError
            The two are no images of one size and type.
        OptionError
            A time lies outside of [0, 1].
        """
        pair = self.pair(PreparedImage(image0), PreparedImage(image1))
        return list(self.between(pair, times).images)

    def pair(self, image0: PreparedImage, image1: PreparedImage, duration: Fraction | float = 1) -> Pair:
        """Two frames as `between` takes them; see `Pair`."""
        return Pair(self, image0, image1, duration)

    def between(
        self,
        pair: Pair,
        times: Sequence[float | Fraction],
        before: Pair | None = None,
        after: Pair | None = None,
    ) -> InBetween:
        """Like `interpolate`, but made one image at a time, with word of a scene cut, and along curved paths.

        Parameters
        ----------
        pair : Pair
        times : sequence of float or Fraction
            Each in [0, 1].
        before, after : Pair, optional
            The pairs that share its first and its last frame. Nothing farther away has a say.

        Returns
        -------
        InBetween

        Raises
        ------
        OptionError
            A time lies outside of [0, 1].
        """
        for t in times:
            if not 0 <= t <= 1:
                raise OptionError(f"A time between two frames must lie in [0, 1], not at {t}.")
        return InBetween(self._images(pair, times, before, after), pair.is_cut)

    def _images(
        self, pair: Pair, times: Sequence[float | Fraction], before: Pair | None, after: Pair | None
    ) -> Iterator[Image]:
        inner = [float(t) for t in times if 0 < t < 1]
        made = self._made(pair, inner, before, after) if inner else iter(())
        for t in times:
            yield next(made) if 0 < t < 1 else (pair.image1 if t == 1 else pair.image0).pixels.copy()

    def _made(self, pair: Pair, times: list[float], before: Pair | None, after: Pair | None) -> Iterator[Image]:
        if pair.is_cut:
            mixer: Synthesizer = Blend() if self.at_cuts == "blend" else Nearest()
            still = Still().estimate(pair.image0, pair.image1)
            return mixer.synthesize(Transition(pair.image0, pair.image1, *still), times)
        before, after = (each if each is not None and not each.is_cut else None for each in (before, after))
        acceleration = None
        if self.curved:
            acceleration = find_acceleration(*pair.fields, _neighbour(before, pair), _neighbour(after, pair))
        images = self.synthesizer.synthesize(Transition(*pair.in_one_light, *pair.fields, acceleration), times)
        if pair.lighting is not None:
            images = _relit(images, times, pair.lighting, pair.image0.pixels.dtype)
        elif self.overlays and (before or after):
            images = _with_overlay(images, times, pair, before or pair, after or pair)
        return images

    def compile_for(self, image: Image) -> None:
        """Compile the kernels for images of this type, or load them from the cache, on a tiny clip.

        Parameters
        ----------
        image : (H, W, C) uint8, uint16 or float32
            Any image of the clip; only its type and channels count.
        """
        # long enough for a pyramid with all kinds of levels
        noise = np.random.default_rng(0).integers(0, 256, (48, 480, image.shape[2])).astype(image.dtype)
        first, second, third = (PreparedImage(noise) for _ in range(3))
        before, pair = self.pair(first, second), self.pair(second, third)
        for _ in self.between(pair, [0.5], before).images:
            pass


def _neighbour(neighbour: Pair | None, pair: Pair) -> Neighbour | None:
    if neighbour is None:
        return None
    return Neighbour(*neighbour.fields, float(neighbour.duration / pair.duration))


def _relit(
    images: Iterator[Image], times: Sequence[float], lighting: Lighting, dtype: np.dtype[Any]
) -> Iterator[Image]:
    for image, t in zip(images, times, strict=True):
        yield lighting.apply(image, t, dtype)


def _with_overlay(
    images: Iterator[Image], times: Sequence[float], pair: Pair, before: Pair, after: Pair
) -> Iterator[Image]:
    overlay = find_overlay(pair.image0, pair.image1, before.image0, after.image1, pair.fields[0])
    for image, t in zip(images, times, strict=True):
        keep_overlay(image, pair.image0.pixels, pair.image1.pixels, t, overlay)
        yield image


methods: Mapping[str, Interpolator] = MappingProxyType(
    {
        "nlm": Interpolator(CoarseToFine(others=(Dis("ultrafast"),)), Fuse()),
        "nlm-fast": Interpolator(CoarseToFine(finest_level=1), Fuse(step=16, enough=0.95)),
        "nlm-best": Interpolator(
            CoarseToFine(reach=1 / 6, others=(Dis("ultrafast"), Dis("medium"), CoarseToFine(patch_radius=4, v=0.06))),
            Fuse(around=16),
        ),
        "nlm-exhaustive": Interpolator(ExhaustiveSearch(), Reproject(), curved=False, relight=False, overlays=False),
        "dis": Interpolator(Dis(), Fuse()),
        "farneback": Interpolator(Farneback(), Fuse()),
        "blend": Interpolator(Still(), Blend(), curved=False, relight=False, overlays=False),
        "nearest": Interpolator(Still(), Nearest(), cuts=None, curved=False, relight=False, overlays=False),
    }
)
"""The methods by the names that the command line knows."""


def find_method(name: str) -> Interpolator:
    """Look a method up by name.

    Raises
    ------
    OptionError
        Unknown; the message lists the known ones.
    """
    if name not in methods:
        raise OptionError(f"There is no method {name!r}; choose one of {', '.join(methods)}.")
    return methods[name]


def configure(interpolator: Interpolator, method: str, options: Mapping[str, Any]) -> Interpolator:
    """Set options of a method's estimator and synthesizer by their field names.

    Parameters
    ----------
    interpolator : Interpolator
    method : str
        Its name, for messages.
    options : mapping of str to value
        Field names of the estimator or of the synthesizer.

    Returns
    -------
    Interpolator

    Raises
    ------
    OptionError
        The method has no such option, or the value is out of range.
    """
    estimator: Any = interpolator.estimator
    synthesizer: Any = interpolator.synthesizer
    for name, value in options.items():
        if name in {field.name for field in fields(estimator)}:
            estimator = replace(estimator, **{name: value})
        elif name in {field.name for field in fields(synthesizer)}:
            synthesizer = replace(synthesizer, **{name: value})
        else:
            raise OptionError(f"--{name.replace('_', '-')} does not apply to the method {method!r}; leave it out.")
    return replace(interpolator, estimator=estimator, synthesizer=synthesizer)


def interpolate(
    frame0: Image, frame1: Image, t: float | Fraction = 0.5, *, method: str | Interpolator = "nlm"
) -> Image:
    """Make the image at time t between two images.

    Parameters
    ----------
    frame0, frame1 : (H, W, C) or (H, W), uint8, uint16 or float32
        Two images of one size and type, BGR(A) or gray.
    t : float or Fraction
        In [0, 1]; 0 is `frame0`, 1 is `frame1`.
    method : str or Interpolator
        A name of `fpsboost.methods`, or an object.

    Returns
    -------
    ndarray
        Shape and type of the images.

    Raises
    ------
    InputError
        The two are no images of one size and type.
    OptionError
        Unknown method, or `t` out of range.

    Examples
    --------
    >>> import numpy as np
    >>> frame = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> interpolate(frame, np.roll(frame, 4, axis=1), 0.5, method="blend").shape
    (48, 64, 3)
    """
    interpolator = find_method(method) if isinstance(method, str) else method
    (image,) = interpolator.interpolate(*_with_channels(frame0, frame1), [t])
    return image.reshape(frame0.shape)


def interpolate_with_confidence(
    frame0: Image, frame1: Image, t: float | Fraction = 0.5, *, method: str | Interpolator = "nlm"
) -> Fused:
    """Like `interpolate`, with a map of how far each pixel can be trusted.

    Where two frames have nothing alike to show for an in-between pixel, its confidence is low and its error high: such
    regions are worth rendering, which the report leaves for the future.

    Parameters
    ----------
    frame0, frame1, t
        As for `interpolate`; t lies between the frames, in (0, 1).
    method : str or Interpolator
        One that fuses: ``nlm``, ``nlm-fast``, ``nlm-best``, ``dis`` or ``farneback``. Scene cuts are not looked for.

    Returns
    -------
    Fused
        ``image``, and ``confidence``: (H, W) float32 in [0, 1].

    Raises
    ------
    InputError
        The two are no images of one size and type.
    OptionError
        Unknown method, one that does not know its confidence, or `t` out of range.

    Examples
    --------
    >>> import numpy as np
    >>> frame = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> bool(interpolate_with_confidence(frame, frame).confidence.min() > 0.99)
    True
    """
    interpolator = find_method(method) if isinstance(method, str) else method
    if not isinstance(interpolator.synthesizer, Fuse):
        raise OptionError(f"The method {method!r} does not know its confidence; take nlm, nlm-fast or nlm-best.")
    if not 0 < t < 1:
        raise OptionError(f"A confidence is for times between two frames, above 0 and below 1, not at {t}.")
    image0, image1 = (PreparedImage(image) for image in _with_channels(frame0, frame1))
    pair = interpolator.pair(image0, image1)
    (fused,) = interpolator.synthesizer.fuse(Transition(*pair.in_one_light, *pair.fields), [float(t)])
    image = fused.image
    if pair.lighting is not None:
        image = pair.lighting.apply(image, float(t), frame0.dtype)
    return Fused(image.reshape(frame0.shape), fused.confidence)


def _with_channels(frame0: Image, frame1: Image) -> tuple[Image, Image]:
    """The two as the library has images; gray ones may come without an axis for channels."""
    if frame0.ndim == 2 and frame1.ndim == 2:
        frame0, frame1 = frame0[..., np.newaxis], frame1[..., np.newaxis]
    return np.ascontiguousarray(frame0), np.ascontiguousarray(frame1)
