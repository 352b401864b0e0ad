"""Planned regions as a renderer needs them: borders of an image, and names of files."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from .errors import RoundTripError

PLAN_FILE = "plan.json"


class Border(NamedTuple):
    """A render border: fractions of the image, x to the right and y up."""

    min_x: float
    max_x: float
    min_y: float
    max_y: float


@dataclass(frozen=True)
class Region:
    """A part of a frame that is to be rendered, pixels, y down; its image has the name, without extension."""

    frame: int
    name: str
    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class Plan:
    """Regions to render, in the order of their frames, whose size is in pixels."""

    width: int
    height: int
    regions: tuple[Region, ...]

    def border_of(self, region: Region) -> Border:
        """Return the border that makes Blender render exactly the pixels of a region.

        Blender multiplies the fraction by the size and drops what is behind the point; half a pixel more keeps
        rounding from losing a row or column.

        Examples
        --------
        >>> Plan(100, 50, ()).border_of(Region(2, "0002", 10, 0, 90, 20))
        Border(min_x=0.105, max_x=1.0, min_y=0.61, max_y=1.0)
        """

        def fraction(pixels: int, size: int) -> float:
            return pixels / size if pixels in (0, size) else (pixels + 0.5) / size

        return Border(
            fraction(region.x, self.width),
            fraction(region.x + region.width, self.width),
            fraction(self.height - region.y - region.height, self.height),
            fraction(self.height - region.y, self.height),
        )


def read_plan(folder: Path) -> Plan:
    """Read the plan that ``fpsboost plan`` has written into a folder."""
    path = folder / PLAN_FILE
    try:
        return parse_plan(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError as error:
        raise RoundTripError(f"{path} is not there; plan first.") from error
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise RoundTripError(f"{path} is no plan that this add-on understands; plan again.") from error


def parse_plan(values: dict[str, Any]) -> Plan:
    """Return the plan that parsed JSON describes; KeyError, TypeError or ValueError if it is none."""
    width, height = int(values["width"]), int(values["height"])
    regions = list[Region]()
    for frame in values["frames"]:
        number = int(frame["number"])
        for place, rectangle in enumerate(frame["regions"], start=1):
            name = f"{number:04d}" if len(frame["regions"]) == 1 else f"{number:04d}_{place}"
            regions.append(Region(number, name, *map(int, rectangle)))
    return Plan(width, height, tuple(regions))


def check_size(plan: Plan, width: int, height: int) -> None:
    """Raise `RoundTripError` unless a plan is for frames of this size in pixels."""
    if (plan.width, plan.height) != (width, height):
        raise RoundTripError(
            f"The plan is for frames of {plan.width}x{plan.height}, but the scene renders {width}x{height}; "
            "set the resolution that the frames were rendered with."
        )


def remove_outdated(folder: Path, planned_at: float) -> list[Path]:
    """Remove regions that were rendered before a plan (seconds since the epoch), and return their paths.

    The folder may be missing. Images with other names are left alone.
    """
    rendered = [path for path in sorted(folder.glob("*.exr")) if re.fullmatch(r"\d{4,}(_\d+)?", path.stem)]
    outdated = [path for path in rendered if path.stat().st_mtime < planned_at]
    for path in outdated:
        path.unlink()
    return outdated


def unrendered(plan: Plan, folder: Path) -> list[Region]:
    """Return the regions that are not rendered yet, so that a run that was interrupted goes on."""
    present = {path.stem for path in folder.glob("*.exr")}
    return [region for region in plan.regions if region.name not in present]
