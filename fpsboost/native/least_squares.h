// Least squares on windows of two frames (Lucas and Kanade 1981).
#pragma once
#include "plane_pair.h"
#include "vectors.h"

namespace {

constexpr Int WINDOW_SIDE = 8;

typedef int16_t S16 __attribute__((vector_size(32)));
typedef int16_t S8 __attribute__((vector_size(16)));

// A row of a plane around a window: sums and differences of both frames, integers until they are multiplied.
struct Row {
  S16 sum, change;
};

FORCE_INLINE Row read_row(const uint8_t *first, const uint8_t *second) {
  const S16 level0 = __builtin_convertvector(load<B16>(first), S16);
  const S16 level1 = __builtin_convertvector(load<B16>(second), S16);
  return {level0 + level1, level1 - level0};
}

// The columns of the window, moved by -1, 0 or 1 pixel.
FORCE_INLINE S8 left_columns(S16 row) { return __builtin_shufflevector(row, row, 0, 1, 2, 3, 4, 5, 6, 7); }
FORCE_INLINE S8 columns(S16 row) { return __builtin_shufflevector(row, row, 1, 2, 3, 4, 5, 6, 7, 8); }
FORCE_INLINE S8 right_columns(S16 row) { return __builtin_shufflevector(row, row, 2, 3, 4, 5, 6, 7, 8, 9); }
FORCE_INLINE F8 as_floats(S8 words) { return __builtin_convertvector(__builtin_convertvector(words, I8), F8); }

FORCE_INLINE float sum_lanes(F8 values) {
  float four[4];
  for (int i = 0; i < 4; i++) four[i] = values[i] + values[i + 4];
  return (four[0] + four[2]) + (four[1] + four[3]);
}

// Products of the gradients along x and y and of the temporal difference t, in one row or summed over a window.
template <typename V> struct Products {
  V xx, xy, yy, xt, yt, tt;
};

// Sums the products of a window's pixels, each weighted by its similarity, (1 + tail tt)^-4, or all alike. `first` and
// `second` are the pixels above and to the left of the window; gradients are sums of four one-pixel differences: over
// two pixels, in both frames.
template <bool IS_WEIGHTED>
FORCE_INLINE Products<float> window_products(const uint8_t *first, const uint8_t *second, Int stride, Int plane,
                                             float tail) {
  Row above[3], centre[3];
  for (int c = 0; c < 3; c++) {
    above[c] = read_row(first + c * plane, second + c * plane);
    centre[c] = read_row(first + c * plane + stride, second + c * plane + stride);
  }
  Products<F8> total = {};
#pragma clang loop unroll(full)
  for (Int j = 2; j < WINDOW_SIDE + 2; j++) {
    Products<F8> row;
    for (int c = 0; c < 3; c++) {
      const Row below = read_row(first + c * plane + j * stride, second + c * plane + j * stride);
      const F8 x = as_floats(right_columns(centre[c].sum) - left_columns(centre[c].sum));
      const F8 y = as_floats(columns(below.sum) - columns(above[c].sum));
      const F8 t = as_floats(columns(centre[c].change));
      if (c == 0)
        row = {x * x, x * y, y * y, x * t, y * t, t * t};
      else
        row = {fma(x, x, row.xx), fma(x, y, row.xy), fma(y, y, row.yy),
               fma(x, t, row.xt), fma(y, t, row.yt), fma(t, t, row.tt)};
      above[c] = centre[c];
      centre[c] = below;
    }
    if constexpr (IS_WEIGHTED) {
      F8 fall = fma(row.tt, broadcast<F8>(tail), broadcast<F8>(1));
      fall *= fall;
      const F8 weight = 1 / (fall * fall);
      total = {fma(weight, row.xx, total.xx), fma(weight, row.xy, total.xy), fma(weight, row.yy, total.yy),
               fma(weight, row.xt, total.xt), fma(weight, row.yt, total.yt), fma(weight, row.tt, total.tt)};
    } else {
      total = {total.xx + row.xx, total.xy + row.xy, total.yy + row.yy,
               total.xt + row.xt, total.yt + row.yt, total.tt + row.tt};
    }
  }
  return {sum_lanes(total.xx), sum_lanes(total.xy), sum_lanes(total.yy),
          sum_lanes(total.xt), sum_lanes(total.yt), sum_lanes(total.tt)};
}

// The multiples of the gradients that are closest to the temporal difference, of products that are sums over a window;
// `damping` limits them where gradients are small. As gradients were summed over four pixels, these are minus a quarter
// of the step that the second frame takes.
FORCE_INLINE Vector solve(const Products<float> &sums, float damping) {
  const float xx = sums.xx + damping, xy = sums.xy, yy = sums.yy + damping;
  // along a straight edge, rounding could make the determinant zero or negative
  const float determinant = max(xx * yy - xy * xy, damping * (xx + yy) * 0.5f);
  return {(yy * sums.xt - xy * sums.yt) / determinant, (xx * sums.yt - xy * sums.xt) / determinant};
}

}  // namespace
