// Semi-global matching: one label for every node of a lattice, consistent with those of its neighbours.
//
// The cost of a label is aggregated along four paths, from the left, the right, above and below. Along each path, every
// change of motion has a cost, up to a limit (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166, Eq. 13).
#pragma once
#include "scratch.h"
#include "vectors.h"

namespace {

constexpr float MISSING_LABEL_COST = 1e30f;  // of a label that a node does not have
constexpr float MAX_FLOAT = 0x1.fffffep127f;

// Labels of a lattice, of at most `capacity` at each node; behind those that a node has, anything may stand.
struct LabelLists {
  const int32_t *count;
  const Vector *motion;
  const float *similarity, *smoothness_weight;
  Int rows, columns, capacity;
};

constexpr Int ROWS_AT_ONCE = 2;  // with two paths along each, so that a processor works on four nodes at a time

// The same by component, with room for a multiple of eight labels at every node. The costs of paths are kept for the
// last two nodes of each: of the four along rows, and of those along columns. `start` is where they begin.
struct Lattice {
  Int room;
  float *x, *y, *data_cost, *total, *along_rows, *along_columns, *start;

  Lattice(Int nodes, Int columns, Int capacity, float *costs, Workspace &workspace)
      : room((capacity + 7) / 8 * 8), total(costs) {
    x = workspace.take<float>(nodes * room);
    y = workspace.take<float>(nodes * room);
    data_cost = workspace.take<float>(nodes * room);
    along_rows = workspace.take<float>(2 * 2 * ROWS_AT_ONCE * room);
    along_columns = workspace.take<float>(2 * columns * room);
    start = workspace.take<float>(room);
  }
};

// Extends the cheapest paths to the labels of the node before, `path_before`, by the labels of the next one. Costs of
// paths are without that of the cheapest of their node, so that a change costs the limit at most.
template <Int ROOM>
FORCE_INLINE void aggregate_path_costs(const Lattice &lattice, Int node, Int node_before, float slope, float limit,
                                       const float *path_before, float *path) {
  const Int room = ROOM ? ROOM : lattice.room, begin = node * room;
  const float *x_before = lattice.x + node_before * room, *y_before = lattice.y + node_before * room;
  F8 lowest = broadcast<F8>(MAX_FLOAT);
  for (Int own = 0; own < room; own += 8) {
    const F8 x = load<F8>(lattice.x + begin + own), y = load<F8>(lattice.y + begin + own);
    F8 cheapest = broadcast<F8>(limit);
    for (Int others = 0; others < room; others += 8)
      for (Int other = others; other < others + 8; other++) {
        const F8 change = absolute(x - x_before[other]) + absolute(y - y_before[other]);
        cheapest = min(path_before[other] + slope * change, cheapest);
      }
    const F8 extended = load<F8>(lattice.data_cost + begin + own) + cheapest;
    lowest = min(extended, lowest);
    store(path + own, extended);
    store(lattice.total + begin + own, load<F8>(lattice.total + begin + own) + extended);
  }
  lowest = min(__builtin_shufflevector(lowest, lowest, 4, 5, 6, 7, 0, 1, 2, 3), lowest);
  lowest = min(__builtin_shufflevector(lowest, lowest, 2, 3, 0, 1, 6, 7, 4, 5), lowest);
  lowest = min(__builtin_shufflevector(lowest, lowest, 1, 0, 3, 2, 5, 4, 7, 6), lowest);
  for (Int own = 0; own < room; own += 8) store(path + own, load<F8>(path + own) - lowest);
}

FORCE_INLINE void copy_labels(const LabelLists &lists, const Lattice &lattice, Int first, Int end) {
  const Int room = lattice.room, capacity = lists.capacity;
  for (Int i = first * room; i < end * room; i++) lattice.total[i] = 0;
  for (Int node = first; node < end; node++)
    for (Int k = 0; k < room; k++) {
      const Int from = node * capacity + k, to = node * room + k;
      const bool is_listed = k < lists.count[node];
      lattice.x[to] = is_listed ? lists.motion[from].dx : 0.0f;
      lattice.y[to] = is_listed ? lists.motion[from].dy : 0.0f;
      lattice.data_cost[to] = is_listed ? -lists.similarity[from] : MISSING_LABEL_COST;
    }
}

// Chooses the label of every node with the lowest cost, the first of several; `choose_labels` of
// fpsboost/kernels/level_search.py.
template <Int ROOM>
void choose_labels_of(const LabelLists &lists, float smoothness, float slope, const Lattice &lattice, Vector *flow,
                      float *chosen) {
  const Int rows = lists.rows, columns = lists.columns, room = ROOM ? ROOM : lattice.room;
  for (Int i = 0; i < room; i++) lattice.start[i] = 0;
  // extends a path to a node, from one that is `step` nodes before it; `paths` are those of its last two nodes
  const auto extend = [&](Int node, Int step, Int number, float *paths, Int apart) INLINE_LAMBDA {
    float *path = paths + number % 2 * apart;
    if (number) {
      const float weight = min(lists.smoothness_weight[node], lists.smoothness_weight[node - step]);
      aggregate_path_costs<ROOM>(lattice, node, node - step, weight * slope, weight * smoothness,
                                 paths + (number - 1) % 2 * apart, path);
    } else {
      aggregate_path_costs<ROOM>(lattice, node, node, 0, 0, lattice.start, path);  // no change has a cost
    }
  };
  const auto extend_along_columns = [&](Int row, Int step, Int number) INLINE_LAMBDA {
    for (Int column = 0; column < columns; column++)
      extend(row * columns + column, step, number, lattice.along_columns + column * room, columns * room);
  };
  for (Int first = 0; first < rows; first += ROWS_AT_ONCE) {
    const Int end = min(first + ROWS_AT_ONCE, rows);
    copy_labels(lists, lattice, first * columns, end * columns);
    for (Int column = 0; column < columns; column++)
      for (Int row = first; row < end; row++) {
        float *paths = lattice.along_rows + (row - first) * 4 * room;
        extend(row * columns + column, 1, column, paths, room);
        extend(row * columns + columns - 1 - column, -1, column, paths + 2 * room, room);
      }
    for (Int row = first; row < end; row++) extend_along_columns(row, columns, row);
  }
  for (Int row = rows - 1; row >= 0; row--) {
    extend_along_columns(row, -columns, rows - 1 - row);
    for (Int node = row * columns; node < (row + 1) * columns; node++) {
      const float *costs = lattice.total + node * room;
      Int best = 0;
      for (Int k = 1; k < lists.count[node]; k++)
        if (costs[k] < costs[best]) best = k;
      const Int from = node * lists.capacity + best;
      flow[node] = lists.motion[from];
      chosen[node] = lists.similarity[from];
    }
  }
}

FORCE_INLINE void choose_labels(const LabelLists &lists, float smoothness, float slope, const Lattice &lattice,
                                Vector *flow, float *chosen) {
  (lattice.room == 8 ? choose_labels_of<8> : choose_labels_of<0>)(lists, smoothness, slope, lattice, flow, chosen);
}

}  // namespace
