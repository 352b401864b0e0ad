"""Choose the pixel format that pictures are encoded in, and report what it does not hold.

A video keeps its pixel format if the encoder supports it, and otherwise gets the one that loses least. 8-bit images
become 4:2:0, which every player shows. For lossless encoding, and for images deeper than 8 bits with a codec given, the
format with the greatest bit depth and chroma resolution of the source that the encoder supports is chosen.
"""

from __future__ import annotations

import re

import av
from av.codec.codec import PixFmtLoss, find_best_pix_fmt_of_list

from fpsboost.errors import OptionError, OutputError
from fpsboost.frame import ClipInfo
from fpsboost.io.video.encode_options import Encoding
from fpsboost.io.video.encoding import depth_of, encoders, encodes_alpha, pixel_formats
from fpsboost.io.video.ycc import has_alpha, is_gray

YCBCR_EXTRA_BITS = 2  # additional bits that YCbCr needs for a lossless round trip of integer RGB values

EXCLUDED_FORMATS = re.compile(r"^(pal8|mono|bayer)|f(16|32)(le|be)$|^rgb555|^bgr555|^rgb565")
"""Pixel formats excluded as targets: palette, monochrome 1-bit, Bayer, float, and unequal channel depths."""


def choose_pixel_format(
    encoder: str, encoding: Encoding, container: str, source: str, info: ClipInfo, name: str, *, of_images: bool
) -> tuple[str, list[str]]:
    """Return the pixel format to encode, and remarks on what it loses of the `source`, which may be `of_images`."""
    codec = av.Codec(encoder, "w")
    offered = pixel_formats(codec)
    wanted = encoding.pixel_format or source
    if not offered:
        return wanted, []
    whole_only = any(entry.name == encoder and entry.needs_whole_chroma for entry in encoders.values())
    fitting = [name for name in offered if not whole_only or _divides(name, info.width, info.height)]
    if encoding.pixel_format:
        if wanted not in fitting:
            raise OptionError(
                f"`pixel_format={wanted!r}` halves an odd size, which {encoder} cannot do for {name} at "
                f"{info.width}x{info.height}; use yuv444p, or crop to an even size."
            )
        return wanted, []
    is_deep = depth_of(source) > 8
    keeps_all = encoding.lossless or (codec.lossless and not codec.lossy)
    if of_images and not keeps_all and not (is_deep and encoding.codec):
        alpha = has_alpha(source) and encodes_alpha(encoding, container)
        wanted = ("yuva420p" if alpha else "yuv420p") + ("10le" if is_deep else "")
    if wanted in fitting:
        return wanted, _loss_remarks(name, encoder, wanted, source, exact=keeps_all) if of_images and is_deep else []
    keeps_alpha = encodes_alpha(encoding, container) and has_alpha(wanted)
    fitting = [name for name in fitting if has_alpha(name) or not keeps_alpha] or fitting
    if keeps_all or (of_images and is_deep):
        deepest = _deepest(fitting, wanted, exact=keeps_all)
        return deepest, _loss_remarks(name, encoder, deepest, source, exact=keeps_all)
    best, loss = find_best_pix_fmt_of_list(fitting, wanted, has_alpha=keeps_alpha)
    if best is None:
        raise OutputError(f"{name} cannot hold {wanted} with {encoder}; choose another `codec`.")
    plain = wanted.replace("yuvj", "yuv")
    lost = [word for flag, word in losses.items() if loss & flag][:1]
    remarks = []
    if best.name != plain and {wanted, plain}.intersection(offered):
        remarks.append(
            f"{name} has the odd size {info.width}x{info.height} and was written as {best.name}, which few players "
            "show; write a .webm, or crop to an even size."
        )
    elif whole_only and av.VideoFormat(wanted).is_rgb and _chroma_of(best) == 1:
        remarks.append(
            f"{name} was written as {best.name} to keep the colours of its source, which few players show; "
            "`pixel_format='yuv420p'` makes what all show."
        )
    elif lost and best.name != plain:
        remarks.append(f"{_loss_sentence(name, lost, encoder, best.name, wanted)}.")
    return best.name, remarks


losses = {PixFmtLoss.DEPTH: "depth", PixFmtLoss.CHROMA | PixFmtLoss.RESOLUTION: "colour resolution"}
"""Words for what FFmpeg says is lost between two pixel formats."""


def _deepest(offered: list[str], wanted: str, *, exact: bool) -> str:
    """Return the format that holds most of another one: colour first, then chroma resolution, then bit depth.

    Ties go to the more similar format if `exact`, else to YCbCr, in which encoders lose less.
    """
    source = av.VideoFormat(wanted)
    offered = [name for name in offered if not EXCLUDED_FORMATS.search(name)] or offered

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


def _loss_remarks(name: str, encoder: str, chosen: str, source: str, *, exact: bool) -> list[str]:
    finer = _chroma_of(av.VideoFormat(source)) > _chroma_of(av.VideoFormat(chosen))
    deeper = _bits_held(chosen, source, exact=exact) < depth_of(source)
    if not finer and not deeper:
        return []
    lost = _loss_sentence(name, ["depth"] * deeper + ["colour resolution"] * finer, encoder, chosen, source)
    return [f"{lost}; `codec='ffv1'` in an .mkv keeps up to 16 bits of every colour."]


def _loss_sentence(name: str, lost: list[str], encoder: str, chosen: str, source: str) -> str:
    return f"{name} has less {' and '.join(lost)} than its source: {encoder} wrote {chosen} for {source}"


def _bits_held(name: str, source: str, *, exact: bool) -> int:
    """Return the bits per sample of a format or, if `exact`, the bits of the source's samples that it preserves."""
    target = av.VideoFormat(name)
    through_matrix = exact and not (target.is_rgb or is_gray(target)) and av.VideoFormat(source).is_rgb
    return depth_of(name) - YCBCR_EXTRA_BITS * through_matrix


def _chroma_of(format: av.VideoFormat) -> float:
    """Return the samples of chroma per pixel: 1 in RGB and 4:4:4, 0 in gray."""
    if is_gray(format):
        return 0
    layout = av.VideoFormat(format.name, 16, 16)
    return layout.chroma_width() * layout.chroma_height() / 256


def _divides(pixel_format: str, width: int, height: int) -> bool:
    layout = av.VideoFormat(pixel_format, 16, 16)
    across, down = 16 // max(1, layout.chroma_width()), 16 // max(1, layout.chroma_height())
    return width % across == 0 and height % down == 0
