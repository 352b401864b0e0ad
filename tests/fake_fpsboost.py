"""A program that answers like fpsboost and copies files instead of making frames; run as a command by tests."""

import json
import re
import shutil
import struct
import sys
import time
import zlib
from pathlib import Path

SIZE = (64, 36)
REGIONS = ([8, 4, 20, 12], [40, 20, 24, 16])
WHOLE = ([0, 0, *SIZE],)


def main() -> None:
    """Do what the command line says, or fail like the program."""
    arguments = [each for each in sys.argv[1:] if each != "-y"]
    options = {}
    for flag in [each for each in arguments if each.startswith("--")]:
        place = arguments.index(flag)
        options[flag] = arguments[place + 1]
        del arguments[place : place + 2]
    known = {"--factor", "--passes", "--confidence", "--progress", "--budget", "--plan", "--vectors", "--vectors-as"}
    unknown = options.keys() - known
    if unknown:
        fail(f"Unknown option: {unknown.pop()}. See fpsboost --help.", 2)
    command = arguments.pop(0) if arguments[0] in {"plan", "merge"} else "convert"
    folders = [Path(each) for each in arguments]
    if folders[0].name == "slow":
        report(1, 100)
        time.sleep(600)
    if not folders[0].is_dir():
        fail(f"{folders[0]} is not there; name a folder of images.", 1)
    {"convert": convert, "plan": plan, "merge": merge}[command](folders, options)
    print("Note: 1 pass is left out.", file=sys.stderr)
    print("done: 2 -> 3 frames", file=sys.stderr)


def convert(folders: list[Path], options: dict[str, str]) -> None:
    """Copy each image to the numbers that follow."""
    renders, made = folders
    factor, confidence = int(options["--factor"]), Path(options["--confidence"])
    images = sorted(renders.glob("*.exr"))
    for folder in (made, confidence):
        folder.mkdir(parents=True, exist_ok=True)
    for place, path in enumerate(images):
        for i in range(factor if path != images[-1] else 1):
            name = re.sub(r"\d+$", lambda found, i=i: f"{int(found[0]) + i:0{len(found[0])}d}", path.stem)
            shutil.copy(path, made / f"{name}.exr")
            if i:
                (confidence / f"{name}.png").write_bytes(gray_png(*SIZE, 200))
        report(place * factor + 1, (len(images) - 1) * factor + 1)


def plan(folders: list[Path], options: dict[str, str]) -> None:
    """Plan two regions of the first frame that is made, and all of the second."""
    renders, target = folders
    check_new(target)
    numbers = [int(path.stem) for path in sorted(renders.glob("*.exr"))]
    frames = [
        {"number": number + 1, "whole": place > 0, "regions": WHOLE if place else REGIONS}
        for place, number in enumerate(numbers[:-1])
    ]
    target.mkdir(parents=True, exist_ok=True)
    (target / "plan.json").write_text(json.dumps({"width": SIZE[0], "height": SIZE[1], "frames": frames}))


def merge(folders: list[Path], options: dict[str, str]) -> None:
    """Copy the made images; rendered regions must be there."""
    made, rendered, target = folders
    if not list(rendered.glob("*.exr")) or not (Path(options["--plan"]) / "plan.json").is_file():
        fail("regions are missing.", 1)
    check_new(target)
    shutil.copytree(made, target)


def check_new(folder: Path) -> None:
    """Refuse a folder that is there already."""
    if folder.exists():
        fail(f"{folder} is there already; name a new folder.", 1)


def report(frames: int, expected: int) -> None:
    """Print progress like ``--progress json``."""
    print(json.dumps({"frame": frames, "frames": expected}), file=sys.stderr, flush=True)


def fail(sentence: str, exit_code: int) -> None:
    """End with an error."""
    print(f"fpsboost: {sentence}", file=sys.stderr)
    sys.exit(exit_code)


def gray_png(width: int, height: int, level: int) -> bytes:
    """Encode a gray image of one level."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    rows = (b"\0" + bytes([level]) * width) * height
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


if __name__ == "__main__":
    main()
