"""Carry over titles and other tags of a file and its streams as far as another container can hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from typing import Any

import av
import av.container
import av.error

from fpsboost.io.video.encoding import EXACT_TIME_BASE_CONTAINERS
from fpsboost.io.video.languages import spellings
from fpsboost.io.video.pyav import open_input

FILE_SPECIFIC_TAGS = {
    *("major_brand", "minor_version", "compatible_brands", "encoder", "timecode", "duration"),
    *("wmfsdkversion", "wmfsdkneeded", "isvbr", "deviceconformancetemplate", "wm/encodingtime", "vbr peak"),
    *("metadatacreator", "metadatadate", "hasvideo", "hasaudio", "hasmetadata", "haskeyframes", "hascuepoints"),
    *("canseektoend", "datasize", "videosize", "audiosize", "filesize", "totalframes", "totalduration", "bytelength"),
    *("lasttimestamp", "lastkeyframetimestamp", "lastkeyframelocation", "videodatarate", "audiodatarate"),
}
"""Tags about the making, sizes and durations of the source file, which do not describe its content."""

STREAM_SPECIFIC_TAG_PREFIXES = (
    *("encoder", "duration", "vendor_id", "rotate", "timecode", "alpha_mode", "number_of", "bps", "_statistics"),
)
"""Prefixes of such tags of a stream."""

UNSET_CREATION_TIMES = ("1904-01-01T00:00:00", "1970-01-01T00:00:00")
"""Prefixes of creation times that mean that none was set."""

CAMERA_TAG_PREFIXES = ("make", "model", "software", "location", "com.", "creationdate")
"""Prefixes of tags that phones and cameras write, which mp4 and mov store in a list of free keys."""


@dataclass(frozen=True)
class Tags:
    """Tags of an output.

    Attributes
    ----------
    values : mapping of str to str
    free_keys : bool
        Whether the container keeps them only in its list of free keys (FFmpeg's ``use_metadata_tags``).
    lost : list of str
        Names of the tags that the container does not hold.
    """

    values: Mapping[str, str]
    free_keys: bool
    lost: list[str]


def tags_for(source: Mapping[str, str], container: str) -> Tags:
    """Return the tags of a source file that a container holds, by a trial with its muxer.

    In mp4 and mov, tags are stored either where players look for titles, or as free keys: the latter only if tags of a
    camera would be lost otherwise.
    """
    values = {
        key: value
        for key, value in source.items()
        if not _is_file_specific(key, value) and not _is_language_duplicate(key, source)
    }
    if not values:
        return Tags(values, False, [])
    lost = _lost_tags(values, container, {})
    if container in EXACT_TIME_BASE_CONTAINERS and any(name.lower().startswith(CAMERA_TAG_PREFIXES) for name in lost):
        return Tags(values, True, _lost_tags(values, container, {"movflags": "+use_metadata_tags"}))
    return Tags(values, False, lost)


def copy_labels(stream: av.stream.Stream, target: av.stream.Stream, container: str) -> None:
    """Copy language, title and disposition of a stream to a stream of a container.

    Languages become three-letter codes; .mov supports only one of two codes for some languages.
    """
    labels = {
        key: value for key, value in stream.metadata.items() if not key.lower().startswith(STREAM_SPECIFIC_TAG_PREFIXES)
    }
    if "name" in labels:  # FFmpeg reads mp4's stream title as "name", but writes it from "title", as Matroska's
        labels.setdefault("title", labels.pop("name"))
    language = next((key for key in labels if key.lower() == "language"), None)
    if language is not None:
        known = spellings(labels[language])
        kept = [each for each in known if _tags_read_back({}, container, {}, each)[1].get("language") == each]
        labels[language] = next(iter([*kept, *known]), labels[language])
    target.metadata.update(labels)
    target.disposition = stream.disposition


def lost_labels(wanted: av.stream.Stream, found: av.stream.Stream) -> list[str]:
    """Describe the language, title and dispositions of `wanted` that the stream `found` of a finished file lacks."""
    before, after = _lower(wanted.metadata), _lower(found.metadata)
    lost = []
    if before.get("language", "und") not in ("und", after.get("language")):
        lost.append(f"language {before['language']}")
    if before.get("title") and before["title"] not in (after.get("title"), after.get("name")):
        lost.append(f"title {before['title']}")
    roles = int(wanted.disposition) & ~int(found.disposition)
    lost += [f"role {role.name}" for role in av.stream.Disposition if roles & role]
    return lost


def _is_file_specific(key: str, value: str) -> bool:
    """Return whether a tag does not describe the content: data about the source file, or an unset creation time."""
    name = key.lower()
    made = (
        name in FILE_SPECIFIC_TAGS or name.startswith("wm/wmadrc") or (name == "software" and value.startswith("Lav"))
    )
    return made or (name == "creation_time" and value.startswith(UNSET_CREATION_TIMES))


def _is_language_duplicate(key: str, tags: Mapping[str, str]) -> bool:
    """Return whether a tag with a language suffix (``location-eng``) repeats the tag without it."""
    name, _, language = key.rpartition("-")
    return len(language) == 3 and tags.get(name) == tags[key]


def _lost_tags(tags: Mapping[str, str], container: str, options: dict[str, str]) -> list[str]:
    """Return the names of the tags that cannot be read back from a file of a container."""
    kept, _ = _tags_read_back(tags, container, options)
    return [name for name in tags if kept and name.lower() not in kept]


def _tags_read_back(
    tags: Mapping[str, str], container: str, options: dict[str, str], language: str = "und"
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the tags of a file, and of a stream in a language, as read back after muxing; empty if the trial fails."""
    file = BytesIO()
    codec = "vp8" if container == "webm" else "mjpeg"
    tick = Fraction(1, 25)
    try:
        with av.open(file, "w", format=container, container_options=options) as output:
            output.metadata.update(tags)
            stream = output.add_mux_stream(codec, rate=25, width=64, height=64, time_base=tick)
            stream.metadata["language"] = language
            packet: av.Packet[Any] = av.Packet(bytes(64))
            packet.stream, packet.pts, packet.dts, packet.duration, packet.time_base = stream, 0, 0, 1, tick
            packet.is_keyframe = True
            output.mux(packet)
        file.seek(0)
        with open_input(file) as again:
            return _lower(again.metadata), _lower(again.streams[0].metadata)
    except (av.error.FFmpegError, ValueError):
        return {}, {}


def _lower(tags: Mapping[str, str]) -> dict[str, str]:
    return {key.lower(): value for key, value in tags.items()}
