// Numbers as text: the shortest text that reads back to the same number, and figures for people.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace giga {

/// The shortest text that reads back to the same value; whole numbers below 2^53 without exponent. "nan", "inf".
std::string print_number(double value);

/// 3 significant digits with a unit: 12345678 = "12.3 M", 950 = "950".
std::string print_short(double value);

/// A share with 2 decimals; "-" for NaN.
std::string print_share(double value);

/// Seconds as 1:02:03 or 2:03; "-:--" where not known.
std::string print_duration(double seconds);

}  // namespace giga
