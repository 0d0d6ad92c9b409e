// How scalars of a field list are read and printed, and how limits are told.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>

#include "config/fields.hpp"
#include "config/names.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

/// A number for people: 0.95, 1e-05, 300000000.
std::string number_text(double value) {
  char buffer[64];
  const auto result = std::to_chars(buffer, buffer + sizeof buffer, value);
  std::string text(buffer, result.ptr);
  // A limit such as 1e+09 reads better in full.
  if (std::abs(value) < 1e15 && value == std::floor(value)) {
    const auto whole = std::to_chars(buffer, buffer + sizeof buffer, static_cast<int64_t>(value));
    text.assign(buffer, whole.ptr);
  }
  return text;
}

/// The digits of a plain scalar without a leading plus and without the underscores between digits; nothing if the text
/// cannot be a number.
std::optional<std::string> digits_of(const Node& node) {
  if (!node.is_scalar() || node.quoted || node.text.empty()) return std::nullopt;
  const std::string& text = node.text;
  const auto digit = [&](size_t k) { return k < text.size() && text[k] >= '0' && text[k] <= '9'; };
  std::string digits;
  for (size_t k = text[0] == '+' ? 1 : 0; k < text.size(); ++k) {
    if (text[k] == '_') {
      if (k == 0 || !digit(k - 1) || !digit(k + 1)) return std::nullopt;
    } else {
      digits += text[k];
    }
  }
  if (digits.empty() || digits[0] == '+' || (text[0] == '+' && digits[0] == '-')) return std::nullopt;
  return digits;
}

/// What became of a text that should be a number: one, one that the type cannot hold, one that is not finite, or none.
enum class Reading : uint8_t { number, too_wide, not_finite, none };

/// Reads the whole text as a T.
template <class T>
Reading parse_whole(const std::string& text, T& value) {
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ptr != text.data() + text.size()) return Reading::none;
  if (result.ec == std::errc::result_out_of_range) return Reading::too_wide;
  return result.ec == std::errc() ? Reading::number : Reading::none;
}

/// "3e8" or "1.5E+3" as the digits that they stand for; none of what is written in another way, or is no integer.
std::optional<std::string> written_out(const std::string& text) {
  const size_t e = text.find_first_of("eE");
  if (e == std::string::npos) return std::nullopt;
  std::string digits = text.substr(0, e), power = text.substr(e + 1);
  if (digits.find_first_of("0123456789") == std::string::npos) return std::nullopt;
  if (power.starts_with('+')) power.erase(0, 1);
  int exponent = 0;
  constexpr int kMost = 40;  // more than any integer has
  if (parse_whole(power, exponent) != Reading::number || exponent < 0 || exponent > kMost) return std::nullopt;
  const size_t point = digits.find('.');
  size_t behind = 0;
  if (point != std::string::npos) {
    behind = digits.size() - point - 1;
    digits.erase(point, 1);
  }
  if (behind > static_cast<size_t>(exponent)) return std::nullopt;
  return digits.append(static_cast<size_t>(exponent) - behind, '0');
}

template <class T>
Reading read_integer(const Node& node, T& value) {
  const std::optional<std::string> digits = digits_of(node);
  if (!digits) return Reading::none;
  if (parse_whole(*digits, value) == Reading::number) return Reading::number;
  if (const std::optional<std::string> all = written_out(*digits))
    if (const Reading reading = parse_whole(*all, value); reading != Reading::none) return reading;
  // 12.0 and the like, as far as a double holds every integer.
  constexpr double kExact = 9007199254740992.0;
  double number = 0;
  if (parse_whole(*digits, number) != Reading::number || number != std::floor(number)) return Reading::none;
  const bool held = std::abs(number) <= kExact && number >= static_cast<double>(std::numeric_limits<T>::min()) &&
                    number <= static_cast<double>(std::numeric_limits<T>::max());
  if (!held) return Reading::too_wide;
  value = static_cast<T>(number);
  return Reading::number;
}

template <class T>
Reading read_real(const Node& node, T& value, const Allowed& allowed) {
  const std::optional<std::string> digits = digits_of(node);
  if (!digits) return Reading::none;
  std::string text = *digits;
  if (text.starts_with(".inf") || text.starts_with("-.inf") || text == ".nan") text.erase(text.find('.'), 1);
  const Reading reading = parse_whole(text, value);
  if (reading != Reading::number || std::isfinite(value)) return reading;
  return std::isinf(value) && allowed.infinity ? Reading::number : Reading::not_finite;
}

/// The limits of an integer together with those of its type.
template <class T>
Allowed limits_of_type(const Allowed& allowed) {
  Allowed result = allowed;
  result.lo = std::max(allowed.lo, static_cast<double>(std::numeric_limits<T>::min()));
  result.hi = std::min(allowed.hi, static_cast<double>(std::numeric_limits<T>::max()));
  return result;
}

