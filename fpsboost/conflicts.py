"""Which options cannot be given together, and which ones need another: two tables, from which all refusals of that kind
and a section of the documentation come.

An option is named by its field, with a value where only that one counts: ``audio=False``. Uses that are no option of
their own are described.
"""

from itertools import product
from typing import NamedTuple

from fpsboost.errors import OptionError

LEAVE_ONE = "leave one of them out"
BY_ITSELF = "use it by itself, and convert its output"

USES = ("a preview", "several inputs", "`retime` that plays backwards", "`cuts` by frames", "`mask` by frames")
"""What the tables name beside options, in words."""


class Conflict(NamedTuple):
    """Options and uses, others with which each of them cannot be combined, and the reason."""

    options: tuple[str, ...]
    others: tuple[str, ...]
    reason: str
    advice: str = LEAVE_ONE
    unless: str = ""
    """Option with which they can be combined after all."""


CONFLICTS = (
    Conflict(("factor",), ("fps", "to_fps"), "both set the output rate", unless="slow_motion"),
    Conflict(("fps_num",), ("factor_num", "factor_den"), "both set the output rate"),
    Conflict(("fps",), ("keep_timing",), "one makes the rate constant, and the other keeps it variable"),
    Conflict(("retime",), ("speed",), "both set the speed"),
    Conflict(("retime", "speed"), ("slow_motion", "keep_timing", "fill_gaps"), "both set the timing"),
    Conflict(("fill_gaps",), ("keep_timing", "replace"), "`fill_gaps` makes only missing images, at a constant rate"),
    Conflict(("loop",), ("replace",), "a loop goes on beyond the frames that `replace` counts"),
    Conflict(
        ("duplicates='drop'",),
        (
            "retime",
            "speed",
            "loop",
            "fill_gaps",
            "replace",
            "vectors",
            "in_place",
            "`cuts` by frames",
            "`mask` by frames",
        ),
        "without repeats, frames have other numbers than in the clip",
        BY_ITSELF,
    ),
    Conflict(
        ("gaps",),
        (
            "retime",
            "speed",
            "loop",
            "fill_gaps",
            "replace",
            "keep_timing",
            "duplicates='drop'",
            "vectors",
            "in_place",
            "cuts",
            "start",
            "end",
        ),
        "`gaps` changes the times of the frames",
        BY_ITSELF,
    ),
    Conflict(
        ("gaps", "duplicates='drop'"),
        ("a preview",),
        "a preview reads only passages, and this needs the whole clip",
        "convert the clip, and preview that",
    ),
    Conflict(
        ("`retime` that plays backwards",),
        ("cuts", "replace", "loop", "`mask` by frames"),
        "backwards, the frames come in another order than in the clip",
    ),
    Conflict(
        ("guide",),
        ("vectors", "shutter", "mask_as='layer'", "loop", "`retime` that plays backwards", "several inputs"),
        "a guide shows frames of one clip, each as a whole and in their order",
    ),
    Conflict(("vectors",), ("retime", "speed", "shutter"), "rendered vectors exist only for frames at the usual times"),
    Conflict(("vectors",), ("loop",), "no rendered vectors lead from the last frame to the first"),
    Conflict(("vectors",), ("mask_as='layer'",), "a layer and what is behind it need vectors of their own"),
    Conflict(
        ("in_place",), ("retime", "speed"), "`in_place` makes images only at whole frame numbers, not at any time"
    ),
    Conflict(
        ("in_place",),
        ("shutter",),
        "`in_place` keeps the originals, and `shutter` blurs them",
        "write to another folder",
    ),
    Conflict(("in_place",), ("overwrite",), "`in_place` replaces nothing"),
    Conflict(("shutter",), ("confidence", "save_motion"), "the average of several frames has no map of its own"),
    Conflict(("resume",), ("confidence", "save_motion"), "frames that are finished are not computed again"),
    Conflict(("chunk",), ("in_place", "confidence", "save_motion"), "a part is written into a folder of its own"),
    Conflict(
        ("cluster",),
        ("in_place", "confidence", "save_motion", "chunk"),
        "a cluster makes parts, in folders of their own",
    ),
    Conflict(("chunk", "cluster"), ("loop",), "a loop leads from the last frame to the first", "convert it in one run"),
    Conflict(("chunk",), ("dry_run",), "a dry run estimates the whole conversion"),
    Conflict(
        ("vectors", "chunk", "confidence", "save_motion", "frames_of"),
        ("several inputs",),
        "each clip would need its own",
        "take the clips one by one",
    ),
    Conflict(("cuts", "cut_threshold"), ("no_cuts",), "both say where scenes end"),
    Conflict(("cuts",), ("cut_threshold",), "both say where scenes end"),
    Conflict(("crf", "lossless"), ("bitrate",), "both set the quality"),
    Conflict(("crf",), ("lossless",), "both set the quality"),
    Conflict(("audio_bitrate",), ("audio_codec='copy'",), "a copy keeps its bit rate"),
    Conflict(("audio=False",), ("audio_codec", "slow_motion_sound='stretch'"), "there is no sound to write"),
    Conflict(
        ("decoder='opencv'",),
        ("stream", "input_fps", "deinterlace", "size_change", "force_colours"),
        "OpenCV reads a video as it is",
    ),
    Conflict(("range",), ("start", "end"), "both select frames"),
    Conflict(("quiet",), ("progress='json'",), "`quiet` prints nothing but errors"),
)
"""Options that cannot be combined."""

NEEDS = {
    "audio_bitrate": ("audio_codec", "slow_motion_sound='stretch'"),
    "slow_motion_sound": ("slow_motion", "retime", "speed"),
    "shutter_samples": ("shutter",),
    "below": ("uncertain",),
    "mask_as": ("mask",),
    "depth": ("vectors",),
    "guide_offset": ("guide",),
    "guide='own'": ("replace",),
    "vector_convention": ("vectors",),
    "fps_den": ("fps_num",),
}
"""Options that mean nothing without another, and those of which each needs one."""


def check_together(given: set[str]) -> None:
    """Raise `OptionError` if some of these, named as in the tables, cannot be combined, or an option lacks another.

    Examples
    --------
    >>> check_together({"fps", "slow_motion"})
    >>> check_together({"range", "end"})
    Traceback (most recent call last):
    fpsboost.media.errors.OptionError: `range` and `end` cannot be combined: both select frames; leave one of them out.
    """
    if not given:
        return
    for conflict in CONFLICTS:
        for pair in product(conflict.options, conflict.others):
            if given.issuperset(pair) and conflict.unless not in given:
                both = " and ".join(map(in_sentence, pair))
                raise OptionError(f"{both} cannot be combined: {conflict.reason}; {conflict.advice}.")
    for option, others in NEEDS.items():
        if option in given and given.isdisjoint(others):
            advice = "give that too" if len(others) == 1 else "give one of them"
            raise OptionError(f"`{option}` needs {' or '.join(map(in_sentence, others))}; {advice}, or leave it out.")


def in_sentence(name: str) -> str:
    """Return an option, between backquotes, or a use, as messages have it."""
    return name if name in USES else f"`{name}`"
