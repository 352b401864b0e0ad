"""What passes for a pair of images, and how images are described."""

import numpy as np
import pytest

from fpsboost.errors import FpsboostError, InputError, OptionError, OutputError
from fpsboost.image import view
from fpsboost.image_checks import check_pair


@pytest.mark.parametrize("shape", [(4, 6), (4, 6, 5), (4, 6, 3, 1), (0, 6, 3), (4, 0, 3), (), (4, 6, 0)])
def test_other_shapes_are_refused(shape):
    """The message says the shape that came."""
    image = np.zeros(shape, np.uint8)
    with pytest.raises(InputError, match="shape"):
        check_pair(image, image)


def test_other_types_and_unlike_frames_are_refused():
    """The message says the type that came, or size, channels and type of both frames."""
    for dtype in (np.int8, np.int32, np.float64, np.float16, bool, np.complex64):
        image = np.zeros((4, 6, 3), dtype)
        with pytest.raises(InputError, match=np.dtype(dtype).name):
            check_pair(image, image)
    image = np.zeros((4, 6, 3), np.uint8)
    for other in (np.zeros((4, 6, 4), np.uint8), np.zeros((6, 4, 3), np.uint8), np.zeros((4, 6, 3), np.uint16)):
        for pair in ((image, other), (other, image)):
            with pytest.raises(InputError, match="6x4, 3 channels, 8-bit"):
                check_pair(*pair)


def test_images_are_described_as_people_do():
    """Width first, one channel in the singular."""
    assert view(np.zeros((360, 640, 3), np.uint8)).describe() == "640x360, 3 channels, 8-bit"
    assert view(np.zeros((2, 3, 1), np.float32)).describe() == "3x2, 1 channel, float"


def test_errors_form_one_tree():
    """One base catches all; a wrong option is a ValueError as well."""
    assert all(issubclass(kind, FpsboostError) for kind in (InputError, OptionError, OutputError))
    assert issubclass(OptionError, ValueError)
