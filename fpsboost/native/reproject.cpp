// Source pixels of an in-between pixel: the report's two searches (section 3), and splatting as in video coding.
#include "rounding.h"

namespace {

typedef View<const float, 3> Flow;  // motion of the source frame

constexpr int32_t NO_SOURCE = -1;
constexpr float MAX_FLOAT = 0x1.fffffep127f;

struct Place {
  Int y, x;
};

// How far from a target a source lands at time t.
struct LandingError {
  float dx, dy;

  LandingError(const Flow &flow, float t, const Place &source, const Place &target)
      : dx(float(source.x) + t * flow(source.y, source.x, 0) - float(target.x)),
        dy(float(source.y) + t * flow(source.y, source.x, 1) - float(target.y)) {}
  bool lands() const { return absolute(dx) <= 0.5f && absolute(dy) <= 0.5f; }
};

// The index from which a motion leads to the target along an axis; half pixels round towards the target.
//
// A motion and its opposite therefore have the same length, and frame 0 and frame 1 the same influence. Indices of axes
// are exact in float32.
FORCE_INLINE Int step_back(Int target, float motion, Int size) {
  const float steps = __builtin_ceilf(min(float(size), absolute(motion)) - 0.5f);
  return Int(clamp(float(target) + (motion > 0 ? -steps : steps), 0.0f, float(size - 1)));  // NaN leads to the first
}

// The cell of a landing position; those outside of the frame are assigned to the nearest cell inside.
FORCE_INLINE int32_t find_cell(const Flow &flow, float t, Int y, Int x) {
  const float *motion = flow.ptr(y, x);
  const int32_t cell_x = nearest_index(float(x) + t * motion[0], flow.shape[1]);
  return nearest_index(float(y) + t * motion[1], flow.shape[0]) * int32_t(flow.shape[1]) + cell_x;
}

// The best source of a target so far.
struct NearestLanding {
  const Flow &flow;
  float t;
  Int search_radius;
  Place target;
  float distance = MAX_FLOAT;  // squared, as is `length`, the distance of the source itself
  Int length = 0, winner;

  NearestLanding(const Flow &flow, float t, Int search_radius, const Place &target)
      : flow(flow), t(t), search_radius(search_radius), target(target), winner(target.y * flow.shape[1] + target.x) {}

  void consider(Int pixel) {
    const Place source{pixel / flow.shape[1], pixel % flow.shape[1]};
    const Int away_y = source.y - target.y, away_x = source.x - target.x;
    if (max(away_y, -away_y) > search_radius || max(away_x, -away_x) > search_radius) return;
    const LandingError error(flow, t, source, target);
    const float new_distance = error.dx * error.dx + error.dy * error.dy;
    const Int new_length = away_y * away_y + away_x * away_x;
    const bool nearer_source = new_length < length || (new_length == length && pixel < winner);
    if (!(new_distance < distance || (new_distance == distance && nearer_source))) return;
    distance = new_distance;
    length = new_length;
    winner = pixel;
  }
};

template <typename T> void fetch(const FetchBoth &args) {
  const View<const T, 3> image0(args.image0), image1(args.image1);
  const View<const int32_t, 2> source0(args.source0), source1(args.source1);
  const View<const bool, 2> lands0(args.lands0), lands1(args.lands1);
  const Int pixels = image0.shape[0] * image0.shape[1], channels = image0.shape[2];
  const float t = args.t, half = args.half;
  for (Int pixel = 0; pixel < pixels; pixel++) {
    const bool in0 = lands0.data[pixel], in1 = lands1.data[pixel];
    const float weight = in0 == in1 ? t : float(in1);
    const T *colour0 = image0.data + source0.data[pixel] * channels;
    const T *colour1 = image1.data + source1.data[pixel] * channels;
    T *out = as<T *>(args.out.data) + pixel * channels;
    for (Int c = 0; c < channels; c++) out[c] = T((1 - weight) * float(colour0[c]) + weight * float(colour1[c]) + half);
  }
}

}  // namespace

KERNEL(void, search_iteratively, const SearchIteratively &args) {
  const Flow flow(args.flow);
  const View<int32_t, 2> source(args.source);
  const View<bool, 2> lands(args.lands);
  const Int height = flow.shape[0], width = flow.shape[1];
  const float t = args.t;
  for (Int y = 0; y < height; y++)
    for (Int x = 0; x < width; x++) {
      Place found{y, x};
      Int first = 0;
      bool success = false;
      for (Int iteration = 0; iteration < args.iterations && !success; iteration++) {
        const float *motion = flow.ptr(found.y, found.x);
        found = {step_back(y, t * motion[1], height), step_back(x, t * motion[0], width)};
        if (iteration == 0) first = found.y * width + found.x;
        success = LandingError(flow, t, found, {y, x}).lands();
      }
      source(y, x) = int32_t(success ? found.y * width + found.x : first);
      lands(y, x) = success;
    }
}