/// What is expected where a number was given that the type cannot hold.
template <class T>
std::string expected_that_fits(const Allowed& allowed) {
  if constexpr (std::is_integral_v<T>) {
    const Allowed limits = limits_of_type<T>(allowed);
    if (limits.hi == allowed.hi) return "an integer" + limits.limits_text();
    // In full: a double would round the largest of 64 bits.
    return cat("an integer in [", number_text(limits.lo), ", ", std::numeric_limits<T>::max(), "]");
  }
  return cat("a number of ", 8 * sizeof(T), " bits", allowed.limits_text());
}

std::string print_real(auto value) {
  if (std::isinf(value)) return value < 0 ? "-.inf" : ".inf";
  if (std::isnan(value)) return ".nan";
  char buffer[64];
  const auto result = std::to_chars(buffer, buffer + sizeof buffer, value);
  return std::string(buffer, result.ptr);
}

}  // namespace

std::optional<double> plain_number(const std::string& text) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = text;
  double value = 0;
  return read_real(node, value, Allowed{}) == Reading::number ? std::optional(value) : std::nullopt;
}

std::string ValueShape::type() const {
  switch (kind) {
    case Kind::boolean:
      return "bool";
    case Kind::integer:
      return "int";
    case Kind::real:
      return "float";
    case Kind::text:
      return allowed.choices.empty() ? "text" : "name";
    case Kind::duration:
      return "duration";
    case Kind::none:
      return "none";
    case Kind::list:
      return "list of " + parts.at(0).type();
    case Kind::either:
      break;
  }
  std::vector<std::string> types;
  for (const ValueShape& part : parts)
    if (std::find(types.begin(), types.end(), part.type()) == types.end()) types.push_back(part.type());
  return join(types, " or ");
}

Allowed Allowed::below(double limit) const {
  Allowed result = *this;
  result.hi = limit;
  result.hi_open = true;
  return result;
}

Allowed Allowed::at_most(double limit) const {
  Allowed result = *this;
  result.hi = limit;
  result.hi_open = false;
  return result;
}

Allowed Allowed::or_infinity() const {
  Allowed result = *this;
  result.infinity = true;
  return result;
}

Allowed Allowed::items(size_t least, size_t most) const {
  Allowed result = *this;
  result.min_items = least;
  result.max_items = most;
  return result;
}

bool Allowed::contains(double value) const {
  return (lo_open ? value > lo : value >= lo) && (hi_open ? value < hi : value <= hi);
}

std::string Allowed::limits_text() const {
  const bool has_lo = !std::isinf(lo), has_hi = !std::isinf(hi);
  std::string text;
  if (has_lo && has_hi)
    text = (lo_open ? " in (" : " in [") + number_text(lo) + ", " + number_text(hi) + (hi_open ? ")" : "]");
  else if (has_lo)
    text = (lo_open ? " > " : " >= ") + number_text(lo);
  else if (has_hi)
    text = (hi_open ? " < " : " <= ") + number_text(hi);
  return infinity ? text + " or inf" : text;
}

Allowed anything() { return {}; }

Allowed at_least(double lo) {
  Allowed allowed;
  allowed.lo = lo;
  return allowed;
}

Allowed greater_than(double lo) {
  Allowed allowed = at_least(lo);
  allowed.lo_open = true;
  return allowed;
}

Allowed range(double lo, double hi) { return at_least(lo).at_most(hi); }

Allowed one_of(std::vector<std::string> choices) {
  Allowed allowed;
  allowed.choices = std::move(choices);
  return allowed;
}

namespace {

/// How "400k" and the like are written.
std::string without_suffix(const Node& node) {
  constexpr std::string_view kSuffixes = "kMG";
  const size_t power = !node.is_scalar() || node.text.empty() ? kSuffixes.npos : kSuffixes.find(node.text.back());
  if (power == kSuffixes.npos) return "";
  const char* end = node.text.data() + node.text.size() - 1;
  double number = 0;
  const auto read = std::from_chars(node.text.data(), end, number);
  if (read.ec != std::errc() || read.ptr != end || !(std::abs(number) <= 1e6)) return "";
  const double meant = number * std::pow(1e3, static_cast<double>(power + 1));
  return cat(" (numbers have no suffix: ", std::llround(meant), ")");
}

}  // namespace

bool ReadSite::fail(const Node& node, const std::string& expected) const {
  errors.add(node.at, path + ": " + node.shown() + " is not " + expected + alternative + without_suffix(node));
  return false;
}

bool is_none(const Node& node) { return node.is_null() || (node.is_scalar() && !node.quoted && node.text == "none"); }

std::string expected_choice(const std::vector<std::string>& names) { return "one of: " + join(names); }

int read_choice(const Node& node, const std::vector<std::string>& names, const ReadSite& site,
                const std::vector<RenamedChoice>& renamed) {
  for (size_t k = 0; k < names.size(); ++k)
    if (node.is_scalar() && node.text == names[k]) return static_cast<int>(k);
  for (const RenamedChoice& r : renamed) {
    if (!node.is_scalar() || node.text != r.before) continue;
    site.errors.add(node.at, cat(site.path, ": '", r.before, "' is now called '", r.now, "'"));
    return -1;
  }
  site.fail(node, expected_choice(names) + (node.is_scalar() ? nearest_hint(node.text, names) : ""));
  return -1;
}

