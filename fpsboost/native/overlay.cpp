// Static overlays on moving frames: pixels that stay the same where their surroundings move.
#include "scratch.h"

namespace {

template <typename T> struct Pictures {
  View<const T, 2> image0, image1, before, after;

  explicit Pictures(const FourFrames &frames)
      : image0(frames.image0), image1(frames.image1), before(frames.before), after(frames.after) {}
};

// Difference of two code values in their type, of which a vector holds more than of int.
template <typename T> INLINE T difference(T one, T other) { return T(most(one, other) - least(one, other)); }

// Motion of the surroundings of a block in whole pixels, and whether it is so short that the block counts as static.
struct BlockMotion {
  bool still;
  Int dx, dy;

  bool operator==(const BlockMotion &other) const { return still == other.still && dx == other.dx && dy == other.dy; }
};

// A motion in whole pixels; what is too large, and no number, leads out of every frame.
INLINE Int whole_pixels(float value) { return Int(within(__builtin_rintf(value), -0x1p30f, 0x1p30f)); }

INLINE BlockMotion motion_of_block(const float *vector, float shortest) {
  const bool still = most(absolute(vector[1]), absolute(vector[0])) < shortest;
  return {still, whole_pixels(vector[0]), whole_pixels(vector[1])};
}

// Writes how much pixels of row y, from `left` to `right`, would change at least if they had moved along.
//
// One of the frames would show the pixel's luma on one side or the other. It is 0 where that is outside.
template <typename T>
void find_smallest_change(const Pictures<T> &pictures, Int y, Int left, Int right, const BlockMotion &motion,
                          T *__restrict smallest) {
  const Int height = pictures.image0.shape[0], width = pictures.image0.shape[1];
  for (Int x = left; x < right; x++) smallest[x] = T(-1);
  for (Int sign = -1; sign <= 1; sign += 2) {
    const Int there = y + sign * motion.dy, moved = sign * motion.dx;
    const Int first = least(most(-moved, left), right), last = most(least(width - moved, right), left);
    if (there < 0 || there >= height || first >= last) {
      for (Int x = left; x < right; x++) smallest[x] = 0;
      return;
    }
    for (Int x = left; x < first; x++) smallest[x] = 0;
    for (Int x = last; x < right; x++) smallest[x] = 0;
    const T *here = pictures.image0.at(y), *image0 = pictures.image0.at(there), *image1 = pictures.image1.at(there);
    const T *before = pictures.before.at(there), *after = pictures.after.at(there);
    for (Int x = first; x < last; x++) {
      const T luma = here[x];
      const T of_pair = least(difference(image0[x + moved], luma), difference(image1[x + moved], luma));
      const T of_others = least(difference(before[x + moved], luma), difference(after[x + moved], luma));
      smallest[x] = least(smallest[x], least(of_pair, of_others));
    }
  }
}

// Writes STATIC for the pixels of row y that change by at most `same` code values, else 0.
template <typename T> void mark_static(const Pictures<T> &pictures, Int y, T same, uint8_t *__restrict row, Int width) {
  const T *image0 = pictures.image0.at(y), *image1 = pictures.image1.at(y);
  const T *before = pictures.before.at(y), *after = pictures.after.at(y);
  for (Int x = 0; x < width; x++) {
    const T luma = image0[x];
    const T of_others = most(difference(before[x], luma), difference(after[x], luma));
    row[x] = most(difference(image1[x], luma), of_others) <= same ? uint8_t(STATIC) : 0;
  }
}

// Writes STATIC_CONTRAST in place of STATIC where a pixel would be different if it had moved.
template <typename T>
void mark_changes(const T *smallest, T different, Int left, Int right, uint8_t *__restrict row) {
  for (Int x = left; x < right; x++)
    row[x] = smallest[x] > different && row[x] == STATIC ? uint8_t(STATIC_CONTRAST) : row[x];
}

template <typename T> Int mark(const MarkOverlay &a) {
  const Pictures<T> pictures(a.frames);
  const View<const float, 3> motion(a.motion);
  const View<uint8_t, 2> marks(a.marks);
  const Int height = marks.shape[0], width = marks.shape[1], spacing = a.spacing, blocks = motion.shape[1];
  const float shortest = float(a.shortest);
  Workspace workspace(a.scratch);
  T *smallest = workspace.take<T>(width);
  if (workspace.is_counting()) return workspace.size();
  for (Int top = 0; top < height; top += spacing) {
    const Int block_row = top / spacing, bottom = least(top + spacing, height);
    for (Int y = top; y < bottom; y++) mark_static(pictures, y, T(a.same), marks.at(y), width);
    for (Int end = 0; end < blocks;) {
      // neighbouring blocks that move alike are one, because short loops are slow
      const BlockMotion shared = motion_of_block(motion.at(block_row, end), shortest);
      const Int left = end * spacing;
      while (end < blocks && motion_of_block(motion.at(block_row, end), shortest) == shared) end++;
      const Int right = least(end * spacing, width);
      for (Int y = top; y < bottom; y++) {
        uint8_t *row = marks.at(y);
        if (shared.still) {
          for (Int x = left; x < right; x++) row[x] = 0;
          continue;
        }
        find_smallest_change(pictures, y, left, right, shared, smallest);
        mark_changes(smallest, T(a.different), left, right, row);
      }
    }
  }
  return 0;
}

}  // namespace

KERNEL(Int, mark_overlay, MarkOverlay) { return a.frames.image0.kind == UINT8 ? mark<uint8_t>(a) : mark<uint16_t>(a); }