// A counting sort, in raster order within a cell.
KERNEL(void, bin_landings, const BinLandings &args) {
  const Flow flow(args.flow);
  int32_t *starts = args.starts.data, *members = args.members.data;
  const Int height = flow.shape[0], width = flow.shape[1], pixels = height * width;
  const float t = args.t;
  for (Int cell = 0; cell <= pixels; cell++) starts[cell] = 0;
  for (Int y = 0; y < height; y++)
    for (Int x = 0; x < width; x++) starts[find_cell(flow, t, y, x)]++;
  for (Int cell = 0; cell < pixels; cell++) starts[cell + 1] += starts[cell];
  // from the ends of the cells back to their starts
  for (Int y = height - 1; y >= 0; y--)
    for (Int x = width - 1; x >= 0; x--) members[--starts[find_cell(flow, t, y, x)]] = int32_t(y * width + x);
}

KERNEL(void, search_nearest_landing, const SearchNearestLanding &args) {
  const Flow flow(args.flow);
  const View<int32_t, 2> source(args.source);
  const View<bool, 2> lands(args.lands);
  const int32_t *starts = args.starts.data, *members = args.members.data;
  const Int height = flow.shape[0], width = flow.shape[1];
  const float t = args.t;
  for (Int y = 0; y < height; y++)
    for (Int x = 0; x < width; x++) {
      NearestLanding nearest(flow, t, args.search_radius, {y, x});
      for (Int ring = 0; ring < max(height, width); ring++) {
        // minimum distance in x or in y of a landing position in this ring
        const float bound = max(0.0f, float(ring) - 0.5f);
        if (bound * bound > nearest.distance) break;
        for (Int cell_y = max(Int(0), y - ring); cell_y <= min(height - 1, y + ring); cell_y++) {
          const Int step = ring == 0 || cell_y == y - ring || cell_y == y + ring ? 1 : 2 * ring;
          for (Int cell_x = x - ring; cell_x <= x + ring; cell_x += step) {
            if (cell_x < 0 || cell_x >= width) continue;
            const Int cell = cell_y * width + cell_x;
            for (Int k = starts[cell]; k < starts[cell + 1]; k++) nearest.consider(members[k]);
          }
        }
      }
      const Int winner = nearest.winner;
      source(y, x) = int32_t(winner);
      lands(y, x) = LandingError(flow, t, {winner / width, winner % width}, {y, x}).lands();
    }
}

KERNEL(void, fetch_both, const FetchBoth &args) {
  with_pixel_type(args.image0.kind, [&](auto pixel) { fetch<decltype(pixel)>(args); });
}

KERNEL(void, splat, const Splat &args) {
  const Flow flow(args.flow);
  const View<const float, 2> similarity(args.similarity);
  const View<int32_t, 2> source0(args.source0), source1(args.source1);
  const Int height = similarity.shape[0], width = similarity.shape[1];
  const float t = args.t, least_similarity = args.least_similarity;
  for (Int pixel = 0; pixel < height * width; pixel++) source0.data[pixel] = NO_SOURCE;
  for (Int y = 0; y < height; y++)
    for (Int x = 0; x < width; x++) {
      if (!(similarity(y, x) >= least_similarity)) continue;
      const float place_y = __builtin_floorf(float(y) + t * flow(y, x, 1) + 0.5f);
      const float place_x = __builtin_floorf(float(x) + t * flow(y, x, 0) + 0.5f);
      if (!(place_y >= 0 && place_y < float(height) && place_x >= 0 && place_x < float(width))) continue;
      int32_t &winner = source0(Int(place_y), Int(place_x));
      if (winner == NO_SOURCE || similarity(y, x) > similarity.data[winner]) winner = int32_t(y * width + x);
    }
  for (Int y = 0; y < height; y++)
    for (Int x = 0; x < width; x++) {
      const Int pixel = source0(y, x);
      if (pixel == NO_SOURCE) {
        source0(y, x) = source1(y, x) = int32_t(y * width + x);
        continue;
      }
      source1(y, x) = find_cell(flow, 1, pixel / width, pixel % width);
    }
}
