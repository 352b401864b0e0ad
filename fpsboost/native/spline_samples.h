// Samples of images from the coefficients of their cubic splines, in rows (kernels/spline.py).
#pragma once
#include "vectors.h"

namespace {

constexpr int TAPS = 4;  // coefficients that a sample depends on, along each axis

struct Taps {  // weights of the coefficients around a position
  float across[TAPS], down[TAPS];
};

// Share of the second derivative of the cubic B-spline that is added to it: that of O-MOMS, the kernel of four weights
// with the smallest error (Blu, Thevenaz and Unser 2001, doi:10.1109/83.931101). The prefilter is made for it.
constexpr float SECOND_DERIVATIVE = float(1 / 42.0);
// Part of this share that is left out between two pixels, half-way between two frames: that sharpens, against what the
// mean of both samples softens.
constexpr float SHARPENING = float(2 / 3.0);

// How much samples are sharpened that are mixed at time t: 0 in one of the frames.
FORCE_INLINE float sharpening_at(float t) { return 4 * t * (1 - t) * SHARPENING; }

// With sharpening as without, the spline meets every pixel.
FORCE_INLINE void spline_weights(float fraction, float sharpening, float *weights) {
  const float f = fraction, g = 1 - f, sixth = float(1 / 6.0), two_thirds = float(2 / 3.0);
  const float share = SECOND_DERIVATIVE * (1 - sharpening * 4 * f * g);
  weights[0] = g * (sixth * g * g + share);
  weights[1] = two_thirds - 0.5f * f * f * (2 - f) - share * (2 - 3 * f);
  weights[2] = two_thirds - 0.5f * g * g * (2 - g) - share * (2 - 3 * g);
  weights[3] = f * (sixth * f * f + share);
}

// Writes the weights of a position, which is at least 1, and returns the first of its 4 x 4 coefficients.
FORCE_INLINE const float *find_taps(const float *coefficients, Int stride, float y, float x, float sharpening,
                                    Taps &taps) {
  const Int top = Int(y), left = Int(x);
  spline_weights(x - float(left), sharpening, taps.across);
  spline_weights(y - float(top), sharpening, taps.down);
  return coefficients + (top - 1) * stride + left - 1;
}

FORCE_INLINE float filter(const float *from, const float *weights) {
  float sum = from[0] * weights[0];
  for (int n = 1; n < TAPS; n++) sum = fma(from[n], weights[n], sum);
  return sum;
}

// Samples columns of `tall` samples, from row to row, and calls take(row, samples). The rows of coefficients that are
// filtered horizontally stay in registers. Meanwhile, what is `ahead` values on is fetched.
template <typename V, typename Take>
FORCE_INLINE void sample_columns(const float *from, Int stride, const Taps &taps, Int tall, Int ahead,
                                 const Take &take) {
  V across[TAPS], down[TAPS];
  for (int k = 0; k < TAPS; k++) {
    across[k] = broadcast<V>(taps.across[k]);
    down[k] = broadcast<V>(taps.down[k]);
  }
  const auto filter_row = [&]() INLINE_LAMBDA {
    V sum = load<V>(from) * across[0];
    for (int k = 1; k < TAPS; k++) sum = fma(load<V>(from + k), across[k], sum);
    if (ahead) __builtin_prefetch(from + ahead);
    from += stride;
    return sum;
  };
  V first = filter_row(), second = filter_row(), third = filter_row();
  for (Int j = 0; j < tall; j++) {
    const V fourth = filter_row();
    take(j, fma(fourth, down[3], fma(third, down[2], fma(second, down[1], first * down[0]))));
    first = second;
    second = third;
    third = fourth;
  }
}

}  // namespace
