"""Carry over titles, languages, timecodes and other tags as far as another container can hold them.

Of Matroska's chapters FFmpeg reads a time and a name; their other properties are read from the file itself.
"""

import mmap
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import av
from av.container import InputContainer
from av.stream import Disposition, Stream

from fpsboost.media.containers import Container
from fpsboost.media.opening import HEADER_BOX, boxes_of
from fpsboost.media.pyav import REFUSALS, open_input, trial_file

FILE_SPECIFIC_TAGS = {"major_brand", "minor_version", "compatible_brands", "encoder", "timecode", "duration"}
FILE_SPECIFIC_TAGS |= {"wmfsdkversion", "wmfsdkneeded", "isvbr", "deviceconformancetemplate", "wm/encodingtime"}
FILE_SPECIFIC_TAGS |= {"metadatacreator", "metadatadate", "hasvideo", "hasaudio", "hasmetadata", "haskeyframes"}
FILE_SPECIFIC_TAGS |= {"hascuepoints", "canseektoend", "datasize", "videosize", "audiosize", "filesize", "totalframes"}
FILE_SPECIFIC_TAGS |= {"totalduration", "bytelength", "lasttimestamp", "lastkeyframetimestamp", "lastkeyframelocation"}
FILE_SPECIFIC_TAGS |= {"videodatarate", "audiodatarate", "vbr peak"}
"""Tags about the making, sizes and durations of the source file, which do not describe its content."""

STREAM_SPECIFIC_TAG_PREFIXES: tuple[str, ...] = ("encoder", "duration", "vendor_id", "rotate", "timecode")
STREAM_SPECIFIC_TAG_PREFIXES += ("alpha_mode", "number_of", "bps", "_statistics")
"""Prefixes of such tags of a stream."""

UNSET_CREATION_TIMES = ("1904-01-01T00:00:00", "1970-01-01T00:00:00")
"""Prefixes of creation times that mean that none was set."""

CAMERA_TAG_PREFIXES = ("make", "model", "software", "location", "com.", "creationdate")
"""Prefixes of tags that phones and cameras write, which mp4 and mov store in a list of free keys."""

counted_rates = {True: range(1, 256), False: range(30, 256, 30)}
"""Frames per second of a timecode track, which stores them in one byte, and of one that drops numbers."""

TIMECODE_PATTERN = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})([:;.])(\d{1,3})")

TIMECODE_ENTRY = re.compile(rb"(?s)stsd.{12}tmcd.{16}(.{4})(.{4})")
"""Description of a timecode track in MP4 and MOV: the ticks per second, and those per frame."""

ISO_639_2 = (
    "alb/sqi arm/hye baq/eus bur/mya chi/zho cze/ces dut/nld fre/fra geo/kat ger/deu gre/ell ice/isl mac/mkd mao/mri "
    "may/msa per/fas rum/ron slo/slk tib/bod wel/cym"
)
"""Codes of languages that have two of three letters, ISO 639-2/B and 639-2/T, as the standard lists them."""
terminological = dict(codes.split("/") for codes in ISO_639_2.split())
"""ISO 639-2/T code by ISO 639-2/B code, where these differ."""

three_letters = {"yo": "yor", "za": "zha", "zh": "zho", "zu": "zul"}
"""ISO 639-2/T code by the ISO 639-1 codes that FFmpeg does not find in its own table."""


CHAPTERS = b"\x10\x43\xa7\x70"
"""Identifier of Matroska's Chapters."""
CHAPTER = b"\xb6"
"""Identifier of ChapterAtom."""
CHAPTER_NAME = b"\x80"
"""Identifier of ChapterDisplay."""

IS_ORDERED = b"\x45\xdd"
"""Identifier of EditionFlagOrdered."""
IS_HIDDEN = b"\x98"
"""Identifier of ChapterFlagHidden."""
LANGUAGE = b"\x43\x7c"
"""Identifier of ChapLanguage."""

