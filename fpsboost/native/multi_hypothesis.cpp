// In-between frame along the candidate motions: their weighted mean, or the motion with the largest weight.
//
// Each window is the mean of its samples along the candidates of its node, by the weights of the pixels. Windows are
// overlapped and added (overlapped block motion compensation, Orchard and Sullivan 1994, doi:10.1109/83.334974).
#include "pixel_weights.h"

namespace {

// Adds the samples of a candidate, times their weights, to the sums of the node.
void add_samples(LayerSamples &layer, bool is_antisymmetric, const CandidateWeights &candidate) {
  alignas(64) float weight[WINDOW * WINDOW], antisymmetric[WINDOW * WINDOW];
  upsample_2x2(candidate.weight, layer.across, layer.down, weight);
  if (is_antisymmetric) upsample_2x2(candidate.antisymmetric, layer.across, layer.down, antisymmetric);
  for (Int c = 0; c < layer.channels; c++) {
    float *total = layer.total + c * layer.size;
    const float *mixed = layer.mixed + c * layer.size, *change = layer.change + c * layer.size;
    for (Int i = 0; i < layer.size; i += 16) {
      const F16 sum = fma(load<F16>(weight + i), load<F16>(mixed + i), load<F16>(total + i));
      store(total + i, is_antisymmetric ? fma(load<F16>(antisymmetric + i), load<F16>(change + i), sum) : sum);
    }
  }
}

struct WindowPart {  // rows and columns of the samples of a window that lie within the frame
  Int first_row, last_row, first_column, last_column;
  Int left;  // column of the frame at which the window begins
};

// Adds a weighted window to a plane of the band of its layer.
FORCE_INLINE void overlap_add(const LayerSamples &layer, const WindowPart &part, const float *weight,
                              const float *values, const View<float, 2> &band) {
  for (Int j = part.first_row; j < part.last_row; j++) {
    const float *weights = weight + j * layer.wide, *row = values + j * layer.wide;
    float *sums = band.ptr(j);
    if (part.last_column - part.first_column < layer.wide)
      for (Int i = part.first_column; i < part.last_column; i++) sums[part.left + i] += weights[i] * row[i];
    else
      for (Int i = 0; i < layer.wide; i += 16) add_row(weights + i, row + i, sums + part.left + i);
  }
}

// Adds the mean of a node's window to the band of a layer, and the sums of its weights and similarities.
void add_node(const LayerSamples &layer, Int top, Int left, Int height, Int width, const float *weight,
              const NodeSums &sums) {
  alignas(64) float weights[WINDOW * WINDOW], values[WINDOW * WINDOW];
  const Int down = layer.down, across = layer.across;
  const WindowPart part = {max(-top, Int(0)) / down, (min(height - top, Int(WINDOW)) + down - 1) / down,
                           max(-left, Int(0)) / across, (min(width - left, Int(WINDOW)) + across - 1) / across,
                           divide_down(left, across)};
  upsample_2x2(weight, across, down, weights);
  for (Int c = 0; c < layer.channels; c++)
    overlap_add(layer, part, weights, layer.total + c * layer.size, layer.band[c]);
  for (Int c = layer.channels; c < layer.band.shape[0]; c++) {
    upsample_2x2(c == layer.channels ? sums.weights : sums.similarities, across, down, values);
    overlap_add(layer, part, weights, values, layer.band[c]);
  }
}

// Writes rows of the means of a band to an image; the band begins at row `top` of it. Pixels are computed in pieces, as
// those of an image may be interleaved, which vectors are not.
template <typename T>
void write_rows(const LayerSamples &layer, Int first, Int last, Int top, const ValueRange &range,
                const ArrayOf<Any, 3> &image) {
  constexpr Int PIECE = 128;
  const Int channels = layer.channels, width = image.shape[2], step = image.steps[2];
  const float white = range.white, offset = range.rounding_offset;
  const float lowest = range.lowest, highest = range.highest;
  for (Int j = first; j < last; j++)
    for (Int c = 0; c < channels; c++) {
      const bool is_straight = range.straight_alpha && c < channels - 1;
      T *to = as<T *>(image.data) + c * image.steps[0] + (top + j) * image.steps[1];
      for (Int left = 0; left < width; left += PIECE) {
        const float *sums = layer.band.ptr(c, j, left), *weights = layer.band.ptr(channels, j, left);
        const float *alphas = layer.band.ptr(channels - 1, j, left);
        const Int count = min(PIECE, width - left);
        T codes[PIECE];
        for (Int x = 0; x < count; x++) {
          float value = sums[x] / weights[x];
          if (is_straight) value /= max(alphas[x] / weights[x], 1e-6f);
          codes[x] = T(clamp(value * white + offset, lowest, highest));
        }
        if (step == 1)
          __builtin_memcpy(to + left, codes, count * sizeof(T));
        else
          for (Int x = 0; x < count; x++) to[(left + x) * step] = codes[x];
      }
    }
}

// Writes rows of pixels of a layer that no further window contributes to, and shifts its band up by `rows`.
void finish_layer(const LayerSamples &layer, Int first, Int last, Int top, Int rows, const ValueRange &range,
                  const ArrayOf<Any, 3> &image) {
  const Int down = layer.down, size = layer.band.shape[1] * layer.band.shape[2];
  with_pixel_type(image.kind, [&](auto pixel) {
    write_rows<decltype(pixel)>(layer, first / down, (last + down - 1) / down, divide_down(top, down), range, image);
  });
  const Int shift = rows / down * layer.band.shape[2];
  for (Int c = 0; c < layer.band.shape[0]; c++) {
    float *plane = layer.band.ptr(c);
    __builtin_memmove(plane, plane + shift, (size - shift) * sizeof(float));
    __builtin_memset(plane + size - shift, 0, shift * sizeof(float));
  }
}

// Writes rows of the confidence: the weighted mean similarity to the eighth power, which corresponds to a bandwidth of
// about a third: a few levels hardly change the weights, but are visible.
void finish_confidence(const LayerSamples &layer, Int first, Int last, Int top, const View<float, 2> &confidence) {
  for (Int j = first; j < last; j++) {
    const float *weights = layer.band.ptr(layer.channels, j), *similarities = layer.band.ptr(layer.channels + 1, j);
    float *to = confidence.ptr(top + j);
    for (Int x = 0; x < confidence.shape[1]; x++) {
      static_assert(CONFIDENCE_POWER == 8, "three squarings");
      float trust = min(similarities[x] / weights[x], 1.f);
      trust *= trust;
      trust *= trust;
      to[x] = trust * trust;
    }
  }
}

// Writes where a window's pixels lie in both frames along a motion, wherever its weight is the largest so far.
void keep_heavier(const float *weight, const Motion &motion, float t, Int top, Int left, const View<float, 2> &weights,
                  const View<float, 3> &places) {
  const Int height = weights.shape[0], width = weights.shape[1];
  const float curve = t * (1 - t) * 0.5f, centre = (WINDOW - 1) * 0.5f, turns = motion.is_rigid() ? 0 : 1;
  const Int begin = max(-left, Int(0)), end = min(width - left, Int(WINDOW));
  for (Int j = max(-top, Int(0)); j < min(height - top, Int(WINDOW)); j++) {
    const Int y = top + j, row_start = y * width + left, plane = height * width;
    const float v = (float(j) - centre) * turns, *__restrict new_weight = weight + j * WINDOW;
    float *__restrict largest = weights.data, *__restrict x0 = places.data, *__restrict y0 = x0 + plane;
    float *__restrict x1 = y0 + plane, *__restrict y1 = x1 + plane;
    for (Int i = begin; i < end; i++) {  // all are written, so that this needs no branch
      const float u = (float(i) - centre) * turns;
      const float dx = motion.dx + u * motion.dx_along_x + v * motion.dx_along_y;
      const float dy = motion.dy + u * motion.dy_along_x + v * motion.dy_along_y;
      const float column = float(left + i) + curve * motion.acceleration_x - t * dx;
      const float row = float(y) + curve * motion.acceleration_y - t * dy;
      const bool heavier = new_weight[i] > largest[row_start + i];
      largest[row_start + i] = heavier ? new_weight[i] : largest[row_start + i];
      x0[row_start + i] = heavier ? column : x0[row_start + i];
      y0[row_start + i] = heavier ? row : y0[row_start + i];
      x1[row_start + i] = heavier ? column + dx : x1[row_start + i];
      y1[row_start + i] = heavier ? row + dy : y1[row_start + i];
    }
  }
}

}  // namespace

