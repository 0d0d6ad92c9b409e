// Nearest names by edit distance.
#include "config/names.hpp"

#include <algorithm>
#include <cctype>

namespace giga {

int edit_distance(std::string_view a, std::string_view b) {
  // Three rows of the table of distances between prefixes (optimal string alignment).
  const size_t n = b.size();
  std::vector<int> before(n + 1), last(n + 1), row(n + 1);
  for (size_t k = 0; k <= n; ++k) last[k] = static_cast<int>(k);
  for (size_t i = 1; i <= a.size(); ++i) {
    row[0] = static_cast<int>(i);
    for (size_t k = 1; k <= n; ++k) {
      const int replace = last[k - 1] + (a[i - 1] == b[k - 1] ? 0 : 1);
      row[k] = std::min({last[k] + 1, row[k - 1] + 1, replace});
      const bool swapped = i > 1 && k > 1 && a[i - 1] == b[k - 2] && a[i - 2] == b[k - 1];
      if (swapped) row[k] = std::min(row[k], before[k - 2] + 1);
    }
    before.swap(last);
    last.swap(row);
  }
  return last[n];
}

namespace {

/// "learning_rate" = "lr".
std::string initials(std::string_view name) {
  std::string letters;
  for (size_t k = 0; k < name.size(); ++k)
    if (k == 0 || name[k - 1] == '_') letters += name[k];
  return letters;
}

}  // namespace

int name_distance(std::string_view name, std::string_view known) {
  const int distance = edit_distance(name, known);
  if (name.size() >= 2 && initials(known) == name) return std::min(distance, 1);
  // A part of the name counts as near: `worlds` for `n_worlds`.
  const bool part = name.size() >= 4 && known.find(name) != std::string_view::npos;
  return part ? std::min(distance, 2) : distance;
}

std::vector<std::string> nearest_names(std::string_view name, const std::vector<std::string>& known, size_t limit) {
  name = name.substr(0, 100);  // nothing known is longer
  std::vector<std::pair<int, std::string>> ranked;
  const size_t dashes = std::min(name.find_first_not_of('-'), name.size());  // those of an option say nothing
  const int far = std::max<int>(2, static_cast<int>(name.size() - dashes) / 2);
  for (const std::string& candidate : known) {
    const int distance = name_distance(name, candidate);
    if (distance <= far) ranked.emplace_back(distance, candidate);
  }
  std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::string> names;
  for (size_t k = 0; k < ranked.size() && k < limit; ++k) names.push_back(ranked[k].second);
  return names;
}

std::string nearest_hint(std::string_view name, const std::vector<std::string>& known, size_t limit) {
  std::vector<std::string> names = nearest_names(name, known, limit);
  if (names.empty()) return "";
  for (std::string& near : names) near = "'" + near + "'";
  return "; nearest: " + join(names);
}

std::string join(const std::vector<std::string>& parts, std::string_view separator) {
  std::string text;
  for (size_t k = 0; k < parts.size(); ++k) {
    if (k) text += separator;
    text += parts[k];
  }
  return text;
}

std::string capitalised(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

}  // namespace giga
