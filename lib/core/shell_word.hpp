// shell_word: a text as a shell reads it.
#pragma once

#include <string>

namespace giga {

/// A text as one word of a shell command, in quotes where it must be.
std::string shell_word(const std::string& text);

}  // namespace giga
