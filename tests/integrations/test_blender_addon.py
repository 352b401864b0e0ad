"""The Blender extension under integrations/blender, with a module that stands for Blender, and in Blender itself.

The last test needs a Python that has Blender's module bpy: this one, or that named by PYTHON_WITH_BPY.
"""

import doctest
import importlib.util
import json
import os
import re
import subprocess
import sys
import threading
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost import __version__
from support.exr_truth import write_exr
from support.fake_bpy import forget, make_bpy, make_context, make_scene
from support.video_truth import scene

INTEGRATIONS = Path(__file__).parents[2] / "integrations"
EXTENSION = INTEGRATIONS / "blender"
MANIFEST = tomllib.loads((EXTENSION / "blender_manifest.toml").read_text())

sys.path.insert(0, str(EXTENSION))
from round_trip import commands, folders, regions, settings  # noqa: E402
from round_trip.errors import RoundTripError  # noqa: E402

PLAN = {
    "width": 64,
    "height": 36,
    "frames": [
        {"number": 2, "whole": False, "regions": [[8, 4, 20, 12], [40, 20, 24, 16]]},
        {"number": 4, "whole": True, "regions": [[0, 0, 64, 36]]},
    ],
}


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """The program fpsboost, of this environment."""
    path = tmp_path / "bin" / "fpsboost"
    path.parent.mkdir()
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m fpsboost "$@"\n')
    path.chmod(0o755)
    return path


@pytest.fixture
def bpy(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module that stands for Blender, imported."""
    module = make_bpy()
    monkeypatch.setitem(sys.modules, "bpy", module)
    return module


@pytest.fixture
def extension(bpy: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The extension, imported from its folder and not yet registered."""
    monkeypatch.syspath_prepend(INTEGRATIONS)
    yield importlib.import_module("blender")
    forget("blender")


@pytest.fixture
def rendered(tmp_path: Path) -> Path:
    """A folder for a round trip in which frames 1, 3 and 5 are rendered, with the passes Combined and Vector."""
    folder = tmp_path / "trip"
    (folder / "renders").mkdir(parents=True)
    channels = [*(f"ViewLayer.Combined.{name}" for name in "BGR"), *(f"ViewLayer.Vector.{name}" for name in "XYZW")]
    for number in (1, 3, 5):
        planes = [*np.moveaxis(scene(number, 36, 64) / np.float32(255), -1, 0), *np.zeros((4, 36, 64), np.float32)]
        write_exr(folder / "renders" / f"{number:04d}.exr", dict(zip(channels, planes, strict=True)))
    return folder


def test_commands_are_those_of_the_documentation():
    """Each step is one command line; a plan and a merge want a new folder."""
    trip = folders.Folders(Path("trip"))
    made, plan = [str(Path("trip", name)) for name in ("made", "plan")]
    passes = [str(trip.renders), made, "--factor", "3", "--passes", "all", "--confidence", str(trip.confidence)]
    follow, progress = ["--vectors", str(trip.renders), "--vectors-as", "blender"], ["--progress", "json", "-y"]
    assert commands.convert_command("fpsboost", trip, 3, vectors=False)[1:] == passes + progress
    assert commands.convert_command("fpsboost", trip, 3, vectors=True)[1:] == passes + follow + progress
    assert commands.plan_command("fpsboost", trip, 7.5)[1:] == [
        *("plan", str(trip.renders), plan + "-unfinished", "--budget", "7.5%")
    ]
    assert commands.merge_command("fpsboost", trip)[1:] == [
        *("merge", made, str(trip.regions), str(trip.merged) + "-unfinished", "--plan", plan)
    ]


def test_progress_is_a_fraction_and_a_text():
    """Which a bar shows; more frames than expected fill it. Anything but an object with numbers is a message."""
    found = [commands.parse_progress(f'{{"frame": 3, "frames": {expected}}}') for expected in ("12", "null", "2")]
    assert [(progress.fraction, str(progress)) for progress in found] == [
        *((0.25, "3 of 12 frames"), (0, "3 of ? frames"), (1, "3 of 2 frames")),
    ]
    for line in ("", "Note: text", "[1]", "3", '{"frames": "many"}', '{"other": 1}', '{"frames": 1'):
        assert commands.parse_progress(line) is None


def test_a_failure_is_told_in_the_programs_words():
    """Its last sentence counts; a program that knows an option not yet is said to be old, in one sentence."""
    assert commands.explain_failure(["Note: x.", "fpsboost: a is not there; name a folder."], 1) == (
        "a is not there; name a folder."
    )
    old = commands.explain_failure(["fpsboost: Unknown option: --passes. Did you mean --x? See fpsboost --help."], 2)
    assert "too old for --passes" in old
    assert commands.explain_failure(["Traceback", "KeyError: 3", ""], 1).endswith("exit code 1: KeyError: 3")
    assert commands.explain_failure([], -9).endswith("exit code -9: it printed nothing.")


def test_a_program_that_is_not_there_is_named(tmp_path, monkeypatch):
    """A wrong path from the preferences, an empty PATH, and a file that is no program are a sentence each."""
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RoundTripError, match="not on PATH"):
        commands.find_program("")
    with pytest.raises(RoundTripError, match="is not a program; correct the path"):
        commands.find_program(str(tmp_path / "fpsboost"))
    (tmp_path / "fpsboost").write_text("text")
    with pytest.raises(RoundTripError, match=r"cannot be started \(Permission denied\)"):
        commands.Run([str(tmp_path / "fpsboost")])


