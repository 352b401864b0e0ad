// Search for the most similar patch: the report's Algorithm 1 for both directions in one pass.
//
// For one offset k, the similarity image W_k(x) = xi(A(x), B(x + k)) serves both fields: summed over the patch, it is
// the score of k at x for A->B, and the score of -k at x + k for B->A. So every offset is computed once, row by row,
// without storing a full-size image. Some neighbouring offsets are processed together and share the reads of the best
// scores.
#include "scratch.h"
#include "similarity.h"

namespace {

constexpr Int STRIP_WIDTH = 640;     // columns per pass: little overhead of patch margins, and small enough for caches
constexpr Int OFFSETS_PER_PASS = 8;  // neighbouring offsets that are processed together
constexpr Int OFFSETS_AT_ONCE = 4;   // of which so many are compared with the best ones at a time
constexpr Int BLOCK = 2 * LANES;     // pixels whose weighted sums are computed together
constexpr Int OUTSIDE = 2 * LANES;   // totals on either side of the candidates that may be compared with them

constexpr Int MAX_SIZE = 2 * MAX_PATCH_RADIUS + 1;  // of patches

// The lanes BY before those of a vector, of which the first are those of the vector before.
template <int BY> FORCE_INLINE U32 preceding(U32 previous, U32 current) {
#define LANE(n) 16 + n - BY
  return __builtin_shufflevector(previous, current, LANE(0), LANE(1), LANE(2), LANE(3), LANE(4), LANE(5), LANE(6),
                                 LANE(7), LANE(8), LANE(9), LANE(10), LANE(11), LANE(12), LANE(13), LANE(14), LANE(15));
#undef LANE
}

// Sizes of the work arrays, in elements of four bytes.
struct Layout {
  Int size, slots, columns, line;  // of patches, rows that are kept, similarities in a row, scores of an offset

  Layout(Int size, Int rows_at_once, Int width)
      : size(size), slots(size + rows_at_once - 1),
        columns((min(width, STRIP_WIDTH) + size + 2 * BLOCK) / BLOCK * BLOCK), line(columns + 2 * OUTSIDE) {}
  Int row() const { return OFFSETS_PER_PASS * line; }  // scores of all offsets in a row
};

// Pixels of frame 0 in a row, and those of frame 1 to which an offset leads from them.
struct PixelRow {
  const float *first, *second;
  Int plane0, plane1, count;

  // Calls a function with the similarities of each vector of pixels and their place; up to four are computed together.
  template <typename Function> FORCE_INLINE void compare(const Function &use) const {
    Int x = 0;
    for (; x + 3 * LANES < count; x += 4 * LANES) compare_vectors<4>(x, use);
    if (x + 2 * LANES < count)
      compare_vectors<3>(x, use);
    else if (x + LANES < count)
      compare_vectors<2>(x, use);
    else if (x < count)
      compare_vectors<1>(x, use);
  }

private:
  template <int COUNT, typename Function>
  FORCE_INLINE void compare_vectors(Int x, const Function &use) const {
    I16 similarity[COUNT];
    exponential_similarity(first + x, plane0, second + x, plane1, similarity);
    for (Int n = 0; n < COUNT; n++) use(similarity[n], x + LANES * n);
  }
};

// Sums of 1, 2, 4 and 8 values along a row, up to each of a vector, and those of the vector before.
struct RunningSums {
  static constexpr int LENGTHS = 4;
  U32 previous[LENGTHS], latest[LENGTHS];

