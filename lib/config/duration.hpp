// Duration: a time in YAML as people write it, `90s`, `45m`, `3h30m`, `2d`.
#pragma once

#include <string>

#include "config/fields.hpp"

namespace giga {

struct Duration {
  double seconds = 0;
};

template <>
struct FieldCodec<Duration> {
  static bool read(const Node& node, Duration& value, const Allowed& allowed, const ReadSite& site);
  static std::string print(const Duration& value);
  static std::string expected(const Allowed&) { return "a duration, as 90s, 45m, 3h30m or 2d"; }
  static ValueShape shape(const Allowed&) { return {ValueShape::Kind::duration}; }
};

/// What a duration looks like, as a regular expression (for the schema).
constexpr const char* kDurationPattern = "^(?=.)([0-9]+d)?([0-9]+h)?([0-9]+m)?([0-9]+s)?$";

}  // namespace giga
