#include "apps/changed_settings.hpp"

#include <iostream>

#include "config/names.hpp"
#include "core/error.hpp"
#include "learn/registry.hpp"

namespace giga {

std::string changed_settings(const std::vector<SettingChange>& changes) {
  constexpr size_t kMost = 5;
  const auto shown_value = [](const std::string& value) { return value.empty() ? "none" : value; };
  std::vector<std::string> texts;
  for (const SettingChange& c : changes) {
    if (texts.size() == kMost) break;
    texts.push_back(cat(c.path, ": ", shown_value(c.before), " there, ", shown_value(c.after), " now"));
  }
  if (changes.size() > kMost) texts.push_back(cat(changes.size() - kMost, " more"));
  return join(texts, "; ");
}

void warn_of_unread(const std::vector<std::string>& overrides, const std::string& algorithm) {
  for (const std::string& assignment : overrides)
    if (const std::string key = assignment.substr(0, assignment.find('=')); !reads_setting(algorithm, key))
      std::cerr << "warning: --set " << key << ": this means nothing with train.algorithm " << algorithm << '\n';
}

}  // namespace giga
