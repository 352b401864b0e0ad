"""How good: hide every second frame, make it again, compare: ``python benchmarks/quality.py [CLIP ...]``.

A clip is a video, a folder or a pattern of images, or a folder that holds several; the sample clip by default. Frames
are made as a sequence, as in a conversion. Pairs across a scene cut are left out, since no method can know what lies
there. Figures are means over the hidden frames, then over the clips: PSNR of the mean squared error and SSIM as
scikit-image has them, MAE in levels of 255 (what papers call interpolation error), and CPU milliseconds a frame; those
of a peer's command include its start and its files. ``--metrics`` adds those of `fpsboost compare`.

A folder of a published set (Vimeo90K, UCF101, SNU-FILM, Xiph, X-TEST, Middlebury, DAVIS) is read as it is unpacked, and
scored as papers score it (``published_sets.py``): one row of their table for each method.

``--methods`` takes those of `fpsboost compare`, and ``--peer NAME='COMMAND {in} {out}'`` any tool that doubles the
frames of a folder, as `fpsboost compare` runs it (``docs/comparison.md``).

``--published`` prints the table of ``docs/benchmark.md`` in Markdown: of the clips that ``samples`` draws, of its
rendered scenes, and of the clips given, with the hashes of all pixels, so that anybody can repeat it and compare.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from published_sets import PublishedSet, Sample, find_sets
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scoring import (
    SAMPLE,
    Clip,
    Figures,
    Made,
    cells,
    find_clips,
    make_hidden,
    measure_further,
    one_thread,
    read_clip,
    score_clip,
    wide_console,
)

from fpsboost import __version__
from fpsboost.cli.compare import choose, name_others
from fpsboost.colour import normalised
from fpsboost.errors import FpsboostError, InputError
from fpsboost.evaluation.compared_methods import ComparedMethod
from fpsboost.evaluation.export import without_nan
from fpsboost.evaluation.further_metrics import STANDARD, choose_metrics
from fpsboost.evaluation.further_metrics import metrics as further_metrics
from fpsboost.evaluation.peers import run_peer
from fpsboost.evaluation.results import absolute_error, means
from fpsboost.image import Image
from fpsboost.kernels.binding import processor_level

Scores = dict[str, Figures]
"""By method."""

SEED = "2026"
"""Seed of the drawn clips of ``--published``, with which nothing was fitted or chosen."""

PUBLISHED = {
    "constructed": "ea8d3b2e9bd8fdf391481ea8d773531fc3fb13fa87c9c3ebfcc05042f6578423",
    "scenes": "f0b4af86fa515b0cd42a631ea4f142d9bcb401b2cbdf0b3a1611d41674a3aedc",
}
"""Hashes of the frames that ``docs/benchmark.md`` has the figures of, by their folder."""

WORST = 2
"""Pictures of each clip."""

CROP = 96
"""Side of the region that a picture shows, pixels."""

ENLARGED = 3
"""Times, in a picture."""

LABEL = 24
"""Height of a picture's title, pixels."""

FRAMES = 40
"""Hidden frames at most, per clip; of a published set all."""

SET_COLUMNS = {"psnr": ("PSNR, dB", 2), "ssim": ("SSIM", 4), "ssim_y": ("SSIM of luma", 4), "ie": ("IE", 2)}
"""Titles of the figures of published sets, and their digits."""


def make_all(
    clip: Clip, chosen: Mapping[str, ComparedMethod], peers: Mapping[str, str], console: Console
) -> dict[str, Made]:
    """Let every method and peer make the hidden frames; a peer that fails is reported and left out."""
    made = {name: make_hidden(method, clip) for name, method in chosen.items()}
    for name, command in peers.items():
        with tempfile.TemporaryDirectory() as scratch:
            try:
                made[name] = make_hidden(run_peer(name, command, clip.intervals, Path(scratch)), clip)
            except InputError as error:
                console.print(f"{clip.name}: {error}", style="red", markup=False)
    return made


def count_leads(scores: Mapping[str, Scores], measure: str) -> dict[str, int]:
    """Count on how many clips each method is the best by a measure."""
    best = min if measure == "mae" else max
    leaders = [
        best(rows, key={name: row[measure] for name, row in rows.items()}.__getitem__) for rows in scores.values()
    ]
    return {name: leaders.count(name) for rows in scores.values() for name in rows}


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


def measure(arguments: argparse.Namespace, console: Console) -> dict[str, Any]:
    """Score every method and peer on every clip; print as it goes."""
    chosen, _ = choose([arguments.methods], None)
    peers = {peer.name: peer.value for peer in name_others((), arguments.peer)}
    metrics = choose_metrics(arguments.metrics)
    scores: dict[str, Scores] = {}
    folders, hashes = dict[str, str](), dict[str, Any]()
    for name, path in find_clips(arguments.clip or [str(SAMPLE)]).items():
        clip = read_clip(name, path, arguments.frames or FRAMES)
        if not clip.scored:
            console.print(f"{name}: a scene cut in every pair, nothing to score.")
            continue
        folders[name] = Path(path).resolve().parent.name
        pixels = b"".join(image.tobytes() for image in (*clip.shown, *clip.hidden))
        hashes.setdefault(folders[name], hashlib.sha256()).update(pixels)
        made = make_all(clip, chosen, peers, console)
        scores[name] = {each: score_clip(clip, result, metrics) for each, result in made.items()}
        console.print(score_table(f"{name}, {len(clip.scored)} frames", scores[name], list(metrics)))
        if arguments.crops and made:
            write_crops(arguments.crops, clip, made)
    sums = {folder: each.hexdigest() for folder, each in hashes.items()}
    return {"clips": scores, "metrics": list(metrics), "folders": folders, "sha256": sums}