@pytest.mark.parametrize(
    ("folder", "numbers", "message"),
    [
        ("renders", range(1, 10, 2), "lacks 2 frames, the first of them 7; render"),
        ("renders", range(1, 6, 4), "also holds frame 3"),
        ("nothing", range(1, 6, 2), "lacks 3 frames"),
    ],
)
def test_renders_must_be_the_frames_of_the_range(rendered, folder, numbers, message):
    """Frames that are missing and frames of another step are counted, and the first is named."""
    folders.check_renders(rendered / "renders", range(1, 6, 2))
    with pytest.raises(RoundTripError, match=message):
        folders.check_renders(rendered / folder, numbers)


def test_a_plan_names_a_file_for_every_region():
    """Several regions of a frame count from 1, in the plan's order; a whole frame keeps its name."""
    plan = regions.parse_plan(PLAN)
    assert [(each.frame, each.name) for each in plan.regions] == [(2, "0002_1"), (2, "0002_2"), (4, "0004")]
    assert plan.regions[2] == regions.Region(4, "0004", 0, 0, 64, 36)
    with pytest.raises(RoundTripError, match="64x36, but the scene renders 64x40"):
        regions.check_size(plan, 64, 40)


@pytest.mark.parametrize("module", [commands, folders, regions, settings], ids=lambda module: module.__name__)
def test_examples_in_docstrings_are_true(module):
    """Of the modules that need no Blender."""
    assert doctest.testmod(module).failed == 0


@given(st.data())
def test_a_border_renders_exactly_the_pixels_of_its_region(data):
    """Blender keeps borders as 32-bit floats, multiplies them by the size and drops the fraction; its y points up."""
    width, height = (data.draw(st.integers(1, 16384)) for _ in range(2))
    x, y = data.draw(st.integers(0, width - 1)), data.draw(st.integers(0, height - 1))
    region = regions.Region(2, "", x, y, data.draw(st.integers(1, width - x)), data.draw(st.integers(1, height - y)))
    border = regions.Plan(width, height, ()).border_of(region)
    left, right = (int(np.float32(each) * np.float32(width)) for each in border[:2])
    bottom, top = (int(np.float32(each) * np.float32(height)) for each in border[2:])
    assert (left, height - top, right - left, top - bottom) == (region.x, region.y, region.width, region.height)


def test_what_is_no_plan_is_said(tmp_path):
    """A missing file and one of another shape are a sentence each."""
    with pytest.raises(RoundTripError, match=r"plan\.json is not there; plan first"):
        regions.read_plan(tmp_path)
    for text in ("no json", "[]", '{"width": 4, "height": 4, "frames": [{"number": 1}]}'):
        (tmp_path / "plan.json").write_text(text)
        with pytest.raises(RoundTripError, match="is no plan"):
            regions.read_plan(tmp_path)


