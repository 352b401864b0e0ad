// Search by tiles over the distinct offsets that a coarser level proposes, at points several pixels apart.
//
// Neighbouring points mostly propose the same few offsets. For each tile, the distinct proposals in and around the tile
// and the neighbours of those in it are therefore collected once, and the similarity of each of them is computed over
// the whole tile and summed around each point: the cost is that of a few dozen offsets, whatever the search range.
#pragma once
#include "plane_pair.h"
#include "scratch.h"
#include "similarity.h"

namespace {

constexpr Int PROPOSAL_MARGIN = 8;       // distance beyond the tile within which proposals are collected, pixels
constexpr float NOTHING = -2;            // similarity of an empty entry
constexpr int32_t NOWHERE = 0x7fff7fff;  // its offset, packed: dx in the lower half, dy in the upper one

struct Offset {
  int32_t dx, dy;
};

FORCE_INLINE int32_t packed_offset(Offset offset) {
  return int32_t(uint32_t(offset.dy) << 16 | (uint32_t(offset.dx) & 0xffff));
}
FORCE_INLINE bool is_same(Offset a, Offset b) { return a.dx == b.dx && a.dy == b.dy; }

struct TileSettings {
  Int step, refine_radius, max_offset, patch_radius, row_step;
};

// Numbers of the offsets before and after one along x, and along y; 0 where there is none.
struct Beside {
  int32_t left, right, above, below;
};

// Work arrays: the number of each offset among those of a tile, 0 for others; the offsets of a tile, and those beside
// them; what each of them scores at the points, and NOTHING for number 0; and the lists of eight points.
struct TileWork {
  Int points, places;
  int32_t *number;
  Offset *offsets;
  Beside *beside;
  float *scores;
  F8 *similarity;
  I8 *packed;

  TileWork(const TileSettings &settings, Int spacing, Int capacity, Workspace &workspace) {
    const Int per_tile = TILE / settings.step, side = 2 * settings.max_offset + 3;  // with a border of zeros
    const Int proposals = (TILE + 2 * PROPOSAL_MARGIN) / spacing + 2, reach = 2 * settings.refine_radius + 1;
    const Int most = 2 + min(side * side, reach * reach * (1 + proposals * proposals));
    points = max(per_tile * per_tile, Int(8));
    places = side * side;
    number = workspace.take<int32_t>(places);
    offsets = workspace.take<Offset>(most);
    beside = workspace.take<Beside>(most);
    scores = workspace.take<float>((1 + most) * points);
    similarity = workspace.take<F8>(capacity);
    packed = workspace.take<I8>(capacity);
  }
};

// What a coarser level proposes: whole pixels, at places `spacing` pixels apart.
struct ProposedOffsets {
  const Offset *proposed, *expected;
  Int down, across, spacing;
};

// Most similar offsets of each point of the frame, of at most `capacity`; and the detail of the patch around each
// point: how much similarity with itself it loses by one pixel along x and one along y.
struct CandidateLists {
  int32_t *listed;
  float *similarity;
  Vector *flow;
  float *detail;
  Int down, across, capacity;
};

// A tile of the frame, and its first point and number of points.
struct Tile {
  Int top, left, bottom, right, first_row, first_column, down, across;
};

// Whether packed offsets differ by a pixel or less along both axes from another one, of which `one_less` has dx and dy
// reduced by one.
FORCE_INLINE I8 are_neighbours(I8 packed, U16 one_less) {
  const U16 apart = as<U16>(packed) - one_less, two = U16{} + uint16_t(2);
  return as<I8>(min(apart, two)) == as<I8>(apart);
}

// Inserts an offset into the lists of eight points, which are in order of falling similarity; of neighbouring offsets,
// only the more similar one is kept. CAPACITY is that of the lists, which then stay in registers, or 0 for any.
template <Int CAPACITY>
FORCE_INLINE void insert_top_eight(Offset offset, F8 similarity, F8 *listed, I8 *packed, Int any_capacity) {
  const Int capacity = CAPACITY ? CAPACITY : any_capacity;
  if (!any(similarity > listed[capacity - 1])) return;
  F8 inserted = similarity;
  I8 inserted_offset = I8{} + packed_offset(offset), is_open = ~I8{};
  const U16 one_less = as<U16>(inserted_offset) - uint16_t(1);
  for (Int entry = 0; entry < capacity; entry++) {
    const F8 before = listed[entry];
    const I8 offset_before = packed[entry], writes = is_open & (similarity > before);
    listed[entry] = writes ? inserted : before;
    packed[entry] = writes ? inserted_offset : offset_before;
    inserted = writes ? before : inserted;
    inserted_offset = writes ? offset_before : inserted_offset;
    is_open &= ~are_neighbours(offset_before, one_less);
  }
}

// Offsets of a tile, each once.
struct OffsetSet {
  Int limit, side, count;
  int32_t *number;
  Offset *offsets;

