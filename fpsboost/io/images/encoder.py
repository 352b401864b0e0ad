"""Images encoded like those of their source, with its metadata, or the source's own files passed on.

Who encodes was chosen by measuring 1080p frames. OpenCV writes PNG: its own setting takes 70 ms with 8 bits and 150
with 16, where OpenImageIO takes 110 and 390, or 85 and 180 at its fastest, and goes through a file. Pillow writes JPEG
and WebP with EXIF and XMP as they are stored, the pixels of a JPEG as OpenImageIO does. OpenImageIO writes all others:
LZW with a predictor takes a third off an 8-bit TIFF; float TIFF stays uncompressed.
"""

import struct
import tempfile
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fpsboost.colour import with_red_and_blue_swapped
from fpsboost.errors import OutputError
from fpsboost.frame import Frame
from fpsboost.image import Image, type_names, view
from fpsboost.io.images.colours import metadata_of_video
from fpsboost.io.images.exr import ExrHeader, encode_exr, read_exr_header
from fpsboost.io.images.files import (
    COLOUR_CHUNKS,
    EXIF_MARK,
    PNG_SIGNATURE,
    ImageMetadata,
    content_of,
    extension_of,
    keeps_alpha,
    metadata_of,
    types_kept,
)
from fpsboost.io.images.layers import encode_like, remark_on_losses
from fpsboost.io.images.library import image_library
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.media import VideoTraits
from fpsboost.remarks import Remarks

INCH = 0.0254  # metres
# maximum size of EXIF or XMP, bytes: in a JPEG, elsewhere
MAX_SEGMENT = 65533
MAX_FILE = 2**31
_xmp_mark = b"http://ns.adobe.com/xap/1.0/\0"
_short_names = {".jpeg": ".jpg", ".tiff": ".tif"}
_pillow_types: dict[str, tuple[str, dict[str, Any]]] = {
    **dict.fromkeys((".jpg", ".jpeg"), ("JPEG", {"quality": 95})),
    ".webp": ("WEBP", {"lossless": True, "exact": True, "quality": 70}),  # of the search for a small file
}


def encode_image(path: Path, image: Image, *, half: bool = True, metadata: ImageMetadata = ImageMetadata()) -> bytes:
    """Encode an image to the content of a file.

    Parameters
    ----------
    path : Path
        Name of the file, whose suffix determines the type.
    image : NDArray
        Image, (H, W, C), of a dtype and channels that `ImageEncoder.check` accepts.
    half : bool
        Write OpenEXR with 16 bits a number instead of 32.
    metadata : ImageMetadata, optional
        Metadata to store, as far as the type holds it.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    OutputError
        The library of this type of file refuses the image.
    """
    extension = path.suffix.lower()
    if extension == ".exr":
        names = {1: "Y", 2: "YA", 3: "BGR", 4: "BGRA"}[image.shape[2]]
        return encode_exr({name: image[..., i] for i, name in enumerate(names)}, half=half)
    try:
        if extension in (".png", ".bmp"):
            done, data = cv2.imencode(extension, image)
            if not done:
                raise ValueError(extension)
            return into_png(data.tobytes(), metadata, image.shape[2]) if extension == ".png" else data.tobytes()
        if extension in _pillow_types:
            return _encode_by_pillow(extension, image, metadata)
        return _encode_by_openimageio(extension, image, metadata)
    except (cv2.error, LookupError, OSError, ValueError) as error:
        raise OutputError(f"{path} cannot be encoded ({view(image).describe()}); try .png or .tif.") from error


def _encode_by_pillow(extension: str, image: Image, metadata: ImageMetadata) -> bytes:
    """Encode an image as JPEG or WebP, by Pillow."""
    from PIL import Image as Pictures  # noqa: PLC0415  # only who writes such files waits for it

    height, width, channels = image.shape
    mode, stored = {1: ("L", "L"), 3: ("RGB", "BGR"), 4: ("RGBA", "BGRA")}[channels]
    picture = Pictures.frombuffer(mode, (width, height), np.ascontiguousarray(image), "raw", stored, 0, 1)
    kind, options = _pillow_types[extension]
    file = BytesIO()
    picture.save(file, kind, **options, **pillow_options(extension, metadata, channels))
    return file.getvalue()


