"""Options of plans and merges."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fpsboost import OptionError
from fpsboost.options import option


def parse_budget(text: str, name: str) -> float:
    """Read a budget, ``10%`` of the pixels, as a share; raise OptionError, with `name`, if it is none."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*%\s*", text)
    if match is None:
        raise OptionError(f"{name} must be a share of the pixels, as in 10%, not {text!r}.")
    return float(match[1]) / 100


@dataclass(frozen=True)
class PlanOptions:
    """Budget and tiles, by which regions of interpolated frames are chosen.

    Parameters
    ----------
    budget : float
        Share of all pixels of the interpolated frames that may be rendered, above 0 and at most 1.
    factor : int, optional
        Output frames per image; by default the step of the images' numbers if that is above 1, else 2.
    tile : int
        Side of the renderer's tiles, pixels: regions consist of whole tiles.

    Raises
    ------
    OptionError
        A value is out of range.
    """

    budget: float = option(0.1, "Share of the interpolated pixels; else 10%.", metavar="SHARE", parse=parse_budget)
    factor: int | None = option(None, "Output frames per image; else the step of the numbers.")
    tile: int = option(16, "The renderer's tile size, pixels.")

    def __post_init__(self) -> None:
        if not 0 < self.budget <= 1:
            raise OptionError(f"`budget` must be above 0 and at most 100%, as in 10%, not {self.budget:.6g}.")
        if self.factor is not None and self.factor < 2:
            raise OptionError(f"`factor` must be a whole number from 2 on for a plan, not {self.factor}.")
        if not 1 <= self.tile <= 4096:
            raise OptionError(f"`tile` must be 1 to 4096 pixels, not {self.tile}.")


@dataclass(frozen=True)
class MergeOptions:
    """How rendered regions are put back.

    Parameters
    ----------
    plan : str, optional
        Folder that a plan was written to.
    feather : int
        Width of the seam inside the edges of a region, pixels, along which it fades into the made frame; 0 for none.

    Raises
    ------
    OptionError
        `feather` is below 0.
    """

    plan: str | None = option(None, "Folder that fpsboost plan has written.", metavar="DIR")
    feather: int = option(4, "Width of the seams, inside of the regions, pixels.")

    def __post_init__(self) -> None:
        if self.feather < 0:
            raise OptionError(f"`feather` must be at least 0 pixels, not {self.feather}.")
