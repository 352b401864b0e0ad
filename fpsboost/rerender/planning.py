"""Plans of regions to render: from images and a budget to ``plan.json`` with rectangles, and a mask for every frame.

Rectangles are ``[x, y, width, height]`` in pixels from the upper left corner, y down. Blender's render border is in
fractions of the frame with y up, and fractions of a pixel are cut off. In a frame of W x H pixels it is ``min_x = (x +
0.5) / W``, ``max_x = (x + width + 0.5) / W``, ``min_y = (H - y - height + 0.5) / H`` and ``max_y = (H - y + 0.5) / H``.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from fpsboost import InputError, Interpolator, MemoryLimit, PathName, VectorFolder, find_method
from fpsboost.extension import (
    available_cores,
    checked,
    content_of,
    new_folder,
    open_source,
    read_image,
    run_in_parallel,
    stands_for_images,
    write_safely,
)
from fpsboost.rerender import PlanOptions
from fpsboost.rerender.regions import Rectangle, TileGrid, choose_regions, partition
from fpsboost.rerender.score import expect_errors

PLAN_FILE = "plan.json"
"""Name of the plan in its folder."""
VERSION = 1
"""Version of the format of plans."""
RENDERED = 255
"""Value of the pixels of a mask that are to be rendered; all others are 0."""

MASK_DIGITS = 4
"""Minimum number of digits in the names of masks."""


@dataclass(frozen=True)
class PlannedFrame:
    """Regions of one frame that are to be rendered."""

    number: int
    """Number of the frame."""
    regions: tuple[Rectangle, ...]
    """Rectangles that do not overlap, in pixels; none where nothing is to be rendered."""
    whole: bool
    """Whether all of the frame is to be rendered."""
    expected_error: float
    """Expected mean squared error before rendering, in levels of 255 squared."""
    remaining_error: float
    """Expected mean squared error after rendering, in levels of 255 squared."""

    def mask(self, height: int, width: int) -> np.ndarray:
        """Return the pixels to render, (height, width) bool."""
        mask = np.zeros((height, width), bool)
        for region in self.regions:
            mask[region.part] = True
        return mask


@dataclass(frozen=True)
class RerenderPlan:
    """Regions of interpolated frames that are worth rendering."""

    width: int
    """Width of a frame, pixels."""
    height: int
    """Height of a frame, pixels."""
    tile: int
    """Side of the tiles that regions consist of, pixels."""
    frames: tuple[PlannedFrame, ...]
    """All interpolated frames, in order."""

    @property
    def rendered_share(self) -> float:
        """Share of all pixels of these frames that is to be rendered."""
        pixels = sum(region.area for frame in self.frames for region in frame.regions)
        return pixels / (self.width * self.height * len(self.frames))

    @property
    def expected_error(self) -> float:
        """Expected mean squared error of all frames before rendering, in levels of 255 squared."""
        return float(np.mean([frame.expected_error for frame in self.frames]))

    @property
    def remaining_error(self) -> float:
        """Expected mean squared error of all frames after rendering, in levels of 255 squared."""
        return float(np.mean([frame.remaining_error for frame in self.frames]))

    def as_json(self) -> dict[str, Any]:
        """Return plain data in the form of ``plan.json``."""
        return {
            "version": VERSION,
            "width": self.width,
            "height": self.height,
            "tile": self.tile,
            "numbers": [frame.number for frame in self.frames],
            "frames": [{**asdict(frame), **_errors_of(frame)} for frame in self.frames],
            "totals": {
                "frames": sum(bool(frame.regions) for frame in self.frames),
                "whole_frames": sum(frame.whole for frame in self.frames),
                "regions": sum(len(frame.regions) for frame in self.frames),
                "rendered_share": round(self.rendered_share, 6),
                **_errors_of(self),
            },
        }

    def write(self, folder: Path) -> None:
        """Write ``plan.json`` and the masks into a folder."""
        for frame in self.frames:
            path = self._mask_file(folder, frame.number)
            mask = frame.mask(self.height, self.width) * np.uint8(RENDERED)
            write_safely(path, cv2.imencode(".png", mask)[1].tobytes())
        write_safely(folder / PLAN_FILE, json.dumps(self.as_json(), indent=1).encode())

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a plan from its folder.

        Raises
        ------
        InputError
            It is missing, damaged, of a later version, or a mask differs from the rectangles.
        """
        path = folder / PLAN_FILE
        data = content_of(path, "name a folder that fpsboost plan has written")
        try:
            values = json.loads(data)
            if values["version"] != VERSION:
                raise InputError(f"{path} is of version {values['version']}, and {VERSION} can be read; plan again.")
            frames = tuple(_frame(each, values["width"], values["height"]) for each in values["frames"])
            plan = cls(values["width"], values["height"], values["tile"], frames)
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path} is damaged or no plan; plan again.") from error
        plan._check_masks(folder)
        return plan

    def _mask_file(self, folder: Path, number: int) -> Path:
        """Return the file of a frame's mask, whose number has as many digits as the longest."""
        digits = max(MASK_DIGITS, *(len(str(frame.number)) for frame in self.frames))
        return folder / f"mask_{number:0{digits}d}.png"

    def _check_masks(self, folder: Path) -> None:
        """Raise `InputError` if a mask is missing, or differs from the rectangles."""
        for frame in self.frames:
            path = self._mask_file(folder, frame.number)
            content_of(path, "plan again, or put it back")
            mask = read_image(path)
            height, width = mask.shape[:2]
            if (height, width) != (self.height, self.width):
                raise InputError(
                    f"{path} has {width}x{height} pixels and its plan {self.width}x{self.height}; plan again."
                )
            if ((mask[..., 0] > 0) != frame.mask(height, width)).any():
                raise InputError(f"{path} marks other pixels than the rectangles of {PLAN_FILE}; plan again.")


