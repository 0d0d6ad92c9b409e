// Mutated replays: each is read, and then written and read back to the same, or is refused with an InputError; also
// where the bytes still unpack, so that the changes reach the header and the columns.
#include <gtest/gtest.h>

#include "changed_replays.hpp"
#include "core/error.hpp"
#include "io/replay.hpp"
#include "io/sample_replay.hpp"

namespace giga::test {
namespace {

void read(const std::string& bytes) {
  const Replay replay = decode_replay(bytes, "fuzz.replay");
  const std::string again = encode_replay(replay);
  EXPECT_EQ(encode_replay(decode_replay(again, "fuzz.replay")), again);
}

TEST(ReplayFuzz, Bytes) {
  const std::string good = encode_replay(sample_replay());
  const auto make = [&good](int64_t k) { return Mutator(static_cast<uint64_t>(k)).bytes(good); };
  const FuzzCount count = fuzz("replays", 10'000, make, read);
  EXPECT_GT(count.refused, 5000);
}

FuzzCount fuzz_insides(const std::string& name, int64_t n_inputs, const Replay& replay) {
  return fuzz(name, n_inputs, ChangedInsides(replay), read);
}

TEST(ReplayFuzz, HeadersAndColumns) {
  const FuzzCount count = fuzz_insides("headers and columns of replays", 4000, sample_replay());
  EXPECT_GT(count.accepted, 50);
  EXPECT_GT(count.refused, 500);
}

TEST(ReplayFuzz, Crowds) {
  const FuzzCount count = fuzz_insides("headers and columns of crowds", 1500, sample_crowd());
  EXPECT_GT(count.accepted, 10);
  EXPECT_GT(count.refused, 200);
}

}  // namespace
}  // namespace giga::test