  OffsetSet(Int limit, const TileWork &work)
      : limit(limit), side(2 * limit + 3), count(0), number(work.number), offsets(work.offsets) {}

  int32_t &number_of(Int dx, Int dy) const { return number[(dy + limit + 1) * side + dx + limit + 1]; }

  // Adds the offsets at a distance from another one, along x and y together, as far as they are within the limit.
  void add_around(Offset offset, Int distance) {
    for (Int dy = max(offset.dy - distance, -limit); dy <= min(offset.dy + distance, limit); dy++) {
      const Int rest = distance - (dy > offset.dy ? dy - offset.dy : offset.dy - dy);
      for (Int dx = max(offset.dx - rest, -limit); dx <= min(offset.dx + rest, limit); dx++) {
        int32_t &own = number_of(dx, dy);
        if (own) continue;
        offsets[count++] = {int32_t(dx), int32_t(dy)};
        own = int32_t(count);
      }
    }
  }

  // The number of an offset, or 0.
  int32_t number_if_any(Int dx, Int dy) const {
    return min(dx, dy) < -limit || max(dx, dy) > limit ? 0 : number_of(dx, dy);
  }

  void find_beside(Beside *beside) const {
    for (Int k = 0; k < count; k++) {
      const int32_t *own = &number_of(offsets[k].dx, offsets[k].dy);
      beside[k] = {own[-1], own[1], own[-side], own[side]};
    }
  }

