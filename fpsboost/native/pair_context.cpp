// Context of a pair for the learnt weights: how many points land where, and how far neighbouring nodes agree.
//
// A node alone cannot tell which motion is right where texture is weak. Each candidate is therefore compared with those
// that its neighbours believe in, by their votes and by the luma around them.
#include "fusion_features.h"

namespace {

constexpr int SIDE = 8, AREA = SIDE * SIDE;  // samples of luma around a node that are compared

// How alike the luma of both frames is around a node along a candidate, 0 to 1.
float compare_luma(Int top, Int left, const Motion &motion, float t, const PairContext &context) {
  alignas(64) float samples[2][AREA];
  for (int n = 0; n < 2; n++) {
    const float time = float(n);
    const View<const float, 2> luma(context.luma[1 + n]);
    const Position position = locate_luma(top, left, time, motion, t, context);
    filter_blocks(luma.data, luma.shape[0], luma.shape[1], position, time - t, 0, motion, SIDE, SIDE, samples[n]);
  }
  F16 alike{};
  for (int i = 0; i < AREA; i += 16) {
    const F16 difference = load<F16>(samples[0] + i) - load<F16>(samples[1] + i);
    alike += decay(difference * difference, 0, context.luma_scale, 1.f / AREA);
  }
  return sum_lanes(alike);
}

// Writes the belief in each candidate of a node, with a sum of 1.
void find_beliefs(Int row, Int column, const Candidates &candidates, const PairContext &context, float t,
                  float *beliefs) {
  const NodeCandidates node(candidates, row, column);
  const Int before = candidates.spacing / 2 - SIDE;
  const Int top = row * candidates.spacing + before, left = column * candidates.spacing + before;
  float total = 0;
  for (Int k = 0; k < node.count; k++) {
    beliefs[k] = node.priors[k];
    if (beliefs[k] > 0 && node.count > 1) {
      const float alike = compare_luma(top, left, node.motions[k], t, context);
      beliefs[k] *= float(__builtin_exp(double(context.sharpness * (alike - 1))));
    }
    total += beliefs[k];
  }
  for (Int k = 0; k < node.count; k++) beliefs[k] /= max(total, 1e-20f);
}

// How far the neighbours of a node agree with motions, 0 to 1: their beliefs, less for a motion that differs.
F16 agreement(Int row, Int column, F16 dx, F16 dy, const Candidates &candidates, const View<float, 3> &beliefs) {
  F16 total{};
  float nodes = 0;
  for (Int y = max(row - 1, Int(0)); y < min(row + 2, beliefs.shape[0]); y++)
    for (Int x = max(column - 1, Int(0)); x < min(column + 2, beliefs.shape[1]); x++) {
      if (y == row && x == column) continue;
      const NodeCandidates node(candidates, y, x);
      nodes += 1;
      for (Int k = 0; k < node.count; k++) {
        const Motion &other = node.motions[k];
        total += beliefs(y, x, k) / (1 + max(absolute(other.dx - dx), absolute(other.dy - dy)));
      }
    }
  return total / max(nodes, 1.f);
}

}  // namespace

// Counts how many points of a frame land around each point of the in-between frame.
KERNEL(void, count_landings, const CountLandings &args) {
  const View<const float, 3> points(args.points);
  const View<float, 2> landings(args.landings);
  const Int rows = landings.shape[0], columns = landings.shape[1];
  const float t = args.t, step = float(args.step), limit = 2;
  for (Int i = 0; i < rows * columns; i++) landings.data[i] = 0;
  for (Int i = 0; i < rows; i++)
    for (Int j = 0; j < columns; j++) {
      const float x = float(j) + t * points(i, j, 0) / step, y = float(i) + t * points(i, j, 1) / step;
      const Int left = Int(__builtin_floorf(x)), top = Int(__builtin_floorf(y));
      for (Int row = max(top, Int(0)); row < min(top + 2, rows); row++)
        for (Int column = max(left, Int(0)); column < min(left + 2, columns); column++) {
          const float share = (1 - absolute(x - float(column))) * (1 - absolute(y - float(row)));
          landings(row, column) = min(landings(row, column) + share, limit);
        }
    }
}

KERNEL(Int, measure_support, const MeasureSupport &args) {
  const View<float, 3> support(args.support);
  const Int rows = support.shape[0], columns = support.shape[1];
  Workspace workspace(args.scratch);
  View<float, 3> beliefs = support;
  beliefs.data = workspace.take<float>(rows * columns * support.shape[2]);
  if (workspace.is_counting()) return workspace.size();
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++)
      find_beliefs(row, column, args.candidates, args.context, args.t, beliefs.ptr(row, column));
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++) {
      const NodeCandidates node(args.candidates, row, column);
      for (Int first = 0; first < node.count; first += 16) {
        F16 dx{}, dy{};
        const Int count = min(node.count - first, Int(16));
        for (Int k = 0; k < count; k++) {
          dx[k] = node.motions[first + k].dx;
          dy[k] = node.motions[first + k].dy;
        }
        const F16 found = agreement(row, column, dx, dy, args.candidates, beliefs);
        for (Int k = 0; k < count; k++) support(row, column, first + k) = found[k];
      }
    }
  return 0;
}
