// What speaks for a candidate at each square of a window: similarities, and what the fields and further frames say.
//
// A feature is a number of one square and one candidate. Those of the samples differ from square to square; those of
// the motion fields are looked up for cells of eight pixels, as the fields' own points are that far apart, and
// interpolated.
#pragma once
#include "window_rows.h"

namespace {

constexpr int CELLS_PER_ROW = 4, CELLS = CELLS_PER_ROW * CELLS_PER_ROW, CELL = WINDOW / CELLS_PER_ROW;

// Features of squares.
enum { SIMILARITY, FINE_SIMILARITY, COARSE_SIMILARITY, FLATNESS, ONWARD0, ONWARD1, ONWARD_DISTANCE, SQUARE_FEATURES };
// Features of cells: each of these of frame 0, then of frame 1, then how far both are apart.
enum { SEARCH_SIMILARITY = 0, AGREEMENT = 3, CONSISTENCY = 6, LANDINGS = 9, CELL_FEATURES = 12 };
enum { CONSTANT, VOTES, ACCELERATION, GRADIENT, SUPPORT, SCALAR_FEATURES };  // features of the whole window
static_assert(FEATURES == SQUARE_FEATURES + CELL_FEATURES + SCALAR_FEATURES, "as in the table of weights");

constexpr float FINE = 100, COARSE = 9;  // factors on squared differences for bandwidths of 0.03 and 0.1 instead of 0.3
constexpr float FINE_LUMA = 25;          // the same for luma, for a bandwidth of 0.06
constexpr float LEAST_SUPPORT = 0.02f;   // so that the logarithm of the support has a limit

struct Features {  // of a candidate
  alignas(64) float squares[SQUARE_FEATURES][SQUARES_PER_WINDOW], cells[CELL_FEATURES][CELLS];
  float scalars[SCALAR_FEATURES];
};

// Share of each cell of a row in each square of a row.
struct CellShares {
  alignas(64) float values[CELLS_PER_ROW][SQUARES_PER_ROW];

