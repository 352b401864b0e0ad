"""Remarks: sentences to the user on what was lost, damaged or assumed, with their kind and values as data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, Self

TEXTS = {
    # what was read
    "damaged": "{name} is damaged: {parts}; {frames} could be read.",
    "frames-out-of-order": "{name} shows {count} no later than the one before; {left} out.",
    "frames-moved-later": "{name} gives {count} no later time than the one before; {put} into the gap that follows.",
    "frames-moved-back": "{name} gives {count} a time far ahead of the next; {put} back between its neighbours.",
    "times-jump-back": (
        "The times of {name} jump back at {count}; the pictures go on from there, but sound and subtitles may not."
    ),
    "clock-jumps": (
        "The clock of {name} jumps at {count}, as where recordings were joined; pictures, sound and subtitles go on "
        "from there."
    ),
    "frames-without-time": "{name} gives no time for {count}; the nominal rate {was} used.",
    "ends-early": (
        "{name} ends after {reached:.1f} s of the {promised:.1f} s its header promises; {frames} could be read."
    ),
    "read-from-beginning": "{name} {was} read from its beginning, because {reason}.",
    "cropped": "{name} shows {shown} of its {coded} pixels and {was} cropped to that.",
    "videos-left-out": "{name} has more than one video stream; stream {chosen} {was} taken, left out: {others}.",
    "ordered-chapters": (
        "{name} has ordered chapters, which players may show in another order; frames {were} taken as they lie in it."
    ),
    "rate-assumed": "{name} does not say its frame rate; {rate} frames per second {were} assumed{advice}.",
    "colours-wrong": "{name} is Dolby Vision whose colours {were} taken for ordinary ones: wrong.",
    "interlaced": (
        "{name} is interlaced{which} and its fields {were} taken as whole pictures; {advice} for smooth motion."
    ),
    "hardly-interlaced": "{name} flags {which} as interlaced; every frame {was} made into two all the same.",
    "size-changes": "{name} changes {change}; {count} frames {were} made like the first.",
    "size-changes-once": "{name} changes {change}; 1 frame {was} made like the first.",
    "coding-changes": (
        "{name} changes its colour matrix or range {change}; {count} frames {were} converted to the first's."
    ),
    "coding-changes-once": (
        "{name} changes its colour matrix or range {change}; 1 frame {was} converted to the first's."
    ),
    "colours-change": "{name} changes its colours {change}; {frames} {kept} the numbers they have.",
    "sound-damaged": (
        "{source} is damaged: {packets} of sound in stream {stream} could not be decoded, where {name} is silent; "
        "listen to it."
    ),
    "other-streams-damaged": (
        "{source} is damaged where sound, subtitles or data lie, so some may be missing in {name}; listen to it."
    ),
    "packets-out-of-order": "{source} has sound or subtitle packets out of order, which {were} left out.",
    # what the target does not hold, or holds otherwise; `lost_stream` is the number of a stream that it lacks
    "alpha-left-out": (
        "{name} has an alpha channel, which {was} left out; a .webm, images as .png, or `codec='prores_ks'` in a .mov "
        "keep it."
    ),
    "beside-left-out": "{name} has {what}, which {target} cannot hold; {left} out.",
    "shape-lost-in-images": "{name} has pixels of the shape {shape}, which images cannot say; they come out unscaled.",
    "shape-lost": (
        "{name} {lost} the pixel shape {shape} of its source, which {encoder} cannot say in this container; write an "
        ".mp4 or .mov to keep it."
    ),
    "side-data-lost": "{name} {lost} the {what} of its source.",
    "stereo-mode-in-stream": (
        "{name} {has} the stereo mode of its source in its H.264 stream, where not every player looks; an .mkv also "
        "has it in its container."
    ),
    "rare-format": "{name} {was} written as {format}, as asked for, which few players show.",
    "odd-size": (
        "{name} has the odd size {width}x{height} and {was} written as {format}, which few players show; write a "
        ".webm, or crop to an even size."
    ),
    "depth-or-colour-lost": (
        "{name} {has} less {what} than its source: {encoder} {wrote} {format} for {source}{advice}."
    ),
    "tags-lost": "{name} {lost} tags of its source, which its container has no place for: {tags}.",
    "chapters-lost": "{name} {lost} the chapters of its source, which its kind of sound rules out here.",
    "chapter-parts-lost": "{name} {lost} the parts of its source's chapters that FFmpeg cannot read: {parts}.",
    "timecode-lost": "{name} {lost} the timecode {timecode} of its source, which its {cause} cannot count.",
    "timecode-stream-lost": (
        "{name} {lost} the timecode of stream {lost_stream} of its source, which its rate cannot count."
    ),
    "labels-lost": "{name} {lost} {labels} of stream {stream} of its source.",
    "lines-lost": "{name} {lost} lines of stream {stream} of its source, where more are shown than a text can hold.",
    "stream-misfits": "{cause}; stream {lost_stream} {was} left out{way}.",
    "stream-not-held": "{name} {does} not hold {what} of its source; {way}.",
    "stream-not-reversible": "{name} {lost} stream {lost_stream} ({what}) of its source, which cannot play backwards.",
    "subtitles-converted": (
        "{name} {holds} stream {stream} ({codec} subtitles) of its source as {format}; styles may differ."
    ),
    "sound-encoded-anew": "{name} {holds} stream {stream} ({codec} sound) of its source {encoded}.",
    # the output of an earlier run, and what a run that ends early leaves for a later one
    "begun-anew": (
        "{name} {was} begun anew, and what an earlier run had finished {was} thrown away; `resume` goes on with it."
    ),
    "frames-finished": "{finished}{of_all} frames are finished, and `resume` goes on from there.",
    "without-locks": "{name} lies on a disk without locks; never let two runs write it at once.",
    # sentences of other sources and sinks
    "other": "{sentence}",
}
"""Sentences by the kind of the remark, with names of values in braces, and so the verbs of what a run did."""

WOULD = {
    "was": "would be",
    "were": "would be",
    "left": "would be left",
    "put": "would be put",
    "lost": "would lose",
    "holds": "would hold",
    "does": "would",
    "has": "would have",
    "wrote": "would write",
    "kept": "would keep",
    "held": "would hold",
}
"""These verbs, and what they become before the run."""

TENSES = {"did": {verb: verb for verb in WOULD}, "would": WOULD}
"""Verbs by the tense of a remark: after the run, or before it."""


class Remark(str):
    """Sentence to the user on what a run lost, found damaged or assumed, as text and as data.

    It is a string, so that it is passed on, compared and printed as one; programs go by its kind and its values.

    Attributes
    ----------
    kind : str
        What is said, in words with hyphens, such as ``stream-not-held``.
    template : str
        The sentence, with the names of values in braces.
    values : Mapping
        What it is about, by name: ``name`` is the file, ``lost_stream`` the number of a stream that is left out.
    tense : {'did', 'would'}
        Whether it says what the run did, or what it would do.

    Examples
    --------
    >>> remark = Remark("stream-lost", "{name} {lost} stream {lost_stream}.", {"name": "out.mp4", "lost_stream": 2})
    >>> remark, remark.expected
    ('out.mp4 lost stream 2.', 'out.mp4 would lose stream 2.')
    >>> remark.kind, remark.values["lost_stream"]
    ('stream-lost', 2)
    """

    kind: str
    template: str
    values: Mapping[str, object]
    tense: str

    def __new__(cls, kind: str, template: str, values: Mapping[str, object], tense: str = "did") -> Remark:
        remark = super().__new__(cls, template.format(**TENSES[tense], **values))
        remark.kind = kind
        remark.template = template
        remark.values = values
        remark.tense = tense
        return remark

    def __getnewargs__(self) -> Any:
        return self.kind, self.template, self.values, self.tense

    @property
    def data(self) -> dict[str, object]:
        """The sentence, and what it is made of, as an object for JSON."""
        return {"kind": self.kind, "sentence": str(self), "values": self.values, "tense": self.tense}

    @property
    def expected(self) -> Remark:
        """What is said before the run: what it would lose or assume."""
        return Remark(self.kind, self.template, self.values, "would")

    def about(self, name: str, other: str) -> Remark:
        """Return the remark with another name in place of a file's."""
        values = {key: other if value == name else value for key, value in self.values.items()}
        return Remark(self.kind, self.template, values, self.tense)


