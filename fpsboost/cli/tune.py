"""Command `fpsboost tune`: finds the options of the report's method that suit a clip."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter
from rich.console import Console
from rich.table import Table

from fpsboost.cli.compare import Progressing, frames_group, hiding_of
from fpsboost.cli.messages import literal
from fpsboost.cli.options import HidingOptions, PathName, SweepOptions, with_flags
from fpsboost.io.new_output import check_writable
from fpsboost.io.video.decode_options import DecodeOptions

if TYPE_CHECKING:
    from fpsboost.evaluation.tune import Trial, Tuning

results = Group("Results", sort_key=3)

MAX_BAR_LENGTH = 24  # length of the longest bar, characters


@with_flags
def tune(
    input: Annotated[PathName, Parameter(name="IN")],
    /,
    *,
    decoding: Annotated[DecodeOptions, frames_group],
    frames: Annotated[HidingOptions, frames_group],
    sweep: Annotated[SweepOptions, Group("What is tried", sort_key=2)],
    figure: Annotated[PathName | None, Parameter(group=results, metavar="FILE")] = None,
    quiet: Annotated[bool, Parameter(group=results, name=["--quiet", "-q"])] = False,
) -> None:
    """Try search radii, patch sizes, windows and v on a few hidden frames, and say which to use.

    Parameters
    ----------
    input
        A video file, a folder of images, or a pattern: shot_%04d.png, shot_####.png.
    figure
        New file with the curves: .svg, .png or .pdf.
    quiet
        Print the options only.
    """
    from fpsboost.evaluation.tune import DEFAULT, check_drawable, draw_tuning  # noqa: PLC0415
    from fpsboost.evaluation.tune import tune as run  # noqa: PLC0415

    console = Console(highlight=False)
    hiding = hiding_of(frames, decoding)
    if figure is not None:
        check_writable(Path(figure), figure)
        check_drawable(Path(figure))
    with Progressing(quiet=quiet) as progress:
        tuning = run(input, sweep.method, hiding, sweep.frames, progress)
    if figure is not None:
        draw_tuning(tuning, Path(figure))
    if not quiet:
        numbers = ", ".join(map(str, tuning.frames))
        console.print(literal(f"{input}, frames {numbers}: mean squared error, levels of 255; CPU seconds a frame."))
        for name, trials in tuning.sweeps.items():
            console.print(table(name, trials, tuning))
        best, default = tuning.best, tuning.default
        other = "with its own values" if tuning.method == DEFAULT else f"the default, {DEFAULT},"
        with_these = (
            f"With these, {tuning.method} has an MSE of {best.mse:.2f} at {best.cpu_seconds:.2f} CPU s a frame;"
        )
        console.print(literal(f"{with_these} {other} {default.mse:.2f} at {default.cpu_seconds:.2f}."))
        console.print("In a comparison:")
        options = ",".join(f"{name.replace('_', '-')}={value}" for name, value in best.options.items())
        console.print(literal(f"-m {tuning.method}:{options}"), soft_wrap=True)
        console.print("In a conversion:")
    options = " ".join(f"--{name.replace('_', '-')} {value}" for name, value in tuning.best.options.items())
    console.print(literal(f"--method {tuning.method} {options}"), soft_wrap=True)


def table(name: str, trials: list[Trial], tuning: Tuning) -> Table:
    """Return the table of one sweep, with bars."""
    sweep_table = Table(name.replace("_", " "), box=None, title=None, pad_edge=False)
    windowed = name == "patch_radius" and "window" in trials[0].options
    if windowed:
        sweep_table.add_column("window")
    sweep_table.add_column("MSE", justify="right")
    sweep_table.add_column("")
    sweep_table.add_column("CPU s", justify="right")
    largest = max(trial.mse for trial in trials)
    best = tuning.best.options
    for trial in trials:
        is_best = trial.options[name] == best[name] and (not windowed or trial.options["window"] == best["window"])
        sweep_table.add_row(
            str(trial.options[name]),
            *([trial.options["window"]] if windowed else []),
            f"{trial.mse:.2f}",
            "█" * max(1, round(MAX_BAR_LENGTH * trial.mse / largest)),
            f"{trial.cpu_seconds:.2f}",
            style="bold green" if is_best else "",
        )
    return sweep_table