def _encode_by_openimageio(extension: str, image: Image, metadata: ImageMetadata) -> bytes:
    """Encode an image as TIFF, DPX, TGA, JPEG XL or HDR, by OpenImageIO, without times and names of files."""
    library = image_library()
    height, width, channels = image.shape
    if extension == ".hdr" and channels == 1:
        image = np.repeat(image, 3, axis=2)
        channels = 3
    spec = library.ImageSpec(width, height, channels, "float" if image.dtype == np.float32 else str(image.dtype))
    is_tiff = extension in (".tif", ".tiff")
    profile = metadata.profile_for(channels)
    attributes: dict[str, Any] = {"oiio:UnassociatedAlpha": int(image.dtype != np.float32)}
    if extension == ".dpx" and image.dtype == np.uint16 and metadata.bits:
        attributes["oiio:BitsPerSample"] = metadata.bits
    if is_tiff:
        attributes["compression"] = "none" if image.dtype == np.float32 else "lzw"
        attributes |= {"DateTime": "", "Orientation": metadata.orientation}  # else the library writes the current time
        if metadata.dots_per_inch is not None:
            across, down = metadata.dots_per_inch
            attributes |= {"ResolutionUnit": "in", "XResolution": across, "YResolution": down}
            attributes["PixelAspectRatio"] = down / across  # which the library would take for 1
        if profile:
            spec.attribute("ICCProfile", library.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8))
    for name, value in attributes.items():
        spec.attribute(name, value)
    image = with_red_and_blue_swapped(image)
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / f"image{extension}")
        file = library.ImageOutput.create(name)
        if not (file.open(name, spec) and file.write_image(np.ascontiguousarray(image)) and file.close()):
            raise ValueError(file.geterror())
        data = Path(name).read_bytes()
    if extension == ".dpx":
        data = data[:36] + bytes(124) + data[160:]  # the name of the file and the time
    return data


def lost_metadata(extension: str, metadata: ImageMetadata, channels: int) -> Iterator[str]:
    """Yield the names of metadata that a type of file, such as ``.png``, cannot hold."""
    holds_words = extension in (".png", ".jpg", ".jpeg", ".webp")
    holds_most = holds_words or extension in (".tif", ".tiff")
    room = _room_in(extension) if holds_words else 0
    if metadata.profile and not (holds_most and metadata.profile_for(channels)):
        yield "colour profile"
    if extension != ".png" and any(name in COLOUR_CHUNKS for name, _ in metadata.chunks):
        yield "colour tags"
    if metadata.dots_per_inch is not None and (extension == ".webp" or not holds_most):
        yield "resolution"
    if len(metadata.exif) > room:
        yield "EXIF data"
    if len(metadata.xmp) > room:
        yield "XMP data"
    if metadata.has_exr_attributes and extension != ".exr":
        yield "OpenEXR attributes"


def pillow_options(extension: str, metadata: ImageMetadata, channels: int) -> dict[str, Any]:
    """Return the options by which Pillow puts metadata into a JPEG or a WebP, as far as they hold it."""
    room = _room_in(extension)
    return {
        "icc_profile": metadata.profile_for(channels),
        "exif": EXIF_MARK + metadata.exif if 0 < len(metadata.exif) <= room else b"",
        "xmp": metadata.xmp if len(metadata.xmp) <= room else b"",
        "dpi": tuple(min(round(dots), 65535) for dots in metadata.dots_per_inch or (0, 0)),  # 0 where none is known
    }


def _room_in(extension: str) -> int:
    """Return the maximum size of EXIF or XMP in a type of file, bytes."""
    return MAX_SEGMENT - len(_xmp_mark) if extension in (".jpg", ".jpeg") else MAX_FILE


