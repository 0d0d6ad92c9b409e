// The sorting network.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "core/lowest_keys.hpp"

namespace giga::test {
namespace {

/// By the 0-1 principle a network that sorts all rows of zeros and ones sorts everything.
TEST(LowestKeys, SixteenAreSorted) {
  for (uint32_t bits = 0; bits < 1u << 16; ++bits) {
    uint32_t keys[16];
    for (int k = 0; k < 16; ++k) keys[k] = bits >> k & 1u;
    sort_lowest(keys);
    ASSERT_TRUE(std::is_sorted(keys, keys + 16)) << bits;
  }
}

template <int kCount>
void expect_lowest(uint32_t seed, uint32_t range) {
  uint32_t keys[kCount];
  for (uint32_t& key : keys) key = (seed = seed * 1664525u + 1013904223u) >> 4 & range;
  std::vector<uint32_t> expected(keys, keys + kCount);
  std::sort(expected.begin(), expected.end());
  expected.resize(std::min(kCount, kSortedKeys));
  sort_lowest(keys);
  ASSERT_EQ(std::vector<uint32_t>(keys, keys + expected.size()), expected) << kCount << " keys, seed " << seed;
}

TEST(LowestKeys, OfAnyNumber) {
  for (uint32_t seed = 0; seed < 1000; ++seed)
    for (const uint32_t range : {3u, 0xFFFFu, 0xFFFFFFFFu}) {
      expect_lowest<1>(seed, range);
      expect_lowest<4>(seed, range);
      expect_lowest<10>(seed, range);
      expect_lowest<17>(seed, range);
      expect_lowest<20>(seed, range);
      expect_lowest<40>(seed, range);
      expect_lowest<50>(seed, range);
    }
}

}  // namespace
}  // namespace giga::test
