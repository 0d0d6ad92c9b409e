// The wire format of Protocol Buffers: every field is a key, field number * 8 + wire type, and a value.
#include "io/protobuf_wire.hpp"

#include <bit>

#include "core/error.hpp"
#include "core/utf8.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

enum class WireType : uint8_t { varint = 0, fixed64 = 1, length_delimited = 2, fixed32 = 5 };

/// Seven bits per byte, lowest first; the high bit says that more follow.
std::string varint_bytes(uint64_t value) {
  std::string bytes;
  for (; value >= 0x80; value >>= 7) bytes += static_cast<char>((value & 0x7F) | 0x80);
  return bytes + static_cast<char>(value);
}

std::string key(int field, WireType type) {
  GIGA_CHECK(field > 0, "field number ", field);
  return varint_bytes(static_cast<uint64_t>(field) << 3 | static_cast<uint64_t>(type));
}

}  // namespace

ProtobufMessage& ProtobufMessage::varint(int field, uint64_t value) {
  encoded_ += key(field, WireType::varint) + varint_bytes(value);
  return *this;
}

ProtobufMessage& ProtobufMessage::float32(int field, float value) {
  encoded_ += key(field, WireType::fixed32) + little_endian(std::bit_cast<uint32_t>(value));
  return *this;
}

ProtobufMessage& ProtobufMessage::float64(int field, double value) {
  encoded_ += key(field, WireType::fixed64) + little_endian(std::bit_cast<uint64_t>(value));
  return *this;
}

ProtobufMessage& ProtobufMessage::bytes(int field, std::string_view value) {
  encoded_ += key(field, WireType::length_delimited) + varint_bytes(value.size());
  encoded_ += value;
  return *this;
}

ProtobufMessage& ProtobufMessage::text(int field, std::string_view value) {
  for (size_t at = 0; at < value.size();) {
    const size_t length = utf8_length(value, at);
    GIGA_CHECK(length > 0, "a text that is not UTF-8: byte ", static_cast<int>(static_cast<unsigned char>(value[at])),
               " at ", at);
    at += length;
  }
  return bytes(field, value);
}

}  // namespace giga