TRACKS = b"\x16\x54\xae\x6b"
"""Identifier of Tracks."""
TRACK = b"\xae"
"""Identifier of TrackEntry."""
TRACK_LANGUAGE = b"\x22\xb5\x9d"
"""Identifier of LanguageBCP47."""

PARENTS = (b"\x18\x53\x80\x67", TRACKS, TRACK, CHAPTERS, b"\x45\xb9", CHAPTER, CHAPTER_NAME)
"""Identifiers of the elements that are looked into: these, Segment and EditionEntry."""

MOST_TEXT = 64  # bytes of an element that are read; flags have up to 8, and languages less than this

ORDER = "the order of editions"

NO_LANGUAGES = (b"und", b"eng")
"""Languages without information: the unknown one, and Matroska's default where none is given."""


@dataclass(frozen=True)
class Tags:
    """Tags of an output, and the names of those that its container does not hold.

    With `free_keys`, the container keeps them only in its list of free keys (FFmpeg's ``use_metadata_tags``).
    """

    values: Mapping[str, str]
    free_keys: bool
    lost: list[str]


def tags_for(source: Mapping[str, str], container: Container) -> Tags:
    """Return the tags of a source file that a container holds, by a trial with its muxer.

    In mp4 and mov, tags are stored either where players look for titles, or as free keys: the latter only if tags of a
    camera would be lost otherwise.
    """
    values = {
        key: value.partition(";")[0] if key.lower() == "creation_time" else value  # FFmpeg 9 joins equal ones
        for key, value in source.items()
        if not _is_file_specific(key, value) and not _is_language_duplicate(key, source)
    }
    lost = _lost_tags(values, container.name)
    if container.exact_times and any(name.lower().startswith(CAMERA_TAG_PREFIXES) for name in lost):
        return Tags(values, True, _lost_tags(values, container.name, "+use_metadata_tags"))
    return Tags(values, False, lost)


def copy_labels(stream: Stream, target: Stream, container: Container) -> None:
    """Copy language, title and disposition of a stream to a stream of a container.

    Languages become three-letter codes; .mov supports only one of two codes for some languages. Matroska and WebM keep
    the name of a region or script, too.
    """
    labels = {
        key: value for key, value in stream.metadata.items() if not key.lower().startswith(STREAM_SPECIFIC_TAG_PREFIXES)
    }
    if "name" in labels:  # FFmpeg reads mp4's stream title as "name", but writes it from "title", as Matroska's
        labels.setdefault("title", labels.pop("name"))
    for language in [key for key in labels if key.lower() == "language"]:
        if "-" in labels[language] and container.matroska_elements:
            continue
        known = _language_codes(labels[language])
        kept = [code for code in known if _tags_read_back({}, container.name, language=code)[1].get("language") == code]
        labels[language] = next(iter([*kept, *known]), labels[language])
    target.metadata.update(labels)
    target.disposition = stream.disposition


def lost_labels(tags: dict[str, str], flags: Disposition, stream: Stream) -> Iterator[str]:
    """Yield, in words, the language, title and dispositions that a stream was given and lacks in the finished file."""
    before = _lower(tags)
    after = _lower(stream.metadata)
    language = before.get("language", "und")
    title = before.get("title")
    roles = int(flags) & ~int(stream.disposition)
    if language not in ("und", after.get("language")):
        yield f"the language {language}"
    if title and title not in (after.get("title"), after.get("name")):
        yield f"the title {title}"
    for role in Disposition:
        if roles & role:
            yield f"the role {role.name}"


def regional_languages(file: InputContainer) -> dict[int, str]:
    """Return the languages with a region or script, such as pt-BR, by the numbers of their streams.

    Beside the tag, Matroska has an element for them, which FFmpeg does not read; its tracks are FFmpeg's first streams.
    """
    found = {stream.index: _lower(stream.metadata).get("language", "") for stream in file.streams}
    elements = _elements_to(TRACKS, file)
    tracks = [element.begin for element in elements if element.name == TRACK]
    for element in elements:
        if element.name == TRACK_LANGUAGE:
            found[tracks.index(element.parent)] = element.content.decode("utf-8", "replace")
    return {index: language for index, language in found.items() if "-" in language}


