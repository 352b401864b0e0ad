// Planes in which the searches compare two frames: half luma, its high-pass and mean chroma in bytes; and small copies.
#include "scratch.h"

namespace {

constexpr Int RADIUS = HIGH_PASS_SIZE / 2;
constexpr Int KEPT_ROWS = HIGH_PASS_SIZE + 1;  // rows of luma that a running sum over boxes needs
// Weight of each pixel of the box.
constexpr double SHARE = 1.0 / (HIGH_PASS_SIZE * HIGH_PASS_SIZE);

struct WorkArrays {
  float *rows;      // ring buffer of the latest rows of luma
  double *sums;     // of each column over the rows of the box, with RADIUS reflected columns on either side
  uint8_t *chroma;  // a row of the third plane at the resolution of chroma

  WorkArrays(Int width, Workspace &workspace)
      : rows(workspace.take<float>(KEPT_ROWS * width)), sums(workspace.take<double>(width + 2 * RADIUS)),
        chroma(workspace.take<uint8_t>(width)) {}
};

struct Levels {  // that represent a difference of 1, and no difference from the mean
  float scale, middle;
};

// A value rounded and clipped to a byte.
FORCE_INLINE uint8_t to_byte(float value) { return uint8_t(clamp(value + 0.5f, 0.0f, float(WHITE))); }

// The index that stands for one beyond the ends of an axis, mirrored at the first and last element.
Int reflected(Int place, Int size) {
  if (size == 1) return 0;
  while (place < 0 || place >= size) place = place < 0 ? -place : 2 * (size - 1) - place;
  return place;
}

// High-pass filter that follows the conversion of rows to luma by RADIUS rows.
struct HighPass {
  WorkArrays work;
  Int height, width;

  float *row(Int y) const { return work.rows + y % KEPT_ROWS * width; }

