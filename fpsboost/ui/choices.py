"""The page's form as a job of the library, and as the equivalent command line."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, Self

from fpsboost import (
    Checked,
    ConversionJob,
    DecodeOptions,
    Encoding,
    OptionError,
    Remark,
    RunOptions,
    Timing,
    Trim,
    find_method,
    format_time,
)
from fpsboost.cli.batch import check_ending
from fpsboost.cli.flags import in_flags
from fpsboost.cli.options import MethodOptions, command_line
from fpsboost.extension import encoders, prepared
from fpsboost.ui.files import Files

LABELS = {
    "overwrite": "a tick at “Replace it if it exists”",
    "no-audio": "“Keep the sound” cleared",
    "no-subtitles": "“Keep the subtitles” cleared",
    "factor": "“Times as many frames”",
    "fps": "“Frames a second”",
    "slow-motion": "“Slow motion”",
    "method": "“Method”",
    "input-fps": "“Frame rate of the images”",
    "retime": "“Speed ramp”",
    "start": "“From”",
    "end": "“to”",
    "codec": "“Format”",
    "crf": "constant rate factor (as by “Smaller file”)",
    "lossless": "“Without loss”",
    "streams": "“Streams to keep”",
    "resume": "“Try again”",
    "loop": "“A loop”",
}
"""What messages call the options that the page has, by their flags."""

FLAG = re.compile(r"(?<![\w-])--([a-z-]+)")

CRF_STEPS = {"usual": 0, "smaller": 6, "higher": -4, "lossless": 0}
"""Difference from the usual constant rate factor by quality; 6 is about half of the size."""


def on_page(sentence: str) -> str:
    """Return a message of the library or the command line in the terms of the page."""
    text = in_flags(sentence)
    others = set(FLAG.findall(text)) - LABELS.keys()
    text = FLAG.sub(lambda flag: LABELS.get(flag[1], flag[0]), text)
    return f"{text} What begins with -- is for a command line." if others else text


def remarks_on_page(remarks: Iterable[Remark], *paths: str) -> list[str]:
    """Return remarks in the terms of the page, with paths reduced to names."""
    for path in paths:
        remarks = [remark.about(path, Path(path).name) for remark in remarks]
    return [on_page(remark) for remark in remarks]


@dataclass(frozen=True)
class Choices(Checked):
    """Fields of the page's form, as text.

    Parameters
    ----------
    input, folder, name : str
        Path of the clip, and folder and name of the output.
    rate : {'factor', 'fps', 'slow', 'retime'}
        Meaning of `value`.
    value : str
        Factor, frame rate, factor of slow motion, or points of a speed ramp.
    loop : bool
        The last frame leads to the first.
    method : str
        Name of the method.
    start, end : str
        Positions of a part, empty for all of the clip.
    codec : str
        Video codec; empty for the usual one of the output's type.
    quality : {'usual', 'smaller', 'higher', 'lossless'}
        Constant rate factor relative to the codec's usual one.
    sound, subtitles : bool
        Keep the streams of this kind.
    streams : str
        Numbers of the streams to keep; empty for all.
    overwrite : bool
        Replace an existing output.
    input_fps : str
        Frame rate of images.
    """

    input: str
    folder: str
    name: str
    rate: Literal["factor", "fps", "slow", "retime"] = "factor"
    value: str = "2"
    loop: bool = False
    method: str = "nlm"
    start: str = ""
    end: str = ""
    codec: str = ""
    quality: Literal["usual", "smaller", "higher", "lossless"] = "usual"
    sound: bool = True
    subtitles: bool = True
    streams: str = ""
    overwrite: bool = False
    input_fps: str = ""

    @classmethod
    def of(cls, data: object) -> Self:
        """Return the form from the data of a request; raises `OptionError` for invalid data."""
        given: Any = data if isinstance(data, dict) else {}
        return cls(**{field.name: given.get(field.name) for field in fields(cls)})

    def job(self, files: Files) -> ConversionJob:
        """Return the conversion that the form describes.

        Raises `InputError`, `OutputError` or `OptionError` for a clip that was not picked, a place that must not be
        written, or a value that cannot be read.
        """
        files.check_picked(self.input)
        output = files.output(self.folder, self.name)
        check_ending(self.input, output)
        name = self.rate if self.rate in ("fps", "retime") else "factor"
        if name == "retime" and "=" not in self.value:  # the name of a file, for a command line
            raise OptionError("A speed ramp is at least two points, such as 0=0 4s=2s.")
        value: Any = {name: self.value}
        timing = Timing(**value, slow_motion=self.rate == "slow", loop=self.loop)
        ends: Any = {"start": self.start or None, "end": self.end or None}
        decoding = DecodeOptions(Trim(**ends), input_fps=self.input_fps or None)
        return ConversionJob(self.input, output, timing, find_method(self.method), decoding, self.encoding)

    @property
    def encoding(self) -> Encoding:
        """Options of the encoding."""
        texts: Any = {"codec": self.codec or None, "streams": self.streams or None}
        encoding = Encoding(**texts, lossless=self.quality == "lossless", audio=self.sound, subtitles=self.subtitles)
        codec = self.codec or ("vp9" if self.name.lower().endswith(".webm") else "h264")
        if not CRF_STEPS[self.quality] or codec not in encoders:  # an unknown codec is refused by the conversion
            return encoding
        return replace(encoding, crf=encoders[codec].crf + CRF_STEPS[self.quality])

    def words(self, job: ConversionJob) -> list[str]:
        """Return the words of the equivalent command line."""
        method = MethodOptions(self.method)
        run = RunOptions(overwrite=self.overwrite)
        return command_line(job.input, job.output or "", job.timing, method, job.decoding, job.encoding, run)

    def check(self, job: ConversionJob) -> dict[str, Any]:
        """Return the properties of the output as plain data, without running the conversion."""
        with prepared(job, RunOptions(overwrite=self.overwrite)) as ready:
            remarks = ready.expected_losses()[1]
            frames = ready.output.expected_frames
            rate = ready.output.timing.rate
        has_rate = ready.target.has_rate
        return {
            "frames": frames,
            "rate": float(rate) if has_rate else None,
            "length": format_time(frames / rate) if has_rate and frames else "",
            "remarks": remarks_on_page(remarks, self.input, ready.output.path),
        }


def first_choices(path: str) -> Choices:
    """Return the initial values of the form for a clip."""
    output = ConversionJob(path, None, Timing(), find_method("nlm")).target(RunOptions()).path
    name = Path(output).name
    return Choices(path, str(Path(path).parent), f"{name}/" if output.endswith("/") else name)
