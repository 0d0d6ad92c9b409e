// Numbers as text.
#include "io/number.hpp"

#include <charconv>
#include <cmath>
#include <cstdio>

namespace giga {

std::string print_number(double value) {
  char text[32];
  constexpr double kExact = 9007199254740992.0;  // 2^53: up to here every whole number has a double of its own
  const bool whole = std::abs(value) < kExact && value == std::floor(value) && !(value == 0 && std::signbit(value));
  const std::to_chars_result end = whole ? std::to_chars(text, text + sizeof text, static_cast<int64_t>(value))
                                         : std::to_chars(text, text + sizeof text, value);
  return {text, end.ptr};
}

std::string print_short(double value) {
  static constexpr const char* kUnits[] = {"", " k", " M", " G", " T", " P"};
  int unit = 0;
  while (std::abs(value) >= 999.5 && unit < 5) {
    value /= 1000;
    ++unit;
  }
  const double size = std::abs(value);
  const int decimals = size >= 99.95 || (unit == 0 && value == std::floor(value)) ? 0 : (size >= 9.995 ? 1 : 2);
  char text[32];
  std::snprintf(text, sizeof text, "%.*f%s", decimals, value, kUnits[unit]);
  return text;
}

std::string print_share(double value) {
  if (std::isnan(value)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

std::string print_duration(double seconds) {
  if (!(seconds >= 0) || seconds > 1e8) return "-:--";
  const auto s = static_cast<int64_t>(std::llround(seconds));
  char text[32];
  if (s >= 3600) {
    std::snprintf(text, sizeof text, "%d:%02d:%02d", static_cast<int>(s / 3600), static_cast<int>(s / 60 % 60),
                  static_cast<int>(s % 60));
  } else {
    std::snprintf(text, sizeof text, "%d:%02d", static_cast<int>(s / 60), static_cast<int>(s % 60));
  }
  return text;
}

}  // namespace giga