KERNEL(Int, blend_hypotheses, const BlendHypotheses &args) {
  Workspace workspace(args.scratch);
  const ArrayOf<Any, 3> &image = args.blended.image, &more = args.blended.further;
  const bool has_confidence = args.blended.confidence.shape[0] * args.blended.confidence.shape[1] > 0;
  LayerSamples full(args.full, image.shape[0] + 1 + has_confidence, image.shape[2], workspace);
  LayerSamples further(args.further, more.shape[0] + 1, more.shape[2], workspace);
  if (workspace.is_counting()) return workspace.size();
  const View<const int32_t, 2> listed(args.candidates.listed);
  const View<float, 2> confidence(args.blended.confidence);
  const float *shape = args.weighting.window_shape.data, t = args.t;
  const Int spacing = args.candidates.spacing, before = (WINDOW - spacing) / 2;
  const Int height = image.shape[1], width = image.shape[2];
  const bool has_further = further.channels > 0;
  const PairContext *context = args.context.points[0].data ? &args.context : nullptr;
  LayerSamples *layers[] = {&full, &further};
  for (Int row = 0; row < listed.shape[0]; row++) {
    const Int top = row * spacing - before;
    for (Int column = 0; column < listed.shape[1]; column++) {
      for (const LayerSamples *layer : layers)
        for (Int i = 0; i < layer->channels * layer->size; i++) layer->total[i] = 0;
      const NodeSums sums =
          weigh_candidates(row, column, args.candidates, t, args.weighting, context, full,
                           has_further ? &further : nullptr, [&](const Motion &, const CandidateWeights &candidate) {
                             add_samples(full, context, candidate);
                             if (has_further) add_samples(further, context, candidate);
                           });
      // more where a window is more similar than others, but with no visible border
      alignas(64) float weight[BLOCKS_2X2];
      for (int i = 0; i < BLOCKS_2X2; i++) weight[i] = shape[i] / __builtin_sqrtf(sums.weights[i]);
      add_node(full, top, column * spacing - before, height, width, weight, sums);
      if (has_further) add_node(further, top, column * spacing - before, height, width, weight, sums);
    }
    // the windows of the next row of nodes overlap the rows below
    const Int first = max(-top, Int(0)), last = row < listed.shape[0] - 1 ? spacing : min(height - top, Int(WINDOW));
    if (has_confidence) finish_confidence(full, first, last, top, confidence);
    finish_layer(full, first, last, top, spacing, args.value_range, image);
    if (has_further) finish_layer(further, first, last, top, spacing, args.value_range, more);
  }
  return 0;
}

