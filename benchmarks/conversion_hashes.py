"""Does a change leave every result as it was: ``python benchmarks/conversion_hashes.py OUT.json [FOLDER ...]``.

Converts a fixed set: the samples by every method, between all kinds of files, through pipes and after a stop; and up to
`FRAMES` frames of every video and every folder of images in the folders given. Of each result it keeps hashes of the
decoded frames, of their times and of the packets of all other streams, and what was said. ``--against OLD.json`` lists
what differs and exits with 1 if anything does.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import av
import OpenImageIO
from PIL import Image

SAMPLES = Path(__file__).parents[1] / "samples"
CLIP, SCENE = SAMPLES / "orbit.mp4", SAMPLES / "scenes" / "texture"
FAST = "nlm", "nlm-fast", "dis", "farneback", "dis-warp", "farneback-warp", "block", "blend", "nearest"
SLOW = "nlm-exhaustive", "nlm-brute-force", "nlm-passes", "tvl1", "tvl1-warp"
FRAMES = 8


def digest(*parts: Any) -> str:
    """Return a short hash of the representation of values, or of the bytes of arrays."""
    total = hashlib.sha256()
    for part in parts:
        total.update(part if isinstance(part, bytes) else repr(part).encode())
    return total.hexdigest()[:16]


def describe_video(path: Path) -> dict[str, Any]:
    """Return hashes of the frames and packets of a video or animation, and what its header says."""
    described: dict[str, Any] = {}
    with av.open(str(path)) as container:
        described["metadata"] = digest(sorted(container.metadata.items()))
        described["chapters"] = digest(container.chapters())
        streams = [stream for stream in container.streams if stream.type != "attachment"]
        for stream in streams:
            described[f"{stream.index} {stream.type}"] = digest(
                stream.codec_context.name if stream.codec_context else "", stream.time_base, stream.duration,
                sorted(stream.metadata.items()), int(stream.disposition),
            )  # fmt: skip
        for stream in streams:
            container.seek(0, backward=True, any_frame=False) if stream.index else None
            items = _frames(container, stream) if stream.type == "video" else _packets(container, stream)
            for name, values in zip(("times", "content"), zip(*items, strict=True), strict=False):
                described[f"{stream.index} {name}"] = f"{len(values)} {digest(*values)}"
    return described


def _frames(container: Any, stream: Any) -> Iterator[tuple[Any, bytes]]:
    for frame in container.decode(stream):
        planes = (bytes(plane) for plane in frame.reformat(format=frame.format.name).planes)
        look = frame.format.name, frame.width, frame.height, int(frame.colorspace), int(frame.color_range)
        yield (frame.pts, frame.time_base, look), b"".join(planes)


def _packets(container: Any, stream: Any) -> Iterator[tuple[Any, bytes]]:
    for packet in container.demux(stream):
        if packet.size:
            yield (packet.pts, packet.duration), bytes(packet)


def describe_image(path: Path) -> str:
    """Return a hash of the pixels of an image, and of the metadata that Pillow reads."""
    if path.suffix == ".exr":
        return digest(*sorted(_channels(path)))
    with Image.open(path) as image:
        known = {
            name: value for name, value in image.info.items() if isinstance(value, (bytes, str, int, float, tuple))
        }
        return digest(image.size, image.mode, sorted(known.items(), key=lambda item: str(item[0])), image.tobytes())


def _channels(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield names and pixels of the first part of an OpenEXR file, in the type in which each channel is stored."""
    image = OpenImageIO.ImageInput.open(str(path))
    spec = image.spec()
    for number, name in enumerate(spec.channelnames):
        yield name, image.read_image(0, 0, number, number + 1, spec.channelformat(number)).tobytes()


def describe(path: Path) -> dict[str, Any]:
    """Return hashes of whatever a conversion has written."""
    if path.is_dir():
        return {each.name: describe_image(each) for each in sorted(path.iterdir())}
    if path.suffix == ".webp":
        with Image.open(path) as image:
            shown = []
            for number in range(image.n_frames):
                image.seek(number)
                shown.append((image.info.get("duration"), image.convert("RGBA").tobytes()))
            return {"loop": image.info.get("loop"), "frames": f"{len(shown)} {digest(shown)}"}
    if path.suffix == ".y4m":
        return {"stream": digest(path.read_bytes())}
    return describe_video(path)


def run(command: list[str], stdin: Path | None = None, stdout: Path | None = None) -> list[str]:
    """Run fpsboost; return its exit status and what it said, without times and folders."""
    program = [sys.executable, "-m", "fpsboost", *command]
    with (stdin or Path("/dev/null")).open("rb") as source, (stdout or Path("/dev/null")).open("wb") as target:
        done = subprocess.run(program, stdin=source, stdout=target, stderr=subprocess.PIPE, check=False)
    lines = done.stderr.decode(errors="replace").splitlines()
    folder = command[-1] if stdout is None else str(stdout)
    kept = [
        line.replace(str(Path(folder).parent), "").replace(str(SAMPLES), "samples")
        for line in lines
        if line.strip() and "frames/s" not in line
    ]
    return [f"exit {done.returncode}", *(re.sub(r"[\d.]+ s\b", "N s", line) for line in kept)]


def stopped_and_resumed(command: list[str]) -> list[str]:
    """Run fpsboost, stop it after its first chunk, and let it go on."""
    folder = Path(command[-1]).parent
    before = set(folder.rglob("*"))
    program = [sys.executable, "-m", "fpsboost", *command]
    with subprocess.Popen(program, stderr=subprocess.DEVNULL) as running:
        while running.poll() is None and len([p for p in set(folder.rglob("*")) - before if p.is_file()]) < 3:
            time.sleep(0.05)
        running.kill()
    return run([*command[:-1], "--resume", command[-1]])


