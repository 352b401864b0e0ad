"""Metrics that FFmpeg has as filters of two videos, in the FFmpeg that PyAV brings: XPSNR and VMAF.

Both look at frames before and after, so that they are given the whole output beside the whole original, the shown
frames in their places; what they say of those, which are equal, is left out. Pictures are YCbCr of 4:4:4, limited range
and 8 bits, by the matrix that is usual for their size.
"""

from __future__ import annotations

import json
import tempfile
from fractions import Fraction
from pathlib import Path

import av
import av.filter
import numpy as np

from fpsboost.errors import InputError
from fpsboost.evaluation.metrics import composite_on_black
from fpsboost.frame import Image, has_alpha
from fpsboost.io.video.ycc import assumed_color_space, from_bgr

HIGHEST = 120.0
"""Equal frames have this XPSNR, dB, as they have this PSNR, and not infinity, which has no mean."""

PIXEL_FORMAT = "yuv444p"
"""Deeper ones are misread by ``xpsnr`` (FFmpeg 8.1): it takes the distorted rows to have no padding."""

MULTIPLE = 4
"""Pixels: blocks of ``xpsnr`` have such sides. Of other sizes it gives a lone last row or column far too much weight,
and in large frames it reads and writes behind them."""

MIN_PIXELS = 2025
"""Of fewer, ``xpsnr`` takes blocks of no size, and divides by it."""

MIN_SIDE = 32
"""Pixels: in a lone column of blocks, ``xpsnr`` sees no error."""


def missing_filter(name: str) -> str | None:
    """Return what is missing to use a filter of FFmpeg, or None."""
    if name in av.filter.filters_available:
        return None
    return f"the filter {name}, which the FFmpeg of this PyAV ({av.__version__}) was built without"


class _Side:
    """Two videos of one size on their way through a filter that compares them."""

    def __init__(self, image: Image, rate: Fraction, filter_name: str, options: dict[str, str]) -> None:
        height, width = image.shape[:2]
        self._matrix, self._passed = assumed_color_space(height), 0
        self._clock = Fraction(1, max(1, round(rate)))
        self._graph = av.filter.Graph()
        picture = {
            "video_size": f"{width}x{height}",
            "pix_fmt": PIXEL_FORMAT,
            "time_base": str(self._clock),
            "frame_rate": str(1 / self._clock),
            "pixel_aspect": "1/1",
        }
        comparing = self._graph.add(filter_name, **options)
        self._entries = [self._graph.add("buffer", **picture) for _ in range(2)]
        for place, entry in enumerate(self._entries):
            entry.link_to(comparing, 0, place)
        self._exit = self._graph.add("buffersink")
        comparing.link_to(self._exit)
        self._graph.configure()

    def push(self, first: Image, second: Image) -> list[av.VideoFrame]:
        """Give it two frames of one moment; what comes out meanwhile."""
        for entry, image in zip(self._entries, (first, second), strict=True):
            picture = from_bgr(_without_alpha(image), PIXEL_FORMAT, self._matrix, full_range=False)
            picture.pts, picture.time_base = self._passed, self._clock
            entry.push(picture)
        self._passed += 1
        return self._pull()

    def end(self) -> list[av.VideoFrame]:
        """Say that there is no more; what comes out last."""
        for entry in self._entries:
            entry.push(None)
        return self._pull()

    def _pull(self) -> list[av.VideoFrame]:
        pictures: list[av.VideoFrame] = []
        while True:
            try:
                picture = self._exit.pull()
            except (av.BlockingIOError, av.EOFError):
                return pictures
            assert isinstance(picture, av.VideoFrame)
            pictures.append(picture)


def _without_alpha(image: Image) -> Image:
    """Return colours as far as they are seen, which is what the other scores count."""
    return composite_on_black(image)[..., :-1] if has_alpha(image) else image


