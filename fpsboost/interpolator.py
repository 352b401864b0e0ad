"""A pair of frames and times in, in-between frames out: estimator, synthesizer, and what happens at a scene cut."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from fpsboost.errors import OptionError, check_choice
from fpsboost.frame import Image, check_pair
from fpsboost.motion import MotionEstimator
from fpsboost.motion.exhaustive import ExhaustiveSearch
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis, Farneback, Still
from fpsboost.scenes import CutDetector
from fpsboost.synthesis import Synthesizer
from fpsboost.synthesis.blend import Blend, Nearest, TwoSidedBlend
from fpsboost.synthesis.reproject import Reproject

AtCuts = Literal["repeat", "blend"]


class InBetween(NamedTuple):
    """The frames between two frames, and whether a scene ends there."""

    images: Iterator[Image]
    scene_cut: bool


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
        return list(self.between(image0, image1, times).images)

    def between(self, image0: Image, image1: Image, times: Sequence[float | Fraction]) -> InBetween:
        """Like `interpolate`, but made one image at a time, and with word of a scene cut."""
        check_pair(image0, image1)
        for t in times:
            if not 0 <= t <= 1:
                raise OptionError(f"A time between two frames must lie in [0, 1], not at {t}.")
        scene_cut = self.cuts is not None and self.cuts.is_cut(image0, image1)
        return InBetween(self._images(image0, image1, times, scene_cut), scene_cut)

    def _images(
        self, image0: Image, image1: Image, times: Sequence[float | Fraction], scene_cut: bool
    ) -> Iterator[Image]:
        inner = [float(t) for t in times if 0 < t < 1]
        made = self._made(image0, image1, inner, scene_cut) if inner else iter(())
        for t in times:
            yield next(made) if 0 < t < 1 else (image1 if t == 1 else image0).copy()

    def _made(self, image0: Image, image1: Image, times: list[float], scene_cut: bool) -> Iterator[Image]:
        synthesizer: Synthesizer
        if scene_cut:
            estimator: MotionEstimator = Still()
            synthesizer = Blend() if self.at_cuts == "blend" else Nearest()
        else:
            estimator, synthesizer = self.estimator, self.synthesizer
        field01, field10 = estimator.estimate(image0, image1)
        return synthesizer.synthesize(image0, image1, field01, field10, times)

    def compile_for(self, image: Image) -> None:
        """Compile the kernels for images of this type, or load them from the cache, on a tiny pair.

        Parameters
        ----------
        image : (H, W, C) uint8, uint16 or float32
            Any image of the clip; only its type and channels count.
        """
        noise = np.random.default_rng(0).integers(0, 256, (48, 64, image.shape[2])).astype(image.dtype)
        self.interpolate(noise, noise, [0.5])


methods: Mapping[str, Interpolator] = MappingProxyType(
    {
        "nlm": Interpolator(CoarseToFine(), TwoSidedBlend()),
        "nlm-exhaustive": Interpolator(ExhaustiveSearch(), Reproject()),
        "dis": Interpolator(Dis(), TwoSidedBlend()),
        "farneback": Interpolator(Farneback(), TwoSidedBlend()),
        "blend": Interpolator(Still(), Blend()),
        "nearest": Interpolator(Still(), Nearest(), cuts=None),
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
    shape = frame0.shape
    if frame0.ndim == 2 and frame1.ndim == 2:
        frame0, frame1 = frame0[..., np.newaxis], frame1[..., np.newaxis]
    (image,) = interpolator.interpolate(np.ascontiguousarray(frame0), np.ascontiguousarray(frame1), [t])
    return image.reshape(shape)
