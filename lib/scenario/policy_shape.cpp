#include "scenario/policy_shape.hpp"

#include <algorithm>
#include <string_view>

#include "sim/egocentric_view.hpp"

namespace giga {
namespace {

/// "map_definitions.*.boxes" fits "map_definitions.pass.boxes".
bool fits(std::string_view pattern, std::string_view key) {
  const size_t star = pattern.find('*');
  if (star == std::string_view::npos) return key == pattern;
  const std::string_view head = pattern.substr(0, star), tail = pattern.substr(star + 1);
  return key.size() > head.size() + tail.size() && key.starts_with(head) && key.ends_with(tail);
}

bool has_other_view(const SimParams& a, const SimParams& b) {
  return a.egocentric_view && b.egocentric_view &&
         (view_opponents(a) != view_opponents(b) || view_team_mates(a) != view_team_mates(b));
}
bool has_other_kinds(const SimParams& a, const SimParams& b) {
  return a.egocentric_view && b.egocentric_view && a.mixed_teams != b.mixed_teams;
}

enum class Of : uint8_t { all, numbers, images };

/// Keys, which policies they matter to by what these read, and whether what follows from them differs.
struct Shaping {
  std::string_view pattern;
  Of policies;
  bool (*differs)(const SimParams& a, const SimParams& b);
};
constexpr auto kOtherTeams = [](const SimParams& a, const SimParams& b) {
  return a.n_neighbors != b.n_neighbors || has_other_view(a, b) || has_other_kinds(a, b);
};
constexpr auto kOtherBoxes = [](const SimParams& a, const SimParams& b) { return a.n_boxes != b.n_boxes; };
constexpr Shaping kShaping[] = {
    {"action", Of::all, [](const SimParams& a, const SimParams& b) { return a.actions != b.actions; }},
    {"observation.type", Of::numbers,
     [](const SimParams& a, const SimParams& b) { return a.images_only != b.images_only; }},
    {"observation.type", Of::images,
     [](const SimParams& a, const SimParams& b) { return (a.resolution > 0) != (b.resolution > 0); }},
    {"observation.resolution", Of::images,
     [](const SimParams& a, const SimParams& b) { return a.resolution != b.resolution; }},
    {"observation.max_agents", Of::numbers,
     [](const SimParams& a, const SimParams& b) { return a.n_neighbors != b.n_neighbors; }},
    {"observation.egocentric_view", Of::numbers,
     [](const SimParams& a, const SimParams& b) { return a.egocentric_view != b.egocentric_view; }},
    {"team_0", Of::numbers, kOtherTeams},
    {"team_1", Of::numbers, kOtherTeams},
    {"agent_types.*.sprite", Of::numbers, has_other_kinds},
    {"maps", Of::numbers, kOtherBoxes},
    {"map_definitions.*.boxes", Of::numbers, kOtherBoxes},
    {"collision.obstacle_heights", Of::numbers,
     [](const SimParams& a, const SimParams& b) {
       return a.obstacle_heights != b.obstacle_heights && a.n_boxes > 0 && b.n_boxes > 0;
     }},
    {"waypoints.enable_waypoints", Of::numbers,
     [](const SimParams& a, const SimParams& b) { return a.waypoints != b.waypoints; }},
};

}  // namespace

std::vector<SettingChange> shape_changes(const SeenScenario& there, const SeenScenario& here, bool reads_image) {
  std::vector<SettingChange> changes = compare_settings(settings_of(there.scenario), settings_of(here.scenario));
  std::erase_if(changes, [&](const SettingChange& change) {
    return std::none_of(std::begin(kShaping), std::end(kShaping), [&](const Shaping& shaping) {
      return fits(shaping.pattern, change.path) && shaping.policies != (reads_image ? Of::numbers : Of::images) &&
             shaping.differs(there.spec.params, here.spec.params);
    });
  });
  // A map or a kind of agents that only one of them has is told by `maps` and the teams.
  std::erase_if(changes, [](const SettingChange& change) {
    return (change.before.empty() || change.after.empty()) &&
           (change.path.starts_with("map_definitions.") || change.path.starts_with("agent_types."));
  });
  return changes;
}

Settings settings_of(const Scenario& scenario) {
  return flatten(parse_yaml_text(print_scenario(scenario), "scenario").root, plain_text);
}

}  // namespace giga
