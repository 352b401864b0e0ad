"""Blender extension: render every N-th frame, make the rest with fpsboost, render again what is doubtful.

The work is done by the program fpsboost, which runs beside Blender; `round_trip` is what needs no Blender.
"""

from __future__ import annotations

import bpy

from . import commanding, panel, preparing, properties, rendering, showing

classes = (
    *properties.classes,
    *preparing.classes,
    *commanding.classes,
    *rendering.classes,
    *showing.classes,
    *panel.classes,
)


def register() -> None:
    """Add the extension's classes and the scene's settings to Blender."""
    for each in classes:
        bpy.utils.register_class(each)
    bpy.types.Scene.fpsboost = bpy.props.PointerProperty(type=properties.FpsboostSettings)


def unregister() -> None:
    """Remove them."""
    del bpy.types.Scene.fpsboost
    for each in reversed(classes):
        bpy.utils.unregister_class(each)
