#include "apps/changed_settings.hpp"

#include "config/names.hpp"
#include "core/error.hpp"

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

}  // namespace giga
