"""The round trip in Blender itself, without a window: ``PYTHON blender_round_trip.py EXTENSION PROGRAM FOLDER``.

PYTHON is one that has Blender's module bpy. Prints what came out as JSON. Run as a command by tests.
"""

import importlib.util
import json
import sys
from pathlib import Path

import bpy


def main() -> None:
    """Make the round trip of a small scene."""
    extension, program, folder = (Path(each).absolute() for each in sys.argv[1:])
    addon = load_extension(extension)
    scene = draw_scene()
    addon.properties.program_of = addon.commanding.program_of = lambda context: str(program)
    scene.fpsboost.folder = str(folder)
    scene.fpsboost.budget = 20
    before = settings_of(scene)
    said = {}
    for name in ("prepare", "render", "convert", "plan", "render_regions", "merge", "show_confidence", "restore"):
        if name == "render":
            said[name] = sorted(bpy.ops.render.render(animation=True))
        else:
            said[name] = sorted(getattr(bpy.ops.fpsboost, name)())
    result = bpy.data.scenes["Scene fpsboost"]
    editor = result.sequence_editor
    strip = (editor.strips_all if bpy.app.version >= (4, 4) else editor.sequences_all)[0]
    print(
        "RESULT "
        + json.dumps(
            {
                "said": said,
                "restored": settings_of(scene) == before,
                "strip": [strip.frame_final_start, strip.frame_final_duration, len(strip.elements)],
                "rate": [result.render.fps, scene.render.fps],
                "confidence": bpy.data.images["fpsboost confidence"].source,
            }
        )
    )
    addon.unregister()


def load_extension(folder: Path):
    """Import the extension from its folder, as Blender would, and register it."""
    spec = importlib.util.spec_from_file_location(
        "bl_ext_fpsboost", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    module.register()
    return module


def draw_scene():
    """Let the cube of the first scene move, and render it small."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 4, "CPU"
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    scene.frame_start, scene.frame_end = 1, 5
    cube = scene.objects["Cube"]
    for frame, x in ((1, -1), (5, 1)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    return scene


def settings_of(scene) -> list:
    """Return the settings that the round trip changes."""
    render, image, layer = scene.render, scene.render.image_settings, scene.view_layers[0]
    borders = [getattr(render, f"border_{edge}") for edge in ("min_x", "max_x", "min_y", "max_y")]
    return [
        *(scene.frame_step, scene.frame_current, render.filepath, render.use_border, render.use_crop_to_border),
        *(image.file_format, image.color_mode, image.color_depth, layer.use_pass_vector, layer.use_pass_z, *borders),
    ]


if __name__ == "__main__":
    main()
