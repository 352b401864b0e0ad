// Search of one level of the pyramid in both directions: compare what a coarser level proposes, and choose among it.
#include "semi_global.h"
#include "tiles.h"

namespace {

// Motion in units of another scale, in whole pixels.
INLINE void whole_pixels(const float *motion, Int places, float scale, Offset *rounded) {
  for (Int i = 0; i < places; i++)
    rounded[i] = {int32_t(__builtin_rintf(motion[2 * i] * scale)), int32_t(__builtin_rintf(motion[2 * i + 1] * scale))};
}

}  // namespace

KERNEL(Int, search_tiles, SearchTiles) {
  Workspace workspace(a.scratch);
  const TileSettings settings = {a.step, a.refine_radius, a.max_offset, a.patch_radius, a.row_step};
  const TileWork work(settings, a.proposals.spacing, a.lists.similarity.shape[2], workspace);
  if (workspace.is_counting()) return workspace.size();
  const Array &motion = a.proposals.motion, &listed = a.lists.listed;
  search_tiles(Frames<uint8_t>(a.pair),
               {(const Offset *)motion.data, (const Offset *)a.proposals.expected.data, motion.shape[0],
                motion.shape[1], a.proposals.spacing},
               settings,
               {(int32_t *)listed.data, (float *)a.lists.similarity.data, (float (*)[2])a.lists.flow.data,
                listed.shape[0], listed.shape[1], a.lists.similarity.shape[2]},
               work);
  return 0;
}

KERNEL(Int, choose_labels, ChooseLabels) {
  Workspace workspace(a.scratch);
  const Lattice lattice(a.count.shape[0] * a.count.shape[1], a.similarity.shape[2], (float *)a.costs.data, workspace);
  if (workspace.is_counting()) return workspace.size();
  choose_labels({(const int32_t *)a.count.data, (const float (*)[2])a.motions.data, (const float *)a.similarity.data,
                 (const float *)a.ties.data, a.count.shape[0], a.count.shape[1], a.similarity.shape[2]},
                float(a.smoothness), float(a.slope), lattice, (float (*)[2])a.flow.data, (float *)a.chosen.data);
  return 0;
}

KERNEL(Int, search_level, SearchLevel) {
  const View<const float, 4> proposed(a.coarse.proposed), expected(a.coarse.expected);
  const View<const float, 3> coarse_ties(a.coarse.ties);
  const View<float, 4> flow(a.points.flow);
  const View<float, 3> similarity(a.points.similarity);
  const Int down = proposed.shape[1], across = proposed.shape[2], rows = flow.shape[1], columns = flow.shape[2];
  const Int nodes = rows * columns, labels = a.settings.labels, spacing = a.settings.spacing, step = a.settings.step;
  const TileSettings tiles = {step, a.settings.refine_radius, a.settings.max_offset, a.settings.patch_radius,
                              a.settings.row_step};
  Workspace scratch(a.scratch);
  Offset *whole_proposed = scratch.take<Offset>(down * across), *whole_expected = scratch.take<Offset>(down * across);
  float *ties = scratch.take<float>(nodes), *costs = scratch.take<float>(nodes * ((labels + 7) / 8 * 8));
  CandidateLists lists = {scratch.take<int32_t>(nodes),
                          scratch.take<float>(nodes * labels),
                          (float (*)[2])scratch.take<float>(2 * nodes * labels),
                          rows,
                          columns,
                          labels};
  const TileWork work(tiles, spacing, labels, scratch);
  const Lattice lattice(nodes, labels, costs, scratch);
  if (scratch.is_counting()) return scratch.size();
  Frames<uint8_t> frames(a.pair);
  for (int direction = 0; direction < 2; direction++) {
    whole_pixels(proposed.at(direction), down * across, float(a.settings.scale), whole_proposed);
    whole_pixels(expected.at(direction), down * across, float(a.settings.scale), whole_expected);
    search_tiles(frames, {whole_proposed, whole_expected, down, across, spacing}, tiles, lists, work);
    for (Int row = 0; row < rows; row++)
      for (Int column = 0; column < columns; column++) {
        // points have the ties of the places in which they lie
        const Int y = point_centre(row, step, frames.height) / spacing,
                  x = point_centre(column, step, frames.width) / spacing;
        ties[row * columns + column] = coarse_ties(direction, y, x);
      }
    choose_labels({lists.listed, lists.flow, lists.similarity, ties, rows, columns, labels},
                  float(a.settings.smoothness), float(a.settings.slope), lattice, (float (*)[2])flow.at(direction),
                  similarity.at(direction));
    frames = frames.opposite();
  }
  return 0;
}
