// Copies of several stretches of memory in one go.
#include "math/copy_pieces.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <vector>

namespace giga::test {
namespace {

// Pieces of 1, 4, 7 and 8 bytes, at even and odd places; the bytes between them stay as they were.
TEST(CopyPieces, CopiesEachByteAndNoOther) {
  alignas(4) uint8_t from[64], to[64];
  std::iota(from, from + 64, uint8_t{1});
  std::fill(to, to + 64, uint8_t{0xFF});
  struct {
    int from, to, bytes;
  } const pieces[] = {{0, 4, 1}, {8, 8, 4}, {21, 13, 7}, {32, 40, 8}};
  CopyPieces copy;
  for (const auto& p : pieces) copy.add(from + p.from, to + p.to, p.bytes);
  ASSERT_EQ(copy.n_rows(), 1 + 1 + 2 + 2);
  for (int64_t row = copy.n_rows(); row-- > 0;) copy(row);

  std::vector<uint8_t> expected(64, 0xFF);
  for (const auto& p : pieces)
    for (int k = 0; k < p.bytes; ++k) expected[static_cast<size_t>(p.to + k)] = from[p.from + k];
  EXPECT_EQ(std::vector<uint8_t>(to, to + 64), expected);
}

}  // namespace
}  // namespace giga::test
