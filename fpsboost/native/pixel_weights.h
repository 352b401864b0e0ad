// Weights of the pixels of a window: how similar both frames are along each candidate motion of its node.
//
// The weight of a candidate at a pixel is its prior weight, by its votes, times an exponential of the patch similarity
// of the two samples at time t: non-local means over motions instead of over places. Learnt weights are the
// exponentials of sums of features, for both frames along the candidate and for either alone.
#pragma once
#include "fusion_features.h"

namespace {

constexpr float MIN_WEIGHT_SUM = 1e-30f;    // initial value of sums of weights, which keeps them above zero
constexpr float MAX_LOGIT = 20;             // logarithms of weights are limited to this
constexpr float FOREGROUND_SCALE = 4;       // on squared differences: a bandwidth of 0.15 at which thin things match
constexpr float FOREGROUND_SHARPNESS = 10;  // logarithm of the factor on the weight of what is certainly in front
constexpr float MAX_GAIN = float(22026.465794806718);  // the factor itself, exp(FOREGROUND_SHARPNESS)
constexpr float NEAR_MOTION = 8, FAR_MOTION = 16;      // of a candidate and the dominant motion, pixels apart
constexpr float FOREGROUND_AGREEMENT = 3;  // on the agreement with the fields: along an edge motion is ambiguous

struct NodeSums {                                                   // over the candidates of a node
  alignas(64) float weights[BLOCKS_2X2], similarities[BLOCKS_2X2];  // the latter are weighted
  alignas(64) float max_similarity[BLOCKS_2X2];                     // largest similarity of any candidate
  alignas(64) float reached[BLOCKS_2X2];  // plain weights, by which further candidates are skipped
  float min_weight, min_similarity;       // of any 2x2 block: plain weight so far, largest similarity
  // The dominant motion is that of the candidate which matches most of the window, times its share of the votes: on
  // flat ground, whatever is in front matches as well.
  alignas(64) float mismatch[BLOCKS_2X2_PER_ROW][3 * BLOCKS_2X2_PER_ROW];  // with zeros on both sides of the window
  float matched;
  Motion dominant;