def _language_codes(language: str) -> list[str]:
    """Return the three-letter codes of a language tag such as ``es-419``, the given or ISO 639-2/T one first."""
    name = re.split(r"[-_]", language.strip().lower(), maxsplit=1)[0]
    if re.fullmatch(r"[a-z]{2}", name) and name not in three_letters:
        # ASF holds codes of two letters, for which FFmpeg returns those of ISO 639-2/B
        code = _tags_read_back({}, "asf", language=name)[1].get("language", "")
        name = terminological.get(code, code)
    code = three_letters.get(name, name)
    others = [terminological.get(code), *(other for other, given in terminological.items() if given == code)]
    return [code, *filter(None, others)] if re.fullmatch(r"[a-z]{3}", code) else []


def _is_file_specific(key: str, value: str) -> bool:
    """Return whether a tag describes the source file and not its content."""
    name = key.lower()
    return (
        name in FILE_SPECIFIC_TAGS
        or name.startswith("wm/wmadrc")
        or (name == "software" and value.startswith("Lav"))
        or (name == "creation_time" and value.startswith(UNSET_CREATION_TIMES))
    )


def _is_language_duplicate(key: str, tags: Mapping[str, str]) -> bool:
    """Return whether a tag with a language suffix (``location-eng``) repeats the tag without it."""
    name, _, language = key.rpartition("-")
    return len(language) == 3 and tags.get(name) == tags[key]


def _lost_tags(tags: Mapping[str, str], container: str, movflags: str = "") -> list[str]:
    """Return the names of tags that a container does not keep, by a trial."""
    kept, _ = _tags_read_back(tags, container, movflags)
    return [name for name in tags if kept and name.lower() not in kept]


