// Wilson's intervals against values by hand.
#include "math/wilson.hpp"

#include <gtest/gtest.h>

namespace giga::test {
namespace {

TEST(MathWilson, Interval) {
  struct Case {
    int k, n;
    double lo, hi;
  };
  // z = 1.96: centre (p + z^2 / 2n) / (1 + z^2 / n), half width z sqrt(p (1 - p) / n + z^2 / 4n^2) / (1 + z^2 / n).
  // k = 0: [0, z^2 / (n + z^2)] = 3.8415 / 13.8415.
  const Case cases[] = {{0, 10, 0, 0.2775}, {10, 10, 0.7225, 1}, {5, 10, 0.2366, 0.7634}, {90, 100, 0.8256, 0.9448}};
  for (const Case& c : cases) {
    const Interval i = wilson95(c.k, c.n);
    EXPECT_NEAR(i.lo, c.lo, 5e-5) << c.k << " of " << c.n;
    EXPECT_NEAR(i.hi, c.hi, 5e-5) << c.k << " of " << c.n;
  }
  EXPECT_EQ(wilson95(0, 0).lo, 0);
  EXPECT_EQ(wilson95(0, 0).hi, 1);
}

}  // namespace
}  // namespace giga::test