JobFingerprint = tuple[str, Callable[[Path], list[str]], str]
"""A name, what makes a result in a folder, and the result's name in it."""


def converting(name: str, result: str, *command: object) -> JobFingerprint:
    """Return the job of a conversion to a file or folder."""
    return name, lambda folder: run([*map(str, command), str(folder / result)]), result


def sample_jobs() -> Iterator[JobFingerprint]:
    """Yield conversions of the samples."""
    short = "--end", f"{FRAMES}f"
    for method in (*FAST, *SLOW):
        end = short if method in FAST else ("--end", "4f")
        yield converting(f"orbit by {method}", "out.mp4", CLIP, "-m", method, *end)
    for method in ("reproject-image", "reproject-scene"):
        depth = ("--depth", SCENE / "depth") if method.endswith("scene") else ()
        more = "--vectors", SCENE / "vectors", *depth, "--end", "12f"
        yield converting(f"scene by {method}", "out", SCENE, "-m", method, *more)
    for suffix in (".mkv", ".webm", ".mov", ".gif", ".apng", ".webp"):
        sound = ("--audio-codec", "opus") if suffix == ".webm" else ()
        yield converting(f"orbit to {suffix}", f"out{suffix}", CLIP, "-m", "nlm-fast", *short, *sound)
    for name, options in {
        "rate": ("--fps", "60"),
        "timing": ("--keep-timing",),
        "slow": ("--slow-motion", "--slow-motion-sound", "stretch"),
        "lossless": ("--lossless",),
        "ten bits": ("--pix-fmt", "yuv420p10le", "--codec", "hevc"),
        "threads": ("--threads", "3"),
        "no cuts": ("--no-cuts", "--duplicates", "keep"),
    }.items():
        yield converting(f"orbit, {name}", "out.mp4", CLIP, "-m", "nlm-fast", *options, "--start", "3f", "--end", "13f")
    yield converting("orbit to images", "out/%03d.png", CLIP, "-m", "nlm-fast", *short)
    yield converting("scene to images", "out", SCENE, "-m", "nlm-fast")
    yield converting("scene to video", "out.mp4", SCENE, "-m", "nlm-fast", "--input-fps", "24")
    yield converting("scene, 16-bit", "out/%03d.tiff", SCENE, "-m", "nlm-fast")
    yield "pipe", piped, "out.y4m"
    yield "resumed", lambda folder: stopped_and_resumed([str(CLIP), str(folder / "out.mp4")]), "out.mp4"


def piped(folder: Path) -> list[str]:
    """Convert a video to a stream and the stream to another one."""
    first = folder.parent / "first.y4m"
    said = run([str(CLIP), "-", "-m", "blend", "--end", f"{FRAMES}f"], stdout=first)
    return [*said, *run(["-", "-", "-m", "nlm-fast"], stdin=first, stdout=folder / "out.y4m")]


def given_jobs(folder: Path) -> Iterator[JobFingerprint]:
    """Yield conversions of the videos and folders of images in a folder."""
    options = "-m", "nlm-fast", "--preset", "ultrafast", "--end", f"{FRAMES}f"
    for path in sorted(each for each in folder.iterdir() if not each.name.startswith(".")):
        if path.is_dir():
            yield converting(path.name, "out", path, *options[:2], "--end", "6f")
        elif path.suffix == ".gif":
            yield converting(path.name, "out.gif", path, "-m", "nlm-fast")
        elif path.suffix != ".md":
            yield converting(path.name, "out.mkv", path, *options)


def fingerprint(job: JobFingerprint) -> tuple[str, dict[str, Any]]:
    """Run a job in a folder of its own; return its name and what came out."""
    name, make, result = job
    with tempfile.TemporaryDirectory() as folder:
        inner = Path(folder) / "results"
        path = inner / result
        if "%" in path.name:
            path = path.parent
        (path if "%" in result else inner).mkdir(parents=True)
        said = make(inner)
        return name, {"said": said, "results": describe(path) if path.exists() else {}}


def differences(old: dict[str, Any], new: dict[str, Any]) -> Iterator[str]:
    """Yield a line for each thing that is not as it was."""
    for name in sorted({*old, *new}):
        before, after = old.get(name), new.get(name)
        if before is None or after is None:
            yield f"{name}: only in the {'new' if before is None else 'old'} one"
        elif before != after:
            parts = {**before["results"], **after["results"]}
            changed = [part for part in parts if before["results"].get(part) != after["results"].get(part)]
            shown = ", ".join(changed[:4]) or "the same"
            more = f" and {len(changed) - 4} more" if len(changed) > 4 else ""
            words = "" if before["said"] == after["said"] else f"; said {before['said']}, now {after['said']}"
            yield f"{name}: {shown}{more}{words}"


def main() -> None:
    """Convert, write the hashes, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--against", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    jobs = [*sample_jobs(), *(job for folder in arguments.folders for job in given_jobs(folder))]
    with ThreadPoolExecutor(arguments.jobs) as pool:
        found = dict(pool.map(fingerprint, jobs))
    arguments.out.write_text(json.dumps(found, indent=1, default=str), encoding="utf-8")
    print(f"{len(found)} conversions, {sum(not each['results'] for each in found.values())} without a result")
    if arguments.against:
        lines = list(differences(json.loads(arguments.against.read_text(encoding="utf-8")), found))
        print("\n".join(lines) or "nothing differs")
        sys.exit(bool(lines))


if __name__ == "__main__":
    main()
