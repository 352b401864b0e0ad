// Static overlays on moving frames: pixels that stay the same where their surroundings move.
#include "scratch.h"

namespace {

constexpr Int PIXELS_AT_ONCE = 32;

template <typename T> struct Pictures {
  View<const T, 2> image0, image1, before, after;

  explicit Pictures(const FourFrames &frames)
      : image0(frames.image0), image1(frames.image1), before(frames.before), after(frames.after) {}
};

// Difference of two code values in their type, of which a vector holds more than of int.
template <typename T> FORCE_INLINE T difference(T one, T other) { return T(max(one, other) - min(one, other)); }

// Motion of the surroundings of a block in whole pixels, and whether it is so short that the block counts as static.
struct BlockMotion {
  bool still;
  Int dx, dy;

  bool operator==(const BlockMotion &other) const { return still == other.still && dx == other.dx && dy == other.dy; }
};

// A motion in whole pixels; what is too large, and no number, leads out of every frame.
FORCE_INLINE Int whole_pixels(float value) { return Int(clamp(__builtin_rintf(value), -0x1p30f, 0x1p30f)); }

FORCE_INLINE BlockMotion motion_of_block(const float *vector, float shortest) {
  const bool still = max(absolute(vector[1]), absolute(vector[0])) < shortest;
  return {still, whole_pixels(vector[0]), whole_pixels(vector[1])};
}

// Writes STATIC for the pixels of row y that change by at most `same` code values, else 0.
template <typename T> void mark_static(const Pictures<T> &pictures, Int y, T same, uint8_t *__restrict row, Int width) {
  const T *image0 = pictures.image0.ptr(y), *image1 = pictures.image1.ptr(y);
  const T *before = pictures.before.ptr(y), *after = pictures.after.ptr(y);
  for (Int x = 0; x < width; x++) {
    const T luma = image0[x];
    const T of_others = max(difference(before[x], luma), difference(after[x], luma));
    row[x] = max(difference(image1[x], luma), of_others) <= same ? uint8_t(STATIC) : 0;
  }
}

// Writes STATIC_CONTRAST in place of STATIC where one of some pixels from y, x on would be different if it had moved
// along: each frame would show other luma on one side or the other, within the frame. Returns whether any would be.
template <typename T>
FORCE_INLINE bool mark_some(const Pictures<T> &pictures, Int y, Int x, Int count, const BlockMotion &motion,
                            T different, uint8_t *__restrict row) {
  uint8_t mark = 0;
  for (Int i = 0; i < count; i++) mark = max(mark, row[x + i]);
  if (!mark) return false;
  const T *__restrict luma = pictures.image0.ptr(y, x);
  T smallest[PIXELS_AT_ONCE];
  for (Int i = 0; i < count; i++) smallest[i] = T(-1);
  for (Int sign = -1; sign <= 1; sign += 2) {
    const Int to_y = y + sign * motion.dy, to_x = x + sign * motion.dx;
    const T *image0 = pictures.image0.ptr(to_y, to_x), *image1 = pictures.image1.ptr(to_y, to_x);
    const T *before = pictures.before.ptr(to_y, to_x), *after = pictures.after.ptr(to_y, to_x);
    T largest = 0;
    for (Int i = 0; i < count; i++) {
      const T of_pair = min(difference(image0[i], luma[i]), difference(image1[i], luma[i]));
      const T of_others = min(difference(before[i], luma[i]), difference(after[i], luma[i]));
      smallest[i] = min(smallest[i], min(of_pair, of_others));
      largest = max(largest, smallest[i]);
    }
    if (largest <= different) return false;
  }
  for (Int i = 0; i < count; i++)
    row[x + i] = smallest[i] > different && row[x + i] == STATIC ? uint8_t(STATIC_CONTRAST) : row[x + i];
  return true;
}

// The same of row y from `left` to `right`. What would come from outside of the frame stays STATIC.
template <typename T>
bool mark_changes(const Pictures<T> &pictures, Int y, Int left, Int right, const BlockMotion &motion, T different,
                  uint8_t *row) {
  const Int height = pictures.image0.shape[0], width = pictures.image0.shape[1];
  const Int down = max(motion.dy, -motion.dy), across = max(motion.dx, -motion.dx);
  if (y < down || y >= height - down) return false;
  const Int last = min(right, width - across);
  bool found = false;
  Int x = max(left, across);
  for (; x + PIXELS_AT_ONCE <= last; x += PIXELS_AT_ONCE)  // a number that is known, because short loops are slow
    found |= mark_some(pictures, y, x, PIXELS_AT_ONCE, motion, different, row);
  return (x < last && mark_some(pictures, y, x, last - x, motion, different, row)) | found;
}

// Whether a pixel is seen in image1 where the motion of its point leads to; no pixel moves with a point that is static.
template <typename T>
bool follows_point(const Pictures<T> &pictures, Int y, Int x, const BlockMotion &motion, T different) {
  const Int to_y = y + motion.dy, to_x = x + motion.dx;
  if (motion.still || to_y < 0 || to_y >= pictures.image1.shape[0] || to_x < 0 || to_x >= pictures.image1.shape[1])
    return false;
  return difference(pictures.image1(to_y, to_x), pictures.image0(y, x)) <= different;
}

struct BlockCounts {  // of pixels that have STATIC_CONTRAST, and of those among them that follow their points
  Int marked, moving;
};

template <typename T>
BlockCounts count_block(const Pictures<T> &pictures, Int top, Int left, Int bottom, Int right, const MarkOverlay &args,
                        const View<uint8_t, 2> &marks) {
  const View<const float, 3> points(args.points);
  BlockCounts counts = {0, 0};
  for (Int y = top; y < bottom; y++)
    for (Int x = left; x < right; x++)
      if (marks(y, x) == STATIC_CONTRAST) {
        const float *vector = points.ptr(y / args.point_spacing, x / args.point_spacing);
        counts.marked++;
        counts.moving += follows_point(pictures, y, x, motion_of_block(vector, args.shortest), T(args.different));
      }
  return counts;
}

// Writes STATIC in place of STATIC_CONTRAST in blocks around which nearly all such pixels follow their own points: what
// moves otherwise than its surroundings, such as one of many slats, may look alike in all frames by chance.
void unmark_moving(const View<BlockCounts, 2> &counts, Int spacing, const View<uint8_t, 2> &marks) {
  const Int rows = counts.shape[0], columns = counts.shape[1];
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++) {
      BlockCounts around = {0, 0};
      for (Int j = max(row - 1, Int(0)); j < min(row + 2, rows); j++)
        for (Int i = max(column - 1, Int(0)); i < min(column + 2, columns); i++) {
          around.marked += counts(j, i).marked;
          around.moving += counts(j, i).moving;
        }
      if (float(around.moving) <= MOVING_SHARE * float(around.marked)) continue;
      const Int bottom = min((row + 1) * spacing, marks.shape[0]), right = min((column + 1) * spacing, marks.shape[1]);
      for (Int y = row * spacing; y < bottom; y++)
        for (Int x = column * spacing; x < right; x++) marks(y, x) = min(marks(y, x), uint8_t(STATIC));
    }
}

