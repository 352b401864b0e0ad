"""Operators that show what came out: the confidence, and the sequence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from .properties import folders_of
from .round_trip.errors import RoundTripError
from .round_trip.folders import numbered_files

CONFIDENCE = "fpsboost confidence"
STRIP = "fpsboost"


class FPSBOOST_OT_show_confidence(bpy.types.Operator):
    """Show how far the made frames can be trusted in an Image Editor; white is certain"""

    bl_idname = "fpsboost.show_confidence"
    bl_label = "Show Confidence"

    def execute(self, context: Any) -> set[str]:
        """Load the maps as a sequence, and show it if an Image Editor is open."""
        try:
            image, last = load_confidence(folders_of(context.scene).confidence)
        except RoundTripError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        editors = [area.spaces.active for area in (context.screen.areas if context.screen else ())]
        editors = [space for space in editors if space.type == "IMAGE_EDITOR"]
        for space in editors:
            space.image = image
            # frame n of the timeline shows file n
            space.image_user.frame_start, space.image_user.frame_offset = 1, 0
            space.image_user.frame_duration = last
            space.image_user.use_auto_refresh = True
        if not editors:
            self.report({"INFO"}, f"Open an Image Editor and choose {image.name} there.")
        return {"FINISHED"}


class FPSBOOST_OT_load_sequence(bpy.types.Operator):
    """Load the made frames, before anything is merged, into the Video Sequencer"""

    bl_idname = "fpsboost.load_sequence"
    bl_label = "Load Made Frames"

    def execute(self, context: Any) -> set[str]:
        """Load the frames."""
        try:
            scene = load_sequence(context, folders_of(context.scene).made)
        except RoundTripError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"The frames are a strip in the scene {scene.name}.")
        return {"FINISHED"}


classes = (FPSBOOST_OT_show_confidence, FPSBOOST_OT_load_sequence)


def load_confidence(folder: Path) -> tuple[Any, int]:
    """Load the maps of a folder as one image, and return it with the number of the last."""
    files = numbered_files(folder, ".png")
    if not files:
        raise RoundTripError(f"{folder} contains no confidence maps; convert first.")
    image = bpy.data.images.get(CONFIDENCE)
    if image is not None:
        bpy.data.images.remove(image)
    image = bpy.data.images.load(str(next(iter(files.values()))))
    image.name = CONFIDENCE
    image.colorspace_settings.name = "Non-Color"
    image.source = "SEQUENCE"
    return image, max(files)


def load_sequence(context: Any, folder: Path) -> Any:
    """Load images as a strip into a scene of its own, and return that.

    In the scene that is rendered, a strip would be rendered instead of it.
    """
    files = numbered_files(folder, ".exr")
    if not files:
        raise RoundTripError(f"{folder} contains no images; convert first.")
    first, *others = files.values()
    scene = strip_scene(context.scene, min(files), max(files))
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences  # until Blender 4.3
    for strip in [each for each in strips if each.name == STRIP]:
        strips.remove(strip)
    strip = strips.new_image(name=STRIP, filepath=str(first), channel=1, frame_start=min(files))
    for path in others:
        strip.elements.append(path.name)
    if hasattr(context.workspace, "sequencer_scene"):  # since Blender 5.0
        context.workspace.sequencer_scene = scene
    return scene


def strip_scene(rendered: Any, first: int, last: int) -> Any:
    """Return the scene for strips of what another scene renders: its rate, size and look, and these frames."""
    name = f"{rendered.name} fpsboost"
    scene = bpy.data.scenes.get(name) or bpy.data.scenes.new(name)
    scene.frame_start, scene.frame_end = first, last
    for attribute in ("fps", "fps_base", "resolution_x", "resolution_y", "resolution_percentage"):
        setattr(scene.render, attribute, getattr(rendered.render, attribute))
    scene.display_settings.display_device = rendered.display_settings.display_device
    for attribute in ("view_transform", "look", "exposure", "gamma"):
        setattr(scene.view_settings, attribute, getattr(rendered.view_settings, attribute))
    return scene
