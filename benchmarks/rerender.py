"""Does a plan know which regions are worth rendering? Against random tiles, and against an oracle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter
from numpy.typing import NDArray
from rich.table import Table
from scoring import find_clips, make_between, one_thread, read_frames, wide_console

from fpsboost.frame import Frame
from fpsboost.method_table import find_method
from fpsboost.rerender.regions import TileGrid, choose_regions, partition
from fpsboost.rerender.score import expect_errors, squared_error

SHARES = (0.05, 0.1, 0.2)
LEVELS = 255**2

app = App(help=__doc__)


def judge(images: list[NDArray[Any]], method: str, tile: int) -> list[dict[str, float]]:
    """Hide every second image, plan, put the truth into the regions, and return a row for every budget."""
    shown, truths = images[::2], images[1 : 2 * len(images[::2]) - 1 : 2]
    interpolator = find_method(method)
    grid = TileGrid(*shown[0].shape[:2], tile)
    made = list(make_between(interpolator, shown))
    true = np.stack([grid.means(squared_error(*pair)) for pair in zip(made, truths, strict=True)])
    frames = [Frame(image, index) for index, image in enumerate(shown)]
    expected, scenes = expect_errors(frames, interpolator, 2, grid, lambda jobs: (job() for job in jobs))
    areas = np.broadcast_to(grid.areas, true.shape)
    sums, pixels = true * areas, areas.sum()
    rows = []
    for share in SHARES:
        masks = choose_regions(expected, grid, share * pixels, scenes)
        oracle = best_tiles(true, areas, share * pixels)
        plain = best_tiles(expected, areas, share * pixels)
        changes = (masks[1:] != masks[:-1]).sum() / max(masks.sum(), 1) / 2
        rows.append(
            {
                "share": share,
                "rendered": float((masks * areas).sum() / pixels),
                "before": LEVELS * float(sums.sum() / pixels),
                "planned": LEVELS * float(sums[~masks].sum() / pixels),
                "tiles": LEVELS * float(sums[~plain].sum() / pixels),
                "random": LEVELS * float(sums.sum() / pixels * (1 - share)),
                "oracle": LEVELS * float(sums[~oracle].sum() / pixels),
                "of_oracle": float(sums[masks].sum() / sums[oracle].sum()),
                "rectangles": float(np.mean([len(partition(mask)) for mask in masks])),
                "changing": float(changes),
                "expected_before": LEVELS * float((expected * areas).sum() / pixels),
                "expected_after": LEVELS * float((expected * areas)[~masks].sum() / pixels),
            }
        )
    return rows


def best_tiles(errors: NDArray[Any], areas: NDArray[Any], pixels: float) -> NDArray[Any]:
    """Return the tiles of the largest error that fit, one by one."""
    order = np.argsort(-errors, axis=None, kind="stable")
    taken = np.zeros(errors.size, bool)
    taken[order[: np.searchsorted(np.cumsum(areas.ravel()[order]), pixels, side="right")]] = True
    return taken.reshape(errors.shape)


@app.command
def regions(
    *clips: str,
    method: str = "nlm",
    tile: int = 16,
    frames: int = 49,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Hide every second frame of clips, plan what to render, and put the truth there.

    Parameters
    ----------
    clips
        Videos, folders or patterns of images, or folders of these.
    method
        One that knows its confidence.
    tile
        Side of the tiles, pixels.
    frames
        Largest number of frames of a clip.
    json_file
        A file for all figures.
    """
    one_thread()
    table = Table(box=None)
    names = ("before", "random", "planned", "oracle", "of the oracle's gain", "plain tiles", "rectangles", "changing")
    for name in ("clip", "budget", "rendered", *names, "expected"):
        table.add_column(name, justify="right")
    found = {}
    for name, path in find_clips(clips).items():
        found[name] = judge(read_frames(path, frames), method, tile)
        for row in found[name]:
            table.add_row(
                name,
                f"{row['share']:.0%}",
                f"{row['rendered']:.1%}",
                *(f"{row[key]:.1f}" for key in ("before", "random", "planned", "oracle")),
                f"{row['of_oracle']:.0%}",
                f"{row['tiles']:.1f}",
                f"{row['rectangles']:.1f}",
                f"{row['changing']:.0%}",
                f"{row['expected_before']:.1f} -> {row['expected_after']:.1f}",
            )
    wide_console().print(table)
    if json_file is not None:
        json_file.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    app()
