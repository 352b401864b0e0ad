"""Operators that prepare a scene for the round trip, and put its settings back."""

from __future__ import annotations

from typing import Any

import bpy

from .properties import PASSES, folders_of, rendered_frames
from .round_trip import settings
from .round_trip.errors import RoundTripError
from .round_trip.settings import Setting


class FPSBOOST_OT_prepare(bpy.types.Operator):
    """Set frame step, output folder, OpenEXR and passes; what was set before is remembered"""

    bl_idname = "fpsboost.prepare"
    bl_label = "Prepare"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Prepare the scene."""
        scene = context.scene
        try:
            folders = folders_of(scene)
            check_preparable(scene)
        except RoundTripError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        restore(scene)
        changes = settings.change(owners_of(scene), wanted_settings(scene, str(folders.renders)))
        scene.fpsboost.remembered = settings.to_text(changes)
        for remark in remarks_on(scene):
            self.report({"WARNING"}, remark)
        frames = rendered_frames(scene)
        self.report({"INFO"}, f"{len(frames)} frames are to be rendered, into {folders.renders}.")
        return {"FINISHED"}


class FPSBOOST_OT_restore(bpy.types.Operator):
    """Put back the settings that Prepare has changed"""

    bl_idname = "fpsboost.restore"
    bl_label = "Put Settings Back"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether there is anything to put back."""
        return bool(context.scene.fpsboost.remembered)

    def execute(self, context: Any) -> set[str]:
        """Put the settings back."""
        left = restore(context.scene)
        if left:
            names = ", ".join(setting.name for setting in left)
            self.report({"INFO"}, f"Changed since and left alone: {names}.")
        return {"FINISHED"}


classes = (FPSBOOST_OT_prepare, FPSBOOST_OT_restore)


def restore(scene: Any) -> list[Setting]:
    """Put back what was changed, and return what is left alone because it was changed since."""
    left = settings.restore(owners_of(scene), settings.from_text(scene.fpsboost.remembered))
    scene.fpsboost.remembered = ""
    return left


def owners_of(scene: Any) -> dict[str, Any]:
    """Return the owners of settings by their names in remembered changes."""
    layers = {f"view_layers/{layer.name}": layer for layer in scene.view_layers}
    return {"scene": scene, "render": scene.render, "image_settings": scene.render.image_settings, **layers}


def wanted_settings(scene: Any, folder: str) -> list[Setting]:
    """Return the settings of a scene for rendering into a folder, in the order in which they can be set."""
    image = scene.render.image_settings
    is_exr = image.file_format in {"OPEN_EXR", "OPEN_EXR_MULTILAYER"}
    # since Blender 5.0 the type of medium decides which formats there are
    media_type = [Setting("image_settings", "media_type", "MULTI_LAYER_IMAGE")] if hasattr(image, "media_type") else []
    return [
        Setting("scene", "frame_step", scene.fpsboost.frame_step),
        Setting("render", "filepath", folder + "/"),
        Setting("render", "use_file_extension", True),
        Setting("render", "use_placeholder", False),  # an empty file is no frame
        Setting("render", "use_sequencer", False),  # strips would be rendered instead of the scene
        Setting("render", "use_border", False),
        *media_type,
        Setting("image_settings", "file_format", "OPEN_EXR_MULTILAYER"),
        Setting("image_settings", "color_mode", "RGBA"),
        Setting("image_settings", "color_depth", image.color_depth if is_exr else "16"),
        *(
            Setting(f"view_layers/{layer.name}", PASSES[each][0], True)
            for layer in scene.view_layers
            if layer.use
            for each in sorted(scene.fpsboost.passes)
            if hasattr(layer, PASSES[each][0])
        ),
    ]


def check_preparable(scene: Any) -> None:
    """Raise `RoundTripError` if the scene cannot be rendered as a sequence of numbered images."""
    if scene.frame_start < 0:
        raise RoundTripError(f"Numbers of images are at least 0, but the first frame is {scene.frame_start}; move it.")
    if len(rendered_frames(scene)) < 2:
        step, last = scene.fpsboost.frame_step, scene.frame_end
        raise RoundTripError(
            f"Only frame {scene.frame_start} would be rendered of a range to {last} in steps of {step}; "
            "frames are made between two, so set a longer range or a smaller step."
        )
    if scene.render.use_multiview:
        raise RoundTripError("Stereoscopy writes two views of a frame; switch it off and render one view at a time.")


def remarks_on(scene: Any) -> list[str]:
    """Return sentences on what will not come out as one might expect."""
    remarks = []
    last = rendered_frames(scene)[-1]
    if last < scene.frame_end:
        remarks.append(f"The last frame that comes out is {last}: no rendered one follows; make the range longer.")
    if "VECTOR" in scene.fpsboost.passes and not writes_vectors(scene):
        remarks.append("Cycles writes no Vector pass with motion blur; the frames are made without it.")
    return remarks


def writes_vectors(scene: Any) -> bool:
    """Return whether rendered frames have a Vector pass."""
    blurs = scene.render.use_motion_blur and scene.render.engine == "CYCLES"
    return "VECTOR" in scene.fpsboost.passes and not blurs
