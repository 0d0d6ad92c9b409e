// Bars of line characters, or of = and - in ASCII.
#include "io/terminal/bar.hpp"

#include <cmath>

namespace giga {

void add_bar(Line& to, double share, int n, TerminalStyle style) {
  const int filled = static_cast<int>(share * n);
  const auto repeat = [](const char* text, int count) {
    std::string all;
    for (int k = 0; k < count; ++k) all += text;
    return all;
  };
  to.add(repeat(style.unicode ? "\u2501" : "=", filled));
  to.add(repeat(style.unicode ? "\u2500" : "-", n - filled), Ink::dim);
}

std::string print_percent_done(double share) { return std::to_string(std::lround(std::floor(share * 100))) + "%"; }

}  // namespace giga
