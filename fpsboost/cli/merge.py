"""Command `fpsboost merge`: puts rendered regions back into the frames that were made."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Group, Parameter
from rich.console import Console

from fpsboost.cli.messages import console, sentence
from fpsboost.cli.signature import PathName, with_flags
from fpsboost.rerender.options import MergeOptions

group = Group("Options", sort_key=1)


@with_flags
def merge(
    made: Annotated[PathName, Parameter(name="MADE")],
    rendered: Annotated[PathName, Parameter(name="RENDERED")],
    output: Annotated[PathName, Parameter(name="OUT")],
    /,
    *,
    options: Annotated[MergeOptions, group],
) -> None:
    """Put rendered regions back into the frames that were made.

    Parameters
    ----------
    made
        All images of a conversion: a folder or a pattern.
    rendered
        A folder with NAME_0012.png or NAME_0012_1.png, _2, ... for
        frame 12: full frames, or cropped to the regions.
    output
        A new folder. Images without regions are copied.
    """
    from fpsboost.rerender.merging import merge_regions  # noqa: PLC0415

    with Console(stderr=True).status("merging"):
        summary = merge_regions(made, rendered, output, options)
    errors = console()
    errors.print(
        sentence(
            f"{output}: {summary.regions} regions put back into {summary.merged_frames} of {summary.frames} frames, "
            "all others copied"
        )
    )
    for remark in summary.remarks:
        errors.print(f"Note: {sentence(remark)}")
