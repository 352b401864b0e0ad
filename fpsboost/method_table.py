"""Table of the methods by name, each an estimator and a synthesizer, and interpolation of single pairs of images."""

from ast import literal_eval
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from fractions import Fraction
from functools import partial
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from fpsboost.analysis.scene_cuts import CutPolicy
from fpsboost.errors import OptionError, choose_one
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, view
from fpsboost.image_checks import check_pair
from fpsboost.interpolator import Interpolator
from fpsboost.motion.block import BlockMatching
from fpsboost.motion.exhaustive import ExhaustiveSearch
from fpsboost.motion.field import ZeroMotion
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis, Farneback, TvL1
from fpsboost.motion.rendered import RenderedMotion, RenderedVectors, UsesVectors
from fpsboost.options import check_type, checked
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.blend import Blend, Nearest
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis
from fpsboost.synthesis.reproject import Reproject
from fpsboost.synthesis.scene_assisted import SceneAssisted
from fpsboost.synthesis.warp import Splat, Warp

plain_interpolator = partial(Interpolator, curved=False, compensate_illumination=False, overlays=False)
"""Interpolator without this package's additions, for methods that reproduce published or other methods."""

methods: Mapping[str, Interpolator] = MappingProxyType(
    {
        "nlm": Interpolator(CoarseToFine(), MultiHypothesis(fusion="learnt", max_candidates=8)),
        "nlm-fast": Interpolator(
            CoarseToFine(patch_radius=3, coarsest_side=40, finest_level=1),
            MultiHypothesis(step=16, node_spacing=24, support_radius=32, sufficient_similarity=0.95),
        ),
        "nlm-exhaustive": plain_interpolator(ExhaustiveSearch(), Reproject()),
        "nlm-brute-force": plain_interpolator(ExhaustiveSearch(), Reproject(search="brute-force")),
        "nlm-passes": plain_interpolator(ExhaustiveSearch(implementation="passes"), Reproject()),
        "dis": Interpolator(Dis(), MultiHypothesis()),
        "farneback": Interpolator(Farneback(), MultiHypothesis()),
        "tvl1": Interpolator(TvL1(), MultiHypothesis()),
        "dis-warp": plain_interpolator(Dis(), Warp()),
        "farneback-warp": plain_interpolator(Farneback(), Warp()),
        "tvl1-warp": plain_interpolator(TvL1(), Warp()),
        "block": plain_interpolator(BlockMatching(), Splat()),
        "blend": plain_interpolator(ZeroMotion(), Blend()),
        "nearest": plain_interpolator(ZeroMotion(), Nearest(), cuts=None),
    }
)
"""Methods by their names on the command line."""


BYTES_PER_PIXEL_OF: Mapping[type, int] = {ZeroMotion: 70, CoarseToFine: 150, BlockMatching: 140}
"""Bytes of memory for a pixel of 8 to 16 bits in a conversion of images, by the estimator of motion.

Measured with 8 and with 16 bits: 34 and 73 with `blend` and `nearest`, 74 and 120 with `nlm`, 63 and 112 with
`nlm-fast`, 69 and 134 with `block`; 167 with `dis` and 8 bits. Others have more, or were not measured.
"""

vector_methods: Mapping[str, Callable[[RenderedVectors], Interpolator]] = MappingProxyType(
    {
        # Yang et al. 2011, image-based and scene-assisted
        "reproject-image": lambda vectors: plain_interpolator(RenderedMotion(vectors), Reproject()),
        "reproject-scene": lambda vectors: plain_interpolator(ZeroMotion(), SceneAssisted(vectors)),
    }
)
"""Methods that need a renderer's motion vectors, by name."""


