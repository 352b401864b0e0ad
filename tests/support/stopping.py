"""Runs that stop after some frames, as if somebody pressed Ctrl-C."""

from fpsboost.contracts import SilentObserver, Summary


class StopAfter(SilentObserver):
    """Observer that stops a run after some frames."""

    def __init__(self, frames: int) -> None:
        self._frames = frames

    def wrote(self, summary: Summary) -> None:
        if summary.frames_out == self._frames:
            raise KeyboardInterrupt
