// Vectors of sixteen and eight floats. Each level makes of them what it has: one register, or two, or four.
//
// The order of every sum is written out, and `fma` stands where one is meant, so that all levels give the same bits.
#pragma once
#include "records.h"

namespace {

typedef float F16 __attribute__((vector_size(64)));
typedef float F8 __attribute__((vector_size(32)));
typedef float F4 __attribute__((vector_size(16)));
typedef int32_t I16 __attribute__((vector_size(64)));
typedef int32_t I8 __attribute__((vector_size(32)));
typedef uint32_t U32 __attribute__((vector_size(64)));
typedef uint16_t U16 __attribute__((vector_size(32)));
typedef uint8_t B16 __attribute__((vector_size(16)));
typedef uint8_t B32 __attribute__((vector_size(32)));
typedef uint16_t W32 __attribute__((vector_size(64)));
typedef uint64_t L8 __attribute__((vector_size(64)));
typedef uint64_t L4 __attribute__((vector_size(32)));

template <typename V> constexpr int lane_count = sizeof(V) / sizeof(float);

// Vectors in arrays need not be aligned.
template <typename V, typename T> FORCE_INLINE V load(const T *from) {
  V values;
  __builtin_memcpy(&values, from, sizeof values);
  return values;
}
template <typename V, typename T> FORCE_INLINE void store(T *to, V values) {
  __builtin_memcpy(to, &values, sizeof values);
}
FORCE_INLINE B32 join(B16 first, B16 second) {
  return __builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19,
                                 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31);
}
template <typename V> FORCE_INLINE V broadcast(float value) { return value - V{}; }

// a * b + c, rounded once.
#if defined(__FMA__) || defined(__aarch64__)
FORCE_INLINE float fma(float a, float b, float c) { return __builtin_fmaf(a, b, c); }
#if defined(__clang__)
template <typename V> FORCE_INLINE V fma(V a, V b, V c) { return __builtin_elementwise_fma(a, b, c); }
#endif
#else
// Without the instruction. The product is exact in double precision; the sum is rounded to odd there, after which
// rounding to single precision gives what rounding once does (Boldo and Melquiond 2008, doi:10.1109/TC.2007.70819,
// theorem 1).
FORCE_INLINE float fma(float a, float b, float c) {
  const double product = double(a) * double(b), sum = product + double(c), part = sum - product;
  const double error = (product - (sum - part)) + (double(c) - part);
  int64_t bits;
  __builtin_memcpy(&bits, &sum, sizeof bits);
  const bool is_inexact = error > 0 || error < 0;  // an infinite sum has no error that is a number
  if (is_inexact && !(bits & 1)) bits += (error > 0) == (sum > 0) ? 1 : -1;
  double odd;
  __builtin_memcpy(&odd, &bits, sizeof odd);
  return float(odd);
}
#endif
#if !(defined(__FMA__) || defined(__aarch64__))
// The same for vectors, four lanes at a time.
typedef double D4 __attribute__((vector_size(32)));
typedef int64_t I4 __attribute__((vector_size(32)));
template <typename V> FORCE_INLINE V fma(V a, V b, V c) {
  V result;
  for (int i = 0; i < lane_count<V>; i += 4) {
    F4 values[3];
    __builtin_memcpy(&values[0], as<const float *>(&a) + i, sizeof(F4));
    __builtin_memcpy(&values[1], as<const float *>(&b) + i, sizeof(F4));
    __builtin_memcpy(&values[2], as<const float *>(&c) + i, sizeof(F4));
    const D4 product = __builtin_convertvector(values[0], D4) * __builtin_convertvector(values[1], D4), none = {};
    const D4 added = __builtin_convertvector(values[2], D4), sum = product + added, part = sum - product;
    const D4 error = (product - (sum - part)) + (added - part);
    const I4 bits = as<I4>(sum), above = as<I4>(error > none), below = as<I4>(error < none);
    const I4 is_even = (bits & 1) - 1, grows = ~(above ^ as<I4>(sum > none));  // all ones where it holds, else zero
    const D4 odd = as<D4>(bits + (((grows & 1) | ~grows) & (above | below) & is_even));
    const F4 rounded = __builtin_convertvector(odd, F4);
    __builtin_memcpy(as<float *>(&result) + i, &rounded, sizeof(F4));
  }
  return result;
}
#elif !defined(__clang__)
template <typename V> FORCE_INLINE V fma(V a, V b, V c) {
  for (int i = 0; i < lane_count<V>; i++) c[i] = fma(a[i], b[i], c[i]);
  return c;
}
#endif

FORCE_INLINE F8 absolute(F8 a) { return as<F8>(as<I8>(a) & 0x7fffffff); }
FORCE_INLINE F16 absolute(F16 a) { return as<F16>(as<I16>(a) & 0x7fffffff); }

// Whether any bit of a mask of 32 bytes is set.
template <typename V> FORCE_INLINE bool any(V mask) {
  const L4 parts = as<L4>(mask);
  return (parts[0] | parts[1] | parts[2] | parts[3]) != 0;
}

}  // namespace
