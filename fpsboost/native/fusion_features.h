// What speaks for a candidate at each 2x2 block of a window: similarities, and what the fields and further frames say.
//
// A feature is a number of one 2x2 block and one candidate. Those of the samples differ from block to block; those of
// the motion fields are looked up for 8x8 blocks, as the fields' own points are that far apart, and interpolated.
#pragma once
#include "window_rows.h"

namespace {

constexpr int BLOCKS_8X8_PER_ROW = 4, BLOCKS_8X8 = BLOCKS_8X8_PER_ROW * BLOCKS_8X8_PER_ROW;
constexpr int SIDE_8X8 = WINDOW / BLOCKS_8X8_PER_ROW;

// Features of 2x2 blocks.
enum { SIMILARITY, FINE_SIMILARITY, COARSE_SIMILARITY, FLATNESS, ONWARD0, ONWARD1, ONWARD_DISTANCE, FEATURES_2X2 };
// Features of 8x8 blocks: each of these of frame 0, then of frame 1, then how far both are apart.
enum { SEARCH_SIMILARITY = 0, AGREEMENT = 3, CONSISTENCY = 6, LANDINGS = 9, FEATURES_8X8 = 12 };
enum { CONSTANT, VOTES, ACCELERATION, GRADIENT, SUPPORT, WINDOW_FEATURES };  // features of the whole window
static_assert(FEATURES == FEATURES_2X2 + FEATURES_8X8 + WINDOW_FEATURES, "as in the table of weights");

constexpr float FINE = 100, COARSE = 9;  // factors on squared differences for bandwidths of 0.03 and 0.1 instead of 0.3
constexpr float FINE_LUMA = 25;          // the same for luma, for a bandwidth of 0.06
constexpr float MIN_SUPPORT = 0.02f;     // so that the logarithm of the support has a limit

struct Features {  // of a candidate
  alignas(64) float blocks_2x2[FEATURES_2X2][BLOCKS_2X2], blocks_8x8[FEATURES_8X8][BLOCKS_8X8];
  float window[WINDOW_FEATURES];
};

// Weight of each 8x8 block of a row at each 2x2 block of a row.
struct InterpolationWeights {
  alignas(64) float values[BLOCKS_8X8_PER_ROW][BLOCKS_2X2_PER_ROW];

  constexpr InterpolationWeights() : values() {
    for (int block = 0; block < BLOCKS_8X8_PER_ROW; block++)
      for (int i = 0; i < BLOCKS_2X2_PER_ROW; i++) {
        float place = (float(i) + 0.5f) / (BLOCKS_2X2_PER_ROW / BLOCKS_8X8_PER_ROW) - 0.5f;
        place = place < 0 ? 0 : place > BLOCKS_8X8_PER_ROW - 1 ? BLOCKS_8X8_PER_ROW - 1 : place;
        const float distance = place < float(block) ? float(block) - place : place - float(block);
        values[block][i] = distance < 1 ? 1 - distance : 0;
      }
  }
};
constexpr InterpolationWeights INTERPOLATION_WEIGHTS;

struct InterpolatedRows {  // values of the 8x8 blocks, interpolated at the 2x2 blocks along rows
  alignas(64) float values[BLOCKS_8X8_PER_ROW][BLOCKS_2X2_PER_ROW];
};

// The rows of 8x8 blocks between which a row of 2x2 blocks is: the first of two, and the shares of both.
struct RowPair {
  int first;
  float below, above;
};

FORCE_INLINE RowPair row_pair(int j) {
  const int first = min(max(2 * j - SIDE_8X8 / 2, 0) / SIDE_8X8, BLOCKS_8X8_PER_ROW - 2);
  return {first, INTERPOLATION_WEIGHTS.values[first][j], INTERPOLATION_WEIGHTS.values[first + 1][j]};
}

FORCE_INLINE void interpolate_across(const float *blocks, InterpolatedRows &rows) {
  for (int v = 0; v < BLOCKS_8X8_PER_ROW; v++) {
    F16 sum{};
    for (int u = 0; u < BLOCKS_8X8_PER_ROW; u++)
      sum = fma(broadcast<F16>(blocks[v * BLOCKS_8X8_PER_ROW + u]), load<F16>(INTERPOLATION_WEIGHTS.values[u]), sum);
    store(rows.values[v], sum);
  }
}

// Interpolates the values of the 8x8 blocks at each 2x2 block.
inline void upsample_8x8(const float *blocks, float *out) {
  InterpolatedRows rows;
  interpolate_across(blocks, rows);
  for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++) {
    const RowPair between = row_pair(j);
    const F16 sum = fma(broadcast<F16>(between.below), load<F16>(rows.values[between.first]), F16{});
    store(out + j * BLOCKS_2X2_PER_ROW,
          fma(broadcast<F16>(between.above), load<F16>(rows.values[between.first + 1]), sum));
  }
}

