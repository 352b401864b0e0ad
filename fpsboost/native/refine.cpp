// Subpixel refinement of motion: weighted least-squares steps at every point (Lucas and Kanade 1981).
#include "least_squares.h"

namespace {

constexpr Int POINTS_AT_ONCE = 64;  // those that another step moves are found without branches nobody could foresee

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

// Moves a vector by one step from whole pixels. Returns whether it rounds to others then.
FORCE_INLINE bool refine_vector(const Frames<uint8_t> &frames, const RefineBidirectional &args, Int row, Int column,
                                float *vector) {
  const Int step = args.step, stride = frames.stride;
  const float largest = args.largest, dx = __builtin_rintf(vector[0]), dy = __builtin_rintf(vector[1]);
  const Int y0 = point_centre(row, step, frames.height) - WINDOW_SIDE / 2 + frames.padding;
  const Int x0 = point_centre(column, step, frames.width) - WINDOW_SIDE / 2 + frames.padding;
  // limited to the padding, beyond which the repeated edges do not change
  const Int y1 = clamp(y0 + Int(dy), Int(1), frames.rows - WINDOW_SIDE - 1);
  const Int x1 = clamp(x0 + Int(dx), Int(1), stride - 2 * WINDOW_SIDE);
  const uint8_t *first = frames.first + (y0 - 1) * stride + x0 - 1;
  const uint8_t *second = frames.second + (y1 - 1) * stride + x1 - 1;
  // the point after the next one usually has a similar motion
  if (column % 2 == 0) {
    prefetch_rows(first + 3 * step + WINDOW_SIDE, stride, frames.plane);
    prefetch_rows(second + 3 * step + WINDOW_SIDE, stride, frames.plane);
  }
  const Products<float> sums = window_products<true>(first, second, stride, frames.plane, args.tail);
  const Vector along = solve(sums, args.damping);
  const float factor = -4 * significance(along.dx * sums.xt + along.dy * sums.yt, sums.tt);
  vector[0] = dx + clamp(factor * along.dx, -largest, largest);
  vector[1] = dy + clamp(factor * along.dy, -largest, largest);
  return (__builtin_rintf(vector[0]) != dx) | (__builtin_rintf(vector[1]) != dy);
}

void refine_points(const Frames<uint8_t> &frames, const RefineBidirectional &args, const View<const float, 3> &refined,
                   const View<float, 3> &flow) {
  const bool has_refined = refined.shape[0] * refined.shape[1] > 0;
  for (Int row = 0; row < flow.shape[0]; row++)
    for (Int begin = 0; begin < flow.shape[1]; begin += POINTS_AT_ONCE) {
      int32_t moving[POINTS_AT_ONCE];
      Int count = 0;
      for (Int column = begin; column < min(begin + POINTS_AT_ONCE, flow.shape[1]); column++) {
        float *vector = flow.ptr(row, column);
        const float *known = has_refined ? refined.ptr(row, column) : vector;
        const bool is_known = has_refined && __builtin_rintf(vector[0]) == __builtin_rintf(known[0]) &&
                              __builtin_rintf(vector[1]) == __builtin_rintf(known[1]);
        vector[0] = is_known ? known[0] : __builtin_rintf(vector[0]);
        vector[1] = is_known ? known[1] : __builtin_rintf(vector[1]);
        moving[count] = int32_t(column);
        count += !is_known;
      }
      for (Int n = 0; n < args.steps && count; n++) {
        const Int before = count;
        count = 0;
        for (Int k = 0; k < before; k++) {
          const int32_t column = moving[k];
          moving[count] = column;
          count += refine_vector(frames, args, row, column, flow.ptr(row, column));
        }
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
