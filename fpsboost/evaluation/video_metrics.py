"""Metrics by FFmpeg's filters of two videos: XPSNR, and those of libvmaf.

XPSNR uses frames before and after, so it gets the whole output and the whole original, including shown frames; values
of those, which are equal, are left out. libvmaf gets the interpolated frames and their true ones alone. Pictures are
YCbCr of 4:4:4, limited range and 8 bits.
"""

import gc
import json
from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from importlib.util import find_spec
from itertools import compress
from pathlib import Path

import av.filter
import numpy as np

from fpsboost.colour import composite_on_black, has_alpha
from fpsboost.errors import InputError
from fpsboost.evaluation.commands import FOLDERS, PicturesMeter, run_command
from fpsboost.image import Image
from fpsboost.io.video.ycc import from_bgr
from fpsboost.media import assumed_color_space, pulled

HIGHEST = 120.0
"""XPSNR and PSNR-HVS of equal frames, dB, the same as their PSNR; infinity would have no mean."""

PIXEL_FORMAT = "yuv444p"
"""Pixel format of both videos; deeper ones are misread by ``xpsnr`` (FFmpeg 8.1), which takes rows to be unpadded."""

LIMITED = "yuv444p:color_ranges=tv"
"""The same with its range, as an option of the filter ``format``; PNG would become full range."""

MULTIPLE = 4
"""Side of the blocks of ``xpsnr``, pixels; a lone last row or column has far too much weight, and may lie behind it."""

MIN_PIXELS = 2025
"""Number of pixels of a frame below which ``xpsnr`` chooses blocks of no size, and divides by it."""

MIN_SIDE = 32
"""Side of a frame below which ``xpsnr`` may see no error, as in a lone column of blocks, and libvmaf ends the process,
pixels."""

LOG = "libvmaf.json"
"""Name of the file that libvmaf writes."""


def missing_filter(name: str) -> str | None:
    """Return a description of a filter that FFmpeg lacks, for a message; None if it is there."""
    lacking = f"the filter {name}, which the FFmpeg of this PyAV ({av.__version__}) was built without"
    return None if name in av.filter.filters_available else lacking


def missing_libvmaf() -> str | None:
    """Return a description of what must be installed for libvmaf, for a message; None if it is there."""
    lacking = missing_filter("libvmaf")
    return None if find_spec("imageio_ffmpeg") else lacking and f"{lacking}; pip install 'fpsboost[vmaf]' adds another"


