// The bytes of messages, and the checksum of records.
#include "io/protobuf_wire.hpp"

#include <gtest/gtest.h>

#include "core/error.hpp"
#include "io/crc32c.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

using namespace std::string_literals;

TEST(Crc32c, PublishedVectors) {
  EXPECT_EQ(crc32c(""), 0u);
  EXPECT_EQ(crc32c("123456789"), 0xE3069283u);
  // RFC 3720, B.4, which prints the bytes lowest first: aa 36 91 8a and 43 ab a8 62.
  EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8A9136AAu);
  EXPECT_EQ(crc32c(std::string(32, '\xff')), 0x62A8AB43u);
}

TEST(ProtobufMessage, Varints) {
  // 150 = 1 * 128 + 22: 22 with the high bit, then 1. The key is field 1 * 8 + type 0.
  EXPECT_EQ(ProtobufMessage().varint(1, 150).encoded(), "\x08\x96\x01"s);
  EXPECT_EQ(ProtobufMessage().varint(1, 0).encoded(), "\x08\x00"s);
  EXPECT_EQ(ProtobufMessage().varint(1, 127).encoded(), "\x08\x7f"s);
  EXPECT_EQ(ProtobufMessage().varint(1, 128).encoded(), "\x08\x80\x01"s);
  // 64 ones: nine times seven of them, and one.
  EXPECT_EQ(ProtobufMessage().varint(1, static_cast<uint64_t>(int64_t{-1})).encoded(),
            "\x08\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01"s);
  // From field 16 on the key has two bytes: 16 * 8 = 128.
  EXPECT_EQ(ProtobufMessage().varint(16, 1).encoded(), "\x80\x01\x01"s);
}

TEST(ProtobufMessage, Numbers) {
  // Field 2 * 8 + 5; 1 = exponent 127 of 8 bits. Field 3 * 8 + 1; -2 = sign, exponent 1024 of 11 bits.
  EXPECT_EQ(ProtobufMessage().float32(2, 1.0f).encoded(), "\x15\x00\x00\x80\x3f"s);
  EXPECT_EQ(ProtobufMessage().float64(3, -2.0).encoded(), "\x19\x00\x00\x00\x00\x00\x00\x00\xc0"s);
}

TEST(ProtobufMessage, TextsAndMessages) {
  // Field 2 * 8 + 2, then the length.
  EXPECT_EQ(ProtobufMessage().text(2, "testing").encoded(), "\x12\x07testing"s);
  EXPECT_EQ(ProtobufMessage().bytes(2, "\xff\0"s).encoded(), "\x12\x02\xff\x00"s);
  EXPECT_EQ(ProtobufMessage().message(3, ProtobufMessage().varint(1, 150)).encoded(), "\x1a\x03\x08\x96\x01"s);
  EXPECT_EQ(ProtobufMessage().message(3, ProtobufMessage()).encoded(), "\x1a\x00"s);
  EXPECT_EQ(ProtobufMessage().text(1, std::string(200, 'x')).encoded(), "\x0a\xc8\x01"s + std::string(200, 'x'));
}

TEST(ProtobufMessage, ATextMustBeUtf8) {
  EXPECT_EQ(ProtobufMessage().text(1, "\xC3\xA4").encoded(), "\x0a\x02\xC3\xA4"s);
  try {
    ProtobufMessage().text(1, "a\xC3");
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_TRUE(contains(e.what(), {"not UTF-8: byte 195 at 1"}));
  }
}

}  // namespace
}  // namespace giga::test
