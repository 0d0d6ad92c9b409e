// Seeds by purpose: no two stretches of draws are one.
#include "core/seeds.hpp"

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr Purpose kLast = Purpose::bench;

TEST(CoreSeeds, NoTwoPurposesShareASeed) {
  // Indices as they occur: networks (team x 2 + role), updates, permutations (update x 2^16 + epoch).
  std::vector<uint64_t> indices;
  for (uint64_t k = 0; k < 64; ++k) indices.push_back(k);
  for (uint64_t update = 1; update < 16; ++update)
    for (uint64_t epoch = 0; epoch < 4; ++epoch) indices.push_back(update << 16 | epoch);
  indices.push_back(uint64_t{1} << 63);  // rate: a hash

  std::map<uint64_t, std::string> owner;
  for (uint64_t user = 0; user < 32; ++user) owner[user] = cat("the seed ", user, " as the user gives it");
  for (uint64_t user = 0; user < 32; ++user)
    for (uint32_t purpose = 0; purpose <= static_cast<uint32_t>(kLast); ++purpose)
      for (const uint64_t index : indices) {
        const std::string name = cat("seed ", user, ", purpose ", purpose, ", index ", index);
        const auto [place, is_new] = owner.emplace(seed_of(user, static_cast<Purpose>(purpose), index), name);
        ASSERT_TRUE(is_new) << name << " is " << place->second;
      }
  EXPECT_EQ(owner.size(), 32 + 32 * 7 * indices.size());
}

TEST(CoreSeeds, AreAFunctionOfTheirArguments) {
  EXPECT_EQ(seed_of(1, Purpose::evaluation, 50), seed_of(1, Purpose::evaluation, 50));
  EXPECT_EQ(seed_of(1, Purpose::training), seed_of(1, Purpose::training, 0));
  // The key of Philox is the seed, its counter (index, 0xFF000000 + purpose, 0).
  const Philox4 bits = philox4x32(3, 2, 0xFF000003u, 0, 7);
  EXPECT_EQ(seed_of(7, Purpose::evaluation, uint64_t{2} << 32 | 3),
            static_cast<uint64_t>(bits.word[0]) << 32 | bits.word[1]);
}

}  // namespace
}  // namespace giga