  // Moves the box to row y, which must be called in order. Sums of integer codes are exact.
  void move_to(Int y) const {
    double *__restrict inner = work.sums + RADIUS;
    if (y == 0) {
      for (Int x = 0; x < width + 2 * RADIUS; x++) work.sums[x] = 0;
    } else {
      const float *leaves = row(reflected(y - RADIUS - 1, height));
      for (Int x = 0; x < width; x++) inner[x] -= double(leaves[x]);
    }
    for (Int n = y == 0 ? -RADIUS : RADIUS; n <= RADIUS; n++) {
      const float *enters = row(reflected(y + n, height));
      for (Int x = 0; x < width; x++) inner[x] += double(enters[x]);
    }
    for (Int n = 1; n <= RADIUS; n++) {
      inner[-n] = inner[reflected(-n, width)];
      inner[width - 1 + n] = inner[reflected(width - 1 + n, width)];
    }
  }
  // Writes row y of the second plane: twice the luma minus its local mean, which has both signs.
  void write(Int y, const Levels &levels, uint8_t *__restrict second) const {
    move_to(y);
    const float *luma = row(y), twice = 2 * levels.scale;
    for (Int x = 0; x < width; x++) {
      double total = work.sums[x];
      for (int n = 1; n < HIGH_PASS_SIZE; n++) total += work.sums[x + n];
      second[x] = to_byte(twice * (luma[x] - float(total * SHARE)) + levels.middle);
    }
  }
};

// Repeats the edges of the frame on all sides of the planes.
void replicate_border(Int height, Int width, Int padding, const View<uint8_t, 3> &planes) {
  const Int columns = planes.shape[2];
  for (Int c = 0; c < planes.shape[0]; c++) {
    for (Int y = padding; y < padding + height; y++) {
      uint8_t *row = planes.ptr(c, y);
      const uint8_t first = row[padding], last = row[padding + width - 1];
      for (Int x = 0; x < padding; x++) row[x] = first;
      for (Int x = padding + width; x < columns; x++) row[x] = last;
    }
    const uint8_t *above = planes.ptr(c, padding), *below = planes.ptr(c, padding + height - 1);
    for (Int y = 0; y < padding; y++) {
      uint8_t *__restrict first = planes.ptr(c, y), *__restrict last = planes.ptr(c, y + padding + height);
      for (Int x = 0; x < columns; x++) {
        first[x] = above[x];
        last[x] = below[x];
      }
    }
  }
}

// Writes all three planes of `height` rows; `split(y, luma, first, third)` gives a row of luma, half luma and chroma.
template <typename Split>
FORCE_INLINE void write_planes(const WorkArrays &work, Int height, Int width, Int padding, const Levels &levels,
                               const View<uint8_t, 3> &planes, Split split) {
  const HighPass high_pass{work, height, width};
  for (Int y = 0; y < height + RADIUS; y++) {
    if (y < height)
      split(y, high_pass.row(y), planes.ptr(0, padding + y) + padding, planes.ptr(2, padding + y) + padding);
    if (y >= RADIUS) high_pass.write(y - RADIUS, levels, planes.ptr(1, padding + y - RADIUS) + padding);
  }
  replicate_border(height, high_pass.width, padding, planes);
}

template <typename T, int CHANNELS> void split_pixels(const SplitColours &args, const WorkArrays &work) {
  const View<const T, 3> image(args.image);
  const Int height = image.shape[0], width = image.shape[1];
  const Levels levels{args.scale, args.middle};
  const float normalise = args.normalise, scale = levels.scale, half = 0.5f;
  auto split = [=](Int y, float *__restrict luma, uint8_t *__restrict first, uint8_t *__restrict third) {
    const T *__restrict pixels = image.ptr(y);
    for (Int x = 0; x < width; x++) {
      const T *pixel = pixels + x * CHANNELS;
      const float blue = float(pixel[0]) * normalise;
      const float alpha = CHANNELS % 2 == 0 ? float(pixel[CHANNELS - 1]) * normalise : 1;
      float value = blue, chroma = 0;
      if constexpr (CHANNELS >= 3) {
        const float green = float(pixel[1]) * normalise, red = float(pixel[2]) * normalise;
        value = 0.299f * red + 0.587f * green + 0.114f * blue;
        chroma = (float(0.713 / 2) * (red - value) + float(0.564 / 2) * (blue - value)) * alpha + half;
      }
      value *= alpha;
      luma[x] = value;
      first[x] = to_byte(value * half * scale);
      third[x] = to_byte(chroma * scale);
    }
  };
  write_planes(work, height, width, args.padding, levels, View<uint8_t, 3>(args.planes), split);
}

template <typename T> void split_image(const SplitColours &args, const WorkArrays &work) {
  switch (args.image.shape[2]) {
    case 1: return split_pixels<T, 1>(args, work);
    case 2: return split_pixels<T, 2>(args, work);
    case 3: return split_pixels<T, 3>(args, work);
    default: return split_pixels<T, 4>(args, work);
  }
}

// Writes a row of the third plane at the resolution of chroma.
template <typename T>
void mix_chroma(const T *cb, const T *cr, float neutral, float unit, float scale, uint8_t *__restrict out,
                Int columns) {
  for (Int x = 0; x < columns; x++) {
    const float chroma = float(cb[x]) + float(cr[x]);
    out[x] = to_byte(((chroma * 0.5f - neutral) * unit + 0.5f) * scale);
  }
}

template <typename T> void split_codes(const SplitPlanes &args, const WorkArrays &work) {
  const View<const T, 2> luma_codes(args.y_plane), cb(args.cb_plane), cr(args.cr_plane);
  const Int height = luma_codes.shape[0], width = luma_codes.shape[1], rows = cb.shape[0], columns = cb.shape[1];
  const Int down = rows == height ? 1 : 2;
  const Levels levels{args.scale, args.middle};
  const float black = args.code_levels.black, luma_unit = args.code_levels.luma_unit;
  const float neutral = args.code_levels.neutral, chroma_unit = args.code_levels.chroma_unit;
  auto split = [=](Int y, float *__restrict luma, uint8_t *__restrict first, uint8_t *__restrict third) {
    const T *__restrict codes = luma_codes.ptr(y);
    for (Int x = 0; x < width; x++) {
      const float value = (float(codes[x]) - black) * luma_unit;
      luma[x] = value;
      first[x] = to_byte(value * 0.5f * levels.scale);
    }
    const uint8_t *chroma = work.chroma;
    if (y % down == 0)
      mix_chroma(cb.ptr(y / down), cr.ptr(y / down), neutral, chroma_unit, levels.scale, work.chroma, columns);
    if (columns == width) {
      for (Int x = 0; x < width; x++) third[x] = chroma[x];
      return;
    }
    for (Int x = 0; x < width / 2; x++) third[2 * x] = third[2 * x + 1] = chroma[x];
    third[width - 1] = chroma[columns - 1];
  };
  write_planes(work, height, width, args.padding, levels, View<uint8_t, 3>(args.planes), split);
}

template <typename T> void shrink_rows(const Shrink &args, float *__restrict line) {
  const View<const T, 2> rows(args.rows);
  const View<float, 3> small(args.small);
  const Int height = rows.shape[0], down = small.shape[0], across = small.shape[1], channels = small.shape[2];
  const Int values = rows.shape[1], width = values / channels;
  const double area = double(height) / double(down) * (double(width) / double(across));
  for (Int v = 0; v < down; v++) {
    const double top = double(v * height) / double(down), bottom = double((v + 1) * height) / double(down);
    for (Int x = 0; x < values; x++) line[x] = 0;
    for (Int y = Int(top); y < min(Int(__builtin_ceil(bottom)), height); y++) {
      const float share = float(min(bottom, double(y + 1)) - max(top, double(y)));
      const T *row = rows.ptr(y);
      for (Int x = 0; x < values; x++) line[x] += share * float(row[x]);
    }
    for (Int u = 0; u < across; u++) {
      const double left = double(u * width) / double(across), right = double((u + 1) * width) / double(across);
      const Int first = Int(left), last = min(Int(__builtin_ceil(right)), width) - 1;
      const double first_share = min(right, double(first + 1)) - left, last_share = right - double(last);
      for (Int c = 0; c < channels; c++) {
        double total = 0;
        total += first_share * double(line[first * channels + c]);
        for (Int x = first + 1; x < last; x++) total += double(line[x * channels + c]);
        if (last > first) total += last_share * double(line[last * channels + c]);
        small(v, u, c) = float(total / area);
      }
    }
  }
}

// Filters an image by 1, 4, 6, 4, 1 along both axes; `Sum` is a type that holds the sums.
template <typename T, typename Sum> void smooth_rows(const Smooth &args, Workspace &workspace) {
  const View<const T, 3> image(args.image);
  const View<T, 3> smoothed(args.smoothed);
  const Int height = image.shape[0], step = image.shape[2], values = image.shape[1] * step;
  Sum *__restrict line = workspace.take<Sum>(values + 4 * step) + 2 * step;  // filtered along y, with edges repeated
  if (workspace.is_counting()) return;
  constexpr bool rounds = Sum(0.5f) == 0;  // sums of whole numbers, that is, and not those of floats
  auto filtered = [](Sum a, Sum b, Sum c, Sum d, Sum e) INLINE_LAMBDA {
    const Sum outer = Sum(a + e), inner = Sum(b + d);
    return Sum(Sum(outer + Sum(4) * inner) + Sum(6) * c);
  };
  for (Int y = 0; y < height; y++) {
    const T *rows[5];
    for (Int n = 0; n < 5; n++) rows[n] = image.ptr(clamp(y + n - 2, Int(0), height - 1));
    for (Int x = 0; x < values; x++) line[x] = filtered(rows[0][x], rows[1][x], rows[2][x], rows[3][x], rows[4][x]);
    for (Int x = -1; x >= -2 * step; x--) line[x] = line[x + step];
    for (Int x = values; x < values + 2 * step; x++) line[x] = line[x - step];
    const Sum *__restrict from = line;
    T *__restrict target = smoothed.ptr(y);
    for (Int x = 0; x < values; x++) {
      const Sum sum = filtered(from[x - 2 * step], from[x - step], from[x], from[x + step], from[x + 2 * step]);
      if constexpr (rounds)
        target[x] = T(Sum(sum + 128) >> 8);
      else
        target[x] = sum / 256;
    }
  }
}

}  // namespace

