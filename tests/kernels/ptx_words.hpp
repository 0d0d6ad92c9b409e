// What those who know instructions of PTX share: names by their parts, types, numbers of half precision.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <initializer_list>
#include <iterator>
#include <string>
#include <vector>

#include "kernels/ptx_operations.hpp"

namespace giga::test {

using Words = std::vector<std::string>;
using Operands = std::vector<PtxOperand>;
using Operation = std::function<void(PtxThread&)>;

/// Whether a part of the name is this one.
inline bool has(const Words& words, const char* word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

[[noreturn]] inline void refuse(const Words& words) {
  std::string name;
  for (const std::string& word : words) name += (name.empty() ? "" : ".") + word;
  throw Error("no PTX instruction that is known here: " + name);
}

inline float from_half(uint16_t bits) { return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(bits)); }
inline uint16_t to_half(float x) { return Eigen::numext::bit_cast<uint16_t>(static_cast<Eigen::half>(x)); }
/// What is too large becomes the largest.
inline uint16_t to_half_held(float x) {
  const uint16_t bits = to_half(x);
  return (bits & 0x7FFF) == 0x7C00 ? static_cast<uint16_t>((bits & 0x8000) | 0x7BFF) : bits;
}
inline uint16_t part(uint32_t pair, int which) { return static_cast<uint16_t>(pair >> (16 * which)); }
inline uint32_t pair_of(uint16_t low, uint16_t high) { return low | static_cast<uint32_t>(high) << 16; }

/// Refuses what has another part of its name than the first, these and types.
inline void allow(const Words& words, std::initializer_list<const char*> known) {
  constexpr const char* kTypes[] = {"f32", "f64", "f16", "f16x2", "s8",  "u8",  "b8",  "s16", "u16",
                                    "b16", "s32", "u32", "b32",   "s64", "u64", "b64", "pred"};
  for (size_t k = 1; k < words.size(); ++k) {
    const auto is = [&](const char* word) { return words[k] == word; };
    if (std::none_of(std::begin(kTypes), std::end(kTypes), is) && std::none_of(known.begin(), known.end(), is))
      refuse(words);
  }
}
/// Refuses another number of operands.
inline void expect_operands(const Words& words, const Operands& operands, size_t count) {
  if (operands.size() != count) refuse(words);
}

/// f<T>() for the type that a word names.
template <class F>
Operation with_type(const Words& words, const std::string& name, F&& f) {
  if (name == "f32") return f.template operator()<float>();
  if (name == "f64") return f.template operator()<double>();
  if (name == "s32") return f.template operator()<int32_t>();
  if (name == "u32" || name == "b32") return f.template operator()<uint32_t>();
  if (name == "s64") return f.template operator()<int64_t>();
  if (name == "u64" || name == "b64") return f.template operator()<uint64_t>();
  if (name == "s16") return f.template operator()<int16_t>();
  if (name == "u16" || name == "b16") return f.template operator()<uint16_t>();
  if (name == "u8" || name == "b8") return f.template operator()<uint8_t>();
  if (name == "pred") return f.template operator()<bool>();
  refuse(words);
}

/// Those of arithmetic: all that compute registers from registers of one type (ptx_arithmetic.cpp).
Operation ptx_arithmetic(const Words& words, const Operands& operands);
/// Those that a warp or a block does together, up to where a thread waits for the others (ptx_warp.cpp).
bool is_warp_work(const std::string& name);
Operation ptx_warp_work(const Words& words, const Operands& operands);

}  // namespace giga::test