// Winner-take-all, for values that must not be averaged, such as object numbers. Candidates are weighed plainly, but
// the weights of a motion that several nodes list are not added up.
KERNEL(Int, find_dominant_motion, const FindDominantMotion &args) {
  Workspace workspace(args.scratch);
  LayerSamples layer(args.layer, 0, 0, workspace);
  if (workspace.is_counting()) return workspace.size();
  const View<const int32_t, 2> listed(args.candidates.listed);
  const View<float, 2> weights(args.weights);
  const View<float, 3> places(args.places);
  const float *shape = args.weighting.window_shape.data, t = args.t;
  const Int spacing = args.candidates.spacing, before = (WINDOW - spacing) / 2;
  for (Int row = 0; row < listed.shape[0]; row++)
    for (Int column = 0; column < listed.shape[1]; column++)
      weigh_candidates(row, column, args.candidates, t, args.weighting, nullptr, layer, nullptr,
                       [&](const Motion &motion, const CandidateWeights &candidate) {
                         alignas(64) float blocks[BLOCKS_2X2], pixels[WINDOW * WINDOW];
                         for (int i = 0; i < BLOCKS_2X2; i++) blocks[i] = candidate.weight[i] * shape[i];
                         upsample_2x2(blocks, 1, 1, pixels);
                         keep_heavier(pixels, motion, t, row * spacing - before, column * spacing - before, weights,
                                      places);
                       });
  return 0;
}

// Writes what is compared of the candidates of a node, from which weights are learnt.
KERNEL(Int, extract_features, const ExtractFeatures &args) {
  Workspace workspace(args.scratch);
  LayerSamples layer(args.layer, 0, 0, workspace);
  if (workspace.is_counting()) return workspace.size();
  const View<float, 3> features(args.features), mixed(args.mixed), change(args.change);
  const View<float, 2> gains(args.gains);
  Int &count = *args.count.data;
  count = 0;
  weigh_candidates(args.row, args.column, args.candidates, args.t, args.weighting, &args.context, layer, nullptr,
                   [&](const Motion &, const CandidateWeights &candidate) {
                     const Features &found = candidate.features;
                     for (int n = 0; n < FEATURES; n++) {
                       float *to = features.ptr(count, n);
                       if (n >= FEATURES_2X2 && n < FEATURES_2X2 + FEATURES_8X8)
                         upsample_8x8(found.blocks_8x8[n - FEATURES_2X2], to);
                       else
                         for (int i = 0; i < BLOCKS_2X2; i++)
                           to[i] = n < FEATURES_2X2 ? found.blocks_2x2[n][i]
                                                    : found.window[n - FEATURES_2X2 - FEATURES_8X8];
                     }
                     for (int i = 0; i < BLOCKS_2X2; i++) gains(count, i) = candidate.gain[i];
                     for (Int i = 0; i < layer.channels * layer.size; i++) {
                       mixed.ptr(count)[i] = layer.mixed[i];
                       change.ptr(count)[i] = layer.change[i];
                     }
                     count++;
                   });
  return 0;
}
