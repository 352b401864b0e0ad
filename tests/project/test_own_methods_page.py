"""The page about methods of one's own: its code is run, gives the right pixels, and wrong results are refused."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fpsboost
from support.video_truth import pictures_of, write_clip

PAGE = Path(__file__).parents[2] / "docs" / "own_methods.md"

TEXTURE = np.repeat(np.repeat(np.random.default_rng(1).integers(40, 200, (12, 16, 3), dtype=np.uint8), 8, 0), 8, 1)

HALF_LIGHT = (TEXTURE / 2).astype(np.uint8)


@pytest.fixture(scope="module")
def page():
    """Names that the code of the page defines."""
    names = {}
    exec("".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)), names)
    return names


def test_the_estimator_and_the_synthesizer_of_the_page_follow_a_pan(page):
    """A picture that moves by eight pixels has moved by four halfway, with both and with either beside `nlm`'s part."""
    moved, halfway = np.roll(TEXTURE, 8, axis=1), np.roll(TEXTURE, 4, axis=1)
    for method in (page["method"], page["own_motion"], page["own_images"]):
        (made,) = method.interpolate(TEXTURE, moved, [0.5])
        assert made.dtype == np.uint8
        assert np.abs(made[16:-16, 24:-24].astype(int) - halfway[16:-16, 24:-24]).mean() < 3


def test_the_method_of_the_page_keeps_values_where_the_light_changes(page):
    """Halfway to half the light, pixels are three quarters as bright, and of the type of the frames."""
    made = page["middle_of"](TEXTURE, HALF_LIGHT)
    assert made.dtype == np.uint8
    assert np.abs(made - 0.75 * TEXTURE).mean() < 2


def test_options_of_the_page_are_checked(page):
    """A value outside of its range is refused with the sentence that the page quotes."""
    with pytest.raises(fpsboost.OptionError) as refused:
        page["GlobalShift"](smoothing=0)
    assert f'"{refused.value}"' in PAGE.read_text(encoding="utf-8")


def test_the_method_of_the_page_converts_files(page, tmp_path):
    """Four times the frames."""
    source = write_clip(tmp_path / "in.mp4", times=range(5))
    page["convert"](source, tmp_path / "out.mp4")
    assert len(pictures_of(tmp_path / "out.mp4")) == 20


@dataclass(frozen=True)
class Returns:
    """An estimator and a synthesizer that returns the same whatever it is asked for."""

    result: Any

    def estimate(self, image0, image1):
        return self.result

    def synthesize(self, frame_pair, times):
        return self.result


FLOW = np.zeros((96, 128, 2), np.float32)
STILL = fpsboost.MotionField(FLOW)


@pytest.mark.parametrize(
    ("result", "said"),
    [
        ((FLOW, FLOW), "as in"),
        (FLOW, "as in"),
        (None, "as in"),
        (STILL, "as in"),
        ((STILL,), "as in"),
        ((STILL, fpsboost.MotionField(FLOW[:48])), r"\(96, 128\), not \(48, 128\)"),
        ((STILL, fpsboost.MotionField(FLOW + np.nan)), "finite"),
        ((fpsboost.MotionField(FLOW + 1e9), STILL), "finite"),
        ((STILL, fpsboost.MotionField(FLOW, FLOW[..., 0] + 255)), "from 0 to 1"),
        ((STILL, fpsboost.MotionField(FLOW, FLOW[..., 0] + np.nan)), "from 0 to 1"),
    ],
)
def test_what_is_no_motion_is_refused(page, result, said):
    """By its type, shape and range, with the name of the estimator and with what to return."""
    method = fpsboost.Interpolator(Returns(result), page["MeanAlongMotion"]())
    with pytest.raises(fpsboost.OptionError, match=f"Returns must return two `fpsboost.MotionField`.*{said}"):
        method.interpolate(TEXTURE, TEXTURE, [0.5])


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (None, "it has yielded 0 for 1 times"),
        ([], "it has yielded 0 for 1 times"),
        ([None], "not NoneType"),
        ([[1, 2]], "not list"),
        (TEXTURE, r"not \(128, 3\) and uint8"),
        ([TEXTURE[:48]], r"not \(48, 128, 3\) and uint8"),
        ([TEXTURE[..., 0]], r"not \(96, 128\) and uint8"),
        ([TEXTURE / 255], r"not \(96, 128, 3\) and float64"),
        ([(TEXTURE / 255).astype(np.float32)], "and float32"),
    ],
)
def test_what_is_no_image_like_the_frames_is_refused(page, result, said):
    """By its number, type, shape and dtype, with the name of the synthesizer and with what to yield."""
    method = fpsboost.Interpolator(page["GlobalShift"](), Returns(result))
    with pytest.raises(fpsboost.OptionError, match=f"synthesizer Returns must yield an image for every time.*{said}"):
        method.interpolate(TEXTURE, TEXTURE, [0.5])


@pytest.mark.parametrize(("result", "said"), [(TEXTURE, "float32, not .*uint8"), (np.float32(TEXTURE), "white is 1.0")])
def test_images_on_the_scale_of_the_clip_are_refused_where_the_light_changes(page, result, said):
    """Frames are float32 there, with white at 1.0; levels of 255 would be taken for too much light."""
    method = fpsboost.Interpolator(page["GlobalShift"](), Returns([result]))
    with pytest.raises(fpsboost.OptionError, match=said):
        method.interpolate(TEXTURE, HALF_LIGHT, [0.5])


def test_values_beyond_white_and_gaps_are_images():
    """Linear light above 1, and NaN in the source and in the image, are no other scale."""
    frame = TEXTURE.astype(np.float32) / 100
    frame[:8] = np.nan
    method = fpsboost.Interpolator(Returns((STILL, STILL)), Returns([frame * 2]), compensate_illumination=False)
    with pytest.warns(UserWarning, match="NaN"):
        (made,) = method.interpolate(frame, frame, [0.5])
    np.testing.assert_array_equal(made, frame * 2)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((FLOW[..., 0],), r"not \(96, 128\) and"),
        ((FLOW, FLOW), r"`similarities` \(96, 128\), not .* and \(96, 128, 2\)"),
        ((FLOW, FLOW[..., 0], None, 0), "`spacing` is 0"),
        ((FLOW, FLOW[..., 0], None, 8), r"`spacing` of 8 have the shape \(12, 16, 2\)"),
        ((FLOW[::8, ::8], FLOW[::8, ::8, 0], None, 8, (128, 96)), r"96x128 pixels .* \(16, 12, 2\)"),
    ],
)
def test_arrays_that_are_no_motion_field_are_refused(arguments, said):
    """When the field is made, by their shapes."""
    with pytest.raises(fpsboost.OptionError, match=said):
        fpsboost.MotionField(*arguments)
