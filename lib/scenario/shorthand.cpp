// One table of suffixes and what each sets.
#include "scenario/shorthand.hpp"

#include <array>
#include <set>

#include "config/names.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

constexpr size_t kNPairs = 4;

struct Suffix {
  const char* name;
  void (*apply)(Scenario&);
};

/// Of each pair a name has one at most.
const std::array<std::array<Suffix, 2>, kNPairs> kSuffixes = {{
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
      {"vec",
       [](Scenario& s) {
         s.observation.type = ObservationType::vector;
         s.observation.resolution = ObservationConfig{}.resolution;
       }}}},
    {{{"maps", [](Scenario& s) { s.maps = MapSelection::all(); }},
      {"void", [](Scenario& s) { s.maps = MapSelection::empty(); }}}},
    {{{"cont", [](Scenario& s) { s.action = ActionKind::continuous; }},
      {"disc", [](Scenario& s) { s.action = ActionKind::discrete; }}}},
}};

constexpr size_t kNoPair = kNPairs;

/// The number of the pair that a suffix is of.
size_t pair_of(std::string_view suffix) {
  for (size_t k = 0; k < kSuffixes.size(); ++k)
    for (const Suffix& known : kSuffixes[k])
      if (suffix == known.name) return k;
  return kNoPair;
}

}  // namespace

std::vector<ShortName> split_name(std::string_view name) {
  std::vector<ShortName> readings = {{std::string(name), {}}};
  std::set<size_t> taken;  // pairs that have a suffix already
  const auto take_last = [&] {
    const ShortName last = readings.back();
    const size_t at = last.base.rfind('_');
    if (at == std::string::npos || at == 0) return false;
    const std::string suffix = last.base.substr(at + 1);
    const size_t pair = pair_of(suffix);
    if (pair == kNoPair || !taken.insert(pair).second) return false;
    ShortName next{last.base.substr(0, at), last.suffixes};
    next.suffixes.insert(next.suffixes.begin(), suffix);
    readings.push_back(std::move(next));
    return true;
  };
  while (take_last()) {
  }
  return readings;
}

void apply_suffix(std::string_view suffix, Scenario& scenario) {
  for (const auto& pair : kSuffixes)
    for (const Suffix& known : pair)
      if (suffix == known.name) known.apply(scenario);
}

std::string suffix_mistake(std::string_view name) {
  const ShortName deepest = split_name(name).back();
  const std::string& base = deepest.base;
  const size_t at = base.rfind('_');
  const size_t pair = at == std::string::npos || at == 0 ? kNoPair : pair_of(base.substr(at + 1));
  if (base.ends_with(".yaml") || base.ends_with(".yml"))
    return deepest.suffixes.empty() ? "" : "suffixes follow names; a file states their keys";
  if (base.find('/') != std::string::npos || pair == kNoPair) return "";
  return cat("a name has one of _", kSuffixes[pair][0].name, " and _", kSuffixes[pair][1].name, ", once");
}

std::string suffix_help() {
  std::vector<std::string> pairs;
  for (const auto& pair : kSuffixes) pairs.push_back(std::string("_") + pair[0].name + "|_" + pair[1].name);
  return join(pairs);
}

}  // namespace giga
