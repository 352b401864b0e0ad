"""Open a file for demuxing, or say why it cannot be opened: playlists, files that were never finished, segments."""

from collections.abc import Iterator
from pathlib import Path

from av.container import InputContainer

from fpsboost.media.errors import InputError
from fpsboost.media.pyav import REFUSALS, open_input

HEADER_BOX = b"moov"
"""Type of the box that describes the streams of an MP4 or MOV, and lists their samples."""


FIRST_BOXES = {b"ftyp", b"mdat", b"wide", b"free", b"skip"}  # types of the boxes that files of MP4 and MOV begin with


SEGMENT_BOXES = {b"styp", b"sidx", b"moof", b"emsg", b"prft"}
"""Types of the boxes that a segment of DASH or HLS in MP4 begins with, which do not describe its streams."""


unreadable_playlists = {
    b"<MPD": "is a manifest of DASH, which this FFmpeg cannot read; join the initialization segment and the segments "
    "of one stream (cat init.mp4 *.m4s > whole.mp4), and name that.",
    b"#EXT-X-KEY": "is a playlist of encrypted segments (#EXT-X-KEY), and they or their key cannot be read; put the "
    "key where it says, or name a copy that is not encrypted.",
    b"": "is a playlist, and the files that it names cannot be read; check that they are there.",
}
"""Reason why a playlist cannot be opened, with advice, by the first of these marks that it contains."""


def open_video(path: Path, name: str, *, playlists: bool = False) -> InputContainer:
    """Open a file for demuxing, or raise `InputError` with a sentence about `name`."""
    if path.is_dir():
        raise InputError(f"{name} is a folder; name a video file, or a pattern of images inside it.")
    if not path.exists():
        raise InputError(f"{name} does not exist; check the path.")
    try:
        # An absolute path, because FFmpeg takes what stands before a colon in a relative one for a protocol.
        container = open_input(str(path.absolute()), playlists=playlists)
    except PermissionError:
        raise InputError(f"{name} may not be read; check its permissions.") from None
    except (*REFUSALS, OSError):
        if not playlists:
            check_is_no_playlist(path, name)
        raise InputError(f"{name} {_why_unreadable(path)}") from None
    if container.format.name == "tty":  # FFmpeg shows any text file as a terminal session
        container.close()
        raise InputError(f"{name} is a text file; name a video file.")
    return container


def check_is_no_playlist(path: Path, name: str) -> None:
    """Raise `InputError` for a file that names other files to be read."""
    if _is_playlist(path):
        raise InputError(
            f"{name} is a playlist, which other files would be read for; name the file that it plays, or pass "
            "`allow_playlists=True`."
        )


def _is_playlist(path: Path) -> bool:
    """Return whether a file is text that names other files to be read: HLS, DASH, SDP, scripts of concat."""
    with path.open("rb") as file:
        head = file.read(1000).lstrip(b"\xef\xbb\xbf \t\r\n")
    return head.startswith((b"#EXTM3U", b"ffconcat version", b"v=0")) or b"<MPD" in head


def _why_unreadable(path: Path) -> str:
    """Return why FFmpeg cannot open a file, and what to do, as the end of a sentence that its name begins."""
    if _is_playlist(path):
        text = path.read_bytes()
        return next(reason for mark, reason in unreadable_playlists.items() if mark in text)
    boxes = [kind for kind, _ in boxes_of(path)]
    is_whole = HEADER_BOX in boxes
    if not is_whole and not SEGMENT_BOXES.isdisjoint(boxes):
        return (
            "is a segment of DASH or HLS without its initialization segment, which says how to decode it; put that "
            "before it (cat init.mp4 segment.m4s > whole.mp4), and name the result."
        )
    if not is_whole and not FIRST_BOXES.isdisjoint(boxes[:1]):
        return (
            "was never finished: its index (moov) is missing, as after a crash or an interrupted copy; copy it again, "
            "or recover it with a tool such as untrunc."
        )
    return "is not a video file that can be read, or it is damaged at its beginning."


def boxes_of(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Yield the types of the boxes of an MP4 or MOV in order, that of the header with its content.

    What it yields of other files means nothing.
    """
    begin = 0
    size = path.stat().st_size
    with path.open("rb") as file:
        while len(head := file.read(16)) >= 8:
            kind = head[4:8]
            length = int.from_bytes(head[:4] if head[:4] != b"\0\0\0\1" else head[8:])
            yield kind, file.read(min(length, size)) if kind == HEADER_BOX else b""
            if not 8 <= length < size:  # 0 stands for the end of the file
                break
            begin = file.seek(begin + length)
