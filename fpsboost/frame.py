"""Frames, clips, and the conventions of all modules of the package.

Images
    Arrays of shape (height, width, channels), C-contiguous, channels 1 (gray), 2 (gray and alpha), 3 (BGR) or 4 (BGRA)
    in OpenCV's order; uint8 and uint16 use their whole range, float32 has 1.0 for white. Indexed ``[y, x]``, sizes
    given as (height, width). Video converted to video keeps its own planes; see `fpsboost.image`. Images of a renderer
    may have further layers; see `fpsboost.layered`.
Motion
    ``flow01[y, x] = (dx, dy)`` in pixels, float32: ``image1[y + dy, x + dx]`` looks like ``image0[y, x]``. The
    direction is in the name: ``flow01`` from frame 0 to frame 1, ``flow10`` back.
Time
    Presentation times are `fractions.Fraction` seconds, exactly as given by the container's ticks. ``t`` in [0, 1] is a
    position between two frames: 0 is ``frame0``, 1 is ``frame1``. A frame rate is a Fraction, never a float.
Words
    *pair* two consecutive frames with different content, and what is computed from them; *duplicates* frames that show
    the same as the one before, treated as one frame; *scene_cut* no motion connects the two frames of a pair, as its
    *match_score* tells; *illumination* a change of brightness between two frames, compensated before the search.

    *offset* an integer motion vector that is tried; *search_radius* the largest one; *patch_radius* r for a patch of
    (2r + 1) x (2r + 1) pixels; *similarity* of two patches, higher is better, with a *bandwidth* for its decay;
    *consistency* of the motion there and back, pixels, as *forward_backward_error*; *trajectory* the path of a point
    through several frames.

    *hypotheses* motions that may lead through a pixel of an in-between frame, called *candidates* where they are
    listed for a neighbourhood; their *votes* and similarity weigh them; *confidence* how far the result can be
    trusted, 0 to 1. *warp* gathers, *splat* scatters and leaves holes.

    *layers* channels of an image that belong together, such as the *passes* that a renderer writes beside its picture;
    their *kind* says whether they may be mixed. *planes* single channels.

    *plan* the *regions* of made frames that are worth rendering, rectangles of whole *tiles* within a *budget*;
    *rerender* to render them; *merge* to put them back, with seams that *feather* into the made frame.

    *chunk* the output frames that are encoded in one go, 240 of a video; *part* one of the parts, of whole chunks,
    that a conversion is cut into, to be made apart and joined; *boundaries* the frames of the source at which parts
    meet.

    *schedule* decides the times of the output's frames; *window* the part of a clip that is written; *traits* the
    colour coding, shape and orientation of video; *remarks* sentences about what was lost or guessed.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from fpsboost.image import Image, Pixels, view
from fpsboost.layered import FrameImage
from fpsboost.media import ClipInfo as ClipInfo  # noqa: PLC0414 (the public name)


class PairMotion(NamedTuple):
    """Motion between two frames of a source."""

    number0: int
    """Number of the first frame, of those that are read, counted from 0."""
    number1: int
    """Number of the second frame; further apart than 1 if duplicates lie between them."""
    flow01: np.ndarray
    """(H, W, 2) float32: motion from the first frame to the second, y down."""
    flow10: np.ndarray
    """(H, W, 2) float32: motion from the second frame to the first, y down."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One image and its presentation time."""

    image: FrameImage
    """(H, W, C) uint8, uint16 or float32, YCbCrImage or LayeredImage."""
    time: Fraction
    """Presentation time in seconds."""
    duration: Fraction = Fraction(0)
    """Duration in seconds; 0 if the source does not say."""
    original: object | None = None
    """The decoder's own frame, kept so that a sink of the same kind can write it without any conversion. None for
    interpolated frames."""
    preceding: object | None = None
    """The `original` of the source frame before an interpolated frame, whose metadata it shares; None for others."""
    confidence: np.ndarray | None = None
    """(H, W) float32 or None: confidence of every pixel of an interpolated frame, 0 to 1, for a sink that asks for it;
    None for others."""
    captions: bytes = b""
    """Closed captions that came since the frame before; see `fpsboost.media.captions_of`."""
    guide: FrameImage | None = None
    """Guide of an output frame, also of one that repeats the source's and does not follow it; None without one."""
    motion: PairMotion | None = None
    """Motion between the two frames of the source around it, for a sink that asks for it, with the first frame that is
    made between them."""
    ends_gap: bool = False
    """Whether the user has named frames that are missing before it, so that no scene cut is looked for there."""

    @property
    def pixels(self) -> Pixels:
        """The image without further layers."""
        return view(self.image).picture

    @property
    def array(self) -> Image:
        """The image, which must be an array; `InputError` if it is a `YCbCrImage`."""
        return view(self.image).array()