def test_regions_of_an_earlier_plan_are_removed_and_those_rendered_are_kept(tmp_path):
    """So that a run goes on where it was interrupted; images with other names stay."""
    plan = regions.parse_plan(PLAN)
    for name, when in (("0002_1", 200), ("0002_2", 50), ("0006", 50), ("holiday", 50)):
        (tmp_path / f"{name}.exr").write_bytes(b"")
        os.utime(tmp_path / f"{name}.exr", (when, when))
    assert [path.stem for path in regions.remove_outdated(tmp_path, 100)] == ["0002_2", "0006"]
    assert [region.name for region in regions.unrendered(plan, tmp_path)] == ["0002_2", "0004"]
    assert (tmp_path / "holiday.exr").exists()
    assert regions.remove_outdated(tmp_path / "missing", 100) == []


def test_an_earlier_output_is_replaced_when_the_new_one_is_finished(tmp_path):
    """And what an interrupted run has left goes; a folder that cannot be replaced is named."""
    plan = tmp_path / "plan"
    for folder, text in ((plan, "old"), (folders.unfinished(plan), "new")):
        folder.mkdir()
        (folder / "plan.json").write_text(text)
    folders.replace_folder(plan)
    assert (plan / "plan.json").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["plan"]
    folders.unfinished(plan).mkdir()
    folders.remove_unfinished(plan)
    assert not folders.unfinished(plan).exists()
    with pytest.raises(RoundTripError, match="cannot be replaced"):
        folders.replace_folder(plan)
    assert (plan / "plan.json").read_text() == "new"


def test_settings_are_put_back():
    """Through text, in their order; what was changed since is the user's now, as is that of an owner that is gone."""
    owners = {"render": SimpleNamespace(filepath="/tmp/", use_border=True), "layer": SimpleNamespace(use=False)}
    path, *others = wanted = [
        settings.Setting("render", "filepath", "/out/"),
        settings.Setting("render", "use_border", False),
        settings.Setting("layer", "use", True),
    ]
    changes = settings.from_text(settings.to_text(settings.change(owners, wanted)))
    assert vars(owners["render"]) == {"filepath": "/out/", "use_border": False}
    assert settings.restore(owners, changes) == []
    assert vars(owners["render"]) == {"filepath": "/tmp/", "use_border": True}
    settings.change(owners, wanted)
    owners["render"].filepath = "/mine/"
    del owners["layer"]
    assert settings.restore(owners, changes) == [path, others[-1]]
    assert vars(owners["render"]) == {"filepath": "/mine/", "use_border": True}
    assert settings.from_text("") == []


def test_the_manifest_keeps_to_blenders_rules():
    """What Blender checks when it builds and installs an extension: names, versions, lengths, licences, reasons."""
    wanted = {
        **{"schema_version": "1.0.0", "version": __version__, "type": "add-on", "blender_version_min": "4.2.0"},
        **{"license": ["SPDX:BSD-3-Clause"], "maintainer": "the fpsboost authors"},
    }
    assert {name: MANIFEST[name] for name in wanted} == wanted
    assert re.fullmatch(r"[a-z][a-z0-9_]*", MANIFEST["id"])
    assert MANIFEST["permissions"].keys() == {"files"}
    for text in (MANIFEST["tagline"], *MANIFEST["permissions"].values()):
        assert re.fullmatch(r".{0,63}[a-zA-Z0-9]", text)


def test_the_zip_file_holds_the_manifest_and_the_modules(tmp_path):
    """At its root, as Blender wants it, and the same bytes every time."""
    script = INTEGRATIONS / "build_blender_extension.py"
    archives = []
    for name in ("first", "second"):
        told = subprocess.run([sys.executable, script, tmp_path / name], check=True, capture_output=True, text=True)
        archives.append(Path(told.stdout.strip()))
    assert archives[0].read_bytes() == archives[1].read_bytes()
    with zipfile.ZipFile(archives[0]) as archive:
        names = set(archive.namelist())
    assert names == {
        path.relative_to(EXTENSION).as_posix() for kind in ("*.py", "*.toml") for path in EXTENSION.rglob(kind)
    }
    assert {"blender_manifest.toml", "__init__.py", "round_trip/commands.py"} <= names


