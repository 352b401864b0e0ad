"""One image file as a template: others are read with the same layers, and encoded with its type and metadata."""

from pathlib import Path

from fpsboost.image import view
from fpsboost.io.images.encoder import encode_image
from fpsboost.io.images.exr import read_exr_header
from fpsboost.io.images.files import extension_of, metadata_of, read_image
from fpsboost.io.images.layers import ALL, Passes, encode_like
from fpsboost.layered import FrameImage


class ImageTemplate:
    """An image file with all its layers, like which others are read and encoded.

    Parameters
    ----------
    path : Path
        The file, which must be readable.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._passes = Passes.chosen(path, ALL) if extension_of(path.name) == ".exr" else None

    def read(self, path: Path) -> FrameImage:
        """Read an image, from OpenEXR with the same layers; raise `InputError` if it has others."""
        if self._passes is None or extension_of(path.name) != ".exr":
            return read_image(path)
        return self._passes.read(path, None)

    def can_be(self, path: Path) -> bool:
        """Return whether a file may take the place of this one as it is: of its type, and shown like what is read."""
        return path.suffix == self._path.suffix and metadata_of(path).can_pass

    def encode(self, image: FrameImage) -> bytes:
        """Return the content of a file of this type, with the metadata of this one."""
        if self._passes is None:
            return encode_image(self._path, view(image).array(), metadata=metadata_of(self._path))
        return encode_like(read_exr_header(self._path), image)
