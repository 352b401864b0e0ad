// Residual search at full size for things smaller than a patch: what neither frame explains is cut into connected
// regions, and regions of both frames are matched as a whole, pixel by pixel, without the ground around them.
#include "plane_pair.h"
#include "scratch.h"
#include "similarity.h"

namespace {

constexpr Int MIN_AREA = 4, MAX_AREA = 1024;  // of a region that may be a thing, pixels
constexpr float MIN_SIMILARITY = 0.5f;        // of two regions that may be the same thing
constexpr float MIN_LEAD = 0.3f;              // of this similarity before that of any other region
constexpr float MIN_LEAD_NEARBY = 0.1f;       // before that of any place near by
constexpr Int NEARBY = 16;                    // pixels along x and y
constexpr Int TOLERANCE = 2;                  // up to which two offsets agree, pixels

// How a pixel differs from the other frame: 0 if it is explained, else one of the four values of `difference_kind`.
typedef uint8_t Kind4;
constexpr Kind4 LISTED = 8;  // flag of pixels whose region has been found

constexpr U16 PLACES = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

struct Offset {  // whole pixels
  Int dy, dx;
};

// Connected pixels of a frame that its motion does not explain, and that all differ in the same way.
struct Region {
  Kind4 kind;
  Int first, count;  // of its pixels in the list of all
  Int top, left, bottom, right;
  Int y, x, levels[3];  // sums over its pixels
  // The most similar region of the other frame, the offset to it, and the similarity of the next one.
  Int match;
  Offset offset;
  float similarity, next_similarity;
};

// What is known of one of the two frames.
struct Residual {
  Frames<uint8_t> frames;  // this one is the first
  View<float, 3> flow;
  View<float, 2> similarity;
  Int step;
  Kind4 *kinds;
  int32_t *pixels;  // of all regions
  Region *regions;
  Int count, capacity;

  Residual(const Frames<uint8_t> &frames, const View<float, 3> &flow, const View<float, 2> &similarity, Int step,
           Workspace &workspace)
      : frames(frames), flow(flow), similarity(similarity), step(step),
        kinds(workspace.take<Kind4>(frames.height * frames.width + 16)),
        pixels(workspace.take<int32_t>(frames.height * frames.width)), count(0),
        capacity(flow.shape[0] * flow.shape[1]) {
    regions = workspace.take<Region>(capacity);
  }

