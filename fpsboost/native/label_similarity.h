// What the similarity of labels would be without sampling.
//
// Whole pixels miss a motion by up to half a pixel, which costs similarity where a pattern is fine. One that repeats is
// then more similar some periods away, where it happens to lie on whole pixels (Birchfield and Tomasi 1998,
// doi:10.1109/34.677269, on the same effect in stereo).
#pragma once
#include "least_squares.h"
#include "similarity.h"
#include "tiles.h"

namespace {

constexpr float MIN_DETAIL = 0.3f;       // of a patch, below which sampling costs too little to matter
constexpr float MAX_FRACTION = 0.5f;     // of a pixel, in which motion and the nearest offset differ along x and y
constexpr float PERIOD_EVIDENCE = 0.2f;  // share of what one period is more similar than another that counts
constexpr float FLAT = 64;  // squared levels, added to gradients so that those of flat patches can be inverted

// The similarity of the patches around two places of the first frame, 0 to 1.
FORCE_INLINE float self_similarity(const Frames<uint8_t> &frames, Int place, Int other, Int radius) {
  const Int size = 2 * radius + 1, corner = radius * (frames.stride + 1);
  const B16 max_similarity = broadcast_byte(uint8_t(frames.max_similarity));
  const uint8_t *pixels = frames.first + place - corner, *others = frames.first + other - corner;
  uint32_t total = 0;
  for (Int column = 0; column < size; column += 16) {
    U16 sums{};
    for (Int row = 0; row < size; row++) {
      const Int at = row * frames.stride + column;
      const B16 components[3] = {load<B16>(pixels + at), load<B16>(pixels + frames.plane + at),
                                 load<B16>(pixels + 2 * frames.plane + at)};
      sums += linear_similarity(components, others + at, frames.plane, max_similarity);
    }
    for (Int i = 0; i < min(size - column, Int(16)); i++) total += sums[i];
  }
  return float(total) * float(1 / double(frames.max_similarity * size * size));
}

// The share of the squared differences of two windows that a fraction of a pixel does not explain.
FORCE_INLINE float unexplained_share(const Frames<uint8_t> &frames, Int place0, Int place1) {
  const Int corner = (WINDOW_SIDE / 2 + 1) * (frames.stride + 1);
  const Products<float> sums = window_products<false>(frames.first + place0 - corner, frames.second + place1 - corner,
                                                      frames.stride, frames.plane, 0);
  if (!(sums.tt > 0)) return 1;
  const Vector along = solve(sums, FLAT);
  const float limit = MAX_FRACTION / 4, x = clamp(along.dx, -limit, limit), y = clamp(along.dy, -limit, limit);
  const float explained = 2 * (x * sums.xt + y * sums.yt) - x * x * sums.xx - 2 * x * y * sums.xy - y * y * sums.yy;
  return clamp(1 - explained / sums.tt, 0.0f, 1.0f);
}

// Labels of one point in order of falling similarity, but for the last one, which may be the expected motion.
struct Labels {
  Int count;
  float *similarity;
  const Vector *motion;

  Int best() const {
    Int first = 0;
    for (Int k = 1; k < count; k++)
      if (similarity[k] > similarity[first]) first = k;
    return first;
  }
  bool have_rivals(float gap) const {
    bool any_rival = false;
    for (Int k = 1; k < count; k++) any_rival |= is_rival(k, 0, gap);
    return any_rival;
  }
  bool is_rival(Int k, Int best, float gap) const { return k != best && similarity[k] >= similarity[best] - gap; }
};

// Raises the similarity of labels to that at the best fraction of a pixel.
FORCE_INLINE void add_fractions(const Frames<uint8_t> &frames, Int place, float slack, const Labels &labels) {
  const float least = labels.similarity[labels.best()] - slack;
  for (Int k = 0; k < labels.count; k++) {
    float &similarity = labels.similarity[k];
    if (similarity < least || similarity >= 1) continue;
    const Int other = place + Int(labels.motion[k].dy) * frames.stride + Int(labels.motion[k].dx);
    similarity = 1 - (1 - similarity) * __builtin_sqrtf(unexplained_share(frames, place, other));
  }
}

// Gives those labels that lie a period of the pattern from the best one nearly its similarity, so that neighbours
// decide, and the little that is left only where they all agree on it. Nothing is left where a label leads out of the
// frame: the pixels that are repeated there lower its similarity, whether it is right or not.
FORCE_INLINE void equalise_periods(const Frames<uint8_t> &frames, Int y, Int x, Int radius, float slack,
                                   const Labels &labels) {
  const Int best = labels.best(), room = frames.padding - radius;
  for (Int k = 0; k < labels.count; k++) {
    const Vector motion = labels.motion[k], best_motion = labels.motion[best];
    const bool stays = frames.holds_patch(y + Int(motion.dy), x + Int(motion.dx), radius);
    if (k == best || (stays && !labels.is_rival(k, best, 0.5f * slack))) continue;  // a quarter of a pixel is unknown
    Int dy = Int(motion.dy - best_motion.dy), dx = Int(motion.dx - best_motion.dx);
    // the frame ends on the side where the label leads; a pattern repeats to the other side, too
    if (!stays && !frames.holds_patch(y + dy, x + dx, radius)) dy = -dy, dx = -dx;
    if (min(y + dy, x + dx) < -room || y + dy >= frames.height + room || x + dx >= frames.width + room) continue;
    if (self_similarity(frames, frames.place(y, x), frames.place(y + dy, x + dx), radius) >= 1 - 0.5f * slack)
      labels.similarity[k] += (stays ? 1 - PERIOD_EVIDENCE : 1.0f) * (labels.similarity[best] - labels.similarity[k]);
  }
}

FORCE_INLINE void compare_labels(const Frames<uint8_t> &frames, Int step, Int radius, const CandidateLists &lists) {
  for (Int row = 0; row < lists.down; row++)
    for (Int column = 0; column < lists.across; column++) {
      const Int point = row * lists.across + column, first = point * lists.capacity;
      const Labels labels = {lists.listed[point], lists.similarity + first, lists.flow + first};
      const float slack = 0.5f * lists.detail[point];
      if (lists.detail[point] < MIN_DETAIL || !labels.have_rivals(slack)) continue;
      const Int y = row * step + step / 2, x = column * step + step / 2;  // maybe beyond the frame, as in the search
      add_fractions(frames, frames.place(y, x), slack, labels);
      equalise_periods(frames, y, x, radius, slack, labels);
    }
}

}  // namespace
