// NamedArray: an array with a name, a type and a shape, in host memory. Whatever a checkpoint keeps is a list of them.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "core/error.hpp"

namespace giga {

enum class ArrayType : uint8_t { f32, f64, i32, i64, u8 };
inline size_t size_of(ArrayType type) {
  constexpr size_t kSizes[] = {4, 8, 4, 8, 1};
  return kSizes[static_cast<size_t>(type)];
}

struct NamedArray {
  std::string name;  ///< path with slashes: "team_0/actor/parameters"
  ArrayType type = ArrayType::f32;
  std::vector<int64_t> shape;
  std::vector<uint8_t> bytes;
};

using NamedArrays = std::vector<NamedArray>;

/// "[3, 4]"
inline std::string shape_text(const std::vector<int64_t>& shape) {
  std::string text = "[";
  for (const int64_t side : shape) text += (text.size() > 1 ? ", " : "") + std::to_string(side);
  return text + "]";
}

/// Null where there is none.
inline const NamedArray* look_for_array(const NamedArrays& arrays, const std::string& name) {
  for (const NamedArray& a : arrays)
    if (a.name == name) return &a;
  return nullptr;
}

inline const NamedArray& find_array(const NamedArrays& arrays, const std::string& name) {
  if (const NamedArray* array = look_for_array(arrays, name)) return *array;
  throw InputError(
      cat("the checkpoint has no array '", name, "': it was written with other settings or by another version"));
}

template <class T>
constexpr ArrayType array_type_of() {
  if constexpr (std::is_same_v<T, float>) return ArrayType::f32;
  if constexpr (std::is_same_v<T, double>) return ArrayType::f64;
  if constexpr (std::is_same_v<T, int32_t>) return ArrayType::i32;
  if constexpr (std::is_same_v<T, int64_t>) return ArrayType::i64;
  if constexpr (std::is_same_v<T, uint8_t>) return ArrayType::u8;
}

template <class T>
NamedArray make_array(const std::string& name, const std::vector<T>& values) {
  NamedArray a{name, array_type_of<T>(), {static_cast<int64_t>(values.size())}, {}};
  a.bytes.resize(values.size() * sizeof(T));
  if (!values.empty()) std::memcpy(a.bytes.data(), values.data(), a.bytes.size());
  return a;
}

template <class T>
std::vector<T> array_values(const NamedArray& a) {
  if (a.type != array_type_of<T>()) throw InputError(cat("array '", a.name, "' has another type than expected"));
  std::vector<T> values(a.bytes.size() / sizeof(T));
  if (!values.empty()) std::memcpy(values.data(), a.bytes.data(), a.bytes.size());
  return values;
}

}  // namespace giga
