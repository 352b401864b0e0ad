// Residual search for small objects that the motion of their surroundings does not explain: unexplained points of one
// frame are compared with those of the other one.
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
INLINE void measure_similarity(const Frames<uint8_t> &frames, Int step, const Patch &patch, const View<float, 3> &flow,
                               const View<float, 2> &similarity) {
  for (Int row = 0; row < flow.shape[0]; row++)
    for (Int point = 0; point < flow.shape[1]; point++) {
      const Int y = point_centre(row, step, frames.height), x = point_centre(point, step, frames.width);
      const float *vector = flow.at(row, point);
      const Int there_y = within(y + Int(__builtin_rintf(vector[1])), Int(0), frames.height - 1);
      const Int there_x = within(x + Int(__builtin_rintf(vector[0])), Int(0), frames.width - 1);
      const uint8_t *first = frames.first + frames.place(y - patch.radius, x - patch.radius);
      const uint8_t *second = frames.second + frames.place(there_y - patch.radius, there_x - patch.radius);
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
INLINE void find_lowest_neighbours(const View<float, 2> &values, const View<float, 2> &lowest) {
  const Int rows = values.shape[0], columns = values.shape[1];
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++) {
      float value = values(row, column);
      for (Int y = most(row - 1, Int(0)); y < least(row + 2, rows); y++)
        for (Int x = most(column - 1, Int(0)); x < least(column + 2, columns); x++) value = least(value, values(y, x));
      lowest(row, column) = value;
    }
}

// The lowest sum of which the share is above a value.
INLINE Int lowest_above(float value, float share) {
  Int sum = Int(value / share);
  while (float(sum - 1) * share > value) sum--;
  while (float(sum) * share <= value) sum++;
  return sum;
}

// Sums the similarities of the patch around one position and those around several positions in a row. Returns false as
// soon as none of the sums that are counted can reach `lowest`.
INLINE bool compare_positions(const Frames<uint8_t> &frames, const Patch &patch, const uint8_t *first,
                              const uint8_t *second, U16 counted, Int lowest, U16 &total) {
  const Int radius = patch.radius;
  if (lowest > patch.size * patch.size * frames.max_similarity) return false;
  total = U16{};
  for (Int j = -radius; j <= radius; j++) {
    for (Int k = -radius; k <= radius; k++) {
      const uint8_t *pixel = first + j * frames.stride + k;
      const B16 pixels[3] = {broadcast_byte(pixel[0]), broadcast_byte(pixel[frames.plane]),
                             broadcast_byte(pixel[2 * frames.plane])};
      total += linear_similarity(pixels, second + j * frames.stride + k, frames.plane, patch.max_similarity);
    }
    const Int at_least = lowest - (radius - j) * patch.size * frames.max_similarity;
    if (at_least > 0 && !any((U16)(total >= uint16_t(at_least)) & counted)) return false;
  }
  return true;
}

// Replaces the motion of unexplained points by motion to unexplained positions of the other frame, in whole pixels.
INLINE void search_residuals(const Frames<uint8_t> &frames, const SearchResidualsBidirectional &a, const Patch &patch,
                             const View<float, 2> &similarity, const View<float, 2> &elsewhere,
                             const View<float, 3> &flow) {
  const Int step = a.step;
  const float min_similarity = float(a.min_similarity), better = float(a.better);
  for (Int row = 0; row < similarity.shape[0]; row++)
    for (Int point = 0; point < similarity.shape[1]; point++) {
      if (similarity(row, point) >= min_similarity) continue;
      const Int y = point_centre(row, step, frames.height), x = point_centre(point, step, frames.width);
      const Int top = most(y - a.max_offset, Int(0)), bottom = least(y + a.max_offset, frames.height - 1);
      const Int left = most(x - a.max_offset, Int(0)), right = least(x + a.max_offset, frames.width - 1);
      const uint8_t *pixel = frames.first + frames.place(y, x);
      Int lowest = lowest_above(similarity(row, point) + better, patch.share);
      for (Int there_row = top / step; there_row <= bottom / step; there_row++) {
        const float *is_explained = elsewhere.at(there_row);
        for (Int there = left / step; there <= right / step;) {
          if (is_explained[there] >= min_similarity) {
            there++;
            continue;
          }
          // unexplained neighbours are compared together, up to one vector of pixels
          const Int begin = there;
          while (there <= right / step && (there + 1 - begin) * step <= POSITIONS &&
                 is_explained[there] < min_similarity)
            there++;
          const Int first = most(begin * step, left), count = least(there * step - 1, right) - first + 1;
          const U16 counted = (U16)(uint16_t(count) > PLACES);
          const Int last_y = least(there_row * step + step - 1, bottom);
          for (Int there_y = most(there_row * step, top); there_y <= last_y; there_y++) {
            U16 total;
            const uint8_t *other = frames.second + frames.place(there_y, first);
            if (!compare_positions(frames, patch, pixel, other, counted, lowest, total)) continue;
            for (Int i = 0; i < count; i++) {
              if (total[i] >= lowest) {
                lowest = lowest_above(float(total[i]) * patch.share, patch.share);
                flow(row, point, 0) = float(first + i - x), flow(row, point, 1) = float(there_y - y);
              }
            }
          }
        }
      }
    }
}

// Distance by which a vector, in units of points, and that of the nearest point to its end do not lead back.
INLINE float forward_backward_error(const View<const float, 3> &back, Int row, Int point, float dx, float dy,
                                    float step) {
  const Int end_y = within(Int(__builtin_rint(double(row) + double(dy))), Int(0), back.shape[0] - 1);
  const Int end_x = within(Int(__builtin_rint(double(point) + double(dx))), Int(0), back.shape[1] - 1);
  const double apart_x = double(dx + back(end_y, end_x, 0) / step), apart_y = double(dy + back(end_y, end_x, 1) / step);
  return float(__builtin_sqrt(apart_x * apart_x + apart_y * apart_y));
}

}  // namespace

KERNEL(void, search_residuals_bidirectional, SearchResidualsBidirectional) {
  const View<float, 4> flow(a.flow), measured(a.similarity);
  const View<float, 3> similarity = measured[0], lowest = measured[1];
  const Frames<uint8_t> there(a.pair), back = there.opposite();
  const Patch patch(there, a.patch_radius);
  for (int direction = 0; direction < 2; direction++) {
    measure_similarity(direction ? back : there, a.step, patch, flow[direction], similarity[direction]);
    find_lowest_neighbours(similarity[direction], lowest[direction]);
  }
  for (int direction = 0; direction < 2; direction++)
    search_residuals(direction ? back : there, a, patch, similarity[direction], lowest[1 - direction], flow[direction]);
}

KERNEL(void, loosen_ties, LoosenTies) {
  const View<const float, 4> flow(a.flow), before(a.before);
  const View<float, 3> ties(a.ties);
  const float step = float(a.step), tolerance = float(a.tolerance), weak = float(a.weak);
  for (int direction = 0; direction < 2; direction++)
    for (Int row = 0; row < ties.shape[1]; row++)
      for (Int point = 0; point < ties.shape[2]; point++) {
        const float *vector = flow.at(direction, row, point), *old = before.at(direction, row, point);
        const float change = most(absolute(vector[0] - old[0]), absolute(vector[1] - old[1]));
        // in units of points: the way back is that of the point nearest to the end of a vector, not of its pixel
        const float error =
            forward_backward_error(flow[1 - direction], row, point, vector[0] / step, vector[1] / step, step);
        ties(direction, row, point) = change > 1 && error * step <= tolerance ? weak : 1;
      }
}
