"""Images of unusual kinds: they look as they should, and it is said where something is lost."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from fpsboost import convert
from fpsboost.io.images.files import read_image

COLOUR = (200, 100, 52)
HEIGHT, WIDTH = 8, 10

Save = Callable[[Path, int], None]


def picture(shift: int = 0) -> np.ndarray:
    """A little ramp in red, green and blue."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 0] = np.arange(WIDTH) * 20 + shift
    image[..., 1] = np.arange(HEIGHT)[:, None] * 20
    return image


def pillow(mode: str, **options: object) -> Save:
    def save(path: Path, shift: int) -> None:
        image = Image.fromarray(picture(shift))
        image = image.quantize(16) if mode == "P" else image.convert("CMYK" if mode == "LAB" else mode)
        if mode == "LAB":
            image = Image.merge("LAB", image.split()[:3])
        image.save(path, **options)

    return save


def tiff(image: np.ndarray, **options: object) -> Save:
    return lambda path, shift: tifffile.imwrite(path, image, **options)


@pytest.mark.parametrize(
    ("suffix", "save", "words"),
    [
        (".jpg", pillow("CMYK"), "out has RGB where its source has CMYK."),
        (".tif", pillow("CMYK"), "out has RGB where its source has CMYK."),
        (".tif", pillow("LAB"), "out has RGB where its source has CIELab."),
        (".tif", tiff(np.stack([picture()] * 2), photometric="rgb"), "hold several pictures, the first of which"),
        (".png", pillow("RGB", save_all=True, append_images=[Image.fromarray(picture(9))]), "hold several pictures"),
        *((suffix, pillow(mode), "") for suffix in (".png", ".tif", ".bmp", ".jpg", ".webp") for mode in ("L", "RGB")),
        *((suffix, pillow(mode), "") for suffix in (".png", ".tif") for mode in ("P", "1", "LA")),
        (".png", pillow("RGB", transparency=(1, 2, 3)), ""),
        (".tif", tiff(picture()[..., 0], photometric="miniswhite"), ""),
    ],
)
def test_other_kinds_are_said(tmp_path, suffix, save, words):
    """One sentence for a folder, and none for kinds whose frames lose nothing that is seen."""
    (tmp_path / "in").mkdir()
    for number in (1, 2, 3):
        save(tmp_path / "in" / f"{number}{suffix}", number * 7)
    remarks = convert(str(tmp_path / "in"), str(tmp_path / "out"), method="blend").remarks
    assert [words in remark for remark in remarks] == [True] * bool(words), remarks


def flat(*values: int, dtype: type = np.uint8) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, len(values)), values, dtype)


def png(mode: str, *values: int, palette: bytes = b"", **options: object) -> Save:
    image = Image.new(mode, (WIDTH, HEIGHT), values if len(values) > 1 else values[0])
    if palette:
        image.putpalette(palette)
    return lambda path, shift: image.save(path, "PNG", **options)


@pytest.mark.parametrize(
    ("save", "expected"),
    [
        (tiff(flat(200, 100, 52, 128), photometric="rgb", extrasamples=["unassalpha"]), [52, 100, 200, 128]),
        (tiff(flat(200, 100, 52, 0), photometric="rgb", extrasamples=["unassalpha"]), [52, 100, 200, 0]),
        (tiff(flat(100, 50, 26, 128), photometric="rgb", extrasamples=["assocalpha"]), [26, 50, 100, 128]),
        (tiff(flat(20, 10, 5, 7, dtype=np.uint16), photometric="rgb", extrasamples=["unassalpha"]), [5, 10, 20, 7]),
        (tiff(flat(55, 155, 203, 0), photometric="separated"), [52, 100, 200]),
        (tiff(flat(200)[..., 0], photometric="miniswhite"), [55]),
        (tiff(flat(20000, dtype=np.uint16)[..., 0], photometric="miniswhite"), [45535]),
        (png("1", 1), [255]),
        (png("LA", 32, 128), [32, 32, 32, 128]),
        (png("P", 1, palette=bytes([0, 0, 0, 1, 2, 3])), [3, 2, 1]),
        (png("P", 1, palette=bytes([0, 0, 0, 1, 2, 3]), transparency=b"\0\7"), [3, 2, 1, 7]),
    ],
)
def test_unusual_images_look_as_they_should(tmp_path, save, expected):
    """Colours apart from their alpha stay so, CMYK has no alpha, white is bright in 16 bits as in 8; palettes, gray."""
    save(tmp_path / "1.tif", 0)
    assert np.abs(read_image(tmp_path / "1.tif")[0, 0].astype(int) - expected).max() <= 1
