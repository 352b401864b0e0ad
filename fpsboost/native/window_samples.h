// Samples of both frames along a candidate: where a window lies in either at time t, and what is seen there.
//
// A candidate is one motion for a whole window, so that all samples of the window lie on a regular grid: both frames
// are read in rows, without looking up single pixels. A window that is zoomed or turned is sampled in blocks, each of
// which moves as its centre does.
#pragma once
#include "candidates.h"
#include "scratch.h"
#include "spline_samples.h"

namespace {

constexpr Int BLOCK = WINDOW_BLOCK;

// Lanes for filters that keep rows of coefficients in registers: with AVX2, sixteen would not fit.
#if defined(__AVX512F__)
typedef F16 Wide;
#else
typedef F8 Wide;
#endif

struct Position {  // in coefficients
  float y, x;
};

struct WindowPlace {  // where the first sample of a window is in both frames
  Position in_frame[2];
  bool is_inside;  // whether the whole window lies inside of both frames
};

struct InsideMarks {  // of a window that is partly outside: 1 for each column, and each row, inside of a frame, else 0
  float columns[2][WINDOW], rows[2][WINDOW];
};

FORCE_INLINE Int divide_down(Int value, Int by) {
  return by == 2 ? value >> 1 : value;
}  // by 1 or 2, towards the lower

// Samples of a window of the planes of one resolution, each of which stands for `across` columns and `down` rows of
// pixels, along a candidate; and their sums over the candidates of a node and over the windows of a row of nodes.
struct LayerSamples {
  View<const float, 3> coefficients[2];
  ArrayOf<const Any, 3> planes[2];
  float unit[2];
  Int channels, down, across, wide, tall, size;
  float *mixed;   // blended by time
  float *change;  // samples of frame 1 minus those of frame 0; 0 where either lies outside of its frame
  float *total;
  View<float, 3> band;
  alignas(64) float distance[WINDOW * WINDOW];  // squared differences, summed over the planes

