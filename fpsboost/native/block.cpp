// Block matching as in video coding: for each block of one frame, the block of the other with the lowest sum of
// absolute differences.
#include "records.h"

namespace {

struct Block {
  Int top, left, bottom, right;
};

struct Offset {
  Int dy, dx;

  Int squared_length() const { return dy * dy + dx * dx; }
};

// Sum of absolute differences of parts of two rows, added to those above. A row of a block has at most 2^16 values.
template <typename T> FORCE_INLINE Int add_differences(Int total, const T *row0, const T *row1, Int count) {
  uint32_t sum = 0;
  for (Int i = 0; i < count; i++) sum += uint32_t(__builtin_abs(int(row0[i]) - int(row1[i])));
  return total + sum;
}

FORCE_INLINE float add_differences(float total, const float *row0, const float *row1, Int count) {
  for (Int i = 0; i < count; i++) total += absolute(row0[i] - row1[i]);  // in this order, as floats are rounded
  return total;
}

// Type of a sum of differences: Int of integers, float of floats.
template <typename T> using SumOf = decltype(T() * Int());

// Search for the best match of one block.
template <typename T> struct BlockSearch {
  typedef SumOf<T> Sum;
  View<const T, 2> rows0, rows1;
  Int channels, search_range;
  Block block;
  Offset best{0, 0};
  Sum lowest = Sum(Int(1) << 62);  // larger than any sum of absolute differences

  BlockSearch(const MatchBlocks &args, const Block &block)
      : rows0(args.rows0), rows1(args.rows1), channels(args.channels), search_range(args.search_range), block(block) {}

  // The sum of absolute differences of the block and its match, or of their first rows once it is too high.
  Sum sum_of_differences(const Offset &vector) const {
    Sum total = 0;
    for (Int y = block.top; y < block.bottom && !(total > lowest); y++) {
      const T *row0 = rows0.ptr(y) + block.left * channels;
      const T *row1 = rows1.ptr(y + vector.dy) + (block.left + vector.dx) * channels;
      total = add_differences(total, row0, row1, (block.right - block.left) * channels);
    }
    return total;
  }
  bool is_allowed(const Offset &vector) const {
    const Int longest = max(max(vector.dy, -vector.dy), max(vector.dx, -vector.dx));
    return longest <= search_range && block.top + vector.dy >= 0 && block.left + vector.dx >= 0 &&
           block.bottom + vector.dy <= rows0.shape[0] && (block.right + vector.dx) * channels <= rows0.shape[1];
  }
  // Compares a place, and returns whether it is better: of equally good ones, the nearest.
  bool compare(const Offset &vector) {
    if (!is_allowed(vector)) return false;
    const Sum total = sum_of_differences(vector);
    const bool nearer = vector.squared_length() < best.squared_length();
    if (!(total < lowest || (total == lowest && nearer))) return false;
    best = vector;
    lowest = total;
    return true;
  }
};

template <typename T> void match(const MatchBlocks &args) {
  typedef SumOf<T> Sum;
  const View<const int32_t, 2> offsets(args.plan.offsets);
  const View<const int32_t, 1> turns(args.plan.turns);
  const View<const bool, 1> repeated(args.plan.repeated);
  const View<int32_t, 3> motion(args.motion);
  const View<Sum, 2> difference(args.difference);
  const Int height = args.rows0.shape[0], width = args.rows0.shape[1] / args.channels;
  for (Int row = 0; row < difference.shape[0]; row++)
    for (Int column = 0; column < difference.shape[1]; column++) {
      const Int top = row * args.block_size, left = column * args.block_size;
      const Block block{top, left, min(top + args.block_size, height), min(left + args.block_size, width)};
      BlockSearch<T> search(args, block);
      for (Int turn = 0; turn < repeated.shape[0]; turn++) {
        bool again = true;
        while (again) {
          again = false;
          const Offset centre = search.best;
          for (Int k = turns(turn); k < turns(turn + 1); k++)
            if (search.compare({centre.dy + offsets(k, 0), centre.dx + offsets(k, 1)})) again = repeated(turn);
        }
      }
      motion(row, column, 0) = int32_t(search.best.dx);
      motion(row, column, 1) = int32_t(search.best.dy);
      difference(row, column) = search.lowest;
    }
}

}  // namespace

KERNEL(void, match_blocks, const MatchBlocks &args) {
  with_pixel_type(args.rows0.kind, [&](auto pixel) { match<decltype(pixel)>(args); });
}
