// Windows as 2x2 blocks of pixels, sixteen in a row: each has one weight, as weights are means over patches.
#pragma once
#include "window_samples.h"

namespace {

// part * exp(-x), accurate to a millionth; x = offset + factor * value, from 0 to 60. A polynomial of x / 64 to the
// 64th.
FORCE_INLINE F16 decay(F16 value, float offset, float factor, float part) {
  constexpr float coefficients[] = {float(-1 / 120.0), float(1 / 24.0), float(-1 / 6.0), 0.5f, -1, 1};
  F16 x = fma(broadcast<F16>(factor), value, broadcast<F16>(offset));
  x = min(max(x, broadcast<F16>(0)), broadcast<F16>(60)) * (1 / 64.f);
  F16 power = broadcast<F16>(coefficients[0]);
  for (int n = 1; n < 6; n++) power = fma(power, x, broadcast<F16>(coefficients[n]));
  for (int n = 0; n < 6; n++) power *= power;
  return part * power;
}

FORCE_INLINE void write_decay(const float *values, float offset, float factor, float part, float *out) {
  for (int i = 0; i < BLOCKS_2X2; i += 16) store(out + i, decay(load<F16>(values + i), offset, factor, part));
}

// Lanes moved down by so many, or up by a negative number; zeros come in.
template <int BY> FORCE_INLINE F16 moved(F16 row) {
#define LANE(n) n + BY >= 0 && n + BY < 16 ? n + BY : 16
  return __builtin_shufflevector(row, F16{}, LANE(0), LANE(1), LANE(2), LANE(3), LANE(4), LANE(5), LANE(6), LANE(7),
                                 LANE(8), LANE(9), LANE(10), LANE(11), LANE(12), LANE(13), LANE(14), LANE(15));
#undef LANE
}

FORCE_INLINE F16 sum_five(F16 first, F16 second, F16 third, F16 fourth, F16 last) {
  return fma(first + last, broadcast<F16>(END_WEIGHT), second + third + fourth);
}

// One over the weight of the 2x2 blocks of each patch within its window.
struct PatchShares {
  alignas(64) float values[BLOCKS_2X2];

  constexpr PatchShares() : values() {
    for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++)
      for (int i = 0; i < BLOCKS_2X2_PER_ROW; i++)
        values[j * BLOCKS_2X2_PER_ROW + i] = float(1 / (length(j) * length(i)));
  }
  static constexpr double length(int place) {  // 2x2 blocks of the patch within the window, along one axis
    double sum = 0;
    for (int n = -2; n <= 2; n++)
      if (place + n >= 0 && place + n < BLOCKS_2X2_PER_ROW) sum += n == -2 || n == 2 ? double(END_WEIGHT) : 1;
    return sum;
  }
};
constexpr PatchShares PATCH_SHARES;

// Writes the mean over the patch of five by five 2x2 blocks around each; patches end at the border of the window.
inline void average_patches(const float *values, float *out) {
  const auto row = [values](int j) {
    return j < BLOCKS_2X2_PER_ROW ? load<F16>(values + j * BLOCKS_2X2_PER_ROW) : F16{};
  };
  F16 first{}, second{}, third = row(0), fourth = row(1);
  for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++) {
    const F16 last = row(j + 2), sum = sum_five(first, second, third, fourth, last);
    const F16 patch = sum_five(moved<-2>(sum), moved<-1>(sum), sum, moved<1>(sum), moved<2>(sum));
    store(out + j * BLOCKS_2X2_PER_ROW, patch * load<F16>(PATCH_SHARES.values + j * BLOCKS_2X2_PER_ROW));
    first = second;
    second = third;
    third = fourth;
    fourth = last;
  }
}

// Every second of 32 values, from the first or the second one on.
FORCE_INLINE F16 even_lanes(F16 a, F16 b) {
  return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
}
FORCE_INLINE F16 odd_lanes(F16 a, F16 b) {
  return __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
}

// Writes the mean over the pixels of each 2x2 block.
inline void pool_pixels(const float *pixels, float *blocks) {
  for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++) {
    const float *above = pixels + 2 * j * WINDOW, *below = above + WINDOW;
    const F16 left = load<F16>(above) + load<F16>(below), right = load<F16>(above + 16) + load<F16>(below + 16);
    store(blocks + j * BLOCKS_2X2_PER_ROW, 0.25f * (even_lanes(left, right) + odd_lanes(left, right)));
  }
}

// Adds the mean of its one or two chroma samples to each 2x2 block.
inline void pool_chroma(const float *samples, Int down, float *blocks) {
  for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++) {
    F16 mean = load<F16>(samples + (down == 2 ? j : 2 * j) * BLOCKS_2X2_PER_ROW);
    if (down != 2) mean = 0.5f * (mean + load<F16>(samples + (2 * j + 1) * BLOCKS_2X2_PER_ROW));
    store(blocks + j * BLOCKS_2X2_PER_ROW, load<F16>(blocks + j * BLOCKS_2X2_PER_ROW) + mean);
  }
}

FORCE_INLINE F16 quarter_way(F16 near, F16 far) { return fma(far, broadcast<F16>(0.25f), near * 0.75f); }

// Interpolates the values of the 2x2 blocks at each sample, of `across` x `down` pixels: without, steps would be
// visible where no candidate fits.
inline void upsample_2x2(const float *blocks, Int across, Int down, float *out) {
  for (int j = 0; j < WINDOW / down; j++) {
    const int row = down == 2 ? j : j / 2, other = clamp(row + 2 * (j % 2) - 1, 0, int(BLOCKS_2X2_PER_ROW) - 1);
    const F16 near = load<F16>(blocks + row * BLOCKS_2X2_PER_ROW);
    if (across > 1) {
      const F16 far = down > 1 ? near : load<F16>(blocks + other * BLOCKS_2X2_PER_ROW);
      store(out + j * BLOCKS_2X2_PER_ROW, quarter_way(near, far));
      continue;
    }
    const F16 values = quarter_way(near, load<F16>(blocks + other * BLOCKS_2X2_PER_ROW));
    const F16 before = __builtin_shufflevector(values, values, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14);
    const F16 after = __builtin_shufflevector(values, values, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 15);
    const F16 a = quarter_way(values, before), b = quarter_way(values, after);
    float *to = out + j * WINDOW;
    store(to, __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23));
    store(to + 16, __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31));
  }
}

FORCE_INLINE void add_row(const float *weights, const float *values, float *sums) {
  store(sums, fma(load<F16>(weights), load<F16>(values), load<F16>(sums)));
}

FORCE_INLINE float sum_lanes(F16 values) {
  float sum = values[0];
  for (int i = 1; i < 16; i++) sum += values[i];
  return sum;
}

inline float sum_of(const float *values) {
  F16 sums = load<F16>(values);
  for (int i = 16; i < BLOCKS_2X2; i += 16) sums += load<F16>(values + i);
  return sum_lanes(sums);
}

inline float smallest(const float *values) {
  F16 lowest = load<F16>(values);
  for (int i = 16; i < BLOCKS_2X2; i += 16) lowest = min(lowest, load<F16>(values + i));
  float found = lowest[0];
  for (int i = 1; i < 16; i++) found = min(found, lowest[i]);
  return found;
}

}  // namespace
