// Two frames as the searches compare them: three planes each, with edges repeated.
#pragma once
#include "records.h"

namespace {

// Planes of two frames. Places are indices of pixels in the first plane; those of the same pixel are `plane` apart.
template <typename T> struct Frames {
  const T *first, *second;
  Int plane, stride, rows, padding, height, width, max_similarity;

  explicit Frames(const PlanePair &pair)
      : first(as<const T *>(pair.planes0.data)), second(as<const T *>(pair.planes1.data)),
        plane(pair.planes0.shape[1] * pair.planes0.shape[2]), stride(pair.planes0.shape[2]),
        rows(pair.planes0.shape[1]), padding(pair.padding), height(pair.height), width(pair.width),
        max_similarity(pair.max_similarity) {}

  Int place(Int y, Int x) const { return (y + padding) * stride + x + padding; }

  // Whether the patch around a pixel, which may lie outside the frame, is inside.
  bool holds_patch(Int y, Int x, Int radius) const {
    return min(y, x) >= radius && y < height - radius && x < width - radius;
  }

  // The pair from frame 1 to frame 0.
  Frames opposite() const {
    Frames other = *this;
    other.first = second;
    other.second = first;
    return other;
  }
};

// Centre of one of the points `step` pixels apart along an axis, which may lie at the edge of the frame.
FORCE_INLINE Int point_centre(Int point, Int step, Int size) { return min(point * step + step / 2, size - 1); }

}  // namespace
