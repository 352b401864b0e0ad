"""Checks of images that users give: their shape and type, the scale of floats, and whether two are alike."""

import warnings

import numpy as np

from fpsboost.errors import InputError, OptionError
from fpsboost.image import Image, ImageView, type_names, view


def check_image(image: Image | ImageView, name: str = "An image") -> None:
    """Raise `InputError`, which calls an image by its name, unless it is one."""
    if len(image.shape) != 3 or image.shape[2] not in (1, 2, 3, 4) or 0 in image.shape:
        raise InputError(f"{name} must have the shape (height, width, 1 to 4), not {image.shape}.")
    if image.dtype not in type_names:
        raise InputError(f"{name} must be uint8, uint16 or float32, not {image.dtype}; convert it first.")


def check_values(image: Image, name: str) -> None:
    """Raise `OptionError` if a float image is surely not on the scale from 0 to 1, and warn if it is probably not.

    Light may be brighter than white, and colours outside of the gamut are a little below 0. So what counts is whether a
    twentieth of the values are far below 0, whether a quarter are whole numbers above 1 and all others whole numbers,
    too, or whether half of them are far above white and none is above 256.
    """
    if image.dtype != np.float32:
        return
    if np.isnan(image).any():
        warnings.warn(
            f"{name} has NaN, which methods that follow motion take for black; give alpha that is 0 there.",
            stacklevel=2,
        )
    values = image[:: image.shape[0] // 256 + 1, :: image.shape[1] // 256 + 1, :3]
    values = values[np.isfinite(values)]
    lowest = values.min(initial=0)
    highest = values.max(initial=0)
    needs = f"{name} has values from {lowest:g} to {highest:g}, and white is 1 in floats;"
    if np.count_nonzero(values < -0.1) > values.size / 20:
        raise OptionError(f"{needs} shift and scale them to 0 to 1: of -1 to 1, give values / 2 + 0.5.")
    if np.count_nonzero(values > 1) > values.size / 4 and highest > 16 and (values == np.rint(values)).all():
        raise OptionError(f"{needs} divide them by the value of white, such as 255, or give them as integers.")
    if np.count_nonzero(values > 16) > values.size / 2 and highest <= 256:
        warnings.warn(f"{needs} if they are 8-bit levels, divide them by 255.", stacklevel=2)


def check_pair(
    image0: Image | ImageView, image1: Image | ImageView, name0: str = "An image", name1: str = "An image"
) -> None:
    """Raise `InputError` unless both, which it calls by their names, are valid images of one size and type."""
    for image, name in ((image0, name0), (image1, name1)):
        check_image(image, name)
    kinds = [(image.shape, image.dtype, view(image).coding) for image in (image0, image1)]
    if kinds[0] != kinds[1]:
        raise InputError(
            f"Two frames of one clip must be alike, but one is {view(image0).describe()} and the other "
            f"{view(image1).describe()}; make them one size and type first."
        )


LEAST_SIDE_OF_GUIDE = 8
"""Smallest height and width of guides, pixels."""


def check_guide_size(name: str, size: tuple[int, ...], of_frames: tuple[int, ...]) -> None:
    """Raise `InputError` if a guide has another shape than the frames, is larger or tiny; sizes are (height, width)."""
    height, width = size
    most_height, most_width = of_frames
    sizes = f"{name} has {width}x{height} pixels, and the frames have {most_width}x{most_height}"
    # sizes are rounded to whole pixels, and those of videos to even ones
    is_other = abs(width * most_height - height * most_width) > max(of_frames)
    if is_other or width > most_width or height > most_height or min(size) < LEAST_SIDE_OF_GUIDE:
        raise InputError(
            f"{sizes}; crop or render the guide in their shape, at most as large, and at least "
            f"{LEAST_SIDE_OF_GUIDE} pixels high and wide."
        )