  // Takes the work arrays of one window, and a band of so many planes and columns, which is zero at first.
  LayerSamples(const PlaneGroup &layer, Int band_planes, Int columns, Workspace &workspace)
      : coefficients{View<const float, 3>(layer.frame0.coefficients), View<const float, 3>(layer.frame1.coefficients)},
        planes{layer.frame0.planes, layer.frame1.planes}, unit{layer.frame0.unit, layer.frame1.unit},
        channels(layer.frame0.coefficients.shape[0]), down(layer.down), across(layer.across), wide(WINDOW / across),
        tall(WINDOW / down), size(wide * tall), mixed(workspace.take<float>(channels * size)),
        change(workspace.take<float>(channels * size)), total(workspace.take<float>(channels * size)) {
    band.data = workspace.take<float>(band_planes * tall * columns);
    band.shape[0] = band_planes;
    band.shape[1] = tall;
    band.shape[2] = columns;
    if (!workspace.is_counting()) __builtin_memset(band.data, 0, band_planes * tall * columns * sizeof(float));
  }
};

FORCE_INLINE void mark_inside(float start, Int size, float *marks) {
  for (int i = 0; i < WINDOW; i++) {
    const float place = start + float(i);
    marks[i] = place >= 0 && place <= float(size - 1) ? 1 : 0;
  }
}

// Positions are limited to the margin, beyond which the repeated edges do not change.
inline WindowPlace locate_window(Int top, Int left, const Motion &motion, float t, Int height, Int width,
                                 InsideMarks &marks) {
  const float curve = t * (1 - t) * 0.5f;
  float x[2], y[2];
  x[0] = float(left) + curve * motion.acceleration_x - t * motion.dx;
  x[1] = x[0] + motion.dx;
  y[0] = float(top) + curve * motion.acceleration_y - t * motion.dy;
  y[1] = y[0] + motion.dy;
  WindowPlace place;
  place.is_inside = min(x[0], x[1]) >= 0 && min(y[0], y[1]) >= 0 && max(x[0], x[1]) <= float(width - WINDOW) &&
                    max(y[0], y[1]) <= float(height - WINDOW);
  for (int n = 0; n < 2; n++) {
    if (!place.is_inside) {
      mark_inside(x[n], width, marks.columns[n]);
      mark_inside(y[n], height, marks.rows[n]);
    }
    place.in_frame[n].x = clamp(x[n], float(2 - MARGIN), float(width + 2)) + MARGIN;
    place.in_frame[n].y = clamp(y[n], float(2 - MARGIN), float(height + 2)) + MARGIN;
  }
  return place;
}

// The chroma siting has no influence on displacements.
inline WindowPlace locate_further(const WindowPlace &place, Int down, Int across) {
  const float by_row = 1 / float(down), by_column = 1 / float(across);
  WindowPlace further;
  further.is_inside = place.is_inside;
  for (int n = 0; n < 2; n++) {
    further.in_frame[n].y = (place.in_frame[n].y - MARGIN) * by_row + MARGIN;
    further.in_frame[n].x = (place.in_frame[n].x - MARGIN) * by_column + MARGIN;
  }
  return further;
}

// The motion in samples of further planes, but for what only locates a window.
inline Motion scale_motion(const Motion &motion, Int down, Int across) {
  Motion scaled = motion;
  scaled.dy_along_x = motion.dy_along_x * (1 / float(down)) * float(across);
  scaled.dx_along_y = motion.dx_along_y * float(down) * (1 / float(across));
  return scaled;
}

// Where a block, from a row and column of its window on, is in a frame; `share` is that of the motion from time t to
// it.
FORCE_INLINE Position locate_block(Position window, float share, const Motion &motion, Int down, Int across, Int tall,
                                   Int wide, Int rows, Int stride) {
  const float from_x = float(across - (wide - BLOCK) / 2), from_y = float(down - (tall - BLOCK) / 2);
  const float x = window.x + float(across) + share * (from_x * motion.dx_along_x + from_y * motion.dx_along_y);
  const float y = window.y + float(down) + share * (from_x * motion.dy_along_x + from_y * motion.dy_along_y);
  return {clamp(y, 1.f, float(rows - BLOCK - 3)), clamp(x, 1.f, float(stride - BLOCK - 3))};
}

// Samples columns of both frames, blends them and adds up the squares of their differences. One frame is sampled after
// the other, as the weights and rows of both would not fit into the registers. What is `ahead` values on is fetched, as
// processors do not foresee small windows of many rows.
template <typename V>
FORCE_INLINE void mix_columns(const LayerSamples &layer, const float *const from[2], const Taps taps[2], Int tall,
                              float t, float *mixed, float *change, float *distance, const Int ahead[2]) {
  V samples[WINDOW];
  sample_columns<V>(from[0], layer.coefficients[0].shape[2], taps[0], tall, ahead[0],
                    [&](Int j, V sum) INLINE_LAMBDA { samples[j] = sum; });
  sample_columns<V>(from[1], layer.coefficients[1].shape[2], taps[1], tall, ahead[1], [&](Int j, V sum) INLINE_LAMBDA {
    const Int row = j * layer.wide;
    const V difference = sum - samples[j];
    store(distance + row, fma(difference, difference, load<V>(distance + row)));
    store(mixed + row, fma(broadcast<V>(t), difference, samples[j]));
    store(change + row, difference);
  });
}

inline void mix_rigid(LayerSamples &layer, const WindowPlace &place, float t) {
  Taps taps[2];
  const float *first[2];
  Int plane_size[2];
  for (int n = 0; n < 2; n++) {
    const View<const float, 3> &plane = layer.coefficients[n];
    plane_size[n] = plane.shape[1] * plane.shape[2];
    first[n] =
        find_taps(plane.data, plane.shape[2], place.in_frame[n].y, place.in_frame[n].x, sharpening_at(t), taps[n]);
  }
  for (Int c = 0; c < layer.channels; c++) {
    Int ahead[2];  // the next plane, and from the last one on, the next window of the first one
    for (int n = 0; n < 2; n++) ahead[n] = c < layer.channels - 1 ? plane_size[n] : layer.wide - c * plane_size[n];
    for (Int i = 0; i < layer.wide; i += lane_count<Wide>) {
      const float *const from[2] = {first[0] + c * plane_size[0] + i, first[1] + c * plane_size[1] + i};
      const Int to = c * layer.size + i;
      mix_columns<Wide>(layer, from, taps, layer.tall, t, layer.mixed + to, layer.change + to, layer.distance + i,
                        ahead);
    }
  }
}

inline void mix_blocks(LayerSamples &layer, const WindowPlace &place, const Motion &motion, float t) {
  for (Int down = 0; down < layer.tall; down += BLOCK)
    for (Int across = 0; across < layer.wide; across += BLOCK) {
      Taps taps[2];
      const float *from[2];
      for (int n = 0; n < 2; n++) {
        const View<const float, 3> &plane = layer.coefficients[n];
        const Position position = locate_block(place.in_frame[n], n == 0 ? -t : 1 - t, motion, down, across, layer.tall,
                                               layer.wide, plane.shape[1], plane.shape[2]);
        from[n] = find_taps(plane.data, plane.shape[2], position.y, position.x, sharpening_at(t), taps[n]);
      }
      const Int first = down * layer.wide + across, nothing_ahead[2] = {};
      for (Int c = 0; c < layer.channels; c++) {
        const Int in_plane = c * layer.size + first;
        mix_columns<F8>(layer, from, taps, BLOCK, t, layer.mixed + in_plane, layer.change + in_plane,
                        layer.distance + first, nothing_ahead);
        for (int n = 0; n < 2; n++) from[n] += layer.coefficients[n].shape[1] * layer.coefficients[n].shape[2];
      }
    }
}

// Samples a window in blocks from a plane of `rows` x `stride` coefficients.
inline void filter_blocks(const float *coefficients, Int rows, Int stride, Position window, float share,
                          float sharpening, const Motion &motion, Int wide, Int tall, float *out) {
  for (Int down = 0; down < tall; down += BLOCK)
    for (Int across = 0; across < wide; across += BLOCK) {
      const Position position = locate_block(window, share, motion, down, across, tall, wide, rows, stride);
      Taps taps;
      const float *from = find_taps(coefficients, stride, position.y, position.x, sharpening, taps);
      float *to = out + down * wide + across;
      sample_columns<F8>(from, stride, taps, BLOCK, 0, [=](Int j, F8 row) INLINE_LAMBDA { store(to + j * wide, row); });
    }
}

// Samples a window that moves as a whole.
inline void filter_rigid(const float *coefficients, Int stride, Position window, float sharpening, Int wide, Int tall,
                         float *out) {
  Taps taps;
  const float *from = find_taps(coefficients, stride, window.y, window.x, sharpening, taps);
  for (Int i = 0; i < wide; i += lane_count<Wide>)
    sample_columns<Wide>(from + i, stride, taps, tall, 0,
                         [=](Int j, Wide row) INLINE_LAMBDA { store(out + j * wide + i, row); });
}

// Copies a window that begins at a pixel, which may lie outside of the frame: its edges are repeated.
template <typename T>
inline void copy_window(const ArrayOf<const Any, 3> &planes, float unit, Int c, Int top, Int left, Int wide, Int tall,
                        float *out) {
  const View<const T, 3> values(planes);
  const Int height = values.shape[1], width = values.shape[2];
  for (Int j = 0; j < tall; j++) {
    const T *row = values.ptr(c, clamp(top + j, Int(0), height - 1));
    if (left >= 0 && left + wide <= width)
      for (Int i = 0; i < wide; i++) out[j * wide + i] = float(row[left + i]) * unit;
    else
      for (Int i = 0; i < wide; i++) out[j * wide + i] = float(row[clamp(left + i, Int(0), width - 1)]) * unit;
  }
}

FORCE_INLINE bool is_whole(Position position) {
  return position.y == float(Int(position.y)) && position.x == float(Int(position.x));
}

// Samples a window that moves as a whole, in one frame. Pixels are copied: the spline meets them but nearly.
inline void fetch_window(const LayerSamples &layer, int n, Int c, Position position, float t, float *out) {
  const View<const float, 3> &plane = layer.coefficients[n];
  if (is_whole(position))
    with_pixel_type(layer.planes[n].kind, [&](auto pixel) {
      copy_window<decltype(pixel)>(layer.planes[n], layer.unit[n], c % layer.planes[n].shape[0],
                                   Int(position.y) - MARGIN, Int(position.x) - MARGIN, layer.wide, layer.tall, out);
    });
  else
    filter_rigid(plane.ptr(c), plane.shape[2], position, sharpening_at(t), layer.wide, layer.tall, out);
}

inline void mix_fetched(LayerSamples &layer, const WindowPlace &place, float t) {
  alignas(64) float first[WINDOW * WINDOW], second[WINDOW * WINDOW];
  for (Int c = 0; c < layer.channels; c++) {
    fetch_window(layer, 0, c, place.in_frame[0], t, first);
    fetch_window(layer, 1, c, place.in_frame[1], t, second);
    for (Int i = 0; i < layer.size; i += 16) {
      const F16 from = load<F16>(first + i), difference = load<F16>(second + i) - from;
      store(layer.distance + i, fma(difference, difference, load<F16>(layer.distance + i)));
      store(layer.mixed + c * layer.size + i, fma(broadcast<F16>(t), difference, from));
      store(layer.change + c * layer.size + i, difference);
    }
  }
}

// Mixes a window that is partly outside anew; samples outside have no weight unless both are.
inline void mix_inside(const LayerSamples &layer, float t, const InsideMarks &marks) {
  float columns[2][WINDOW];
  for (Int i = 0; i < layer.wide; i++) {
    columns[0][i] = (1 - t) * marks.columns[0][i * layer.across];
    columns[1][i] = t * marks.columns[1][i * layer.across];
  }
  for (Int c = 0; c < layer.channels; c++)
    for (Int j = 0; j < layer.tall; j++) {
      const float row0 = marks.rows[0][j * layer.down], row1 = marks.rows[1][j * layer.down];
      float *__restrict mixed = layer.mixed + c * layer.size + j * layer.wide;
      float *__restrict change = layer.change + c * layer.size + j * layer.wide;
      for (Int i = 0; i < layer.wide; i++) {  // all are written, so that this needs no branch
        const float weight0 = columns[0][i] * row0, weight1 = columns[1][i] * row1, both = weight0 + weight1;
        const float mean = mixed[i] + (weight1 / max(both, 1e-30f) - t) * change[i];
        mixed[i] = both > 0 ? mean : mixed[i];
        change[i] = ((both > 0) & (weight0 * weight1 == 0)) ? 0 : change[i];
      }
    }
}

// Samples a window of both frames along a motion, blends the samples by time, and sums their squared differences.
inline void sample_layer(LayerSamples &layer, const WindowPlace &place, const InsideMarks &marks, const Motion &motion,
                         float t) {
  for (Int i = 0; i < layer.size; i++) layer.distance[i] = 0;
  if (!motion.is_rigid())
    mix_blocks(layer, place, motion, t);
  else if (is_whole(place.in_frame[0]) || is_whole(place.in_frame[1]))
    mix_fetched(layer, place, t);
  else
    mix_rigid(layer, place, t);
  if (!place.is_inside) mix_inside(layer, t, marks);
}

}  // namespace