template <typename T> Int mark(const MarkOverlay &args) {
  const Pictures<T> pictures(args.frames);
  const View<const float, 3> motion(args.motion);
  const View<uint8_t, 2> marks(args.marks);
  const Int height = marks.shape[0], width = marks.shape[1], spacing = args.spacing, blocks = motion.shape[1];
  const float shortest = args.shortest;
  Workspace workspace(args.scratch);
  View<BlockCounts, 2> counts;
  counts.shape[0] = (height + spacing - 1) / spacing;
  counts.shape[1] = (width + spacing - 1) / spacing;
  counts.data = workspace.take<BlockCounts>(counts.shape[0] * counts.shape[1]);
  if (workspace.is_counting()) return workspace.size();
  for (Int top = 0; top < height; top += spacing) {
    const Int block_row = top / spacing, bottom = min(top + spacing, height);
    bool found = false;
    for (Int y = top; y < bottom; y++) mark_static(pictures, y, T(args.same), marks.ptr(y), width);
    for (Int end = 0; end < blocks;) {
      // neighbouring blocks that move alike are one
      const BlockMotion shared = motion_of_block(motion.ptr(block_row, end), shortest);
      const Int left = end * spacing;
      while (end < blocks && motion_of_block(motion.ptr(block_row, end), shortest) == shared) end++;
      const Int right = min(end * spacing, width);
      for (Int y = top; y < bottom; y++) {
        uint8_t *row = marks.ptr(y);
        if (shared.still) {
          for (Int x = left; x < right; x++) row[x] = 0;
          continue;
        }
        found |= mark_changes(pictures, y, left, right, shared, T(args.different), row);
      }
    }
    for (Int left = 0; left < width; left += spacing)
      counts(block_row, left / spacing) =
          found ? count_block(pictures, top, left, bottom, min(left + spacing, width), args, marks) : BlockCounts{};
  }
  unmark_moving(counts, spacing, marks);
  return 0;
}

}  // namespace

KERNEL(Int, mark_overlay, const MarkOverlay &args) {
  return args.frames.image0.kind == UINT8 ? mark<uint8_t>(args) : mark<uint16_t>(args);
}