def into_png(data: bytes, metadata: ImageMetadata, channels: int) -> bytes:
    """Put metadata into a PNG that OpenCV has encoded, behind its header."""
    profile = metadata.profile_for(channels)
    dots = metadata.dots_per_inch
    bodies = {  # by the names of chunks, empty for those that are not written
        b"iCCP": b"ICC profile\0\0" + zlib.compress(profile) if profile else b"",
        b"pHYs": b"" if dots is None else struct.pack(">IIB", *(round(each / INCH) for each in dots), 1),
        **dict(metadata.chunks),
        b"eXIf": metadata.exif,
        b"iTXt": b"XML:com.adobe.xmp\0\0\0\0\0" + metadata.xmp if metadata.xmp else b"",
    }
    chunks = b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in bodies.items()
        if body
    )
    behind_header = len(PNG_SIGNATURE) + 25
    return data[:behind_header] + chunks + data[behind_header:]


class ImageEncoder:
    """Encoder of frames into image files; `Frame.original` of a source of images is the path of its file.

    `remarks` say what the files cannot hold.

    Parameters
    ----------
    name : str
        The output in messages.
    images : NumberedImages or None
        Images of the source, whose metadata frames get; None for a video or an animation.
    colours : VideoTraits
        Colours of a video or an animation.
    anew : bool
        Whether frames are numbered anew, so that motion vectors lead to other numbers.
    """

    def __init__(self, name: str, images: NumberedImages | None, colours: VideoTraits, *, anew: bool) -> None:
        self._path = name
        self._anew = anew
        self._half = images is None  # float images of other types would lose precision
        self._metadata = metadata_of_video(colours)
        self._exr: ExrHeader | None = None
        self._layers = () if images is None else images.layers
        self._followed: Path | None = None
        self.remarks = Remarks()
        if images is not None:
            self._follow(images.files[0])

    def check(self, path: Path, image: Image) -> None:
        """Raise `OutputError` unless a type of file can hold an image with its depth and alpha; remark on losses."""
        extension = path.suffix.lower()
        kind = type_names[image.dtype]
        if image.dtype not in types_kept[extension]:
            other = ".tif or .exr" if image.dtype == np.float32 else ".png or .tif"
            raise OutputError(f"{path.name} cannot hold {kind} images; use {other}, as in shot_######{other[-4:]}.")
        if image.shape[2] == 4 and not keeps_alpha(extension):
            raise OutputError(f"{path.name} cannot hold alpha; use .png or .tif, as in shot_######.png.")
        name = {".webp": "WebP", ".hdr": "HDR"}.get(extension)
        if name is not None and image.shape[2] == 1:
            self.remarks.add("gray-as-colour", format=name)

    def content(self, path: Path, frame: Frame) -> bytes:
        """Return the content of a file for a frame.

        An original that stays of its type is returned as its file is, if that displays correctly; other frames are
        encoded, with the metadata of the original before them. Raises `OutputError` if a library refuses the image, and
        `InputError` if the file of the original cannot be read any more.
        """
        if isinstance(frame.original, Path):
            source = frame.original
            data = content_of(source, "leave the input as it is until all is done")
            ours, theirs = (_short_names.get(name, name) for name in map(extension_of, (path.name, source.name)))
            if self.passes(source, is_same=ours == theirs):
                return data
        elif isinstance(frame.preceding, Path) and frame.preceding != self._followed:
            self._follow(frame.preceding)
        for item in lost_metadata(extension_of(path.name), self._metadata, frame.array.shape[2]):
            self.remarks.add("metadata-not-held", name=self._path, what=item)
        if self._exr is not None and extension_of(path.name) == ".exr":
            remark_on_losses(self.remarks, self._exr, self._layers, anew=self._anew)
            return encode_like(self._exr, frame.image)
        return encode_image(path, frame.array, half=self._half, metadata=self._metadata)

    def passes(self, source: Path, *, is_same: bool) -> bool:
        """Return whether an original can be copied as its file; `is_same` if the output has its type.

        Remarks, once, if the colours of originals differ from those of encoded frames.
        """
        self._follow(source)
        if self._metadata.other_colours:
            self.remarks.add("colours-as-rgb", name=self._path, colours=self._metadata.other_colours)
        return is_same and self._metadata.can_pass

    def _follow(self, source: Path) -> None:
        """Use the metadata of an original for the frames encoded from here on."""
        self._followed = source
        self._metadata = metadata_of(source)
        if extension_of(source.name) == ".exr":
            self._exr = read_exr_header(source)
