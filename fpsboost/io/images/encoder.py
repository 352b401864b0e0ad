"""Images encoded like those of their source, with its metadata, or the source's own files passed on.

Who encodes was chosen by measuring 1080p frames. OpenCV writes PNG: its own setting takes 70 ms with 8 bits and 150
with 16, where OpenImageIO takes 110 and 390, or 85 and 180 at its fastest, and goes through a file. Pillow writes JPEG
and WebP with EXIF and XMP as they are stored, the pixels of a JPEG as OpenImageIO does. OpenImageIO writes all others:
LZW with a predictor takes a third off an 8-bit TIFF; float TIFF stays uncompressed.
"""

import re
import struct
import tempfile
import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fpsboost.colour import with_red_and_blue_swapped
from fpsboost.errors import OutputError, applicable
from fpsboost.frame import Frame
from fpsboost.image import Image, type_names, view
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
from fpsboost.media import BT709, BT2020, LINEAR, SRGB, UNSPECIFIED, VideoTraits, primaries, traits_of_png, transfers
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

_chromaticities = {
    BT709: (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290),
    BT2020: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),  # Display P3
}
"""CIE 1931 x and y of red, green, blue and white, by the number of primaries in ITU-T H.273."""
_patches = np.array([[(255, 0, 0), (0, 255, 0), (0, 0, 255), (32, 32, 32), (128, 128, 128)]], np.uint8)
"""Red, green, blue and two grays, whose CIELab identifies an ICC profile's primaries and transfer function."""
_patches_of_primaries = {
    BT709: ((138, 81, 70), (224, 177, 81), (75, 68, 144)),
    BT2020: ((152, 117, 107), (219, 128, 109), (65, 74, 130)),
    12: ((143, 94, 99), (221, 149, 103), (79, 70, 140)),
}
"""The first three of these in CIELab, in Pillow's 8-bit encoding, by the number of primaries."""
_patches_of_transfers = {BT709: (50, 148), 4: (24, 138), 5: (7, 115), LINEAR: (107, 194), SRGB: (31, 137)}
"""Lightness of the two grays, likewise, by the number of the transfer function; 4 and 5 are gamma 2.2 and 2.8."""


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


def lost_metadata(extension: str, metadata: ImageMetadata, channels: int) -> list[str]:
    """Return the names of metadata that a type of file, such as ``.png``, cannot hold."""
    holds_words = extension in (".png", ".jpg", ".jpeg", ".webp")
    holds_most = holds_words or extension in (".tif", ".tiff")
    room = _room_in(extension) if holds_words else 0
    wanted = {
        "colour profile": bool(metadata.profile) and not (holds_most and metadata.profile_for(channels)),
        "colour tags": any(name in COLOUR_CHUNKS for name, _ in metadata.chunks) and extension != ".png",
        "resolution": metadata.dots_per_inch is not None and (extension == ".webp" or not holds_most),
        "EXIF data": len(metadata.exif) > room,
        "XMP data": len(metadata.xmp) > room,
        "OpenEXR attributes": metadata.has_exr_attributes and extension != ".exr",
    }
    return applicable(wanted)


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


