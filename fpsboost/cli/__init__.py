"""Command-line interface of fpsboost, and the signals that stop it, which are handled before the rest is imported."""

import os
import signal


def stop_signals() -> list[int]:
    """Return the signals that stop the command line: not those that are switched off, as by nohup and a shell's &."""
    others = [signal.SIGINT, *([] if os.name == "nt" else [signal.SIGHUP])]
    return [signal.SIGTERM, *(number for number in others if signal.getsignal(number) is not signal.SIG_IGN)]