class _FilterMeter:
    """What the meters of both filters have in common: every frame goes in, and those count that were made."""

    def __init__(self, rate: Fraction) -> None:
        self._rate = rate
        self._side: _Side | None = None
        self._is_made: list[bool] = []

    def shown(self, image: Image) -> None:
        """Add a frame that passes as it is.

        Raises
        ------
        InputError
            Frames are too small for the filter.
        """
        self._is_made.append(False)
        self._push(image, image)

    def made(self, truth: Image, made: Image) -> None:
        """Add a made frame in its place."""
        self._is_made.append(True)
        self._push(truth, made)

    def _push(self, truth: Image, made: Image) -> None:
        """Give the filter two frames of one moment."""
        raise NotImplementedError

    def _of_made(self, name: str, values: list[float]) -> list[dict[str, float]]:
        return [{name: value} for value, made in zip(values, self._is_made, strict=True) if made]


class XpsnrMeter(_FilterMeter):
    """XPSNR of luma of the made frames of one method, dB: PSNR with errors weighted by how well they are seen.

    Helmrich et al. 2020 ("XPSNR: a low-complexity extension of the perceptually weighted peak signal-to-noise ratio for
    high-resolution video quality assessment", ICASSP, doi:10.1109/ICASSP40776.2020.9054089), as FFmpeg's filter
    ``xpsnr`` has it. It weighs blocks of the picture by the activity of the true video in space and time. Up to three
    rows at the bottom and columns at the right are left out, so that the sides are multiples of 4.

    Parameters
    ----------
    rate : Fraction
        Frames per second, rounded: from 32 on, the filter takes second differences for the activity in time.
    """

    def __init__(self, rate: Fraction) -> None:
        super().__init__(rate)
        self._found: list[float] = []

    def _push(self, truth: Image, made: Image) -> None:
        height, width = (side - side % MULTIPLE for side in truth.shape[:2])
        if min(height, width) < MIN_SIDE or height * width < MIN_PIXELS:
            raise InputError(
                f"Frames of {truth.shape[1]}x{truth.shape[0]} are too small for XPSNR, which needs {MIN_SIDE} "
                f"pixels each way and {MIN_PIXELS} in all; leave xpsnr out of `metrics`."
            )
        truth, made = (np.ascontiguousarray(image[:height, :width]) for image in (truth, made))
        if self._side is None:
            self._side = _Side(truth, self._rate, "xpsnr", {})
        self._keep(self._side.push(truth, made))

    def _keep(self, pictures: list[av.VideoFrame]) -> None:
        self._found += [min(float(each.metadata["lavfi.xpsnr.xpsnr.y"]), HIGHEST) for each in pictures]

    def values(self) -> list[dict[str, float]]:
        """Return ``xpsnr`` of every made frame."""
        if self._side is not None:
            self._keep(self._side.end())
            self._side = None
        return self._of_made("xpsnr", self._found)


class VmafMeter(_FilterMeter):
    """VMAF of the made frames of one method, 0 to 100: trained on what people said of compressed videos.

    Netflix's model ``vmaf_v0.6.1``, for a 1080p screen from three times its height away, as FFmpeg's filter ``libvmaf``
    has it. It knows blur and coding, and was not made for frames between others.

    Parameters
    ----------
    rate : Fraction
        Frames per second.
    """

    def __init__(self, rate: Fraction) -> None:
        super().__init__(rate)
        self._scratch = tempfile.TemporaryDirectory(prefix="fpsboost-")
        self._log = Path(self._scratch.name, "vmaf.json")

    def _push(self, truth: Image, made: Image) -> None:
        if self._side is None:
            self._side = _Side(truth, self._rate, "libvmaf", {"log_path": str(self._log), "log_fmt": "json"})
        self._side.push(made, truth)  # unlike xpsnr, it takes the reference second

    def values(self) -> list[dict[str, float]]:
        """Return ``vmaf`` of every made frame."""
        if self._side is not None:
            self._side.end()
            self._side = None  # the filter writes its log when it is taken down
        found = read_vmaf(self._log.read_text(encoding="utf-8"))
        self._scratch.cleanup()
        return self._of_made("vmaf", found)


def read_vmaf(log: str) -> list[float]:
    """VMAF of every frame, in order, from the log that libvmaf writes as JSON."""
    frames = sorted(json.loads(log)["frames"], key=lambda frame: int(frame["frameNum"]))
    return [float(frame["metrics"]["vmaf"]) for frame in frames]