class Remarks(list[Remark]):
    """Remarks in the order in which they came up, each once."""

    texts: ClassVar = TEXTS
    """Sentences by kind."""

    def __init__(self, others: Iterable[str] = ()) -> None:
        super().__init__()
        self.take(others)

    def add(self, kind: str, **values: object) -> None:
        """Add the remark of a kind and values, unless it is there."""
        self.take([Remark(kind, self.texts[kind], values)])

    @property
    def expected(self) -> Self:
        """What is said of them before the run."""
        return type(self)(each.expected for each in self)

    @classmethod
    def from_json(cls, objects: Iterable[dict[str, Any]]) -> Self:
        """Return the remarks of which these are the `Remark.data`."""
        return cls(Remark(each["kind"], cls.texts[each["kind"]], each["values"], each["tense"]) for each in objects)

    def take(self, others: Iterable[str]) -> None:
        """Add those remarks that are not there; plain sentences, as of others' sources, get the kind ``other``."""
        for each in others:
            if each not in self:
                self.append(each if isinstance(each, Remark) else Remark("other", "{sentence}", {"sentence": each}))


@dataclass
class Damage:
    """Counts of the errors found while a video is read."""

    undecodable: int = 0  # packets
    unreadable: int = 0  # places of the file
    corrupt: int = 0  # frames that decoded with errors
    misplaced: int = 0  # frames no later than the one before that were left out
    displaced: int = 0  # such frames that were moved into the gap that follows
    far_ahead: int = 0  # frames far ahead of the next one, which were moved back before it
    jumps: int = 0  # places where the times of the video stream jump back
    joints: int = 0  # places where the clock of the whole file jumps
    untimed: int = 0  # frames

    def remarks(self, name: str, frames: int) -> Remarks:
        """Return the remarks on all faults of a file, of which so many frames could be read."""
        remarks = Remarks()
        losses = (
            (self.undecodable, "packet", "could not be decoded"),
            (self.unreadable, "place", "could not be read"),
            (self.corrupt, "frame", "decoded with errors"),
        )
        parts = " and ".join(f"{counted(count, what)} {how}" for count, what, how in losses if count)
        if parts:
            remarks.add("damaged", name=name, parts=parts, frames=counted(frames, "frame"))
        for kind, count, what in (
            ("frames-out-of-order", self.misplaced, "frame"),
            ("frames-moved-later", self.displaced, "frame"),
            ("frames-moved-back", self.far_ahead, "frame"),
            ("times-jump-back", self.jumps, "place"),
            ("clock-jumps", self.joints, "place"),
            ("frames-without-time", self.untimed, "frame"),
        ):
            if count:
                remarks.add(kind, name=name, count=counted(count, what))
        return remarks