  void clear() {
    for (Int k = 0; k < count; k++) number_of(offsets[k].dx, offsets[k].dy) = 0;
  }
};

// Adds zero motion, the distinct proposals in and around a tile, and the neighbours of zero and of those in it.
FORCE_INLINE void gather_offsets(const ProposedOffsets &proposals, const Tile &tile, Int refine_radius,
                                 OffsetSet &offsets) {
  const Int spacing = proposals.spacing;
  // by distance from the proposal: of equally similar offsets, the first one is kept
  for (Int distance = 0; distance <= refine_radius; distance++) {
    const Int margin = distance ? 0 : PROPOSAL_MARGIN;
    // the places in which pixels lie
    const Int top = max(tile.top - margin, Int(0)) / spacing, left = max(tile.left - margin, Int(0)) / spacing;
    const Int bottom = min((tile.bottom + margin - 1) / spacing + 1, proposals.down),
              right = min((tile.right + margin - 1) / spacing + 1, proposals.across);
    offsets.add_around({0, 0}, distance);
    for (Int y = top; y < bottom; y++)
      for (Int x = left; x < right; x++) {
        const Offset *proposed = proposals.proposed + y * proposals.across + x;
        const bool is_known = (x > left && is_same(proposed[0], proposed[-1])) ||
                              (y > top && is_same(proposed[0], proposed[-proposals.across]));
        if (!is_known) offsets.add_around(*proposed, distance);
      }
  }
}

// Writes the lists of eight points of a tile, from number `first` on, to those of the frame. The expected motion is
// added where its similarity is not negative, and replaces the last entry of a list that is full; if nothing is listed,
// zero motion is.
template <Int CAPACITY>
FORCE_INLINE void write_lists(const Tile &tile, Int per_row, Int first, const F8 *listed, const I8 *packed,
                              F8 expected_similarity, I8 expected, const CandidateLists &lists) {
  const Int capacity = CAPACITY ? CAPACITY : lists.capacity;
  I8 count{}, is_expected = expected_similarity >= 0;
  for (Int entry = 0; entry < capacity; entry++) {
    const I8 is_filled = listed[entry] > NOTHING;
    count -= is_filled;
    is_expected &= ~(is_filled & (packed[entry] == expected));
  }
  for (Int lane = 0; lane < 8; lane++) {
    const Int p = (first + lane) / per_row, q = (first + lane) % per_row;
    if (p >= tile.down || q >= tile.across) continue;
    const Int point = (tile.first_row + p) * lists.across + tile.first_column + q;
    float *similarity = lists.similarity + point * capacity;
    Vector *flow = lists.flow + point * capacity;
    for (Int entry = 0; entry < capacity; entry++) {
      const int32_t offset = entry < count[lane] ? as<const int32_t *>(packed + entry)[lane] : 0;
      similarity[entry] = as<const float *>(listed + entry)[lane];
      flow[entry] = {float(int16_t(offset)), float(offset >> 16)};
    }
    lists.listed[point] = max(count[lane], 1);
    if (!is_expected[lane]) continue;
    const int32_t place = min(count[lane], int32_t(capacity - 1));
    similarity[place] = expected_similarity[lane];
    flow[place] = {float(int16_t(expected[lane])), float(expected[lane] >> 16)};
    lists.listed[point] = place + 1;
  }
}

// Sums of the similarity over the columns of a tile, from the first row of its patches to each row, for one offset
// after another. Differences of two of them are right even where the sums overflow. The rows of the first frame are
// copied before, since all offsets read them.
template <Int LANES> struct ColumnSums {
  alignas(64) uint16_t sums[TILE + 2 * MAX_TILE_PATCH_RADIUS + 1][LANES];
  alignas(64) uint8_t first[TILE + 2 * MAX_TILE_PATCH_RADIUS][3][64];
  alignas(32) uint8_t first_beyond[3][32], beyond[32];  // of the column after 32 lanes, where patches are that wide
  Int rows, row_stride, plane;
  uint8_t max_similarity;
  bool reads_beyond;

  template <typename V> FORCE_INLINE void copy_columns(const uint8_t *pixels, Int column) {
    for (Int row = 0; row < rows; row++)
      for (int c = 0; c < 3; c++)
        store(first[row][c] + column, load<V>(pixels + row * row_stride + c * plane + column));
  }
  // Begins a tile with the pixels of the first frame.
  FORCE_INLINE void begin(const Frames<uint8_t> &frames, const uint8_t *pixels, Int row_step, Int used_rows,
                          Int patch_size) {
    rows = used_rows;
    reads_beyond = LANES == 32 && patch_size == 9;
    row_stride = row_step * frames.stride;
    plane = frames.plane;
    max_similarity = uint8_t(frames.max_similarity);
    copy_columns<B32>(pixels, 0);
    if constexpr (LANES == 48) copy_columns<B16>(pixels, 32);
    if constexpr (LANES == 64) copy_columns<B32>(pixels, 32);
    if (reads_beyond) copy_beyond(pixels, first_beyond);
  }
  FORCE_INLINE void copy_beyond(const uint8_t *pixels, uint8_t (&column)[3][32]) const {
    for (Int row = 0; row < rows; row++)
      for (int c = 0; c < 3; c++) column[c][row] = pixels[row * row_stride + c * plane + 32];
  }
  template <typename V> FORCE_INLINE void compare_columns(const uint8_t *second, Int column) {
    const V most = max_similarity - V{};
    const Int apart = row_stride, planes_apart = plane;
    auto total = as_words(V{});
    second += column;
    for (Int row = 0; row < rows; row++, second += apart) {
      const V components[3] = {load<V>(first[row][0] + column), load<V>(first[row][1] + column),
                               load<V>(first[row][2] + column)};
      total += as_words(byte_similarity(components, second, planes_apart, most));
      store(sums[row + 1] + column, total);
    }
  }
  FORCE_INLINE void compare(const uint8_t *second) {
    alignas(32) uint8_t second_beyond[3][32];
    if (reads_beyond) copy_beyond(second, second_beyond);
    compare_columns<B32>(second, 0);
    if (reads_beyond) {
      const B32 pixels[3] = {load<B32>(first_beyond[0]), load<B32>(first_beyond[1]), load<B32>(first_beyond[2])};
      store(beyond, byte_similarity(pixels, second_beyond[0], 32, max_similarity - B32{}));
    }
    if constexpr (LANES == 48) compare_columns<B16>(second, 32);
    if constexpr (LANES == 64) compare_columns<B32>(second, 32);
  }
};

// Sums of two lanes side by side: of the first vector in even lanes, of the second one in odd lanes.
FORCE_INLINE W32 sum_pairs(W32 first, W32 second) {
  const U32 a = as<U32>(first), b = as<U32>(second);
  return as<W32>(((a + (a >> 16)) & 0xffffu) | ((b + (b << 16)) & 0xffff0000u));
}
FORCE_INLINE L8 sum_pairs_of_pairs(W32 first, W32 second) {
  const L8 a = as<L8>(first), b = as<L8>(second), lower = L8{} + 0xffffffffu;
  return ((a + (a >> 32)) & lower) | ((b + (b << 32)) & ~lower);
}

// Scores an offset at the sixteen points of a tile that are eight pixels apart, by patches of nine columns.
FORCE_INLINE void score_sixteen_points(const ColumnSums<32> &columns, Int rows_apart, Int compared, float share,
                                       float *scores) {
  W32 sums[4];
  L8 ninth{};
  alignas(32) uint16_t beyond[16] = {};
  for (Int p = 0; p < 4; p++) {
    const uint16_t *above = columns.sums[p * rows_apart];
    sums[p] = load<W32>(above + compared * 32) - load<W32>(above);
    ninth |= (as<L8>(sums[p]) & 0xffffu) << (16 * p);
    uint32_t total = 0;
    for (Int row = 0; row < compared; row++) total += columns.beyond[p * rows_apart + row];
    beyond[12 + p] = uint16_t(total);
  }
  // four lanes in each of eight groups: of four columns each, at the four points below each other
  const L8 fours = sum_pairs_of_pairs(sum_pairs(sums[0], sums[1]), sum_pairs(sums[2], sums[3]));
  const L4 left = __builtin_shufflevector(fours, fours, 0, 2, 4, 6),
           right = __builtin_shufflevector(fours, fours, 1, 3, 5, 7),
           next = __builtin_shufflevector(ninth, L8{}, 2, 4, 6, 8);
  const U16 down = as<U16>(left) + as<U16>(right) + as<U16>(next) + load<U16>(beyond);
  const U16 across = __builtin_shufflevector(down, down, 0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  store(scores, __builtin_convertvector(__builtin_convertvector(across, I16), F16) * share);
}

// Scores an offset at the points of a tile by the sums of its patches: `compared` rows of `size` columns, of which each
// pixel counts `share`. STEP is the distance between points, and sums fit 16 bits; or 0 for any.
template <Int STEP, Int LANES>
FORCE_INLINE void score_points(const ColumnSums<LANES> &columns, const Tile &tile, const TileSettings &settings,
                               Int size, Int compared, float share, Int per_row, float *scores) {
  const Int step = STEP ? STEP : settings.step, rows_apart = step / settings.row_step;
  if constexpr (LANES == 32)
    if (columns.reads_beyond) return score_sixteen_points(columns, rows_apart, compared, share, scores);
  alignas(64) uint16_t sums[TILE][LANES + 2 * MAX_TILE_PATCH_RADIUS];
  for (Int p = 0; p < tile.down; p++) {
    const uint16_t *above = columns.sums[p * rows_apart], *below = above + compared * LANES;
    for (Int i = 0; i < LANES; i++) sums[p][i] = uint16_t(below[i] - above[i]);
  }
  for (Int p = 0; p < tile.down; p++) {
    if constexpr (STEP == 0) {
      for (Int q = 0; q < tile.across; q++) {
        int32_t total = 0;
        for (Int i = 0; i < size; i++) total += sums[p][q * step + i];
        scores[p * per_row + q] = float(total) * share;
      }
    } else {
      W32 total = load<W32>(sums[p]);
      for (Int i = 1; i < size; i++) total += load<W32>(sums[p] + i);
      uint16_t totals[TILE];
      store(totals, total);
      for (Int q = 0; q < TILE / STEP; q++) scores[p * (TILE / STEP) + q] = float(totals[q * STEP]) * share;
    }
  }
}

// Adds to the similarity of an offset what its fraction of a pixel hides along an axis. Dissimilarity grows linearly
// with the distance from the true motion, so that the offsets before and after it differ by twice what is lost.
FORCE_INLINE void add_peak(F8 scores, F8 before, F8 after, F8 &similarity) {
  const I8 is_peak = (min(before, after) >= 0) & (scores >= max(before, after));
  similarity += is_peak ? 0.5f * absolute(before - after) : F8{};
}

// Lists the most similar offsets of all points of a tile, each at its best fraction of a pixel.
template <Int CAPACITY>
void list_offsets(const ProposedOffsets &proposals, const Tile &tile, Int step, const OffsetSet &offsets,
                  const TileWork &work, const CandidateLists &lists) {
  const Int per_row = TILE / step;
  offsets.find_beside(work.beside);
  for (Int first = 0; first < work.points; first += 8) {
    F8 listed_here[CAPACITY ? CAPACITY : 1], *listed = CAPACITY ? listed_here : work.similarity;
    I8 packed_here[CAPACITY ? CAPACITY : 1], *packed = CAPACITY ? packed_here : work.packed;
    for (Int entry = 0; entry < (CAPACITY ? CAPACITY : lists.capacity); entry++) {
      listed[entry] = broadcast<F8>(NOTHING);
      packed[entry] = I8{} + NOWHERE;
    }
    int32_t expected[8], expected_number[8];
    for (Int lane = 0; lane < 8; lane++) {
      const Int p = (first + lane) / per_row, q = (first + lane) % per_row;
      const Int y = min(((tile.first_row + p) * step + step / 2) / proposals.spacing, proposals.down - 1);
      const Int x = min(((tile.first_column + q) * step + step / 2) / proposals.spacing, proposals.across - 1);
      const Offset offset = proposals.expected[y * proposals.across + x];
      expected[lane] = packed_offset(offset);
      expected_number[lane] = offsets.number_if_any(offset.dx, offset.dy);
    }
    F8 expected_similarity = broadcast<F8>(-1);
    for (Int k = 0; k < offsets.count; k++) {
      const auto scores_of = [&](Int number)
                                 INLINE_LAMBDA { return load<F8>(work.scores + number * work.points + first); };
      const Beside &beside = work.beside[k];
      const F8 scores = scores_of(k + 1);
      F8 similarity = scores;
      add_peak(scores, scores_of(beside.left), scores_of(beside.right), similarity);
      add_peak(scores, scores_of(beside.above), scores_of(beside.below), similarity);
      expected_similarity = load<I8>(expected_number) == int32_t(k + 1) ? similarity : expected_similarity;
      insert_top_eight<CAPACITY>(offsets.offsets[k], similarity, listed, packed, lists.capacity);
    }
    write_lists<CAPACITY>(tile, per_row, first, listed, packed, expected_similarity, load<I8>(expected), lists);
  }
}

// Finds the most similar offsets, at least one, at every point of a frame. STEP, as in `score_points`, and LANES, the
// columns of a tile and its patches in whole vectors, are constants, so that a row is one piece of code.
template <Int STEP, Int LANES>
void search_tiles_of(const Frames<uint8_t> &frames, const ProposedOffsets &proposals, const TileSettings &settings,
                     const CandidateLists &lists, const TileWork &work) {
  const Int step = STEP ? STEP : settings.step, radius = settings.patch_radius, row_step = settings.row_step;
  const Int size = 2 * radius + 1, compared = (size + row_step - 1) / row_step;  // columns and rows of a patch
  const float share = float(1 / double(frames.max_similarity * size * compared));
  const Int per_row = TILE / step;
  ColumnSums<LANES> columns;
  __builtin_memset(work.number, 0, work.places * sizeof *work.number);
  for (Int i = 0; i < work.points; i++) work.scores[i] = NOTHING;
  __builtin_memset(&columns, 0, sizeof columns);
  for (Int top = 0; top < frames.height; top += TILE)
    for (Int left = 0; left < frames.width; left += TILE) {
      const Tile tile = {
          top,        left,        min(top + TILE, frames.height),        min(left + TILE, frames.width),
          top / step, left / step, min(per_row, lists.down - top / step), min(per_row, lists.across - left / step)};
      const Int last_row = max(tile.bottom, top + tile.down * step);  // the last points may lie beyond the frame's edge
      const Int rows = (tile.down - 1) * (step / row_step) + compared;
      OffsetSet offsets(settings.max_offset, work);
      gather_offsets(proposals, tile, settings.refine_radius, offsets);
      const Int place = frames.place(top + step / 2 - radius, left + step / 2 - radius);  // of the first patch
      columns.begin(frames, frames.first + place, row_step, rows, size);
      const auto score = [&](const uint8_t *second, float *scores) INLINE_LAMBDA {
        columns.compare(second + place);
        score_points<STEP>(columns, tile, settings, size, compared, share, per_row, scores);
      };
      for (Int k = 0; k < offsets.count; k++) {
        const Offset offset = offsets.offsets[k];
        float *scores = work.scores + (k + 1) * work.points;
        for (Int i = 0; i < work.points; i++) scores[i] = NOTHING;  // includes points beyond the frame
        if (min(top + offset.dy, left + offset.dx) < -TILE || last_row + offset.dy > frames.height + TILE ||
            tile.right + offset.dx > frames.width + TILE)
          continue;  // the tile would lie mostly outside
        score(frames.second + offset.dy * frames.stride + offset.dx, scores);
      }
      (lists.capacity == 8 ? list_offsets<8> : list_offsets<0>)(proposals, tile, step, offsets, work, lists);
      offsets.clear();
      score(frames.first + 1, work.scores + work.points);
      score(frames.first + frames.stride, work.scores + 2 * work.points);
      for (Int p = 0; p < tile.down; p++)
        for (Int q = 0; q < tile.across; q++) {
          const float *scores = work.scores + work.points + p * per_row + q;
          lists.detail[(tile.first_row + p) * lists.across + tile.first_column + q] =
              2 - scores[0] - scores[work.points];
        }
    }
}

FORCE_INLINE void search_tiles(const Frames<uint8_t> &frames, const ProposedOffsets &proposals,
                               const TileSettings &settings, const CandidateLists &lists, const TileWork &work) {
  const Int step = settings.patch_radius > 4 ? Int(0) : settings.step;
  const auto search = step == 2                             ? search_tiles_of<2, 48>
                      : step == 4                           ? search_tiles_of<4, 48>
                      : step == 8 && settings.row_step == 2 ? search_tiles_of<8, 32>
                                                            : search_tiles_of<0, 64>;
  search(frames, proposals, settings, lists, work);
}

}  // namespace