def test_only_the_thin_part_knows_blender():
    """Blender's process gets nothing but Python's own library and bpy; round_trip not even that."""
    paths = list(EXTENSION.rglob("*.py"))
    assert paths
    for path in paths:
        imported = set(re.findall(r"^(?:import|from) (\w+)", path.read_text(), re.MULTILINE))
        allowed = sys.stdlib_module_names | (set() if path.parent.name == "round_trip" else {"bpy"})
        assert imported <= allowed, path


def test_registering_adds_all_classes_and_takes_them_away(extension, bpy):
    """Every class of every module, and the scene's settings."""
    extension.register()
    assert set(bpy.utils.registered) == set(extension.classes)
    assert hasattr(bpy.types.Scene, "fpsboost")
    extension.unregister()
    assert bpy.utils.registered == []
    assert not hasattr(bpy.types.Scene, "fpsboost")


def test_preparing_sets_the_scene_and_putting_back_undoes_it(extension, tmp_path):
    """Twice prepared counts once: what is put back is what was before the first time."""
    scene = make_scene(tmp_path)
    before = repr(scene)
    context = make_context(scene, None)
    for _ in range(2):
        assert extension.preparing.FPSBOOST_OT_prepare().execute(context) == {"FINISHED"}
    image = scene.render.image_settings
    assert (image.file_format, image.color_depth, scene.frame_step) == ("OPEN_EXR_MULTILAYER", "16", 2)
    assert (Path(scene.render.filepath), scene.render.use_sequencer) == (tmp_path / "renders", False)
    assert scene.view_layers["ViewLayer"].use_pass_vector
    assert extension.preparing.FPSBOOST_OT_restore.poll(context)
    assert extension.preparing.FPSBOOST_OT_restore().execute(context) == {"FINISHED"}
    assert repr(scene) == before


def test_since_blender_5_the_type_of_medium_comes_first(extension, tmp_path):
    """Before it is set, the format of several layers cannot be."""
    scene = make_scene(tmp_path)
    scene.render.image_settings.media_type = "IMAGE"
    names = [each.name for each in extension.preparing.wanted_settings(scene, "out")]
    assert names.index("media_type") < names.index("file_format") < names.index("color_depth")


def refusal_of(operator: Any, context: Any) -> str:
    """The error that an operator reports when it refuses to work."""
    assert operator.execute(context) == {"CANCELLED"}
    assert operator.reports[-1][0] == "ERROR"
    return operator.reports[-1][1]


@pytest.mark.parametrize(
    ("owner", "name", "value", "words"),
    [
        (None, "frame_start", -2, "at least 0"),
        (None, "frame_end", 2, "Only frame 1 would"),
        ("render", "use_multiview", True, "Stereoscopy"),
        ("fpsboost", "folder", "//trip/", "save it"),
        ("fpsboost", "folder", "", "folder of the round trip is missing"),
    ],
)
def test_scenes_that_cannot_be_prepared_are_refused(extension, tmp_path, owner, name, value, words):
    """Negative numbers, one frame, stereoscopy, and a folder beside a file that is not saved."""
    scene = make_scene(tmp_path)
    setattr(getattr(scene, owner) if owner else scene, name, value)
    assert words in refusal_of(extension.preparing.FPSBOOST_OT_prepare(), make_context(scene, None))


def test_what_will_be_missing_is_said_before_rendering(extension, tmp_path):
    """Frames after the last rendered one, and vectors under motion blur."""
    scene = make_scene(tmp_path)
    scene.frame_end, scene.render.use_motion_blur = 6, True
    operator = extension.preparing.FPSBOOST_OT_prepare()
    operator.execute(make_context(scene, None))
    warnings = [text for kind, text in operator.reports if kind == "WARNING"]
    assert len(warnings) == 2
    assert "frame that comes out is 5" in warnings[0]
    assert "no Vector pass" in warnings[1]


