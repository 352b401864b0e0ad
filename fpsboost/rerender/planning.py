"""Plans of what to render: from images and a budget to masks and rectangles in a folder."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np

from fpsboost import InputError, Interpolator, MemoryLimit, VectorFolder, find_method
from fpsboost.io.images.source import ImageSource
from fpsboost.io.new_output import check_new_folder, new_folder
from fpsboost.io.opening import ASSUMED_IMAGE_RATE, stands_for_images
from fpsboost.rerender.options import PlanOptions, RenderBudget
from fpsboost.rerender.plan_file import PlannedFrame, RerenderPlan
from fpsboost.rerender.regions import Rectangle, RenderCost, TileGrid, choose_regions, partition
from fpsboost.rerender.score import expect_errors
from fpsboost.threads import available_cores, run_in_parallel

DEFAULT_BUDGET = RenderBudget(0.1)
MIN_IMAGES = 3
"""Smallest number of images: one is hidden between two others to learn how large errors are."""

LEVELS = 255**2


def plan_rerender(
    input: str, folder: str, options: PlanOptions | None = None, *, method: str | Interpolator = "nlm"
) -> RerenderPlan:
    """Find the regions of the frames between rendered images that are most likely wrong, and write them to a folder.

    Parameters
    ----------
    input : str
        A folder or a pattern of images.
    folder : str
        A new folder for ``plan.json`` and a mask for every interpolated frame.
    options : PlanOptions, optional
        Budget, costs and tiles.
    method : str or Interpolator
        Method that interpolates the frames.

    Returns
    -------
    RerenderPlan

    Raises
    ------
    InputError
        The input is no folder of images, or these cannot be read or are fewer than three.
    OutputError
        The folder exists and is not empty, or cannot be written.

    Examples
    --------
    >>> plan_rerender("renders/", "plan/")  # doctest: +SKIP
    """
    options = options or PlanOptions()
    interpolator = find_method(method)
    with open_images(input, folder) as source:
        images, info = source.images, source.info
        factor = options.factor or (images.step if images.step > 1 else 2)
        first, step = images.numbers_for(Fraction(factor)) or (images.first_number, 1)
        numbers = [first + step * place for place in range((len(images.files) - 1) * factor + 1)]
        match = partial(VectorFolder.matched, numbers=numbers, must_match=images.step > 1)
        interpolator, _ = interpolator.with_vectors(match)
        interpolator = replace(interpolator, duplicates=None)
        interpolator.compile_for(next(iter(source)).image)
        grid = TileGrid(info.height, info.width, options.tile)
        threads = MemoryLimit().affordable_threads(info.width, info.height, available_cores())
        with run_in_parallel(threads) as in_order:
            expected = expect_errors(source, interpolator, factor, grid, in_order)
    pixels = info.height * info.width
    cost = _cost(options, pixels, len(expected.errors))
    masks = choose_regions(expected.errors, grid, cost, expected.scenes)
    between = [number for place, number in enumerate(numbers) if place % factor]
    frames = []
    for number, errors, mask in zip(between, expected.errors * grid.areas * LEVELS / pixels, masks, strict=True):
        regions = tuple(map(grid.in_pixels, partition(mask)))
        whole = regions == (Rectangle(0, 0, info.width, info.height),)
        frames.append(PlannedFrame(number, regions, whole, float(errors.sum()), float(errors[~mask].sum())))
    seconds = None
    if options.cost is not None:
        areas = np.array([sum(region.area for region in frame.regions) for frame in frames])
        seconds = round(float(RenderCost(options.cost / pixels, options.overhead, 0).of(areas).sum()), 3)
    plan = RerenderPlan(info.width, info.height, options.tile, tuple(frames), seconds)
    with new_folder(Path(folder)) as unfinished:
        plan.write(unfinished)
    return plan


def open_images(path: str, folder: str) -> ImageSource:
    """Open the images of a plan, which goes to a new folder; raise InputError unless they are images, and enough."""
    if not stands_for_images(path):
        if not Path(path).exists():
            raise InputError(f"{path or 'An input without a name'} does not exist; check the name.")
        raise InputError(f"{path} is no folder or pattern of images, which plans need; write its frames as images.")
    check_new_folder(Path(folder))
    source = ImageSource(path, ASSUMED_IMAGE_RATE)
    if len(source.images.files) < MIN_IMAGES:
        raise InputError(
            f"{path} holds {len(source.images.files)} images, and a plan needs {MIN_IMAGES} at least: it hides one "
            "between two others to learn how large errors are."
        )
    return source


def _cost(options: PlanOptions, pixels: int, frames: int) -> RenderCost:
    """Return costs in seconds if they are known, else in pixels."""
    budget = options.budget or DEFAULT_BUDGET
    if budget.unit == "share":  # starting a frame costs nothing of a budget of pixels
        return RenderCost(1, 0, budget.amount * pixels * frames)
    assert options.cost is not None
    return RenderCost(options.cost / pixels, options.overhead, budget.amount)