def measure_sets(sets: Sequence[PublishedSet], arguments: argparse.Namespace, console: Console) -> list[dict[str, Any]]:
    """Score every method and peer on published sets; return a row for each."""
    chosen, _ = choose([arguments.methods], None)
    peers = {peer.name: peer.value for peer in name_others((), arguments.peer)}
    metrics = choose_metrics(arguments.metrics)
    rows = []
    for each in sets:
        scored: dict[str, list[tuple[str, Figures]]] = {}
        for sample in track(spread(each.samples, arguments.frames), each.name, console=Console(stderr=True)):
            clip = each.read(sample)
            for method, made in make_all(clip, chosen, peers, console).items():
                figures = each.score(clip, made.images) | measure_further(clip, made, metrics)
                scored.setdefault(method, []).append((sample.clip, figures | {"cpu_ms": made.cpu_ms}))
        for method, found in scored.items():
            count = sum(len(sample.scored) for sample in each.samples[:1]) * len(found)
            rows.append({"set": each.name, "method": method, "frames": count, **each.mean(found)})
    return rows


def spread(samples: Sequence[Sample], largest: int | None) -> Sequence[Sample]:
    """Return so many of the samples at most, from everywhere in the set."""
    if largest is None or largest >= len(samples):
        return samples
    return [samples[(2 * k + 1) * len(samples) // (2 * largest)] for k in range(largest)]


def set_lines(rows: Sequence[Mapping[str, Any]], metrics: Sequence[str]) -> Iterator[str]:
    """Yield the rows of published sets as a table in Markdown."""
    columns = {name: column for name, column in SET_COLUMNS.items() if any(name in row for row in rows)}
    columns |= {name: (further_metrics[name].title, further_metrics[name].digits) for name in metrics}
    columns |= {"cpu_ms": ("CPU, ms", 0)}
    yield f"| set | method | frames | {' | '.join(title for title, _ in columns.values())} |"
    yield f"|{'---|' * (len(columns) + 3)}"
    for row in rows:
        figures = [f"{row[name]:.{digits}f}" if name in row else "" for name, (_, digits) in columns.items()]
        method = f"`{row['method']}`"
        yield f"| {' | '.join([row['set'], method, str(row['frames']), *figures])} |"


def published_lines(figures: Mapping[str, Any]) -> Iterator[str]:
    """Yield the means over the clips of each folder as a table in Markdown, then what was measured, and by what."""
    metrics = figures["metrics"]
    titles = "clips", "method", "PSNR, dB", "SSIM", "MAE", "CPU, ms", *metrics
    yield f"| {' | '.join(titles)} |"
    yield f"|{'---|' * len(titles)}"
    for folder in figures["sha256"]:
        scores = {name: rows for name, rows in figures["clips"].items() if figures["folders"][name] == folder}
        for method, row in mean_scores(scores).items():
            yield f"| {' | '.join([folder, f'`{method}`', *cells(row, metrics)])} |"
    yield ""
    for folder, found in figures["sha256"].items():
        known = f", {'' if PUBLISHED[folder] == found else '**not** '}as published" if folder in PUBLISHED else ""
        yield f"- {folder}: {list(figures['folders'].values()).count(folder)} clips, SHA-256 `{found}`{known}"
    versions = f"fpsboost {__version__}, NumPy {np.__version__}, OpenCV {cv2.__version__}, PyAV {av.__version__}"
    yield f"- {versions}, kernels {processor_level()}, {platform.platform()}, {date.today()}"


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
    parser.add_argument("clip", nargs="*")
    parser.add_argument(
        "--methods", default="nlm,nlm-fast,dis,block,minterpolate,blend", help="names, separated by commas"
    )
    parser.add_argument(
        "--frames", type=int, help=f"hidden frames at most, per clip, else {FRAMES}; samples at most of a published set"
    )
    parser.add_argument(
        "--metrics", action="append", default=[], metavar="NAMES", help=f"besides: {', '.join(further_metrics)}"
    )
    parser.add_argument("--peer", action="append", default=[], metavar="NAME='COMMAND {in} {out}'")
    parser.add_argument("--crops", type=Path, metavar="FOLDER", help="pictures of the worst frames of each clip")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--published", action="store_true", help="the table of docs/benchmark.md, and rows of CLIP")
    arguments = parser.parse_args()
    console = wide_console(stderr=arguments.published)
    one_thread()
    found = {path: find_sets(Path(path)) for path in arguments.clip}
    sets = [each for several in found.values() for each in several]
    arguments.clip = [path for path in arguments.clip if not found[path]]
    with tempfile.TemporaryDirectory() as scratch:
        if arguments.published:
            drawing = [sys.executable, str(SAMPLE.parent / "construct_clips.py"), f"{scratch}/constructed"]
            subprocess.run([*drawing, "--seed", SEED], check=True, stdout=subprocess.DEVNULL)
            arguments.clip = [drawing[-1], str(SAMPLE.parent / "scenes"), *arguments.clip]
            arguments.metrics += STANDARD
        try:
            of_sets = measure_sets(sets, arguments, console)
            figures = measure(arguments, console) if arguments.clip or not sets else {}
        except FpsboostError as error:
            raise SystemExit(str(error)) from error
    if sets:
        print(*set_lines(of_sets, choose_metrics(arguments.metrics)), sep="\n")
        figures["sets"] = of_sets
    if arguments.published:
        print(*published_lines(figures), sep="\n")
    elif "clips" in figures:
        summarise(figures, console)
    if arguments.json:
        arguments.json.write_text(json.dumps(without_nan(figures), indent=1) + "\n")


if __name__ == "__main__":
    main()
