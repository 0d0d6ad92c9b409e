// Fnv1a: a number that tells sequences of bytes apart (FNV-1a of 64 bits; Fowler, Noll and Vo 1991).
#pragma once

#include <cstdint>

namespace giga {

class Fnv1a {
 public:
  void add(unsigned char byte) { value_ = (value_ ^ byte) * 0x100000001B3u; }
  /// All of a container of bytes or of characters.
  template <class Bytes>
  void add_all(const Bytes& bytes) {
    for (const auto byte : bytes) add(static_cast<unsigned char>(byte));
  }
  uint64_t value() const { return value_; }

 private:
  uint64_t value_ = 0xCBF29CE484222325u;
};

}  // namespace giga
