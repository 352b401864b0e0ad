// Semi-global matching: one label for every node of a lattice, consistent with those of its neighbours.
//
// The cost of a label is aggregated along four paths, from the left, the right, above and below. Along each path, every
// change of motion has a cost, up to a limit (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166, Eq. 13).
#pragma once
#include "scratch.h"
#include "vectors.h"

namespace {

constexpr float MISSING_LABEL_COST = 1e30f;  // of a label that a node does not have
constexpr Int PATHS_AT_ONCE = 4;  // neighbouring paths, on one node of each of which a processor works at a time
constexpr float MAX_FLOAT = 0x1.fffffep127f;

// Labels of a lattice, of at most `capacity` at each node; behind those that a node has, anything may stand.
struct LabelLists {
  const int32_t *count;
  const Vector *motion;
  const float *similarity, *smoothness_weight;
  Int rows, columns, capacity;
};

// The same by component, with room for a multiple of eight labels at every node, and one node more, at which paths
// begin.
struct Lattice {
  Int room;
  float *x, *y, *data_cost, *path_cost, *total;

  Lattice(Int nodes, Int capacity, float *costs, Workspace &workspace) : room((capacity + 7) / 8 * 8), total(costs) {
    const Int size = (nodes + 1) * room;
    x = workspace.take<float>(size);
    y = workspace.take<float>(size);
    data_cost = workspace.take<float>(size);
    path_cost = workspace.take<float>(size);
  }
};

// Extends the cheapest paths to the labels of the node before by the labels of the next one. `path_cost` has the cost
// of the cheapest path to each label, without that of the cheapest of its node.
FORCE_INLINE void aggregate_path_costs(const Lattice &lattice, Int node, Int node_before, float slope, float limit) {
  const Int room = lattice.room, begin = node * room, begin_before = node_before * room;
  F8 lowest = broadcast<F8>(MAX_FLOAT);
  for (Int own = begin; own < begin + room; own += 8) {
    const F8 x = load<F8>(lattice.x + own), y = load<F8>(lattice.y + own);
    F8 cheapest = broadcast<F8>(MAX_FLOAT);
    for (Int others = begin_before; others < begin_before + room; others += 8)
      for (Int other = others; other < others + 8; other++) {
        const F8 change = absolute(x - lattice.x[other]) + absolute(y - lattice.y[other]);
        cheapest = min(lattice.path_cost[other] + min(slope * change, broadcast<F8>(limit)), cheapest);
      }
    const F8 extended = load<F8>(lattice.data_cost + own) + cheapest;
    lowest = min(extended, lowest);
    store(lattice.path_cost + own, extended);
    store(lattice.total + own, load<F8>(lattice.total + own) + extended);
  }
  lowest = min(__builtin_shufflevector(lowest, lowest, 4, 5, 6, 7, 0, 1, 2, 3), lowest);
  lowest = min(__builtin_shufflevector(lowest, lowest, 2, 3, 0, 1, 6, 7, 4, 5), lowest);
  lowest = min(__builtin_shufflevector(lowest, lowest, 1, 0, 3, 2, 5, 4, 7, 6), lowest);
  for (Int own = begin; own < begin + room; own += 8)
    store(lattice.path_cost + own, load<F8>(lattice.path_cost + own) - lowest);
}

FORCE_INLINE void copy_labels(const LabelLists &lists, const Lattice &lattice) {
  const Int nodes = lists.rows * lists.columns, size = (nodes + 1) * lattice.room;
  for (Int i = 0; i < size; i++) {
    lattice.x[i] = lattice.y[i] = lattice.path_cost[i] = 0;
    lattice.data_cost[i] = MISSING_LABEL_COST;
  }
  for (Int i = 0; i < size - lattice.room; i++) lattice.total[i] = 0;
  for (Int node = 0; node < nodes; node++)
    for (Int k = 0; k < lists.count[node]; k++) {
      const Int from = node * lists.capacity + k, to = node * lattice.room + k;
      lattice.x[to] = lists.motion[from].dx;
      lattice.y[to] = lists.motion[from].dy;
      lattice.data_cost[to] = -lists.similarity[from];
    }
}

// Chooses the label of every node with the lowest cost, the first of several; `choose_labels` of
// fpsboost/kernels/level_search.py.
FORCE_INLINE void choose_labels(const LabelLists &lists, float smoothness, float slope, const Lattice &lattice,
                                Vector *flow, float *chosen) {
  const Int rows = lists.rows, columns = lists.columns, nodes = rows * columns, room = lattice.room;
  const float *costs = lattice.total;
  copy_labels(lists, lattice);
  for (int direction = 0; direction < 4; direction++) {
    const bool is_vertical = direction > 1, is_backward = direction % 2;
    const Int sign = is_backward ? -1 : 1, begin = is_backward ? nodes - 1 : 0;
    const Int step = sign * (is_vertical ? columns : 1), aside = sign * (is_vertical ? 1 : columns);
    const Int length = is_vertical ? rows : columns, parallel = is_vertical ? columns : rows;
    for (Int first = 0; first < parallel; first += PATHS_AT_ONCE)
      for (Int n = 0; n < length; n++)
        for (Int path = first; path < min(first + PATHS_AT_ONCE, parallel); path++) {
          const Int node = begin + path * aside + n * step;
          if (n) {
            const float weight = min(lists.smoothness_weight[node], lists.smoothness_weight[node - step]);
            aggregate_path_costs(lattice, node, node - step, weight * slope, weight * smoothness);
          } else {
            // no change has a cost at the first node, which has no predecessor
            aggregate_path_costs(lattice, node, nodes, 0, 0);
          }
        }
  }
  for (Int node = 0; node < nodes; node++) {
    Int best = 0;
    for (Int k = 1; k < lists.count[node]; k++)
      if (costs[node * room + k] < costs[node * room + best]) best = k;
    const Int from = node * lists.capacity + best;
    flow[node] = lists.motion[from];
    chosen[node] = lists.similarity[from];
  }
}

}  // namespace