def _tags_read_back(
    tags: Mapping[str, str], container: str, movflags: str = "", *, language: str = "und"
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the tags of a file, and of a stream in a language, as read back from a header.

    Empty if there is no such header, as of Matroska and WebM, which keep all tags.
    """
    options = {"movflags": f"+empty_moov{movflags}"}
    with trial_file() as path, suppress(*REFUSALS):
        with av.open(str(path), "w", format=container, container_options=options) as output:
            output.metadata.update(tags)
            stream = output.add_mux_stream("mjpeg", rate=25, width=64, height=64, time_base=Fraction(1, 25))
            stream.metadata["language"] = language
            output.start_encoding()
        with open_input(str(path)) as again:
            return _lower(again.metadata), _lower(again.streams[0].metadata)
    return {}, {}


def _lower(tags: Mapping[str, str]) -> dict[str, str]:
    """Return tags with their names in lower case."""
    return {key.lower(): value for key, value in tags.items()}


def unread_of_chapters(file: InputContainer) -> Iterator[str]:
    """Yield in words the properties of chapters that FFmpeg does not read, found in Matroska's element for them.

    FFmpeg leaves out chapters inside others, and those that begin no later than one before, as where an edition begins.
    """
    kept = len(file.chapters())
    if not kept:
        return
    elements = _elements_to(CHAPTERS, file)
    names = [element.name for element in elements]
    contents = {(element.name, element.content) for element in elements}
    of_names = [element.parent for element in elements if element.name == CHAPTER_NAME]
    count = names.count(CHAPTER)
    if any(name == IS_ORDERED and value for name, value in contents):
        yield ORDER
    if count > kept:
        yield f"{count - kept} of {count} chapters"
    if len(of_names) > len(set(of_names)):
        yield "second names"
    if any(name == LANGUAGE and value not in NO_LANGUAGES for name, value in contents):
        yield "languages"
    if any(name == IS_HIDDEN and value for name, value in contents):
        yield "flags of hidden chapters"


class _Element(NamedTuple):
    """Element of Matroska: its identifier, where its parent's content and its own begin, and that without zeros."""

    name: bytes
    parent: int
    begin: int
    content: bytes


def _elements_to(last: bytes, file: InputContainer) -> list[_Element]:
    """Return the elements of a Matroska that are in `PARENTS`, up to the one named last, behind which packets may lie.

    No other file has any.
    """
    found: list[_Element] = []
    if file.format.name != "matroska,webm":
        return found
    with open(file.name, "rb") as source, mmap.mmap(source.fileno(), 0, access=mmap.ACCESS_READ) as data:
        parts = [(0, len(data))]
        for begin, end in parts:
            for name, start, stop in _elements(data, begin, end):
                found.append(_Element(name, begin, start, data[start : min(start + MOST_TEXT, stop)].strip(b"\0")))
                if name in PARENTS:
                    parts.append((start, stop))
                if name == last:
                    break
    return found


def _elements(data: mmap.mmap, begin: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield the identifiers of the EBML elements in a part of a file, and where the content of each begins and ends.

    Both identifier and size tell their own length by the zeros that they begin with.
    """
    while begin < end:
        after = begin + 9 - data[begin].bit_length()
        width = 9 - data[min(after, end - 1)].bit_length()
        start = after + width
        most = (1 << 7 * width) - 1
        size = int.from_bytes(data[after:start]) & most
        # a size of ones is unknown, as where a recording was streamed: all that follows
        stop = end if size == most else min(end, start + size)
        yield data[begin:after], start, stop
        begin = stop


def find_timecode(*tags: Mapping[str, str]) -> str | None:
    """Return the first timecode in the tags of a stream or a file, or None; the case of tag names is ignored."""
    return next((value for mapping in tags for key, value in mapping.items() if key.lower() == "timecode"), None)


def is_timecode(stream: Stream) -> bool:
    """Return whether a stream of data is a timecode, by its tags; FFmpeg gives no timecode that it cannot count."""
    handler = stream.metadata.get("handler_name", "").lower().replace(" ", "")
    return stream.type == "data" and ("timecode" in handler or find_timecode(stream.metadata) is not None)


def timecode_rate(path: Path) -> Fraction | None:
    """Return how many frames per second the timecode track of an MP4 or MOV counts; None if it has none."""
    header = next((content for kind, content in boxes_of(path) if kind == HEADER_BOX), b"")
    entry = TIMECODE_ENTRY.search(header)
    ticks, length = (int.from_bytes(number) for number in entry.groups()) if entry else (0, 0)
    return Fraction(ticks, length) if length else None


def timecode_at(timecode: str, old: Fraction, new: Fraction, later: int = 0) -> str | None:
    """Convert a timecode from one frame rate to another, `later` frames of the old rate after it, modulo 24 hours.

    A semicolon before the frames denotes drop-frame timecode, for 29.97 frames per second: it leaves out the first
    numbers of each minute but every tenth. Returns None for a text that is no timecode, or a rate that cannot count it.
    """
    match = TIMECODE_PATTERN.fullmatch(timecode.strip())
    before = round(old)
    after = round(new)
    if match is None or int(match[5]) >= before or after not in counted_rates[match[4] == ":"]:
        return None
    hours, minutes, seconds, frames = (int(match[group]) for group in (1, 2, 3, 5))
    minutes += 60 * hours
    dropped = 0 if match[4] == ":" else before // 15
    number = (60 * minutes + seconds) * before + frames - dropped * (minutes - minutes // 10) + later
    tens, rest = divmod(number, 600 * before - 9 * dropped)
    number += dropped * (9 * tens + max(0, rest - dropped) // (60 * before - dropped))
    seconds, frames = divmod(number, before)
    moment = f"{seconds // 3600 % 24:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    return f"{moment}{match[4]}{frames * after // before:02d}"
