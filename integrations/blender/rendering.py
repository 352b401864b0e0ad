"""Operator that renders the planned regions."""

from __future__ import annotations

from pathlib import Path
from threading import Event
from typing import Any, ClassVar

import bpy

from .preparing import owners_of
from .properties import folders_of, render_size
from .round_trip import settings
from .round_trip.errors import RoundTripError
from .round_trip.regions import PLAN_FILE, Plan, Region, check_size, read_plan, remove_outdated, unrendered
from .round_trip.settings import Setting

INTERVAL = 0.1
"""Seconds between two looks at whether a render has ended."""

CHANGED = tuple(
    Setting("render", name, 0)
    for name in (
        *("filepath", "use_border", "use_crop_to_border"),
        *("border_min_x", "border_max_x", "border_min_y", "border_max_y"),
    )
)
"""Settings that rendering regions changes, and puts back; without their values."""


class FPSBOOST_OT_render_regions(bpy.types.Operator):
    """Render the planned regions, each cropped into a file of its own; Esc stops, and another call goes on"""

    bl_idname = "fpsboost.render_regions"
    bl_label = "Render Regions"

    current: ClassVar[str] = ""
    """Progress of the rendering for the panel, such as "Region 1 of 3"; empty if there is none."""

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether nothing is being rendered."""
        return not bpy.app.is_job_running("RENDER") and not cls.current

    def execute(self, context: Any) -> set[str]:
        """Render the regions and wait for them."""
        try:
            self._begin(context)
        except RoundTripError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        try:
            for region in self._regions:
                self._set(region)
                bpy.ops.render.render(write_still=True, scene=self._scene.name)
        except RuntimeError as error:  # what an operator reports as an error, such as a missing camera
            self.report({"ERROR"}, str(error))
        finally:
            self._put_back()
        return self._finish()

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Start rendering and return; `modal` starts one region after the other."""
        try:
            self._begin(context)
        except RoundTripError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._waiting, self._stopped = list(self._regions), Event()
        self._handler = lambda *_: self._stopped.set()
        bpy.app.handlers.render_cancel.append(self._handler)
        self._timer = context.window_manager.event_timer_add(INTERVAL, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Start the next region when the one before has ended."""
        if event.type == "ESC" and event.value == "PRESS":
            self._stopped.set()
        if event.type != "TIMER" or bpy.app.is_job_running("RENDER"):
            return {"PASS_THROUGH"}
        if self._waiting and not self._stopped.is_set():
            self._start_next()
            return {"PASS_THROUGH"}
        self.cancel(context)
        return self._finish()

    def cancel(self, context: Any) -> None:
        """Put everything back, also when Blender is closed or another file is opened."""
        FPSBOOST_OT_render_regions.current = ""
        bpy.app.handlers.render_cancel.remove(self._handler)
        context.window_manager.event_timer_remove(self._timer)
        self._put_back()

    def _begin(self, context: Any) -> None:
        """Read the plan and remember the settings; `RoundTripError` if something has to be done before."""
        self._scene = context.scene
        folders = folders_of(self._scene)
        self._folder = folders.regions
        self._plan = read_plan(folders.plan)
        check_size(self._plan, *render_size(self._scene))
        self._regions = regions_to_render(self._plan, folders.plan, folders.regions)
        if not self._scene.fpsboost.remembered:
            raise RoundTripError("The scene's settings are put back, but regions need those of the frames; prepare.")
        self._before = settings.read(owners_of(self._scene), CHANGED)
        self._frame = self._scene.frame_current, self._scene.frame_subframe

    def _start_next(self) -> None:
        done = len(self._regions) - len(self._waiting)
        FPSBOOST_OT_render_regions.current = f"Region {done + 1} of {len(self._regions)}"
        self._set(self._waiting.pop(0))
        try:
            if "CANCELLED" in bpy.ops.render.render("INVOKE_DEFAULT", write_still=True, scene=self._scene.name):
                self._stopped.set()
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            self._stopped.set()

    def _set(self, region: Region) -> None:
        """Set frame, border and file for a region."""
        self._scene.frame_set(region.frame)
        settings.write(owners_of(self._scene), region_settings(self._plan, region, self._folder))

    def _put_back(self) -> None:
        frame, subframe = self._frame
        self._scene.frame_set(frame, subframe=subframe)
        settings.write(owners_of(self._scene), self._before)

    def _finish(self) -> set[str]:
        missing = unrendered(self._plan, self._folder)
        if missing:
            self.report({"WARNING"}, f"{len(missing)} regions are not rendered yet; Render Regions goes on with them.")
            return {"CANCELLED"}
        self.report({"INFO"}, f"{len(self._plan.regions)} regions are in {self._folder}.")
        return {"FINISHED"}


classes = (FPSBOOST_OT_render_regions,)


def regions_to_render(plan: Plan, plan_folder: Path, folder: Path) -> list[Region]:
    """Return the regions that are not rendered yet, and remove those of an earlier plan."""
    remove_outdated(folder, (plan_folder / PLAN_FILE).stat().st_mtime)
    return unrendered(plan, folder)


def region_settings(plan: Plan, region: Region, folder: Path) -> list[Setting]:
    """Return the settings that render one region into a file of its size."""
    border = plan.border_of(region)
    return [
        Setting("render", "filepath", str(folder / region.name)),
        Setting("render", "use_border", True),
        Setting("render", "use_crop_to_border", True),
        *(Setting("render", f"border_{edge}", value) for edge, value in border._asdict().items()),
    ]
