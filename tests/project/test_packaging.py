"""What is published, what the package says of itself, and what is imported at all."""

import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from fpsboost import __version__
from fpsboost.kernels import binding
from support.video_truth import write_clip

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "fpsboost"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def files_of(kind: str, root: Path = ROOT) -> set[str]:
    """The paths of everything that a distribution takes from a folder."""
    builders = pytest.importorskip(f"hatchling.builders.{kind}")
    builder = {"wheel": "WheelBuilder", "sdist": "SdistBuilder"}[kind]
    included = getattr(builders, builder)(str(root)).recurse_included_files()
    return {Path(file.distribution_path).as_posix() for file in included}


def test_the_wheel_holds_the_package_alone():
    """Every module is in it, the templates of the page and the mark of typed packages too, and nothing else.

    The compiled kernels are there, too, but are not among what hatchling finds: hatch_build.py hands them over.
    """
    here = {path.relative_to(ROOT).as_posix() for path in (ROOT / "fpsboost").rglob("*") if path.is_file()}
    built = ("__pycache__", "fpsboost/native/kernels.")
    assert files_of("wheel") == {path for path in here if not any(each in path for each in built)}
    assert "fpsboost/py.typed" in here


def test_the_source_distribution_leaves_the_rendered_scenes_out():
    """The package, its tests, a sample clip and the Blender extension are in it; the rendered scenes are not."""
    files = files_of("sdist")
    wanted = {"LICENSE", "CITATION.cff", "fpsboost/py.typed", "tests/project/test_packaging.py", "samples/orbit.mp4"}
    assert files >= wanted | {"integrations/blender/blender_manifest.toml"}
    assert not [path for path in files if path.startswith("samples/scenes/")]
    assert sum((ROOT / path).stat().st_size for path in files) < 11e6


def test_the_source_distribution_takes_nothing_else_that_lies_in_the_folder(tmp_path):
    """An environment, whatever its name is, and a clip that somebody tried are left out."""
    wanted = {"LICENSE", "README.md", "pyproject.toml", "fpsboost/__init__.py"}
    for path in (*wanted, "venv/lib/fpsboost/__init__.py", "env311/pyvenv.cfg", "my clip.mp4"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes((ROOT / path).read_bytes() if path in wanted else b"")
    assert files_of("sdist", tmp_path) == wanted


def test_the_licence_is_one_everywhere():
    """The file, the metadata of the package and the citation name the same licence and the same authors."""
    licence, citation = ((ROOT / name).read_text() for name in ("LICENSE", "CITATION.cff"))
    assert PROJECT["license"] == "BSD-3-Clause"
    assert "\nlicense: BSD-3-Clause\n" in citation
    assert licence.startswith("BSD 3-Clause License\n")
    (author,) = (each["name"] for each in PROJECT["authors"])
    assert f"Copyright (c) 2026, {author}\n" in licence
    assert f"\nauthors:\n  - name: {author}\n" in citation


@pytest.mark.parametrize("requirement", PROJECT["dependencies"])
def test_every_dependency_has_a_lowest_version(requirement):
    """Which is what .ci/lowest installs to see whether it works; a version that is known not to work ends the range."""
    assert re.fullmatch(r"[\w-]+>=\d+(\.\d+)*(,<\d+(\.\d+)*)?", requirement)


BUILD = """
import sys
from pathlib import Path
import hatch_build as build

build.SOURCES = Path("native")
build.compile_kernels(build.PLATFORMS[build.this_platform()], Path())
"""
"""Compiles what is in the folder native of the working directory."""


@pytest.mark.slow
def test_a_build_needs_no_home_folder_and_leaves_the_library_alone(tmp_path, monkeypatch):
    """Where nothing can be written but the folder of the library and that of temporary files, which is empty again."""
    pytest.importorskip("ziglang")
    for name in ("native", "temporary"):
        (tmp_path / name).mkdir()
    for source in (PACKAGE / "native" / "processor.cpp", *(PACKAGE / "native").glob("*.h")):
        shutil.copy(source, tmp_path / "native")
    for name in ("CC", "CFLAGS", "ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HOME", "USERPROFILE", "LOCALAPPDATA", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, __file__)  # in which not even an administrator can write
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.setenv(name, str(tmp_path / "temporary"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    subprocess.run([sys.executable, "-c", BUILD], cwd=tmp_path, check=True)
    made = {path.name for path in tmp_path.rglob("*") if path.parent.name != "native"}
    assert made == {"native", "temporary", f"kernels{binding.LIBRARY.suffix}"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [("probe", "in.mp4"), ("in.mp4", "out.mp4", "--method", "blend"), ("in.mp4", "out.mp4")]
)
def test_what_a_conversion_does_not_need_is_not_imported(tmp_path, arguments):
    """Metrics, figures, pages and clusters."""
    write_clip(tmp_path / "in.mp4")
    code = f"""if True:
        import atexit, sys
        others = {{"matplotlib", "jinja2", "skimage", "distributed", "starlette"}}
        atexit.register(lambda: print("loaded:", others & set(sys.modules)))
        sys.argv = ["fpsboost", *{arguments}]
        from fpsboost.__main__ import main
        main()
    """
    result = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "loaded: set()"


APP = ROOT / "release" / "app_entry.py"


def test_the_text_of_a_release_is_that_of_the_changelog():
    """What stands below the heading of the version, down to the next one."""
    pytest.importorskip("hatchling")
    changes = runpy.run_path(str(APP.with_name("make_release.py")))["changes"]
    below = (ROOT / "CHANGELOG.md").read_text("utf-8").partition(f"\n## {__version__}")[2].partition("\n")[2]
    assert changes(__version__) == below.partition("\n## ")[0].strip() != ""


def test_what_the_app_does_with_its_arguments(tmp_path):
    """Without any it opens the page, files are converted one by one, all else is a command line, the page's own too."""
    commands = runpy.run_path(str(APP))["commands"]
    present, absent = [str(tmp_path), __file__], [str(tmp_path / "in.mp4"), str(tmp_path / "out.mp4")]
    assert commands([]) == [["ui"]]
    assert commands(absent) == [absent]
    assert commands(present) == [[present[0]], [present[1]]]
    assert commands(["-m", "fpsboost", *present]) == [present]


@pytest.mark.slow
def test_clips_dropped_on_the_app_are_converted_beside_them(tmp_path):
    """A file that is no clip does not stop the others, and shows in the exit code."""
    for name in ("a.mp4", "c.mp4"):
        write_clip(tmp_path / name)
    (tmp_path / "b.mp4").touch()
    dropped = [str(tmp_path / name) for name in ("a.mp4", "b.mp4", "c.mp4")]
    result = subprocess.run([sys.executable, APP, *dropped], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert "b.mp4" in result.stderr
    assert {path.name for path in tmp_path.glob("*-2x.mp4")} == {"a-2x.mp4", "c-2x.mp4"}
