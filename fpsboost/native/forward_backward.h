// Forward-backward error of motion: how far from its start a vector and the one at its end lead.
#pragma once
#include "rounding.h"

namespace {

struct RoundTripError {
  float distance;
  bool inside;  // whether the vector ends within the frame
};

// The error of a vector from y, x; `backward` has one vector for `spacing` x `spacing` pixels of the layout, `unit`
// times as long as they count.
FORCE_INLINE RoundTripError forward_backward_error(float dx, float dy, const View<const float, 3> &backward,
                                                   const FieldLayout &layout, Int y, Int x, float unit = 1) {
  const double end_y = __builtin_rint(double(y) + double(dy)), end_x = __builtin_rint(double(x) + double(dx));
  const Int nearest_y = clamp(truncate(end_y), Int(0), layout.height - 1);
  const Int nearest_x = clamp(truncate(end_x), Int(0), layout.width - 1);
  const float *vector = backward.ptr(nearest_y / layout.spacing, nearest_x / layout.spacing);
  const double error_x = double(dx + vector[0] / unit), error_y = double(dy + vector[1] / unit);
  return {float(__builtin_sqrt(error_x * error_x + error_y * error_y)),
          0 <= end_y && end_y < double(layout.height) && 0 <= end_x && end_x < double(layout.width)};
}

}  // namespace
