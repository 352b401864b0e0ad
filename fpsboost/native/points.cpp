// Vectors of points several pixels apart: forward-backward consistency, gradients and accelerations.
#include "rounding.h"

namespace {

// The smaller in magnitude of two numbers of the same sign, else 0; without branches, which could not be predicted.
INLINE float minmod(float before, float after) {
  return most(least(before, after), 0.0f) + least(most(before, after), 0.0f);
}

// How far from its start the vector of a pixel ends on the way there and back, and whether it leads into the frame.
struct VectorError {
  float distance;
  bool inside;
};

INLINE VectorError find_vector_error(float dx, float dy, const View<const float, 3> &back, const FieldLayout &layout,
                                     Int y, Int x) {
  const double landing_y = __builtin_rint(double(y) + double(dy)), landing_x = __builtin_rint(double(x) + double(dx));
  const Int nearest_y = within(whole(landing_y), Int(0), layout.height - 1);
  const Int nearest_x = within(whole(landing_x), Int(0), layout.width - 1);
  const float *vector = back.at(nearest_y / layout.spacing, nearest_x / layout.spacing);
  const double apart_x = double(dx + vector[0]), apart_y = double(dy + vector[1]);
  return {float(__builtin_sqrt(apart_x * apart_x + apart_y * apart_y)),
          0 <= landing_y && landing_y < double(layout.height) && 0 <= landing_x && landing_x < double(layout.width)};
}

}  // namespace

KERNEL(void, find_gradients, FindGradients) {
  const View<const float, 3> vectors(a.vectors);
  const View<float, 4> gradients(a.gradients);
  const Int rows = vectors.shape[0], columns = vectors.shape[1];
  const float spacing = float(a.spacing);
  for (Int i = 0; i < rows; i++)
    for (Int j = 0; j < columns; j++)
      for (Int axis = 0; axis < 2; axis++) {
        const float here = vectors(i, j, axis);
        float along_x = 0, along_y = 0;
        if (0 < j && j < columns - 1)
          along_x = minmod((here - vectors(i, j - 1, axis)) / spacing, (vectors(i, j + 1, axis) - here) / spacing);
        if (0 < i && i < rows - 1)
          along_y = minmod((here - vectors(i - 1, j, axis)) / spacing, (vectors(i + 1, j, axis) - here) / spacing);
        gradients(i, j, 0, axis) = along_x;
        gradients(i, j, 1, axis) = along_y;
      }
}

KERNEL(void, measure_forward_backward_errors, MeasureForwardBackwardErrors) {
  const View<const float, 3> vectors(a.vectors), back(a.back);
  const View<const Int, 1> y(a.y), x(a.x);
  const View<float, 2> distance(a.distance);
  const FieldLayout layout{a.spacing, a.height, a.width};
  for (Int i = 0; i < y.shape[0]; i++)
    for (Int j = 0; j < x.shape[0]; j++)
      distance(i, j) = find_vector_error(vectors(i, j, 0), vectors(i, j, 1), back, layout, y(i), x(j)).distance;
}

KERNEL(void, find_accelerations, FindAccelerations) {
  const View<const float, 3> there(a.onward.there), back(a.onward.back);
  const View<const float, 3> far_there(a.away.there), far_back(a.away.back);
  const View<const Int, 1> y(a.y), x(a.x);
  const View<float, 3> changes(a.changes);
  // x(1) = v + a / 2 and x(-r) = -r v + r^2 a / 2
  const float duration = float(a.ratio), factor = float(2 / (a.ratio + a.ratio * a.ratio));
  const float consistent = float(a.consistent);
  for (Int i = 0; i < y.shape[0]; i++)
    for (Int j = 0; j < x.shape[0]; j++) {
      const Int row = y(i) / a.layout.spacing, column = x(j) / a.layout.spacing;
      const float *onward = there.at(row, column), *far = far_there.at(row, column);
      const VectorError near_error = find_vector_error(onward[0], onward[1], back, a.layout, y(i), x(j));
      const VectorError far_error = find_vector_error(far[0], far[1], far_back, a.layout, y(i), x(j));
      float *change = changes.at(i, j);
      change[0] = change[1] = change[2] = 0;
      if (near_error.inside && far_error.inside && near_error.distance <= consistent &&
          far_error.distance <= consistent) {
        change[0] = 1;
        change[1] = (onward[0] * duration + far[0]) * factor;
        change[2] = (onward[1] * duration + far[1]) * factor;
      }
    }
}
