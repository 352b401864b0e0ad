// Vectors of points several pixels apart: forward-backward consistency, gradients and accelerations.
#include "forward_backward.h"

namespace {

// The smaller in magnitude of two numbers of the same sign, else 0; without branches, which could not be predicted.
FORCE_INLINE float minmod(float before, float after) {
  return max(min(before, after), 0.0f) + min(max(before, after), 0.0f);
}

}  // namespace

KERNEL(void, find_gradients, const FindGradients &args) {
  const View<const float, 3> vectors(args.vectors);
  const View<float, 4> gradients(args.gradients);
  const Int rows = vectors.shape[0], columns = vectors.shape[1];
  const float spacing = args.spacing;
  for (Int i = 0; i < rows; i++)
    for (Int j = 0; j < columns; j++)
      for (Int axis = 0; axis < 2; axis++) {
        const float centre = vectors(i, j, axis);
        float along_x = 0, along_y = 0;
        if (0 < j && j < columns - 1)
          along_x = minmod((centre - vectors(i, j - 1, axis)) / spacing, (vectors(i, j + 1, axis) - centre) / spacing);
        if (0 < i && i < rows - 1)
          along_y = minmod((centre - vectors(i - 1, j, axis)) / spacing, (vectors(i + 1, j, axis) - centre) / spacing);
        gradients(i, j, 0, axis) = along_x;
        gradients(i, j, 1, axis) = along_y;
      }
}

KERNEL(void, measure_forward_backward_errors, const MeasureForwardBackwardErrors &args) {
  const View<const float, 3> vectors(args.vectors), back(args.back);
  const View<const Int, 1> y(args.y), x(args.x);
  const View<float, 2> distance(args.distance);
  const FieldLayout layout{args.spacing, args.height, args.width};
  for (Int i = 0; i < y.shape[0]; i++)
    for (Int j = 0; j < x.shape[0]; j++)
      distance(i, j) = forward_backward_error(vectors(i, j, 0), vectors(i, j, 1), back, layout, y(i), x(j)).distance;
}

KERNEL(void, find_accelerations, const FindAccelerations &args) {
  const View<const float, 3> forward(args.onward.forward), backward(args.onward.backward);
  const View<const float, 3> far_forward(args.away.forward), far_backward(args.away.backward);
  const View<const Int, 1> y(args.y), x(args.x);
  const View<float, 3> changes(args.changes);
  // x(1) = v + a / 2 and x(-r) = -r v + r^2 a / 2
  const float duration = float(args.ratio), factor = float(2 / (args.ratio + args.ratio * args.ratio));
  const float consistent = args.consistent;
  for (Int i = 0; i < y.shape[0]; i++)
    for (Int j = 0; j < x.shape[0]; j++) {
      const Int row = y(i) / args.layout.spacing, column = x(j) / args.layout.spacing;
      const float *onward = forward.ptr(row, column), *far = far_forward.ptr(row, column);
      const RoundTripError near_error = forward_backward_error(onward[0], onward[1], backward, args.layout, y(i), x(j));
      const RoundTripError far_error = forward_backward_error(far[0], far[1], far_backward, args.layout, y(i), x(j));
      float *change = changes.ptr(i, j);
      change[0] = change[1] = change[2] = 0;
      if (near_error.inside && far_error.inside && near_error.distance <= consistent &&
          far_error.distance <= consistent) {
        change[0] = 1;
        change[1] = (onward[0] * duration + far[0]) * factor;
        change[2] = (onward[1] * duration + far[1]) * factor;
      }
    }
}
