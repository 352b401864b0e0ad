// Search of one level of the pyramid in one or both directions: compare what a coarser level proposes, and choose among
// it.
#include "label_similarity.h"
#include "semi_global.h"
#include "tiles.h"

namespace {

constexpr Int REFINE_RADIUS = 1;  // distance from a proposal within which offsets are compared, along x and y together
constexpr Int SPARSE_STEP = 8;    // distance between points from which on every second row of a patch is compared

// Motion in units of another scale, in whole pixels.
FORCE_INLINE void whole_pixels(const float *motion, Int places, float scale, Offset *rounded) {
  for (Int i = 0; i < places; i++)
    rounded[i] = {int32_t(__builtin_rintf(motion[2 * i] * scale)), int32_t(__builtin_rintf(motion[2 * i + 1] * scale))};
}

CandidateLists candidate_lists(const OffsetLists &lists) {
  return {lists.listed.data,     lists.similarity.data, as<Vector *>(lists.flow.data), lists.detail.data,
          lists.listed.shape[0], lists.listed.shape[1], lists.similarity.shape[2]};
}

}  // namespace

KERNEL(Int, search_tiles, const SearchTiles &args) {
  Workspace workspace(args.scratch);
  const TileSettings settings = {args.step, args.refine_radius, args.max_offset, args.patch_radius, args.row_step};
  const TileWork work(settings, args.proposals.spacing, args.lists.similarity.shape[2], workspace);
  if (workspace.is_counting()) return workspace.size();
  const ArrayOf<const int32_t, 3> &motion = args.proposals.motion;
  search_tiles(Frames<uint8_t>(args.pair),
               {as<const Offset *>(motion.data), as<const Offset *>(args.proposals.expected.data), motion.shape[0],
                motion.shape[1], args.proposals.spacing},
               settings, candidate_lists(args.lists), work);
  return 0;
}

KERNEL(void, compare_labels, const CompareLabels &args) {
  compare_labels(Frames<uint8_t>(args.pair), args.step, args.patch_radius, candidate_lists(args.lists));
}

KERNEL(Int, choose_labels, const ChooseLabels &args) {
  Workspace workspace(args.scratch);
  const Lattice lattice(args.count.shape[0] * args.count.shape[1], args.count.shape[1], args.similarity.shape[2],
                        args.costs.data, workspace);
  if (workspace.is_counting()) return workspace.size();
  choose_labels({args.count.data, as<const Vector *>(args.motions.data), args.similarity.data,
                 args.smoothness_weight.data, args.count.shape[0], args.count.shape[1], args.similarity.shape[2]},
                args.smoothness, args.slope, lattice, as<Vector *>(args.flow.data), args.chosen.data);
  return 0;
}

KERNEL(Int, search_level, const SearchLevel &args) {
  const View<const float, 4> proposed(args.coarse.proposed), expected(args.coarse.expected);
  const View<const float, 3> coarse_weight(args.coarse.smoothness_weight);
  const View<float, 4> flow(args.points.flow);
  const View<float, 3> similarity(args.points.similarity);
  const Int down = proposed.shape[1], across = proposed.shape[2], rows = flow.shape[1], columns = flow.shape[2];
  const Int nodes = rows * columns, labels = args.settings.labels, spacing = args.settings.spacing,
            step = args.settings.step;
  const TileSettings tiles = {step, REFINE_RADIUS, args.settings.max_offset, args.settings.patch_radius,
                              step % SPARSE_STEP ? Int(1) : Int(2)};
  Workspace scratch(args.scratch);
  Offset *whole_proposed = scratch.take<Offset>(down * across), *whole_expected = scratch.take<Offset>(down * across);
  float *smoothness_weight = scratch.take<float>(nodes), *costs = scratch.take<float>(nodes * ((labels + 7) / 8 * 8));
  CandidateLists lists = {scratch.take<int32_t>(nodes),
                          scratch.take<float>(nodes * labels),
                          scratch.take<Vector>(nodes * labels),
                          scratch.take<float>(nodes),
                          rows,
                          columns,
                          labels};
  const TileWork work(tiles, spacing, labels, scratch);
  const Lattice lattice(nodes, columns, labels, costs, scratch);
  if (scratch.is_counting()) return scratch.size();
  Frames<uint8_t> frames(args.pair);
  for (Int direction = 0; direction < flow.shape[0]; direction++) {
    whole_pixels(proposed.ptr(direction), down * across, args.settings.scale, whole_proposed);
    whole_pixels(expected.ptr(direction), down * across, args.settings.scale, whole_expected);
    search_tiles(frames, {whole_proposed, whole_expected, down, across, spacing}, tiles, lists, work);
    compare_labels(frames, step, args.settings.patch_radius, lists);
    for (Int row = 0; row < rows; row++)
      for (Int column = 0; column < columns; column++) {
        // points have the weights of the places in which they lie
        const Int y = point_centre(row, step, frames.height) / spacing,
                  x = point_centre(column, step, frames.width) / spacing;
        smoothness_weight[row * columns + column] = coarse_weight(direction, y, x);
      }
    choose_labels({lists.listed, lists.flow, lists.similarity, smoothness_weight, rows, columns, labels},
                  args.settings.smoothness, args.settings.slope, lattice, as<Vector *>(flow.ptr(direction)),
                  similarity.ptr(direction));
    frames = frames.opposite();
  }
  return 0;
}