@checked
def find_method(method: str | Interpolator, vectors: RenderedVectors | None = None) -> Interpolator:
    """Return the method of a name, with a renderer's motion vectors if it can use them.

    Parameters
    ----------
    method : str or Interpolator
        A name from `fpsboost.methods`, or one that needs vectors: ``reproject-image`` or ``reproject-scene``. Options
        of its estimator and synthesizer may follow: ``nlm:fusion=plain,patch-radius=6``. An object is returned as it
        is.
    vectors : RenderedVectors, optional
        Such as a `VectorFolder`.

    Raises
    ------
    OptionError
        The method is unknown, or has no such option, or vectors are missing or do not apply.

    Examples
    --------
    >>> find_method("nlm") is methods["nlm"]
    True
    >>> find_method("nlm:patch-radius=6").estimator.patch_radius
    6
    """
    if isinstance(method, Interpolator):
        return method
    name, options = split_method(method)
    if name in methods and may_use_vectors(methods[name]) and "vectors" in options:
        check_type(f"{name}:vectors", answer := options.pop("vectors"), Literal["yes", "no"])
        vectors = vectors if answer == "yes" else None
    interpolator = _named(name, vectors)
    values = read_options(interpolator, name, options)
    try:
        return configure(interpolator, values) if values else interpolator
    except OptionError as error:
        raise OptionError(f"In {method}: {error}") from None


def split_method(text: str) -> tuple[str, dict[str, str]]:
    """Split ``NAME:option=value,option=value`` into the name of a method and its options, whose names get dashes.

    Raises `OptionError` if an option has no value, or is given twice.

    Examples
    --------
    >>> split_method("nlm:fusion=plain,patch-radius=6")
    ('nlm', {'fusion': 'plain', 'patch-radius': '6'})
    """
    name, colon, rest = text.partition(":")
    options = dict[str, str]()
    for part in rest.split(",") if colon else ():
        option, equals, value = (word.strip() for word in part.partition("="))
        option = option.replace("_", "-")
        if not (option and equals and value):
            raise OptionError(f"{text!r} has an option without a value; write {name}:OPTION=VALUE.")
        if option in options:
            raise OptionError(f"{text!r} gives {option} twice; give it once.")
        options[option] = value
    return name.strip(), options


def _named(method: str, vectors: RenderedVectors | None) -> Interpolator:
    """Return the method of a plain name; see `find_method`."""
    if method in vector_methods:
        if vectors is None:
            raise OptionError(
                f"The method {method!r} needs the renderer's motion vectors; give `vectors=DIR`, or name another one."
            )
        return vector_methods[method](vectors)
    if method not in methods:
        raise OptionError(f"There is no method {method!r}; {choose_one(method, [*methods, *vector_methods])}")
    if vectors is None:
        return methods[method]
    if not may_use_vectors(methods[method]):
        others = (each for each, other in methods.items() if may_use_vectors(other))
        raise OptionError(
            f"`vectors` does not apply to the method {method!r}; leave it out, or choose one of "
            f"{', '.join([*vector_methods, *others])}."
        )
    return configure(methods[method], {"vectors": vectors})


def may_use_vectors(interpolator: Interpolator) -> bool:
    """Return whether a method can do with a renderer's motion vectors and without."""
    return any(isinstance(part, UsesVectors) for part in (interpolator.estimator, interpolator.synthesizer))


def configure(interpolator: Interpolator, options: Mapping[str, Any]) -> Interpolator:
    """Set options of a method's estimator and synthesizer by their field names; what both have is the estimator's.

    Raises `OptionError` if a value is out of range.
    """
    estimator: Any = interpolator.estimator
    own = {field.name for field in fields(estimator)} & options.keys()
    others = {name: value for name, value in options.items() if name not in own}
    synthesizer: Any = replace(interpolator.synthesizer, **others)  # type: ignore[type-var]
    estimator = replace(estimator, **{name: options[name] for name in own})
    return replace(interpolator, estimator=estimator, synthesizer=synthesizer)


def read_options(interpolator: Interpolator, method: str, texts: Mapping[str, str]) -> dict[str, Any]:
    """Parse options written by a user into values for `configure`, which checks them; messages name the `method`.

    Raises `OptionError` if the method has no such option.
    """
    parts: tuple[Any, ...] = interpolator.estimator, interpolator.synthesizer
    names = {field.name.replace("_", "-") for part in parts for field in fields(part)} - {"vectors"}
    for text in texts.keys() - names:
        raise OptionError(f"The method {method!r} has no option {text!r}; it has {', '.join(sorted(names)) or 'none'}.")
    return {text.replace("-", "_"): _value(value) for text, value in texts.items()}


def _value(text: str) -> Any:
    """Return the number that a text is, or the text."""
    try:
        return literal_eval(text)
    except (ValueError, SyntaxError):
        return text


