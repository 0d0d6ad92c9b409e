// Philox4x32-10 against the published vectors, and the properties of a world's draws.
#include "core/philox.hpp"

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "sim/draws.hpp"

namespace giga {
namespace {

struct KnownAnswer {
  uint32_t counter[4];
  uint32_t key[2];
  uint32_t expected[4];
};

// Random123's kat_vectors, lines "philox4x32 10".
constexpr KnownAnswer kKnownAnswers[] = {
    {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
    {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
     {0xffffffff, 0xffffffff},
     {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
    {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
     {0xa4093822, 0x299f31d0},
     {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
};

TEST(CorePhilox, PublishedVectors) {
  for (const KnownAnswer& k : kKnownAnswers) {
    const uint64_t key = static_cast<uint64_t>(k.key[1]) << 32 | k.key[0];
    const Philox4 out = philox4x32(k.counter[0], k.counter[1], k.counter[2], k.counter[3], key);
    for (int word = 0; word < 4; ++word)
      EXPECT_EQ(out.word[word], k.expected[word]) << "counter " << std::hex << k.counter[0] << ", word " << word;
  }
}

TEST(CorePhilox, UnitFloatIsBelowOne) {
  EXPECT_EQ(to_unit_float(0), 0.0f);
  EXPECT_EQ(to_unit_float(0xFF), 0.0f);                    // the low 8 bits do not count
  EXPECT_EQ(to_unit_float(0x80000000u), 0.5f);             // 2^31 / 2^32
  EXPECT_EQ(to_unit_float(0xFFFFFFFFu), 1.0f - 0x1p-24f);  // (2^24 - 1) / 2^24
}

TEST(CorePhilox, DrawIsAFunctionOfItsAddress) {
  // Number `index` of row `row` is word index % 4 of the block with counter (world, step, purpose | index / 4, row),
  // whatever was asked before it.
  DrawKey key(77, 5, 9);
  const uint32_t order[] = {3, 0, 6, 1, 7, 2, 5, 4, 3};
  for (const uint32_t index : order)
    for (const uint32_t row : {0u, 2u, 65536u}) {
      const uint32_t purpose = static_cast<uint32_t>(Draw::comm) << 24 | index / 4;
      const float expected = to_unit_float(philox4x32(5, 9, purpose, row, 77).word[index % 4]);
      EXPECT_EQ(key.uniform(Draw::comm, row, index), expected) << "row " << row << ", index " << index;
    }
}

TEST(CorePhilox, NoTwoAddressesShareADraw) {
  // 2 seeds x 2 worlds x 2 steps x 3 purposes x 3 rows x 8 indices = 576 draws of 24 bits; a chance collision has
  // probability 576^2 / 2 / 2^24 = 1 %, and the draws are fixed, so this run has none.
  std::set<float> values;
  int count = 0;
  for (const uint64_t seed : {uint64_t{1}, uint64_t{1} << 32})
    for (uint32_t world = 0; world < 2; ++world)
      for (uint32_t step = 0; step < 2; ++step)
        for (const Draw draw : {Draw::detect, Draw::comm, Draw::start}) {
          DrawKey key(seed, world, step);
          for (uint32_t row = 0; row < 3; ++row)
            for (uint32_t index = 0; index < 8; ++index, ++count) values.insert(key.uniform(draw, row, index));
        }
  EXPECT_EQ(count, 576);
  EXPECT_EQ(static_cast<int>(values.size()), count);
}

TEST(CorePhilox, UniformByChiSquare) {
  // 65 worlds x 1,000 rows into 16 equal cells: 15 degrees of freedom, 0.1 % critical value 37.70.
  std::vector<int> cells(16);
  const int n = 65 * 1000;
  for (uint32_t world = 0; world < 65; ++world) {
    DrawKey key(3, world, 0);
    for (uint32_t row = 0; row < 1000; ++row) {
      const float u = key.uniform(Draw::detect, row, row % 7);
      ASSERT_GE(u, 0.0f);
      ASSERT_LT(u, 1.0f);
      ++cells[static_cast<size_t>(u * 16)];
    }
  }
  double chi2 = 0;
  for (const int count : cells) chi2 += (count - n / 16.0) * (count - n / 16.0) / (n / 16.0);
  EXPECT_LT(chi2, 37.70);
}

TEST(CorePhilox, DrawsOfAResetAreApartFromTheStep) {
  PhiloxDraws draws(1, 2, 3);
  EXPECT_NE(draws.comm(0, 1, false), draws.comm(0, 1, true));
  EXPECT_NE(draws.start(0, 0, StartDraw::x), draws.start(0, 1, StartDraw::x));
  EXPECT_NE(draws.detect(0, 1), draws.detect(1, 0));
}

}  // namespace
}  // namespace giga