  NodeSums() {
    for (int i = 0; i < BLOCKS_2X2; i++) {
      weights[i] = MIN_WEIGHT_SUM;
      similarities[i] = max_similarity[i] = reached[i] = 0;
    }
    __builtin_memset(mismatch, 0, sizeof mismatch);
    min_weight = min_similarity = matched = 0;
    dominant = {};
  }
};

struct CandidateWeights {                 // of the 2x2 blocks of a window
  alignas(64) float squared[BLOCKS_2X2];  // squared differences along the candidate
  alignas(64) float weight[BLOCKS_2X2];
  // weight of the difference of frame 1 from frame 0, as one of them alone weighs more than its share by time
  alignas(64) float antisymmetric[BLOCKS_2X2];
  alignas(64) float gain[BLOCKS_2X2];  // factor on the weights; see find_foreground
  Features features;
};

FORCE_INLINE void count_similarity(const float *weight, const float *similarity, NodeSums &sums) {
  for (int i = 0; i < BLOCKS_2X2; i += 16) {
    const F16 w = load<F16>(weight + i), similar = load<F16>(similarity + i);
    store(sums.weights + i, load<F16>(sums.weights + i) + w);
    store(sums.similarities + i, fma(w, similar, load<F16>(sums.similarities + i)));
    store(sums.max_similarity + i, max(load<F16>(sums.max_similarity + i), similar));
  }
  sums.min_similarity = smallest(sums.max_similarity);
}

// Computes the plain weights of a candidate from its squared differences.
inline void find_plain_weights(float prior, const Weighting &weighting, CandidateWeights &candidate, NodeSums &sums) {
  alignas(64) float values[BLOCKS_2X2], similarity[BLOCKS_2X2];
  const float sharpness = weighting.sharpness;
  write_decay(candidate.squared, 0, weighting.scale, 1, values);
  average_patches(values, similarity);
  write_decay(similarity, sharpness, -sharpness, prior, candidate.weight);
  count_similarity(candidate.weight, similarity, sums);
  sums.min_weight = smallest(sums.weights);
}

// Writes the mismatch, bilinearly, of the place so many 2x2 blocks on from each; 0 outside of the window.
inline void find_mismatch(const NodeSums &sums, float down, float across, float *moved) {
  constexpr Int SIZE = BLOCKS_2X2_PER_ROW;
  const float whole_y = __builtin_floorf(down), whole_x = __builtin_floorf(across);
  const float below = down - whole_y, right = across - whole_x;
  const bool overlaps = min(whole_y, whole_x) >= -SIZE && max(whole_y, whole_x) < SIZE;
  const Int y = overlaps ? Int(whole_y) : SIZE, x = overlaps ? Int(whole_x) : 0;
  for (Int j = 0; j < SIZE; j++) {
    F16 sum{};
    for (Int n = 0; n < 2; n++) {
      const Int row = j + y + n;
      if (row < 0 || row >= SIZE) continue;
      const float *from = sums.mismatch[row] + SIZE + x, share = n ? below : 1 - below;
      sum += share * (1 - right) * load<F16>(from);
      sum += share * right * load<F16>(from + 1);
    }
    store(moved + j * SIZE, sum);
  }
}

FORCE_INLINE float motion_distance(const Motion &a, const Motion &b) {
  return max(absolute(a.dx - b.dx), absolute(a.dy - b.dy));
}

// Raises the mismatch of the ends of a candidate along the dominant motion to that of the luma, times a share: if the
// candidate moves far, its ends are outside of the window.
inline void raise_mismatch(float share, Int top, Int left, const Motion &motion, const Motion &dominant, float t,
                           const PairContext &context, float *front, float *other) {
  alignas(64) float end[BLOCKS_2X2], along[BLOCKS_2X2];
  for (int n = 0; n < 2; n++) {
    // the dominant motion leads from one end, of the candidate in frame n, to this place of the other frame
    const float ratio = n ? (1 - t) / t : t / (1 - t);
    Motion moved = motion;
    moved.dx = dominant.dx - ratio * (motion.dx - dominant.dx);
    moved.dy = dominant.dy - ratio * (motion.dy - dominant.dy);
    fetch_luma(1 + n, top, left, motion, t, context, end);
    fetch_luma(2 - n, top, left, moved, t, context, along);
    float *mismatch = n ? other : front;
    for (int i = 0; i < BLOCKS_2X2; i += 16) {
      const F16 difference = load<F16>(end + i) - load<F16>(along + i);
      const F16 match = decay(difference * difference, 0, context.luma_scale * FOREGROUND_SCALE, share);
      store(mismatch + i, max(load<F16>(mismatch + i), share - match));
    }
  }
}

// Writes the factor by which a candidate gains where it shows what is in front of the dominant motion of the window.
//
// A thin thing that moves by more than its width leaves no gap in what is behind it: there, both frames agree along
// either motion, and similarity cannot tell which is in front. But what is seen of the thing in both frames disagrees
// along the dominant motion, so it must have moved by another, and must be shown. The 2x2 blocks where both ends of a
// candidate are such blocks are its foreground; it gains where its own match holds over the foreground around.
inline void find_foreground(float scale, float prior, Int top, Int left, const Motion &motion, float t,
                            const PairContext &context, CandidateWeights &candidate, NodeSums &sums) {
  alignas(64) float match[BLOCKS_2X2], front[BLOCKS_2X2], other[BLOCKS_2X2];
  float *gain = candidate.gain;
  write_decay(candidate.squared, 0, scale * FOREGROUND_SCALE, 1, match);
  for (int i = 0; i < BLOCKS_2X2; i++) gain[i] = 1;
  const float matched = prior * sum_of(match);
  if (matched > sums.matched) {
    sums.matched = matched;
    sums.dominant = motion;
    for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++)
      store(sums.mismatch[j] + BLOCKS_2X2_PER_ROW, 1 - load<F16>(match + j * BLOCKS_2X2_PER_ROW));
    return;
  }
  const float dx = motion.dx - sums.dominant.dx, dy = motion.dy - sums.dominant.dy, curve = t * (1 - t) * 0.5f;
  const float distance = motion_distance(motion, sums.dominant), motion_difference = min(distance - 1, 1.f);
  if (motion_difference <= 0) return;
  const float bent_x = curve * (motion.acceleration_x - sums.dominant.acceleration_x);
  const float bent_y = curve * (motion.acceleration_y - sums.dominant.acceleration_y);
  find_mismatch(sums, (bent_y - t * dy) * 0.5f, (bent_x - t * dx) * 0.5f, front);
  find_mismatch(sums, (bent_y + (1 - t) * dy) * 0.5f, (bent_x + (1 - t) * dx) * 0.5f, other);
  const float share = min((distance - NEAR_MOTION) / (FAR_MOTION - NEAR_MOTION), 1.f);
  if (share > 0) raise_mismatch(share, top, left, motion, sums.dominant, t, context, front, other);
  const float *agreement0 = candidate.features.blocks_8x8[AGREEMENT], *agreement1 = agreement0 + BLOCKS_8X8;
  for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++) {
    alignas(64) float agreement[BLOCKS_2X2_PER_ROW];
    for (int i = 0; i < BLOCKS_2X2_PER_ROW; i++) {
      const int block = 2 * j / SIDE_8X8 * BLOCKS_8X8_PER_ROW + 2 * i / SIDE_8X8;
      agreement[i] = min(FOREGROUND_AGREEMENT * min(agreement0[block], agreement1[block]), 1.f);
    }
    const int row = j * BLOCKS_2X2_PER_ROW;
    const F16 least = min(load<F16>(front + row), load<F16>(other + row));
    const F16 in_front = least * motion_difference * load<F16>(agreement);
    store(front + row, in_front);
    store(other + row, in_front * load<F16>(match + row));
  }
  average_patches(other, gain);
  average_patches(front, match);
  for (int i = 0; i < BLOCKS_2X2; i++)  // of hardly any foreground around, the mean is no evidence
    gain[i] = front[i] * gain[i] / (match[i] + 0.02f);
  write_decay(gain, FOREGROUND_SHARPNESS, -FOREGROUND_SHARPNESS, MAX_GAIN, gain);
}

