"""Make a release: the source distribution, a wheel for every platform, recipes of package managers, and its text.

``python release/make_release.py`` compiles for all platforms on any one of them, checks what it has made, installs the
wheel of this machine into empty environments, and converts the sample clip there. It uploads nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from jinja2 import Environment, FileSystemLoader, StrictUndefined

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from hatch_build import PLATFORMS, Platform, this_platform  # noqa: E402 (the path is set before)

PYTHONS = ("3.11", "3.13", "3.14")

SUFFIXES = {".py", ".pyi", ".typed", ".cpp", ".h", ".j2", ".css", ".js"}
"""Of the files of the package."""

MAGIC = {".so": b"\x7fELF", ".dylib": b"\xcf\xfa\xed\xfe", ".dll": b"MZ"}
"""First bytes of a library, by its suffix."""

MAX_WHEEL = 5e6
"""Size beyond which something is in a wheel that does not belong there, bytes."""

BIN = "Scripts" if sys.platform == "win32" else "bin"


def build_source(out: Path) -> Path:
    """Build the source distribution into a folder that is emptied; return its path."""
    shutil.rmtree(out, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "build", "--no-isolation", "--sdist", "--outdir", out, ROOT], check=True)
    return next(out.glob("*.tar.gz"))


def build_wheel(source: Path, name: str) -> Path:
    """Build the wheel for a platform of `PLATFORMS` beside the source distribution it is made of; return its path."""
    command = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(source.parent), str(source)]
    subprocess.run(command, check=True, env=os.environ | {"FPSBOOST_PLATFORM": name})
    return next(source.parent.glob(f"*-{PLATFORMS[name].tag}.whl"))


def faults(wheel: Path, platform: Platform, package: set[str]) -> Iterator[str]:
    """Yield what is wrong with a wheel.

    Parameters
    ----------
    wheel : Path
        The wheel.
    platform : Platform
        What it is for.
    package : set of str
        Paths of the files of the package in the source distribution.
    """
    kernels = f"fpsboost/native/kernels{platform.suffix}"
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        if names != package | {kernels}:
            yield f"other files than those of the package and its kernels: {sorted(names ^ (package | {kernels}))}"
        elif not archive.read(kernels).startswith(MAGIC[platform.suffix]):
            yield f"{kernels} is no library of this platform"
    if stray := sorted(name for name in package if PurePosixPath(name).suffix not in SUFFIXES):
        yield f"files that do not belong there: {stray}"
    if wheel.stat().st_size > MAX_WHEEL:
        yield f"{wheel.stat().st_size / 1e6:.1f} MB, more than {MAX_WHEEL / 1e6:.0f}"


def check(out: Path, version: str) -> None:
    """Check metadata and contents of all that was built; exit with what is wrong."""
    built = sorted(out.iterdir())
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *map(str, built)], check=True)
    root = f"fpsboost-{version}/"
    with tarfile.open(out / f"fpsboost-{version}.tar.gz") as source:
        files = {name.removeprefix(root) for name in source.getnames()}
    package = {name for name in files if name.startswith("fpsboost/")}
    wheels = {out / f"fpsboost-{version}-py3-none-{each.tag}.whl": each for each in PLATFORMS.values()}
    if missing := wheels.keys() - set(built):
        sys.exit(f"These wheels are missing: {sorted(path.name for path in missing)}.")
    wrong = [f"{path.name}: {fault}" for path, each in wheels.items() for fault in faults(path, each, package)]
    if wrong:
        sys.exit("\n".join(wrong))
    for path in built:
        print(f"{path.stat().st_size / 1e6:6.2f} MB  {path.name}")


def find_python(version: str) -> str | None:
    """Return the newest Python of a version that pyenv has installed, else that on the PATH, if there is one."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    found = sorted(pyenv.glob(f"versions/{version}.*/bin/python"), key=lambda path: int(path.parts[-3].split(".")[2]))
    return str(found[-1]) if found else shutil.which(f"python{version}")


def try_wheel(python: str, wheel: Path) -> str:
    """Install a wheel into an empty environment, let it check itself and convert the sample clip.

    Returns
    -------
    str
        Versions of Python and FFmpeg that did it.

    Raises
    ------
    subprocess.CalledProcessError
        Something fails.
    """
    with tempfile.TemporaryDirectory() as place:
        subprocess.run([python, "-m", "venv", place], check=True)
        programs = Path(place, BIN)
        subprocess.run(
            [programs / "python", "-m", "pip", "install", "-q", f"fpsboost[ui] @ {wheel.as_uri()}"], check=True
        )
        subprocess.run([programs / "python", "-m", "pip", "check"], check=True)
        command = [programs / "fpsboost"]
        # elsewhere than in the repository, whose package would be found before the installed one
        subprocess.run([*command, ROOT / "samples" / "orbit.mp4", "doubled.mp4"], check=True, cwd=place)
        report = json.loads(subprocess.check_output([*command, "probe", "doubled.mp4", "--json"], cwd=place))
        if report["frames"] != 144:
            sys.exit(f"The sample clip became {report['frames']} frames, not 144.")
        checked = json.loads(subprocess.check_output([*command, "doctor", "--json"], cwd=place))
    values = {finding["name"]: finding["value"] for finding in checked["findings"]}
    return f"Python {values['Python']}, PyAV {values['PyAV']}, NumPy {values['NumPy']}"


