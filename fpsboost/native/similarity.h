// Similarity of sixteen pairs of pixels: a linear form on bytes, and the report's exponential (section 3.2, Eqs. 3, 4).
#pragma once
#include "vectors.h"

namespace {

FORCE_INLINE U16 as_words(B16 bytes) { return __builtin_convertvector(bytes, U16); }
FORCE_INLINE W32 as_words(B32 bytes) { return __builtin_convertvector(bytes, W32); }

// Adds the absolute differences of bytes to sums, which stop at 255.
template <typename V> FORCE_INLINE void add_difference(V first, V second, V &sum) {
  const V difference = max(first, second) - min(first, second);
  sum += min(difference, ~sum);
}

FORCE_INLINE B16 broadcast_byte(uint8_t value) { return value - B16{}; }

// The largest similarity less the sum of absolute differences, 0 at the least, of all lanes. `pixels` are the three
// components, those of the others begin at `second`, `plane` apart.
template <typename V>
FORCE_INLINE V byte_similarity(const V (&pixels)[3], const uint8_t *second, Int plane, V max_similarity) {
  V sum{};
  for (int c = 0; c < 3; c++) add_difference(pixels[c], load<V>(second + c * plane), sum);
  return max(max_similarity, sum) - sum;
}

// The same of sixteen pixels, as words.
FORCE_INLINE U16 linear_similarity(const B16 (&pixels)[3], const uint8_t *second, Int plane, B16 max_similarity) {
  return as_words(byte_similarity(pixels, second, plane, max_similarity));
}

// Polynomial that approximates 2^20 times 2^-f for a fraction f: Chebyshev's interpolation of degree 5 on [0, 1], with
// a half added to the constant, so that truncation rounds.
constexpr float POWER[] = {0x1.000008p+20f, -0x1.62e3a8p+19f, 0x1.ebe2f2p+17f,
                           -0x1.c5009p+15f, 0x1.2dc434p+13f,  -0x1.f06faep+9f};

// 2^20 times 2^-s for the sum s of three squared differences, of `COUNT` times sixteen pairs of pixels, whose
// components are `plane` apart: integers, whose sums are exact in any order. Several vectors are computed together,
// since each instruction waits for the one before.
template <int COUNT>
FORCE_INLINE void exponential_similarity(const float *first, Int plane0, const float *second, Int plane1,
                                         I16 (&similarity)[COUNT]) {
  F16 squares[COUNT], power[COUNT];
  for (int n = 0; n < COUNT; n++)
    for (int c = 0; c < 3; c++) {
      const F16 difference = load<F16>(first + c * plane0 + 16 * n) - load<F16>(second + c * plane1 + 16 * n);
      squares[n] = c ? fma(difference, difference, squares[n]) : difference * difference;
    }
  I16 integer[COUNT];
  for (int n = 0; n < COUNT; n++) {
    squares[n] = min(squares[n], broadcast<F16>(FRACTION_BITS + 1));
    integer[n] = __builtin_convertvector(squares[n], I16);
    squares[n] -= __builtin_convertvector(integer[n], F16);
    power[n] = broadcast<F16>(POWER[5]);
  }
  for (int k = 4; k >= 0; k--)
    for (int n = 0; n < COUNT; n++) power[n] = fma(power[n], squares[n], broadcast<F16>(POWER[k]));
  for (int n = 0; n < COUNT; n++) similarity[n] = __builtin_convertvector(power[n], I16) >> integer[n];
}

}  // namespace
