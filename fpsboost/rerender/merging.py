"""Merge of rendered regions into interpolated frames.

A region fades into the frame along its own edges, so that nothing outside of it changes; edges of the frame, and those
where two regions meet, have no seam.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from fpsboost import FrameImage, InputError, Layer, LayeredImage, OptionError, OutputError, PathName
from fpsboost.extension import (
    ImageTemplate,
    Remarks,
    checked,
    content_of,
    counted,
    explained,
    find_images,
    has_alpha,
    image_names,
    new_folder,
    view,
    write_safely,
)
from fpsboost.rerender import MergeOptions
from fpsboost.rerender.planning import PlannedFrame, RerenderPlan
from fpsboost.rerender.regions import Rectangle

LOSSY = (".jpg", ".jpeg")
"""Types of images that lose quality when they are encoded again."""


@dataclass
class MergeSummary:
    """Result of a merge."""

    frames: int
    """Number of frames written."""
    merged_frames: int
    """Number of frames with rendered regions; all others are copies."""
    regions: int
    """Number of regions put back."""
    remarks: Remarks
    """Sentences about what was left out or could not be kept."""


@checked
def merge_regions(made: PathName, rendered: PathName, output: PathName, options: MergeOptions) -> MergeSummary:
    """Put rendered regions back into interpolated frames.

    Parameters
    ----------
    made : str or os.PathLike
        Folder or pattern of all images of a conversion.
    rendered : str or os.PathLike
        Folder with the rendered images: for frame 12 either ``NAME_0012.png`` or a file for each region in the order of
        the plan, ``NAME_0012_1.png``. Each is of the size of the frame, or cropped to the region.
    output : str or os.PathLike
        New folder. Images without regions are copied to the byte.
    options : MergeOptions
        The plan, and the width of seams.

    Raises
    ------
    OptionError
        There is no plan.
    InputError
        A planned frame or region is missing, or is unlike the others in size or type.
    OutputError
        The output exists, or cannot be written.

    Examples
    --------
    >>> merge_regions("doubled/", "regions/", "final/", MergeOptions("plan/"))  # doctest: +SKIP
    """
    if options.plan is None:
        raise OptionError("Rendered regions go by a plan; name its folder with `plan=DIR`.")
    with new_folder(Path(output)) as unfinished:
        plan = RerenderPlan.read(Path(options.plan))
        with explained(InputError, "read", str(made), "check that it exists and that you may read it"):
            images = find_images(os.fspath(made))
        if not images.numbers:
            raise InputError(f"The images of {made} have no numbers in their names, by which a plan goes; number them.")
        files = dict(zip(images.numbers, images.files, strict=True))
        planned = {frame.number: frame for frame in plan.frames if frame.regions}
        missing = [frame.number for frame in plan.frames if frame.number not in files]
        if missing:
            more = f" and {len(missing) - 1} more of its frames" if len(missing) > 1 else ""
            raise InputError(
                f"{made} has no frame {missing[0]}{more}, which the plan counts; name the sequence that was planned."
            )
        places, remarks = _find_rendered(Path(rendered), planned)
        for number, path in files.items():
            if number in planned:
                content = _merged(path, places[number], planned[number], plan, options.feather)
            else:
                content = content_of(path)
            with explained(OutputError, "write", Path(output) / path.name, "check the free space and the permissions"):
                write_safely(unfinished / path.name, content)
    if any(files[number].suffix.lower() in LOSSY for number in planned):
        remarks.add("lossy-merge")
    return MergeSummary(len(files), len(planned), sum(len(frame.regions) for frame in planned.values()), remarks)


def seam_weights(mask: np.ndarray, feather: int) -> np.ndarray:
    """Return the share of the rendered image in each pixel, (H, W) float32.

    It is 1 inside of the mask, falls towards its edges over `feather` pixels, and is 0 outside.
    """
    # beyond the frame the mask goes on, so that its border is no edge
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    distance = cv2.distanceTransform(padded, cv2.DIST_C, 3)[1:-1, 1:-1]
    return np.asarray(np.minimum(distance / np.float32(feather + 1), 1), np.float32)


def mix(image: np.ndarray, rendered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean of two images; pixels of weight 0 are those of the first, of weight 1 of the second.

    Parameters
    ----------
    image, rendered : (H, W, C)
        Two images of one type; straight alpha in integers, premultiplied in floats.
    weights : (H, W) float32
        Share of the rendered image, 0 to 1.
    """
    share = weights[..., np.newaxis].astype(np.float64)
    is_float = np.issubdtype(image.dtype, np.floating)
    with np.errstate(invalid="ignore"):  # of infinity times 0, where the result is not taken
        mixed = image * (1 - share) + rendered * share
    if has_alpha(image) and not is_float:
        alphas = image[..., -1:] * (1 - share), rendered[..., -1:] * share
        colours = image[..., :-1] * alphas[0] + rendered[..., :-1] * alphas[1]
        total = alphas[0] + alphas[1]
        np.divide(colours, total, out=mixed[..., :-1], where=total > 0)
    rounded = mixed if is_float else np.rint(mixed)
    result = np.where(share > 0, rounded.astype(image.dtype), image)
    return np.ascontiguousarray(np.where(share < 1, result, rendered))


