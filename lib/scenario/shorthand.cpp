// One table of suffixes and what each sets.
#include "scenario/shorthand.hpp"

#include <array>

#include "config/names.hpp"

namespace giga {
namespace {

struct Suffix {
  const char* name;
  void (*apply)(Scenario&);
};

/// Pairs in the order in which they stand in a name.
const std::array<std::array<Suffix, 2>, 4> kSuffixes = {{
    {{{"fobs",
       [](Scenario& s) {
         s.sight.use_stochastic_obs = false;
         s.communication.use_stochastic_comm = false;
         s.sight.cone_depth = 100;
         s.sight.cone_angle = 2 * kPi;
         s.rewards[RewardTerm::detection] = 0;
       }},
      {"pobs", [](Scenario&) {}}}},
    {{{"rgb", [](Scenario& s) { s.observation.type = ObservationType::rgb; }},
      {"vec", [](Scenario& s) { s.observation.type = ObservationType::vector; }}}},
    {{{"maps", [](Scenario& s) { s.maps = MapSelection::all(); }},
      {"void", [](Scenario& s) { s.maps = MapSelection::empty(); }}}},
    {{{"cont", [](Scenario& s) { s.action = ActionKind::continuous; }},
      {"disc", [](Scenario& s) { s.action = ActionKind::discrete; }}}},
}};

}  // namespace

std::vector<ShortName> split_name(std::string_view name) {
  std::vector<ShortName> readings = {{std::string(name), {}}};
  for (size_t place = kSuffixes.size(); place-- > 0;) {
    for (const Suffix& suffix : kSuffixes[place]) {
      const ShortName last = readings.back();
      const std::string ending = std::string("_") + suffix.name;
      if (last.base.size() <= ending.size() || !last.base.ends_with(ending)) continue;
      ShortName next{last.base.substr(0, last.base.size() - ending.size()), last.suffixes};
      next.suffixes.insert(next.suffixes.begin(), suffix.name);
      readings.push_back(std::move(next));
      break;
    }
  }
  return readings;
}

void apply_suffix(std::string_view suffix, Scenario& scenario) {
  for (const auto& pair : kSuffixes)
    for (const Suffix& known : pair)
      if (suffix == known.name) known.apply(scenario);
}

std::string suffix_help() {
  std::vector<std::string> pairs;
  for (const auto& pair : kSuffixes) pairs.push_back(std::string("_") + pair[0].name + "|_" + pair[1].name);
  return join(pairs);
}

}  // namespace giga
