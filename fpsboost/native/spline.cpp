// Cubic splines: the coefficients of planes, and both frames mixed in time along the motion of every pixel.
#include "scratch.h"
#include "spline_samples.h"

namespace {

// Filters that turn samples into coefficients, one after the other; stage k adds what is 2^k places away on both sides.
struct Prefilter {
  const float *weights;
  Int stages, reach;  // reach: places on both sides that count in all

  explicit Prefilter(const ArrayOf<const float, 1> &array)
      : weights(array.data), stages(array.shape[0]), reach((Int(1) << array.shape[0]) - 1) {}
};

// Writes a row plus `weight` times the sum of two others.
void filter_row(float weight, const float *before, const float *centre, const float *after, float *__restrict out,
                Int count) {
  for (Int x = 0; x < count; x++) out[x] = fma(weight, before[x] + after[x], centre[x]);
}

void copy_row(const float *from, float *__restrict to, Int count) {
  for (Int x = 0; x < count; x++) to[x] = from[x];
}

// Filters a row of values times `unit`, with repeated edges, horizontally; `lines` are two rows for work, one after the
// other.
template <typename T>
void filter_across(const T *source, Int columns, float unit, const Prefilter &filter, float *lines, float *out,
                   Int width) {
  const Int begin = filter.reach + MARGIN;
  Int length = width + 2 * filter.reach;
  float *const others[] = {lines, lines + length}, *line = lines, *inner = line + begin;
  for (Int x = 0; x < columns; x++) inner[x] = float(source[x]) * unit;
  for (Int x = 0; x < begin; x++) line[x] = inner[0];
  for (Int x = columns; x < length - begin; x++) inner[x] = inner[columns - 1];
  for (Int k = 0; k < filter.stages; k++) {
    const Int distance = Int(1) << k;
    line = others[k % 2];
    length -= 2 * distance;
    float *to = k < filter.stages - 1 ? others[(k + 1) % 2] : out;
    filter_row(filter.weights[k], line, line + distance, line + 2 * distance, to, length);
  }
}

// The latest rows of each stage of the vertical filter; row y is in the same place as those a multiple of `size` away.
struct Rings {
  float *rows;
  Int size, width;

  // y is at least -4 size, since what is filtered first lies twice the filter's reach above the frame
  float *row(Int stage, Int y) const { return rows + (stage * size + (y + 4 * size) % size) * width; }
};

// Filters vertically what is known now that row y is there, as far as the filter reaches above it.
void filter_down(const Prefilter &filter, const Rings &rings, Int y, float *out, Int width) {
  for (Int k = 0; k < filter.stages; k++) {
    const Int distance = Int(1) << k;
    y -= distance;
    float *to = k < filter.stages - 1 ? rings.row(k + 1, y) : out;
    filter_row(filter.weights[k], rings.row(k, y - distance), rings.row(k, y), rings.row(k, y + distance), to, width);
  }
}

template <typename T> Int filter_planes(const FindCoefficients &args) {
  const View<const T, 3> planes(args.planes);
  const View<float, 3> coefficients(args.coefficients);
  const Prefilter filter(args.weights);
  Workspace workspace(args.scratch);
  float *lines = workspace.take<float>(2 * (coefficients.shape[2] + 2 * filter.reach));
  const Int kept = filter.reach + 2, size = filter.stages * kept * coefficients.shape[2];
  const Rings rings{workspace.take<float>(size), kept, coefficients.shape[2]};
  if (workspace.is_counting()) return workspace.size();
  for (Int i = 0; i < size; i++) rings.rows[i] = 0;  // of what is filtered before they are full, nothing remains
  const Int height = planes.shape[1], tall = coefficients.shape[1], width = coefficients.shape[2], reach = filter.reach;
  float unit = args.unit;
  for (Int k = 0; k < filter.stages; k++) {  // so that flat areas keep their brightness
    const float gain = 1 + filter.weights[k] + filter.weights[k];
    unit /= gain * gain;
  }
  const Int first = MARGIN - reach, last = MARGIN + height - 1 + reach;
  for (Int c = 0; c < planes.shape[0]; c++) {
    for (Int y = -2 * reach; y < height + 2 * reach; y++) {
      float *centre = rings.row(0, y);
      if (y == -2 * reach || (0 < y && y < height))
        filter_across(planes.ptr(c, max(y, Int(0))), planes.shape[2], unit, filter, lines, centre, width);
      else
        copy_row(rings.row(0, y - 1), centre, width);
      // rows before the first whole one are written again below
      filter_down(filter, rings, y, coefficients.ptr(c, max(MARGIN + y - reach, Int(0))), width);
    }
    // farther out, all values around are equal, and so are the coefficients
    for (Int y = 0; y < first; y++) copy_row(coefficients.ptr(c, first), coefficients.ptr(c, y), width);
    for (Int y = last + 1; y < tall; y++) copy_row(coefficients.ptr(c, last), coefficients.ptr(c, y), width);
  }
  return 0;
}

// Where the motion of a pixel ends; beyond the frame, edges are repeated.
FORCE_INLINE const float *find_end(const View<const float, 3> &coefficients, const View<const float, 3> &motion, Int i,
                                   Int j, float t, Taps &taps) {
  const float height = float(motion.shape[0]), width = float(motion.shape[1]);
  const float y = clamp(float(i) + motion(i, j, 1), -1.0f, height) + float(MARGIN);
  const float x = clamp(float(j) + motion(i, j, 0), -1.0f, width) + float(MARGIN);
  return find_taps(coefficients.data, coefficients.shape[2], y, x, sharpening_at(t), taps);
}

FORCE_INLINE float sample_spline(const View<const float, 3> &coefficients, Int plane, const float *from,
                                 const Taps &taps) {
  const Int stride = coefficients.shape[2];
  from += plane * coefficients.shape[1] * stride;
  float rows[TAPS];
  for (int j = 0; j < TAPS; j++) rows[j] = filter(from + j * stride, taps.across) + 0;  // no zero is negative
  return filter(rows, taps.down) + 0;
}

}  // namespace

KERNEL(Int, find_coefficients, const FindCoefficients &args) {
  return with_pixel_type(args.planes.kind, [&](auto pixel) { return filter_planes<decltype(pixel)>(args); });
}

KERNEL(void, mix_along, const MixAlong &args) {
  const View<const float, 3> coefficients0(args.source0.coefficients), coefficients1(args.source1.coefficients);
  const View<const float, 3> motion0(args.source0.motion), motion1(args.source1.motion);
  const View<const bool, 2> visible0(args.source0.is_visible), visible1(args.source1.is_visible);
  const View<float, 3> mixed(args.mixed);
  const View<float, 2> squared(args.squared);
  const float t = args.t;
  for (Int i = 0; i < mixed.shape[1]; i++)
    for (Int j = 0; j < mixed.shape[2]; j++) {
      const bool seen0 = visible0(i, j), seen1 = visible1(i, j);
      const float share = seen0 == seen1 ? t : float(seen1);
      Taps taps0, taps1;
      const float *from0 = find_end(coefficients0, motion0, i, j, t, taps0);
      const float *from1 = find_end(coefficients1, motion1, i, j, t, taps1);
      float distance = 0;
      for (Int c = 0; c < mixed.shape[0]; c++) {
        const float value = sample_spline(coefficients0, c, from0, taps0);
        const float difference = sample_spline(coefficients1, c, from1, taps1) - value;
        mixed(c, i, j) = fma(share, difference, value);
        distance = fma(difference, difference, distance);
      }
      squared(i, j) = seen0 && seen1 ? distance : 0;
    }
}
