"""Entry point of the command line; it handles interruption from the first import on."""

import gc
import os
import signal
from types import FrameType

from fpsboost.cli import stop_signals


def leave(number: int, frame: FrameType | None) -> None:
    """Print a message and exit; nothing needs cleaning up while modules are imported.

    An exception would be unreliable: loading a compiled library may swallow or replace it.
    """
    os.write(2, b"Stopped; nothing was written.\n")
    os._exit(130)


def main() -> None:
    """Run the command line and exit."""
    for number in stop_signals():
        signal.signal(number, leave)
    gc.disable()  # imports make many objects and few cycles; the command enables it again
    from fpsboost.cli import app  # noqa: PLC0415 (takes a while, and may be stopped meanwhile)

    app.main()


if __name__ == "__main__":
    main()
