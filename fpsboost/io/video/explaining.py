"""Sentences for errors while a video is written."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator

import av.error

from fpsboost.errors import OutputError


@contextlib.contextmanager
def explained_writing(name: str) -> Iterator[None]:
    """Convert errors of FFmpeg and the operating system into an `OutputError` with a sentence about the file."""
    try:
        yield
    except (av.error.FFmpegError, OSError) as error:
        raise OutputError(_explain(error, name)) from error


def _explain(error: Exception, name: str) -> str:
    reasons = {
        errno.ENOSPC: f"{name} could not be finished because the disk is full; free some space and run again.",
        errno.EDQUOT: f"{name} could not be finished because the disk quota is used up; free some space and run again.",
        errno.EACCES: f"{name} may not be written; check the permissions of its folder.",
        errno.EPERM: f"{name} may not be written; check the permissions of its folder.",
        errno.EROFS: f"{name} lies on a read-only disk; choose another folder.",
        errno.EFBIG: f"{name} grew larger than the disk or the system allows; choose another disk or a higher `crf`.",
    }
    number = getattr(error, "errno", None)
    reason = getattr(error, "strerror", None) or error
    return reasons.get(number or 0, f"{name} could not be written ({reason}); try another `codec` or container.")
