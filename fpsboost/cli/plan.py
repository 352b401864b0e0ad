"""Command `fpsboost plan`: says which regions, or which frames, are worth rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter
from rich.console import Console
from rich.table import Table

from fpsboost.cli.messages import shown
from fpsboost.cli.options import MethodOptions, PlannedMethodOptions, TuningOptions
from fpsboost.cli.signature import with_flags
from fpsboost.rerender.options import PlanOptions

if TYPE_CHECKING:
    from fpsboost.rerender.plan_file import RerenderPlan

budget, method = Group("Budget", sort_key=1), Group("Method", sort_key=2)


@with_flags
def plan(
    input: Annotated[str, Parameter(name="IN")],
    folder: Annotated[str, Parameter(name="DIR")],
    /,
    *,
    options: Annotated[PlanOptions, budget],
    motion: Annotated[PlannedMethodOptions, method],
) -> None:
    """Say which regions of the frames between are worth rendering.

    Parameters
    ----------
    input
        A folder of rendered images, or a pattern: shot_%04d.png, shot_####.png.
    folder
        A new folder for plan.json and a mask for every frame.
    """
    from fpsboost.rerender.planning import plan_rerender  # noqa: PLC0415

    interpolator = MethodOptions(motion.method, vectors=motion.vectors, depth=motion.depth).interpolator(
        TuningOptions()
    )
    with Console(stderr=True, quiet=motion.quiet).status("making frames whose truth is known"):
        found = plan_rerender(input, folder, options, method=interpolator)
    if not motion.quiet:
        Console(highlight=False).print(plan_table(found, folder))


def plan_table(found: RerenderPlan, folder: str) -> Table:
    """Return what was planned, one name and value per row."""
    started = [frame for frame in found.frames if frame.regions]
    regions = sum(len(frame.regions) for frame in started)
    whole = sum(frame.whole for frame in started)
    table = Table(box=None, pad_edge=False, show_header=False, title=f"[bold]{shown(folder)}[/]", title_justify="left")
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row("frames", f"{len(started)} of {len(found.frames)} that are made" + f", {whole} whole" * (whole > 0))
    table.add_row("regions", f"{regions} rectangles")
    table.add_row("pixels", f"{found.rendered_share:.1%} of those frames")
    if found.seconds is not None:
        table.add_row("rendering", f"{found.seconds:.0f} s")
    before, after = found.expected_error, found.remaining_error
    less = f", {1 - after / before:.0%} less" if before > 0 else ""
    table.add_row("squared error", f"{before:.1f} -> {after:.1f} expected{less}")
    return table
