#include "learn/registry.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "core/error.hpp"
#include "learn/run_config.hpp"

namespace giga {

const std::vector<const Algorithm*>& algorithms() {
  static const std::vector<const Algorithm*> all = Algorithms::descriptions();
  return all;
}

std::vector<std::string> algorithm_names() {
  std::vector<std::string> names;
  for (const Algorithm* a : algorithms()) names.emplace_back(a->name);
  return names;
}

const Algorithm* find_algorithm(const std::string& name) {
  const auto found = std::find_if(algorithms().begin(), algorithms().end(), [&](auto* a) { return a->name == name; });
  return found == algorithms().end() ? nullptr : *found;
}

bool reads_setting(const std::string& algorithm, std::string_view key) {
  const Algorithm* found = find_algorithm(algorithm);
  return !found || std::none_of(found->unread.begin(), found->unread.end(), [key](std::string_view unread) {
    return key == unread || (unread.ends_with('.') && key.starts_with(unread));
  });
}

const Algorithm& algorithm_of(const RunConfig& config) {
  const std::string& name = config.train.algorithm;
  if (const Algorithm* found = find_algorithm(name)) return *found;
  throw InputError(cat("train.algorithm: '", name, "' is not one of: ", join(algorithm_names())));
}

}  // namespace giga
