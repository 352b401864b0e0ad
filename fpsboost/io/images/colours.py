"""Colours of images as tags of a video, and those of a video as metadata of images."""

import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.files import ImageMetadata, extension_of, metadata_of
from fpsboost.media import BT709, BT2020, LINEAR, SRGB, UNSPECIFIED, VideoTraits, primaries, traits_of_png, transfers
from fpsboost.remarks import Remarks

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
    untaggable = " and the ".join(_untaggable(chunks, tags))
    if untaggable:
        remarks.add("colours-without-tag", what=untaggable, file=path.name)
    return tags


def _untaggable(chunks: Mapping[bytes, bytes], tags: VideoTraits) -> Iterator[str]:
    """Yield what an image says of its colours, by the names of PNG's chunks, and tags of a video do not."""
    has_primaries = tags.color_primaries in primaries
    has_transfer = tags.color_transfer in transfers
    if b"iCCP" in chunks and not (has_primaries and has_transfer):
        yield "ICC profile"
    if b"cICP" in chunks and not (has_primaries and has_transfer):
        yield "code points"
    if b"cHRM" in chunks and not has_primaries:
        yield "chromaticities"
    if b"gAMA" in chunks and not has_transfer:
        yield "gamma"
    if chunks.get(b"cICP", b"")[3:] == b"\0":
        yield "limited range"


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
