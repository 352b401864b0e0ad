"""The panel, in the output properties."""

from __future__ import annotations

from typing import Any

import bpy

from .commanding import Commanding
from .rendering import FPSBOOST_OT_render_regions


class FPSBOOST_PT_output(bpy.types.Panel):
    """The steps of the round trip, from top to bottom."""

    bl_label = "fpsboost"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "output"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, chosen = self.layout, context.scene.fpsboost
        layout.use_property_split = True
        layout.use_property_decorate = False

        column = layout.column()
        column.prop(chosen, "frame_step")
        column.prop(chosen, "folder")
        column.prop(chosen, "passes")
        row = layout.row(align=True)
        row.operator("fpsboost.prepare", icon="SETTINGS")
        row.operator("fpsboost.restore", icon="LOOP_BACK")

        column = layout.column()
        column.enabled = bool(chosen.remembered)
        column.operator("render.render", text="Render Every N-th Frame", icon="RENDER_ANIMATION").animation = True

        column = layout.column()
        column.operator("fpsboost.convert", icon="FRAME_NEXT")
        row = column.row(align=True)
        row.operator("fpsboost.show_confidence", icon="IMAGE_DATA")
        row.operator("fpsboost.load_sequence", icon="SEQUENCE")

        column = layout.column()
        column.prop(chosen, "budget")
        column.operator("fpsboost.plan", icon="SELECT_SET")
        column.operator("fpsboost.render_regions", icon="RENDER_STILL")
        column.operator("fpsboost.merge", icon="SELECT_EXTEND")

        draw_progress(layout)


classes = (FPSBOOST_PT_output,)


def draw_progress(layout: Any) -> None:
    """Draw a bar for the command that runs, if one does."""
    if Commanding.current is not None:
        label, run = Commanding.current
        fraction = run.progress.fraction if run.progress else 0.0
        layout.progress(factor=fraction, text=f"{label}: {run.progress or 'running'} (Esc stops)")
    elif FPSBOOST_OT_render_regions.current:
        layout.label(text=FPSBOOST_OT_render_regions.current, icon="RENDER_STILL")