std::string expected_list(const Allowed& allowed, const std::string& item) {
  const std::string least = std::to_string(allowed.min_items), most = std::to_string(allowed.max_items);
  std::string count;
  if (allowed.min_items == allowed.max_items)
    count = " of " + least + " items";
  else if (allowed.max_items != std::numeric_limits<size_t>::max())
    count = " of " + least + " to " + most + " items";
  else if (allowed.min_items > 0)
    count = " of at least " + least + (allowed.min_items == 1 ? " item" : " items");
  return "a list" + count + ", each " + item;
}

bool read_list_shape(const Node& node, const Allowed& allowed, const std::string& expected, const ReadSite& site) {
  if (!node.is_sequence()) {
    // A list without its brackets: "64, 64"; not where brackets alone would not do.
    const auto n_parts = static_cast<size_t>(std::count(node.text.begin(), node.text.end(), ',')) + 1;
    const bool bare = node.is_scalar() && !node.text.empty() &&
                      node.text.find_first_of("[]{}\n") == std::string::npos && n_parts >= allowed.min_items &&
                      n_parts <= allowed.max_items;
    return site.fail(node, expected + (bare ? "; write [" + node.text + "]" : ""));
  }
  const size_t n = node.items.size();
  if (n >= allowed.min_items && n <= allowed.max_items) return true;
  site.errors.add(node.at,
                  cat(site.path, ": has ", counted(static_cast<int64_t>(n), "items"), ", expected ", expected));
  return false;
}

template <class T>
bool ScalarCodec<T>::read(const Node& node, T& value, const Allowed& allowed, const ReadSite& site) {
  if constexpr (std::is_same_v<T, std::string>) {
    if (!allowed.choices.empty()) {
      const int index = read_choice(node, allowed.choices, site);
      if (index >= 0) value = allowed.choices[static_cast<size_t>(index)];
      return index >= 0;
    }
    if (!node.is_scalar()) return site.fail(node, expected(allowed));
    value = node.text;
  } else if constexpr (std::is_same_v<T, bool>) {
    const bool usable = node.is_scalar() && !node.quoted && (node.text == "true" || node.text == "false");
    if (!usable) return site.fail(node, expected(allowed));
    value = node.text == "true";
  } else {
    T number{};
    Reading reading;
    if constexpr (std::is_integral_v<T>)
      reading = read_integer(node, number);
    else
      reading = read_real(node, number, allowed);
    double as_real = static_cast<double>(number);
    if constexpr (std::is_floating_point_v<T>)  // a limit itself: 6.3 is a little less than what 32 bits make of it
      for (const double limit : {allowed.lo, allowed.hi})
        if (number == static_cast<T>(limit)) as_real = limit;
    if (reading == Reading::not_finite) return site.fail(node, "a finite number" + allowed.limits_text());
    if (reading == Reading::too_wide) return site.fail(node, expected_that_fits<T>(allowed));
    if (reading != Reading::number || (std::isfinite(as_real) && !allowed.contains(as_real)))
      return site.fail(node, expected(allowed));
    value = number;
  }
  return true;
}

template <class T>
std::string ScalarCodec<T>::print(const T& value) {
  if constexpr (std::is_same_v<T, std::string>)
    return print_text(value);
  else if constexpr (std::is_same_v<T, bool>)
    return value ? "true" : "false";
  else if constexpr (std::is_integral_v<T>)
    return std::to_string(value);
  else
    return print_real(value);
}

template <class T>
ValueShape ScalarCodec<T>::shape(const Allowed& allowed) {
  if constexpr (std::is_same_v<T, std::string>) return {ValueShape::Kind::text, allowed};
  if constexpr (std::is_same_v<T, bool>) return {ValueShape::Kind::boolean};
  if constexpr (std::is_integral_v<T>) return {ValueShape::Kind::integer, limits_of_type<T>(allowed)};
  return {ValueShape::Kind::real, allowed};
}

template <class T>
std::string ScalarCodec<T>::expected(const Allowed& allowed) {
  if constexpr (std::is_same_v<T, std::string>)
    return allowed.choices.empty() ? "a text" : expected_choice(allowed.choices);
  if constexpr (std::is_same_v<T, bool>) return "true or false";
  // The limit 0 is always told; the largest number of a type only where somebody exceeds it.
  if constexpr (std::is_unsigned_v<T>)
    return "an integer" + at_least(std::max(allowed.lo, 0.0)).at_most(allowed.hi).limits_text();
  return (std::is_integral_v<T> ? "an integer" : "a number") + allowed.limits_text();
}

template struct ScalarCodec<bool>;
template struct ScalarCodec<int>;
template struct ScalarCodec<int64_t>;
template struct ScalarCodec<uint64_t>;
template struct ScalarCodec<float>;
template struct ScalarCodec<double>;
template struct ScalarCodec<std::string>;

}  // namespace giga