  RunningSums() : previous{}, latest{} {}
  FORCE_INLINE void add(U32 values) {
    for (int n = 0; n < LENGTHS; n++) previous[n] = latest[n];
    latest[0] = values;
    latest[1] = latest[0] + preceding<1>(previous[0], latest[0]);
    latest[2] = latest[1] + preceding<2>(previous[1], latest[1]);
    latest[3] = latest[2] + preceding<4>(previous[2], latest[2]);
  }
  // The sum of the last SIZE values up to each, of which the last LATER are already in `sum`.
  template <Int SIZE, Int LATER = 0> FORCE_INLINE U32 sum_last(U32 sum = U32{}) const {
    if constexpr (SIZE > LATER) {
      constexpr int n = SIZE - LATER >= 8 ? 3 : SIZE - LATER >= 4 ? 2 : SIZE - LATER >= 2 ? 1 : 0;
      return sum_last<SIZE, LATER + (1 << n)>(sum + preceding<LATER>(previous[n], latest[n]));
    }
    return sum;
  }
};

// Scores of one offset over boxes: integers, which are summed across and then down the last rows. SIZE, of patches, is
// a constant where it is a usual one; else it is 0.
template <Int SIZE> struct BoxScores {
  typedef int32_t Score;
  static constexpr Int ROWS_AT_ONCE = 1;

  Int size, row_size;
  uint32_t *ring, *latest;  // the last rows of sums across, and a row of similarities

  void allocate(const Layout &layout, const float *, Workspace &workspace) {
    size = SIZE ? SIZE : layout.size;
    row_size = layout.columns;
    ring = workspace.take<uint32_t>(layout.slots * row_size);
    latest = workspace.take<uint32_t>(row_size) + LANES;
  }

  // Begins with `count` scores, from which a price is subtracted.
  void begin(Int count, int32_t price, int32_t *scores) {
    const Int rounded = (count + size - 1 + LANES - 1) / LANES * LANES;
    for (Int row = 0; row < size; row++) __builtin_memset(ring + row * row_size, 0, rounded * sizeof(uint32_t));
    for (Int x = 1 - size; x < count; x += LANES) store(scores + x, -price - I16{});
  }

  // Adds a row to the scores, in which it takes the place of the one that has left the boxes.
  void add_row(const PixelRow &pixels, Int row, int32_t *scores) {
    uint32_t *const slot = ring + row % size * row_size, *const values = latest;
    uint32_t *const totals = as<uint32_t *>(scores) - (size - 1);
    const auto add = [=](U32 across, Int x) INLINE_LAMBDA {
      store(totals + x, load<U32>(totals + x) + across - load<U32>(slot + x));
      store(slot + x, across);
    };
    if constexpr (SIZE != 0) {
      RunningSums sums;
      pixels.compare([&](I16 similarity, Int x) INLINE_LAMBDA {
        sums.add(as<U32>(similarity));
        add(sums.template sum_last<SIZE>(), x);
      });
    } else {
      pixels.compare([=](I16 similarity, Int x) INLINE_LAMBDA { store(values + x, as<U32>(similarity)); });
      for (Int x = 0; x < pixels.count; x += LANES) {
        U32 across{};
        for (Int k = x + 1 - size; k <= x; k++) across += load<U32>(values + k);
        add(across, x);
      }
    }
  }

  void finish(Int, Int, Int, int32_t, int32_t *, Int) {}
};

// Scores of one offset over windows with symmetric weights, which are summed across and then down (section 3.1).
template <Int SIZE> struct WindowScores {
  typedef float Score;
  static constexpr Int ROWS_AT_ONCE = 6;  // windows one below the other, which share the reads of their rows

  Int size, slots, row_size;
  const float *weights;
  float *ring, *latest;  // the last rows of sums across, and a row of similarities

  void allocate(const Layout &layout, const float *window, Workspace &workspace) {
    size = SIZE ? SIZE : layout.size;
    slots = layout.slots;
    row_size = layout.columns;
    weights = window;
    ring = workspace.take<float>(slots * row_size);
    latest = workspace.take<float>(row_size);
  }

  void begin(Int, float, float *) {}

  void add_row(const PixelRow &pixels, Int row, float *) {
    float *const values = latest;
    pixels.compare([=](I16 similarity, Int x)
                       INLINE_LAMBDA { store(values + x, __builtin_convertvector(similarity, F16)); });
    float *const across = ring + row % slots * row_size;
    for (Int x = 0; x < pixels.count - size + 1; x += BLOCK)
      sum_symmetric(x, 0, across, [=](Int k) INLINE_LAMBDA { return values + k; });
  }

  // Writes the scores of `count` pixels, less a price, in several rows, which are `stride` apart, from a first one on.
  void finish(Int first, Int rows, Int count, float price, float *scores, Int stride) {
    const float *slot[MAX_SIZE + ROWS_AT_ONCE - 1];
    for (Int k = 0; k < size + rows - 1; k++) slot[k] = ring + (first + k) % slots * row_size;
    for (Int x = 0; x < count; x += BLOCK)
      for (Int row = 0; row < rows; row++)
        sum_symmetric(x, -price, scores + row * stride, [&](Int k) INLINE_LAMBDA { return slot[row + k]; });
  }

  // Writes weighted sums of a block of values, of which the k-th begin at value(k), and a first value.
  template <typename Value>
  FORCE_INLINE void sum_symmetric(Int x, float first, float *sums, const Value &value) {
    const Int half = (SIZE ? SIZE : size) / 2;
    F16 sum[BLOCK / LANES];
    for (Int n = 0; n < BLOCK / LANES; n++)
      sum[n] = fma(broadcast<F16>(weights[half]), load<F16>(value(half) + x + LANES * n), broadcast<F16>(first));
    for (Int k = 0; k < half; k++) {
      const F16 weight = broadcast<F16>(weights[k]);
      const float *one = value(k) + x, *other = value(2 * half - k) + x;
      for (Int n = 0; n < BLOCK / LANES; n++)
        sum[n] = fma(weight, load<F16>(one + LANES * n) + load<F16>(other + LANES * n), sum[n]);
    }
    for (Int n = 0; n < BLOCK / LANES; n++) store(sums + x + LANES * n, sum[n]);
  }
};

// Updates the best scores and their ranks where one of four scores is larger, or equal at a lower rank. Ranks increase.
template <typename Score>
FORCE_INLINE void keep_best(const Score *const (&scores)[OFFSETS_AT_ONCE], const int32_t (&ranks)[OFFSETS_AT_ONCE],
                            Score *best, int32_t *winners, Int count) {
  typedef Score V __attribute__((vector_size(64)));
  for (Int x = 0; x < count; x += LANES) {
    V value[OFFSETS_AT_ONCE];
    I16 rank[OFFSETS_AT_ONCE];
    for (Int n = 0; n < OFFSETS_AT_ONCE; n++) {
      value[n] = load<V>(scores[n] + x);
      rank[n] = ranks[n] - I16{};
    }
    for (Int n = 0; n < OFFSETS_AT_ONCE; n += 2) {
      const I16 is_larger = value[n + 1] > value[n];
      value[n] = is_larger ? value[n + 1] : value[n];
      rank[n] = is_larger ? rank[n + 1] : rank[n];
    }
    const I16 is_second = value[2] > value[0];
    const V highest = is_second ? value[2] : value[0], before = load<V>(best + x);
    const I16 best_rank = is_second ? rank[2] : rank[0], winner = load<I16>(winners + x);
    const I16 is_larger = highest > before, is_better = is_larger | ((highest == before) & (best_rank < winner));
    store(best + x, is_larger ? highest : before);
    store(winners + x, is_better ? best_rank : winner);
  }
}

// Pixels of a strip that an offset leads into the other frame.
struct Columns {
  Int begin, end;
};

FORCE_INLINE Columns find_candidates(Int dx, Int left, Int pixels, Int width) {
  return {max(Int(0), -dx - left), min(pixels, width - dx - left)};
}

// A neighbouring offset that is processed with others.
template <typename Score> struct Candidate {
  Int dx;
  Columns pixels;
  Score price;
  int32_t rank01, rank10;
};

// Searches some offsets of a row in a strip of columns: from the nearest to zero on, whose rank is lowest, to the left
// or to the right.
template <typename Scores> struct SearchPass {
  typedef typename Scores::Score Score;
  const Search &args;
  const Layout &layout;
  Scores *sums;   // of each offset
  Score *scores;  // of each offset, in `layout.line` places each, for the rows that are scored at once
  Int dy, left, pixels, count;
  Candidate<Score> offsets[OFFSETS_PER_PASS];

  // Begins with `count` offsets from the nearest one on.
  void begin(Int nearest, Int sign) {
    const View<const int32_t, 2> ranks(args.ranks);
    const View<const Score, 2> prices(args.prices);
    const Int radius = ranks.shape[0] / 2;
    count = min(radius + 1 - nearest * sign, OFFSETS_PER_PASS);
    for (Int n = 0; n < count; n++) {
      const Int dx = nearest + sign * n;
      const Columns columns = find_candidates(dx, left, pixels, args.width);
      offsets[n] = {dx, columns, prices(radius + dy, radius + dx), ranks(radius + dy, radius + dx),
                    ranks(radius - dy, radius - dx)};
      if (columns.begin < columns.end)
        sums[n].begin(columns.end - columns.begin, offsets[n].price, scores + n * layout.line + columns.begin);
    }
  }

  // Scores rows from row y on at each offset; `is_first` tells that those above them have not been added.
  void score_rows(Int y, Int rows, bool is_first) {
    const View<const float, 3> planes0(args.planes0), planes1(args.planes1);
    for (Int n = 0; n < count; n++) {
      const Int begin = offsets[n].pixels.begin, wide = offsets[n].pixels.end - begin;
      if (wide <= 0) continue;
      const Int column0 = left + begin, column1 = LANES + column0 + offsets[n].dx;
      Score *const line = scores + n * layout.line + begin;
      for (Int row = is_first ? y : y + layout.size - 1; row < y + rows + layout.size - 1; row++)
        sums[n].add_row({planes0.ptr(0, row, column0), planes1.ptr(0, row + dy, column1),
                         planes0.shape[1] * planes0.shape[2], planes1.shape[1] * planes1.shape[2],
                         wide + layout.size - 1},
                        row, line);
      sums[n].finish(y, rows, wide, offsets[n].price, line, layout.row());
    }
  }

  // Keeps the best of the scores of row y, which begin at `line`, at some offsets from the first of them on.
  void keep_best_of(Int first, Int y, Score *line) {
    const Columns widest = offsets[first].pixels;
    if (widest.begin >= widest.end) return;
    const View<Score, 2> best01(args.found01.similarity), best10(args.found10.similarity);
    const View<int32_t, 2> winners01(args.found01.ranks), winners10(args.found10.ranks);
    // the scores are moved by their offsets for frame 1, so that they refer to the same pixel
    const Int dx = offsets[first].dx, last_dx = offsets[min(first + OFFSETS_AT_ONCE, count) - 1].dx;
    const Int begin = max(min(dx, last_dx), -left), end = min(pixels + max(dx, last_dx), args.width - left);
    const Score *from01[OFFSETS_AT_ONCE], *from10[OFFSETS_AT_ONCE];
    int32_t ranks01[OFFSETS_AT_ONCE], ranks10[OFFSETS_AT_ONCE];
    for (Int k = 0; k < OFFSETS_AT_ONCE; k++) {
      const Int n = min(first + k, count - 1);  // the last one again does not win
      const Candidate<Score> &offset = offsets[n];
      Score *own = line + n * layout.line;
      for (Int x = 0; x < OUTSIDE; x++)  // what leads out of the other frame never wins
        own[offset.pixels.begin - OUTSIDE + x] = own[offset.pixels.end + x] = -1;
      from01[k] = own + widest.begin;
      from10[k] = own - offset.dx + begin;
      ranks01[k] = offset.rank01;
      ranks10[k] = offset.rank10;
    }
    const Int column0 = left + widest.begin, column1 = LANES + left + begin;
    keep_best(from01, ranks01, best01.ptr(y, column0), winners01.ptr(y, column0), widest.end - widest.begin);
    keep_best(from10, ranks10, best10.ptr(y + dy, column1), winners10.ptr(y + dy, column1), end - begin);
  }

  void search() {
    const Int top = max(Int(0), -dy), bottom = min(args.height, args.height - dy);
    for (Int y = top; y < bottom; y += Scores::ROWS_AT_ONCE) {
      const Int rows = min(Scores::ROWS_AT_ONCE, bottom - y);
      score_rows(y, rows, y == top);
      for (Int row = 0; row < rows; row++)
        for (Int first = 0; first < count; first += OFFSETS_AT_ONCE)
          keep_best_of(first, y + row, scores + row * layout.row());
    }
  }
};

template <typename Scores> Int search_all(const Search &args) {
  typedef typename Scores::Score Score;
  const Int radius = args.ranks.shape[0] / 2, width = args.width;
  const Layout layout(args.weights.shape[0], Scores::ROWS_AT_ONCE, width);
  Workspace workspace(args.scratch);
  Scores sums[OFFSETS_PER_PASS];
  for (Scores &each : sums) each.allocate(layout, args.weights.data, workspace);
  Score *scores = workspace.take<Score>(Scores::ROWS_AT_ONCE * layout.row()) + OUTSIDE;
  if (workspace.is_counting()) return workspace.size();
  for (Int dy = -radius; dy <= radius; dy++)
    for (Int left = 0; left < width; left += STRIP_WIDTH)
      for (Int sign = 1; sign >= -1; sign -= 2)
        for (Int nearest = sign < 0 ? -1 : 0; nearest * sign <= radius; nearest += sign * OFFSETS_PER_PASS) {
          SearchPass<Scores> pass{args, layout, sums, scores, dy, left, min(STRIP_WIDTH, width - left), 0, {}};
          const Columns columns = find_candidates(nearest, left, pass.pixels, width);
          if (columns.begin >= columns.end) continue;
          pass.begin(nearest, sign);
          pass.search();
        }
  return 0;
}

}  // namespace

KERNEL(Int, search, const Search &args) {
  const bool is_box = args.prices.kind == INT32;
  switch (args.weights.shape[0]) {
    case 5: return (is_box ? search_all<BoxScores<5>> : search_all<WindowScores<5>>)(args);
    case 7: return (is_box ? search_all<BoxScores<7>> : search_all<WindowScores<7>>)(args);
    case 9: return (is_box ? search_all<BoxScores<9>> : search_all<WindowScores<0>>)(args);
    case 11: return (is_box ? search_all<BoxScores<11>> : search_all<WindowScores<11>>)(args);
    default: return (is_box ? search_all<BoxScores<0>> : search_all<WindowScores<0>>)(args);
  }
}