def _merged(path: Path, rendered: Sequence[Path], frame: PlannedFrame, plan: RerenderPlan, feather: int) -> bytes:
    """Return the content of the file of a merged frame, encoded like the interpolated one at `path`.

    `rendered` are the files of its regions.
    """
    template = ImageTemplate(path)
    made = template.read(path)
    if made.shape[:2] != (plan.height, plan.width):
        raise InputError(
            f"{path} has {made.shape[1]}x{made.shape[0]} pixels and the plan {plan.width}x"
            f"{plan.height}; name the sequence that was planned."
        )
    if frame.whole and template.can_be(rendered[0]):
        _check_alike(rendered[0], template.read(rendered[0]), path, made)
        return content_of(rendered[0])
    mask = frame.mask(plan.height, plan.width)
    weights = seam_weights(mask, feather)
    picture = view(made).deep_copy()  # with the rendered regions, without seams
    for region, file in zip(frame.regions, rendered, strict=True):
        image = template.read(file)
        part = _part(file, image, region, path, made)
        for to, values in zip(view(picture).arrays(), view(image).arrays(), strict=True):
            to[region.part] = values[part]
    mixed: FrameImage = mix(view(made).array(), view(picture).array(), weights)
    if isinstance(made, LayeredImage) and isinstance(picture, LayeredImage):  # their layers are mixed, each by kind
        layers = (_mix_layer(*pair, weights, mask) for pair in zip(made.layers, picture.layers, strict=True))
        mixed = LayeredImage(view(mixed).array(), tuple(layers))
    return template.encode(mixed)


def _mix_layer(made: Layer, rendered: Layer, weights: np.ndarray, mask: np.ndarray) -> Layer:
    """Return a layer with that of the rendered frame in it; layers that must not be mixed have no seam."""
    planes = {}
    for name, plane in made.planes.items():
        other = rendered.planes[name]
        if made.kind == "linear":
            planes[name] = mix(plane[..., np.newaxis], other[..., np.newaxis], weights)[..., 0]
        else:
            planes[name] = np.where(mask, other, plane)
    return replace(made, planes=planes)


def _part(path: Path, image: FrameImage, region: Rectangle, made_path: Path, made: FrameImage) -> tuple[slice, slice]:
    """Return the part of an image that is a region; the image shows the full frame or that region alone."""
    size = region.height, region.width
    if (image.shape, image.dtype) == ((*size, made.shape[2]), made.dtype):
        return slice(None), slice(None)
    if image.shape[:2] not in (made.shape[:2], size):
        raise InputError(
            f"{path} has {image.shape[1]}x{image.shape[0]} pixels; render the full {made.shape[1]}x{made.shape[0]} or "
            f"the region of {region.width}x{region.height} at {region.x},{region.y}."
        )
    _check_alike(path, image, made_path, made)
    return region.part


def _check_alike(path: Path, image: FrameImage, made_path: Path, made: FrameImage) -> None:
    """Raise `InputError` if a rendered image has another size or type than the frame."""
    if (image.shape, image.dtype) != (made.shape, made.dtype):
        raise InputError(
            f"{path} ({view(image).describe()}) is unlike {made_path} ({view(made).describe()}); "
            "render regions as the frames were."
        )


def _find_rendered(folder: Path, planned: Mapping[int, PlannedFrame]) -> tuple[dict[int, list[Path]], Remarks]:
    """Find the image of every region of every planned frame, by the numbers at the ends of their names."""
    with explained(InputError, "read", folder, "check that it exists and that you may read it"):
        names = image_names(folder)
    found: dict[int, dict[int, Path]] = {number: {} for number in planned}
    extra = 0
    for name in names:
        number, place = _number_and_region(name, planned)
        if number is None:
            extra += 1
            continue
        files = found[number]
        other = next((file for key, file in files.items() if key == place or 0 in (key, place)), None)
        if other is not None:
            raise InputError(
                f"{folder} holds several images for one part of frame {number} ({other.name}, {name}); keep one."
            )
        files[place] = folder / name
    images = {number: _of_regions(folder, frame, found[number]) for number, frame in planned.items()}
    remarks = Remarks()
    if extra:
        remarks.add("images-in-no-region", images=counted(extra, "image"), name=folder)
    return images, remarks


def _number_and_region(name: str, planned: Mapping[int, PlannedFrame]) -> tuple[int | None, int]:
    """Return the number of a planned frame from the name of a file, and that of a region, or 0 for all of them."""
    for pattern in (r".*?(\d+)_([1-9]\d*)", r".*?(\d+)()"):
        match = re.fullmatch(pattern, Path(name).stem)
        if match is not None:
            number = int(match[1])
            place = int(match[2] or 0)
            if number in planned and place <= len(planned[number].regions):
                return number, place
    return None, 0


def _of_regions(folder: Path, frame: PlannedFrame, files: Mapping[int, Path]) -> list[Path]:
    """Return the file of each region of a frame; `InputError` if one is missing."""
    for place, at in enumerate(frame.regions, start=1):
        if not {0, place} & files.keys():
            what = f"region {place} of frame {frame.number}" if files else f"frame {frame.number}"
            raise InputError(
                f"{folder} has no image of {what} ({at.width}x{at.height} at {at.x},{at.y}); render it, or plan less."
            )
    return [files.get(0) or files[place] for place in range(1, len(frame.regions) + 1)]
