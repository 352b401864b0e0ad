// Weights of the pictures of which a guided frame is mixed, and what its guide shows beyond them.
#include "scratch.h"
#include "vectors.h"

namespace {

constexpr Int COLOURS = 3;
constexpr Int FINE_SIDE = 7, COARSE_SIDE = 3;  // squares in which power is measured, pixels
constexpr Int KEYS = 4096;                     // of powers

// The index that stands for one beyond the ends of an axis, mirrored at the first and last element.
Int mirrored(Int place, Int size) {
  if (size == 1) return 0;
  while (place < 0 || place >= size) place = place < 0 ? -place : 2 * (size - 1) - place;
  return place;
}

// Means over squares around each pixel.
struct BoxMean {
  Int height, width, side;
  float *line;  // a row of sums, with half a side of mirrored columns on either end

  BoxMean(Int height, Int width, Int most, Workspace &workspace)
      : height(height), width(width), side(most), line(workspace.take<float>(width + most)) {}

  // Calls use(x, mean) for each pixel of row y.
  template <typename Use> FORCE_INLINE void row(const float *values, Int y, const Use &use) const {
    const Int radius = side / 2;
    float *inner = line + radius;
    for (Int k = -radius; k <= radius; k++) {
      const float *from = values + mirrored(y + k, height) * width;
      if (k == -radius)
        for (Int x = 0; x < width; x++) inner[x] = from[x];
      else
        for (Int x = 0; x < width; x++) inner[x] += from[x];
    }
    for (Int k = 1; k <= radius; k++) {
      inner[-k] = inner[mirrored(-k, width)];
      inner[width - 1 + k] = inner[mirrored(width - 1 + k, width)];
    }
    const float share = 1 / float(side * side);
    for (Int x = 0; x < width; x++) {
      float sum = line[x];
      for (Int k = 1; k < side; k++) sum += line[x + k];
      use(x, sum * share);
    }
  }
  void all(const float *values, float *means) const {
    for (Int y = 0; y < height; y++) {
      float *to = means + y * width;
      row(values, y, [=](Int x, float mean) INLINE_LAMBDA { to[x] = mean; });
    }
  }
};

FORCE_INLINE float mean_square(const float *colours) {
  return (colours[0] * colours[0] + colours[1] * colours[1] + colours[2] * colours[2]) * float(1 / 3.0);
}

struct Picture {
  float *data;
  Int height, width;

  Int size() const { return COLOURS * height * width; }
  float *row(Int y) const { return data + y * COLOURS * width; }
};

// Halves a picture by the weights 1, 4, 6, 4, 1 along both axes (Burt and Adelson 1983).
void shrink(const Picture &from, const Picture &to, float *line) {
  for (Int y = 0; y < to.height; y++) {
    const float *rows[5];
    for (Int k = 0; k < 5; k++) rows[k] = from.row(mirrored(2 * y + k - 2, from.height));
    for (Int i = 0; i < COLOURS * from.width; i++)
      line[i] = (rows[0][i] + rows[4][i]) + 4 * (rows[1][i] + rows[3][i]) + 6 * rows[2][i];
    float *out = to.row(y);
    for (Int x = 0; x < to.width; x++) {
      const float *taps[5];
      for (Int k = 0; k < 5; k++) taps[k] = line + COLOURS * mirrored(2 * x + k - 2, from.width);
      for (Int c = 0; c < COLOURS; c++)
        out[COLOURS * x + c] =
            ((taps[0][c] + taps[4][c]) + 4 * (taps[1][c] + taps[3][c]) + 6 * taps[2][c]) * float(1 / 256.0);
    }
  }
}

// Adds a picture of half the size, enlarged by the same weights and times a sign; its edges are repeated.
void add_risen(const Picture &small, float sign, const Picture &to, float *line) {
  for (Int y = 0; y < to.height; y++) {
    const Int middle = y / 2, before = max(middle - 1, Int(0)), after = min(middle + 1, small.height - 1);
    const float *above = small.row(before), *here = small.row(middle), *below = small.row(after);
    for (Int i = 0; i < COLOURS * small.width; i++)
      line[i] = y % 2 ? (here[i] + below[i]) * 4 : above[i] + 6 * here[i] + below[i];
    float *out = to.row(y);
    for (Int x = 0; x < to.width; x++) {
      const float *centre = line + COLOURS * (x / 2);
      const float *right = line + COLOURS * min(x / 2 + 1, small.width - 1);
      const float *left = line + COLOURS * max(x / 2 - 1, Int(0));
      for (Int c = 0; c < COLOURS; c++) {
        const float risen = x % 2 ? (centre[c] + right[c]) * 4 : left[c] + 6 * centre[c] + right[c];
        out[COLOURS * x + c] += risen * (sign / 64);
      }
    }
  }
}

// A picture and its halved copies.
struct Pyramid {
  Int levels;
  Picture pictures[BANDS];

