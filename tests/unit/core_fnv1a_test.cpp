// Fnv1a against the test vectors of its authors.
#include "core/fnv1a.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace giga::test {
namespace {

TEST(Fnv1a, HasTheValuesOfItsAuthors) {
  const auto of = [](const auto& bytes) {
    Fnv1a hash;
    hash.add_all(bytes);
    return hash.value();
  };
  EXPECT_EQ(of(std::string()), 0xCBF29CE484222325u);
  EXPECT_EQ(of(std::string("a")), 0xAF63DC4C8601EC8Cu);
  EXPECT_EQ(of(std::string("foobar")), 0x85944171F73967E8u);
  EXPECT_EQ(of(std::vector<uint8_t>{'a'}), of(std::string("a")));
  EXPECT_NE(of(std::string("\xC3")), of(std::string("C"))) << "characters are bytes, whatever their sign";
}

}  // namespace
}  // namespace giga::test
