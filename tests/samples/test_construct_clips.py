"""The constructed clips under samples/: that all can be made, and each frame by itself as it is among others."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

SAMPLES = Path(__file__).parents[2] / "samples"
SIZE = (48, 27)
TABLE = (SAMPLES / "README.md").read_text(encoding="utf-8").split("## Constructed clips")[1].split("\n## ")[0]
NAMES = [line.split("`")[1] for line in TABLE.splitlines() if line.startswith("| `")]


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The program that constructs the clips."""
    monkeypatch.syspath_prepend(str(SAMPLES))
    return importlib.import_module("construct_clips")


@pytest.fixture
def raster(program: ModuleType) -> ModuleType:
    """Its places and matrices."""
    return importlib.import_module("constructed.raster")


@pytest.mark.parametrize("name", NAMES)
def test_a_frame_hangs_on_its_number_alone(program: ModuleType, name: str) -> None:
    """Drawn after others or by itself, a frame is the same to the byte, and time does not stand still."""
    first, second = program.construct(name, SIZE, range(2))
    (alone,) = program.construct(name, SIZE, [1])
    assert first.shape == (27, 48, 3)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(alone, second)
    assert not np.array_equal(first, second)


def test_the_program_writes_what_is_asked_for(
    program: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A folder for each clip, numbered frames in it, nothing else."""
    arguments = [str(tmp_path), "--only", "fire", "--only", "titles", "--frames", "3", "--size", "48x27"]
    monkeypatch.setattr(sys, "argv", ["construct_clips.py", *arguments])
    program.main()
    written = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.png"))
    assert written == [f"{name}/000{k}.png" for name in ("fire", "titles") for k in range(3)]
    (alone,) = program.construct("titles", SIZE, [2])
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "titles" / "0002.png")), alone)


def test_every_clip_is_in_the_table(program: ModuleType) -> None:
    """samples/README.md names each clip, and none besides."""
    assert list(program.clips) == NAMES


def test_samples_show_the_place_that_the_matrix_takes_there(raster: ModuleType) -> None:
    """A texture whose colours are places comes out as the places that the inverse matrix says."""
    view = raster.Raster(96, 54)
    x, y = raster.find_places((600, 400), view.density)
    texture = raster.Texture(np.dstack([x, y, x]).astype(np.float32), view.density)
    matrix = raster.shift(7.3, -4) @ raster.turn(5) @ raster.tilt(10, -6) @ raster.enlarge(1.1)
    x, y = view.places
    from_x, from_y, one = np.linalg.inv(matrix) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    filled = view.fill(texture, matrix).reshape(-1, 3)
    np.testing.assert_allclose(filled[:, 0], from_x / one, atol=0.1)  # a sixteenth of a sample
    np.testing.assert_allclose(filled[:, 1], from_y / one, atol=0.1)
    seen = view.look_up(texture, x + 3.25, y - 1.5)
    np.testing.assert_allclose(seen[..., 0], x + 3.25, atol=0.1)
    np.testing.assert_allclose(seen[..., 1], y - 1.5, atol=0.1)