class XpsnrMeter:
    """Meter of XPSNR of luma, dB: PSNR with errors weighted by their visibility.

    Helmrich et al. 2020 (doi:10.1109/ICASSP40776.2020.9054089), in FFmpeg's filter ``xpsnr``: blocks are weighted by
    the activity of the true video in space and time, in time by second differences from 32 frames per second on. Up to
    three rows at the bottom and columns at the right are left out, so that the sides are multiples of 4. The graph of
    the filter is built for the size of the first frame.
    """

    def __init__(self, rate: Fraction) -> None:
        self._rate = max(1, round(rate))
        self._graph = av.filter.Graph()
        self._entries: list[av.filter.FilterContext] = []
        self._values: list[float] = []
        self._counts: list[bool] = []

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Add the next frame; raises `InputError` if it is too small for the filter."""
        pictures = [_picture(_cropped(each, MULTIPLE, "xpsnr")) for each in (truth, image)]
        if not self._entries:
            clock = f"time_base=1/{self._rate}:frame_rate={self._rate}:pixel_aspect=1/1"
            size = f"{pictures[0].width}x{pictures[0].height}"
            comparing = self._graph.add("xpsnr")
            for place in range(2):
                entry = self._graph.add("buffer", f"video_size={size}:pix_fmt={PIXEL_FORMAT}:{clock}")
                entry.link_to(comparing, 0, place)
                self._entries.append(entry)
            comparing.link_to(self._graph.add("buffersink"))
            self._graph.configure()
        for entry, picture in zip(self._entries, pictures, strict=True):
            picture.pts = len(self._counts)
            picture.time_base = Fraction(1, self._rate)
            entry.push(picture)
        self._counts.append(counts)
        self._keep()

    def _keep(self) -> None:
        """Store the values of pictures that the filter has output, limited to `HIGHEST`."""
        self._values += [min(float(each.metadata["lavfi.xpsnr.xpsnr.y"]), HIGHEST) for each in pulled(self._graph)]

    def values(self) -> list[float]:
        """Return the XPSNR of each frame that counts, dB."""
        for entry in self._entries:
            entry.push(None)
        self._keep()
        return list(compress(self._values, self._counts))


def _cropped(image: Image, multiple: int, metric: str) -> Image:
    """Return an image without the rows and columns beyond a multiple; raises `InputError` if it is too small."""
    height, width = (side - side % multiple for side in image.shape[:2])
    if min(height, width) < MIN_SIDE or height * width < MIN_PIXELS:
        raise InputError(
            f"Frames of {image.shape[1]}x{image.shape[0]} are too small for {metric}, which needs {MIN_SIDE} "
            f"pixels each way and {MIN_PIXELS} in all; leave it out of `metrics`."
        )
    return np.ascontiguousarray(image[:height, :width])


def _picture(image: Image) -> av.VideoFrame:
    """Return an image as a picture of `PIXEL_FORMAT`, by the usual matrix for its size."""
    if has_alpha(image):  # colours count as far as they are seen, as in the other scores
        image = composite_on_black(image)[..., :-1]
    return from_bgr(image, PIXEL_FORMAT, assumed_color_space(image.shape[0]), full_range=False)


class LibvmafMeter(PicturesMeter):
    """Meter of a figure of libvmaf: ``vmaf`` by Netflix's model ``vmaf_v0.6.1``, or ``psnr_hvs``.

    By the FFmpeg of PyAV, or else by that of the package ``imageio-ffmpeg`` (``fpsboost[vmaf]``). A last row or column
    that makes a side odd is left out.
    """

    def __init__(self, figure: str) -> None:
        super().__init__(partial(measure_by_libvmaf, figure))
        self._figure = figure

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Write the next frame, if it counts; raises `InputError` if it is too small."""
        super().add(_cropped(truth, 2, self._figure), _cropped(image, 2, self._figure), counts=counts)


def measure_by_libvmaf(figure: str, folder: Path, count: int) -> list[float]:
    """Return a figure of libvmaf for each picture of a folder; see `fpsboost.evaluation.commands.PicturesMeter`."""
    options = {"log_fmt": "json"}
    if figure != "vmaf":  # a feature, instead of a model and its features
        options |= {"model": "", "feature": f"name={figure}"}
    if missing_filter("libvmaf"):
        _filter_apart(figure, folder, options)
    else:
        _filter_here(folder, options)
        gc.collect()  # libvmaf writes its log when it is freed; PyAV's filters and their graph hold each other
    frames = json.loads((folder / LOG).read_text("utf-8"))["frames"]
    values = [frame["metrics"][figure] for frame in frames]
    return [HIGHEST if value is None else value for value in values]


def _filter_here(folder: Path, options: Mapping[str, str]) -> None:
    """Have libvmaf write its log on the pictures of a folder, by PyAV."""
    graph = av.filter.Graph()
    comparing = graph.add("libvmaf", log_path=str(folder / LOG), **options)
    for place, name in enumerate(reversed(FOLDERS)):
        entry = graph.add("format", LIMITED)
        graph.add("movie", filename=str(folder / name / "%04d.png")).link_to(entry)
        entry.link_to(comparing, 0, place)
    comparing.link_to(graph.add("buffersink"))
    graph.configure()
    for _ in pulled(graph):
        pass


def _filter_apart(figure: str, folder: Path, options: Mapping[str, str]) -> None:
    """Have libvmaf write its log on the pictures of a folder, by the program of ``imageio-ffmpeg``."""
    from imageio_ffmpeg import get_ffmpeg_exe  # noqa: PLC0415 (an extra, which may be missing)

    settings = ":".join(f"{name}={value}" for name, value in {**options, "log_path": LOG}.items())
    sources = f"movie=made/%04d.png,format={LIMITED}[made];movie=truth/%04d.png,format={LIMITED}[truth]"
    graph = f"{sources};[made][truth]libvmaf={settings}"
    run_command("metric", figure, [get_ffmpeg_exe(), "-v", "error", "-lavfi", graph, "-f", "null", "-"], {}, folder)
