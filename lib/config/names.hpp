// Nearest names: what the user may have meant by a misspelt one.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace giga {

/// Number of insertions, deletions, replacements and swaps of neighbouring characters that turn a into b.
int edit_distance(std::string_view a, std::string_view b);

/// The same, but names of which one is part of the other, or made of its first letters (`lr`), count as near.
int name_distance(std::string_view name, std::string_view known);

/// The known names that are near `name`, nearest first, at most `limit`.
std::vector<std::string> nearest_names(std::string_view name, const std::vector<std::string>& known, size_t limit = 3);

/// "; nearest: 'x'" or "; nearest: 'x', 'y'"; empty if nothing is near.
std::string nearest_hint(std::string_view name, const std::vector<std::string>& known, size_t limit = 1);

/// "a, b, c".
std::string join(const std::vector<std::string>& parts, std::string_view separator = ", ");

/// With a capital at the beginning.
std::string capitalised(std::string text);

}  // namespace giga
