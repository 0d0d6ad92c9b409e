// Mutated exports: each file is read or refused with an InputError; a manifest that is read prints and reads back to
// the same.
#include <gtest/gtest.h>

#include "core/error.hpp"
#include "export/manifest.hpp"
#include "export/safetensors.hpp"
#include "mutations.hpp"

namespace giga::test {
namespace {

constexpr size_t kLengthBytes = 8;

std::string sample_tensors() {
  NamedArrays arrays = {make_array<float>("layers.0.weight", std::vector<float>(24, 0.5f)),
                        make_array<float>("layers.0.bias", std::vector<float>(4, 1)), make_array<int64_t>("n", {12}),
                        make_array<uint8_t>("empty", {})};
  arrays[0].shape = {4, 6};
  return encode_safetensors(arrays, {{"written_by", "gigastep"}});
}

/// Whatever is accepted has shapes that fit its bytes, and no more bytes than the file.
void decode_tensors(const std::string& bytes) {
  size_t total = 0;
  for (const NamedArray& array : decode_safetensors(bytes, "fuzz.safetensors")) {
    size_t count = 1;
    for (const int64_t side : array.shape) count *= static_cast<size_t>(side);
    EXPECT_EQ(count * size_of(array.type), array.bytes.size());
    total += array.bytes.size();
  }
  EXPECT_LT(total, bytes.size());
}

TEST(ExportFuzz, BytesOfSafetensors) {
  const std::string good = sample_tensors();
  const auto make = [&good](int64_t k) {
    return Mutator(static_cast<uint64_t>(k)).bytes(good, k % 2 ? kLengthBytes : 0);
  };
  const FuzzCount count = fuzz("safetensors", 20'000, make, decode_tensors);
  EXPECT_GT(count.accepted, 100);  // numbers of tensors may be any
  EXPECT_GT(count.refused, 1000);
}

// The length in front fits the changed header, so that its words are reached.
TEST(ExportFuzz, HeadersOfSafetensors) {
  const std::string good = sample_tensors();
  const size_t n_data = (24 + 4) * 4 + 8;
  const std::string header = good.substr(kLengthBytes, good.size() - kLengthBytes - n_data);
  const auto make = [&](int64_t k) {
    const std::string changed = Mutator(static_cast<uint64_t>(k)).text(header, {header});
    std::string bytes = good.substr(0, kLengthBytes) + changed + good.substr(good.size() - n_data);
    for (size_t byte = 0; byte < kLengthBytes; ++byte) bytes[byte] = static_cast<char>(changed.size() >> (8 * byte));
    return bytes;
  };
  const FuzzCount count = fuzz("headers of safetensors", 10'000, make, decode_tensors);
  EXPECT_GT(count.accepted, 50);
  EXPECT_GT(count.refused, 1000);
}

Manifest sample_manifest() {
  Manifest manifest;
  manifest.shape.inputs = 18;
  manifest.shape.actions = ActionKind::continuous;
  manifest.shape.network.hidden = {12, 10};
  manifest.observation = {{"self", 0, 1, 9}, {"neighbors", 9, 1, 9}};
  manifest.log_std = {-0.5f, -0.5f, -0.5f};
  manifest.origin = {"0.1.0", "small", "rules: corrected\n", "seed: 7\n", 1, 7, 12, 4096, Precision::tf32};
  return manifest;
}

TEST(ExportFuzz, Manifests) {
  const auto print = [](const Manifest& m) { return manifest_text(m); };
  const std::string good = print(sample_manifest());
  const auto make = [&good](int64_t k) { return Mutator(static_cast<uint64_t>(k)).text(good, {good}); };
  const FuzzCount count = fuzz("manifests", 4000, make, [&print](const std::string& text) {
    const std::string printed = print(parse_manifest(text, "fuzz.json"));
    ASSERT_EQ(print(parse_manifest(printed, "fuzz.json")), printed) << text;
  });
  EXPECT_GT(count.accepted, 50);
  EXPECT_GT(count.refused, 100);
}

}  // namespace
}  // namespace giga::test
