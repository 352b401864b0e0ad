"""Semi-global matching: choose a label for every node of a lattice that is consistent with its neighbours.

The cost of a label at a node is aggregated along four paths, from the left, the right, above and below. Along each
path, every change of motion has a cost, up to a limit, so that motion may be discontinuous at the edge of an object
(Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166, Eq. 13). Every node has its own short list of labels instead of a
common one.
"""

from typing import Annotated

import numpy as np

from fpsboost.kernels.binding import Array, compiled

EIGHT = 8
"""Labels whose costs are computed together: every node has room for a multiple."""


@compiled
def choose_labels(
    count: Annotated[Array, "int32 (rows, columns)"],
    motions: Annotated[Array, "float32 (rows, columns, capacity, 2)"],
    similarity: Annotated[Array, "float32 (rows, columns, capacity)"],
    ties: Annotated[Array, "float32 (rows, columns)"],
    smoothness: np.float32,
    slope: np.float32,
    costs: Annotated[Array, "float32 (rows, columns, padded)"],
    flow: Annotated[Array, "float32 (rows, columns, 2)"],
    chosen: Annotated[Array, "float32 (rows, columns)"],
    scratch: Annotated[Array, "uint8 (bytes)"],
) -> None:
    """Choose the label of every node with the lowest cost, aggregated over its neighbours; the first of several.

    - `count`: labels of each node, at least one
    - `motions`: ``(dx, dy)`` of each label, pixels; undefined beyond `count`
    - `similarity`: of each label; its negative is the cost at the node
    - `ties`: share of the smoothness that applies to a node, between two the smaller of both
    - `smoothness`, `slope`: maximum cost of a change of motion between neighbours, and its cost per pixel
    - `costs`: of the paths to each label, out; `padded` is the capacity rounded up to a multiple of EIGHT
    - `flow`, `chosen`: motion and similarity of the chosen label, out
    - `scratch`: by `fpsboost.kernels.binding.scratch_of` of `label_scratch`
    """


def label_scratch(nodes: int, capacity: int) -> tuple[int, int, int, int]:
    """Return the bytes that `choose_labels` needs: motion along x and y and two costs of all labels and a node more."""
    return (4 * (nodes + 1) * (-(-capacity // EIGHT) * EIGHT),) * 4
