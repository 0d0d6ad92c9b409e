// ProtobufMessage: a message in the wire format of Protocol Buffers, built field by field.
//
// libprotobuf is not used: libtorch_cpu.so exports the symbols of its own copy, and the system's library would be a
// second version in the same program. The few messages that we write need four kinds of fields.
#pragma once

#include <concepts>
#include <cstdint>
#include <string>
#include <string_view>

namespace giga {

/// The bytes of an integer, lowest first, whatever the machine's own order is.
template <std::unsigned_integral T>
std::string little_endian(T value) {
  std::string bytes;
  for (size_t k = 0; k < sizeof value; ++k) bytes += static_cast<char>(static_cast<uint64_t>(value) >> (8 * k) & 0xFF);
  return bytes;
}

/// Each call adds the field of that number; a repeated field is added several times. Number and kind are those of the
/// .proto file.
class ProtobufMessage {
 public:
  /// bool, enum, uint64; int32 and int64 as static_cast<uint64_t>.
  ProtobufMessage& varint(int field, uint64_t value);
  /// float.
  ProtobufMessage& float32(int field, float value);
  /// double.
  ProtobufMessage& float64(int field, double value);
  /// bytes.
  ProtobufMessage& bytes(int field, std::string_view value);
  /// string: throws Error for what is not UTF-8, because readers refuse the whole message.
  ProtobufMessage& text(int field, std::string_view value);
  /// A message inside this one.
  ProtobufMessage& message(int field, const ProtobufMessage& value) { return bytes(field, value.encoded_); }

  const std::string& encoded() const { return encoded_; }

 private:
  std::string encoded_;
};

}  // namespace giga
