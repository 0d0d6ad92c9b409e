// Whether a straight way passes through a box: sight past obstacles, and ways around them.
#pragma once

#include "core/geometry.hpp"

namespace giga {

/// Whether the segment from `from` to `from + delta` meets the inside of the box from `lo` to `hi` along the first
/// `n_axes` axes (each array has so many numbers). To touch a face or a corner is not to meet; nor does a segment of
/// length 0 outside of the box. Clips the segment to the space between the faces of one axis after
/// the other (Liang and Barsky 1984).
GIGA_HD bool segment_meets_box(const float* from, const float* delta, const float* lo, const float* hi, int n_axes) {
  float enter = 0, leave = 1;  // the part that is left, as shares of the segment
  for (int axis = 0; axis < n_axes; ++axis) {
    if (delta[axis] == 0) {
      if (from[axis] <= lo[axis] || from[axis] >= hi[axis]) return false;
      continue;
    }
    const float t1 = (lo[axis] - from[axis]) / delta[axis], t2 = (hi[axis] - from[axis]) / delta[axis];
    enter = max_of(enter, min_of(t1, t2));
    leave = min_of(leave, max_of(t1, t2));
  }
  return enter < leave;
}

}  // namespace giga
