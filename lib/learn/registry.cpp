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

bool is_run_time_setting(std::string_view key) {
  constexpr std::array kKeys = {"seed",
                                "device",
                                "train.n_threads",
                                "train.max_wall_time",
                                "train.stop_at_agent_steps",
                                "train.compile_step",
                                "train.pairs",
                                "mappo.graphs",
                                "eval.record"};
  return key.starts_with("checkpoint.") || std::find(kKeys.begin(), kKeys.end(), key) != kKeys.end();
}

Settings game_settings(const Node& scenario, std::string (*print)(const Node&)) {
  Settings settings = flatten(scenario, print);
  std::erase_if(settings, [](const auto& entry) {
    return entry.first == "description" || entry.first.ends_with(".description");
  });
  return settings;
}

const Algorithm& algorithm_of(const RunConfig& config) {
  const std::string& name = config.train.algorithm;
  if (const Algorithm* found = find_algorithm(name)) return *found;
  throw InputError(cat("train.algorithm: '", name, "' is not one of: ", join(algorithm_names())));
}

}  // namespace giga