// Parts of a sum of features: the even one is the same for both frames, the odd one has another sign for frame 1.
struct FeatureSums {
  InterpolatedRows even, odd;
};

// Sums those features that differ from one 8x8 block to another, or not at all.
inline void sum_8x8(const float *even, const float *odd, const Features &features, FeatureSums &sums) {
  even += FEATURES_2X2;
  odd += FEATURES_2X2;
  float constant = 0;
  for (int n = 0; n < WINDOW_FEATURES; n++) constant += even[FEATURES_8X8 + n] * features.window[n];
  F16 even_sum = broadcast<F16>(constant), odd_sum{};
  for (int n = 0; n < FEATURES_8X8; n++) {
    const F16 blocks = load<F16>(features.blocks_8x8[n]);
    even_sum = fma(broadcast<F16>(even[n]), blocks, even_sum);
    odd_sum = fma(broadcast<F16>(odd[n]), blocks, odd_sum);
  }
  alignas(64) float values[BLOCKS_8X8];
  store(values, even_sum);
  interpolate_across(values, sums.even);
  store(values, odd_sum);
  interpolate_across(values, sums.odd);
}

struct Logits {  // logarithms of the weights of both frames along a candidate, and of either alone
  alignas(64) float both[BLOCKS_2X2], frame0[BLOCKS_2X2], frame1[BLOCKS_2X2];
};

// Sums the features of every 2x2 block. Features and logarithms of some 2x2 blocks stay in registers over all sums.
inline void sum_features(const Weighting &weighting, const Features &features, Logits &logits) {
  const View<const float, 2> even(weighting.even), odd(weighting.odd), factors(weighting.factors);
  FeatureSums sums_8x8[FEATURE_SUMS];
  for (int n = 0; n < FEATURE_SUMS; n++) sum_8x8(even.ptr(n), odd.ptr(n), features, sums_8x8[n]);
  for (int j = 0; j < BLOCKS_2X2_PER_ROW; j++) {
    const RowPair between = row_pair(j);
    const Wide below = broadcast<Wide>(between.below), above = broadcast<Wide>(between.above);
    for (int i = 0; i < BLOCKS_2X2_PER_ROW; i += lane_count<Wide>) {
      const int first = j * BLOCKS_2X2_PER_ROW + i;
      Wide blocks[FEATURES_2X2], both{}, frame0{}, frame1{};
      for (int k = 0; k < FEATURES_2X2; k++) blocks[k] = load<Wide>(features.blocks_2x2[k] + first);
      const Wide antisymmetric = blocks[ONWARD0] - blocks[ONWARD1];
      for (int n = 0; n < FEATURE_SUMS; n++) {
        const auto row = [&](const InterpolatedRows &rows) INLINE_LAMBDA {
          return fma(load<Wide>(rows.values[between.first + 1] + i), above,
                     load<Wide>(rows.values[between.first] + i) * below);
        };
        Wide even_sum = row(sums_8x8[n].even);
        for (int k = 0; k < FEATURES_2X2; k++) even_sum = fma(blocks[k], broadcast<Wide>(even(n, k)), even_sum);
        const Wide odd_sum = fma(antisymmetric, broadcast<Wide>(odd(n, ONWARD0)), row(sums_8x8[n].odd));
        const Wide floor = broadcast<Wide>(n < 2 ? -1e9f : 0);  // the sums from the third on are hinges
        const Wide of_frame0 = max(even_sum + odd_sum, floor), of_frame1 = max(even_sum - odd_sum, floor);
        const Wide alone = broadcast<Wide>(factors(n, 1));
        both = fma(broadcast<Wide>(factors(n, 0)), of_frame0 + of_frame1, both);
        frame0 = fma(alone, of_frame0, frame0);
        frame1 = fma(alone, of_frame1, frame1);
      }
      store(logits.both + first, both);
      store(logits.frame0 + first, frame0);
      store(logits.frame1 + first, frame1);
    }
  }
}

