"""ComfyUI as the observer of a run: its progress bar, its button that cancels, and its log."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from fpsboost import ClipInfo, Summary
from fpsboost.threads import nothing

log = logging.getLogger("fpsboost")


class HostObserver:
    """Observer that moves ComfyUI's progress bar, and ends the run with ComfyUI's own exception when it is cancelled.

    Outside of ComfyUI it does neither.
    """

    def __init__(self, count: int) -> None:
        self._bar, self._check_cancelled = _host_functions(count)

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """Do nothing: the batch is there already."""

    def ready(self) -> None:
        """End the run if it was cancelled already."""
        self._check_cancelled()

    def wrote(self, summary: Summary) -> None:
        """Show the progress, and end the run if it was cancelled."""
        if self._bar is not None:
            self._bar.update_absolute(summary.frames_out)
        self._check_cancelled()


def say_summary(summary: Summary) -> None:
    """Say what was done."""
    log.info(
        "fpsboost: %d images in, %d out, %d of them made; %d scene cuts, %d duplicates.",
        *(summary.frames_in, summary.frames_out, summary.frames_made, summary.scene_cuts, summary.duplicates),
    )


def _host_functions(count: int) -> tuple[Any, Callable[[], None]]:
    """Return a progress bar, and the function that raises if the run was cancelled; neither outside of ComfyUI."""
    try:
        from comfy.model_management import throw_exception_if_processing_interrupted  # noqa: PLC0415 (may be missing)
        from comfy.utils import ProgressBar  # noqa: PLC0415
    except ImportError:
        return None, nothing
    return ProgressBar(count), throw_exception_if_processing_interrupted
