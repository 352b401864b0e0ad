"""Titles and other tags of a file and its streams, as another container can hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from typing import Any

import av
import av.container
import av.error

from fpsboost.io.video.encoding import EXACT_CLOCKS
from fpsboost.io.video.languages import spellings

OF_THE_OLD_FILE = {
    *("major_brand", "minor_version", "compatible_brands", "encoder", "timecode", "duration"),
    *("wmfsdkversion", "wmfsdkneeded", "isvbr", "deviceconformancetemplate", "wm/encodingtime", "vbr peak"),
    *("metadatacreator", "metadatadate", "hasvideo", "hasaudio", "hasmetadata", "haskeyframes", "hascuepoints"),
    *("canseektoend", "datasize", "videosize", "audiosize", "filesize", "totalframes", "totalduration", "bytelength"),
    *("lasttimestamp", "lastkeyframetimestamp", "lastkeyframelocation", "videodatarate", "audiodatarate"),
}
"""Tags that say how the old file was made and how long its parts are, not what it shows."""

OF_THE_OLD_STREAM = (
    *("encoder", "duration", "vendor_id", "rotate", "timecode", "alpha_mode", "number_of", "bps", "_statistics"),
)
"""Beginnings of such tags of a stream."""

UNSET_CLOCKS = ("1904-01-01T00:00:00", "1970-01-01T00:00:00")
"""Times of creation that mean that nobody wrote one."""

OF_A_CAMERA = ("make", "model", "software", "location", "com.", "creationdate")
"""Beginnings of tags that phones and cameras write, for which mp4 and mov have a list of free keys."""


@dataclass(frozen=True)
class Tags:
    """Tags of an output.

    Attributes
    ----------
    values : mapping of str to str
    free_keys : bool
        The container keeps them only in its list of free keys (FFmpeg's ``use_metadata_tags``).
    lost : list of str
        Names of what it does not hold.
    """

    values: Mapping[str, str]
    free_keys: bool
    lost: list[str]


def tags_for(source: Mapping[str, str], container: str) -> Tags:
    """Which tags of a source file go into a container, found out by writing them once.

    In mp4 and mov the titles that their players look for stand in one place or in another: in free keys only where a
    camera's tags would be lost otherwise.
    """
    values = {key: value for key, value in source.items() if not _is_old(key, value) and not _is_twin(key, source)}
    if not values:
        return Tags(values, False, [])
    lost = _lost(values, container, {})
    if container in EXACT_CLOCKS and any(name.lower().startswith(OF_A_CAMERA) for name in lost):
        return Tags(values, True, _lost(values, container, {"movflags": "+use_metadata_tags"}))
    return Tags(values, False, lost)


def copy_labels(stream: av.stream.Stream, target: av.stream.Stream, container: str) -> None:
    """Give a stream of a container the language, title and role of another.

    Languages get three letters; .mov knows some of them only by one of two spellings.
    """
    labels = {key: value for key, value in stream.metadata.items() if not key.lower().startswith(OF_THE_OLD_STREAM)}
    if "name" in labels:  # what mp4 gives as the name, it takes as the title, and so does Matroska
        labels.setdefault("title", labels.pop("name"))
    language = next((key for key in labels if key.lower() == "language"), None)
    if language is not None:
        known = spellings(labels[language])
        kept = [each for each in known if _written({}, container, {}, each)[1].get("language") == each]
        labels[language] = next(iter([*kept, *known]), labels[language])
    target.metadata.update(labels)
    target.disposition = stream.disposition


def lost_labels(wanted: av.stream.Stream, found: av.stream.Stream) -> list[str]:
    """What a stream of a finished file does not say of what it was to say: language, title and roles."""
    before, after = _lower(wanted.metadata), _lower(found.metadata)
    lost = []
    if before.get("language", "und") not in ("und", after.get("language")):
        lost.append(f"language {before['language']}")
    if before.get("title") and before["title"] not in (after.get("title"), after.get("name")):
        lost.append(f"title {before['title']}")
    roles = int(wanted.disposition) & ~int(found.disposition)
    lost += [f"role {role.name}" for role in av.stream.Disposition if roles & role]
    return lost


def _is_old(key: str, value: str) -> bool:
    """Whether a tag says nothing of what the file shows: how it was made, or a clock that stood at its beginning."""
    name = key.lower()
    made = name in OF_THE_OLD_FILE or name.startswith("wm/wmadrc") or (name == "software" and value.startswith("Lav"))
    return made or (name == "creation_time" and value.startswith(UNSET_CLOCKS))


def _is_twin(key: str, tags: Mapping[str, str]) -> bool:
    """Whether a tag says in a language (``location-eng``) what another says without."""
    name, _, language = key.rpartition("-")
    return len(language) == 3 and tags.get(name) == tags[key]


def _lost(tags: Mapping[str, str], container: str, options: dict[str, str]) -> list[str]:
    """The names of tags that do not come back from a file of a container."""
    kept, _ = _written(tags, container, options)
    return [name for name in tags if kept and name.lower() not in kept]


def _written(
    tags: Mapping[str, str], container: str, options: dict[str, str], language: str = "und"
) -> tuple[dict[str, str], dict[str, str]]:
    """Tags of a file, and of a stream in a language, as they come back; none where that cannot be found out."""
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
        with av.open(file, metadata_errors="replace") as again:
            return _lower(again.metadata), _lower(again.streams[0].metadata)
    except (av.error.FFmpegError, ValueError):
        return {}, {}


def _lower(tags: Mapping[str, str]) -> dict[str, str]:
    return {key.lower(): value for key, value in tags.items()}
