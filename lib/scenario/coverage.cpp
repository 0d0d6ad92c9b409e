// covers(): cuts box after box out of what is left of the area.
#include "scenario/coverage.hpp"

namespace giga {
namespace {

/// The two ends of a box along an axis.
struct Axis {
  float Box::*lo;
  float Box::*hi;
};
constexpr Axis kAxes[] = {{&Box::x1, &Box::x2}, {&Box::y1, &Box::y2}, {&Box::z1, &Box::z2}};

bool overlap(const Box& part, const Box& box, int n_axes) {
  for (int k = 0; k < n_axes; ++k) {
    const float lo = part.*kAxes[k].lo, hi = part.*kAxes[k].hi, from = box.*kAxes[k].lo, to = box.*kAxes[k].hi;
    if (lo < hi ? hi <= from || to <= lo : lo < from || to < lo) return false;
  }
  return true;
}

/// Adds what lies of `part` beside the box, which overlaps it.
void cut(Box part, const Box& box, int n_axes, std::vector<Box>& left) {
  for (int k = 0; k < n_axes; ++k) {
    const auto& [lo, hi] = kAxes[k];
    if (part.*lo < box.*lo) {
      left.push_back(part);
      left.back().*hi = part.*lo = box.*lo;
    }
    if (box.*hi < part.*hi) {
      left.push_back(part);
      left.back().*lo = part.*hi = box.*hi;
    }
  }
}

}  // namespace

bool covers(const std::vector<Box>& boxes, const Box& area, bool with_heights) {
  const int n_axes = with_heights ? 3 : 2;
  std::vector<Box> left = {area};
  for (const Box& box : boxes) {
    std::vector<Box> rest;
    for (const Box& part : left)
      if (overlap(part, box, n_axes))
        cut(part, box, n_axes, rest);
      else
        rest.push_back(part);
    left = std::move(rest);
  }
  return left.empty();
}

}  // namespace giga
