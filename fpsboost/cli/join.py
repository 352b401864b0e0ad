"""Command ``fpsboost join``: put the parts of a conversion together."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Group, Parameter

from fpsboost.cli.options import JoinOptions, MessageOptions
from fpsboost.cli.progress import JsonReporter, Reporter
from fpsboost.cli.signature import PathName, with_flags

group = Group("Options", sort_key=1)


@with_flags
def join(
    output: Annotated[PathName, Parameter(name="OUT")],
    part: Annotated[PathName, Parameter(name="PART")],
    /,
    *more: Annotated[PathName, Parameter(show=False)],
    options: Annotated[JoinOptions, group],
    messages: Annotated[MessageOptions, group],
) -> None:
    """Put the parts of a conversion together.

    Parameters
    ----------
    output
        A video or folder of the type that the parts were made for.
    part
        The folders of all parts, in any order,
        or the folder that holds them: OUT.parts.
    more
        Further parts.
    """
    from fpsboost.parts.join import join as join_parts  # noqa: PLC0415 (--help need not wait for FFmpeg)

    reporter: Reporter | JsonReporter = (
        JsonReporter(output)
        if messages.progress == "json"
        else Reporter(output, quiet=messages.quiet, verbose=messages.verbose)
    )
    with reporter:
        summary = join_parts(output, [part, *more], input=options.input, overwrite=options.overwrite, observer=reporter)
    reporter.say_summary(summary)
