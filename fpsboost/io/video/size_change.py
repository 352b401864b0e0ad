"""Convert pictures to the size, pixel format and colour coding of the first picture of their clip."""

from __future__ import annotations

import av
from av.video.reformatter import VideoReformatter

from fpsboost.io.video.damage import counted
from fpsboost.io.video.traits import VideoTraits
from fpsboost.io.video.ycc import color_space_of, from_bgr, is_full_range, reformatted, to_bgr


class FormatUnifier:
    """Converter of every picture to the properties of the first one, which counts the converted pictures.

    Parameters
    ----------
    width, height : int
        Size of the first picture, pixels.
    traits : VideoTraits
        Traits of the first picture.
    """

    def __init__(self, width: int, height: int, traits: VideoTraits) -> None:
        self._width, self._height, self._traits = width, height, traits
        self._coding = av.VideoFormat(traits.pixel_format).is_rgb, traits.color_space, traits.full_range
        self._reformatter = VideoReformatter()
        self._reshaped = self._recoded = 0
        self.first_change: str | None = None
        """First change of size or pixel format: ``from 64x48 yuv420p to 96x64 yuv420p at frame 12``."""

    def unified(self, picture: av.VideoFrame, index: int) -> av.VideoFrame:
        """Scale and convert a picture; return it unchanged if it already matches the first one.

        Parameters
        ----------
        picture : av.VideoFrame
        index : int
            Number of the picture, counted from 0.

        Raises
        ------
        ValueError
            The colour matrix of the picture is not supported.
        """
        traits = self._traits
        before = f"{self._width}x{self._height} {traits.pixel_format}"
        now = f"{picture.width}x{picture.height} {picture.format.name}"
        is_recoded = (picture.format.is_rgb, color_space_of(picture), is_full_range(picture)) != self._coding
        if now == before and not is_recoded:
            return picture
        if now != before:
            self._reshaped += 1
            self.first_change = self.first_change or f"from {before} to {now} at frame {index}"
        else:
            self._recoded += 1
        source = self._recoded_like_first(picture) if is_recoded else picture
        size = self._height, self._width
        alike = reformatted(source, self._reformatter, traits.pixel_format, traits.full_range, size=size)
        alike.pts, alike.duration, alike.time_base = picture.pts, picture.duration, picture.time_base
        alike.colorspace, alike.color_range = traits.tagged_color_space, traits.color_range
        alike.color_primaries, alike.color_trc = traits.color_primaries, traits.color_transfer
        return alike

    def remarks(self, name: str) -> list[str]:
        """Return the remarks on the converted pictures."""
        said = []
        if self._reshaped:
            said.append(f"{name} changes {self.first_change}; {_were(self._reshaped)} made like the first.")
        if self._recoded:
            said.append(f"{name} changes its colour matrix or range; {_were(self._recoded)} converted to the first's.")
        return said

    def _recoded_like_first(self, picture: av.VideoFrame) -> av.VideoFrame:
        return from_bgr(
            to_bgr(picture, self._reformatter),
            self._traits.pixel_format,
            self._traits.color_space,
            self._traits.full_range,
            chroma_location=self._traits.chroma_location,
        )


def _were(count: int) -> str:
    return f"{counted(count, 'frame')} {'was' if count == 1 else 'were'}"