  constexpr CellShares() : values() {
    for (int cell = 0; cell < CELLS_PER_ROW; cell++)
      for (int i = 0; i < SQUARES_PER_ROW; i++) {
        float place = (float(i) + 0.5f) / (SQUARES_PER_ROW / CELLS_PER_ROW) - 0.5f;
        place = place < 0 ? 0 : place > CELLS_PER_ROW - 1 ? CELLS_PER_ROW - 1 : place;
        const float apart = place < float(cell) ? float(cell) - place : place - float(cell);
        values[cell][i] = apart < 1 ? 1 - apart : 0;
      }
  }
};
constexpr CellShares CELL_SHARES;

INLINE const float *cell_shares(int cell) { return CELL_SHARES.values[cell]; }

struct CellRows {  // values of the cells, interpolated at the squares along rows
  alignas(64) float values[CELLS_PER_ROW][SQUARES_PER_ROW];
};

// The rows of cells between which a row of squares is: the first of two, and the shares of both.
struct Between {
  int first;
  float below, above;
};

INLINE Between rows_of_cells(int j) {
  const int first = least(most(2 * j - CELL / 2, 0) / CELL, CELLS_PER_ROW - 2);
  return {first, CELL_SHARES.values[first][j], CELL_SHARES.values[first + 1][j]};
}

INLINE void spread_across(const float *cells, CellRows &rows) {
  for (int v = 0; v < CELLS_PER_ROW; v++) {
    F16 sum{};
    for (int u = 0; u < CELLS_PER_ROW; u++)
      sum = fma(broadcast<F16>(cells[v * CELLS_PER_ROW + u]), load<F16>(cell_shares(u)), sum);
    store(rows.values[v], sum);
  }
}

inline void spread_cells(const float *cells, float *squares) {
  CellRows rows;
  spread_across(cells, rows);
  for (int j = 0; j < SQUARES_PER_ROW; j++) {
    const Between at = rows_of_cells(j);
    const F16 sum = fma(broadcast<F16>(at.below), load<F16>(rows.values[at.first]), F16{});
    store(squares + j * SQUARES_PER_ROW, fma(broadcast<F16>(at.above), load<F16>(rows.values[at.first + 1]), sum));
  }
}

// Where in the luma of a frame at some time, which has half the size, a pixel of the in-between frame is.
inline Position locate_luma(Int top, Int left, float time, const Motion &motion, float t, const PairContext &context) {
  const float bent = (t * (1 - t) - time * (1 - time)) * 0.5f;
  const float x = (float(left) + (time - t) * motion.dx + bent * motion.acceleration_x) * 0.5f;
  const float y = (float(top) + (time - t) * motion.dy + bent * motion.acceleration_y) * 0.5f;
  const Int rows = context.luma[1].shape[0], stride = context.luma[1].shape[1];
  return {within(y + MARGIN, 2.f, float(rows - MARGIN + 2)),
          within(x + MARGIN, 2.f, float(stride - SQUARES_PER_ROW - MARGIN + 2))};
}

// Samples the luma of a frame along a candidate, one sample for each square.
inline void fetch_luma(int frame, Int top, Int left, const Motion &motion, float t, const PairContext &context,
                       float *out) {
  const View<const float, 2> luma(context.luma[frame]);
  const float time = float(context.times[frame]);
  const Position at = locate_luma(top, left, time, motion, t, context);
  if (motion.is_rigid())
    filter_rigid(luma.data, luma.shape[1], at, SQUARES_PER_ROW, SQUARES_PER_ROW, out);
  else
    filter_blocks(luma.data, luma.shape[0], luma.shape[1], at, time - t, motion, SQUARES_PER_ROW, SQUARES_PER_ROW, out);
}

struct PointValues {  // what a motion field says at a place
  double similarity, agreement, consistency, flatness;
};

// Looks up the field at a place in cells, bilinearly, and how far it agrees with a motion.
INLINE PointValues look_up(const View<const float, 3> &points, double x, double y, double dx, double dy) {
  const Int rows = points.shape[0], columns = points.shape[1];
  x = within(x - 0.5, 0.0, double(columns - 1)), y = within(y - 0.5, 0.0, double(rows - 1));
  const Int left = Int(x), top = Int(y), right = least(left + 1, columns - 1), bottom = least(top + 1, rows - 1);
  const double part_x = x - double(left), part_y = y - double(top);
  const double shares[] = {(1 - part_y) * (1 - part_x), (1 - part_y) * part_x, part_y * (1 - part_x), part_y * part_x};
  const float *const corners[] = {points.at(top, left), points.at(top, right), points.at(bottom, left),
                                  points.at(bottom, right)};
  PointValues sum = {};
  for (int n = 0; n < 4; n++) {
    const float *point = corners[n];
    sum.similarity += shares[n] * double(point[2]);
    const double apart = most(__builtin_fabs(double(point[0]) - dx), __builtin_fabs(double(point[1]) - dy));
    sum.agreement += shares[n] / (1 + apart);
    sum.consistency += shares[n] * double(point[3]);
    sum.flatness += shares[n] * double(point[4]);
  }
  return sum;
}

// Writes what the motion fields say of a candidate, in double precision; and the flatness of each cell.
inline void describe_cells(Int top, Int left, const Motion &motion, float t, const PairContext &context,
                           Features &features, float *flatness) {
  const View<const float, 3> points[] = {View<const float, 3>(context.points[0]),
                                         View<const float, 3>(context.points[1])};
  const View<const float, 3> landings(context.landings);
  const float curve = t * (1 - t) * 0.5f, per_step = 1 / float(context.step);
  const float bent_x = curve * motion.acceleration_x, bent_y = curve * motion.acceleration_y;
  const double turns = motion.is_rigid() ? 0 : 1;
  for (int cell = 0; cell < CELLS; cell++) {
    const float across = float(cell % CELLS_PER_ROW * CELL + CELL / 2),
                down = float(cell / CELLS_PER_ROW * CELL + CELL / 2);
    const double from_x = (double(across) - WINDOW / 2) * turns, from_y = (double(down) - WINDOW / 2) * turns;
    const double dx = motion.dx + from_x * double(motion.dx_along_x) + from_y * double(motion.dx_along_y);
    const double dy = motion.dy + from_x * double(motion.dy_along_x) + from_y * double(motion.dy_along_y);
    const float x = float(left) + across, y = float(top) + down;
    const double x0 = x - t * dx + bent_x, y0 = y - t * dy + bent_y;
    flatness[cell] = 0;
    for (int n = 0; n < 2; n++) {
      const double sign = 1 - 2 * n;
      const PointValues found =
          look_up(points[n], (x0 + n * dx) * per_step, (y0 + n * dy) * per_step, sign * dx, sign * dy);
      features.cells[SEARCH_SIMILARITY + n][cell] = float(found.similarity);
      features.cells[AGREEMENT + n][cell] = float(found.agreement);
      features.cells[CONSISTENCY + n][cell] = float(found.consistency);
      flatness[cell] = float(flatness[cell] + 0.5 * found.flatness);
    }
    const Int row = within(Int(__builtin_floorf(y * per_step)), Int(0), landings.shape[1] - 1);
    const Int column = within(Int(__builtin_floorf(x * per_step)), Int(0), landings.shape[2] - 1);
    for (int n = 0; n < 2; n++) features.cells[LANDINGS + n][cell] = landings(n, row, column);
  }
  for (int n = 0; n < CELL_FEATURES; n += 3)
    store(features.cells[n + 2], absolute(load<F16>(features.cells[n]) - load<F16>(features.cells[n + 1])));
}

// Writes the similarities of the frames onward, before and after the two, along a candidate.
inline void describe_onward(Int top, Int left, const Motion &motion, float t, const PairContext &context,
                            Features &features) {
  alignas(64) float near[SQUARES_PER_WINDOW], far[SQUARES_PER_WINDOW];
  for (int n = 0; n < 2; n++) {
    float *out = features.squares[ONWARD0 + n];
    if (context.luma[3 * n].shape[0] * context.luma[3 * n].shape[1] == 0) {  // there is no such frame
      for (int i = 0; i < SQUARES_PER_WINDOW; i++) out[i] = features.squares[COARSE_SIMILARITY][i];
      continue;
    }
    fetch_luma(1 + n, top, left, motion, t, context, near);
    fetch_luma(3 * n, top, left, motion, t, context, far);
    for (int i = 0; i < SQUARES_PER_WINDOW; i += 16) {
      const F16 apart = absolute(load<F16>(near + i) - load<F16>(far + i));
      store(near + i, apart * apart);
    }
    average_patches(near, far);
    write_decay(far, 0, float(context.luma_scale) * FINE_LUMA, 1, out);
  }
  for (int i = 0; i < SQUARES_PER_WINDOW; i += 16)
    store(features.squares[ONWARD_DISTANCE] + i,
          absolute(load<F16>(features.squares[ONWARD0] + i) - load<F16>(features.squares[ONWARD1] + i)));
}

// Writes the features of a candidate, of which the squared differences at each square are given.
inline void describe_candidate(const float *squared, float scale, Int top, Int left, const Motion &motion, float prior,
                               float support, float t, const PairContext &context, Features &features) {
  alignas(64) float values[SQUARES_PER_WINDOW], flatness[CELLS];
  write_decay(squared, 0, scale, 1, values);
  average_patches(values, features.squares[SIMILARITY]);
  average_patches(squared, values);
  write_decay(values, 0, scale * FINE, 1, features.squares[FINE_SIMILARITY]);
  write_decay(values, 0, scale * COARSE, 1, features.squares[COARSE_SIMILARITY]);
  describe_cells(top, left, motion, t, context, features, flatness);
  spread_cells(flatness, features.squares[FLATNESS]);
  describe_onward(top, left, motion, t, context, features);
  features.scalars[CONSTANT] = 1;
  features.scalars[VOTES] = prior;
  const float bend = absolute(motion.acceleration_x) + absolute(motion.acceleration_y);
  features.scalars[ACCELERATION] = least(bend * 0.125f, 1.f);
  const float gradient = absolute(motion.dx_along_x) + absolute(motion.dy_along_x) + absolute(motion.dx_along_y) +
                         absolute(motion.dy_along_y);
  features.scalars[GRADIENT] = least(gradient, 0.5f);
  features.scalars[SUPPORT] = float(__builtin_log(double(support + LEAST_SUPPORT)));  // the same float by any library
}

}  // namespace
