// Candidate motions of a node, as the arrays of kernels/candidates.py have them.
#pragma once
#include "records.h"

namespace {

constexpr float MIN_GRADIENT = 0.05f, MAX_GRADIENT = 0.5f;  // of a window that is zoomed or turned, pixels per pixel

struct Motion {  // of a candidate, at the centre of its window; gradients are pixels per pixel
  float dx, dy, acceleration_x, acceleration_y, dx_along_x, dy_along_x, dx_along_y, dy_along_y;

  // Whether a window moves as a whole. Below the least gradient, its blocks would move by less than windows overlap
  // anyway; one above the largest is not zoom or rotation, but the boundary of two motions.
  bool is_rigid() const {
    const float gradient = absolute(dx_along_x) + absolute(dy_along_x) + absolute(dx_along_y) + absolute(dy_along_y);
    return gradient < MIN_GRADIENT || gradient > MAX_GRADIENT;
  }
};
static_assert(sizeof(Motion) == VALUES_PER_MOTION * sizeof(float));

struct NodeCandidates {  // of one node
  Int count;
  const Motion *motions;
  const float *priors;

  NodeCandidates(const Candidates &all, Int row, Int column)
      : count(View<const int32_t, 2>(all.listed)(row, column)),
        motions(as<const Motion *>(View<const float, 4>(all.motions).ptr(row, column))),
        priors(View<const float, 3>(all.weights).ptr(row, column)) {}
};

}  // namespace
