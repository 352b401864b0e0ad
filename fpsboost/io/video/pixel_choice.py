"""Which pixel format pictures are encoded in, and what of them it does not hold.

A video keeps its own format where the encoder has it, and else gets the one that loses least. Images of 8 bits become
4:2:0, which every player shows. Where losing nothing was asked for, and where images are deeper than 8 bits and a codec
was named, the format is the deepest and finest that the encoder has.
"""

from __future__ import annotations

import re

import av
from av.codec.codec import PixFmtLoss, find_best_pix_fmt_of_list

from fpsboost.errors import OptionError, OutputError
from fpsboost.frame import ClipInfo
from fpsboost.io.video.encoding import Encoding, depth_of, encoders, encodes_alpha, pixel_formats
from fpsboost.io.video.ycc import has_alpha, is_gray

BITS_OF_A_MATRIX = 2
"""Bits by which YCbCr must be deeper than RGB so that rounding to it and back gives every value back."""

NOT_SAMPLES = re.compile(r"^(pal8|mono|bayer)|f(16|32)(le|be)$|^rgb555|^bgr555|^rgb565")
"""Formats that no pictures are converted to here: palettes, single bits, sensors' mosaics, floats, unequal channels."""


def choose_pixel_format(
    encoder: str, encoding: Encoding, container: str, source: str, info: ClipInfo, name: str, *, of_images: bool
) -> tuple[str, list[str]]:
    """Choose the pixel format to encode, and say what it loses.

    Parameters
    ----------
    encoder : str
        FFmpeg's name.
    encoding : Encoding
        What was asked for.
    container : str
        FFmpeg's name.
    source : str
        Pixel format of the source.
    info : ClipInfo
        Size of the frames.
    name : str
        What messages call the output.
    of_images : bool
        The source is images, or an animation.

    Returns
    -------
    str, list of str
        FFmpeg's name of the format, and sentences about what is lost.

    Raises
    ------
    OptionError
        The format that was asked for halves an odd size.
    OutputError
        The encoder has none for the source.
    """
    codec = av.Codec(encoder, "w")
    offered = pixel_formats(codec)
    wanted = encoding.pixel_format or source
    if not offered:
        return wanted, []
    whole_only = any(e.name == encoder and e.needs_whole_chroma for e in encoders.values())
    fitting = [each for each in offered if not whole_only or _divides(each, info.width, info.height)]
    if encoding.pixel_format:
        if wanted not in fitting:
            raise OptionError(
                f"--pix-fmt {wanted} halves an odd size, which {encoder} cannot do for {name} at "
                f"{info.width}x{info.height}; use yuv444p, or crop to an even size."
            )
        return wanted, []
    is_deep = depth_of(source) > 8
    keeps_all = encoding.lossless or (codec.lossless and not codec.lossy)
    if of_images and not keeps_all and not (is_deep and encoding.codec):
        wanted = ("yuva420p" if has_alpha(source) else "yuv420p") + ("10le" if is_deep else "")
    if wanted in fitting:
        return wanted, _said(name, encoder, wanted, source, exact=keeps_all) if of_images and is_deep else []
    keeps_alpha = encodes_alpha(encoding, container) and has_alpha(wanted)
    fitting = [each for each in fitting if has_alpha(each) or not keeps_alpha] or fitting
    if keeps_all or (of_images and is_deep):
        found = _deepest(fitting, wanted, exact=keeps_all)
        return found, _said(name, encoder, found, source, exact=keeps_all)
    best, loss = find_best_pix_fmt_of_list(fitting, wanted, has_alpha=keeps_alpha)
    if best is None:
        raise OutputError(f"{name} cannot hold {wanted} with {encoder}; choose another --codec.")
    remark = ""
    plain = wanted.replace("yuvj", "yuv")
    lost = [word for flag, word in _losses if loss & flag][:1]
    if wanted in offered or plain in offered:
        remark = "" if best.name == plain else _odd_size(name, info, best.name)
    elif whole_only and av.VideoFormat(wanted).is_rgb and _chroma_of(best) == 1:
        remark = (
            f"{name} was written as {best.name} to keep the colours of its source, which few players show; --pix-fmt "
            "yuv420p makes what all show."
        )
    elif lost:
        remark = _less(name, lost, encoder, best.name, wanted)
    return best.name, [remark] if remark else []


_losses = (
    (PixFmtLoss.DEPTH, "depth"),
    (PixFmtLoss.CHROMA | PixFmtLoss.RESOLUTION, "colour resolution"),
)


def _deepest(offered: list[str], wanted: str, *, exact: bool) -> str:
    """The format that holds most of another: its colours, its chroma, its depth.

    Among equals the one that is most like it where it is to come back exactly; else YCbCr, in which encoders lose less.
    """
    source = av.VideoFormat(wanted)
    offered = [each for each in offered if not NOT_SAMPLES.search(each)] or offered

    def worth(name: str) -> tuple[float, ...]:
        target = av.VideoFormat(name)
        return (
            is_gray(source) or not is_gray(target),
            min(_chroma_of(target), _chroma_of(source)),
            min(_bits_held(name, wanted, exact=exact), depth_of(wanted)),
            target.is_rgb == (source.is_rgb and exact) and is_gray(target) == is_gray(source),
            has_alpha(name) == has_alpha(wanted),
            -depth_of(name),
            target.is_planar,
        )

    return max(offered, key=worth)


def _said(name: str, encoder: str, found: str, source: str, *, exact: bool) -> list[str]:
    """What to say of depth and chroma that a format does not hold."""
    finer = _chroma_of(av.VideoFormat(source)) > _chroma_of(av.VideoFormat(found))
    deeper = _bits_held(found, source, exact=exact) < depth_of(source)
    lost = ["depth"] * deeper + ["colour resolution"] * finer
    if not lost:
        return []
    sentence = _less(name, lost, encoder, found, source).removesuffix(".")
    return [f"{sentence}; --codec ffv1 in an .mkv keeps up to 16 bits of every colour."]


def _less(name: str, lost: list[str], encoder: str, found: str, source: str) -> str:
    return f"{name} has less {' and '.join(lost)} than its source: {encoder} wrote {found} for {source}."


def _odd_size(name: str, info: ClipInfo, found: str) -> str:
    return (
        f"{name} has the odd size {info.width}x{info.height} and was written as {found}, which few players show; write "
        "a .webm, or crop to an even size."
    )


def _bits_held(name: str, source: str, *, exact: bool) -> int:
    """Bits of a format's samples, or, where they are to come back exactly, of the source's that do."""
    target = av.VideoFormat(name)
    through_matrix = exact and not (target.is_rgb or is_gray(target)) and av.VideoFormat(source).is_rgb
    return depth_of(name) - BITS_OF_A_MATRIX * through_matrix


def _chroma_of(format: av.VideoFormat) -> float:
    """Samples of colour for each pixel."""
    if is_gray(format):
        return 0
    if format.is_rgb:
        return 1
    layout = av.VideoFormat(format.name, 16, 16)
    return layout.chroma_width() * layout.chroma_height() / 256


def _divides(pixel_format: str, width: int, height: int) -> bool:
    """Whether chroma planes come out whole."""
    layout = av.VideoFormat(pixel_format, 16, 16)
    across, down = 16 // max(1, layout.chroma_width()), 16 // max(1, layout.chroma_height())
    return width % across == 0 and height % down == 0
