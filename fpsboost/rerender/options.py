"""Options of plans and merges."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from fpsboost import OptionError
from fpsboost.options import option


@dataclass(frozen=True)
class RenderBudget:
    """How much may be rendered.

    Parameters
    ----------
    amount : float
        A share of all pixels of the frames to be made, 0 to 1; or seconds.
    unit : {'share', 'seconds'}

    Raises
    ------
    OptionError
        The amount is not above 0, or a share is above 1.
    """

    amount: float
    unit: Literal["share", "seconds"] = "share"

    def __post_init__(self) -> None:
        if not (0 < self.amount < math.inf and (self.unit == "seconds" or self.amount <= 1)):
            raise OptionError("`budget` must be above 0 and at most 100%, as in 10%, or a time in seconds, as in 300s.")


def parse_budget(text: str, name: str) -> RenderBudget:
    """Read a budget, ``10%`` of the pixels or ``300s``; raise OptionError, with `name`, if it is neither."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(%|s)\s*", text)
    if match is None:
        raise OptionError(f"{name} must be a share as in 10%, or seconds as in 300s, not {text!r}.")
    amount, unit = float(match[1]), match[2]
    return RenderBudget(amount / 100) if unit == "%" else RenderBudget(amount, "seconds")


@dataclass(frozen=True)
class PlanOptions:
    """Budget, tiles and costs of rendering, by which regions of interpolated frames are chosen.

    Parameters
    ----------
    budget : RenderBudget, optional
        How much may be rendered; a tenth of the pixels by default.
    cost : float, optional
        Seconds that a renderer takes for a full frame; needed where the budget is a time.
    overhead : float
        Seconds that every frame with a region costs beside its pixels, such as for loading the scene.
    factor : int, optional
        Output frames per image; by default the step of the images' numbers if that is above 1, else 2.
    tile : int
        Side of the renderer's tiles, pixels: regions consist of whole tiles.

    Raises
    ------
    OptionError
        A value is out of range, or the budget is a time and `cost` is missing.
    """

    budget: RenderBudget | None = option(
        None, "Share of the interpolated pixels, or 300s; else 10%.", metavar="SHARE", parse=parse_budget
    )
    cost: float | None = option(None, "Seconds to render a full frame; for a budget in seconds.", metavar="SECONDS")
    overhead: float = option(0.0, "Seconds in addition for each frame that is rendered.", metavar="SECONDS")
    factor: int | None = option(None, "Output frames per image; else the step of the numbers.")
    tile: int = option(16, "The renderer's tile size, pixels.")

    def __post_init__(self) -> None:
        if self.factor is not None and self.factor < 2:
            raise OptionError(f"`factor` must be a whole number from 2 on for a plan, not {self.factor}.")
        if not 1 <= self.tile <= 4096:
            raise OptionError(f"`tile` must be 1 to 4096 pixels, not {self.tile}.")
        if self.cost is not None and not 0 < self.cost < math.inf:
            raise OptionError(f"`cost` must be above 0 seconds, not {self.cost}.")
        if not 0 <= self.overhead < math.inf:
            raise OptionError(f"`overhead` must be at least 0 seconds, not {self.overhead}.")
        if self.cost is None and (self.overhead or (self.budget is not None and self.budget.unit == "seconds")):
            raise OptionError("Seconds of rendering need to know those of a full frame; say them with `cost=60`.")


def parse_quality(text: str, name: str) -> float:
    """Read a quality, ``35`` or ``35dB``; raise OptionError, with `name`, if it is no number of decibels."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(?:dB)?\s*", text, re.IGNORECASE)
    if match is None:
        raise OptionError(f"{name} must be a number of decibels, as in 35, not {text!r}.")
    return float(match[1])


@dataclass(frozen=True)
class FrameChoiceOptions:
    """Which frames are to be rendered at all."""

    quality: float | None = option(
        None, "Choose whole frames instead, for this least PSNR.", metavar="DB", parse=parse_quality
    )


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
