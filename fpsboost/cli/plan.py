"""Commands `fpsboost plan`, which finds regions worth rendering, and `fpsboost merge`, which puts them into frames."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Group, Parameter
from rich.console import Console
from rich.table import Table

import fpsboost
from fpsboost.cli.flags import OWN_OPTIONS, Input, with_flags
from fpsboost.cli.messages import console, fact_table, literal, sentence
from fpsboost.cli.options import MethodOptions, PathName, PlannedMethodOptions
from fpsboost.rerender import MergeOptions, PlanOptions

budget = Group("Regions", sort_key=1)
method = Group("Method", sort_key=2)


@with_flags
def plan(
    input: Input,
    folder: Annotated[PathName, Parameter(name="DIR")],
    /,
    *,
    options: Annotated[PlanOptions, budget],
    motion: Annotated[PlannedMethodOptions, method],
) -> None:
    """Find regions of interpolated frames to render instead.

    Parameters
    ----------
    input
        Rendered images: a folder, shot_%04d.png or shot_####.png.
    folder
        A new folder for plan.json and a mask for every frame.
    """
    interpolator = MethodOptions(motion.method, rendered=motion.rendered).interpolator()
    with console(quiet=motion.quiet).status("interpolating frames that are known"):
        table = plan_table(fpsboost.plan_rerender(input, folder, options, method=interpolator), folder)
    if not motion.quiet:
        Console(highlight=False).print(table)


def plan_table(plan: fpsboost.RerenderPlan, folder: str) -> Table:
    """Return a summary of a plan, one name and value per row, titled with its folder."""
    started = [frame for frame in plan.frames if frame.regions]
    regions = sum(len(frame.regions) for frame in started)
    whole = sum(frame.whole for frame in started)
    before = plan.expected_error
    after = plan.remaining_error
    less = f", {1 - after / before:.0%} less" if before > 0 else ""
    of_these = f", {whole} whole" if whole else ""
    facts = {
        "frames": f"{len(started)} of {len(plan.frames)} that are interpolated{of_these}",
        "regions": f"{regions} rectangles",
        "pixels": f"{plan.rendered_share:.1%} of those frames",
        "squared error": f"{before:.1f} -> {after:.1f} expected{less}",
    }
    return fact_table(facts, f"[bold]{literal(folder)}[/]")


@with_flags
def merge(
    images: Annotated[PathName, Parameter(name="FRAMES")],
    rendered: Annotated[PathName, Parameter(name="RENDERED")],
    output: Annotated[PathName, Parameter(name="OUT")],
    /,
    *,
    options: Annotated[MergeOptions, OWN_OPTIONS],
    quiet: Annotated[bool, Parameter(group=OWN_OPTIONS, name=["--quiet", "-q"])] = False,
) -> None:
    """Put rendered regions into interpolated frames.

    Parameters
    ----------
    images
        All images of a conversion: a folder or a pattern.
    rendered
        A folder with NAME_0012.png or NAME_0012_1.png, _2, ... for
        frame 12: full frames, or cropped to the regions.
    output
        A new folder. Images without regions are copied.
    quiet
        Print errors only.
    """
    errors = console(quiet=quiet)
    with errors.status("merging"):
        summary = fpsboost.merge_regions(images, rendered, output, options)
    errors.print(
        sentence(
            f"{output}: {summary.regions} regions put back into {summary.merged_frames} of {summary.frames} frames, "
            "all others copied"
        )
    )
    for remark in summary.remarks:
        errors.print(f"Note: {sentence(remark)}")
