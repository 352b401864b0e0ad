"""List of a video's frames in a file beside the parts, so that not every part has to read the whole video for it."""

from __future__ import annotations

import io
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from fpsboost.io.part_folder import INDEX_NAME
from fpsboost.io.staging import write_safely
from fpsboost.io.video.frame_index import EntryPoint, FrameIndex

NO_TIME = np.iinfo(np.int64).min


def write_index(folder: Path, identity: str, index: FrameIndex) -> None:
    """Write an index into the folder of all parts, unless it is there; nothing is lost where that is impossible.

    Parameters
    ----------
    folder : Path
    identity : str
        Identity of the video; see `fpsboost.io.staging.identify_files`.
    index : FrameIndex
    """
    points = [(point.number, point.pts, NO_TIME if point.dts is None else point.dts) for point in index.entry_points]
    data = io.BytesIO()
    np.savez_compressed(data, identity=identity, ticks=index.ticks, entry_points=np.array(points, np.int64))
    with suppress(OSError):
        if not (folder / INDEX_NAME).exists():
            write_safely(folder / INDEX_NAME, data.getvalue())


def read_index(folder: Path, identity: str) -> FrameIndex | None:
    """Read the index of a video with this identity; None if there is none, or it is damaged."""
    try:
        with np.load(folder / INDEX_NAME, allow_pickle=False) as stored:
            if str(stored["identity"]) != identity:
                return None
            points = [
                EntryPoint(number, pts, None if dts == NO_TIME else dts)
                for number, pts, dts in stored["entry_points"].reshape(-1, 3).tolist()
            ]
            return FrameIndex(stored["ticks"], points)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
