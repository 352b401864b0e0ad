"""Semi-global matching over lists of labels, against a slow twin."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost.kernels.level_search import choose_labels
from support.twins import smoothed


def smooth(motions, energies, smoothness, slope, room=0, weights=None):
    """Lists of labels as the kernel takes them, whatever lies behind each; the mean costs of the paths as lists again.

    Every node must have chosen the first of its cheapest labels.
    """
    weights = np.ones(motions.shape, np.float32) if weights is None else weights
    capacity = max(len(each) for each in energies.ravel()) + room
    count = np.zeros(motions.shape, np.int32)
    numbers = np.full((*motions.shape, capacity, 2), np.float32(1e6))
    similarity = np.full((*motions.shape, capacity), np.float32(1e6))
    for place in np.ndindex(motions.shape):
        count[place] = len(energies[place])
        numbers[place][: count[place]] = motions[place]
        similarity[place][: count[place]] = np.negative(energies[place])
    costs = np.full((*motions.shape, -(-capacity // 8) * 8), np.float32(np.nan))
    flow, chosen = np.full((*motions.shape, 2), np.float32(np.nan)), np.full(motions.shape, np.float32(np.nan))
    limits = np.float32(smoothness), np.float32(slope)
    choose_labels(count, numbers, similarity, weights, *limits, costs, flow, chosen)
    found = np.empty(motions.shape, object)
    for place in np.ndindex(motions.shape):
        best = int(costs[place][: count[place]].argmin())
        np.testing.assert_array_equal(flow[place], numbers[place][best])
        assert chosen[place] == similarity[place][best]
        found[place] = (costs[place][: count[place]] / 4).tolist()
    return found


def lattice(rows, columns, motions, energies):
    """The labels of every node, by functions of its place."""
    labels, costs = np.empty((rows, columns), object), np.empty((rows, columns), object)
    for place in np.ndindex(rows, columns):
        labels[place], costs[place] = motions(*place), energies(*place)
    return labels, costs


def choice(costs):
    """The number of the best label of each node."""
    return [[int(np.argmin(each)) for each in row] for row in costs]


@settings(max_examples=25)
@given(
    st.integers(1, 6), st.integers(1, 6), st.integers(1, 12), st.sampled_from([0, 0.5, 3]), st.sampled_from([0, 0.1, 1])
)
def test_costs_equal_their_slow_twin(rows, columns, most, smoothness, slope):
    """For any lattice, ties and lists of any length, also without smoothness or slope."""
    random = np.random.default_rng([rows, columns, most])
    weights = random.choice(np.array([0, 0.25, 1], np.float32), (rows, columns))
    lengths = random.integers(1, most + 1, (rows, columns))
    motions, energies = lattice(
        rows,
        columns,
        lambda row, column: random.integers(-8, 9, (lengths[row, column], 2)).tolist(),
        lambda row, column: random.random(lengths[row, column]).tolist(),
    )
    found = smooth(motions, energies, smoothness, slope, room=2, weights=weights)
    expected = smoothed(motions, energies, weights, smoothness, slope)
    for place in np.ndindex(rows, columns):
        np.testing.assert_allclose(found[place], expected[place], atol=1e-5)


def test_a_lone_node_goes_along_but_an_object_does_not():
    """What a node says alone is not heard, unless it is tied loosely; what many say holds to its very edge."""
    motions, lone = lattice(
        7, 8, lambda *_: [[0, 0], [9, 2]], lambda row, column: [0.2, 0.0] if (row, column) == (3, 3) else [0.0, 0.2]
    )
    assert choice(smooth(motions, lone, 0.5, 0.1)) == [[0] * 8] * 7
    weights = np.ones((7, 8), np.float32)
    weights[3, 3] = 0.25
    assert choice(smooth(motions, lone, 0.5, 0.1, weights=weights))[3] == [0] * 3 + [1] + [0] * 4
    _, half = lattice(7, 8, lambda *_: [], lambda row, column: [0.2, 0.0] if column >= 4 else [0.0, 0.2])
    assert choice(smooth(motions, half, 0.5, 0.1)) == [[0] * 4 + [1] * 4] * 7
