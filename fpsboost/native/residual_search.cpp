// Residual search for small objects that the motion of their surroundings does not explain: unexplained points of one
// frame are compared with those of the other one.
#include "forward_backward.h"
#include "plane_pair.h"
#include "similarity.h"

namespace {

// Pixels that are compared with one at a time.
constexpr Int POSITIONS = 16;

constexpr U16 PLACES = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

// What is compared around each point.
struct Patch {
  Int radius, size;
  B16 max_similarity;
  float share;  // of one pixel's similarity in that of the patch, which is 1 at the most

  Patch(const Frames<uint8_t> &frames, Int radius)
      : radius(radius), size(2 * radius + 1), max_similarity(broadcast_byte(uint8_t(frames.max_similarity))),
        share(float(1 / double(frames.max_similarity * size * size))) {}
};

// Measures the similarity, 0 to 1, of the small patches at both ends of every point's motion.
FORCE_INLINE void measure_similarity(const Frames<uint8_t> &frames, Int step, const Patch &patch,
                                     const View<float, 3> &flow, const View<float, 2> &similarity) {
  for (Int row = 0; row < flow.shape[0]; row++)
    for (Int point = 0; point < flow.shape[1]; point++) {
      const Int y = point_centre(row, step, frames.height), x = point_centre(point, step, frames.width);
      const float *vector = flow.ptr(row, point);
      const Int end_y = clamp(y + Int(__builtin_rintf(vector[1])), Int(0), frames.height - 1);
      const Int end_x = clamp(x + Int(__builtin_rintf(vector[0])), Int(0), frames.width - 1);
      const uint8_t *first = frames.first + frames.place(y - patch.radius, x - patch.radius);
      const uint8_t *second = frames.second + frames.place(end_y - patch.radius, end_x - patch.radius);
      U16 columns = {};
      for (Int j = 0; j < patch.size; j++, first += frames.stride, second += frames.stride) {
        const B16 pixels[3] = {load<B16>(first), load<B16>(first + frames.plane), load<B16>(first + 2 * frames.plane)};
        columns += linear_similarity(pixels, second, frames.plane, patch.max_similarity);
      }
      int32_t total = 0;
      for (Int i = 0; i < patch.size; i++) total += columns[i];
      similarity(row, point) = float(total) * patch.share;
    }
}

// Writes the lowest of each value and its eight neighbours.
FORCE_INLINE void find_lowest_neighbours(const View<float, 2> &values, const View<float, 2> &lowest) {
  const Int rows = values.shape[0], columns = values.shape[1];
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++) {
      float value = values(row, column);
      for (Int y = max(row - 1, Int(0)); y < min(row + 2, rows); y++)
        for (Int x = max(column - 1, Int(0)); x < min(column + 2, columns); x++) value = min(value, values(y, x));
      lowest(row, column) = value;
    }
}

// Replaces each value by where its run of unexplained points ends in the row; negative in runs of explained points.
FORCE_INLINE void mark_runs(float min_similarity, const View<float, 2> &lowest) {
  const Int columns = lowest.shape[1];
  for (Int row = 0; row < lowest.shape[0]; row++) {
    Int end = columns;
    bool right = false;
    for (Int column = columns - 1; column >= 0; column--) {
      const bool unexplained = lowest(row, column) < min_similarity;
      if (unexplained != right) end = column + 1;
      right = unexplained;
      lowest(row, column) = float(unexplained ? end : -end);
    }
  }
}

// The lowest sum of which the share is above a value.
FORCE_INLINE Int lowest_above(float value, float share) {
  Int sum = Int(value / share);
  while (float(sum - 1) * share > value) sum--;
  while (float(sum) * share <= value) sum++;
  return sum;
}

// Sums of similarities at several positions in each of two rows, one below the other.
struct PositionSums {
  W32 both;

  FORCE_INLINE U16 row(int n) const {
    U16 rows[2];
    __builtin_memcpy(rows, &both, sizeof both);
    return rows[n];
  }
};

// Sums the similarities of the patch around one position and those around several positions in two rows. Returns false
// as soon as none of the sums that are counted can reach `lowest`.
FORCE_INLINE bool compare_positions(const Frames<uint8_t> &frames, const Patch &patch, const uint8_t *first,
                                    const uint8_t *second, const U16 (&counted)[2], Int lowest, PositionSums &total) {
  const Int radius = patch.radius;
  if (lowest > patch.size * patch.size * frames.max_similarity) return false;
  const B32 max_similarity = uint8_t(frames.max_similarity) - B32{};
  total.both = W32{};
  for (Int j = -radius; j <= radius; j++) {
    for (Int k = -radius; k <= radius; k++) {
      const uint8_t *pixel = first + j * frames.stride + k, *other = second + j * frames.stride + k;
      B32 sum{};
      for (int c = 0; c < 3; c++) {
        const uint8_t *above = other + c * frames.plane;
        add_difference(pixel[c * frames.plane] - B32{}, join(load<B16>(above), load<B16>(above + frames.stride)), sum);
      }
      total.both += as_words(max(max_similarity, sum) - sum);
    }
    const Int at_least = lowest - (radius - j) * patch.size * frames.max_similarity;
    if (at_least <= 0) continue;
    const U16 reached = as<U16>(total.row(0) >= uint16_t(at_least)) & counted[0];
    if (!any(reached | (as<U16>(total.row(1) >= uint16_t(at_least)) & counted[1]))) return false;
  }
  return true;
}

