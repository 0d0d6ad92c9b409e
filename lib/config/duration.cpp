// Durations as text: whole numbers with the units d, h, m, s, each at most once and in this order.
#include "config/duration.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <utility>

namespace giga {
namespace {

constexpr std::array<std::pair<char, int64_t>, 4> kUnits = {{{'d', 86400}, {'h', 3600}, {'m', 60}, {'s', 1}}};
constexpr int64_t kMostSeconds = int64_t{1} << 40;

/// -1 where the text is no duration above zero.
int64_t parse_seconds(const std::string& text) {
  const char* at = text.data();
  const char* const end = at + text.size();
  int64_t total = 0;
  size_t unit = 0;
  while (at != end) {
    int64_t count = 0;
    const auto [stop, code] = std::from_chars(at, end, count);
    if (code != std::errc() || stop == end || *at == '-') return -1;
    while (unit < kUnits.size() && kUnits[unit].first != *stop) ++unit;
    if (unit == kUnits.size() || count > kMostSeconds / kUnits[unit].second) return -1;
    total += count * kUnits[unit++].second;
    at = stop + 1;
  }
  return total > 0 ? total : -1;
}

}  // namespace

bool FieldCodec<Duration>::read(const Node& node, Duration& value, const Allowed& allowed, const ReadSite& site) {
  const int64_t seconds = node.is_scalar() ? parse_seconds(node.text) : -1;
  if (seconds < 0) return site.fail(node, expected(allowed));
  value.seconds = static_cast<double>(seconds);
  return true;
}

std::string FieldCodec<Duration>::print(const Duration& value) {
  auto left = static_cast<int64_t>(std::llround(value.seconds));
  std::string text;
  for (const auto& [unit, seconds] : kUnits) {
    if (left / seconds > 0) text += std::to_string(left / seconds) + unit;
    left %= seconds;
  }
  return text.empty() ? "0s" : text;
}

}  // namespace giga
