// The bar of a panel: how much of something is done.
#pragma once

#include <string>

#include "io/terminal/line.hpp"

namespace giga {

/// Adds a bar of `n` columns, of which a `share` (0 to 1, rounded down) is filled.
void add_bar(Line& to, double share, int n, TerminalStyle style);

/// "50%", rounded down, so that 100% says that it is done.
std::string print_percent_done(double share);

}  // namespace giga