def follow(operator: Any, context: Any) -> set[str]:
    """Send timer events to an operator until it ends."""
    timer = SimpleNamespace(type="TIMER", value="NOTHING")
    while not (answer := operator.modal(context, timer)) <= {"FINISHED", "CANCELLED"}:
        threading.Event().wait(0.01)
    return answer


@pytest.mark.slow
def test_a_button_runs_the_command_beside_blender(extension, program, rendered):
    """Blender goes on meanwhile, no second command can start, and nothing is left of the timer and the bar."""
    commanding = extension.commanding
    context = make_context(make_scene(rendered), program)
    operator = commanding.FPSBOOST_OT_convert()
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert commanding.Commanding.current[0] == "Convert"
    assert not commanding.FPSBOOST_OT_plan.poll(context)
    assert operator.modal(context, SimpleNamespace(type="MOUSEMOVE", value="NOTHING")) == {"PASS_THROUGH"}
    assert follow(operator, context) == {"FINISHED"}
    *remarks, end = operator.reports
    assert end == ("INFO", f"All frames are in {rendered / 'made'}.")
    assert any(kind == "WARNING" and "vectors for 3 of the 5 output frames" in text for kind, text in remarks)
    assert context.window_manager.events == []
    assert commanding.FPSBOOST_OT_plan.poll(context)
    assert len(list((rendered / "made").iterdir())) == 5


def test_escape_stops_the_command(extension, program, rendered, monkeypatch):
    """That is no error, and the bar is gone."""
    slow = [str(program), str(rendered / "renders"), str(rendered / "made"), "--factor", "1000"]
    monkeypatch.setattr(extension.commanding, "convert_command", lambda *_, **__: slow)
    context = make_context(make_scene(rendered), program)
    operator = extension.commanding.FPSBOOST_OT_convert()
    operator.invoke(context, None)
    assert operator.modal(context, SimpleNamespace(type="ESC", value="PRESS")) == {"RUNNING_MODAL"}
    assert follow(operator, context) == {"CANCELLED"}
    assert operator.reports == [("INFO", "Convert: stopped, nothing was replaced.")]
    assert not (rendered / "made").exists()
    assert context.window_manager.events == []


def test_errors_are_reports_with_the_programs_sentence(extension, program, rendered, monkeypatch):
    """Whether the program says it, or the extension before it starts the program."""
    context = make_context(make_scene(rendered), program)
    old = [str(program), "a", "b", "--new-option", "x"]
    monkeypatch.setattr(extension.commanding, "convert_command", lambda *_, **__: old)
    assert "too old for --new-option" in refusal_of(extension.commanding.FPSBOOST_OT_convert(), context)
    operator = extension.commanding.FPSBOOST_OT_convert()
    operator.invoke(context, None)
    assert follow(operator, context) == {"CANCELLED"}
    assert "too old for --new-option" in operator.reports[-1][1]
    assert "plan first" in refusal_of(extension.commanding.FPSBOOST_OT_merge(), context)
    (rendered / "renders" / "0003.exr").unlink()
    operator = extension.commanding.FPSBOOST_OT_convert()
    assert operator.invoke(context, None) == {"CANCELLED"}
    assert "lacks frame 3" in operator.reports[-1][1]


@pytest.fixture
def planned(rendered: Path) -> Path:
    """A round trip with a plan."""
    (rendered / "plan").mkdir()
    (rendered / "plan" / "plan.json").write_text(json.dumps(PLAN))
    (rendered / "regions").mkdir()
    return rendered


@pytest.fixture
def renders(bpy: ModuleType) -> list[Any]:
    """What was rendered: frame, file and border; each render writes its file at once."""
    done: list[Any] = []

    def render(*how: str, write_still: bool, scene: str) -> set[str]:
        settings = render.scene.render
        Path(settings.filepath + ".exr").write_bytes(b"")
        done.append((render.scene.frame_current, Path(settings.filepath).name, settings.border_min_x))
        return {"RUNNING_MODAL"} if how else {"FINISHED"}

    bpy.ops.render.render = render
    return done


