"""How good: hide every second frame, make it again, compare: ``python benchmarks/quality.py [CLIP ...]``.

A clip is a video, a folder or a pattern of images, or a folder that holds several; the sample clip by default. Frames
are made as a sequence, as in a conversion. Pairs across a scene cut are left out, since no method can know what lies
there. Figures are means over the hidden frames, then over the clips: PSNR of the mean squared error and SSIM as
scikit-image has them, MAE in levels of 255 (what the Middlebury tables call interpolation error), and CPU milliseconds
a frame; those of a peer's command include its start and its files. ``--metrics`` adds those of `fpsboost compare`.

``--peer NAME='COMMAND {in} {out}'`` scores any tool that doubles the frames of a folder: the even frames lie in {in} as
PNG, and {out}, which does not exist yet, gets all frames as images whose names sort.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import shlex
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scoring import (
    SAMPLE,
    Clip,
    Figures,
    Made,
    cells,
    find_clips,
    make_hidden,
    one_thread,
    read_clip,
    score_clip,
    three_colours,
    wide_console,
)

from fpsboost.colour import normalised
from fpsboost.errors import FpsboostError, InputError, OptionError
from fpsboost.evaluation.further_metrics import choose_metrics
from fpsboost.evaluation.further_metrics import metrics as further_metrics
from fpsboost.evaluation.results import absolute_error, means
from fpsboost.image import Image
from fpsboost.io.images.files import IMAGE_SUFFIXES, read_image
from fpsboost.method_table import find_method, methods

Scores = dict[str, Figures]
"""By method."""

WORST = 2
"""Pictures of each clip."""

CROP = 96
"""Side of the region that a picture shows, pixels."""

ENLARGED = 3
"""Times, in a picture."""

LABEL = 24
"""Height of a picture's title, pixels."""


def run_peer(command: str, clip: Clip) -> Made:
    """Let a command double the even frames in a scratch folder, and read what it made."""
    with tempfile.TemporaryDirectory() as scratch:
        source, target = Path(scratch, "in"), Path(scratch, "out")
        source.mkdir()
        for number, image in enumerate(clip.shown):
            cv2.imwrite(str(source / f"{number:04d}.png"), _as_integers(image))
        filled = command.replace("{in}", shlex.quote(str(source))).replace("{out}", shlex.quote(str(target)))
        begin = _seconds_of_children()
        ended = subprocess.run(filled, shell=True, capture_output=True, text=True, check=False)
        spent = _seconds_of_children() - begin
        files = sorted(each for each in target.glob("*") if each.suffix.lower() in IMAGE_SUFFIXES)
        expected = len(clip.shown) + len(clip.hidden)
        if ended.returncode or len(files) < expected:
            raise InputError(
                f"{filled} ended with code {ended.returncode} and wrote {len(files)} images of {expected}: "
                f"{ended.stderr.strip()[-300:]}"
            )
        images = [three_colours(read_image(each)) for each in files[1:expected:2]]
    if any(image.shape != clip.hidden[0].shape for image in images):
        raise InputError(f"{filled} made images of {images[0].shape}, not of {clip.hidden[0].shape}.")
    return Made(images, spent * 1e3 / len(images), [])


def _as_integers(image: Image) -> Image:
    if image.dtype != np.float32:
        return image
    whole: Image = np.rint(np.clip(normalised(image), 0, 1) * 65535).astype(np.uint16)
    return whole


def _seconds_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def count_leads(scores: Mapping[str, Scores], measure: str) -> dict[str, int]:
    """Count on how many clips each method is the best by a measure."""
    best = min if measure == "mae" else max
    counts: dict[str, int] = {}
    for rows in scores.values():
        values = {name: row[measure] for name, row in rows.items()}
        for name in values:
            counts.setdefault(name, 0)
        counts[best(values, key=values.__getitem__)] += 1
    return counts


def mean_scores(scores: Mapping[str, Scores]) -> Scores:
    """Return each method's mean scores over the clips that every method could do."""
    names = {name: None for rows in scores.values() for name in rows}
    complete = [rows for rows in scores.values() if len(rows) == len(names)]
    return {name: means([rows[name] for rows in complete]) for name in names} if complete else {}


