// Conversion of floats to whole numbers, also of those that have none.
#pragma once
#include "records.h"

namespace {

// The integer part of a value; of NaN and of what is too large the lowest integer, on every processor.
FORCE_INLINE Int truncate(double value) { return value > -0x1p63 && value < 0x1p63 ? Int(value) : INT64_MIN; }

// The index of an axis that is nearest to a value, half rounded up; 0 for NaN.
FORCE_INLINE int32_t nearest_index(float value, Int size) {
  return int32_t(clamp(__builtin_floorf(value + 0.5f), 0.0f, float(size - 1)));
}

}  // namespace
