"""Names of the conventions by which renderers store motion vectors; light to import, for a command line.

Vectors are in pixels per frame.

`blender`
    Four channels X, Y, Z, W: X and Y are the position in the previous frame minus that in this one, Z and W the
    position in this one minus that in the next, y up.
`nuke`
    Four channels ``forward.u``, ``forward.v``, ``backward.u``, ``backward.v``: to the next and to the previous frame,
    y up.
`forward-up`, `forward-down`, `backward-up`, `backward-down`
    Two channels (R and G, X and Y, or u and v; a third is left out), as Arnold, V-Ray and others write them: motion to
    the next or to the previous frame, y up or down. The other direction is taken for its opposite.
"""

from __future__ import annotations

from typing import Literal

ConventionName = Literal["auto", "blender", "nuke", "forward-up", "forward-down", "backward-up", "backward-down"]
"""A convention, or the one that the names of the channels and a comparison of frames suggest."""
