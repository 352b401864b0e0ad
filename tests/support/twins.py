"""Slow, obvious twins of the kernels; nothing of fpsboost is imported here."""

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

BEYOND = 48
"""Pixels around a frame for which `blended` and `heaviest` have coefficients of splines."""


def offsets_from_the_centre(radius: int) -> list[int]:
    """0, 1, -1, -2, 2, 3, -3, -4, 4, ... up to the radius."""
    order = [0]
    for distance in range(1, radius + 1):
        order += [distance, -distance] if distance % 2 else [-distance, distance]
    return order


def box_weights(patch_radius: int) -> Array:
    """(2r + 1, 2r + 1) equal weights that sum to 1."""
    size = 2 * patch_radius + 1
    return np.full((size, size), 1 / size**2)


def gaussian_weights(patch_radius: int) -> Array:
    """(2r + 1, 2r + 1) weights that sum to 1, variance half the size of the similarity area."""
    away = np.arange(-patch_radius, patch_radius + 1.0)
    weights = np.exp(-np.add.outer(away**2, away**2) / (2 * 0.5 * away.size))
    return weights / weights.sum()


def pixel_similarity(a: Array, b: Array, v: float) -> Array:
    """The report's xi, a product of one Gaussian a component."""
    return np.exp(-((np.asarray(a, float) - np.asarray(b, float)) ** 2) / (2 * v * v)).prod(axis=-1)


def level_similarity(a: Array, b: Array, most: int) -> Array:
    """One less the sum of absolute differences, which `most` levels bring to 0."""
    return (1 - np.abs(np.asarray(a, float) - np.asarray(b, float)).sum(axis=-1) / most).clip(0)


def patch_scores(
    image0: Array,
    image1: Array,
    radius: int,
    weights: Array,
    v: float,
    repeat_target: bool,
    similarity: Callable[[Array, Array, Any], Array] = pixel_similarity,
) -> Array:
    """Weighted patch similarity of every pixel of frame 0 under every offset: (H, W, 2 R + 1, 2 R + 1) of [dy, dx].

    Pixels repeat beyond the edges. Targets out of frame 1 score -1, or are compared too with `repeat_target`.
    """
    height, width = image0.shape[:2]
    patch_radius = len(weights) // 2
    near, far = (patch_radius,) * 2, (patch_radius + radius,) * 2
    padded0 = np.pad(image0.astype(float), (near, near, (0, 0)), "edge")
    padded1 = np.pad(image1.astype(float), (far, far, (0, 0)), "edge")
    y, x = np.ogrid[-radius : height - radius, -radius : width - radius]
    scores = np.empty((height, width, 2 * radius + 1, 2 * radius + 1))
    for dy, dx in np.ndindex(scores.shape[2:]):
        other = padded1[dy : dy + padded0.shape[0], dx : dx + padded0.shape[1]]
        patches = np.lib.stride_tricks.sliding_window_view(similarity(padded0, other, v), weights.shape)
        inside = (y + dy >= 0) & (y + dy < height) & (x + dx >= 0) & (x + dx < width)
        scores[:, :, dy, dx] = np.where(inside | repeat_target, (patches * weights).sum(axis=(2, 3)), -1)
    return scores


