"""Command ``fpsboost doctor``: checks whether fpsboost works on this machine, and gives advice where it does not.

It checks libraries, kernels, codecs and the machine, and makes frames as a self-test. Libraries are imported where they
are checked, because an installation may be broken.
"""

from __future__ import annotations

import json as plain
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import Literal

from rich.console import Console

from fpsboost import __version__
from fpsboost.cli.flags import OwnFlag
from fpsboost.cli.messages import console, fact_table, literal
from fpsboost.memory import available_memory
from fpsboost.threads import available_cores


def doctor(*, json: OwnFlag = False) -> None:
    """Check whether fpsboost works on this machine.

    Parameters
    ----------
    json
        Print JSON.
    """
    with console(quiet=json).status("checking"):
        findings = list(diagnose())
    broken = [finding for finding in findings if finding.advice]
    if json:
        print(plain.dumps({"works": not broken, "findings": [asdict(finding) for finding in findings]}, indent=1))
    else:
        out = Console(highlight=False)
        rows = {
            f"{each.part:10} {each.name}": literal(each.value) + " [red]fails[/]" * bool(each.advice)
            for each in findings
        }
        out.print(fact_table(rows))
        if not broken:
            out.print("[green]Everything works.[/]")
        named = [each for each in findings if each.part in ("programs", "kernels") or each.name == "FFmpeg"]
        line = "; ".join(f"{each.name} {each.value}" for each in named)
        out.print(f"For an issue: {literal(line)}", soft_wrap=True)  # to be pasted: one line in any width
    for finding in broken:
        console().print(f"[red]fpsboost:[/] {literal(finding.advice)}")
    if broken:
        sys.exit(1)


libraries = {
    "NumPy": ("numpy", "numpy"),
    "OpenCV": ("cv2", "opencv-contrib-python-headless"),
    "PyAV": ("av", "av"),
}
"""Module and package of the libraries without which nothing works."""

DECODERS = (
    "h264",
    "hevc",
    "libdav1d",
    "vp8",
    "vp9",
    "mpeg2video",
    "mpeg4",
    "prores",
    "ffv1",
    "mjpeg",
    "aac",
    "libopus",
)
"""FFmpeg's decoders of what people film and render."""

known_digests = {"nlm": "a3feecd2f54655ad", "nlm-fast": "5d96389100c6f04f"}
"""First digits of the digests of `fpsboost.parts.manifest` by method, 8-bit BGR; AVX2 and AVX-512 give the same."""

MAX_ERROR = 4.0
"""Mean absolute error of a frame whose motion is known, of 255, beyond which kernels are broken; 0.02 is usual."""

Part = Literal["programs", "kernels", "codecs", "machine", "self-test"]


@dataclass(frozen=True)
class Finding:
    """Result of a check."""

    part: Part
    name: str
    value: str
    advice: str = ""
    """Sentence with what to do if the check failed; else empty."""


def diagnose() -> Iterator[Finding]:
    """Yield the result of each check as soon as it is known; an error is a result too, a missing library the last."""
    for needed in (_programs, _kernels):
        findings = list(needed())
        yield from findings
        if any(each.advice for each in findings):
            return
    for part, (look, advice) in _looks.items():
        try:
            yield from look()
        except Exception as error:  # a broken library raises anything
            yield Finding(part, "error", f"{type(error).__name__}: {error}".splitlines()[0], advice)


def _programs() -> Iterator[Finding]:
    yield Finding("programs", "fpsboost", __version__)
    yield Finding("programs", "Python", f"{platform.python_version()}, {platform.platform()}")
    for name, (module, package) in libraries.items():
        try:
            yield Finding("programs", name, import_module(module).__version__)
        except ImportError as error:
            yield Finding("programs", name, str(error), f"{name} cannot be imported; reinstall {package} with pip.")


def _kernels() -> Iterator[Finding]:
    from fpsboost.kernels.binding import LEVELS, library, processor_level  # noqa: PLC0415

    try:
        levels = ", ".join(LEVELS[: library().count_levels()])
        yield Finding("kernels", "processor level", f"{processor_level()} of {levels}")
    except ImportError as error:
        yield Finding("kernels", "processor level", "none", str(error))


def _codecs() -> Iterator[Finding]:
    from fpsboost.io.animation.writers import types  # noqa: PLC0415
    from fpsboost.media import encoders, ffmpeg_version, missing_codecs, sound_encoders  # noqa: PLC0415

    yield Finding("codecs", "FFmpeg", ffmpeg_version())
    kinds: dict[str, tuple[list[str], Literal["r", "w"]]] = {
        "video encoders": ([each.name for each in encoders.values()], "w"),
        "sound encoders": (list(sound_encoders.values()), "w"),
        "animation encoders": ([writer.codec for writer in types.values()], "w"),
        "decoders": (list(DECODERS), "r"),
    }
    for kind, (names, mode) in kinds.items():
        missing = missing_codecs(names, mode)
        found = ", ".join(name for name in names if name not in missing) or "none"
        advice = f"This FFmpeg has no {', '.join(missing)}; {REINSTALL_PYAV}" if missing else ""
        yield Finding("codecs", kind, found, advice)


def _machine() -> Iterator[Finding]:
    import cv2  # noqa: PLC0415

    features = [name.strip("*") for name in cv2.getCPUFeaturesLine().split() if not name.endswith("?")]
    processor = platform.processor() or platform.machine()
    yield Finding("machine", "processor", f"{processor}, {', '.join(features) or 'no vector instructions'}")
    yield Finding("machine", "cores", f"{available_cores()} of {os.cpu_count()}; as many pairs of frames in parallel")
    yield Finding("machine", "free memory", f"{available_memory() / 1e9:.1f} GB")


def _self_test() -> Iterator[Finding]:
    import numpy as np  # noqa: PLC0415

    from fpsboost.method_table import interpolate, methods  # noqa: PLC0415
    from fpsboost.parts.manifest import self_test  # noqa: PLC0415

    texture = np.random.default_rng(0).integers(0, 256, (24, 60, 3), np.uint8).repeat(4, axis=0).repeat(4, axis=1)
    for method, known in known_digests.items():
        bits = (
            "same results as on other machines" if self_test(methods[method], texture).startswith(known) else OTHER_BITS
        )
        made = interpolate(texture, np.roll(texture, 8, axis=1), method=method)
        error = float(np.abs(made.astype(float) - np.roll(texture, 4, axis=1))[16:-16, 16:-16].mean())
        advice = "" if error <= MAX_ERROR else f"Frames of {method} are wrong; {REINSTALL}"
        yield Finding("self-test", method, f"{bits}, error {error:.2f} of 255", advice)


REINSTALL_PYAV = "reinstall the wheel of av with pip."
OTHER_BITS = "results differ from other machines: convert parts of one video on machines of this kind only"
REINSTALL = "reinstall fpsboost with pip."

_looks: Mapping[Part, tuple[Callable[[], Iterator[Finding]], str]] = {
    "codecs": (_codecs, f"FFmpeg cannot be used; {REINSTALL_PYAV}"),
    "machine": (_machine, f"The processor cannot be examined; {REINSTALL}"),
    "self-test": (_self_test, f"No frame can be interpolated; {REINSTALL}"),
}
"""Checks after those of programs and kernels, and the advice where one raises an error."""
