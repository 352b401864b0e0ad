// Landings of points: how many points of a frame land around each point of the in-between frame.
#include "records.h"

KERNEL(void, count_landings, CountLandings) {
  const View<const float, 3> points(a.points);
  const View<float, 2> landings(a.landings);
  const Int rows = landings.shape[0], columns = landings.shape[1];
  const float t = float(a.t), step = float(a.step), limit = 2;
  for (Int i = 0; i < rows * columns; i++) landings.data[i] = 0;
  for (Int i = 0; i < rows; i++)
    for (Int j = 0; j < columns; j++) {
      const float x = float(j) + t * points(i, j, 0) / step, y = float(i) + t * points(i, j, 1) / step;
      const Int left = Int(__builtin_floorf(x)), top = Int(__builtin_floorf(y));
      for (Int row = most(top, Int(0)); row < least(top + 2, rows); row++)
        for (Int column = most(left, Int(0)); column < least(left + 2, columns); column++) {
          const float share = (1 - absolute(x - float(column))) * (1 - absolute(y - float(row)));
          landings(row, column) = least(landings(row, column) + share, limit);
        }
    }
}
