"""Locks of files between processes, which the system releases when a process ends."""

import errno
import sys
from io import BufferedRandom

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

LOCKED = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
"""Codes of the errors for a file that another process has locked; others mean that the disk has no locks."""


def lock_file(file: BufferedRandom) -> None:
    """Lock a file until it is closed.

    Raises BlockingIOError if another process holds it, and another OSError if the disk has no locks.
    """
    try:
        if sys.platform == "win32":
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in LOCKED:
            raise BlockingIOError from error
        raise
