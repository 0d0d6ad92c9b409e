// safetensors: the bytes that are written, and what is refused.
#include "export/safetensors.hpp"

#include <gtest/gtest.h>

#include "io/protobuf_wire.hpp"
#include "io/temporary_folder.hpp"

namespace giga::test {
namespace {

/// A file of a header and so many bytes behind it.
std::string file_of(const std::string& header, size_t n_bytes) {
  return little_endian(uint64_t{header.size()}) + header + std::string(n_bytes, '\0');
}
std::string tensors_refusal(const std::string& bytes) {
  return input_error_of([&] { decode_safetensors(bytes, "x.safetensors"); });
}
std::string tensors_refusal(const std::string& header, size_t n_bytes) {
  return tensors_refusal(file_of(header, n_bytes));
}

TEST(Safetensors, BytesOfAFile) {
  const std::string bytes = encode_safetensors({make_array<float>("a", {1.0f, -2.0f})}, {});
  // 1.0 = 3f800000 and -2.0 = c0000000, little-endian, at the end; they begin at a multiple of 8.
  EXPECT_EQ(bytes.substr(bytes.size() - 8), std::string("\0\0\x80\x3f\0\0\0\xc0", 8));
  EXPECT_EQ(bytes.size() % 8, 0u);
  EXPECT_EQ(bytes.substr(0, 8), little_endian(uint64_t{bytes.size() - 16}));  // 8 before, 8 behind the header
  EXPECT_EQ(bytes[8], '{');
}

TEST(Safetensors, ReadsWhatItWrote) {
  NamedArrays arrays = {make_array<uint8_t>("bytes", {1, 2, 3}), make_array<float>("a \"b\"", {1, 2, 3, 4, 5, 6}),
                        make_array<double>("wide", {0.1}), make_array<int64_t>("none", {}),
                        make_array<int32_t>("whole", {-7})};
  arrays[1].shape = {2, 1, 3};
  arrays[2].shape = {};
  const NamedArrays read = decode_safetensors(encode_safetensors(arrays, {{"k", "v"}}), "x");
  ASSERT_EQ(read.size(), arrays.size());
  for (const NamedArray& a : arrays) {
    const NamedArray& b = find_array(read, a.name);
    EXPECT_EQ(b.type, a.type) << a.name;
    EXPECT_EQ(b.shape, a.shape) << a.name;
    EXPECT_EQ(b.bytes, a.bytes) << a.name;
  }
}

// As the library of Python writes it: on one line, without spaces.
TEST(Safetensors, ReadsACompactHeader) {
  const NamedArrays read = decode_safetensors(
      file_of(R"({"__metadata__":{"format":"pt"},"b":{"dtype":"F32","shape":[2,1],"data_offsets":[4,12]},)"
              R"("a":{"dtype":"I32","shape":[],"data_offsets":[0,4]}}   )",
              12),
      "x");
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[0].name, "a");
  EXPECT_EQ(read[1].shape, (std::vector<int64_t>{2, 1}));
}

TEST(Safetensors, LengthOfTheHeader) {
  EXPECT_TRUE(contains(tensors_refusal("1234567"), {"x.safetensors is no safetensors file", "7 bytes"}));
  EXPECT_TRUE(
      contains(tensors_refusal(little_endian(uint64_t{3}) + "{}"), {"header would have 3 bytes", "allowed here: 2"}));
  EXPECT_TRUE(
      contains(tensors_refusal(std::string(8, '\xFF') + "{}"), {"header would have 18446744073709551615 bytes"}));
  EXPECT_TRUE(contains(tensors_refusal("{" + std::string(1 << 20, ' ') + "}", 0), {"allowed here: 1048576"}));
  EXPECT_TRUE(contains(tensors_refusal("[]", 0), {"does not begin with {"}));
  EXPECT_TRUE(contains(tensors_refusal("", 0), {"does not begin with {"}));
  EXPECT_TRUE(contains(tensors_refusal("{\"a\": ", 0), {"x.safetensors"}));
}

TEST(Safetensors, EntriesOfTheHeader) {
  const auto entry = [](const std::string& text) { return tensors_refusal("{\"a\": " + text + "}", 8); };
  EXPECT_EQ(entry(R"({"dtype": "F32", "shape": [2], "data_offsets": [0, 8]})"), "no error");
  EXPECT_TRUE(
      contains(entry(R"({"dtype": "F16", "shape": [4], "data_offsets": [0, 8]})"), {"F16", "is not one of: F32, F64"}));
  EXPECT_TRUE(
      contains(entry(R"({"dtype": "F32", "shape": [-2], "data_offsets": [0, 8]})"), {"tensor 'a'.shape", "-2"}));
  EXPECT_TRUE(contains(entry(R"({"dtype": "F32", "shape": ["2"], "data_offsets": [0, 8]})"), {"tensor 'a'.shape"}));
  EXPECT_TRUE(contains(entry(R"({"dtype": "F32", "shape": 2, "data_offsets": [0, 8]})"), {"tensor 'a'.shape"}));
  EXPECT_TRUE(
      contains(entry(R"({"dtype": "F32", "shape": [3], "data_offsets": [0, 8]})"), {"does not fit the 8 bytes"}));
  EXPECT_TRUE(contains(entry(R"({"dtype": "F32", "shape": [2], "data_offsets": [0]})"), {"data_offsets"}));
  EXPECT_TRUE(contains(entry(R"({"dtype": "F32", "shape": [2]})"), {"data_offsets is missing"}));
  EXPECT_TRUE(contains(entry(R"({"dtype": "F32", "shape": [2], "data_offsets": [0, 8], "x": 1})"), {"'x' is unknown"}));
  EXPECT_TRUE(contains(entry("3"), {"tensor 'a': a map is needed"}));
  // 2^62 x 4 x 4 bytes = 2^66, which is 0 in 64 bits.
  EXPECT_TRUE(contains(entry(R"({"dtype": "F32", "shape": [4611686018427387904, 4], "data_offsets": [0, 0]})"),
                       {"does not fit the 0 bytes"}));
  EXPECT_TRUE(contains(tensors_refusal(R"({"__metadata__": {"a": 1}})", 0), {"__metadata__: 'a' is no text"}));
}

TEST(Safetensors, PlacesOfTensors) {
  const auto two = [](const std::string& first, const std::string& second, size_t n_bytes) {
    const std::string rest = R"({"dtype": "F32", "shape": [2], "data_offsets": )";
    return tensors_refusal("{\"a\": " + rest + first + "}, \"b\": " + rest + second + "}}", n_bytes);
  };
  EXPECT_EQ(two("[0, 8]", "[8, 16]", 16), "no error");
  EXPECT_EQ(two("[8, 16]", "[0, 8]", 16), "no error");
  EXPECT_TRUE(contains(two("[0, 8]", "[4, 12]", 12), {"tensor 'b' begins at byte 4 inside another one"}));
  EXPECT_TRUE(contains(two("[0, 8]", "[0, 8]", 8), {"inside another one"}));
  EXPECT_TRUE(contains(two("[0, 8]", "[12, 20]", 20), {"begins at byte 12 behind bytes that belong to none"}));
  EXPECT_TRUE(contains(two("[0, 8]", "[8, 16]", 20), {"4 bytes at the end belong to no tensor"}));
  EXPECT_TRUE(contains(two("[0, 8]", "[8, 16]", 12), {"[8, 16] lie outside of the 12 bytes"}));
  EXPECT_TRUE(contains(two("[0, 8]", "[16, 8]", 16), {"[16, 8] lie outside"}));
  EXPECT_TRUE(contains(tensors_refusal(R"({"a": {"dtype": "F32", "shape": [1], "data_offsets": [0, 4]}, "a": 1})", 4),
                       {"duplicate key 'a'"}));
}

}  // namespace
}  // namespace giga::test
