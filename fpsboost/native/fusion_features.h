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

// Looks up the field of frame n at a place of each 8x8 block in units of points, bilinearly, and how far its points
// agree with motions; writes its features, and its flatness.
inline void look_up(int n, const PairContext &context, F16 x, F16 y, F16 dx, F16 dy, Features &features,
                    float *flatness) {
  const View<const float, 3> points(context.points[n]);
  constexpr int CORNERS = 4, VALUES = 5;  // of a point: motion, similarity, consistency, flatness
  const int rows = int(points.shape[0]), columns = int(points.shape[1]);
  x = min(max(x - 0.5f, F16{}), broadcast<F16>(float(columns - 1)));
  y = min(max(y - 0.5f, F16{}), broadcast<F16>(float(rows - 1)));
  const I16 left = __builtin_convertvector(x, I16), top = __builtin_convertvector(y, I16);
  const I16 rightward = min(left + 1, I16{} + (columns - 1)) - left, downward = min(top + 1, I16{} + (rows - 1)) - top;
  const I16 first = (top * columns + left) * VALUES, across = rightward * VALUES, down = downward * columns * VALUES;
  const F16 part_x = x - __builtin_convertvector(left, F16), part_y = y - __builtin_convertvector(top, F16);
  alignas(64) int32_t places[CORNERS][BLOCKS_8X8];
  store(places[0], first);
  store(places[1], first + across);
  store(places[2], first + down);
  store(places[3], first + down + across);
  alignas(64) float shares[CORNERS][BLOCKS_8X8], motions[CORNERS][BLOCKS_8X8][2];
  store(shares[0], (1 - part_y) * (1 - part_x));
  store(shares[1], (1 - part_y) * part_x);
  store(shares[2], part_y * (1 - part_x));
  store(shares[3], part_y * part_x);
  for (int block = 0; block < BLOCKS_8X8; block++) {
    F4 sum{};
    for (int corner = 0; corner < CORNERS; corner++) {
      const float *point = points.data + places[corner][block];
      __builtin_memcpy(motions[corner][block], point, sizeof motions[corner][block]);
      sum += load<F4>(point + 1) * shares[corner][block];  // all but dx
    }
    features.blocks_8x8[SEARCH_SIMILARITY + n][block] = sum[1];
    features.blocks_8x8[CONSISTENCY + n][block] = sum[2];
    flatness[block] = sum[3];
  }
  F16 agreement{};
  for (int corner = 0; corner < CORNERS; corner++) {
    const F16 lower = load<F16>(motions[corner][0]), upper = load<F16>(motions[corner][BLOCKS_8X8 / 2]);
    const F16 difference = max(absolute(even_lanes(lower, upper) - dx), absolute(odd_lanes(lower, upper) - dy));
    agreement += load<F16>(shares[corner]) / (1 + difference);
  }
  store(features.blocks_8x8[AGREEMENT + n], agreement);
}

struct BlockCentres {  // of the 8x8 blocks, pixels from the first of the window
  alignas(64) float across[BLOCKS_8X8], down[BLOCKS_8X8];

  constexpr BlockCentres() : across(), down() {
    for (int block = 0; block < BLOCKS_8X8; block++) {
      across[block] = float(block % BLOCKS_8X8_PER_ROW * SIDE_8X8 + SIDE_8X8 / 2);
      down[block] = float(block / BLOCKS_8X8_PER_ROW * SIDE_8X8 + SIDE_8X8 / 2);
    }
  }
};
constexpr BlockCentres BLOCK_CENTRES;

FORCE_INLINE void write_distance(Features &features, int feature) {
  const float (*values)[BLOCKS_8X8] = features.blocks_8x8 + feature;
  store(features.blocks_8x8[feature + 2], absolute(load<F16>(values[0]) - load<F16>(values[1])));
}

// Writes how many points land at each 8x8 block, which is the same for all candidates of a node.
inline void extract_landings(Int top, Int left, const PairContext &context, Features &features) {
  const View<const float, 3> landings(context.landings);
  const float per_step = 1 / float(context.step);
  for (int block = 0; block < BLOCKS_8X8; block++) {
    const float x = float(left) + BLOCK_CENTRES.across[block], y = float(top) + BLOCK_CENTRES.down[block];
    const Int row = clamp(Int(__builtin_floorf(y * per_step)), Int(0), landings.shape[1] - 1);
    const Int column = clamp(Int(__builtin_floorf(x * per_step)), Int(0), landings.shape[2] - 1);
    for (int n = 0; n < 2; n++) features.blocks_8x8[LANDINGS + n][block] = landings(n, row, column);
  }
  write_distance(features, LANDINGS);
}

// Writes what the motion fields say of a candidate, and the flatness of each 8x8 block.
inline void extract_field_features(Int top, Int left, const Motion &motion, float t, const PairContext &context,
                                   Features &features, float *flatness) {
  const float curve = t * (1 - t) * 0.5f, per_step = 1 / float(context.step), turns = motion.is_rigid() ? 0 : 1;
  const F16 across = load<F16>(BLOCK_CENTRES.across), down = load<F16>(BLOCK_CENTRES.down);
  const F16 from_x = (across - float(WINDOW / 2)) * turns, from_y = (down - float(WINDOW / 2)) * turns;
  const F16 dx = motion.dx + from_x * motion.dx_along_x + from_y * motion.dx_along_y;
  const F16 dy = motion.dy + from_x * motion.dy_along_x + from_y * motion.dy_along_y;
  const F16 x0 = float(left) + across - t * dx + curve * motion.acceleration_x;
  const F16 y0 = float(top) + down - t * dy + curve * motion.acceleration_y;
  alignas(64) float flatness1[BLOCKS_8X8];
  look_up(0, context, x0 * per_step, y0 * per_step, dx, dy, features, flatness);
  look_up(1, context, (x0 + dx) * per_step, (y0 + dy) * per_step, -dx, -dy, features, flatness1);
  store(flatness, 0.5f * (load<F16>(flatness) + load<F16>(flatness1)));
  write_distance(features, SEARCH_SIMILARITY);
  write_distance(features, AGREEMENT);
  write_distance(features, CONSISTENCY);
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
