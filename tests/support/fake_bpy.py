"""A module that stands for Blender's bpy: as much of it as the extension touches."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any


class Type:
    """A base class of operators, panels and groups of properties; remembers what is reported."""

    def __init__(self) -> None:
        self.reports: list[tuple[str, str]] = []

    def report(self, kind: set[str], text: str) -> None:
        self.reports.append((*kind, text))


class Collection(dict[str, Any]):
    """Blender's collections: mappings that are iterated by value."""

    def __iter__(self) -> Any:
        return iter(self.values())


def make_bpy() -> ModuleType:
    """Return the module, nothing registered and nothing rendered."""
    bpy = ModuleType("bpy")
    registered: list[type] = []
    handlers = SimpleNamespace(render_cancel=[])
    kinds = ("AddonPreferences", "PropertyGroup", "Operator", "Panel")
    names = ("StringProperty", "IntProperty", "FloatProperty", "EnumProperty", "PointerProperty")
    bpy.types = SimpleNamespace(**{kind: type(kind, (Type,), {}) for kind in kinds}, Scene=type("Scene", (), {}))
    bpy.props = SimpleNamespace(**{name: lambda **options: options for name in names})
    bpy.utils = SimpleNamespace(
        registered=registered, register_class=registered.append, unregister_class=registered.remove
    )
    bpy.path = SimpleNamespace(abspath=lambda path: path.replace("//", "/file/"))
    bpy.data = SimpleNamespace(filepath="", scenes={})
    bpy.app = SimpleNamespace(version=(4, 2, 0), handlers=handlers, is_job_running=lambda kind: False)
    bpy.ops = SimpleNamespace(render=SimpleNamespace(render=None))
    return bpy


def make_scene(folder: Path, **chosen: Any) -> Any:
    """Return a scene with Blender's defaults before 5.0, and one view layer."""
    layer = SimpleNamespace(name="ViewLayer", use=True, use_pass_vector=False, use_pass_z=True)
    image = SimpleNamespace(file_format="PNG", color_mode="RGB", color_depth="8")
    borders = {"border_min_x": 0.0, "border_max_x": 1.0, "border_min_y": 0.0, "border_max_y": 1.0}
    render = SimpleNamespace(
        **{"filepath": "/tmp/", "use_file_extension": True, "use_placeholder": False, "use_sequencer": True},
        **{"use_border": False, "use_crop_to_border": False, "use_multiview": False, "use_motion_blur": False},
        **{"resolution_x": 128, "resolution_y": 72, "resolution_percentage": 50, "engine": "CYCLES"},
        **borders,
        image_settings=image,
    )
    options = {"folder": str(folder), "frame_step": 2, "passes": {"VECTOR", "DEPTH"}, "budget": 10.0, "remembered": ""}
    scene = SimpleNamespace(
        **{"name": "Scene", "frame_start": 1, "frame_end": 5, "frame_step": 1},
        **{"frame_current": 1, "frame_subframe": 0.0},
        render=render,
        view_layers=Collection(ViewLayer=layer),
        fpsboost=SimpleNamespace(**options | chosen),
    )

    def frame_set(frame: int, subframe: float = 0.0) -> None:
        scene.frame_current, scene.frame_subframe = frame, subframe

    scene.frame_set = frame_set
    return scene


def make_context(scene: Any, program: Path | None) -> Any:
    """Return a context with a window that has one properties editor, and the preferences of the extension."""
    addon = SimpleNamespace(preferences=SimpleNamespace(program="" if program is None else str(program)))
    events: list[Any] = []
    window_manager = SimpleNamespace(
        events=events,
        event_timer_add=lambda interval, window: events.append("timer") or "timer",
        event_timer_remove=events.remove,
        modal_handler_add=lambda operator: None,
        progress_begin=lambda low, high: events.append("progress"),
        progress_update=lambda percent: None,
        progress_end=lambda: events.remove("progress"),
    )
    area = SimpleNamespace(type="PROPERTIES", tag_redraw=lambda: None)
    return SimpleNamespace(
        scene=scene,
        window=None,
        screen=SimpleNamespace(areas=[area]),
        window_manager=window_manager,
        preferences=SimpleNamespace(addons={"blender": addon}),
    )


def forget(name: str) -> None:
    """Drop a package and its modules from the imported ones."""
    for each in [key for key in sys.modules if key == name or key.startswith(name + ".")]:
        del sys.modules[each]