def best_offset(scores: Array, sign: int = 1) -> tuple[Array, Array, Array]:
    """The flow of the best scores, those scores, and by how much each leads over every other offset.

    Offsets are tried from the centre outwards, dy in the outer loop; `sign` -1 tries the opposite offsets.
    """
    height, width, side = scores.shape[:3]
    order = [sign * k for k in offsets_from_the_centre(side // 2)]
    flow, best = np.zeros((height, width, 2)), np.full((height, width), -1.0)
    for dy, dx in product(order, order):
        score = scores[:, :, dy + side // 2, dx + side // 2]
        flow[score > best] = dx, dy
        best = np.maximum(best, score)
    second, first = np.moveaxis(np.sort(scores.reshape(height, width, -1))[..., -2:], -1, 0)
    return flow, best, first - second


def peak_scores(scores: Array) -> Array:
    """The scores of `patch_scores` at the best fraction of a pixel: a linear peak through both neighbours."""
    peaks = scores.copy()
    for axis in (2, 3):
        before, here, after = (np.moveaxis(scores, axis, 0)[n : scores.shape[axis] - 2 + n] for n in range(3))
        is_peak = (here >= np.maximum(before, after)) & (np.minimum(before, after) >= 0)
        np.moveaxis(peaks, axis, 0)[1:-1] += np.where(is_peak, np.abs(before - after) / 2, 0)
    return peaks


def compared_labels(
    image0: Array, image1: Array, point: tuple[int, int], radius: int, most: int, labels: Array, similarity: Array
) -> tuple[Array, float]:
    """The similarities of one point's labels (n, 2) after `compare_labels`, and the detail there."""
    far = 64
    first, second = (np.pad(each.astype(float), ((far, far), (far, far), (0, 0)), "edge") for each in (image0, image1))
    y, x = (place + far for place in point)

    def window(image: Array, dy: int, dx: int, before: int, after: int) -> Array:
        return image[y + dy - before : y + dy + after + 1, x + dx - before : x + dx + after + 1]

    def likeness(dy: int, dx: int) -> float:
        return level_similarity(*(window(first, *to, radius, radius) for to in ((0, 0), (dy, dx))), most).mean()

    def unexplained(dy: int, dx: int) -> float:
        one, other = window(first, 0, 0, 5, 4), window(second, dy, dx, 5, 4)
        change, total = (other - one)[1:-1, 1:-1], one + other
        along_x, along_y = total[1:-1, 2:] - total[1:-1, :-2], total[2:, 1:-1] - total[:-2, 1:-1]
        xx, xy, yy = (along_x**2).sum() + 64, (along_x * along_y).sum(), (along_y**2).sum() + 64
        xt, yt, tt = (along_x * change).sum(), (along_y * change).sum(), (change**2).sum()
        determinant = max(xx * yy - xy * xy, 32 * (xx + yy))
        step_x, step_y = ((yy * xt - xy * yt) / determinant, (xx * yt - xy * xt) / determinant)
        rest = change - np.clip(step_x, -0.125, 0.125) * along_x - np.clip(step_y, -0.125, 0.125) * along_y
        return min((rest**2).sum() / tt, 1) if tt else 1

    detail, changed = 2 - likeness(0, 1) - likeness(1, 0), similarity.astype(float)
    slack, places = detail / 2, [(int(dy), int(dx)) for dx, dy in labels]
    rivals = changed >= changed.max() - slack
    if detail < 0.3 or rivals.sum() < 2:
        return changed, detail
    for k in np.flatnonzero(rivals & (changed < 1)):
        changed[k] = 1 - (1 - changed[k]) * math.sqrt(unexplained(*places[k]))

    def is_inside(dy: int, dx: int) -> bool:
        sizes = zip(point, (dy, dx), image0.shape, strict=False)
        return all(radius <= place + move < size - radius for place, move, size in sizes)

    best = int(changed.argmax())
    for k, place in enumerate(places):
        rest = 0.2 if is_inside(*place) else 0
        if rest and changed[k] < changed[best] - slack / 2:
            continue
        apart = np.subtract(place, places[best])
        if likeness(*(apart if rest or is_inside(*apart) else -apart)) >= 1 - slack / 2:
            changed[k] = changed[best] + rest * (changed[k] - changed[best])
    return changed, detail


def clamped(value: float, size: int) -> int:
    """Round half up, then clamp to an index."""
    return min(max(math.floor(value + 0.5), 0), size - 1)


def miss(flow: Array, t: float, source: tuple[int, int], target: tuple[int, int]) -> tuple[float, float]:
    """How far a source ``(y, x)`` lands from a target at t: ``(dx, dy)``."""
    dx, dy = flow[source]
    return source[1] + t * float(dx) - target[1], source[0] + t * float(dy) - target[0]


def lands(flow: Array, t: float, source: tuple[int, int], target: tuple[int, int]) -> bool:
    """Whether a source lands within half a pixel of the target."""
    return all(abs(distance) <= 0.5 for distance in miss(flow, t, source, target))


def stepped_back(target: int, motion: float, size: int) -> int:
    """The pixel that a motion leads from to the target, half pixels rounded towards the target."""
    distance = math.ceil(abs(motion) - 0.5)
    return min(max(target - distance if motion > 0 else target + distance, 0), size - 1)


def iterative_search(flow: Array, t: float, iterations: int) -> tuple[Array, Array]:
    """Yang et al.: q <- p - t m(q), first from q = p, until q lands on p; else the first iteration's q."""
    height, width = flow.shape[:2]
    source, found = np.zeros((height, width), int), np.zeros((height, width), bool)
    for y in range(height):
        for x in range(width):
            visited = []
            q = y, x
            while len(visited) < iterations and not (visited and lands(flow, t, visited[-1], (y, x))):
                dx, dy = flow[q]
                q = stepped_back(y, t * float(dy), height), stepped_back(x, t * float(dx), width)
                visited.append(q)
            found[y, x] = lands(flow, t, visited[-1], (y, x))
            q = visited[-1] if found[y, x] else visited[0]
            source[y, x] = q[0] * width + q[1]
    return source, found


def brute_force_search(flow: Array, t: float, radius: int) -> tuple[Array, Array]:
    """Of all sources within the radius, the one that lands nearest; of several, the nearest source, in raster order."""
    height, width = flow.shape[:2]
    source, found = np.zeros((height, width), int), np.zeros((height, width), bool)
    for y in range(height):
        for x in range(width):
            best = math.inf, math.inf
            for source_y in range(max(0, y - radius), min(height, y + radius + 1)):
                for source_x in range(max(0, x - radius), min(width, x + radius + 1)):
                    dx, dy = miss(flow, t, (source_y, source_x), (y, x))
                    distances = dx * dx + dy * dy, (source_y - y) ** 2 + (source_x - x) ** 2
                    if distances < best:
                        best = distances
                        source[y, x] = source_y * width + source_x
                        found[y, x] = lands(flow, t, (source_y, source_x), (y, x))
    return source, found


def fetched(
    image0: Array, image1: Array, t: float, source0: Array, found0: Array, source1: Array, found1: Array
) -> Array:
    """Both sources blended in time, or the only one that was found; not rounded."""
    pairs = (image0, source0), (image1, source1)
    a, b = (image.reshape(-1, image.shape[2])[source].astype(float) for image, source in pairs)
    share = np.where(found0 == found1, t, found1)[..., np.newaxis]
    return (1 - share) * a + share * b


def matched_blocks(image0: Array, image1: Array, block_size: int, search_range: int) -> tuple[Array, Array]:
    """Of every place in frame 1 and in range, the one with the lowest sum of absolute differences, then the nearest.

    ``(dx, dy)`` and the sum for every block; those at the right and at the bottom edge may be smaller.
    """
    height, width = image0.shape[:2]
    rows, columns = -(-height // block_size), -(-width // block_size)
    motion, difference = np.zeros((rows, columns, 2), int), np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            top, left = row * block_size, column * block_size
            block = image0[top : top + block_size, left : left + block_size].astype(float)
            found = []
            for dy in range(-search_range, search_range + 1):
                for dx in range(-search_range, search_range + 1):
                    bottom, right = top + dy + block.shape[0], left + dx + block.shape[1]
                    if top + dy < 0 or left + dx < 0 or bottom > height or right > width:
                        continue
                    there = image1[top + dy : bottom, left + dx : right].astype(float)
                    found.append((np.abs(block - there).sum(), dx * dx + dy * dy, dy, dx))
            best = min(found)
            motion[row, column], difference[row, column] = best[:1:-1], best[0]
    return motion, difference


def shortest_motions(
    components0: Array, components1: Array, step: int, radius: int, around: int, tolerance: float, v: float, flow: Array
) -> tuple[Array, Array, Array]:
    """Similarity of each point's motion, the best of those around it and of none, and the shortest that is near it."""
    height, width = components0.shape[:2]
    padded0, padded1 = (
        np.pad(each, ((radius, radius), (radius, radius), (0, 0)), "edge") for each in (components0, components1)
    )
    size = 2 * radius + 1

    def compared(y: int, x: int, motion: Array) -> float:
        there_y, there_x = y + round(float(motion[1])), x + round(float(motion[0]))
        if not (0 <= there_y < height and 0 <= there_x < width):
            return 0
        patches = padded0[y : y + size, x : x + size], padded1[there_y : there_y + size, there_x : there_x + size]
        return float(pixel_similarity(*patches, v).mean())

    own, best, shortest = (np.zeros(flow.shape[:2]) for _ in range(3))
    for row, point in np.ndindex(*flow.shape[:2]):
        y, x = min(row * step + step // 2, height - 1), min(point * step + step // 2, width - 1)
        near = flow[max(row - around, 0) : row + around + 1, max(point - around, 0) : point + around + 1].reshape(-1, 2)
        tried = [(compared(y, x, motion), np.abs(motion).max()) for motion in (*near, flow[row, point], np.zeros(2))]
        own[row, point] = tried[-2][0]
        best[row, point] = max(similarity for similarity, _ in tried)
        shortest[row, point] = min(length for similarity, length in tried if similarity >= own[row, point] - tolerance)
    return own, best, shortest


def landed(flow: Array, similarity: Array, least: float, t: float) -> tuple[Array, Array]:
    """The pixels of both frames, ``y * W + x``, that are seen at each place at time t.

    Of the pixels of frame 0 that land there the most similar, the first of several, and what it moves to; or the place
    itself where none of at least that similarity lands.
    """
    height, width = similarity.shape
    landings: dict[tuple[int, int], list[tuple[float, int, int]]] = {}
    for y in range(height):
        for x in range(width):
            dx, dy = (float(value) for value in flow[y, x])
            place = math.floor(y + t * dy + 0.5), math.floor(x + t * dx + 0.5)
            if similarity[y, x] >= least:
                end = clamped(y + dy, height) * width + clamped(x + dx, width)
                landings.setdefault(place, []).append((-float(similarity[y, x]), y * width + x, end))
    source0, source1 = (np.arange(height * width).reshape(height, width) for _ in range(2))
    for (y, x), candidates in landings.items():
        if 0 <= y < height and 0 <= x < width:
            _, source0[y, x], source1[y, x] = min(candidates)
    return source0, source1


def kernel(distance: Any, sharpening: float = 0) -> Any:
    """The kernel of cubic splines: a B-spline and 1/42 of its second derivative, less of it where it is sharpened."""
    x, fraction = np.abs(distance), distance % 1
    cubic = np.where(x < 1, 2 / 3 - x * x + x**3 / 2, np.maximum(2 - x, 0) ** 3 / 6)
    near, middle, far = (np.maximum(1 - np.abs(x - at), 0) for at in (-1, 0, 1))
    return cubic + (1 - sharpening * 4 * fraction * (1 - fraction)) / 42 * (near - 2 * middle + far)


def sharpening_at(t: float) -> float:
    """How much what is mixed at time t is sharpened: two thirds in the middle."""
    return 2 / 3 * 4 * t * (1 - t)


def spline_coefficients(plane: Array, beyond: int) -> Array:
    """The coefficients whose spline meets every sample, of the plane padded by its edges, `beyond` pixels wide."""
    padded = np.pad(plane.astype(float), beyond, "edge")
    down, across = (kernel(np.subtract.outer(np.arange(side), np.arange(side))) for side in padded.shape)
    return np.linalg.solve(across, np.linalg.solve(down, padded).T).T


def seen_by_both(place: float, motion: float, t: float, length: int) -> float:
    """The nearest place along an axis whose start and end, by a motion, are within both frames."""
    first = max(0, t * motion, (t - 1) * motion)
    last = min(length, length + t * motion, length - (1 - t) * motion)
    return first if place < first else max(first, last) if place > last else place


def collected(
    vectors: Array,
    gradients: Array,
    accelerations: Array,
    trust: Array,
    candidates: Array,
    *,
    sign: float,
    t: float,
    step: int,
    support: float,
    tolerance: float,
    size: tuple[int, int],
    capacity: int,
    spacing: int = 16,
) -> None:
    """Motions for nodes in the middles of square cells; ``candidates[row, column]`` are lists of lists of eleven.

    Cells are `spacing` pixels wide. The eleven are votes; sums of dx and dy; of votes whose acceleration is known,
    votes, ax, ay and ax^2 + ay^2; and sums of how dx and dy change along x, then along y. A point votes at every node
    nearer to where it lands than `support`, along x and y, the less the farther and the less it is trusted; a node that
    the motion brings in or takes out counts as the nearest place that both frames have. Its vote, for its motion and
    what its gradients add on the way to the node, is for the first candidate whose mean is near, or a new one as long
    as there is room.
    """
    height, width = size
    for i, j in np.ndindex(*trust.shape):
        y, x = min(i * step + step // 2, height - 1), min(j * step + step // 2, width - 1)
        here_x, here_y = (float(value) for value in vectors[i, j])
        known, ax, ay = (float(value) for value in accelerations[i, j])
        landing_x = x + 0.5 + t * here_x - t * (1 - t) / 2 * ax
        landing_y = y + 0.5 + t * here_y - t * (1 - t) / 2 * ay
        for row, column in np.ndindex(*candidates.shape):
            node_x, node_y = spacing * column + spacing / 2, spacing * row + spacing / 2
            down = max(1 - abs(landing_y - seen_by_both(node_y, here_y, t, height)) / support, 0)
            across = max(1 - abs(landing_x - seen_by_both(node_x, here_x, t, width)) / support, 0)
            vote = float(trust[i, j]) * down * across
            if vote == 0:
                continue
            apart = np.array([node_x - landing_x, node_y - landing_y])
            dx, dy = (float(value) for value in (here_x, here_y) + apart @ gradients[i, j])
            sure = known * vote
            more = [vote, vote * sign * dx, vote * sign * dy, sure, sure * ax, sure * ay, sure * (ax * ax + ay * ay)]
            more += (vote * sign * gradients[i, j]).ravel().tolist()
            listed = candidates[row, column]
            for candidate in listed:
                votes, sum_x, sum_y, *_ = candidate
                if max(abs(sum_x / votes - sign * dx), abs(sum_y / votes - sign * dy)) < tolerance:
                    candidate[:] = np.add(candidate, more).tolist()
                    break
            else:
                if len(listed) < capacity:
                    listed.append(more)


def listed_by_votes(
    candidates: list[list[float]],
    room: int,
    *,
    still_votes: float,
    spread: float,
    least_share: float,
    least: float,
    unknown: float,
) -> tuple[list[list[float]], list[float]]:
    """A node's motions ``[dx, dy, ax, ay, *gradients]`` by falling votes, none last, and weights that sum to 1.

    `candidates` are lists as `collected` makes them. A candidate's acceleration is the mean of its votes, times the
    share of votes that know one, a few being for none, and times 1 / (1 + variance / spread^2). Motion of less than a
    quarter of a pixel has the less of it the shorter it is. Weights are in proportion to the share of the votes and
    `least_share` more; the best's being 1, `least` is taken off, and none is below 0.
    """
    everything = sum(candidate[0] for candidate in candidates) + still_votes
    motions, shares = [], []
    for votes, sum_x, sum_y, known, sum_ax, sum_ay, squares, *changes in sorted(candidates, key=lambda each: -each[0])[
        : room - 1
    ]:
        ax = ay = 0.0
        if known > 0:
            ax, ay = sum_ax / known, sum_ay / known
            variance = squares / known - ax**2 - ay**2
            belief = known / (known + unknown * votes) / (1 + variance / spread**2)
            belief *= min(4 * (abs(sum_x) + abs(sum_y)) / votes, 1)
            ax, ay = belief * ax, belief * ay
        motions.append([sum_x / votes, sum_y / votes, ax, ay, *(change / votes for change in changes)])
        shares.append(votes / everything + least_share)
    shares.append(still_votes / everything + least_share)
    weights = [max(share / max(shares) - least, 0) for share in shares]
    return [*motions, [0] * 8], [weight / sum(weights) for weight in weights]


def smoothed(motions: Array, energies: Array, weights: Array, smoothness: float, slope: float) -> Array:
    """Mean over four directions of the least cost of a path that ends in a label, less what the node before had to pay.

    `motions` and `energies` are (rows, columns) of lists: of ``(dx, dy)``, and of a number for each; so is the answer.
    Between two nodes a change costs the smaller one of their weights.
    """
    rows, columns = motions.shape
    total = np.empty(motions.shape, object)
    for place in np.ndindex(rows, columns):
        total[place] = [0.0] * len(energies[place])
    for direction in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        paths: dict[tuple[int, ...], list[float]] = {}

        def path(place: tuple[int, ...], direction=direction, paths=paths) -> list[float]:
            before = tuple(np.subtract(place, direction).tolist())
            if place not in paths and not (0 <= before[0] < rows and 0 <= before[1] < columns):
                paths[place] = list(energies[place])
            if place not in paths:
                behind, tie = path(before), min(float(weights[place]), float(weights[before]))
                paths[place] = [
                    energy
                    - min(behind)
                    + min(
                        cost + tie * min(slope * float(np.abs(np.subtract(motion[:2], other[:2])).sum()), smoothness)
                        for other, cost in zip(motions[before], behind, strict=True)
                    )
                    for motion, energy in zip(motions[place], energies[place], strict=True)
                ]
            return paths[place]

        for place in np.ndindex(rows, columns):
            total[place] = [so_far + cost / 4 for so_far, cost in zip(total[place], path(place), strict=True)]
    return total


def blended(
    planes0: list[Array],
    planes1: list[Array],
    t: float,
    candidates: Array,
    *,
    scale: float,
    sharpness: float,
    enough: float,
    negligible: float = 0,
    compared: int | None = None,
    spacing: int = 16,
) -> tuple[list[Array], Array]:
    """The mean of each plane over all windows and candidates, weighed by patch similarity at t, and similarity ** 8.

    Windows have 16 x 16 squares of 2 x 2 pixels and fade into those of their neighbours, `spacing` pixels away, where
    they overlap; patches have 5 x 5 squares, of which the outer ones count three quarters, and end with their window;
    edges repeat. The first plane has all pixels, others may have half the columns, and half the rows; only the first
    `compared` have a say in the weights. ``candidates[row, column]`` are lists of ``[weight, dx, dy, ax, ay]``, tried
    one by one, until one weighs less than `negligible` of the least weight of a square.
    """
    splines = [[spline_coefficients(plane, BEYOND) for plane in planes] for planes in (planes0, planes1)]
    size = planes0[0].shape
    steps = [tuple(-(-a // b) for a, b in zip(size, plane.shape, strict=True)) for plane in planes0]
    sums, all_weights = ([np.zeros(plane.shape) for plane in planes0] for _ in range(2))
    similarities = np.zeros(size)
    shape, before = faded_window(spacing), (32 - spacing) // 2
    for row, column in np.ndindex(*candidates.shape):
        corner = np.array([spacing * column - before, spacing * row - before])
        totals = [np.zeros((32 // down, 32 // across)) for down, across in steps]
        weights, alike_sum, best = (np.zeros((16, 16)) for _ in range(3))
        for prior, *motion in candidates[row, column]:
            if prior == 0:
                continue
            if prior < negligible * weights.min():
                break
            _, mixed, alike = _compared(splines, corner, motion, t, scale, size, steps, compared)
            weight = prior * np.exp(-sharpness * (1 - alike))
            totals = [
                total + _of_samples(weight, step) * both for total, both, step in zip(totals, mixed, steps, strict=True)
            ]
            weights += weight
            alike_sum += weight * alike
            best = np.maximum(best, alike)
            if best.min() >= enough:
                break
        share = shape / np.sqrt(weights)
        for plane, plane_weights, total, step in zip(sums, all_weights, totals, steps, strict=True):
            at, shares = (corner[1] // step[0], corner[0] // step[1]), _of_samples(share, step)
            _add_within(plane, shares * total, at)
            _add_within(plane_weights, shares * _of_samples(weights, step), at)
        at = corner[1], corner[0]
        _add_within(similarities, _of_samples(share, (1, 1)) * _of_samples(alike_sum, (1, 1)), at)
    means = [plane / plane_weights for plane, plane_weights in zip(sums, all_weights, strict=True)]
    return means, (similarities / all_weights[0]) ** 8


def heaviest(
    planes0: list[Array],
    planes1: list[Array],
    t: float,
    candidates: Array,
    *,
    scale: float,
    sharpness: float,
    spacing: int = 16,
) -> tuple[Array, Array]:
    """The largest weight at each pixel, and where it lies along that motion: x and y in frame 0, and in frame 1.

    Weights are those of `blended`, times how much the pixel's square counts in its window.
    """
    splines = [[spline_coefficients(plane, BEYOND) for plane in planes] for planes in (planes0, planes1)]
    height, width = size = planes0[0].shape
    weights, places = np.zeros(size), np.zeros((4, *size))
    shape, before = faded_window(spacing), (32 - spacing) // 2
    for row, column in np.ndindex(*candidates.shape):
        corner = np.array([spacing * column - before, spacing * row - before])
        for prior, *motion in candidates[row, column]:
            starts, _, alike = _compared(splines, corner, motion, t, scale, size, [(1, 1)] * len(planes0))
            weight = _of_samples(prior * np.exp(-sharpness * (1 - alike)) * shape, (1, 1))
            for j, i in np.ndindex(32, 32):
                x, y = corner[0] + i, corner[1] + j
                if 0 <= x < width and 0 <= y < height and weight[j, i] > weights[y, x]:
                    weights[y, x] = weight[j, i]
                    places[:, y, x] = np.concatenate([np.add(start, (i, j)) for start in starts])
    return weights, places


def _compared(
    splines: list[list[Array]],
    corner: Array,
    motion: list[float],
    t: float,
    scale: float,
    frame: tuple[int, ...],
    steps: list[tuple[int, ...]],
    compared: int | None = None,
) -> tuple[tuple[Array, Array], tuple[Array, ...], Array]:
    """A window along ``[dx, dy, ax, ay]``: its corners in both frames, its planes mixed, and patch similarity."""
    start = corner - t * np.array(motion[:2]) + t * (1 - t) / 2 * np.array(motion[2:])
    starts = start, start + motion[:2]
    planes = [_along(both, starts, frame, t, step) for *both, step in zip(*splines, steps, strict=True)]
    mixed, apart = zip(*planes, strict=True)
    return starts, mixed, _means_around(np.exp(-scale * sum(apart[:compared])))


def _means_around(squares: Array) -> Array:
    """The means of the squares up to two away, of which the farthest count three quarters along each axis."""
    away = np.abs(np.subtract.outer(np.arange(16), np.arange(16)))
    counts = np.select([away <= 1, away == 2], [1, 0.75], 0)
    return (counts @ squares @ counts.T) / (counts @ np.ones((16, 16)) @ counts.T)


def _of_samples(squares: Array, step: tuple[int, int]) -> Array:
    """What each sample has between squares: three quarters of its own one's, a quarter of the next one's."""
    for axis in (0, 1):
        if step[axis] == 1:
            place = np.arange(32)
            near, far = place // 2, np.clip(place // 2 + 2 * (place % 2) - 1, 0, 15)
            squares = 0.75 * squares.take(near, axis) + 0.25 * squares.take(far, axis)
    return squares


def _add_within(plane: Array, values: Array, corner: tuple[int, int]) -> None:
    """Add the part of a window that lies within a plane."""
    rows, columns = (at + np.arange(side) for at, side in zip(corner, values.shape, strict=True))
    within = [(places >= 0) & (places < side) for places, side in zip((rows, columns), plane.shape, strict=True)]
    plane[np.ix_(rows[within[0]], columns[within[1]])] += values[np.ix_(*within)]


def fading(place: int, spacing: int = 16) -> float:
    """How much a square in a row of 16 counts: a smooth step of the share s of its way through the next window's part.

    That window lies `spacing` pixels away, on the side of the nearer end; squares that only one window has count 1. The
    step is 3 s^2 - 2 s^3 where windows overlap by half, and 6 s^5 - 15 s^4 + 10 s^3 where they overlap less.
    """
    share = min(min(place + 0.5, 15.5 - place) / (16 - spacing / 2), 1)
    return 3 * share**2 - 2 * share**3 if spacing == 16 else 6 * share**5 - 15 * share**4 + 10 * share**3


def faded_window(spacing: int) -> Array:
    """How much each of the 16 x 16 squares of a window counts."""
    row = [fading(place, spacing) for place in range(16)]
    return np.outer(row, row)


def _along(
    coefficients: list[Array], starts: tuple[Array, Array], frame: tuple[int, ...], t: float, step: tuple[int, ...]
) -> tuple[Array, Array]:
    """A window of a plane of both frames from their corners ``(x, y)``: mixed, and how far apart each square is."""
    (height, width), (down, across) = frame, step
    windows, inside = [], []
    for plane, (x, y) in zip(coefficients, starts, strict=True):
        rows, columns = y + np.arange(0, 32, down), x + np.arange(0, 32, across)
        inside.append(np.outer((rows >= 0) & (rows <= height - 1), (columns >= 0) & (columns <= width - 1)))
        # a corner further out than this sees nothing but the repeated edge
        place = min(max(y, -38), height + 2) / down, min(max(x, -38), width + 2) / across
        windows.append(spline_window(plane, BEYOND, *place, (32 // down, 32 // across), sharpening_at(t)))
    share = np.where(inside[0] == inside[1], t, inside[1])
    apart = ((windows[1] - windows[0]) ** 2).reshape(16, 2 // down, 16, 2 // across).mean(axis=(1, 3))
    return (1 - share) * windows[0] + share * windows[1], apart


def spline_window(
    coefficients: Array, beyond: int, y: float, x: float, size: tuple[int, int] = (32, 32), sharpening: float = 0
) -> Array:
    """The spline at places a sample apart, the first at (y, x): the sum over all coefficients."""
    down, across = (
        kernel(np.subtract.outer(start + beyond + np.arange(side), np.arange(length)), sharpening)
        for start, length, side in zip((y, x), coefficients.shape, size, strict=True)
    )
    return down @ coefficients @ across.T


def refined(
    components0: Array, components1: Array, step: int, tail: float, damping: float, largest: float, flow: Array
) -> Array:
    """One weighted least-squares step of the motion at points `step` pixels apart; windows of 8 x 8, edges repeat."""
    height, width = components0.shape[:2]
    both = components0.astype(float), components1.astype(float)

    def pixel(frame: int, y: int, x: int) -> Array:
        return both[frame][min(max(y, 0), height - 1), min(max(x, 0), width - 1)]

    out = flow.astype(float)
    for row in range(flow.shape[0]):
        for point in range(flow.shape[1]):
            y0 = min(row * step + step // 2, height - 1) - 4
            x0 = min(point * step + step // 2, width - 1) - 4
            dx, dy = (int(value) for value in flow[row, point])
            matrix, vector, squares = damping * np.eye(2), np.zeros(2), 0.0
            for y in range(y0, y0 + 8):
                for x in range(x0, x0 + 8):
                    change = pixel(1, y + dy, x + dx) - pixel(0, y, x)
                    # twice the central difference of each frame, together four times the gradient
                    along_x = pixel(0, y, x + 1) - pixel(0, y, x - 1)
                    along_x = along_x + pixel(1, y + dy, x + dx + 1) - pixel(1, y + dy, x + dx - 1)
                    along_y = pixel(0, y + 1, x) - pixel(0, y - 1, x)
                    along_y = along_y + pixel(1, y + dy + 1, x + dx) - pixel(1, y + dy - 1, x + dx)
                    weight = (1 + (change**2).sum() * tail) ** -4
                    gradient = np.array([along_x, along_y])
                    matrix += weight * gradient @ gradient.T
                    vector += weight * gradient @ change
                    squares += weight * (change**2).sum()
            move = np.linalg.solve(matrix, vector)
            # of 64 pixels that do not move, two numbers explain a 31st of the rest by chance
            explained = float(move @ vector)
            belief = max(0.0, 1 - max(squares - explained, 0.0) / 31 / max(explained, 1e-20))
            out[row, point] += np.clip(-4 * belief * move, -largest, largest)
    return out


def marked(
    images: list[Array],
    motion: Array,
    spacing: int,
    points: Array,
    point_spacing: int,
    shortest: float,
    same: int,
    different: int,
) -> Array:
    """2 where a pixel of the first image stays as it is in all of them and would not if it moved with its block.

    1 where it stays, else 0. It would not stay if its colour is found neither where its motion leads nor where it comes
    from, in any image. Beyond the frame, nobody can tell. No pixel of a block is 2 if more than four fifths of those
    that would be, in it and in the blocks around it, are seen in the second image where their points move to.
    """
    height, width = images[0].shape
    first, second, *others = (image.astype(int) for image in images)
    out = np.zeros((height, width), np.uint8)
    moving = np.zeros((height, width), bool)
    for y in range(height):
        for x in range(width):
            dx, dy = (float(value) for value in motion[y // spacing, x // spacing])
            stays = all(abs(other[y, x] - first[y, x]) <= same for other in (second, *others))
            if max(abs(dx), abs(dy)) < shortest or not stays:
                continue
            out[y, x] = 2
            for sign in (-1, 1):
                v, shift = y + sign * round(dy), sign * round(dx)
                known = 0 <= v < height and 0 <= x + shift < width
                shown = (image[v, x + shift] for image in (first, second, *others)) if known else ()
                if not known or any(abs(value - first[y, x]) <= different for value in shown):
                    out[y, x] = 1
            dx, dy = (float(value) for value in points[y // point_spacing, x // point_spacing])
            v, u = y + round(dy), x + round(dx)
            if max(abs(dx), abs(dy)) >= shortest and 0 <= v < height and 0 <= u < width:
                moving[y, x] = abs(second[v, u] - first[y, x]) <= different
    stands_out = out == 2
    for top in range(0, height, spacing):
        for left in range(0, width, spacing):
            near = np.s_[max(top - spacing, 0) : top + 2 * spacing, max(left - spacing, 0) : left + 2 * spacing]
            moved = np.count_nonzero(moving[near] & stands_out[near])
            if moved > np.float32(0.8) * np.float32(stands_out[near].sum()):
                block = out[top : top + spacing, left : left + spacing]
                block.clip(0, 1, out=block)
    return out


def way_there_and_back(vector: Array, back: Array, y: int, x: int) -> tuple[float, bool]:
    """How far from pixel (y, x) its vector ends, there and back, and whether it leads to a pixel of the other frame."""
    height, width = back.shape[:2]
    landing_x, landing_y = round(x + float(vector[0])), round(y + float(vector[1]))
    inside = 0 <= landing_x < width and 0 <= landing_y < height
    returning = back[min(max(landing_y, 0), height - 1), min(max(landing_x, 0), width - 1)]
    return math.hypot(*(vector + returning).tolist()), inside


def smaller_change(before: float, after: float) -> float:
    """The minmod limiter."""
    if before * after <= 0:
        return 0.0
    return min(before, after, key=abs)


def luma_and_chroma(image: Array) -> tuple[Array, Array]:
    """Luma by BT.601, and the mean of both differences of colour with 0.5 for gray, of an image with 1 for white.

    Gray, gray and alpha, BGR, or BGR and alpha; both are multiplied by alpha, and 0 is the chroma of gray images.
    """
    *colours, alpha = np.moveaxis(image, 2, 0) if image.shape[2] in {2, 4} else (*np.moveaxis(image, 2, 0), 1.0)
    if len(colours) == 1:
        return colours[0] * alpha, np.zeros(image.shape[:2])
    blue, green, red = colours
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    return luma * alpha, ((0.713 * (red - luma) + 0.564 * (blue - luma)) / 2) * alpha + 0.5


def split_levels(image: Array, white: float, scale: float) -> list[Array]:
    """Luma, and levels of half of it and of chroma, (H, W) each and not rounded; `scale` levels are 1."""
    luma, chroma = luma_and_chroma(image.astype(float) / white)
    return [luma, (luma / 2 * scale).clip(0, 255), (chroma * scale).clip(0, 255)]


def split_codes(planes: list[Array], levels: tuple[float, float, float, float], scale: float) -> list[Array]:
    """The same of a picture in planes; `levels` are black, white less black, gray's chroma, and the range of chroma.

    A sample of chroma belongs to all pixels that it was taken of.
    """
    black, luma_span, neutral, chroma_span = levels
    y, x = (
        np.arange(size) // -(-size // length) for size, length in zip(planes[0].shape, planes[1].shape, strict=True)
    )
    luma = (planes[0].astype(float) - black) / luma_span
    cb, cr = (plane[np.ix_(y, x)].astype(float) for plane in planes[1:])
    chroma = ((cb + cr) / 2 - neutral) / chroma_span + 0.5
    return [luma, (luma / 2 * scale).clip(0, 255), (chroma * scale).clip(0, 255)]


def finished(sums: Array, weights: Array, white: float, lowest: float, highest: float, straight_alpha: bool) -> Array:
    """Weighted sums, (C, rows, width), as the values of an image, not yet rounded.

    Each is divided by its weight, all but the last by the last if alpha was multiplied in, and kept in range.
    """
    values = sums.astype(float) / weights
    if straight_alpha:
        values[:-1] /= np.maximum(values[-1], 1e-6)
    return (values * white).clip(lowest, highest)