// Computes the learnt weights of a candidate from its features.
inline void find_learnt_weights(float prior, Int top, Int left, const Motion &motion, float t,
                                const Weighting &weighting, const PairContext &context, CandidateWeights &candidate,
                                NodeSums &sums) {
  Logits logits;
  find_foreground(weighting.scale, prior, top, left, motion, t, context, candidate, sums);
  sum_features(weighting, candidate.features, logits);
  // What one frame alone shows at half the time is mostly still, or already, hidden near the other one.
  const float near0 = (1 - t) * (1 - t) * (1 - t), near1 = t * t * t;
  const float share1 = 2 * near1 / (near0 + near1), share0 = 2 - share1, sharpness = weighting.sharpness;
  for (int i = 0; i < BLOCKS_2X2; i += 16) {
    const F16 both = decay(load<F16>(logits.both + i), MAX_LOGIT, -1, prior) * load<F16>(candidate.gain + i);
    const F16 frame0 = decay(load<F16>(logits.frame0 + i), MAX_LOGIT, -1, share0 * prior);
    const F16 frame1 = decay(load<F16>(logits.frame1 + i), MAX_LOGIT, -1, share1 * prior);
    store(candidate.antisymmetric + i, (1 - t) * frame1 - t * frame0);
    store(candidate.weight + i, both + frame0 + frame1);
    const F16 plain = decay(load<F16>(candidate.features.blocks_2x2[SIMILARITY] + i), sharpness, -sharpness, prior);
    store(sums.reached + i, load<F16>(sums.reached + i) + plain);
  }
  count_similarity(candidate.weight, candidate.features.blocks_2x2[SIMILARITY], sums);
  sums.min_weight = smallest(sums.reached);
}

// Weighs the candidates of a node one after the other, and calls `take` after each with its motion and
// weights; returns the sums of all.
//
// The rest is skipped once it has few votes beside what others have reached, or once all pixels are similar enough. But
// the ground matches all over a window that a fast thing crosses between the two frames, so learnt weights do not skip
// what moves far from the dominant motion.
template <typename Take>
FORCE_INLINE NodeSums weigh_candidates(Int row, Int column, const Candidates &candidates, float t,
                                       const Weighting &weighting, const PairContext *context, LayerSamples &full,
                                       LayerSamples *further, Take take) {
  CandidateWeights candidate;
  NodeSums sums;
  const Int before = (WINDOW - candidates.spacing) / 2;
  const Int top = row * candidates.spacing - before, left = column * candidates.spacing - before;
  const Int height = full.planes[0].shape[1], width = full.planes[0].shape[2];
  const NodeCandidates node(candidates, row, column);
  bool is_enough = false;
  if (context) extract_landings(top, left, *context, candidate.features);
  for (Int k = 0; k < node.count; k++) {
    const float prior = node.priors[k];
    if (prior <= 0) continue;
    is_enough = is_enough || prior < weighting.min_vote_share * sums.min_weight ||
                sums.min_similarity >= weighting.sufficient_similarity;
    const Motion motion = node.motions[k];
    if (is_enough && !(context && motion_distance(motion, sums.dominant) > FAR_MOTION)) continue;
    InsideMarks marks;
    const WindowPlace place = locate_window(top, left, motion, t, height, width, marks);
    sample_layer(full, place, marks, motion, t);
    pool_pixels(full.distance, candidate.squared);
    if (further) {
      const WindowPlace further_place = locate_further(place, further->down, further->across);
      sample_layer(*further, further_place, marks, scale_motion(motion, further->down, further->across), t);
      if (further->across > 1) pool_chroma(further->distance, further->down, candidate.squared);
    }
    if (context) {
      const float support = View<const float, 3>(context->support)(row, column, k);
      extract_candidate_features(candidate.squared, weighting.scale, top, left, motion, prior, support, t, *context,
                                 candidate.features);
      find_learnt_weights(prior, top, left, motion, t, weighting, *context, candidate, sums);
    } else {
      find_plain_weights(prior, weighting, candidate, sums);
    }
    take(motion, candidate);
  }
  return sums;
}

}  // namespace
