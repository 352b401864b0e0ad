// Pictures along motion that is interpolated between points, row by row: samples, and weighted sums of several.
#include "scratch.h"
#include "vectors.h"

namespace {

constexpr Int TAPS = 4;

// Where the pixels of an axis lie between the points of one: the one before, and the share of the next one.
struct Axis {
  int32_t *point;
  float *share;
  Int size, points;

  Axis(Int size, Int points, Workspace &workspace)
      : point(workspace.take<int32_t>(size)), share(workspace.take<float>(size)), size(size), points(points) {}
  void place(float share_between, float share_before) const {  // of the picture's size
    const float spacing = share_between * float(size), begin = share_before * float(size);
    const float last = float(points - 1), last_begin = float(max(points - 2, Int(0)));
    for (Int i = 0; i < size; i++) {
      const float at = clamp((float(i) + 0.5f - begin) / spacing - 0.5f, 0.0f, last);
      const float before = min(__builtin_floorf(at), last_begin);
      point[i] = int32_t(before);
      share[i] = at - before;
    }
  }
};

// Values of points in rows, of `PARTS` numbers each, interpolated at the pixels of a row.
template <Int PARTS> struct Interpolation {
  Axis across, down;
  float *mixed, *row;  // the points of the row, and its pixels

  Interpolation(Int height, Int width, const Int *points, Workspace &workspace)
      : across(width, points[1], workspace), down(height, points[0], workspace),
        mixed(workspace.take<float>(PARTS * (points[1] + 1))), row(workspace.take<float>(PARTS * width)) {}
  void place(const float *layout) const {  // by `kernels/smooth_motion.py`
    across.place(layout[0], layout[2]);
    down.place(layout[1], layout[3]);
  }
  const float *at(const float *values, Int y) const {
    const Int count = PARTS * across.points;
    const float *above = values + down.point[y] * count, *below = down.points > 1 ? above + count : above;
    const float below_share = down.share[y];
    for (Int i = 0; i < count; i++) mixed[i] = above[i] + (below[i] - above[i]) * below_share;
    for (Int part = 0; part < PARTS; part++) mixed[count + part] = mixed[count - PARTS + part];
    for (Int x = 0; x < across.size; x++) {
      const float *before = mixed + PARTS * across.point[x];
      for (Int part = 0; part < PARTS; part++)
        row[PARTS * x + part] = before[part] + (before[PARTS + part] - before[part]) * across.share[x];
    }
    return row;
  }
};

FORCE_INLINE float cubic(float distance) {  // with a = -0.75
  const float a = -0.75f, d = distance;
  return d < 1 ? ((a + 2) * d - (a + 3)) * d * d + 1 : ((a * d - 5 * a) * d + 8 * a) * d - 4 * a;
}

// Vector of 8 floats, or of 16.
template <bool IS_LONG> struct RowOf {
  typedef F8 Type;
};
template <> struct RowOf<true> {
  typedef F16 Type;
};

// Samples pixels of C values. Four pixels of a row are one vector, in which more may follow them.
template <Int C> struct Sampler {
  static constexpr Int LANES_OF_ROW = C > 2 ? 16 : 8;
  typedef typename RowOf<(C > 2)>::Type Row;
  typedef float Pixel __attribute__((vector_size(16)));

  const float *picture;
  Int height, width;
  Row *across;             // weights of each fraction, each for all values of its pixel
  float *down;             // of each fraction, TAPS
  int32_t *end_x, *end_y;  // ends of the motion in a row, in fractions of a pixel

  Sampler(const float *picture, Int height, Int width, Workspace &workspace)
      : picture(picture), height(height), width(width), across(workspace.take<Row>(FRACTIONS)),
        down(workspace.take<float>(FRACTIONS * TAPS)), end_x(workspace.take<int32_t>(width)),
        end_y(workspace.take<int32_t>(width)) {}

  void prepare() const {
    for (Int k = 0; k < FRACTIONS; k++) {
      const float fraction = float(k) / FRACTIONS;
      const float weights[TAPS] = {cubic(1 + fraction), cubic(fraction), cubic(1 - fraction), cubic(2 - fraction)};
      across[k] = Row{};
      for (Int n = 0; n < TAPS; n++) {
        down[TAPS * k + n] = weights[n];
        for (Int c = 0; c < C; c++) across[k][C * n + c] = weights[n];
      }
    }
  }

  // The sum of rows of pixels weighted by a fraction along both axes, in the first C lanes.
  FORCE_INLINE Pixel filter(const float *first, Int stride, Int fraction_x, Int fraction_y) const {
    const float *weights = down + TAPS * fraction_y;
    Row sum = load<Row>(first) * weights[0];
    for (Int n = 1; n < TAPS; n++) sum = sum + load<Row>(first + n * stride) * weights[n];
    sum = sum * across[fraction_x];
    const Pixel before = part<0>(sum) + part<C>(sum), after = part<2 * C>(sum) + part<3 * C>(sum);
    return before + after;
  }

  template <Int BEGIN> static FORCE_INLINE Pixel part(Row row) {
    Pixel pixel = {};
    for (Int c = 0; c < C; c++) pixel[c] = row[BEGIN + c];
    return pixel;
  }

  // Calls use(x, values) with the sample of each pixel of row y.
  template <typename Use> FORCE_INLINE void sample_row(const float *motion, Int y, const Use &use) const {
    const float farthest_x = float(FRACTIONS * (width + 1)), farthest_y = float(FRACTIONS * (height + 1));
    for (Int x = 0; x < width; x++) {
      const float to_x = (float(x) + motion[2 * x] * float(width)) * FRACTIONS + 0.5f;
      const float to_y = (float(y) + motion[2 * x + 1] * float(height)) * FRACTIONS + 0.5f;
      end_x[x] = int32_t(__builtin_floorf(clamp(to_x, float(-2 * FRACTIONS), farthest_x)));
      end_y[x] = int32_t(__builtin_floorf(clamp(to_y, float(-2 * FRACTIONS), farthest_y)));
    }
    const Int stride = C * width, last_row = height - TAPS - (LANES_OF_ROW > TAPS * C);
    for (Int x = 0; x < width; x++) {
      const Int fraction_x = end_x[x] & (FRACTIONS - 1), fraction_y = end_y[x] & (FRACTIONS - 1);
      const Int left = (end_x[x] - fraction_x) / FRACTIONS - 1, top = (end_y[x] - fraction_y) / FRACTIONS - 1;
      if (0 <= left && left <= width - TAPS && 0 <= top && top <= last_row) {
        use(x, filter(picture + top * stride + C * left, stride, fraction_x, fraction_y));
        continue;
      }
      float repeated[TAPS][LANES_OF_ROW] = {};
      for (Int j = 0; j < TAPS; j++)
        for (Int i = 0; i < TAPS; i++)
          for (Int c = 0; c < C; c++)
            repeated[j][C * i + c] =
                picture[clamp(top + j, Int(0), height - 1) * stride + C * clamp(left + i, Int(0), width - 1) + c];
      use(x, filter(repeated[0], LANES_OF_ROW, fraction_x, fraction_y));
    }
  }
};

template <Int C> Int sample_all(const SampleAlong &args) {
  const View<float, 3> sampled(args.sampled);
  const View<const float, 3> vectors(args.motion.vectors);
  const Int height = sampled.shape[0], width = sampled.shape[1];
  Workspace workspace(args.scratch);
  const Sampler<C> sampler(args.picture.data, height, width, workspace);
  const Interpolation<2> motion(height, width, vectors.shape, workspace);
  if (workspace.is_counting()) return workspace.size();
  sampler.prepare();
  motion.place(args.motion.layout.data);
  for (Int y = 0; y < height; y++) {
    float *row = sampled.ptr(y);
    sampler.sample_row(motion.at(vectors.data, y), y, [=](Int x, auto pixel) INLINE_LAMBDA {
      for (Int c = 0; c < C; c++) row[C * x + c] = pixel[c];
    });
  }
  return 0;
}

template <Int C> Int add_all(const AddAlong &args) {
  const View<float, 3> total(args.total);
  const View<float, 3> sums(args.sums);
  const View<const float, 3> vectors(args.motion.vectors);
  const View<const float, 2> weights(args.weights);
  const Int height = total.shape[0], width = total.shape[1];
  Workspace workspace(args.scratch);
  const Sampler<C> sampler(args.picture.data, height, width, workspace);
  const Interpolation<2> motion(height, width, vectors.shape, workspace);
  const Interpolation<1> weight(height, width, weights.shape, workspace);
  if (workspace.is_counting()) return workspace.size();
  sampler.prepare();
  weight.place(args.layout.data);
  const bool is_moving = vectors.data;
  if (is_moving) motion.place(args.motion.layout.data);
  for (Int y = 0; y < height; y++) {
    float *row = total.ptr(y), *sum = sums.ptr(y);
    const float *own = args.picture.data + y * C * width, *of_row = weight.at(weights.data, y);
    if (is_moving)
      sampler.sample_row(motion.at(vectors.data, y), y, [=](Int x, auto pixel) INLINE_LAMBDA {
        for (Int c = 0; c < C; c++) row[C * x + c] += pixel[c] * of_row[x];
      });
    else
      for (Int x = 0; x < width; x++)
        for (Int c = 0; c < C; c++) row[C * x + c] += own[C * x + c] * of_row[x];
    for (Int x = 0; x < width; x++) sum[x] += of_row[x];
  }
  return 0;
}

}  // namespace

KERNEL(Int, sample_along, const SampleAlong &args) {
  switch (args.picture.shape[2]) {
    case 1: return sample_all<1>(args);
    case 2: return sample_all<2>(args);
    case 3: return sample_all<3>(args);
    default: return sample_all<4>(args);
  }
}

KERNEL(Int, add_along, const AddAlong &args) {
  switch (args.picture.shape[2]) {
    case 1: return add_all<1>(args);
    case 2: return add_all<2>(args);
    case 3: return add_all<3>(args);
    default: return add_all<4>(args);
  }
}
