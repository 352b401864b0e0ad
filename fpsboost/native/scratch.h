// Memory for work arrays, which Python makes: kernels allocate none, and stacks of threads are small.
#pragma once
#include "records.h"

namespace {

// Hands out pieces of the memory that a kernel is given. Without any, as in the first of its two calls, it counts what
// the kernel takes, which then returns `size()` before it does anything else.
class Workspace {
  static constexpr uintptr_t LINE = 64;  // of caches, bytes: every piece begins at one
  uintptr_t begin, end, next;

public:
  explicit Workspace(const WorkMemory &block)
      : begin((uintptr_t(block.address) + LINE - 1) / LINE * LINE), end(uintptr_t(block.address + block.size)),
        next(block.address ? begin : LINE) {}
  bool is_counting() const { return !begin; }
  Int size() const { return Int(next); }  // with what may be lost at the beginning
  template <typename T> T *take(Int count) {
    T *piece = reinterpret_cast<T *>(next);
    next += (uintptr_t(count) * sizeof(T) + LINE - 1) / LINE * LINE;
    if (!is_counting() && next > end) __builtin_trap();  // the two calls differ
    return piece;
  }
};

}  // namespace
