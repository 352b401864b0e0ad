// Search for the shortest motion around each point that explains the point about as well as its own motion.
//
// In a repeated pattern, many motions are equally similar. Comparison with the shorter motions of the surroundings
// shows which length is necessary.
#include "plane_pair.h"
#include "similarity.h"

namespace {

// Motion in whole pixels.
struct Offset {
  Int dx, dy;

  explicit Offset(const float *vector) : dx(Int(__builtin_rintf(vector[0]))), dy(Int(__builtin_rintf(vector[1]))) {}
  bool operator==(const Offset &other) const { return dx == other.dx && dy == other.dy; }
};

// Similarity of the patches at both ends of a motion, 0 to 1; negative if it leads out of the frame. At most sixteen
// columns are compared at once.
struct Patches {
  const Frames<float> &frames;
  Int radius, size;
  float share;

  Patches(const Frames<float> &frames, Int radius)
      : frames(frames), radius(radius), size(2 * radius + 1),
        share(float(1 / double(frames.max_similarity * size * size))) {}

  float compare(Int y, Int x, Int dx, Int dy) const {
    const Int end_y = y + dy, end_x = x + dx;
    if (end_y < 0 || end_x < 0 || end_y >= frames.height || end_x >= frames.width) return -1 * share;
    const float *first = frames.first + frames.place(y - radius, x - radius);
    const float *second = frames.second + frames.place(end_y - radius, end_x - radius);
    I16 columns = {};
    for (Int j = 0; j < size; j++, first += frames.stride, second += frames.stride) {
      I16 similarity[1];
      exponential_similarity(first, frames.plane, second, frames.plane, similarity);
      columns += similarity[0];
    }
    int32_t total = 0;
    for (Int i = 0; i < size; i++) total += columns[i];
    return float(total) * share;
  }
};

}  // namespace

KERNEL(void, find_shortest, const FindShortest &args) {
  const View<const float, 3> flow(args.flow);
  const View<float, 2> own(args.motion.own), best(args.motion.best), shortest(args.motion.shortest);
  const Frames<float> frames(args.pair);
  const Patches patches(frames, args.patch_radius);
  const Int rows = flow.shape[0], points = flow.shape[1], support = args.support_radius;
  const float tolerance = args.tolerance;
  for (Int row = 0; row < rows; row++)
    for (Int point = 0; point < points; point++) {
      const Int y = point_centre(row, args.step, frames.height), x = point_centre(point, args.step, frames.width);
      const float *vector = flow.ptr(row, point);
      Offset last(vector);
      own(row, point) = patches.compare(y, x, last.dx, last.dy);
      const float min_similarity = own(row, point) - tolerance, still = patches.compare(y, x, 0, 0);
      float highest = max(own(row, point), still);
      float min_length = still >= min_similarity ? 0 : max(absolute(vector[0]), absolute(vector[1]));
      for (Int other_row = max(row - support, Int(0)); other_row <= min(row + support, rows - 1); other_row++)
        for (Int other = max(point - support, Int(0)); other <= min(point + support, points - 1); other++) {
          const Offset offset(flow.ptr(other_row, other));
          if (offset == last) continue;  // usually equal to its neighbour
          last = offset;
          const float similarity = patches.compare(y, x, offset.dx, offset.dy);
          highest = max(highest, similarity);
          if (similarity >= min_similarity)
            min_length = min(min_length, max(absolute(float(offset.dx)), absolute(float(offset.dy))));
        }
      best(row, point) = highest;
      shortest(row, point) = min_length;
    }
}
