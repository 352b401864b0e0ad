"""Damaged copies of small clips, converted one after the other: a program of its own, since codecs may crash.

``python fuzzing.py FOLDER SEED COUNT KIND...`` prints a line of JSON before each copy and one after it.
"""

import faulthandler
import json
import random
import shutil
import sys
import warnings
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from fpsboost import DecodeOptions, Timing, VectorFolder, conversion, find_method, threads
from fpsboost.errors import FpsboostError, notes_of
from fpsboost.io.images.exr import read_exr
from fpsboost.io.images.files import read_image
from fpsboost.io.side.flow import encode_flow
from support.exr_truth import write_exr
from support.video_truth import scene, stream_of, write_clip

SECONDS_PER_COPY = 30
SIZE = (32, 48)
NUMBERS = [b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0" * 4, b"\x80\0\0\0", b"\0\0\xea\x60"]

videos = {
    "h264.mp4": {"sound": "aac", "options": {"g": "3"}},
    "h264.mkv": {"sound": "aac", "subtitles": [(0, 100, b"hi")], "chapters": True, "options": {"g": "3"}},
    "vp9.webm": {"codec": "libvpx-vp9", "sound": "libopus", "options": {"cpu-used": "8"}},
    "prores.mov": {"codec": "prores_ks", "pixel_format": "yuv422p10le", "sound": "pcm_s16le"},
    "mjpeg.avi": {"codec": "mjpeg", "pixel_format": "yuvj420p"},
    "mpeg2.ts": {"codec": "mpeg2video", "sound": "mp2"},
    "gif.gif": {"codec": "gif", "pixel_format": "rgb8"},
}
images = {
    "png": np.uint8,
    "16.png": np.uint16,
    "jpg": np.uint8,
    "webp": np.uint8,
    "bmp": np.uint8,
    "tif": np.uint8,
    "float.tif": np.float32,
    "exr": np.float32,
}
KINDS = [*videos, "stream.y4m", *images, "flo"]


def make_sample(folder: Path, kind: str) -> Path:
    """A video, or a folder of images or vectors."""
    path = folder / kind
    if kind in videos:
        return write_clip(path, times=range(6), size=SIZE, **videos[kind])
    if kind == "stream.y4m":
        path.write_bytes(stream_of(4, size=SIZE))
        return path
    path.mkdir()
    ending = "png" if kind == "flo" else kind.rsplit(".", maxsplit=1)[-1]
    for number in range(3):
        save_image(path / f"f{number:04d}.{ending}", number, images.get(kind))
    if kind == "flo":
        (path / "vectors").mkdir()
        for number in range(5):
            for way in ("backward", "forward"):
                (path / "vectors" / f"v{number:04d}_{way}.flo").write_bytes(
                    encode_flow(np.ones((*SIZE, 2), np.float32))
                )
    return path


def save_image(path: Path, number: int, dtype: type | None) -> None:
    image = scene(number, *SIZE)
    if dtype is np.uint16:
        image = image.astype(np.uint16) * 257
    if dtype is np.float32:
        image = image / np.float32(255)
    if path.suffix == ".exr":
        write_exr(path, dict(zip("BGR", np.moveaxis(image, -1, 0), strict=True)))
    else:
        path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Cut short, bits flipped, bytes overwritten, missing or twice; half of it near the beginning."""
    spoilt = bytearray(data)
    for _ in range(chance.choice([1, 1, 2, 3])):
        end = min(len(spoilt), 400) if chance.random() < 0.5 else len(spoilt)
        places = [chance.randrange(max(end, 1)) for _ in range(chance.choice([1, 2, 5, 30]))]
        place, length = places[0], chance.randrange(1, 60)
        way = chance.choice(["cut", "flip", "flip", "noise", "number", "zeros", "missing", "twice"])
        if way == "cut":
            del spoilt[place:]
        elif way == "flip":
            for each in places:
                spoilt[each : each + 1] = bytes(byte ^ 1 << chance.randrange(8) for byte in spoilt[each : each + 1])
        elif way in ("noise", "zeros", "number"):
            new = {"noise": chance.randbytes(length), "zeros": bytes(length), "number": chance.choice(NUMBERS)}[way]
            spoilt[place : place + len(new)] = new
        elif way == "missing":
            del spoilt[place : place + length]
        else:
            spoilt[place:place] = spoilt[place : place + length]
    return bytes(spoilt)


def convert(sample: Path, kind: str, work: Path, chance: random.Random) -> str:
    """Damage a copy, convert it, and look at what came out."""
    source, method = work / f"in{sample.suffix if sample.is_file() else ''}", find_method("blend")
    if sample.is_dir():
        shutil.copytree(sample, source)
        victim = chance.choice(sorted(path for path in source.rglob("*.*") if kind != "flo" or path.suffix == ".flo"))
        victim.write_bytes(damaged(victim.read_bytes(), chance))
        if kind == "flo":
            method = find_method("reproject-scene", VectorFolder(str((source / "vectors").rename(work / "vectors"))))
    else:
        source.write_bytes(damaged(sample.read_bytes(), chance))
    output = work / chance.choice(["out.mkv", "out.mp4", "out"])
    fps, rate = chance.choice([None, Fraction(50)]), Fraction(25) if sample.is_dir() else None
    try:
        conversion.convert(
            str(source),
            str(output),
            method=method,
            timing=Timing(fps=None if kind == "flo" else fps),
            decoding=DecodeOptions(input_fps=rate),
        )
    except FpsboostError as error:
        assert not output.exists(), "an output that failed has its name"
        kept = hidden(work) if not notes_of(error) else []
        assert not kept, "something is left behind that nobody is told of"
        return f"refused: {error}"
    assert not hidden(work), "something is left behind"
    check(output)
    return "converted"


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def check(output: Path) -> None:
    """Everything in an output can be read again."""
    if output.is_file():
        from support.video_truth import pictures_of  # noqa: PLC0415

        assert len(pictures_of(output)) >= 2
        return
    for path in output.iterdir():  # images of the source are passed on as they are: damaged, but read by us
        (read_exr if path.suffix == ".exr" else read_image)(path)


def main(folder: Path, seed: int, count: int, kinds: list[str]) -> None:
    warnings.simplefilter("error")
    threads.POLL_INTERVAL = 0.005
    results, sys.stdout = sys.stdout, sys.stderr  # where OpenEXR prints warnings
    for kind in kinds:
        sample = make_sample(folder, kind)
        for number in range(count):
            print(json.dumps({"kind": kind, "number": number}), file=results, flush=True)
            work = folder / "work"
            work.mkdir()
            faulthandler.dump_traceback_later(SECONDS_PER_COPY, exit=True)
            outcome = convert(sample, kind, work, random.Random(f"{seed} {kind} {number}"))
            print(json.dumps(outcome), file=results, flush=True)
            faulthandler.cancel_dump_traceback_later()
            shutil.rmtree(work)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
