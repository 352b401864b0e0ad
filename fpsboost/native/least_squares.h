// Least squares on windows of two frames (Lucas and Kanade 1981).
#pragma once
#include "plane_pair.h"
#include "vectors.h"

namespace {

constexpr Int WINDOW_SIDE = 8;

typedef uint8_t B8 __attribute__((vector_size(8)));

FORCE_INLINE I8 read_levels(const uint8_t *row) { return __builtin_convertvector(load<B8>(row), I8); }
FORCE_INLINE F8 as_floats(I8 values) { return __builtin_convertvector(values, F8); }

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
  I8 above[3], centre[3];  // sums of both frames, integers until they are multiplied
  for (int c = 0; c < 3; c++) {
    const Int place = c * plane + 1;
    above[c] = read_levels(first + place) + read_levels(second + place);
    centre[c] = read_levels(first + place + stride) + read_levels(second + place + stride);
  }
  Products<F8> total = {};
#pragma clang loop unroll(full)
  for (Int j = 1; j <= WINDOW_SIDE; j++) {
    Products<F8> row;
    for (int c = 0; c < 3; c++) {
      const uint8_t *left0 = first + c * plane + j * stride, *left1 = second + c * plane + j * stride;
      const I8 below = read_levels(left0 + stride + 1) + read_levels(left1 + stride + 1);
      const F8 x = as_floats(read_levels(left0 + 2) + read_levels(left1 + 2) - read_levels(left0) - read_levels(left1));
      const F8 y = as_floats(below - above[c]);
      const F8 t = as_floats(read_levels(left1 + 1) - read_levels(left0 + 1));
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
