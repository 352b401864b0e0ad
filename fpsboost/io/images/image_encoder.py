"""Encode images like those of their source, with its metadata, or pass the source's own files on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fpsboost.frame import Frame
from fpsboost.image import Image
from fpsboost.io.images.exr_header import ExrHeader, parse_exr_header
from fpsboost.io.images.exr_layers import contents_of
from fpsboost.io.images.files import check_format, content_of, encode_image, extension_of, losses
from fpsboost.io.images.kinds import stored_otherwise
from fpsboost.io.images.metadata import ImageMetadata, can_pass, lost_metadata, metadata_of
from fpsboost.io.images.passes import encode_like, losses_like
from fpsboost.io.images.sequence import NumberedImages


@dataclass(frozen=True)
class ImageFile:
    """The file that a frame was read from: its `Frame.original`."""

    path: Path


class ImageEncoder:
    """Encoder of frames into image files.

    Parameters
    ----------
    name : str
        Name of the output in messages.
    images : NumberedImages or None
        Images of the source; None if it is a video.
    anew : bool
        Whether frames are numbered anew, so that motion vectors lead to other numbers.

    Attributes
    ----------
    remarks : list of str
        Sentences about what the files cannot hold.

    Raises
    ------
    InputError
        The first image cannot be read again.
    """

    def __init__(self, name: str, images: NumberedImages | None, *, anew: bool) -> None:
        self._path, self._anew = name, anew
        self._half = images is None or not images.needs_float
        self._metadata = ImageMetadata()
        self._exr: ExrHeader | None = None
        self._layers = () if images is None else images.layers
        self._kinds = set[str]()
        self._followed: Path | None = None
        self.remarks: list[str] = []
        if images is not None:
            self._follow(*_read_again(images.files[0]))

    def check(self, path: Path, image: Image) -> None:
        """Check that a file can hold an image, and remark on what it loses.

        Raises
        ------
        OutputError
            It cannot.
        """
        check_format(path, image)
        self.remarks += [remark for remark in losses(path, image) if remark not in self.remarks]

    def content(self, path: Path, frame: Frame) -> bytes:
        """Return the bytes to write: of an original into a file of its own type that file, else an encoded image.

        Raises
        ------
        InputError
            An original cannot be read again.
        OutputError
            The file type cannot hold the image.
        """
        if isinstance(frame.original, ImageFile):
            source, data = _read_again(frame.original.path)
            self._follow(source, data)
            is_same = _one_name(extension_of(source.name)) == _one_name(extension_of(path.name))
            passes = is_same and can_pass(data)
            self._remark_on_kind(source, data, frame.array, passes=passes)
            if passes:
                return data
        elif isinstance(frame.preceding, ImageFile) and frame.preceding.path != self._followed:
            self._follow(*_read_again(frame.preceding.path))
        for lost in lost_metadata(extension_of(path.name), self._metadata, frame.array.shape[2]):
            remark = f"{self._path} cannot hold the {lost} of its source; left out."
            self.remarks += [remark] * (remark not in self.remarks)
        if self._exr is not None and extension_of(path.name) == ".exr":
            self._remark_on_layers(self._exr)
            return encode_like(self._exr, frame.image)
        return encode_image(path, frame.array, half=self._half, metadata=self._metadata)

    def passes_in_place(self, path: Path, image: Image) -> None:
        """Note an original that stays where it is.

        Raises
        ------
        InputError
            It cannot be read again.
        """
        _, data = _read_again(path)
        self._follow(path, data)
        self._remark_on_kind(path, data, image, passes=True)

    def _follow(self, source: Path, data: bytes) -> None:
        """Have the frames made from here on say what an original says."""
        self._followed = source
        self._metadata = metadata_of(source, data)
        if extension_of(source.name) == ".exr":
            self._exr = parse_exr_header(source, data)

    def _remark_on_layers(self, header: ExrHeader) -> None:
        """Remark, once, what the frames between do not have of the originals."""
        lost = [f"The originals {each}." for each in losses_like(header)]
        made = {name for layer in self._layers for name in layer.channels}
        contents = contents_of(header)
        left_out = [layer.name for layer in contents.layers if not made.issuperset(layer.channels)]
        if left_out:
            lost.append("The originals passed with all their layers, of which the frames between have fewer.")
        if self._anew and any(layer.has_vectors for layer in self._layers):
            lost.append(
                "Motion vectors lead from one original to the next, also in the frames between, as the originals' do."
            )
        self.remarks += [remark for remark in lost if remark not in self.remarks]

    def _remark_on_kind(self, source: Path, data: bytes, image: Image, *, passes: bool) -> None:
        """Remark, once per storage kind, that frames are written differently from the originals."""
        how = stored_otherwise(data, image.shape[2])
        if not how or how in self._kinds:
            return
        self._kinds.add(how)
        written = {1: "gray", 3: "RGB"}.get(image.shape[2], "RGB with alpha")
        which = "the frames between" if passes else "all frames"
        self.remarks.append(f"{source.name} and its like are stored {how}; {which} were written as {written}.")


def _read_again(path: Path) -> tuple[Path, bytes]:
    """Read an input again that could be read before; return its path and content."""
    return path, content_of(path, "leave the input as it is until all is done")


def _one_name(extension: str) -> str:
    """Return the shorter of two extensions that stand for one type of file."""
    return {".jpeg": ".jpg", ".tiff": ".tif"}.get(extension, extension)