@checked
def interpolate(
    frame0: Image,
    frame1: Image,
    t: float | Fraction = 0.5,
    *,
    method: str | Interpolator = "nlm",
    cuts: CutPolicy | None = None,
    guide: Image | None = None,
    key_guides: tuple[Image, Image] | None = None,
) -> Image:
    """Make the image at time t between two images; scene cuts are respected only if `cuts` is given.

    Parameters
    ----------
    frame0, frame1 : (H, W, C) or (H, W), uint8, uint16 or float32
        Two images of one size and type, BGR(A) or gray.
    t : float or Fraction
        In [0, 1]; 0 is `frame0`, 1 is `frame1`.
    method : str or Interpolator
        A name from `fpsboost.methods`, or an object, whose own cut policy is for sequences and not used.
    cuts : CutPolicy, optional
        Decides whether a scene ends between the two: ``cuts=fpsboost.CutDetector()``. Across a cut, the method's
        ``at_cuts`` applies; most methods repeat the nearer image.
    guide : (h, w, C) uint8, uint16 or float32, optional
        Cheap picture of the image to be made, such as a small or noisy one: it shows where everything is.
    key_guides : tuple of two (h, w, C), optional
        The same of the two images, by which the guide is calibrated.

    Returns
    -------
    ndarray
        Shape and type of the images.

    Raises
    ------
    InputError
        The two are not images of one size and type.
    OptionError
        The method is unknown, or `t` is out of range.

    Warns
    -----
    SceneCutWarning
        There is a cut, so that the result does not show what lies between the two.

    Examples
    --------
    >>> import numpy as np
    >>> frame = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> interpolate(frame, np.roll(frame, 4, axis=1), 0.5, method="blend").shape
    (48, 64, 3)
    >>> small = np.roll(frame, 2, axis=1)[::2, ::2]
    >>> interpolate(frame, np.roll(frame, 4, axis=1), 0.5, guide=small).shape
    (48, 64, 3)
    """
    guides = None if guide is None else [guide]
    images = _with_channels(frame0, frame1)
    (image,) = find_method(method).interpolate(*images, [t], cuts=cuts, guides=guides, key_guides=key_guides)
    return image.reshape(frame0.shape)


@checked
def interpolate_with_confidence(
    frame0: Image, frame1: Image, t: float | Fraction = 0.5, *, method: str | Interpolator = "nlm"
) -> InterpolatedImage:
    """Make the image at time t between two images, with a confidence map.

    Where no patches of the two frames match for an in-between pixel, its confidence is low and its error high: such
    regions are worth rendering, which the report leaves to future work.

    Parameters
    ----------
    frame0, frame1, t
        As for `interpolate`; t lies between the frames, in (0, 1).
    method : str or Interpolator
        As for `interpolate`. Methods that fuse hypotheses (``nlm``, ``nlm-fast``, ``dis``, ``farneback``, ``tvl1``)
        know their confidence; for the others it is the agreement of the two frames along the estimated motion. Scene
        cuts are not looked for.

    Returns
    -------
    InterpolatedImage
        ``image``, and ``confidence``: (H, W) float32 in [0, 1]. Errors are those of `interpolate`.

    Examples
    --------
    >>> import numpy as np
    >>> frame = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> bool(interpolate_with_confidence(frame, frame).confidence.min() > 0.99)
    True
    """
    interpolator = replace(find_method(method), cuts=None)
    if not 0 < t < 1:
        raise OptionError(f"Confidence is defined between two frames, for t above 0 and below 1, not at {t}.")
    image0, image1 = (FrameCache(image) for image in _with_channels(frame0, frame1))
    ((image, confidence),) = interpolator.images(interpolator.pair(image0, image1), [t], with_confidence=True)
    return InterpolatedImage(view(image).array().reshape(frame0.shape), confidence)


def _with_channels(frame0: Image, frame1: Image) -> tuple[Image, Image]:
    """Return the two as images of the library; gray ones may come without a channel axis, and as other arrays."""
    image0 = np.ascontiguousarray(frame0)
    image1 = np.ascontiguousarray(frame1)
    if image0.ndim == 2 and image1.ndim == 2:
        image0 = image0[..., np.newaxis]
        image1 = image1[..., np.newaxis]
    check_pair(image0, image1, "frame0", "frame1")
    return image0, image1