KERNEL(Int, split_colours, const SplitColours &args) {
  Workspace workspace(args.scratch);
  const WorkArrays work(args.image.shape[1], workspace);
  if (workspace.is_counting()) return workspace.size();
  with_pixel_type(args.image.kind, [&](auto pixel) { split_image<decltype(pixel)>(args, work); });
  return 0;
}

KERNEL(Int, split_planes, const SplitPlanes &args) {
  Workspace workspace(args.scratch);
  const WorkArrays work(args.y_plane.shape[1], workspace);
  if (workspace.is_counting()) return workspace.size();
  args.y_plane.kind == UINT8 ? split_codes<uint8_t>(args, work) : split_codes<uint16_t>(args, work);
  return 0;
}

KERNEL(Int, shrink, const Shrink &args) {
  Workspace workspace(args.scratch);
  float *line = workspace.take<float>(args.rows.shape[1]);
  if (workspace.is_counting()) return workspace.size();
  with_pixel_type(args.rows.kind, [&](auto pixel) { shrink_rows<decltype(pixel)>(args, line); });
  return 0;
}

KERNEL(Int, smooth, const Smooth &args) {
  Workspace workspace(args.scratch);
  switch (args.image.kind) {
    case UINT8: smooth_rows<uint8_t, uint16_t>(args, workspace); break;
    case UINT16: smooth_rows<uint16_t, uint32_t>(args, workspace); break;
    default: smooth_rows<float, float>(args, workspace);
  }
  return workspace.size();
}
