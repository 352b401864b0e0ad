"""Sentences of all remarks of the package; see `fpsboost.media.Remark` for what a remark is."""

from typing import ClassVar

from fpsboost import media


class Remarks(media.Remarks):
    """Remarks in the order in which they came up, each once: those of media, and of everything else."""

    texts: ClassVar = {
        **media.Remarks.texts,
        # sources
        "frame-cut-off": "{name} ended within frame {number}, which {was} left out.",
        "read-by-opencv": (
            "{name} {was} read by OpenCV: 8-bit colours at a constant rate, without sound, subtitles and metadata."
        ),
        "eight-bits-read": "{name} has 16 bits per channel, of which 8 {were} read.",
        "animation-damaged": "{name} is damaged or ends early; {frames} could be decoded and {were} converted.",
        "alpha-over-white": "{name} has transparent parts, which the output cannot hold; they {were} laid over white.",
        "colours-without-tag": (
            "No colour tag stands for the {what} of {file}, whose colours are written unchanged; convert it to sRGB "
            "first."
        ),
        "numbers-with-step": "The numbers of {name} rise by {step}: taken for a sequence rendered with that step.",
        "without-numbers": (
            "The images of {name} have no numbers and {were} taken by the alphabet: {file} is the first one."
        ),
        "several-layers": "{file} and its like hold several pictures ({pictures}), the first of which leads.",
        "linear-light": (
            "{file} and its like hold linear light, which {was} written as it is and looks dark on a display; "
            "`view='srgb'` makes a preview."
        ),
        "several-pictures": "{file} and its like hold several pictures, the first of which {was} read.",
        "channels-left-out": "{file} and its like hold other channels ({channels}), which {were} left out.",
        "range-read-from-beginning": (
            "{name} {was} read from where the range begins, because the times of its frames are known only by decoding "
            "them."
        ),
        "part-read-from-beginning": (
            "{name} does not list its frames, so that all those before a part {were} decoded for it."
        ),
        "input-fps-of-steps": (
            "`input_fps` counts the images of {name} and not their numbers: of a scene with 24 numbers a second it is "
            "24/{step}, or 24 with `fill_gaps`."
        ),
        # timing, and frames that are left out, put in or replaced
        "repeats-dropped": "{count} of {frames} frames repeat another and {were} dropped; the others {how}.",
        "frames-missing": "Missing behind {listed}: {frames}; with them, the picture is {seconds:.3f} s longer.",
        "no-frames-missing": "No gap was found in camera motion; `gaps` takes a list of those in other motion.",
        "rate-lowered": "{name} has {rate} frames per second, the most that {file_type} can show.",
        "rate-made-constant": (
            "{name} varies from {slowest} to {fastest} frames per second; the output is constant at {rate:.5g}, and "
            "`keep_timing` keeps it variable."
        ),
        "picture-held": (
            "{name} shows nothing new for {longest:.1f} s from {begin:.1f} s on; the picture {was} held there{as_one}, "
            "as in all pauses of more than {limit:g} s."
        ),
        "frame-without-good-before": "Frame {number} has no good one before it and {was} kept as it is.",
        "frames-without-good-after": "No good frame comes after {numbers}, at the end, which {was} kept as it is.",
        "replace-behind-end": "The last frame is {number}, and `replace` has {behind} behind it.",
        "cut-in-long-pair": (
            "A scene seems to end between {begin} and {end}, so that no motion is followed there; if it goes on, use "
            "`no_cuts`."
        ),
        "retime-behind-end": "{name} ended before the retime curve, which {held} its last frame.",
        "loop-of-sound": (
            "{name} has sound, which does not become a loop; where it outlasts the {frames} frames, players hold the "
            "last one until its end; leave it out with `audio=False`."
        ),
        "loop-holds-last": "{name} holds its last frame, and so does its loop; no frames lead from it to the first.",
        "last-image": (
            "{frames} frames give {images} images and not {expected}, because nothing follows the last one; a video "
            "shows its last frame as long as the others."
        ),
        "sound-left-out": "{name} has sound, which {cause} leaves out.",
        "silent-passages": "{name} has no sound {passages}.",
        # motion vectors of a renderer
        "vectors-missing": "{name} has motion vectors for {there} of the {frames} output frames.",
        "vectors-in-order": (
            "{name} is numbered from {first} on and the output from {number}: its files {were} taken in order, the "
            "first for the first frame."
        ),
        "vectors-convention": (
            "In {name}, {convention}: found by comparing frames, although the names of the channels suggest otherwise; "
            "`vector_convention` overrides this."
        ),
        "vectors-unlike-motion": (
            "Frames fetched along the vectors of {name} agree less than without any motion: check that they are in "
            "pixels per frame, and of these frames."
        ),
        # guides
        "guide-missing": (
            "{name} has no picture of {missing} of the {frames} frames that are made ({numbers}); these {were} made "
            "without guide."
        ),
        "guide-followed": "{name} {was} followed in {frames}: {found}.",
        # targets
        "alpha-not-held": "{name} cannot hold an alpha channel, which {was} left out.",
        "floats-in-16-bits": "{name} {holds} the floating-point values of its source in 16 bits.",
        "light-clipped": (
            "{name} {holds} no light beyond white or below black, which {was} clipped; images as .exr keep it."
        ),
        "captions-lost": "{name} {lost} the closed captions of its source.",
        "format-not-held": "{name} cannot hold all of {wanted} and {was} written as {format}.",
        "not-said-in-pipe": "{name} cannot say the {what} of {source}; say it again behind the pipe.",
        "uneven-times": (
            "{name} shows every frame equally long, which those of {source} are not; give `fps` to keep their times."
        ),
        "not-said-in-animation": "{name} cannot say the {what} of its source; {left} out.",
        "frames-late": (
            "{name} shows some frames up to {late:.0f} ms late, because {file_type} cannot show one for less than "
            "{shortest:.3g} ms."
        ),
        "frames-slowed-by-browsers": (
            "{name} has frames of 10 ms and less, which browsers slow down to 100 ms; use `fps=90` or less for them."
        ),
        "last-frame-as-before": (
            "{name} shows its last frame as long as the one before, and not for its own time; write a .webp to keep "
            "that."
        ),
        "depth-lost": "{name} {lost} {what}, because {file_type} holds {bits}.",
        "numbered-anew": (
            "{factor} times the frames do not fit between numbers that rise by {gap}: all {were} numbered anew, one by "
            "one; `factor={gap}` makes just those that are missing."
        ),
        "few-digits": "{name} has too few digits for {frames} frames: later names grow longer.",
        "gray-as-colour": "{format} has no gray: gray images {were} written as colour with three equal channels.",
        "metadata-not-held": "{name} cannot hold the {what} of its source; {left} out.",
        "colours-as-rgb": "{name} has RGB where its source has {colours}.",
        "pixels-elsewhere": (
            "The originals have pixels elsewhere than in the display window, where those of the frames between are."
        ),
        "no-smaller-copies": "The originals hold smaller copies of their images, which the frames between do not.",
        "fewer-layers": "The originals passed with all their layers, of which the frames between have fewer.",
        "vectors-of-originals": (
            "Motion vectors lead from one original to the next, also in the frames between, as the originals' do."
        ),
        "no-side-frames": "No frame {was} made, so that nothing {was} written to {name}.",
        "no-motion": "No motion was found: all vectors in {name} are 0.",
        "images-in-no-region": "{images} of {name} belong to no planned region and {were} left out.",
        "lossy-merge": (
            "JPEG is lossy: merged frames {were} encoded anew, which changes them a little outside of the regions too."
        ),
        # the run itself
        "passages-looked-at": "Only the first {seconds} s of {name} were looked at.",
        "not-encrypted": (
            "The connection to {address} was not encrypted, and who reaches that port can run programs on the workers; "
            "use tls:// with the certificates of Dask's configuration."
        ),
    }
