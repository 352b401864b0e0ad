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

template <typename V>
FORCE_INLINE V filter(const float *from, Int step, const float *weights) {
  V sum = load<V>(from) * weights[0];
  for (int n = 1; n < TAPS; n++) sum = fma(load<V>(from + n * step), broadcast<V>(weights[n]), sum);
  return sum;
}

// Filters rows of `wide` samples horizontally into `rows`, with room for three more than are `tall`, then vertically.
template <typename V>
FORCE_INLINE void filter_rows(const float *from, Int stride, const Taps &taps, Int wide, Int tall, float *rows,
                              float *out, Int out_stride) {
  for (Int j = 0; j < tall + TAPS - 1; j++)
    for (Int i = 0; i < wide; i += lane_count<V>)
      store(rows + j * wide + i, filter<V>(from + j * stride + i, 1, taps.across));
  for (Int j = 0; j < tall; j++)
    for (Int i = 0; i < wide; i += lane_count<V>)
      store(out + j * out_stride + i, filter<V>(rows + j * wide + i, wide, taps.down));
}

}  // namespace
