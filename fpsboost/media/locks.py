"""Locks of files between processes, which the system releases when a process ends."""

import sys
from io import BufferedRandom

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl


def lock_file(file: BufferedRandom) -> None:
    """Lock a file until it is closed.

    Raises BlockingIOError if another process holds it, and another OSError if the disk has no locks.
    """
    if sys.platform == "win32":
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError from error
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
