"""The report's Figure 7 for any material: error against the patch radius, with and without the Gaussian."""

from __future__ import annotations

from pathlib import Path

from fpsboost.errors import OutputError
from fpsboost.evaluation.tune import Trial, Tuning
from fpsboost.evaluation.writing import appearing

COLOURS = {"box": "#0072b2", "gaussian": "#e69f00", "": "#0072b2"}
LABELS = {"box": "box", "gaussian": "Gaussian", "": ""}
FORMATS = (".svg", ".png", ".pdf")


def draw_tuning(tuning: Tuning, path: Path) -> None:
    """Draw all sweeps side by side into a new file.

    Parameters
    ----------
    tuning : Tuning
    path : Path
        Ends in .svg, .png or .pdf.

    Raises
    ------
    OutputError
        The ending is another, or the file cannot be written.
    """
    # takes half a second, and only this needs it
    from matplotlib.figure import Figure  # noqa: PLC0415
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415

    check_drawable(path)
    figure = Figure(figsize=(4 * len(tuning.sweeps), 3.4), layout="constrained")
    for axes, (name, trials) in zip(
        figure.subplots(1, len(tuning.sweeps), squeeze=False)[0], tuning.sweeps.items(), strict=True
    ):
        for window, curve in _curves(name, trials).items():
            x, y = zip(*curve, strict=True)
            axes.plot(x, y, "o-", color=COLOURS[window], label=LABELS[window], markersize=4)
        chosen = tuning.best.options[name]
        axes.axvline(chosen, color="0.6", linewidth=0.8, linestyle="--")
        axes.set_xlabel(f"{name.replace('_', ' ')}{'' if name == 'v' else ', pixels'}")
        axes.set_ylim(0, 1.08 * max(trial.mse for trial in trials))
        axes.spines[["top", "right"]].set_visible(False)
        if name != "v":
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if len(_curves(name, trials)) > 1:
            axes.legend(frameon=False)
    figure.axes[0].set_ylabel("mean squared error, levels of 255")
    with appearing(path) as unfinished:
        figure.savefig(unfinished, dpi=150)


def check_drawable(path: Path) -> None:
    """Raise `OutputError` if the file's ending is none that can be drawn."""
    if path.suffix.lower() not in FORMATS:
        raise OutputError(f"{path} cannot be drawn; choose a name that ends in {', '.join(FORMATS)}.")


def _curves(name: str, trials: list[Trial]) -> dict[str, list[tuple[float, float]]]:
    """Error against the swept value; where the windows are swept too, one curve each."""
    curves: dict[str, list[tuple[float, float]]] = {}
    for trial in trials:
        window = trial.options.get("window", "") if name == "patch_radius" else ""
        curves.setdefault(window, []).append((trial.options[name], trial.mse))
    return curves
