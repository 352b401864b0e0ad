"""Conversions with guides from end to end, of a scene that is drawn here: a square jumps before a moving texture."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import InputError, Part, RunOptions, Summary, convert, join
from support.exr_truth import content, write_exr
from support.stopping import StopAfter

Array = NDArray[Any]

HEIGHT, WIDTH = 64, 96
LAST = 9
"""Number of the last frame; frames 1, 5 and 9 are rendered in full, and all others made."""

RENDERED = (1, 5, 9)
MADE = (2, 3, 4, 6, 7, 8)
JUMPS = (3, 8, 31, 6, 14, 17, 40, 9, 20, 24, 35)
"""Place of the square by the number of the frame."""


def scene(number: int) -> Array:
    """Return a frame, (H, W, 3) uint8."""
    noise = np.random.default_rng(5).random((HEIGHT, 2 * WIDTH, 3), np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    texture = np.rint((smooth - smooth.min()) * (255 / np.ptp(smooth))).astype(np.uint8)
    frame = texture[:, 2 * number : 2 * number + WIDTH].copy()
    left = 8 + JUMPS[number]
    frame[20:44, left : left + 24] = texture[20:44, 150:174, ::-1]
    return frame


def small(image: Array) -> Array:
    return cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)


def decibels(truth: Array, made: Array, white: float = 255) -> float:
    return float(10 * np.log10(white**2 / np.mean((truth.astype(np.float64) - made) ** 2)))


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """Every fourth frame as an image, and all frames at a quarter of the size; the folder of both."""
    (tmp_path / "renders").mkdir()
    (tmp_path / "cheap").mkdir()
    for number in range(1, LAST + 1):
        if number in RENDERED:
            cv2.imwrite(str(tmp_path / f"renders/r_{number:04}.png"), scene(number))
        cv2.imwrite(str(tmp_path / f"cheap/c_{number:04}.png"), small(scene(number)))
    return tmp_path


def convert_it(clip: Path, output: str, **options: Any) -> Summary:
    return convert(clip / "renders", clip / output, guide=clip / "cheap", **options)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_all_numbers_between_are_made_by_their_own_guides(clip: Path) -> None:
    """With the step of the numbers as the factor, far better than without."""
    summary = convert_it(clip, "out")
    convert(clip / "renders", clip / "alone", factor=4)
    assert summary.guided_frames == len(MADE)
    names = [f"r_{number:04}.png" for number in MADE]
    for number, name in zip(MADE, names, strict=True):
        made, alone = (decibels(scene(number), cv2.imread(str(clip / folder / name))) for folder in ("out", "alone"))
        assert made > max(28, alone + 4), number


def noisy(image: Array) -> Array:
    noise = np.random.default_rng(7).normal(0, 25, image.shape)
    return (image + noise).clip(0, 255).astype(np.uint8)


def recoloured(image: Array) -> Array:
    shaded = np.sqrt(image[..., ::-1] / 255) * np.linspace(0.4, 1, WIDTH)[:, np.newaxis]
    return np.rint(shaded * 255).astype(np.uint8)


def guides_as(clip: Path, drawn: Callable[[int], Array]) -> None:
    """Write other guides, drawn by the numbers of their files."""
    for number in range(1, LAST + 1):
        cv2.imwrite(str(clip / f"cheap/c_{number:04}.png"), drawn(number))


@pytest.mark.parametrize("shift", [-1, 1])
@pytest.mark.parametrize("change", [small, noisy])
def test_guides_that_show_the_frames_beside_are_refused(clip: Path, change: Any, shift: int) -> None:
    """By the guides of the first frames; nothing is written."""
    guides_as(clip, lambda number: change(scene(number + shift)))
    with pytest.raises(InputError, match="`guide` shows the frames beside; correct the numbers of its files, or `guid"):
        convert_it(clip, "out")
    assert not (clip / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "drawn",
    [
        lambda number: scene(1),
        lambda number: noisy(scene(number)),
        lambda number: recoloured(scene(number)),
        lambda number: np.roll(scene(number), 2, axis=1),
        lambda number: np.roll(scene(number), -2, axis=1),
    ],
    ids=["still", "noisy", "recoloured", "to the right", "to the left"],
)
def test_other_guides_than_usual_are_in_order(clip: Path, drawn: Any) -> None:
    """Such as those that hardly differ from frame to frame, or lie beside the frames by as much as these move."""
    guides_as(clip, drawn)
    assert convert_it(clip, "out").guided_frames == len(MADE)


@pytest.mark.slow
@pytest.mark.parametrize("after", [6, 8])
def test_runs_that_go_on_and_parts_make_the_frames_of_one(clip: Path, after: int) -> None:
    """Byte by byte, wherever the first run stopped, and whichever part is made first."""
    convert_it(clip, "whole")
    whole = contents(clip / "whole")
    with pytest.raises(KeyboardInterrupt):
        convert_it(clip, "again", run=RunOptions(observer=StopAfter(after)))
    summary = convert_it(clip, "again", resume=True)
    assert 0 < summary.completed_frames < LAST
    assert contents(clip / "again") == whole
    for number in (2, 1):
        convert_it(clip, "joined", chunk=Part(number, 2))
    join(clip / "joined", clip / "joined.parts")
    assert contents(clip / "joined") == whole


def light(number: int) -> dict[str, Array]:
    """Return a frame as light, with two layers of which it is the sum, by channels."""
    base = (2 ** (scene(number).astype(np.float32) / 32 - 5)).astype(np.float32)
    share = (np.mgrid[0:HEIGHT, 0:WIDTH][1] / WIDTH).astype(np.float32)[..., np.newaxis]
    layers = {"": base, "diffuse.": base * share, "specular.": base * (1 - share)}
    return {f"{layer}{letter}": image[..., k] for layer, image in layers.items() for k, letter in enumerate("BGR")}


def roots(channels: dict[str, Array], layer: str) -> Array:
    """Return the square roots of a layer's light, which shadows and lights share."""
    return np.sqrt(np.maximum(np.stack([channels[f"{layer}{letter}"] for letter in "BGR"]), 0))


@pytest.mark.slow
def test_light_with_layers_follows_guides(tmp_path: Path) -> None:
    """OpenEXR by number: the picture and its layers are nearer to the truth than without."""
    (tmp_path / "renders").mkdir()
    (tmp_path / "cheap").mkdir()
    for number in range(1, LAST + 1):
        channels = light(number)
        if number in RENDERED:
            write_exr(tmp_path / f"renders/r_{number:04}.exr", channels, half=False)
        write_exr(tmp_path / f"cheap/c_{number:04}.exr", {name: small(channels[name]) for name in "BGR"}, half=False)
    summary = convert_it(tmp_path, "out")
    convert(tmp_path / "renders", tmp_path / "alone", factor=4)
    assert summary.guided_frames == len(MADE)
    for number in MADE:
        truth = light(number)
        made, alone = (content(tmp_path / folder / f"r_{number:04}.exr") for folder in ("out", "alone"))
        assert made.keys() == truth.keys()
        for layer in ("", "diffuse.", "specular."):
            first, *others = (roots(each, layer) for each in (truth, made, alone))
            with_guide, without = (decibels(first, each) for each in others)
            assert with_guide > without + 1, (number, layer)