def counted(count: int, what: str) -> str:
    """Return a count with its noun: ``1 frame``, ``2 frames``."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def encrypted_sentence(name: str, begin: Fraction = Fraction(0)) -> str:
    """Return the sentence that a video is encrypted from a time on, seconds."""
    if begin <= 0:
        return f"{name} is encrypted (DRM) and cannot be decoded; name a copy that is not."
    end = f"{math.floor(begin * 1000) / 1000:.3f}".rstrip("0").rstrip(".")
    return f"{name} is encrypted (DRM) from {end} s on; `end={end}` converts what is before."


def encrypted_stream_sentence(name: str, kind: str, index: int) -> str:
    """Return the sentence that another stream than the video is encrypted."""
    advice = {"audio": "leave it out with `audio=False`", "subtitle": "leave it out with `subtitles=False`"}
    return f"{name} has encrypted {kind} (DRM) in stream {index}; {advice.get(kind, 'take a copy without it')}."


def dolby_vision_sentence(name: str) -> str:
    """Return why Dolby Vision without an ordinary base layer is refused."""
    return (
        f"{name} is Dolby Vision whose colours only its own decoders know (profile 5 or a like one); convert it to "
        "HDR10 first, or pass `force_colours=True` to take them for ordinary ones, which turns them green and purple."
    )