def _errors_of(item: PlannedFrame | RerenderPlan) -> dict[str, float]:
    """Return expected and remaining error as plain data."""
    return {"expected_error": round(item.expected_error, 4), "remaining_error": round(item.remaining_error, 4)}


def _frame(data: Mapping[str, Any], width: int, height: int) -> PlannedFrame:
    """Read a frame of a plan; raise ValueError, KeyError or TypeError if the data is not one."""
    regions = tuple(Rectangle(*map(int, region)) for region in data["regions"])
    for each in regions:
        inside = each.x >= 0 and each.y >= 0 and each.x + each.width <= width and each.y + each.height <= height
        if not inside or each.width < 1 or each.height < 1:
            raise ValueError("a region outside of the frame")
    return PlannedFrame(
        int(data["number"]), regions, bool(data["whole"]), float(data["expected_error"]), float(data["remaining_error"])
    )


MIN_IMAGES = 3
"""Smallest number of images: one is hidden between two others to learn how large errors are."""

LEVELS = 255**2
"""Square of the levels of 8 bits, in which plans give errors."""


@checked
def plan_rerender(
    input: PathName, folder: PathName, options: PlanOptions | None = None, *, method: str | Interpolator = "nlm"
) -> RerenderPlan:
    """Find the regions of the frames between rendered images that are most likely wrong, and write them to a folder.

    Parameters
    ----------
    input : str or os.PathLike
        A folder or a pattern of images.
    folder : str or os.PathLike
        A new folder for ``plan.json`` and a mask for every interpolated frame.
    options : PlanOptions, optional
        Budget and tiles.
    method : str or Interpolator
        Method that interpolates the frames.

    Raises
    ------
    InputError
        The input is not a folder of images, or these cannot be read or are fewer than three.
    OutputError
        The folder exists and is not empty, or cannot be written.

    Examples
    --------
    >>> plan_rerender("renders/", "plan/")  # doctest: +SKIP
    """
    options = options or PlanOptions()
    interpolator = find_method(method)
    check_images(os.fspath(input))
    with new_folder(Path(folder)) as unfinished, open_source(os.fspath(input)) as source:
        info = source.info
        images = source.stream_info.images
        if images is None or len(images.files) < MIN_IMAGES:
            raise InputError(
                f"{info.name} holds {info.frame_count} images, and a plan needs {MIN_IMAGES} at least: it hides one "
                "between two others to learn how large errors are."
            )
        factor = options.factor or (images.step if images.step > 1 else 2)
        first, step = images.numbers_for(Fraction(factor)) or (images.first_number, 1)
        numbers = [first + step * place for place in range((len(images.files) - 1) * factor + 1)]
        match = partial(VectorFolder.matched, numbers=numbers, must_match=images.step > 1)
        interpolator = interpolator.with_vectors(match)
        grid = TileGrid(info.height, info.width, options.tile)
        threads = MemoryLimit().affordable_threads(info.width, info.height, available_cores())
        with run_in_parallel(threads) as in_order:
            expected, scenes = expect_errors(source, interpolator, factor, grid, in_order)
        pixels = info.height * info.width
        masks = choose_regions(expected, grid, options.budget * pixels * len(expected), scenes)
        between = [number for place, number in enumerate(numbers) if place % factor]
        frames = []
        for number, errors, mask in zip(between, expected * grid.areas * LEVELS / pixels, masks, strict=True):
            regions = tuple(map(grid.in_pixels, partition(mask)))
            whole = regions == (Rectangle(0, 0, info.width, info.height),)
            frames.append(PlannedFrame(number, regions, whole, float(errors.sum()), float(errors[~mask].sum())))
        plan = RerenderPlan(info.width, info.height, options.tile, tuple(frames))
        plan.write(unfinished)
    return plan


def check_images(path: str) -> None:
    """Raise `InputError` unless a path stands for images."""
    if stands_for_images(path):
        return
    if not Path(path).exists():
        raise InputError(f"{path or 'An input without a name'} does not exist; check the name.")
    raise InputError(f"{path} is not a folder or pattern of images, which plans need; write its frames as images.")
