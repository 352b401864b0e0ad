// The candidate motion with the largest weight at each pixel of an in-between frame (winner-take-all).
//
// For values that must not be averaged, such as object numbers. Candidates are weighed plainly, but the weights of a
// motion that several nodes list are not added up.
#include "pixel_weights.h"

namespace {

// Writes where a window's pixels lie in both frames along a motion, wherever its weight is the largest so far.
void keep_heavier(const float *weight, const Motion &motion, float t, Int top, Int left, const View<float, 2> &weights,
                  const View<float, 3> &places) {
  const Int height = weights.shape[0], width = weights.shape[1];
  const float curve = t * (1 - t) * 0.5f, centre = (WINDOW - 1) * 0.5f, turns = motion.is_rigid() ? 0 : 1;
  const Int begin = most(-left, Int(0)), end = least(width - left, Int(WINDOW));
  for (Int j = most(-top, Int(0)); j < least(height - top, Int(WINDOW)); j++) {
    const Int y = top + j, at = y * width + left, plane = height * width;
    const float v = (float(j) - centre) * turns, *__restrict new_weight = weight + j * WINDOW;
    float *__restrict largest = weights.data, *__restrict x0 = places.data, *__restrict y0 = x0 + plane;
    float *__restrict x1 = y0 + plane, *__restrict y1 = x1 + plane;
    for (Int i = begin; i < end; i++) {  // all are written, so that this needs no branch
      const float u = (float(i) - centre) * turns;
      const float dx = motion.dx + u * motion.dx_along_x + v * motion.dx_along_y;
      const float dy = motion.dy + u * motion.dy_along_x + v * motion.dy_along_y;
      const float column = float(left + i) + curve * motion.acceleration_x - t * dx;
      const float row = float(y) + curve * motion.acceleration_y - t * dy;
      const bool heavier = new_weight[i] > largest[at + i];
      largest[at + i] = heavier ? new_weight[i] : largest[at + i];
      x0[at + i] = heavier ? column : x0[at + i];
      y0[at + i] = heavier ? row : y0[at + i];
      x1[at + i] = heavier ? column + dx : x1[at + i];
      y1[at + i] = heavier ? row + dy : y1[at + i];
    }
  }
}

}  // namespace

KERNEL(Int, find_dominant_motion, FindDominantMotion) {
  Workspace workspace(a.scratch);
  LayerSamples layer(a.layer, 0, 0, workspace);
  if (workspace.is_counting()) return workspace.size();
  CandidateWeights candidate;
  NodeSums sums;
  const View<const int32_t, 2> listed(a.candidates.listed);
  const View<float, 2> weights(a.weights);
  const View<float, 3> places(a.places);
  const float *shape = (const float *)a.weighting.window_shape.data, t = float(a.t);
  const Int spacing = a.candidates.spacing, before = (WINDOW - spacing) / 2;
  for (Int row = 0; row < listed.shape[0]; row++)
    for (Int column = 0; column < listed.shape[1]; column++)
      weigh_candidates(row, column, a.candidates, t, a.weighting, nullptr, layer, nullptr, candidate, sums,
                       [&](Int, const Motion &motion) {
                         alignas(64) float squares[SQUARES_PER_WINDOW], pixels[WINDOW * WINDOW];
                         for (int i = 0; i < SQUARES_PER_WINDOW; i++) squares[i] = candidate.weight[i] * shape[i];
                         upsample_squares(squares, 1, 1, pixels);
                         keep_heavier(pixels, motion, t, row * spacing - before, column * spacing - before, weights,
                                      places);
                       });
  return 0;
}
