// Json: a value to be written as JSON, for run.json and every `--json`. Objects keep the order of insertion.
#pragma once

#include <concepts>
#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace giga {

struct Node;

class Json {
 public:
  Json() = default;  ///< null
  Json(bool value) : value_(value) {}
  template <std::integral T>
  Json(T value) : value_(std::in_place_type<Integer>, Integer{value < T{0}, static_cast<uint64_t>(value)}) {}
  Json(double value) : value_(value) {}  ///< NaN and infinity, which JSON does not have, become null
  Json(std::string value) : value_(std::move(value)) {}
  Json(const char* value) : value_(std::string(value)) {}

  static Json object();
  static Json array();
  /// An array of such values.
  template <class T>
  static Json array(const std::vector<T>& values) {
    Json list = array();
    for (const T& value : values) list.push(value);
    return list;
  }

  /// Adds a member to an object.
  Json& set(std::string key, Json value);
  /// Adds an item to an array.
  Json& push(Json value);

  /// Indented by two spaces, arrays of numbers on one line; numbers read back to the same value. Ends without newline.
  std::string text() const;

 private:
  struct Integer {
    bool negative;
    uint64_t bits;
  };
  using Array = std::vector<Json>;
  using Object = std::vector<std::pair<std::string, Json>>;

  bool is_container() const;
  void print(std::string& out, int depth) const;

  std::variant<std::monostate, bool, Integer, double, std::string, Array, Object> value_;
};

/// A document that was read as JSON.
Json json_of(const Node& node);

/// Writes to a file, or to the standard output where `destination` is "-".
void write_json(const Json& json, const std::string& destination);

}  // namespace giga