def try_everywhere(wheel: Path, pythons: list[str]) -> list[str]:
    """Try a wheel with several versions of Python, and by uvx; return a line for each, also for what is missing."""
    lines = []
    for version in pythons:
        python = version if os.sep in version else find_python(version)
        lines.append(f"not tried: Python {version} is not installed" if python is None else try_wheel(python, wheel))
    if shutil.which("uvx") is None:
        lines.append("not tried: uvx is not installed")
    else:
        subprocess.run(["uvx", "--from", wheel, "fpsboost", "--help"], check=True, stdout=subprocess.DEVNULL)
        lines.append("uvx --from WHEEL fpsboost --help")
    return lines


def changes(version: str) -> str:
    """Return what CHANGELOG.md says of a version, and exit if it says nothing."""
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    found = re.search(
        rf"^## {re.escape(version)}(?P<date>[^\n]*)\n(?P<text>.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL
    )
    if found is None:
        sys.exit(f"CHANGELOG.md does not describe {version}.")
    if "not released" in found["date"]:
        print(f"CHANGELOG.md calls {version} not released yet; write the date there before you upload.")
    return found["text"].strip()


def digests(folder: Path) -> dict[str, str]:
    """Return SHA-256 by name of the files of a folder, which may be missing."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*"))}


def write_recipes(out: Path, version: str, home: str, hashes: dict[str, str]) -> list[str]:
    """Write the recipes whose files are there, with their addresses and hashes; return a line for each."""
    environment = Environment(
        loader=FileSystemLoader(ROOT / "release" / "recipes"), undefined=StrictUndefined, keep_trailing_newline=True
    )
    lines = []
    out.mkdir(parents=True, exist_ok=True)
    for name in environment.list_templates():
        needed = [f"fpsboost-{version}-win-amd64.zip"] if name.endswith(".yaml") else []
        if missing := [each for each in needed if each not in hashes]:
            lines.append(f"not written: {name} needs {', '.join(missing)} in dist/apps, which make_app.py makes there")
            continue
        values = {"version": version, "home": home, "files": f"{home}/releases/download/v{version}", "sha256": hashes}
        (out / name).write_text(environment.get_template(name).render(values), "utf-8")
        lines.append(f"{out / name}")
    return lines


def write_node(out: Path, home: str) -> None:
    """Write the folder of ComfyUI's node as its registry wants it: with licence, page and address of the repository."""
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(ROOT / "integrations" / "comfyui", out, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "LICENSE", out)
    shutil.copy(ROOT / "docs" / "comfyui.md", out / "README.md")
    with (out / "pyproject.toml").open("a", encoding="utf-8") as file:
        file.write(f'\n[project.urls]\nRepository = "{home}"\n')


def main() -> None:
    """Make and check all of a release."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for all that is made")
    parser.add_argument("--home", default="https://example.org/fpsboost", help="address of the repository")
    parser.add_argument("--python", action="append", help="version or path of a Python to try the wheel with")
    options = parser.parse_args()
    out = options.out.resolve()
    found = re.search(r'^__version__ = "(.+)"$', (ROOT / "fpsboost" / "__init__.py").read_text("utf-8"), re.MULTILINE)
    assert found, "the package has a version"
    version = found[1]
    text = changes(version)
    source = build_source(out / "pypi")
    own = this_platform()
    lines = try_everywhere(build_wheel(source, own), options.python or list(PYTHONS))  # before the time for the others
    for name in (name for name in PLATFORMS if name != own):
        build_wheel(source, name)
    check(out / "pypi", version)
    hashes = digests(out / "pypi") | digests(out / "apps")
    lines += write_recipes(out / "recipes", version, options.home, hashes)
    write_node(out / "comfyui", options.home)
    subprocess.run([sys.executable, ROOT / "integrations" / "build_blender_extension.py", out / "blender"], check=True)
    sums = "\n".join(f"{digest}  {name}" for name, digest in hashes.items())
    (out / "release.md").write_text(f"# fpsboost {version}\n\n{text}\n\n## SHA-256\n\n```\n{sums}\n```\n", "utf-8")
    print(*lines, out / "release.md", sep="\n")


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as failed:
        sys.exit(f"{' '.join(map(str, failed.cmd))} ended with {failed.returncode}; see what it said above.")
