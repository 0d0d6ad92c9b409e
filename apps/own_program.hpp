// own_program: where this program lies, for processes that are to run it again.
#pragma once

#include <string>

namespace giga {

/// A path that exec takes, by whose last part `ps` and `top` name the process: the program's own, or /proc/self/exe
/// where that has been replaced or removed meanwhile.
std::string own_program();

}  // namespace giga
