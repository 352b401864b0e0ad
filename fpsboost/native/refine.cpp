// Subpixel refinement of motion: weighted least-squares steps at every point (Lucas and Kanade 1981).
#include "least_squares.h"

namespace {

// How much of a step to trust, 0 to 1, given how much of the squared change it explains. Two free parameters explain
// some of any noise, which is no evidence of motion (positive-part shrinkage of James and Stein 1961).
FORCE_INLINE float significance(float explained, float change) {
  const float rest = max(change - explained, 0.0f) * float(1 / (WINDOW_SIDE * WINDOW_SIDE / 2.0 - 1));
  return max(explained - rest, 0.0f) / max(explained, 1e-20f);
}

// Fetches a window ahead, as processors do not foresee small windows of many rows.
FORCE_INLINE void prefetch_rows(const uint8_t *row, Int stride, Int plane) {
  for (Int j = 0; j < WINDOW_SIDE; j++, row += stride)
    for (int c = 0; c < 3; c++) __builtin_prefetch(row + c * plane);
}

void refine_points(const Frames<uint8_t> &frames, const RefineBidirectional &args, const View<const float, 3> &refined,
                   const View<float, 3> &flow) {
  const Int step = args.step, stride = frames.stride;
  const float tail = args.tail, damping = args.damping, largest = args.largest;
  const bool has_refined = refined.shape[0] * refined.shape[1] > 0;
  for (Int row = 0; row < flow.shape[0]; row++)
    for (Int column = 0; column < flow.shape[1]; column++) {
      const Int y0 = point_centre(row, step, frames.height) - WINDOW_SIDE / 2 + frames.padding;
      const Int x0 = point_centre(column, step, frames.width) - WINDOW_SIDE / 2 + frames.padding;
      float *vector = flow.ptr(row, column), dx = __builtin_rintf(vector[0]), dy = __builtin_rintf(vector[1]);
      if (has_refined) {
        const float *known = refined.ptr(row, column);
        if (dx == __builtin_rintf(known[0]) && dy == __builtin_rintf(known[1])) {
          vector[0] = known[0];
          vector[1] = known[1];
          continue;
        }
      }
      const uint8_t *first = frames.first + (y0 - 1) * stride + x0 - 1;
      for (Int n = 0; n < args.steps; n++) {
        // limited to the padding, beyond which the repeated edges do not change
        const Int y1 = clamp(y0 + Int(dy), Int(1), frames.rows - WINDOW_SIDE - 1);
        const Int x1 = clamp(x0 + Int(dx), Int(1), stride - 2 * WINDOW_SIDE);
        const uint8_t *second = frames.second + (y1 - 1) * stride + x1 - 1;
        // the point after the next one usually has a similar motion
        prefetch_rows(first + 2 * step + WINDOW_SIDE, stride, frames.plane);
        prefetch_rows(second + 2 * step + WINDOW_SIDE, stride, frames.plane);
        const Products<float> sums = window_products<true>(first, second, stride, frames.plane, tail);
        const Vector along = solve(sums, damping);
        const float factor = -4 * significance(along.dx * sums.xt + along.dy * sums.yt, sums.tt);
        vector[0] = dx + clamp(factor * along.dx, -largest, largest);
        vector[1] = dy + clamp(factor * along.dy, -largest, largest);
        const float x = __builtin_rintf(vector[0]), y = __builtin_rintf(vector[1]);
        if (x == dx && y == dy) break;
        dx = x;
        dy = y;
      }
    }
}

}  // namespace

KERNEL(void, refine_bidirectional, const RefineBidirectional &args) {
  const View<const float, 4> refined(args.refined);
  const View<float, 4> flow(args.flow);
  const Frames<uint8_t> frames(args.pair);
  refine_points(frames, args, refined[0], flow[0]);
  if (flow.shape[0] > 1) refine_points(frames.opposite(), args, refined[1], flow[1]);
}
