"""Where the command line begins, as ``fpsboost`` and as ``python -m fpsboost``: it can be stopped from here on."""

from __future__ import annotations

import os
import signal
from types import FrameType


def leave(number: int, frame: FrameType | None) -> None:
    """Say one sentence and go: while modules are imported, nothing has been begun that would have to be put away.

    An exception could not be relied on here: where a library loads its compiled parts, it gets lost or becomes another.
    """
    os.write(2, b"Stopped; nothing was written.\n")
    os._exit(130)


def main() -> None:
    """Run the command line and exit."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as nohup and a shell's & have it
        signal.signal(signal.SIGINT, leave)
    signal.signal(signal.SIGTERM, leave)
    from fpsboost.cli import app  # noqa: PLC0415 (takes a while, and may be stopped meanwhile)

    app.main()


if __name__ == "__main__":
    main()
