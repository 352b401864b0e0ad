"""Commands of the user's: programs that interpolate frames, or compare them, and get folders of pictures.

`docs/comparison.md` describes what they get, and what they must return.
"""

import re
import shlex
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from textwrap import shorten

import numpy as np

from fpsboost.colour import as_shown
from fpsboost.errors import InputError, OptionError, explained
from fpsboost.image import Image
from fpsboost.io.images.encoder import encode_image
from fpsboost.media import counted

MAX_SHOWN = 80
"""Maximum number of characters of a metric's output in a message."""

NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
"""Finite number of a metric, as a command prints it."""

FOLDERS = "truth", "made"
"""Folders of `PicturesMeter`: the true frames, and the interpolated ones."""

PLACEHOLDERS = "{truth}", "{made}"
"""Placeholders of a command for these."""


def split_command(option: str, name: str, command: str, placeholders: Sequence[str]) -> list[str]:
    """Split a command into words; the option that gives it, and its name, are for messages.

    Raises `OptionError` if that fails, or a placeholder is missing.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise OptionError(f"The command of the {option} {name} cannot be read ({error}); check its quotes.") from None
    missing = [each for each in placeholders if each not in command]
    if missing:
        usage = " ".join(placeholders)
        raise OptionError(
            f"The command of the {option} {name} lacks {' and '.join(missing)}; write it like 'tool {usage}'."
        )
    return words


def run_command(
    option: str, name: str, words: Sequence[str], values: Mapping[str, object], place: Path | None = None
) -> tuple[str, str]:
    """Run a command to its end with values for its placeholders; return what it printed on standard output.

    The second is the last line of its error output, or else of its standard output. `place` is the folder in which it
    runs, else that is the current one; `option` and `name` are those of `split_command`. Raises `InputError` if it
    cannot be run, or fails.
    """
    for placeholder, value in values.items():
        words = [word.replace(placeholder, str(value)) for word in words]
    try:
        process = subprocess.run(
            words, cwd=place, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", check=False
        )
    except OSError as error:
        reason = f"{error.strerror}: {words[0]}"
        raise InputError(f"The {option} {name} cannot be run ({reason}); check `{option}`.") from None
    lines = ["", *(process.stderr.strip() or process.stdout.strip()).splitlines()]
    last_line = lines[-1].strip()
    code = process.returncode
    if code:
        how = f"exit code {code}" if code > 0 else f"signal {-code}"
        raise InputError(f"The {option} {name} failed with {how}: {last_line or 'it printed nothing'}")
    return process.stdout, last_line


def write_frame(folder: Path, number: int, image: Image) -> None:
    """Write a frame as PNG, or as OpenEXR if it is float."""
    is_float = image.dtype == np.float32
    path = folder / f"{number:04d}.{'exr' if is_float else 'png'}"
    if image.shape[2] == 2 and not is_float:  # PNG by OpenCV has no gray with alpha
        image = image[..., [0, 0, 0, 1]]
    with explained(InputError, "write to", folder, "free some space there, or name another folder with TMPDIR"):
        path.write_bytes(encode_image(path, np.ascontiguousarray(image), half=False))


class PicturesMeter:
    """Meter that writes the frames that count as pictures of 8 bits, and has them measured at the end.

    It gets a function that measures `FOLDERS` in a folder, with as many pictures each as it is told.
    """

    def __init__(self, measure: Callable[[Path, int], list[float]]) -> None:
        self._measure = measure
        self._count = 0
        self._folder = Path(tempfile.mkdtemp(prefix="fpsboost-"))
        self._remove = weakref.finalize(self, shutil.rmtree, self._folder)
        for name in FOLDERS:
            (self._folder / name).mkdir()

    def add(self, truth: Image, image: Image, *, counts: bool = True) -> None:
        """Write the next frame, if it counts."""
        if counts:
            for name, each in zip(FOLDERS, (truth, image), strict=True):
                write_frame(self._folder / name, self._count, as_shown(each))
            self._count += 1

    def values(self) -> list[float]:
        """Return the value of each frame that counts, and remove the pictures."""
        values = self._measure(self._folder, self._count)
        self._remove()
        return values


def measure_by_command(name: str, words: Sequence[str], folder: Path, count: int) -> list[float]:
    """Return the numbers that a command of the user's prints for each picture; one in all is that of each.

    Raises `InputError` if the command fails, or prints anything else.
    """
    text, last_line = run_command("metric", name, words, {f"{{{each}}}": folder / each for each in FOLDERS})
    printed = text.split()
    numbers = [float(each) for each in printed if re.fullmatch(NUMBER, each)]
    if len(printed) not in {1, count} or len(numbers) < len(printed):
        raise InputError(
            f"The metric {name} printed {shorten(text, MAX_SHOWN) or last_line or 'nothing'!r}; its command must print "
            f"{counted(count, 'number')}, one for each frame, or one in all, and nothing else on standard output."
        )
    return numbers if len(numbers) == count else numbers * count
