"""Writers of what is known of the frames of a conversion: confidence and motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fpsboost.frame import Frame, PairMotion
from fpsboost.io.images.exr import encode_exr
from fpsboost.io.images.files import encode_image
from fpsboost.io.new_output import StagedFiles
from fpsboost.io.side.names import FileNames
from fpsboost.io.vectors.flow_colours import flow_picture
from fpsboost.io.vectors.flow_files import encode_flow
from fpsboost.io.vectors.folder import BACKWARD, FORWARD

PICTURE, EXR, FLO = ".png", ".exr", ".flo"


class SideWriter(Protocol):
    """Contract: writer of files about the frames of a conversion."""

    files: StagedFiles

    @property
    def remarks(self) -> list[str]:
        """Sentences about what was not written."""
        ...

    def write(self, frame: Frame) -> None:
        """Write what there is about the next frame of the output."""
        ...

    def finish(self) -> None:
        """Write what has waited for a next frame."""
        ...


class ConfidenceWriter:
    """Writer of a map of confidence for every frame that has one.

    Parameters
    ----------
    names : FileNames
        By the place of a frame in the output.
    overwrite : bool
        Replace existing files.

    Raises
    ------
    OutputError
        See `StagedFiles`.
    """

    suffixes = (PICTURE, EXR)
    """Types of files."""

    def __init__(self, names: FileNames, *, overwrite: bool) -> None:
        self.files = StagedFiles(
            names.path, names.folder, names.namings([names.suffix]), overwrite=overwrite, alone=not names.is_pattern
        )
        self._names, self._place = names, 0

    @property
    def remarks(self) -> list[str]:
        """See `SideWriter.remarks`."""
        return self.files.remarks

    def write(self, frame: Frame) -> None:
        """See `SideWriter.write`."""
        place, self._place = self._place, self._place + 1
        if frame.confidence is None:
            return
        values: NDArray[Any] = frame.confidence[..., np.newaxis]
        if self._names.suffix == PICTURE:
            values = np.rint(values.clip(0, 1) * 255).astype(np.uint8)
        path = Path(self._names.stem(place) + self._names.suffix)
        self.files.write(path.name, encode_image(path, values))

    def finish(self) -> None:
        """See `SideWriter.finish`."""


class MotionWriter:
    """Writer of the motion of source frames to the previous and to the next one, and of pictures of it.

    If frames are made on one side of a frame alone (at both ends of a clip and of a scene), its motion is extrapolated
    to the other side, because readers ask for both.

    Parameters
    ----------
    names : FileNames
        By the place of a frame in the source.
    overwrite : bool
        Replace existing files.

    Raises
    ------
    OutputError
        See `StagedFiles`.
    """

    suffixes = (FLO, EXR)
    """Types of files."""

    def __init__(self, names: FileNames, *, overwrite: bool) -> None:
        endings = [str(Path(ending).with_suffix(PICTURE)) for ending in (BACKWARD, FORWARD)]
        endings += [EXR] if names.suffix == EXR else [BACKWARD, FORWARD]
        self.files = StagedFiles(
            names.path, names.folder, names.namings(endings), overwrite=overwrite, alone=not names.is_pattern
        )
        self._names = names
        self._last: PairMotion | None = None
        self._is_still: bool | None = None

    @property
    def remarks(self) -> list[str]:
        """See `SideWriter.remarks`."""
        still = [f"No motion was found: all vectors in {self._names.path} are 0."] if self._is_still else []
        return [*self.files.remarks, *still]

    def write(self, frame: Frame) -> None:
        """See `SideWriter.write`."""
        motion = frame.motion
        if motion is None:
            return
        if self._last is not None and self._last.number1 == motion.number0:
            self._write_vectors(motion.number0, self._last.flow10, motion.flow01)
        else:
            self.finish()
            self._write_vectors(motion.number0, -motion.flow01, motion.flow01)
        self._last = motion
        self._is_still = self._is_still is not False and not motion.flow01.any() and not motion.flow10.any()

    def finish(self) -> None:
        """See `SideWriter.finish`."""
        if self._last is not None:
            self._write_vectors(self._last.number1, self._last.flow10, -self._last.flow10)
            self._last = None

    def _write_vectors(self, place: int, backward: NDArray[Any], forward: NDArray[Any]) -> None:
        stem = self._names.stem(place)
        if self._names.suffix == EXR:
            x, y, z, w = *np.moveaxis(backward, -1, 0), *np.moveaxis(forward, -1, 0)
            # Blender: the place in the previous frame minus that here, that here minus that in the next, y up
            self.files.write(stem + EXR, encode_exr({"X": x, "Y": -y, "Z": -z, "W": w}, half=False))
        for ending, flow in ((BACKWARD, backward), (FORWARD, forward)):
            if self._names.suffix == FLO:
                self.files.write(stem + ending, encode_flow(flow))
            picture = Path(stem + ending).with_suffix(PICTURE)
            self.files.write(picture.name, encode_image(picture, flow_picture(flow)))