// Where in the luma of a frame at some time, which has half the size, a pixel of the in-between frame is.
inline Position locate_luma(Int top, Int left, float time, const Motion &motion, float t, const PairContext &context) {
  const float bent = (t * (1 - t) - time * (1 - time)) * 0.5f;
  const float x = (float(left) + (time - t) * motion.dx + bent * motion.acceleration_x) * 0.5f;
  const float y = (float(top) + (time - t) * motion.dy + bent * motion.acceleration_y) * 0.5f;
  const Int rows = context.luma[1].shape[0], stride = context.luma[1].shape[1];
  return {clamp(y + MARGIN, 2.f, float(rows - MARGIN + 2)),
          clamp(x + MARGIN, 2.f, float(stride - BLOCKS_2X2_PER_ROW - MARGIN + 2))};
}

// Samples the luma of a frame along a candidate, one sample for each 2x2 block.
inline void fetch_luma(int frame, Int top, Int left, const Motion &motion, float t, const PairContext &context,
                       float *out) {
  const View<const float, 2> luma(context.luma[frame]);
  const float time = context.times[frame];
  const Position position = locate_luma(top, left, time, motion, t, context);
  if (motion.is_rigid())
    filter_rigid(luma.data, luma.shape[1], position, 0, BLOCKS_2X2_PER_ROW, BLOCKS_2X2_PER_ROW, out);
  else
    filter_blocks(luma.data, luma.shape[0], luma.shape[1], position, time - t, 0, motion, BLOCKS_2X2_PER_ROW,
                  BLOCKS_2X2_PER_ROW, out);
}

struct PointValues {  // what a motion field says at a place
  double similarity, agreement, consistency, flatness;
};

// Looks up the field at a place in units of points, bilinearly, and how far it agrees with a motion.
FORCE_INLINE PointValues look_up(const View<const float, 3> &points, double x, double y, double dx, double dy) {
  const Int rows = points.shape[0], columns = points.shape[1];
  x = clamp(x - 0.5, 0.0, double(columns - 1));
  y = clamp(y - 0.5, 0.0, double(rows - 1));
  const Int left = Int(x), top = Int(y), right = min(left + 1, columns - 1), bottom = min(top + 1, rows - 1);
  const double part_x = x - double(left), part_y = y - double(top);
  const double shares[] = {(1 - part_y) * (1 - part_x), (1 - part_y) * part_x, part_y * (1 - part_x), part_y * part_x};
  const float *const corners[] = {points.ptr(top, left), points.ptr(top, right), points.ptr(bottom, left),
                                  points.ptr(bottom, right)};
  PointValues sum = {};
  for (int n = 0; n < 4; n++) {
    const float *point = corners[n];
    sum.similarity += shares[n] * double(point[2]);
    const double difference = max(__builtin_fabs(double(point[0]) - dx), __builtin_fabs(double(point[1]) - dy));
    sum.agreement += shares[n] / (1 + difference);
    sum.consistency += shares[n] * double(point[3]);
    sum.flatness += shares[n] * double(point[4]);
  }
  return sum;
}

