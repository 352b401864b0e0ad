"""Options for what is written beside the frames of a conversion."""

from dataclasses import dataclass

from fpsboost.options import Checked, PathName, option


@dataclass(frozen=True)
class SideOutputs(Checked):
    """Side outputs, written beside the frames: maps of confidence, and motion.

    Each is a folder, created if it does not exist, or a pattern in an existing one. All of its files appear together
    with the output, or none. The frames are the same with and without them.

    Parameters
    ----------
    confidence : str or os.PathLike, optional
        Where to write the confidence of every interpolated frame, named like the frames of the output: PNG with 255 for
        certain; half OpenEXR with 1 for certain by a pattern (``conf_####.exr``). Original frames have none.
    save_motion : str or os.PathLike, optional
        Where to write the motion of every source frame next to an interpolated one, named like
        the source's images: ``NAME_backward.flo`` and ``NAME_forward.flo``; OpenEXR in Blender's convention by a
        pattern (``motion_####.exr``). Pictures in colour, ``NAME_forward.png``, are written beside them.
    """

    confidence: PathName | None = option(
        None, "Write confidence maps, PNG; c_####.exr for EXR.", metavar="DIR", group="Side outputs"
    )
    save_motion: PathName | None = option(
        None, "Write motion fields, .flo; m_####.exr for EXR.", metavar="DIR", group="Side outputs"
    )
