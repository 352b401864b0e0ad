"""Guides of known frames: cheap pictures of them, for `guides.py`.

A kind is a name, such as ``area4``. Most make a guide of a frame by itself; codecs make those of a whole clip.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import NamedTuple

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageFilter

from fpsboost.colour import srgb_encoded
from fpsboost.image import Image

Floats = NDArray[np.float32]
MakeGuide = Callable[[Image, int], Image]
"""A frame and the seed of its noise in, its guide out."""
MakeGuides = Callable[[Mapping[int, Image], Mapping[int, int]], dict[int, Image]]
"""Frames and the seeds of those that take a guide in, both by numbers, their guides out."""
Read = Callable[[int], list[Image]]
"""Reads the first frames of a clip, at most so many."""

LOOK_AHEAD = 8
"""Frames after the last guide in a proxy, as encoders look ahead."""


@dataclass(frozen=True)
class Material:
    """A clip, and how each kind of guides of it is made."""

    name: str
    read: Read
    kinds: Mapping[str, MakeGuides]
    read_from_files: frozenset[str] = frozenset()
    """Kinds that are no function of the frames."""


class Codec(NamedTuple):
    """How frames become a proxy: a video of small frames."""

    name: str
    smaller: int
    """Factor by which it is smaller each way."""
    options: dict[str, str]
    container: str = "matroska"


def to_bytes(levels: Floats) -> Image:
    """Round levels to 8 bits."""
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def to_light(image: Image) -> Floats:
    """Return the linear light of sRGB with 8 bits, 0 to 1."""
    values = np.arange(256, dtype=np.float32) / 255
    light = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return light.astype(np.float32)[image]


def from_light(light: Floats) -> Image:
    """Return linear light as sRGB with 8 bits."""
    return to_bytes(srgb_encoded(np.clip(light, 0, 1)) * 255)


def size_of(image: Image, smaller: int) -> tuple[int, int]:
    """Return width and height of a smaller picture."""
    return image.shape[1] // smaller, image.shape[0] // smaller


def reduced(image: NDArray[np.generic], smaller: int) -> NDArray[np.generic]:
    """Return the means of areas."""
    return cv2.resize(image, size_of(image, smaller), interpolation=cv2.INTER_AREA)


def enlarged(guide: Image, like: Image) -> Image:
    """Return a guide in the size of its frame."""
    size = like.shape[1::-1]
    return guide if guide.shape[1::-1] == size else cv2.resize(guide, size, interpolation=cv2.INTER_CUBIC)


def reduce_by_area(frame: Image, seed: int, smaller: int) -> Image:
    """Average the code values of areas, as scalers of video do."""
    return reduced(frame, smaller)


def reduce_light(frame: Image, seed: int, smaller: int) -> Image:
    """Average the light of areas, as renderers do."""
    return from_light(reduced(to_light(frame), smaller))


def reduce_by_filter(frame: Image, seed: int, smaller: int, resampling: Picture.Resampling, sharpen: int) -> Image:
    """Scale with the filter of an image editor, and sharpen the result, percent."""
    picture = Picture.fromarray(frame).resize(size_of(frame, smaller), resampling)
    if sharpen:
        picture = picture.filter(ImageFilter.UnsharpMask(1, sharpen, 0))
    return np.asarray(picture)


def add_noise(frame: Image, seed: int, deviation: float) -> Image:
    """Add noise that is stronger where it is bright."""
    noise = np.random.default_rng(seed).standard_normal(frame.shape).astype(np.float32) * np.float32(deviation)
    return to_bytes(frame + noise * np.sqrt((frame.astype(np.float32) + 32) / 160))


def compress(frame: Image, seed: int, quality: int) -> Image:
    """Compress as JPEG."""
    return cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)


def change_tone(frame: Image, seed: int) -> Image:
    """Change contrast, colours and shading, as a preview with other lights has them."""
    light = 0.15 + 0.7 * (frame.astype(np.float32) / 255) ** 1.5
    light = light[..., [1, 0, 2]] * 0.5 + 0.5 * light.mean(2, keepdims=True)
    shade = cv2.GaussianBlur(light.mean(2), (0, 0), frame.shape[1] / 24)[..., np.newaxis]
    return to_bytes(255 * np.clip(light - 0.5 * shade + 0.25, 0, 1))


def displace(frame: Image, seed: int, distance: float) -> Image:
    """Move the picture by some pixels of the frame."""
    matrix = np.array([[1, 0, 0.8 * distance], [0, 1, -0.6 * distance]])
    size = frame.shape[1::-1]
    return cv2.warpAffine(frame, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def blur(frame: Image, seed: int, deviation: float) -> Image:
    """Blur as a lens out of focus."""
    return cv2.GaussianBlur(frame, (0, 0), deviation)


def change_gain(frame: Image, seed: int) -> Image:
    """Expose each guide otherwise than the one before, by up to half a stop, as automatic exposure does."""
    return from_light(to_light(frame) * np.float32(2 ** np.random.default_rng(seed).uniform(-0.5, 0.5)))


def change_balance(frame: Image, seed: int) -> Image:
    """Change the white balance towards red, so that bright red is clipped."""
    return from_light(to_light(frame) * np.array([0.65, 1, 1.5], np.float32))


def reduce_after(change: MakeGuide, smaller: int) -> MakeGuide:
    """Return a kind that makes a changed frame smaller."""
    return lambda frame, seed: reduced(change(frame, seed), smaller)


PICTURES: Mapping[str, MakeGuide] = {
    "area2": partial(reduce_by_area, smaller=2),
    "area4": partial(reduce_by_area, smaller=4),
    "area8": partial(reduce_by_area, smaller=8),
    "noise20": partial(add_noise, deviation=20),
    "noise40": partial(add_noise, deviation=40),
    "jpeg10": partial(compress, quality=10),
    "tone": change_tone,
    "tone4": reduce_after(change_tone, 4),
    "shift1": reduce_after(partial(displace, distance=1), 4),
    "shift2": reduce_after(partial(displace, distance=2), 4),
    "shift4": reduce_after(partial(displace, distance=4), 4),
    "light4": partial(reduce_light, smaller=4),
    "bicubic4": partial(reduce_by_filter, smaller=4, resampling=Picture.Resampling.BICUBIC, sharpen=0),
    "lanczos4": partial(reduce_by_filter, smaller=4, resampling=Picture.Resampling.LANCZOS, sharpen=80),
    "blur": partial(blur, deviation=2),
    "blur4": reduce_after(partial(blur, deviation=2), 4),
    "gain": change_gain,
    "gain4": reduce_after(change_gain, 4),
    "balance": change_balance,
    "balance4": reduce_after(change_balance, 4),
}
"""Kinds that make a guide of a frame by itself."""

CODECS: Mapping[str, Codec] = {
    "h264-2-28": Codec("libx264", 2, {"crf": "28"}),
    "h264-4-23": Codec("libx264", 4, {"crf": "23"}),
    "h264-4-32": Codec("libx264", 4, {"crf": "32"}),
    "vp9-2-36": Codec("libvpx-vp9", 2, {"crf": "36", "b": "0", "cpu-used": "4", "row-mt": "0"}),
    "mjpeg-2-12": Codec("mjpeg", 2, {"qmin": "12", "qmax": "12"}),
}
"""Kinds that encode a clip: codec, factor by which it is smaller, and quality."""

OTHER_PICTURES = ("tone", "tone4", "gain", "gain4", "balance", "balance4")
"""Kinds whose guides are meant to differ from their frames, so that their own PSNR says nothing."""


def encode(frames: Sequence[Image], codec: Codec) -> list[Image]:
    """Encode frames as a small video with 4:2:0 chroma, and decode it."""
    width, height = (side // 2 * 2 for side in size_of(frames[0], codec.smaller))
    file = io.BytesIO()
    with av.open(file, "w", format=codec.container) as writing:
        stream = writing.add_stream(codec.name, Fraction(25), options={**codec.options, "threads": "1"})
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuvj420p" if codec.name == "mjpeg" else "yuv420p"
        for frame in frames:
            small = cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
            writing.mux(stream.encode(av.VideoFrame.from_ndarray(small, format="bgr24")))
        writing.mux(stream.encode())
    file.seek(0)
    with av.open(file) as reading:
        decoded = [picture.to_ndarray(format="bgr24") for picture in reading.decode(video=0)]
    assert len(decoded) == len(frames), "no frame is lost"
    return decoded


def each_by_itself(make: MakeGuide) -> MakeGuides:
    """Return a function that makes the guides of frames one by one."""
    return lambda frames, seeds: {number: make(frames[number], seed) for number, seed in seeds.items()}


def of_proxy(codec: Codec, read: Read) -> MakeGuides:
    """Return a function that takes the guides of frames from a video of the whole clip."""

    def make(frames: Mapping[int, Image], seeds: Mapping[int, int]) -> dict[int, Image]:
        decoded = encode(read(max(seeds) + LOOK_AHEAD), codec)
        return {number: decoded[number] for number in seeds}

    return make


def kinds_of_clip(read: Read) -> dict[str, MakeGuides]:
    """Return all kinds of guides that can be made of the frames of a clip."""
    of_pictures = {name: each_by_itself(make) for name, make in PICTURES.items()}
    return of_pictures | {name: of_proxy(codec, read) for name, codec in CODECS.items()}
