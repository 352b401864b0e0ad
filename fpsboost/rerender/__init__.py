"""Rendering of some frames and regions: a plan of what is worth rendering, and the merge of what was rendered.

`planning` finds the regions of interpolated frames that are most likely wrong, within a budget; `merging` puts them
back after they were rendered. `score` predicts the errors that a plan is based on, and `regions` turns them into
rectangles. The options are here, light to import: they are also those of `fpsboost plan` and `fpsboost merge`.

>>> import fpsboost
>>> plan = fpsboost.plan_rerender("renders/", "plan/", fpsboost.PlanOptions(budget=0.05))  # doctest: +SKIP
>>> # render the rectangles of plan/plan.json into regions/, then:
>>> fpsboost.merge_regions("doubled/", "regions/", "final/", fpsboost.MergeOptions("plan/"))  # doctest: +SKIP
"""

import re
from dataclasses import dataclass
from typing import Annotated

from fpsboost import Checked, OptionError, PathName, Range
from fpsboost.extension import option


def parse_budget(text: str, name: str) -> float:
    """Return a budget such as ``10%`` of the pixels as a share, 0.1.

    Raises `OptionError`, in which `name` names the option, for any other text, and for more than 100 %.

    Examples
    --------
    >>> parse_budget("12.5%", "budget")
    0.125
    """
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*%\s*", text)
    if match is None or not 0 < float(match[1]) <= 100:
        raise OptionError(f"{name} must be a share of the pixels, above 0% and at most 100%, as in 10%, not {text!r}.")
    return float(match[1]) / 100


@dataclass(frozen=True)
class PlanOptions(Checked):
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

    budget: Annotated[float, Range(above=0, most=1)] = option(
        0.1, "Share of the interpolated pixels; else 10%.", metavar="SHARE", parse=parse_budget
    )
    factor: Annotated[int, Range(2)] | None = option(None, "Output frames per image; else the step of the numbers.")
    tile: Annotated[int, Range(1, 4096, unit=" pixels")] = option(16, "The renderer's tile size, pixels.")


@dataclass(frozen=True)
class MergeOptions(Checked):
    """Options by which rendered regions are put back.

    Parameters
    ----------
    plan : str or os.PathLike, optional
        Folder that a plan was written to.
    feather : int
        Width of the seam inside the edges of a region, pixels, along which it fades into the interpolated frame; 0 for
        none.

    Raises
    ------
    OptionError
        `feather` is below 0.
    """

    plan: PathName | None = option(None, "Folder that fpsboost plan has written.", metavar="DIR")
    feather: Annotated[int, Range(0, unit=" pixels")] = option(4, "Width of the seams, inside of the regions, pixels.")
