// Replays whose insides are changed: they unpack, so that the changes reach the header and the columns.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <string>

#include "io/replay.hpp"
#include "mutations.hpp"

namespace giga::test {

constexpr size_t kFirstLine = sizeof "gigastep replay 3\n" - 1;

inline std::string unpacked(const std::string& bytes) {
  std::string raw(1 << 17, '\0');
  uLongf size = raw.size();
  EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(raw.data()), &size,
                       reinterpret_cast<const Bytef*>(bytes.data() + kFirstLine), bytes.size() - kFirstLine),
            Z_OK);
  return raw.substr(0, size);
}

inline std::string packed(const std::string& first_line, const std::string& raw) {
  std::string out(compressBound(raw.size()), '\0');
  uLongf size = out.size();
  EXPECT_EQ(
      compress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(raw.data()), raw.size(), 1),
      Z_OK);
  return first_line + out.substr(0, size);
}

/// Replays with changed headers and changed columns, by turns; the same for the same number.
class ChangedInsides {
 public:
  explicit ChangedInsides(const Replay& replay) {
    const std::string good = encode_replay(replay);
    first_line_ = good.substr(0, kFirstLine);
    const std::string raw = unpacked(good);
    size_t header = 0;
    for (size_t byte = 0; byte < 4; ++byte)
      header |= static_cast<size_t>(static_cast<unsigned char>(raw[byte])) << 8 * byte;
    size_ = raw.substr(0, 4);
    json_ = raw.substr(4, header);
    columns_ = raw.substr(4 + header);
  }
  std::string operator()(int64_t k) const {
    Mutator mutator(static_cast<uint64_t>(k));
    if (k % 2) return packed(first_line_, size_ + json_ + mutator.bytes(columns_));
    const std::string changed = mutator.text(json_, {json_});
    std::string all;
    for (size_t byte = 0; byte < 4; ++byte) all += static_cast<char>(changed.size() >> 8 * byte & 255);
    return packed(first_line_, all + changed + columns_);
  }

 private:
  std::string first_line_, size_, json_, columns_;
};

}  // namespace giga::test
