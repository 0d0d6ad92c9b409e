// Mutated checkpoints: each is read or refused with an InputError, also where the seal in front fits what was changed
// behind it, so that the changed bytes reach the HDF5 library.
#include <gtest/gtest.h>

#include "core/error.hpp"
#include "io/checkpoint.hpp"
#include "io/seal.hpp"
#include "mutations.hpp"

namespace giga::test {
namespace {

Checkpoint sample() {
  Checkpoint c;
  c.gigastep_version = "0.1.0";
  c.scenario_name = "identical_2_vs_2";
  c.config_yaml = "seed: 3\n";
  c.scenario_yaml = "description: short\n";
  c.updates = 12;
  c.agent_steps = 4096;
  c.seed = 7;
  c.arrays.push_back(make_array<float>("team_0/actor/weight", std::vector<float>(64, 0.5f)));
  c.arrays.back().shape = {8, 8};
  c.arrays.push_back(make_array<double>("team_0/actor/bias", {3.25}));
  c.arrays.push_back(make_array<int64_t>("updates", {12}));
  c.arrays.push_back(make_array<uint8_t>("empty", {}));
  return c;
}

void decode(const std::string& bytes) { decode_checkpoint(bytes, "fuzz.h5"); }

TEST(CheckpointFuzz, AnyChangeIsRefused) {
  const std::string good = encode_checkpoint(sample());
  const auto make = [&good](int64_t k) { return Mutator(static_cast<uint64_t>(k)).bytes(good); };
  const FuzzCount count = fuzz("checkpoints", 20'000, make, [&good](const std::string& bytes) {
    decode(bytes);
    EXPECT_EQ(bytes, good) << "a change was not noticed";  // some mutations change nothing
  });
  EXPECT_GT(count.refused, 10'000);
}

TEST(CheckpointFuzz, ChangesUnderANewSeal) {
  const std::string good = encode_checkpoint(sample());
  const auto make = [&good](int64_t k) {
    std::string bytes = Mutator(static_cast<uint64_t>(k)).bytes(good, kSealBytes);
    seal(bytes, kCheckpointKind, kCheckpointFormat, "0.1.0");
    return bytes;
  };
  const FuzzCount count = fuzz("checkpoints under a new seal", 5000, make, decode);
  EXPECT_GT(count.accepted, 100);  // changes of what nobody reads
  EXPECT_GT(count.refused, 1000);
}

}  // namespace
}  // namespace giga::test