  Pyramid(Int height, Int width, Int levels, Workspace &workspace) : levels(levels) {
    for (Int k = 0; k < levels; k++) {
      const Int count = COLOURS * height * width;
      pictures[k] = {workspace.take<float>(count), height, width};
      height = (height + 1) / 2;
      width = (width + 1) / 2;
    }
  }
  // Keeps the bands of a Laplacian pyramid: each picture less what the next smaller one shows of it.
  void split(const float *values, float *line) const {
    for (Int i = 0; i < pictures[0].size(); i++) pictures[0].data[i] = values[i];
    for (Int k = 1; k < levels; k++) shrink(pictures[k - 1], pictures[k], line);
    for (Int k = 1; k < levels; k++) add_risen(pictures[k], -1, pictures[k - 1], line);
  }
};

// Keys of powers, which are as many in each octave, and whose order is that of the powers.
FORCE_INLINE int32_t power_key(float power) {
  int32_t bits;
  __builtin_memcpy(&bits, &power, sizeof bits);
  return max(bits, int32_t(0)) >> 19;  // 0 for what is none
}

FORCE_INLINE float power_of(Int key) {  // in the middle of those that have the key
  const int32_t bits = int32_t(key) << 19 | 1 << 18;
  float power;
  __builtin_memcpy(&power, &bits, sizeof power);
  return power;
}

FORCE_INLINE Int bin_of(float power, const float *limits, Int bins) {
  Int bin = 0;
  for (Int k = 0; k < bins - 1; k++) bin += power_key(power) > power_key(limits[k]);
  return bin;
}

// Bands of guides of a size: the coarsest is at least 8 pixels high and wide, if there are several.
Int count_bands(Int height, Int width) {
  Int bands = 1;
  while (bands < BANDS && min(height, width) >= Int(8) << bands) bands++;
  return bands;
}

// Bands of differences and of what is shown, and their power around each pixel.
struct Bands {
  Pyramid differences, details;
  BoxMean box;
  float *line, *squares, *power, *strength;

  Bands(Int height, Int width, Int levels, Workspace &workspace)
      : differences(height, width, levels, workspace), details(height, width, levels, workspace),
        box(height, width, FINE_SIDE, workspace), line(workspace.take<float>(COLOURS * width)),
        squares(workspace.take<float>(height * width)), power(workspace.take<float>(height * width)),
        strength(workspace.take<float>(height * width)) {}

  Int bins(Int level) const { return level == differences.levels - 1 ? 1 : BINS; }
  void split(const float *difference, const float *shown) const {
    differences.split(difference, line);
    details.split(shown, line);
  }
  void choose(Int level) {
    box.height = differences.pictures[level].height;
    box.width = differences.pictures[level].width;
    box.side = bins(level) == 1 ? COARSE_SIDE : FINE_SIDE;
    measure(differences.pictures[level], power);
    measure(details.pictures[level], strength);
  }

private:
  void measure(const Picture &band, float *means) const {
    for (Int i = 0; i < band.height * band.width; i++) squares[i] = mean_square(band.data + COLOURS * i);
    box.all(squares, means);
  }
};

// The key below which are a share of those that are counted.
Int quantile(const int32_t *counts, Int total, Int part, Int parts) {
  Int key = 0, below = 0;
  while (key < KEYS - 1 && (below + counts[key]) * parts <= total * part) below += counts[key++];
  return key;
}

}  // namespace

KERNEL(Int, measure_error, const MeasureError &args) {
  const Int height = args.error.shape[0], width = args.error.shape[1];
  Workspace workspace(args.scratch);
  const BoxMean box(height, width, args.side, workspace);
  float *squares = workspace.take<float>(height * width);
  if (workspace.is_counting()) return workspace.size();
  const float *guide = args.guide.data, *shown = args.shown.data, variance = args.variance;
  for (Int i = 0; i < height * width; i++) {
    float difference[COLOURS];
    for (Int c = 0; c < COLOURS; c++) difference[c] = shown[COLOURS * i + c] - guide[COLOURS * i + c];
    squares[i] = mean_square(difference);
  }
  for (Int y = 0; y < height; y++) {
    float *error = args.error.data + y * width;
    box.row(squares, y, [=](Int x, float mean) INLINE_LAMBDA { error[x] = max(mean - variance, 0.0f); });
  }
  return 0;
}