  Offset offset_at(Int y, Int x) const {
    const float *vector = flow.ptr(y / step, x / step);
    return {Int(__builtin_rintf(vector[1])), Int(__builtin_rintf(vector[0]))};
  }
};

FORCE_INLINE Int magnitude(Int value) { return value < 0 ? -value : value; }

FORCE_INLINE Int largest_component(Int dy, Int dx) { return max(magnitude(dy), magnitude(dx)); }

FORCE_INLINE Int rounded_mean(Int sum, Int count) { return (2 * sum + count) / (2 * count); }

// Sum of absolute differences of two pixels.
FORCE_INLINE Int difference(const uint8_t *first, const uint8_t *second, Int plane) {
  Int sum = 0;
  for (int c = 0; c < 3; c++) sum += magnitude(Int(first[c * plane]) - Int(second[c * plane]));
  return sum;
}

// How a pixel differs from all nine around a place of the other frame: a difference of sharp edges by a fraction of a
// pixel does not count. Where a thing is, it has another sign than where it will be.
inline Kind4 difference_kind(const Frames<uint8_t> &frames, const uint8_t *first, const uint8_t *second) {
  for (Int j = -1; j <= 1; j++)
    for (Int k = -1; k <= 1; k++)
      if (difference(first, second + j * frames.stride + k, frames.plane) < frames.max_similarity) return 0;
  const Int plane = frames.plane;
  const Int luma = Int(first[0]) - Int(second[0]) + Int(first[plane]) - Int(second[plane]);
  const Int chroma = Int(first[2 * plane]) - Int(second[2 * plane]);
  if (magnitude(luma) >= magnitude(chroma)) return luma > 0 ? 1 : 2;
  return chroma > 0 ? 3 : 4;
}

// Part of a frame that moves by one offset: up to 16 columns, and rows.
struct Block {
  Int top, left, bottom, right;
};

// Marks the unexplained pixels of some rows of a block. Returns whether there may be any.
FORCE_INLINE bool mark_rows(const Residual &all, const Block &block, const Offset &offset, Int first, Int step) {
  const Frames<uint8_t> &frames = all.frames;
  const B16 max_similarity = broadcast_byte(uint8_t(frames.max_similarity));
  const U16 counted = as<U16>(uint16_t(block.right - block.left) > PLACES);
  U16 found = {};
  for (Int y = first; y < block.bottom; y += step) {
    const uint8_t *pixel = frames.first + frames.place(y, block.left);
    const uint8_t *other = frames.second + frames.place(y + offset.dy, block.left + offset.dx);
    const B16 pixels[3] = {load<B16>(pixel), load<B16>(pixel + frames.plane), load<B16>(pixel + 2 * frames.plane)};
    const U16 similar = linear_similarity(pixels, other, frames.plane, max_similarity);
    const U16 unexplained = as<U16>(similar == 0) & counted;
    found |= unexplained;
    if (step > 1 || !any(unexplained)) continue;
    for (Int x = block.left; x < block.right; x++, pixel++, other++)
      if (unexplained[x - block.left]) all.kinds[y * frames.width + x] = difference_kind(frames, pixel, other);
  }
  return any(found);
}

// Marks the pixels that the motion of their point does not explain. A block where there is none in its first and in any
// second row has nothing that could be seen.
FORCE_INLINE void mark_unexplained(const Residual &all) {
  const Frames<uint8_t> &frames = all.frames;
  const Int step = all.step, points = all.flow.shape[1];
  __builtin_memset(all.kinds, 0, frames.height * frames.width + 16);
  for (Int top = 0; top < frames.height; top += step)
    for (Int point = 0; point < points;) {
      const Int left = point * step;
      const Offset offset = all.offset_at(top, left);
      // neighbours that move alike are compared together, as far as they fit
      for (point++; point < points && (point + 1) * step <= left + 16; point++) {
        const Offset next = all.offset_at(top, point * step);
        if (next.dy != offset.dy || next.dx != offset.dx) break;
      }
      const Int right = min(min(point * step, frames.width), frames.width - offset.dx);
      Block block = {max(top, -offset.dy), max(left, -offset.dx),
                     min(min(top + step, frames.height), frames.height - offset.dy), 0};
      for (; block.left < right; block.left += 16) {
        block.right = min(block.left + 16, right);
        const bool is_found =
            mark_rows(all, block, offset, block.top, step) || mark_rows(all, block, offset, block.top | 1, 2);
        if (is_found) mark_rows(all, block, offset, block.top, 1);
      }
    }
}

// Sums of the components of pixels of this frame, and of their places in the other one.
struct Colours {
  Int count, own[3], other[3];
};

// How far the means of two sets of pixels are apart.
FORCE_INLINE float contrast(const Int (&sums0)[3], Int count0, const Int (&sums1)[3], Int count1) {
  float sum = 0;
  for (int c = 0; c < 3; c++) sum += absolute(float(sums0[c]) / float(count0) - float(sums1[c]) / float(count1));
  return sum;
}

// Whether a region stands out from its surroundings more than its place in the other frame does: that is the thing
// itself, while the ground where it will be is unexplained, too.
inline bool stands_out(const Residual &all, const Region &region) {
  const Frames<uint8_t> &frames = all.frames;
  Colours inside = {}, around = {};
  for (Int y = max(region.top - 2, Int(0)); y < min(region.bottom + 3, frames.height); y++)
    for (Int x = max(region.left - 2, Int(0)); x < min(region.right + 3, frames.width); x++) {
      const Kind4 kind = all.kinds[y * frames.width + x];
      if (kind && kind != (region.kind | LISTED)) continue;
      Colours &colours = kind ? inside : around;
      const Offset offset = all.offset_at(y, x);
      const Int end_y = clamp(y + offset.dy, Int(0), frames.height - 1);
      const Int end_x = clamp(x + offset.dx, Int(0), frames.width - 1);
      const uint8_t *first = frames.first + frames.place(y, x), *second = frames.second + frames.place(end_y, end_x);
      colours.count++;
      for (int c = 0; c < 3; c++) {
        colours.own[c] += first[c * frames.plane];
        colours.other[c] += second[c * frames.plane];
      }
    }
  if (!around.count) return false;
  return contrast(inside.own, inside.count, around.own, around.count) >
         contrast(inside.other, inside.count, around.other, around.count);
}

// Lists the pixels of the region around one; they are flagged.
inline Region find_region(const Residual &all, Int start, Int first) {
  const Frames<uint8_t> &frames = all.frames;
  int32_t *pixels = all.pixels + first;
  Region region = {};
  region.kind = all.kinds[start];
  region.first = first;
  region.top = region.left = max(frames.height, frames.width);
  pixels[region.count++] = int32_t(start);
  all.kinds[start] |= LISTED;
  for (Int n = 0; n < region.count; n++) {
    const Int y = pixels[n] / frames.width, x = pixels[n] % frames.width;
    region.top = min(region.top, y);
    region.left = min(region.left, x);
    region.bottom = max(region.bottom, y);
    region.right = max(region.right, x);
    region.y += y;
    region.x += x;
    for (int c = 0; c < 3; c++) region.levels[c] += frames.first[frames.place(y, x) + c * frames.plane];
    for (Int v = max(y - 1, Int(0)); v < min(y + 2, frames.height); v++)
      for (Int u = max(x - 1, Int(0)); u < min(x + 2, frames.width); u++) {
        const Int next = v * frames.width + u;
        if (all.kinds[next] != region.kind) continue;
        all.kinds[next] |= LISTED;
        pixels[region.count++] = int32_t(next);
      }
  }
  return region;
}

// Lists the regions that may be things.
FORCE_INLINE void list_regions(Residual &all) {
  const Int size = all.frames.height * all.frames.width;
  Int first = 0;
  mark_unexplained(all);
  for (Int begin = 0; begin < size; begin += 16) {
    if (!any(__builtin_convertvector(load<B16>(all.kinds + begin), U16))) continue;
    for (Int start = begin; start < min(begin + 16, size) && all.count < all.capacity; start++) {
      if (all.kinds[start] == 0 || all.kinds[start] & LISTED) continue;
      const Region region = find_region(all, start, first);
      if (region.count < MIN_AREA || region.count > MAX_AREA || !stands_out(all, region)) continue;
      all.regions[all.count++] = region;
      first += region.count;
    }
  }
}

// Mean similarity of the pixels of a region and those at an offset in the other frame, 0 to 1.
inline float compare_region(const Residual &all, const Region &region, const Offset &offset) {
  const Frames<uint8_t> &frames = all.frames;
  Int total = 0;
  for (Int n = region.first; n < region.first + region.count; n++) {
    const Int y = all.pixels[n] / frames.width, x = all.pixels[n] % frames.width;
    const Int end_y = y + offset.dy, end_x = x + offset.dx;
    if (end_y < 0 || end_x < 0 || end_y >= frames.height || end_x >= frames.width) continue;
    const uint8_t *first = frames.first + frames.place(y, x), *second = frames.second + frames.place(end_y, end_x);
    total += max(frames.max_similarity - difference(first, second, frames.plane), Int(0));
  }
  return float(total) / float(region.count * frames.max_similarity);
}

FORCE_INLINE void note_match(Region &region, Int match, const Offset &offset, float similarity) {
  if (similarity <= region.similarity) {
    region.next_similarity = max(region.next_similarity, similarity);
    return;
  }
  region.next_similarity = region.similarity;
  region.similarity = similarity;
  region.match = match;
  region.offset = offset;
}

// Compares each region with those of the other frame that are of its kind, about its size and of a similar colour.
FORCE_INLINE void match_regions(const Residual &all0, const Residual &all1, Int max_offset) {
  for (Int i = 0; i < all0.count; i++)
    for (Int j = 0; j < all1.count; j++) {
      Region &region0 = all0.regions[i], &region1 = all1.regions[j];
      if (region0.kind != region1.kind) continue;
      if (region0.count > 2 * region1.count || region1.count > 2 * region0.count) continue;
      const Int dy = rounded_mean(region1.y, region1.count) - rounded_mean(region0.y, region0.count);
      const Int dx = rounded_mean(region1.x, region1.count) - rounded_mean(region0.x, region0.count);
      if (largest_component(dy, dx) > max_offset) continue;
      const float apart = contrast(region0.levels, region0.count, region1.levels, region1.count);
      if (apart > 0.5f * float(all0.frames.max_similarity)) continue;
      Offset best = {};
      float similarity = 0;
      for (Int down = dy - 1; down <= dy + 1; down++)
        for (Int across = dx - 1; across <= dx + 1; across++) {
          const float similarity0 = compare_region(all0, region0, {down, across});
          const float mean = (similarity0 + compare_region(all1, region1, {-down, -across})) * 0.5f;
          if (mean <= similarity) continue;
          similarity = mean;
          best = {down, across};
        }
      note_match(region0, j, best, similarity);
      note_match(region1, i, {-best.dy, -best.dx}, similarity);
    }
}

// Whether no other region, and no other place near by, is about as similar to a region as its match. Parts of a longer
// thing look like other parts of it.
inline bool is_unique(const Residual &all, const Region &region) {
  if (region.similarity < region.next_similarity + MIN_LEAD) return false;
  const Int size = max(region.bottom - region.top, region.right - region.left) + 2;
  const Offset ground = all.offset_at(rounded_mean(region.y, region.count), rounded_mean(region.x, region.count));
  for (Int dy = ground.dy - NEARBY; dy <= ground.dy + NEARBY; dy++)
    for (Int dx = ground.dx - NEARBY; dx <= ground.dx + NEARBY; dx++) {
      if (largest_component(dy - region.offset.dy, dx - region.offset.dx) <= size) continue;
      if (compare_region(all, region, {dy, dx}) >= region.similarity - MIN_LEAD_NEARBY) return false;
    }
  return true;
}

// The fraction of an offset, by the similarities one pixel before it, there, and one pixel behind it.
FORCE_INLINE float fraction(float before, float here, float behind) {
  const float fall = here - min(before, behind);
  return fall > 0 ? clamp((behind - before) / (2 * fall), -0.5f, 0.5f) : 0;
}

FORCE_INLINE Vector find_motion(const Residual &all, const Region &region) {
  const auto compare = [&](Int down, Int across) INLINE_LAMBDA {
    return compare_region(all, region, {region.offset.dy + down, region.offset.dx + across});
  };
  const float here = compare(0, 0);
  return {float(region.offset.dx) + fraction(compare(0, -1), here, compare(0, 1)),
          float(region.offset.dy) + fraction(compare(-1, 0), here, compare(1, 0))};
}

// Gives the motion of a region to the points whose pixels it has; if it is small, to the four around it, too, which are
// enough for it to be a candidate at time t. The region may be one of the other frame, moved by an offset to this one.
inline void set_motion(const Residual &all, const Residual &listed, const Region &region, const Offset &moved,
                       const Vector &motion) {
  const Int step = all.step, rows = all.flow.shape[0], points = all.flow.shape[1];
  const auto set = [&](Int row, Int point) {
    if (row < 0 || point < 0 || row >= rows || point >= points) return;
    float *vector = all.flow.ptr(row, point);
    vector[0] = motion.dx;
    vector[1] = motion.dy;
    all.similarity(row, point) = region.similarity;
  };
  for (Int n = region.first; n < region.first + region.count; n++) {
    const Int y = listed.pixels[n] / all.frames.width + moved.dy, x = listed.pixels[n] % all.frames.width + moved.dx;
    if (y >= 0 && x >= 0) set(y / step, x / step);
  }
  if (max(region.bottom - region.top, region.right - region.left) >= 2 * step) return;
  const Int first_y = rounded_mean(region.y, region.count) + moved.dy + step - step / 2;
  const Int first_x = rounded_mean(region.x, region.count) + moved.dx + step - step / 2;
  for (Int row = first_y / step - 1; row < first_y / step + 1; row++)
    for (Int point = first_x / step - 1; point < first_x / step + 1; point++) set(row, point);
}

// Matches regions by the motion of points of the other frame that end there and that this frame does not confirm.
FORCE_INLINE void match_points(const Residual &here, const Residual &there) {
  const Int step = here.step, reach = step / 2;
  for (Int row = 0; row < there.flow.shape[0]; row++)
    for (Int point = 0; point < there.flow.shape[1]; point++) {
      const Offset back = there.offset_at(row * step, point * step);
      const Int y = row * step + reach + back.dy, x = point * step + reach + back.dx;
      if (y < 0 || x < 0 || y >= here.frames.height || x >= here.frames.width) continue;
      const Offset offset = here.offset_at(y, x);
      if (largest_component(offset.dy + back.dy, offset.dx + back.dx) <= TOLERANCE) continue;
      for (Int i = 0; i < here.count; i++) {
        Region &region = here.regions[i];
        if (y < region.top - reach || y > region.bottom + reach || x < region.left - reach || x > region.right + reach)
          continue;
        const Offset onward = {-back.dy, -back.dx};
        const float similarity = compare_region(here, region, onward);
        const bool is_same = largest_component(onward.dy - region.offset.dy, onward.dx - region.offset.dx) <= TOLERANCE;
        if (!is_same || region.similarity == 0) {
          note_match(region, -1, onward, similarity);
        } else if (region.match < 0 && similarity > region.similarity) {
          region.offset = onward;
          region.similarity = similarity;
        }
      }
    }
}

FORCE_INLINE void set_unmatched(const Residual &here, const Residual &there) {
  for (Int i = 0; i < here.count; i++) {
    const Region &region = here.regions[i];
    if (region.similarity < MIN_SIMILARITY || region.match >= 0 || !is_unique(here, region)) continue;
    const Vector motion = find_motion(here, region);
    set_motion(here, here, region, {}, motion);
    set_motion(there, here, region, region.offset, {-motion.dx, -motion.dy});
  }
}

}  // namespace

KERNEL(Int, match_residual_regions, const MatchResidualRegions &args) {
  const View<float, 4> flow(args.flow);
  const View<float, 3> similarity(args.similarity);
  const Frames<uint8_t> forward(args.pair);
  Workspace workspace(args.scratch);
  Residual all0(forward, flow[0], similarity[0], args.step, workspace);
  Residual all1(forward.opposite(), flow[1], similarity[1], args.step, workspace);
  if (workspace.is_counting()) return workspace.size();
  list_regions(all0);
  list_regions(all1);
  match_regions(all0, all1, args.max_offset);
  match_points(all0, all1);
  match_points(all1, all0);
  for (Int i = 0; i < all0.count; i++) {
    const Region &region0 = all0.regions[i];
    if (region0.similarity < MIN_SIMILARITY || region0.match < 0) continue;
    const Region &region1 = all1.regions[region0.match];
    if (region1.match != i || !is_unique(all0, region0) || !is_unique(all1, region1)) continue;
    const Vector motion = find_motion(all0, region0);
    set_motion(all0, all0, region0, {}, motion);
    set_motion(all1, all1, region1, {}, {-motion.dx, -motion.dy});
  }
  set_unmatched(all0, all1);
  set_unmatched(all1, all0);
  return 0;
}
