"""Closed captions inside the pictures of a video (ATSC A/53 Part 4): read from a picture, written into H.264.

They are commands to a screen, a few bytes with each picture, which mean something only whole, once, and in order: so
they belong to a time and not to a picture. Whoever makes other pictures of those of a video passes on what lies between
two of them with the later one.
"""

import re

from av import VideoFrame

from fpsboost.media.side_data import CAPTIONS, side_data_of

LONGEST = 93  # bytes of captions in one message

ENTRY = re.compile(rb"(?s)([\xfc-\xff]..)|...")
"""Entry of captions, its type and two bytes, as a group if it is valid."""
MESSAGE = re.compile(rb"(?s).{1,93}")
"""What one message holds of captions."""

FIRST_SLICE = re.compile(rb"\0?\0\0\x01[\x01-\x05\x21-\x25\x41-\x45\x61-\x65]")
"""Start of a unit of H.264 that holds a part of a picture."""


def captions_of(picture: VideoFrame) -> bytes:
    """Return the entries of closed captions that a picture carries, three bytes each."""
    return dict(side_data_of(picture)).get(CAPTIONS, b"")


def with_captions(data: bytes, captions: bytes) -> bytes:
    """Return a coded picture of H.264 with closed captions in messages (SEI) before it.

    Padding is left out where more than one message would be needed.
    """
    if len(captions) > LONGEST:
        captions = ENTRY.sub(rb"\1", captions)
    messages = b"".join(map(_message, MESSAGE.findall(captions)))
    return FIRST_SLICE.sub(lambda slices: messages + slices[0], data, count=1)


def _message(captions: bytes) -> bytes:
    """Return user data registered by ITU-T T.35, with bytes inserted so that it contains no start of another unit."""
    payload = b"\xb5\0\x31GA94\3" + bytes([0x40 | len(captions) // 3, 0xFF]) + captions + b"\xff"
    return b"\0\0\0\1\6" + re.sub(rb"\0\0(?=[\x00-\x03])", b"\0\0\3", bytes([4, len(payload)]) + payload + b"\x80")