KERNEL(Int, weigh, const Weigh &args) {
  const View<const float, 3> errors(args.errors);
  const View<float, 3> shares(args.shares);
  const Int count = errors.shape[0], height = errors.shape[1], width = errors.shape[2];
  Workspace workspace(args.scratch);
  const BoxMean box(height, width, args.own_side, workspace);
  float *least = workspace.take<float>(width);
  if (workspace.is_counting()) return workspace.size();
  const bool *is_own = args.is_own.data;
  const float unsure = args.unsure, unsure_share = args.unsure_share, doubling_error = args.doubling_error;
  const float own_weight = args.own_weight;
  for (Int y = 0; y < height; y++) {
    const float *usual = args.usual.data + y * width, *trust = args.trust.data + y * width;
    const float *motion_error = args.motion_error.data + y * width;
    for (Int k = 0; k < count; k++) {
      float *expected = shares.ptr(k, y);
      const float *error = errors.ptr(k, y);
      if (is_own[k])
        box.row(errors.ptr(k), y,
                [=](Int x, float mean) INLINE_LAMBDA { expected[x] = max(mean - usual[x], 0.0f) * trust[x]; });
      else
        for (Int x = 0; x < width; x++) expected[x] = max(error[x] - usual[x], 0.0f) + motion_error[x];
      for (Int x = 0; x < width; x++) {
        expected[x] += unsure + unsure_share * usual[x];
        least[x] = k ? min(least[x], expected[x]) : expected[x];
      }
    }
    for (Int k = 0; k < count; k++) {
      float *share = shares.ptr(k, y);
      for (Int x = 0; x < width; x++) {
        const float ratio = least[x] / share[x], cube = ratio * ratio * ratio;
        share[x] = is_own[k] ? cube * (own_weight * (1 + usual[x] / doubling_error)) : cube;
      }
    }
  }
  return 0;
}

KERNEL(Int, measure_usual_power, const MeasureUsualPower &args) {
  const View<float, 3> usual(args.usual);
  const Int height = args.difference.shape[0], width = args.difference.shape[1];
  Workspace workspace(args.scratch);
  Bands bands(height, width, count_bands(height / (args.use_median ? 1 : 2), width), workspace);
  int32_t *counts = workspace.take<int32_t>(KEYS), *in_bins = workspace.take<int32_t>(BINS * KEYS);
  if (workspace.is_counting()) return workspace.size();
  bands.split(args.difference.data, args.shown.data);
  for (Int i = 0; i < BANDS * 2 * BINS; i++) usual.data[i] = 0;
  for (Int level = 0; level < bands.differences.levels; level++) {
    bands.choose(level);
    const Int pixels = bands.box.height * bands.box.width, bins = bands.bins(level);
    float *limits = usual.ptr(level, 0), *power = usual.ptr(level, 1);
    __builtin_memset(counts, 0, KEYS * sizeof *counts);
    for (Int i = 0; i < pixels; i++) counts[power_key(bands.strength[i])]++;
    for (Int bin = 0; bin < bins; bin++) limits[bin] = power_of(quantile(counts, pixels, bin + 1, bins));
    __builtin_memset(in_bins, 0, BINS * KEYS * sizeof *in_bins);
    double sums[BINS] = {};
    Int found[BINS] = {};
    for (Int i = 0; i < pixels; i++) {
      const Int bin = bin_of(bands.strength[i], limits, bins);
      in_bins[bin * KEYS + power_key(bands.power[i])]++;
      sums[bin] += double(bands.power[i]);
      found[bin]++;
    }
    for (Int bin = 0; bin < bins; bin++) {
      const float mean = float(sums[bin] / double(max(found[bin], Int(1))));
      const bool has_median = args.use_median && found[bin];
      power[bin] = has_median ? power_of(quantile(in_bins + bin * KEYS, found[bin], 1, 2)) : mean;
    }
  }
  return 0;
}

KERNEL(Int, keep_excess, const KeepExcess &args) {
  const View<const float, 3> usual(args.usual);
  const Int height = args.difference.shape[0], width = args.difference.shape[1];
  Workspace workspace(args.scratch);
  Bands bands(height, width, count_bands(height, width), workspace);
  if (workspace.is_counting()) return workspace.size();
  bands.split(args.difference.data, args.shown.data);
  const float excess = args.excess;
  const Int levels = bands.differences.levels;
  for (Int level = levels - 1; level >= 0; level--) {
    bands.choose(level);
    const Picture &band = bands.differences.pictures[level];
    const Int bins = bands.bins(level);
    const float *limits = usual.ptr(level, 0), *power = usual.ptr(level, 1);
    for (Int i = 0; i < band.height * band.width; i++)
      bands.squares[i] = power[bin_of(bands.strength[i], limits, bins)];
    for (Int y = 0; y < band.height; y++) {
      const float *of_row = bands.power + y * band.width;
      float *row = band.row(y);
      bands.box.row(bands.squares, y, [=](Int x, float expected) INLINE_LAMBDA {
        const float share = max(of_row[x] - excess * expected, 0.0f) / (of_row[x] + 1e-3f);
        for (Int c = 0; c < COLOURS; c++) row[COLOURS * x + c] *= share;
      });
    }
    if (level < levels - 1) add_risen(bands.differences.pictures[level + 1], 1, band, bands.line);
  }
  for (Int i = 0; i < COLOURS * height * width; i++) args.kept.data[i] = bands.differences.pictures[0].data[i];
  return 0;
}