// Replaces the motion of unexplained points by motion to unexplained positions of the other frame, in whole pixels.
FORCE_INLINE void search_residuals(const Frames<uint8_t> &frames, const SearchResidualsBidirectional &args,
                                   const Patch &patch, const View<float, 2> &similarity,
                                   const View<float, 2> &other_runs, const View<float, 3> &flow) {
  const Int step = args.step;
  const float min_similarity = args.min_similarity, better = args.better;
  for (Int row = 0; row < similarity.shape[0]; row++)
    for (Int point = 0; point < similarity.shape[1]; point++) {
      if (similarity(row, point) >= min_similarity) continue;
      const Int y = point_centre(row, step, frames.height), x = point_centre(point, step, frames.width);
      const Int top = max(y - args.max_offset, Int(0)), bottom = min(y + args.max_offset, frames.height - 1);
      const Int left = max(x - args.max_offset, Int(0)), right = min(x + args.max_offset, frames.width - 1);
      const uint8_t *pixel = frames.first + frames.place(y, x);
      Int lowest = lowest_above(similarity(row, point) + better, patch.share);
      for (Int other_row = top / step; other_row <= bottom / step; other_row++) {
        const float *ends = other_runs.ptr(other_row);
        for (Int other = left / step; other <= right / step;) {
          const Int begin = other, end = Int(ends[begin]);
          if (end < 0) {
            other = -end;
            continue;
          }
          // unexplained neighbours are compared together, up to one vector of pixels
          other = min(min(end, begin + POSITIONS / step), right / step + 1);
          const Int first = max(begin * step, left), count = min(other * step - 1, right) - first + 1;
          const Int last_y = min(other_row * step + step - 1, bottom);
          for (Int above = max(other_row * step, top); above <= last_y; above += 2) {
            const U16 in_row = as<U16>(uint16_t(count) > PLACES),
                      counted[2] = {in_row, above < last_y ? in_row : U16{}};
            PositionSums total;
            const uint8_t *second = frames.second + frames.place(above, first);
            if (!compare_positions(frames, patch, pixel, second, counted, lowest, total)) continue;
            for (Int other_y = above; other_y <= min(above + 1, last_y); other_y++) {
              const U16 sums = total.row(int(other_y - above));
              for (Int i = 0; i < count; i++) {
                if (sums[i] >= lowest) {
                  lowest = lowest_above(float(sums[i]) * patch.share, patch.share);
                  flow(row, point, 0) = float(first + i - x);
                  flow(row, point, 1) = float(other_y - y);
                }
              }
            }
          }
        }
      }
    }
}

}  // namespace

KERNEL(void, search_residuals_bidirectional, const SearchResidualsBidirectional &args) {
  const View<float, 4> flow(args.flow), measured(args.similarity);
  const View<float, 3> similarity = measured[0], runs = measured[1];
  const Frames<uint8_t> forward(args.pair), backward = forward.opposite();
  const Patch patch(forward, args.patch_radius);
  for (int direction = 0; direction < 2; direction++) {
    measure_similarity(direction ? backward : forward, args.step, patch, flow[direction], similarity[direction]);
    find_lowest_neighbours(similarity[direction], runs[direction]);
    mark_runs(args.min_similarity, runs[direction]);
  }
  for (int direction = 0; direction < 2; direction++)
    search_residuals(direction ? backward : forward, args, patch, similarity[direction], runs[1 - direction],
                     flow[direction]);
}

KERNEL(void, relax_smoothness, const RelaxSmoothness &args) {
  const View<const float, 4> flow(args.flow), before(args.before);
  const View<float, 3> smoothness_weight(args.smoothness_weight);
  const float step = args.step, tolerance = args.tolerance, weak = args.weak;
  const FieldLayout points{1, flow.shape[1], flow.shape[2]};
  for (int direction = 0; direction < 2; direction++)
    for (Int row = 0; row < smoothness_weight.shape[1]; row++)
      for (Int point = 0; point < smoothness_weight.shape[2]; point++) {
        const float *vector = flow.ptr(direction, row, point), *old = before.ptr(direction, row, point);
        const float change = max(absolute(vector[0] - old[0]), absolute(vector[1] - old[1]));
        // in units of points: the way back is that of the point nearest to the end of a vector, not of its pixel
        const float error =
            forward_backward_error(vector[0] / step, vector[1] / step, flow[1 - direction], points, row, point, step)
                .distance;
        smoothness_weight(direction, row, point) = change > 1 && error * step <= tolerance ? weak : 1;
      }
}
