// Memory for work arrays, which Python makes: kernels allocate none, and stacks of threads are small.
#pragma once
#include "arrays.h"

namespace {

// Hands out the pieces of a block that `scratch_of` of fpsboost/kernels/binding.py has made for them, in any order.
struct Scratch {
  uint8_t *next;

  explicit Scratch(const Array &block) : next((uint8_t *)block.data) { next += -(uintptr_t)next % ALIGNMENT; }
  template <typename T> T *take(Int count) {
    T *piece = (T *)next;
    next += (count * Int(sizeof(T)) + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    return piece;
  }

private:
  static constexpr Int ALIGNMENT = 64;  // of cache lines
};

}  // namespace