def colours_of(
    remarks: Remarks, path: Path, metadata: ImageMetadata | None = None, *, displayed: bool = False
) -> VideoTraits:
    """Return the colour tags of a video made of images like this one, and add a remark on colours that have no tag.

    FFmpeg's decoder reads those of a PNG. OpenEXR and HDR are tagged as linear.

    Parameters
    ----------
    remarks : Remarks
        Remarks to add to.
    path : Path
        One of the images.
    metadata : ImageMetadata, optional
        Its metadata; read from the file without it.
    displayed : bool
        Whether OpenEXR and HDR are converted by the transfer function of sRGB, and so tagged.

    Returns
    -------
    VideoTraits
        Traits, in which all that the image does not declare is unspecified.
    """
    extension = extension_of(path.name)
    chunks = dict[bytes, bytes]()
    if extension in (".exr", ".hdr"):
        said = read_exr_header(path).parts[0].attributes if extension == ".exr" else {}
        points = said.get("chromaticities", _chromaticities[BT709])
        chunks[b"cHRM"] = b""
        number = _number_of(_chromaticities, points, 0.001)
        transfer = SRGB if displayed else LINEAR
        tags = VideoTraits(color_primaries=number, color_transfer=transfer)
    else:
        metadata = metadata or metadata_of(path)
        chunks |= metadata.chunks
        tags = traits_of_png(path) if chunks else VideoTraits()
        if metadata.profile and b"cICP" not in chunks:
            tags = _traits_of_profile(metadata.profile)
            chunks = {b"iCCP": metadata.profile}
    has_primaries = tags.color_primaries in primaries
    has_transfer = tags.color_transfer in transfers
    untaggable = {
        "ICC profile": b"iCCP" in chunks and not (has_primaries and has_transfer),
        "code points": b"cICP" in chunks and not (has_primaries and has_transfer),
        "chromaticities": b"cHRM" in chunks and not has_primaries,
        "gamma": b"gAMA" in chunks and not has_transfer,
        "limited range": chunks.get(b"cICP", b"")[3:] == b"\0",
    }
    words = " and the ".join(applicable(untaggable))
    if words:
        remarks.add("colours-without-tag", what=words, file=path.name)
    return tags


def _number_of(known: dict[int, Any], values: Any, tolerance: float) -> int:
    """Return the number whose values these are, within a tolerance; that of unspecified colours if there is none."""
    close = (number for number, those in known.items() if np.allclose(those, values, rtol=0, atol=tolerance))
    return next(close, UNSPECIFIED)


def _traits_of_profile(profile: bytes) -> VideoTraits:
    """Return the primaries and transfer function of an ICC profile, by its `cicp` tag, or by measuring.

    It is measured by converting a few colours to CIELab, because the name of a profile is arbitrary. What no number
    stands for is unspecified.
    """
    from PIL import Image, ImageCms  # noqa: PLC0415  # only who converts such images to a video waits for it

    said = re.search(rb"cicp\0{4}(..)", profile, re.DOTALL)
    if said:
        return VideoTraits(color_primaries=said[1][0], color_transfer=said[1][1])
    with suppress(ImageCms.PyCMSError, OSError):  # profiles of gray or of print, and damaged ones
        ours = ImageCms.getOpenProfile(BytesIO(profile))
        lab = ImageCms.createProfile("LAB")
        transform = ImageCms.buildTransform(ours, lab, "RGB", "LAB", ImageCms.Intent.RELATIVE_COLORIMETRIC)
        measured = np.asarray(ImageCms.applyTransform(Image.fromarray(_patches), transform))[0].astype(int)
        return VideoTraits(
            color_primaries=_number_of(_patches_of_primaries, measured[:3], 1),
            color_transfer=_number_of(_patches_of_transfers, measured[3:, 0], 1),
        )
    return VideoTraits()


def metadata_of_video(traits: VideoTraits) -> ImageMetadata:
    """Return a video's colours as metadata of PNG: cICP, mDCV and cLLI; an unknown part of mDCV is 0."""
    display = traits.mastering_display
    light = traits.light_level
    chunks: list[tuple[bytes, bytes]] = []
    if traits.code_points != (UNSPECIFIED, UNSPECIFIED):
        chunks.append((b"cICP", bytes((*traits.code_points, 0, 1))))  # RGB of full range
    if display is not None:
        points = display.colours or [(0, 0)] * 4
        numbers = [50_000 * part for point in points for part in point]
        numbers += [10_000 * (limit or 0) for limit in (display.brightest, display.darkest)]
        chunks.append((b"mDCV", struct.pack(">8H2I", *map(round, numbers))))
    if light is not None:
        levels = struct.pack(">2I", light.brightest_pixel * 10_000, light.brightest_frame * 10_000)
        chunks.append((b"cLLI", levels))
    return ImageMetadata(chunks=tuple(chunks))


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
        lost = lost_metadata(extension_of(path.name), self._metadata, frame.array.shape[2])
        for item in lost:
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
