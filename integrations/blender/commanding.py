"""Operators that run fpsboost: convert, plan, merge."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from .preparing import writes_vectors
from .properties import folders_of, program_of, render_size, rendered_frames
from .round_trip.commands import Run, convert_command, merge_command, plan_command
from .round_trip.errors import RoundTripError
from .round_trip.folders import check_renders, remove_unfinished, replace_folder
from .round_trip.regions import check_size, read_plan, unrendered
from .showing import load_sequence

INTERVAL = 0.2
"""Seconds between two looks at a running program."""


class Commanding:
    """Base of the operators: a command that runs beside Blender, which Esc stops.

    Called from a script they wait for its end; called by a button Blender goes on, and shows the progress.
    """

    current: ClassVar[tuple[str, Run] | None] = None
    """Label and command that run at present; the panel shows them."""

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether no command is running."""
        return Commanding.current is None

    def command(self, context: Any) -> list[str]:
        """Return the command; `RoundTripError` if something has to be done before."""
        raise NotImplementedError

    def finished(self, context: Any) -> str:
        """Return a sentence about what is there now."""
        raise NotImplementedError

    def execute(self, context: Any) -> set[str]:
        """Run the command and wait for its end."""
        try:
            self._run = Run(self.command(context))
            return self._end(context)
        except RoundTripError as error:
            return self._refuse(error)

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Start the command and return; `modal` follows it."""
        try:
            self._run = Run(self.command(context))
        except RoundTripError as error:
            return self._refuse(error)
        Commanding.current = self.bl_label, self._run
        window_manager = context.window_manager
        self._timer = window_manager.event_timer_add(INTERVAL, window=context.window)
        window_manager.progress_begin(0, 100)
        window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Show how far the command is, stop it on Esc, and end with it."""
        if event.type == "ESC" and event.value == "PRESS" and self._run.is_running:
            self._run.stop()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        redraw(context)
        if self._run.is_running:
            if self._run.progress is not None:
                context.window_manager.progress_update(100 * self._run.progress.fraction)
            return {"PASS_THROUGH"}
        self._clear(context)
        try:
            return self._end(context)
        except RoundTripError as error:
            return self._refuse(error)

    def cancel(self, context: Any) -> None:
        """Stop the command when Blender is closed or another file is opened."""
        self._run.stop()
        self._clear(context)

    def _clear(self, context: Any) -> None:
        Commanding.current = None
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        redraw(context)

    def _end(self, context: Any) -> set[str]:
        try:
            self._run.finish()
        except RoundTripError:
            if not self._run.is_stopped:
                raise
            self.report({"INFO"}, f"{self.bl_label}: stopped, nothing was replaced.")
            return {"CANCELLED"}
        for remark in self._run.remarks:
            self.report({"WARNING"}, remark)
        self.report({"INFO"}, self.finished(context))
        return {"FINISHED"}

    def _refuse(self, error: RoundTripError) -> set[str]:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}


class FPSBOOST_OT_convert(Commanding, bpy.types.Operator):
    """Make the frames between the rendered ones, with all passes; Esc stops"""

    bl_idname = "fpsboost.convert"
    bl_label = "Convert"

    def command(self, context: Any) -> list[str]:
        scene = context.scene
        folders = folders_of(scene)
        check_renders(folders.renders, rendered_frames(scene))
        vectors = writes_vectors(scene)
        return convert_command(program_of(context), folders, scene.fpsboost.frame_step, vectors=vectors)

    def finished(self, context: Any) -> str:
        return f"All frames are in {folders_of(context.scene).made}."


class FPSBOOST_OT_plan(Commanding, bpy.types.Operator):
    """Find the regions of the made frames that are most likely wrong; Esc stops"""

    bl_idname = "fpsboost.plan"
    bl_label = "Plan"

    def command(self, context: Any) -> list[str]:
        scene = context.scene
        folders = folders_of(scene)
        check_renders(folders.renders, rendered_frames(scene))
        remove_unfinished(folders.plan)
        return plan_command(program_of(context), folders, scene.fpsboost.budget)

    def finished(self, context: Any) -> str:
        folders = folders_of(context.scene)
        replace_folder(folders.plan)
        plan = read_plan(folders.plan)
        frames = len({region.frame for region in plan.regions})
        return f"{len(plan.regions)} regions in {frames} frames are to be rendered."


class FPSBOOST_OT_merge(Commanding, bpy.types.Operator):
    """Put the rendered regions into the made frames, and load the result into the Video Sequencer; Esc stops"""

    bl_idname = "fpsboost.merge"
    bl_label = "Merge"

    def command(self, context: Any) -> list[str]:
        folders = folders_of(context.scene)
        plan = read_plan(folders.plan)
        check_size(plan, *render_size(context.scene))
        missing = unrendered(plan, folders.regions)
        if missing:
            raise RoundTripError(f"{len(missing)} regions are not rendered yet; render them, then merge.")
        remove_unfinished(folders.merged)
        return merge_command(program_of(context), folders)

    def finished(self, context: Any) -> str:
        folders = folders_of(context.scene)
        replace_folder(folders.merged)
        strip_scene = load_sequence(context, folders.merged)
        return f"The result is a strip in the scene {strip_scene.name}."


classes = (FPSBOOST_OT_convert, FPSBOOST_OT_plan, FPSBOOST_OT_merge)


def redraw(context: Any) -> None:
    """Have the panels drawn anew that show how far a command is."""
    for area in context.screen.areas if context.screen else ():
        if area.type == "PROPERTIES":
            area.tag_redraw()