// Writes what the motion fields say of a candidate, in double precision; and the flatness of each 8x8 block.
inline void extract_field_features(Int top, Int left, const Motion &motion, float t, const PairContext &context,
                                   Features &features, float *flatness) {
  const View<const float, 3> points[] = {View<const float, 3>(context.points[0]),
                                         View<const float, 3>(context.points[1])};
  const View<const float, 3> landings(context.landings);
  const float curve = t * (1 - t) * 0.5f, per_step = 1 / float(context.step);
  const float bent_x = curve * motion.acceleration_x, bent_y = curve * motion.acceleration_y;
  const double turns = motion.is_rigid() ? 0 : 1;
  for (int block = 0; block < BLOCKS_8X8; block++) {
    const float across = float(block % BLOCKS_8X8_PER_ROW * SIDE_8X8 + SIDE_8X8 / 2),
                down = float(block / BLOCKS_8X8_PER_ROW * SIDE_8X8 + SIDE_8X8 / 2);
    const double from_x = (double(across) - WINDOW / 2) * turns, from_y = (double(down) - WINDOW / 2) * turns;
    const double dx = motion.dx + from_x * double(motion.dx_along_x) + from_y * double(motion.dx_along_y);
    const double dy = motion.dy + from_x * double(motion.dy_along_x) + from_y * double(motion.dy_along_y);
    const float x = float(left) + across, y = float(top) + down;
    const double x0 = x - t * dx + bent_x, y0 = y - t * dy + bent_y;
    flatness[block] = 0;
    for (int n = 0; n < 2; n++) {
      const double sign = 1 - 2 * n;
      const PointValues found =
          look_up(points[n], (x0 + n * dx) * per_step, (y0 + n * dy) * per_step, sign * dx, sign * dy);
      features.blocks_8x8[SEARCH_SIMILARITY + n][block] = float(found.similarity);
      features.blocks_8x8[AGREEMENT + n][block] = float(found.agreement);
      features.blocks_8x8[CONSISTENCY + n][block] = float(found.consistency);
      flatness[block] = float(flatness[block] + 0.5 * found.flatness);
    }
    const Int row = clamp(Int(__builtin_floorf(y * per_step)), Int(0), landings.shape[1] - 1);
    const Int column = clamp(Int(__builtin_floorf(x * per_step)), Int(0), landings.shape[2] - 1);
    for (int n = 0; n < 2; n++) features.blocks_8x8[LANDINGS + n][block] = landings(n, row, column);
  }
  for (int n = 0; n < FEATURES_8X8; n += 3)
    store(features.blocks_8x8[n + 2],
          absolute(load<F16>(features.blocks_8x8[n]) - load<F16>(features.blocks_8x8[n + 1])));
}

// Writes the similarities of the frames onward, before and after the two, along a candidate.
inline void extract_onward_features(Int top, Int left, const Motion &motion, float t, const PairContext &context,
                                    Features &features) {
  alignas(64) float near[BLOCKS_2X2], far[BLOCKS_2X2];
  for (int n = 0; n < 2; n++) {
    float *out = features.blocks_2x2[ONWARD0 + n];
    if (context.luma[3 * n].shape[0] * context.luma[3 * n].shape[1] == 0) {  // there is no such frame
      for (int i = 0; i < BLOCKS_2X2; i++) out[i] = features.blocks_2x2[COARSE_SIMILARITY][i];
      continue;
    }
    fetch_luma(1 + n, top, left, motion, t, context, near);
    fetch_luma(3 * n, top, left, motion, t, context, far);
    for (int i = 0; i < BLOCKS_2X2; i += 16) {
      const F16 difference = absolute(load<F16>(near + i) - load<F16>(far + i));
      store(near + i, difference * difference);
    }
    average_patches(near, far);
    write_decay(far, 0, context.luma_scale * FINE_LUMA, 1, out);
  }
  for (int i = 0; i < BLOCKS_2X2; i += 16)
    store(features.blocks_2x2[ONWARD_DISTANCE] + i,
          absolute(load<F16>(features.blocks_2x2[ONWARD0] + i) - load<F16>(features.blocks_2x2[ONWARD1] + i)));
}

// Writes the features of a candidate, of which the squared differences at each 2x2 block are given.
inline void extract_candidate_features(const float *squared, float scale, Int top, Int left, const Motion &motion,
                                       float prior, float support, float t, const PairContext &context,
                                       Features &features) {
  alignas(64) float values[BLOCKS_2X2], flatness[BLOCKS_8X8];
  write_decay(squared, 0, scale, 1, values);
  average_patches(values, features.blocks_2x2[SIMILARITY]);
  average_patches(squared, values);
  write_decay(values, 0, scale * FINE, 1, features.blocks_2x2[FINE_SIMILARITY]);
  write_decay(values, 0, scale * COARSE, 1, features.blocks_2x2[COARSE_SIMILARITY]);
  extract_field_features(top, left, motion, t, context, features, flatness);
  upsample_8x8(flatness, features.blocks_2x2[FLATNESS]);
  extract_onward_features(top, left, motion, t, context, features);
  features.window[CONSTANT] = 1;
  features.window[VOTES] = prior;
  const float bend = absolute(motion.acceleration_x) + absolute(motion.acceleration_y);
  features.window[ACCELERATION] = min(bend * 0.125f, 1.f);
  const float gradient = absolute(motion.dx_along_x) + absolute(motion.dy_along_x) + absolute(motion.dx_along_y) +
                         absolute(motion.dy_along_y);
  features.window[GRADIENT] = min(gradient, 0.5f);
  features.window[SUPPORT] = float(__builtin_log(double(support + MIN_SUPPORT)));  // the same float by any library
}

}  // namespace
