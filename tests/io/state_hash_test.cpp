// state_sha256: the standard's number for what is hashed, and another one for whatever differs.
#include "io/state_hash.hpp"

#include <gtest/gtest.h>

#include <set>

namespace giga::test {
namespace {

NamedArrays two_arrays() { return {make_array<float>("a", {1, 2, 3, 4}), make_array<int32_t>("b", {5})}; }

// printf 'a\n0 1 1\n\x00\x00\x80\x3f' | sha256sum: array "a" of type f32 (0), 1 dimension of 1, the number 1.0f.
TEST(StateHash, IsSha256OfHeaderAndBytes) {
  EXPECT_EQ(state_sha256({make_array<float>("a", {1})}),
            "57ef125f98c78a308f83c6be839be7c8dfd5774722e57da95334a5cdc9c81ffc");
  // The empty text, as FIPS 180-4 and every other program have it.
  EXPECT_EQ(state_sha256({}), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(StateHash, EveryDifferenceShows) {
  std::set<std::string> hashes = {state_sha256(two_arrays())};
  const auto differs = [&](auto&& change) {
    NamedArrays arrays = two_arrays();
    change(arrays);
    return hashes.insert(state_sha256(arrays)).second;
  };
  EXPECT_FALSE(differs([](NamedArrays&) {}));
  EXPECT_TRUE(differs([](NamedArrays& a) { a[0].bytes[7] ^= 1; }));
  EXPECT_TRUE(differs([](NamedArrays& a) { a[0].name = "c"; }));
  EXPECT_TRUE(differs([](NamedArrays& a) { a[0].type = ArrayType::i32; }));
  EXPECT_TRUE(differs([](NamedArrays& a) { a[0].shape = {2, 2}; }));
  EXPECT_TRUE(differs([](NamedArrays& a) { std::swap(a[0], a[1]); }));
  EXPECT_TRUE(differs([](NamedArrays& a) { a.pop_back(); }));
}

}  // namespace
}  // namespace giga::test
