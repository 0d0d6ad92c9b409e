// Mutated replays: each is read, and then written and read back to the same, or is refused with an InputError; also
// where the bytes still unpack, so that the changes reach the header and the columns.
#include <gtest/gtest.h>
#include <zlib.h>

#include "core/error.hpp"
#include "io/replay.hpp"
#include "io/sample_replay.hpp"
#include "mutations.hpp"

namespace giga::test {
namespace {

constexpr size_t kFirstLine = sizeof "gigastep replay 3\n" - 1;

std::string unpacked(const std::string& bytes) {
  std::string raw(1 << 17, '\0');
  uLongf size = raw.size();
  EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(raw.data()), &size,
                       reinterpret_cast<const Bytef*>(bytes.data() + kFirstLine), bytes.size() - kFirstLine),
            Z_OK);
  return raw.substr(0, size);
}

std::string packed(const std::string& first_line, const std::string& raw) {
  std::string out(compressBound(raw.size()), '\0');
  uLongf size = out.size();
  EXPECT_EQ(
      compress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(raw.data()), raw.size(), 1),
      Z_OK);
  return first_line + out.substr(0, size);
}

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

/// Feeds changed headers and changed columns of a replay, by turns.
FuzzCount fuzz_insides(const std::string& name, int64_t n_inputs, const Replay& replay) {
  const std::string good = encode_replay(replay), first_line = good.substr(0, kFirstLine);
  const std::string raw = unpacked(good);
  size_t header = 0;
  for (size_t byte = 0; byte < 4; ++byte)
    header |= static_cast<size_t>(static_cast<unsigned char>(raw[byte])) << 8 * byte;
  const std::string json = raw.substr(4, header), columns = raw.substr(4 + header);
  const auto make = [&](int64_t k) {
    Mutator mutator(static_cast<uint64_t>(k));
    if (k % 2) return packed(first_line, raw.substr(0, 4 + header) + mutator.bytes(columns));
    const std::string changed = mutator.text(json, {json});
    std::string all;
    for (size_t byte = 0; byte < 4; ++byte) all += static_cast<char>(changed.size() >> 8 * byte & 255);
    return packed(first_line, all + changed + columns);
  };
  return fuzz(name, n_inputs, make, read);
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