def write_crops(folder: Path, clip: Clip, made: Mapping[str, Made]) -> None:
    """Write crops of where the first method errs most: the truth and every method's frame, side by side."""
    first = next(iter(made.values()))
    errors = {index: absolute_error(clip.hidden[index], first.images[index]) for index in clip.scored}
    for index in sorted(errors, key=lambda index: -float(errors[index].mean()))[:WORST]:
        around = cv2.blur(errors[index], (CROP, CROP))
        y, x = np.unravel_index(int(around.argmax()), around.shape)
        height, width = around.shape
        top, left = max(0, min(int(y) - CROP // 2, height - CROP)), max(0, min(int(x) - CROP // 2, width - CROP))
        views = {"truth": clip.hidden[index], **{name: each.images[index] for name, each in made.items()}}
        tiles = [_labelled(name, image[top : top + CROP, left : left + CROP]) for name, image in views.items()]
        folder.mkdir(parents=True, exist_ok=True)
        name = clip.name.replace("/", "_")
        cv2.imwrite(str(folder / f"{name}_{2 * index + 1:04d}.png"), cv2.hconcat(tiles))


def _labelled(name: str, image: Image) -> NDArray[Any]:
    """Return an enlarged crop with its name above and a gap beside."""
    values = np.rint(np.clip(normalised(image), 0, 1) * 255).astype(np.uint8)
    large = cv2.resize(values, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_NEAREST)
    framed: NDArray[Any] = cv2.copyMakeBorder(large, LABEL, 0, 0, 4, cv2.BORDER_CONSTANT, value=(255, 255, 255))
    cv2.putText(framed, name, (2, LABEL - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return framed


def score_table(title: str, scores: Scores, metrics: Sequence[str]) -> Table:
    """Return a table of PSNR, SSIM, MAE, CPU time and further metrics by method."""
    further = [further_metrics[name].title for name in metrics]
    table = Table("method", "PSNR, dB", "SSIM", "MAE", "CPU, ms", *further, title=title)
    for name, row in scores.items():
        table.add_row(name, *cells(row, metrics))
    return table


def parse_peers(texts: list[str]) -> dict[str, str]:
    """Parse texts of the form NAME=COMMAND into commands by name."""
    peers = dict(text.partition("=")[::2] for text in texts)
    for name, command in peers.items():
        if "{in}" not in command or "{out}" not in command:
            raise OptionError(f"--peer {name} must read NAME='COMMAND {{in}} {{out}}'.")
    return peers


def measure(arguments: argparse.Namespace, console: Console) -> dict[str, Any]:
    """Score every method and peer on every clip; print as it goes."""
    chosen = {name: find_method(name) for name in arguments.methods.split(",") if name}
    peers = parse_peers(arguments.peer)
    metrics = choose_metrics(arguments.metrics)
    scores: dict[str, Scores] = {}
    for name, path in find_clips(arguments.clip).items():
        clip = read_clip(name, path, arguments.frames)
        if not clip.scored:
            console.print(f"{name}: a scene cut in every pair, nothing to score.")
            continue
        made = {each: make_hidden(method, clip) for each, method in chosen.items()}
        for each, command in peers.items():
            try:
                made[each] = run_peer(command, clip)
            except InputError as error:
                console.print(f"{name}: {error}", style="red", markup=False)
        scores[name] = {each: score_clip(clip, result, metrics) for each, result in made.items()}
        console.print(score_table(f"{name}, {len(clip.scored)} frames", scores[name], metrics))
        if arguments.crops and made:
            write_crops(arguments.crops, clip, made)
    return {"clips": scores, "metrics": metrics}


def summarise(figures: dict[str, Any], console: Console) -> None:
    """Add the means over the clips and the number of clips that each method leads, and print both."""
    scores = figures["clips"]
    figures["mean"] = mean_scores(scores)
    if figures["mean"]:
        complete = sum(len(rows) == len(figures["mean"]) for rows in scores.values())
        console.print(score_table(f"Mean of {complete} clips", figures["mean"], figures["metrics"]))
    else:
        console.print("There is no clip that every method could do, hence no mean.")
    figures["leads"] = {measure: count_leads(scores, measure) for measure in ("psnr", "ssim", "mae")}
    for measure_name, counts in figures["leads"].items():
        listed = ", ".join(f"{name} {count}" for name, count in sorted(counts.items(), key=lambda item: -item[1]))
        console.print(f"Leads by {measure_name.upper()}, of {len(scores)} clips: {listed}", highlight=False)


def main() -> None:
    """Print a table for each clip and their means, and write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="*", default=[str(SAMPLE)])
    parser.add_argument("--methods", default=",".join(methods), help="names, separated by commas")
    parser.add_argument("--frames", type=int, default=40, help="hidden frames at most, per clip")
    parser.add_argument(
        "--metrics", action="append", default=[], metavar="NAMES", help=f"besides: {', '.join(further_metrics)}"
    )
    parser.add_argument("--peer", action="append", default=[], metavar="NAME='COMMAND {in} {out}'")
    parser.add_argument("--crops", type=Path, metavar="FOLDER", help="pictures of the worst frames of each clip")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    console = wide_console()
    one_thread()
    try:
        figures = measure(arguments, console)
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    summarise(figures, console)
    if arguments.json:
        arguments.json.write_text(json.dumps(_without_nan(figures), indent=1) + "\n")


def _without_nan(value: Any) -> Any:
    """Replace numbers that are not finite by None, because JSON has none."""
    if isinstance(value, dict):
        return {key: _without_nan(each) for key, each in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    main()
