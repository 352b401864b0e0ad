"""The pixel format of an output: that of its source, or the one of the encoder's that suits it best."""

import re

from av import Codec, VideoFormat
from av.codec.codec import PixFmtLoss, find_best_pix_fmt_of_list

from fpsboost.media.encoding import depth_of, encoder_of, encoders, encodes_alpha, is_lossless, pixel_formats
from fpsboost.media.errors import OptionError, OutputError
from fpsboost.media.output import Output
from fpsboost.media.pixels import has_alpha, is_gray, is_rgb
from fpsboost.media.remarks import Remarks

YCBCR_EXTRA_BITS = 2  # additional bits that YCbCr needs for a lossless round trip of integer RGB values


EXCLUDED_FORMATS = re.compile(r"^(pal8|mono|bayer)|f(16|32)(le|be)$|^rgb555|^bgr555|^rgb565")
"""Pixel formats excluded as targets: palette, monochrome 1-bit, Bayer, float, and unequal channel depths."""


def choose_pixel_format(remarks: Remarks, output: Output, encoder: str, source: str) -> str:
    """Return the name of the pixel format to encode, and add remarks on losses.

    Parameters
    ----------
    remarks : Remarks
        Remarks to add to.
    output : Output
        Output with the options of the user, of which a pixel format is taken or refused, not replaced. Images become
        4:2:0 unless lossless or deep, and RGB video unless lossless.
    encoder : str
        FFmpeg's encoder.
    source : str
        Pixel format of the source.

    Raises
    ------
    OptionError
        The pixel format asked for needs an even size.
    OutputError
        The encoder has no pixel format that FFmpeg can convert to.
    """
    codec = Codec(encoder, "w")
    encoding = output.encoding
    offered = pixel_formats(codec)
    if not offered:
        return encoding.pixel_format or source
    fitting = offered
    if encoder_of(encoder).needs_whole_chroma:
        fitting = [each for each in offered if _divides(each, output.info.width, output.info.height)]
    if encoding.pixel_format:
        _check_asked(remarks, output, encoder, fitting, encoding.pixel_format)
        return encoding.pixel_format
    of_images = output.stream.traits is None
    is_deep_image = of_images and depth_of(source) > 8
    is_rgb_video = not of_images and is_rgb(source) and "yuv420p" in offered
    keeps_all = encoding.lossless or is_lossless(encoder)
    wanted = source
    if not keeps_all and (is_rgb_video or (of_images and not (is_deep_image and encoding.codec))):
        alpha = has_alpha(source) and encodes_alpha(encoding, output.container)
        wanted = ("yuva420p" if alpha else "yuv420p") + ("10le" if depth_of(source) > 8 else "")
    if wanted in fitting:
        if is_rgb_video or is_deep_image:
            _compare(remarks, output, encoder, wanted, source, exact=keeps_all)
        return wanted
    keeps_alpha = has_alpha(wanted) and encodes_alpha(encoding, output.container)
    fitting = [each for each in fitting if has_alpha(each) or not keeps_alpha] or fitting
    if keeps_all or is_deep_image:
        deepest = _deepest(fitting, wanted, exact=keeps_all)
        _compare(remarks, output, encoder, deepest, source, exact=keeps_all)
        return deepest
    best, loss = find_best_pix_fmt_of_list(fitting, wanted, has_alpha=keeps_alpha)
    if best is None:
        raise OutputError(f"{output.path} cannot hold {wanted} with {encoder}; choose another `codec`.")
    plain = wanted.replace("yuvj", "yuv")
    lost = [word for flag, word in losses.items() if loss & flag]
    if best.name != plain and {wanted, plain}.intersection(offered):
        remarks.add("odd-size", name=output.path, format=best.name, width=output.info.width, height=output.info.height)
    elif best.name != plain and lost:
        _remark_on_loss(remarks, output, encoder, best.name, wanted, lost[0])
    return best.name


def _check_asked(remarks: Remarks, output: Output, encoder: str, fitting: list[str], asked: str) -> None:
    """Raise `OptionError` unless a pixel format that was asked for suits the size; remark on a rare one."""
    if asked not in fitting:
        raise OptionError(
            f"`pixel_format={asked!r}` halves an odd size, which {encoder} cannot do for {output.path} at "
            f"{output.info.width}x{output.info.height}; use yuv444p, or crop to an even size."
        )
    if encoder_of(encoder) in encoders.values() and not output.encoding.lossless and _chroma_of(asked) == 1:
        remarks.add("rare-format", name=output.path, format=asked)


losses = {PixFmtLoss.DEPTH: "depth", PixFmtLoss.CHROMA | PixFmtLoss.RESOLUTION: "colour resolution"}
"""Words in remarks for FFmpeg's flags of losses between two pixel formats."""


def _deepest(offered: list[str], wanted: str, *, exact: bool) -> str:
    """Return the format that holds most of another one: colour first, then chroma resolution, then bit depth.

    Ties go to the more similar format if `exact`, else to YCbCr, in which encoders lose less.
    """
    source = VideoFormat(wanted)
    offered = [name for name in offered if not EXCLUDED_FORMATS.search(name)] or offered

    def worth(name: str) -> tuple[float, ...]:
        target = VideoFormat(name)
        return (
            is_gray(source) or not is_gray(target),
            min(_chroma_of(name), _chroma_of(wanted)),
            min(_bits_held(name, wanted, exact=exact), depth_of(wanted)),
            target.is_rgb == (source.is_rgb and exact) and is_gray(target) == is_gray(source),
            has_alpha(name) == has_alpha(wanted),
            -depth_of(name),
            target.is_planar,
        )

    return max(offered, key=worth)


def _compare(remarks: Remarks, output: Output, encoder: str, chosen: str, source: str, *, exact: bool) -> None:
    """Add a remark on depth and colour resolution that the chosen format lacks, if it lacks any."""
    lost = ["depth"] if _bits_held(chosen, source, exact=exact) < depth_of(source) else []
    if _chroma_of(source) > _chroma_of(chosen):
        lost.append("colour resolution")
    if lost:
        advice = "; `codec='ffv1'` in an .mkv keeps up to 16 bits of every colour"
        _remark_on_loss(remarks, output, encoder, chosen, source, " and ".join(lost), advice)


def _remark_on_loss(
    remarks: Remarks, output: Output, encoder: str, chosen: str, source: str, what: str, advice: str = ""
) -> None:
    """Add a remark on what a format lacks of another one."""
    name = output.path
    remarks.add(
        "depth-or-colour-lost", name=name, encoder=encoder, format=chosen, source=source, what=what, advice=advice
    )


def _bits_held(name: str, source: str, *, exact: bool) -> int:
    """Return the bits per sample of a format or, if `exact`, the bits of the source's samples that it preserves."""
    target = VideoFormat(name)
    through_matrix = exact and not (target.is_rgb or is_gray(target)) and VideoFormat(source).is_rgb
    return depth_of(name) - YCBCR_EXTRA_BITS * through_matrix


def _chroma_of(pixel_format: str) -> float:
    """Return the samples of chroma per pixel: 1 in RGB and 4:4:4, 0 in gray."""
    layout = VideoFormat(pixel_format, 16, 16)
    return 0 if is_gray(layout) else layout.chroma_width() * layout.chroma_height() / 256


def _divides(pixel_format: str, width: int, height: int) -> bool:
    """Return whether the chroma samples of a pixel format divide the size of a picture."""
    layout = VideoFormat(pixel_format, 16, 16)
    across = 16 // max(1, layout.chroma_width())
    down = 16 // max(1, layout.chroma_height())
    return width % across == 0 and height % down == 0
