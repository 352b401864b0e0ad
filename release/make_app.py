"""Make the app: a folder that holds fpsboost and all that it needs, Python included, for the system on which this runs.

``python release/make_app.py`` installs fpsboost and PyInstaller into an environment of their own, puts the folder
together, tries it, prints its size and how long it takes to start, and packs it into ``dist/apps``.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from urllib.request import urlopen

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from hatch_build import this_platform  # noqa: E402 (the path is set before)

PYINSTALLER = "pyinstaller>=6.22,<7"

WINDOWS = sys.platform == "win32"

SUFFIX = ".exe" if WINDOWS else ""


def installed(place: Path, source: str) -> Path:
    """Install fpsboost, its page and PyInstaller into an empty environment; return the folder of its programs."""
    venv.create(place, with_pip=True, clear=True)
    programs = place / ("Scripts" if WINDOWS else "bin")
    package = f"fpsboost[ui] @ {Path(source).resolve().as_uri()}"
    subprocess.run([programs / f"python{SUFFIX}", "-m", "pip", "install", "-q", package, PYINSTALLER], check=True)
    return programs


def freeze(programs: Path, place: Path) -> Path:
    """Put the folder of the app together; return it."""
    place.mkdir(parents=True, exist_ok=True)
    options = ["-y", "--log-level=WARN", "--distpath=.", "--workpath=work", str(ROOT / "release" / "app.spec")]
    # elsewhere than in the repository, whose package would be found before the installed one
    subprocess.run([programs / f"pyinstaller{SUFFIX}", *options], check=True, cwd=place)
    folder = place / "fpsboost"
    shutil.copy(ROOT / "LICENSE", folder)
    if sys.platform == "linux":
        shutil.copy(ROOT / "release" / "add-to-menu.sh", folder)
    return folder


def check_conversion(app: Path, installed_program: Path) -> None:
    """Exit unless the app does with a clip that is dropped on it what the installed program does, to the bit."""
    with tempfile.TemporaryDirectory() as place:
        clip = shutil.copy(ROOT / "samples" / "orbit.mp4", place)
        subprocess.run([app, clip], check=True, stdin=subprocess.DEVNULL)
        other = Path(place, "installed.mp4")
        subprocess.run([installed_program, clip, other], check=True)
        digests = {hashlib.sha256(path.read_bytes()).hexdigest() for path in (Path(place, "orbit-2x.mp4"), other)}
    if len(digests) != 1:
        sys.exit("The app and the installed program make different files of the sample clip.")
    print(f"conversion: as the installed program, SHA-256 {digests.pop()}")


def check_page(app: Path) -> None:
    """Print how long the app takes until it answers with its page, a second time, when its files are in memory."""
    for round_ in ("first", "warm"):
        with tempfile.TemporaryDirectory() as state:  # no page of the user's own is in the way
            before, began = os.times(), time.monotonic()
            process = subprocess.Popen(
                [app, "ui", "--no-browser", "--port", "0"],
                stdout=subprocess.PIPE,
                text=True,
                env=os.environ | {"XDG_STATE_HOME": state, "PYTHONUNBUFFERED": "1"},
            )
            assert process.stdout is not None, "it is a pipe"
            address = next(word for line in process.stdout for word in line.split() if word.startswith("http"))
            with urlopen(address.partition("#")[0]) as answer:
                answer.read()
            wall = time.monotonic() - began
            process.terminate()
            process.wait()
            cpu = sum(os.times()[2:4]) - sum(before[2:4])
        print(f"page, {round_} start: {wall:.1f} s, {cpu:.1f} s of CPU time")


def main() -> None:
    """Make the app of this system, try it and pack it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--from", dest="source", default=str(ROOT), help="wheel to install; the checkout by default")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "apps", help="folder for the packed app")
    options = parser.parse_args()
    work = ROOT / "build" / "app"
    programs = installed(work / "environment", options.source)
    folder = freeze(programs, work)
    app = folder / f"fpsboost{SUFFIX}"
    subprocess.run([app, "doctor"], check=True)
    check_conversion(app, programs / f"fpsboost{SUFFIX}")
    check_page(app)
    version = subprocess.check_output([app, "--version"], text=True).split()[1]
    options.out.mkdir(parents=True, exist_ok=True)
    name = str(options.out / f"fpsboost-{version}-{this_platform()}")
    packed = Path(shutil.make_archive(name, "zip" if WINDOWS else "gztar", folder.parent, folder.name))
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    print(f"size: {size / 1e6:.0f} MB, packed {packed.stat().st_size / 1e6:.0f} MB: {packed}")


if __name__ == "__main__":
    main()
