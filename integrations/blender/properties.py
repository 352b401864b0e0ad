"""Settings of a scene, preferences of the add-on, and what follows from them."""

from pathlib import Path
from typing import Any

import bpy

from .round_trip.commands import find_program
from .round_trip.errors import RoundTripError
from .round_trip.folders import Folders

PASSES = {
    "VECTOR": ("use_pass_vector", "Vector", "Motion from frame to frame"),
    "DEPTH": ("use_pass_z", "Depth", "Distance from the camera"),
    "NORMAL": ("use_pass_normal", "Normal", "Directions of surfaces"),
    "CRYPTOMATTE_OBJECT": ("use_pass_cryptomatte_object", "Cryptomatte Object", "Which object a pixel shows"),
    "CRYPTOMATTE_MATERIAL": ("use_pass_cryptomatte_material", "Cryptomatte Material", "Which material a pixel shows"),
    "DIFFUSE_COLOR": ("use_pass_diffuse_color", "Diffuse Color", "Colour of matt surfaces without light"),
    "EMIT": ("use_pass_emit", "Emission", "Light that surfaces give off"),
}
"""Passes by identifier: attribute of a view layer, name, description. Others stay as the view layer has them."""


BLEND_RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0, 0) else set()
"""Options of a path that may begin with ``//``; other versions have no such option."""


class FpsboostPreferences(bpy.types.AddonPreferences):
    """Preferences of the add-on."""

    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="fpsboost",
        description="Path of the program fpsboost; empty to search PATH for it",
        subtype="FILE_PATH",
    )

    def draw(self, context: Any) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "program")


class FpsboostSettings(bpy.types.PropertyGroup):
    """Settings of a round trip, kept in the scene."""

    frame_step: bpy.props.IntProperty(
        name="Frame Step", description="Render every N-th frame; the others are made", default=2, min=2, max=16
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="Takes the folders renders, made, confidence, plan, regions and merged",
        default="//fpsboost/",
        subtype="DIR_PATH",
        options=BLEND_RELATIVE,
    )
    passes: bpy.props.EnumProperty(
        name="Passes",
        description="Passes to render beside Combined",
        items=[(key, name, about, 1 << bit) for bit, (key, (_, name, about)) in enumerate(PASSES.items())],
        options={"ENUM_FLAG"},
        default={"VECTOR", "DEPTH"},
    )
    budget: bpy.props.FloatProperty(
        name="Budget",
        description="Part of the made frames' pixels that may be rendered again",
        subtype="PERCENTAGE",
        default=10,
        min=0.1,
        max=100,
    )
    remembered: bpy.props.StringProperty(options={"HIDDEN"})


classes = (FpsboostPreferences, FpsboostSettings)


def folders_of(scene: Any) -> Folders:
    """Return the folders of a scene's round trip."""
    folder = scene.fpsboost.folder
    if not folder:
        raise RoundTripError("The folder of the round trip is missing; choose one.")
    if folder.startswith("//") and not bpy.data.filepath:
        raise RoundTripError("The folder is relative to this file, which is not saved; save it, or choose another.")
    return Folders(Path(bpy.path.abspath(folder)))


def rendered_frames(scene: Any) -> range:
    """Return the numbers of the frames that are rendered."""
    return range(scene.frame_start, scene.frame_end + 1, scene.fpsboost.frame_step)


def render_size(scene: Any) -> tuple[int, int]:
    """Return the width and height of a rendered frame, pixels, as Blender rounds them."""
    render = scene.render
    width, height = (size * render.resolution_percentage // 100 for size in (render.resolution_x, render.resolution_y))
    return max(width, 1), max(height, 1)


def program_of(context: Any) -> str:
    """Return the path of the program fpsboost, from the preferences or PATH; `RoundTripError` if there is none."""
    addon = context.preferences.addons.get(__package__)
    given = addon.preferences.program if addon is not None and addon.preferences is not None else ""
    return find_program(bpy.path.abspath(given) if given else "")