@pytest.mark.parametrize("by", ["script", "button"])
def test_the_planned_regions_are_rendered_and_the_scene_is_as_before(extension, bpy, planned, renders, by):
    """One render a region, into a file of its own; frame, border and path are put back."""
    scene = bpy.ops.render.render.scene = make_scene(planned, remembered="[]")
    context, before = make_context(scene, None), repr(scene.render)
    operator = extension.rendering.FPSBOOST_OT_render_regions()
    if by == "script":
        assert operator.execute(context) == {"FINISHED"}
    else:
        assert operator.invoke(context, None) == {"RUNNING_MODAL"}
        assert follow(operator, context) == {"FINISHED"}
    assert renders == [(2, "0002_1", 8.5 / 64), (2, "0002_2", 40.5 / 64), (4, "0004", 0)]
    assert repr(scene.render) == before
    assert scene.frame_current == 1
    assert (context.window_manager.events, bpy.app.handlers.render_cancel) == ([], [])


def test_a_render_that_was_stopped_goes_on(extension, bpy, planned, renders):
    """After Esc within a render nothing else starts; the next call renders what is missing."""
    scene = bpy.ops.render.render.scene = make_scene(planned, remembered="[]")
    context = make_context(scene, None)
    operator = extension.rendering.FPSBOOST_OT_render_regions()
    operator.invoke(context, None)
    operator.modal(context, SimpleNamespace(type="TIMER", value="NOTHING"))
    for handler in bpy.app.handlers.render_cancel:
        handler(scene, None)
    assert follow(operator, context) == {"CANCELLED"}
    assert "2 regions are not rendered yet" in operator.reports[-1][1]
    assert "2 regions are not rendered yet" in refusal_of(extension.commanding.FPSBOOST_OT_merge(), context)
    assert extension.rendering.FPSBOOST_OT_render_regions().execute(context) == {"FINISHED"}
    assert [name for _, name, _ in renders] == ["0002_1", "0002_2", "0004"]


def test_a_render_that_fails_is_reported(extension, bpy, planned):
    """With Blender's own words, and with the scene as before."""
    scene = make_scene(planned, remembered="[]")

    def render(*how: str, **options: Any) -> set[str]:
        raise RuntimeError("Error: Cannot render, no camera")

    bpy.ops.render.render = render
    for by in ("execute", "invoke"):
        context = make_context(scene, None)
        operator = extension.rendering.FPSBOOST_OT_render_regions()
        ended = operator.execute(context) if by == "execute" else operator.invoke(context, None)
        assert (ended if by == "execute" else follow(operator, context)) == {"CANCELLED"}
        assert ("ERROR", "Error: Cannot render, no camera") in operator.reports
        assert not scene.render.use_border


def test_regions_need_the_prepared_scene(extension, planned):
    """Regions in other passes or another format could not be merged."""
    context = make_context(make_scene(planned), None)
    assert "prepare" in refusal_of(extension.rendering.FPSBOOST_OT_render_regions(), context)


def python_with_bpy() -> str | None:
    """The path of a Python that has Blender's module."""
    here = sys.executable if importlib.util.find_spec("bpy") else None
    return os.environ.get("PYTHON_WITH_BPY", here)


@pytest.mark.skipif(python_with_bpy() is None, reason="there is no module bpy; see PYTHON_WITH_BPY")
def test_the_round_trip_in_blender(program, tmp_path):
    """A small scene goes all the way without a window, and all its settings are as before."""
    command = [
        str(python_with_bpy()),
        Path(__file__).with_name("blender_round_trip.py"),
        EXTENSION,
        program,
        tmp_path / "trip",
    ]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    found = re.search(r"^RESULT (.*)$", told.stdout, re.MULTILINE)
    assert found, told.stdout + told.stderr
    result = json.loads(found[1])
    assert set(map(tuple, result.pop("said").values())) == {("FINISHED",)}
    assert result == {"restored": True, "strip": [1, 5, 5], "rate": [24, 24], "confidence": "SEQUENCE"}
    planned = {region.name for region in regions.read_plan(tmp_path / "trip" / "plan").regions}
    assert {path.stem for path in (tmp_path / "trip" / "regions").glob("*.exr")} == planned != set()
