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

constexpr Int PROPOSAL_MARGIN = 8;             // distance beyond the tile within which proposals are collected, pixels
constexpr float NOTHING = -2, NOWHERE = 1e6f;  // similarity and offset of an empty entry

struct Offset {
  int32_t dx, dy;
};

struct TileSettings {
  Int step, refine_radius, max_offset, patch_radius, row_step;
};

// Work arrays: the number of each offset among those of a tile, 0 for others; the offsets of a tile; what each of them
// scores at the points, and NOTHING for number 0; and the lists of the points.
struct TileWork {
  Int points, places;
  int32_t *number;
  Offset *offsets;
  float *scores, *entries;

  TileWork(const TileSettings &settings, Int spacing, Int capacity, Workspace &workspace) {
    const Int per_tile = TILE / settings.step, side = 2 * settings.max_offset + 1;
    const Int proposals = (TILE + 2 * PROPOSAL_MARGIN) / spacing + 2, reach = 2 * settings.refine_radius + 1;
    const Int most = 2 + min(side * side, reach * reach * (1 + proposals * proposals));
    points = max(per_tile * per_tile, Int(8));
    places = side * side;
    number = workspace.take<int32_t>(places);
    offsets = workspace.take<Offset>(most);
    scores = workspace.take<float>((1 + most) * points);
    entries = workspace.take<float>(capacity * 3 * points);
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

// One entry of the lists of all points of a tile.
struct EntryRow {
  float *similarity, *dx, *dy;

  EntryRow(float *entries, Int entry, Int points)
      : similarity(entries + 3 * entry * points), dx(similarity + points), dy(dx + points) {}
};

// Inserts an offset into the lists of eight points, which are in order of falling similarity; of neighbouring offsets,
// only the more similar one is kept.
FORCE_INLINE void insert_top_eight(float dx, float dy, const float *similarities, Int first, float *entries, Int points,
                                   Int capacity) {
  const F8 similarity = load<F8>(similarities + first);
  if (!any(similarity > load<F8>(EntryRow(entries, capacity - 1, points).similarity + first))) return;
  F8 inserted[3] = {similarity, broadcast<F8>(dx), broadcast<F8>(dy)};
  I8 is_open = ~I8{};
  for (Int entry = 0; entry < capacity; entry++) {
    const EntryRow row(entries, entry, points);
    float *places[3] = {row.similarity + first, row.dx + first, row.dy + first};
    const F8 before[3] = {load<F8>(places[0]), load<F8>(places[1]), load<F8>(places[2])};
    const I8 writes = is_open & (similarity > before[0]);
    for (int n = 0; n < 3; n++) {
      store(places[n], writes ? inserted[n] : before[n]);
      inserted[n] = writes ? before[n] : inserted[n];
    }
    is_open &= ~((absolute(before[1] - dx) <= 1) & (absolute(before[2] - dy) <= 1));
  }
}

// Offsets of a tile, each once.
struct OffsetSet {
  Int limit, side, count;
  int32_t *number;
  Offset *offsets;

  OffsetSet(Int limit, const TileWork &work)
      : limit(limit), side(2 * limit + 1), count(0), number(work.number), offsets(work.offsets) {}

  int32_t &number_of(Int dx, Int dy) const { return number[(dy + limit) * side + dx + limit]; }

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
      for (Int x = left; x < right; x++) offsets.add_around(proposals.proposed[y * proposals.across + x], distance);
  }
}

// Appends an offset to a point's list if it is not listed yet; if the list is full, replaces the last entry.
FORCE_INLINE void keep_offset(Offset offset, float similarity, Int point, const CandidateLists &lists) {
  Vector *flow = lists.flow + point * lists.capacity;
  const Int count = lists.listed[point];
  for (Int k = 0; k < count; k++)
    if (flow[k].dx == float(offset.dx) && flow[k].dy == float(offset.dy)) return;
  const Int place = min(count, lists.capacity - 1);
  lists.similarity[point * lists.capacity + place] = similarity;
  flow[place] = {float(offset.dx), float(offset.dy)};
  lists.listed[point] = int32_t(place + 1);
}

// Points of a tile: the expected offset and its similarity, and the similarity of the offset that is compared.
struct TilePoints {
  Int per_row;
  Offset expected[TILE * TILE];
  float expected_similarity[TILE * TILE], similarity[TILE * TILE];
};

// Writes the lists of a tile's points to those of the frame. The expected motion is added where its similarity is not
// negative; if nothing is listed, zero motion is.
FORCE_INLINE void write_lists(const Tile &tile, const TileWork &work, const TilePoints &points,
                              const CandidateLists &lists) {
  for (Int p = 0; p < tile.down; p++)
    for (Int q = 0; q < tile.across; q++) {
      const Int of_tile = p * points.per_row + q, point = (tile.first_row + p) * lists.across + tile.first_column + q;
      float *similarity = lists.similarity + point * lists.capacity;
      Vector *flow = lists.flow + point * lists.capacity;
      int32_t count = 0;
      for (Int entry = 0; entry < lists.capacity; entry++) {
        const EntryRow row(work.entries, entry, work.points);
        const bool is_filled = row.similarity[of_tile] > NOTHING;
        similarity[entry] = is_filled ? row.similarity[of_tile] : NOTHING;
        flow[entry] = is_filled ? Vector{row.dx[of_tile], row.dy[of_tile]} : Vector{0, 0};
        if (is_filled) count = int32_t(entry + 1);
      }
      lists.listed[point] = count;
      if (points.expected_similarity[of_tile] >= 0)
        keep_offset(points.expected[of_tile], points.expected_similarity[of_tile], point, lists);
      lists.listed[point] = max(lists.listed[point], 1);
    }
}

// Sums of the similarity over the columns of a tile, from its top to each row, for one offset after another.
// Differences of two of them are right even where the sums overflow.
template <Int LANES> struct ColumnSums {
  alignas(64) uint16_t sums[TILE + 2 * MAX_TILE_PATCH_RADIUS + 1][LANES];

  void compare(const Frames<uint8_t> &frames, Int place0, Int place1, Int row_stride, Int rows) {
    const B16 max_similarity = broadcast_byte(uint8_t(frames.max_similarity));
    for (Int row = 0; row < rows; row++, place0 += row_stride, place1 += row_stride)
      for (Int i = 0; i < LANES; i += 16) {
        const uint8_t *pixels = frames.first + place0 + i;
        const B16 components[3] = {load<B16>(pixels), load<B16>(pixels + frames.plane),
                                   load<B16>(pixels + 2 * frames.plane)};
        const U16 similarity = linear_similarity(components, frames.second + place1 + i, frames.plane, max_similarity);
        store(sums[row + 1] + i, load<U16>(sums[row] + i) + similarity);
      }
  }
};

// Begins the points of a tile, and their lists, in which nothing is.
FORCE_INLINE void begin_points(const ProposedOffsets &proposals, const Tile &tile, Int step, Int capacity,
                               const TileWork &work, TilePoints &points) {
  for (Int k = 0; k < capacity; k++) {
    const EntryRow row(work.entries, k, work.points);
    for (Int i = 0; i < work.points; i++) {
      row.similarity[i] = NOTHING;
      row.dx[i] = row.dy[i] = NOWHERE;
    }
  }
  for (Int p = 0; p < tile.down; p++)
    for (Int q = 0; q < tile.across; q++) {
      const Int y = min(((tile.first_row + p) * step + step / 2) / proposals.spacing, proposals.down - 1);
      const Int x = min(((tile.first_column + q) * step + step / 2) / proposals.spacing, proposals.across - 1);
      points.expected[p * points.per_row + q] = proposals.expected[y * proposals.across + x];
      points.expected_similarity[p * points.per_row + q] = -1;
    }
}

// Scores an offset at the points of a tile by the sums of its patches: `compared` rows of `size` columns, of which each
// pixel counts `share`.
template <Int LANES>
FORCE_INLINE void score_points(const ColumnSums<LANES> &columns, const Tile &tile, const TileSettings &settings,
                               Int size, Int compared, float share, Int per_row, float *scores) {
  const Int step = settings.step;
  for (Int p = 0; p < tile.down; p++) {
    const uint16_t *above = columns.sums[(p * step + step / 2) / settings.row_step], *below = above + compared * LANES;
    uint16_t sums[LANES];
    for (Int i = 0; i < LANES; i++) sums[i] = uint16_t(below[i] - above[i]);
    for (Int q = 0; q < tile.across; q++) {
      int32_t total = 0;
      for (Int i = 0; i < size; i++) total += sums[q * step + step / 2 + i];
      scores[p * per_row + q] = float(total) * share;
    }
  }
}

// Adds to the similarity of an offset what its fraction of a pixel hides along an axis. Dissimilarity grows linearly
// with the distance from the true motion, so that the offsets before and after it differ by twice what is lost.
FORCE_INLINE void add_peak(const float *scores, const float *before, const float *after, Int points,
                           float *similarity) {
  for (Int i = 0; i < points; i++) {
    const bool is_peak = min(before[i], after[i]) >= 0 && scores[i] >= max(before[i], after[i]);
    similarity[i] += is_peak ? 0.5f * absolute(before[i] - after[i]) : 0.0f;
  }
}

// Computes the similarity of an offset at the points of a tile, at its best fraction of a pixel.
FORCE_INLINE void find_similarity(const TileWork &work, const OffsetSet &offsets, Int k, TilePoints &points) {
  const Offset offset = offsets.offsets[k];
  const float *scores = work.scores + (k + 1) * work.points;
  for (Int i = 0; i < work.points; i++) points.similarity[i] = scores[i];
  for (Int axis = 0; axis < 2; axis++) {
    const Int along_x = axis == 0, along_y = axis == 1;
    const Int along = axis ? offset.dy : offset.dx;
    if (max(along, -along) == offsets.limit) continue;
    const Int before = offsets.number_of(offset.dx - along_x, offset.dy - along_y),
              after = offsets.number_of(offset.dx + along_x, offset.dy + along_y);
    add_peak(scores, work.scores + before * work.points, work.scores + after * work.points, work.points,
             points.similarity);
  }
  for (Int i = 0; i < work.points; i++)
    if (offset.dx == points.expected[i].dx && offset.dy == points.expected[i].dy)
      points.expected_similarity[i] = points.similarity[i];
}

// Finds the most similar offsets, at least one, at every point of a frame. LANES, the columns of a tile and its patches
// in whole vectors, is a constant, so that a row is one piece of code.
template <Int LANES>
void search_tiles_of(const Frames<uint8_t> &frames, const ProposedOffsets &proposals, const TileSettings &settings,
                     const CandidateLists &lists, const TileWork &work) {
  const Int step = settings.step, radius = settings.patch_radius, row_step = settings.row_step;
  const Int size = 2 * radius + 1, compared = (size + row_step - 1) / row_step;  // columns and rows of a patch
  const float share = float(1 / double(frames.max_similarity * size * compared));
  TilePoints points;
  points.per_row = TILE / step;
  ColumnSums<LANES> columns;
  __builtin_memset(work.number, 0, work.places * sizeof *work.number);
  for (Int i = 0; i < work.points; i++) work.scores[i] = NOTHING;
  __builtin_memset(columns.sums[0], 0, sizeof columns.sums[0]);
  for (Int top = 0; top < frames.height; top += TILE)
    for (Int left = 0; left < frames.width; left += TILE) {
      const Tile tile = {top,
                         left,
                         min(top + TILE, frames.height),
                         min(left + TILE, frames.width),
                         top / step,
                         left / step,
                         min(points.per_row, lists.down - top / step),
                         min(points.per_row, lists.across - left / step)};
      begin_points(proposals, tile, step, lists.capacity, work, points);
      const Int last_row = max(tile.bottom, top + tile.down * step);  // the last points may lie beyond the frame's edge
      const Int rows = (last_row - top + 2 * radius + row_step - 1) / row_step;
      OffsetSet offsets(settings.max_offset, work);
      gather_offsets(proposals, tile, settings.refine_radius, offsets);
      const auto score = [&](const Frames<uint8_t> &of, Offset offset, float *scores) {
        columns.compare(of, of.place(top - radius, left - radius),
                        of.place(top - radius + offset.dy, left - radius + offset.dx), row_step * of.stride, rows);
        score_points(columns, tile, settings, size, compared, share, points.per_row, scores);
      };
      for (Int k = 0; k < offsets.count; k++) {
        const Offset offset = offsets.offsets[k];
        float *scores = work.scores + (k + 1) * work.points;
        for (Int i = 0; i < work.points; i++) scores[i] = NOTHING;  // includes points beyond the frame
        if (min(top + offset.dy, left + offset.dx) < -TILE || last_row + offset.dy > frames.height + TILE ||
            tile.right + offset.dx > frames.width + TILE)
          continue;  // the tile would lie mostly outside
        score(frames, offset, scores);
      }
      for (Int k = 0; k < offsets.count; k++) {
        find_similarity(work, offsets, k, points);
        for (Int i = 0; i < work.points; i += 8)
          insert_top_eight(float(offsets.offsets[k].dx), float(offsets.offsets[k].dy), points.similarity, i,
                           work.entries, work.points, lists.capacity);
      }
      offsets.clear();
      write_lists(tile, work, points, lists);
      score(frames.first_alone(), {1, 0}, work.scores + work.points);
      score(frames.first_alone(), {0, 1}, work.scores + 2 * work.points);
      for (Int p = 0; p < tile.down; p++)
        for (Int q = 0; q < tile.across; q++) {
          const float *scores = work.scores + work.points + p * points.per_row + q;
          lists.detail[(tile.first_row + p) * lists.across + tile.first_column + q] =
              2 - scores[0] - scores[work.points];
        }
    }
}

FORCE_INLINE void search_tiles(const Frames<uint8_t> &frames, const ProposedOffsets &proposals,
                               const TileSettings &settings, const CandidateLists &lists, const TileWork &work) {
  const bool fits = TILE + 2 * settings.patch_radius <= 48;
  (fits ? search_tiles_of<48> : search_tiles_of<64>)(frames, proposals, settings, lists, work);
}

}  // namespace
