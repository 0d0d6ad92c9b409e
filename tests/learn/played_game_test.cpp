// Which keys of a scenario a policy is bound to, and that those are named where it does not fit.
#include "eval/played_game.hpp"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "export/observation_layout.hpp"
#include "runs.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "scenario/policy_shape.hpp"

namespace giga::test {
namespace {

/// A scenario in which every key can take another value that counts: mixed kinds, two maps with boxes, images, the
/// view.
const std::string kBase = R"(
action: discrete
limit_x: 10
limit_y: 10
max_episode_length: 300
team_0: [{type: a, count: 2}]
team_1: [{type: a, count: 1}, {type: b, count: 1}]
maps: [gap]
observation: {type: rgb_vector, resolution: 16, max_agents: 4, egocentric_view: true}
waypoints: {enable_waypoints: true}
agent_types:
  a: {sprite: 1}
  b: {sprite: 2}
map_definitions:
  gap: {boxes: [[4, 4, 5, 5]], team_0: {area: [1, 1, 3, 3]}, team_1: {area: [7, 7, 9, 9]}}
)";

/// With other values: "sight.cone_depth=5".
Scenario changed(const std::vector<std::string>& assignments) {
  Document text = parse_yaml_text(print_scenario(parse_scenario(kBase, "base", data_dirs())), "base");
  for (const std::string& assignment : assignments) set_override(text, assignment);
  return parse_scenario(print_node(text.root), "changed", data_dirs());
}

std::set<std::string> named(const Scenario& there, const Scenario& here, bool reads_image) {
  const SimSpec spec_there = compile(there), spec_here = compile(here);
  std::set<std::string> keys;
  for (const SettingChange& change : shape_changes({there, spec_there}, {here, spec_here}, reads_image))
    keys.insert(change.path);
  return keys;
}

bool fits(const Scenario& there, const Scenario& here, bool reads_image) {
  return interface_of(compile(there), reads_image).fits(interface_of(compile(here), reads_image));
}

/// Values of keys by which a policy that reads numbers fits no more.
const std::map<std::string, std::string> kShaping = {
    {"action", "continuous"},
    {"team_0", "[{type: a, count: 1}]"},
    {"team_1", "[{type: a, count: 2}]"},
    {"maps", "empty"},
    {"collision.obstacle_heights", "true"},
    {"waypoints.enable_waypoints", "false"},
    {"observation.max_agents", "3"},
    {"observation.egocentric_view", "false"},
    {"agent_types.b.sprite", "1"},
    {"map_definitions.gap.boxes", "[[4, 4, 5, 5], [5, 6, 6, 7]]"},
};

TEST(PlayedGame, KeysThatShapeAPolicyAreNamed) {
  const Scenario base = changed({});
  for (const auto& [key, value] : kShaping) {
    const Scenario other = changed({cat(key, "=", value)});
    EXPECT_FALSE(fits(base, other, false)) << key;
    EXPECT_EQ(named(base, other, false), std::set<std::string>{key}) << value;
    EXPECT_EQ(named(other, base, false), std::set<std::string>{key}) << value;
  }
  const Scenario blind = changed({"observation.egocentric_view=false"});
  EXPECT_EQ(named(blind, changed({"observation.egocentric_view=false", "observation.type=rgb"}), false),
            std::set<std::string>{"observation.type"});
  // Of policies that read images.
  for (const auto& [key, value] :
       std::map<std::string, std::string>{{"action", "continuous"}, {"observation.resolution", "20"}}) {
    const Scenario other = changed({cat(key, "=", value)});
    EXPECT_FALSE(fits(base, other, true)) << key;
    EXPECT_EQ(named(base, other, true), std::set<std::string>{key}) << value;
  }
  const Scenario without_images = changed({"observation={type: vector, max_agents: 4, egocentric_view: true}"});
  EXPECT_FALSE(fits(base, without_images, true));
  EXPECT_TRUE(named(base, without_images, true).contains("observation.type"));
}

/// Among them one for each type of key.
const std::vector<std::string> kValues = {"true",   "false",          "7",           "30",     "0.5",       "1",
                                          "none",   "original",       "corrected",   "team_0", "waypoints", "[2, 3]",
                                          "[9, 9]", "[[1, 4, 2, 5]]", "[0, 0, 2, 2]"};

// Whatever else is changed, one key at a time: a policy still fits, and no key is named.
TEST(PlayedGame, NoOtherKeyShapesAPolicy) {
  const Scenario base = changed({});
  const auto text = [](const Scenario& scenario) { return print_scenario(scenario); };
  for (const auto& [key, value] : settings_of(base)) {
    bool changes = false;
    for (const std::string& other : kValues) {
      if (kShaping.contains(key) && key != "map_definitions.gap.boxes") continue;  // one box is as good as another
      Scenario here;
      try {
        here = changed({cat(key, "=", other)});
        compile(here);
      } catch (const InputError&) {
        continue;  // a value of another type
      }
      if (text(here) == text(base)) continue;
      changes = true;
      EXPECT_TRUE(fits(base, here, false)) << key << "=" << other;
      EXPECT_EQ(named(base, here, false), std::set<std::string>{}) << key << "=" << other;
      if (key == "observation.resolution") continue;  // shapes those that read images: see above
      EXPECT_TRUE(fits(base, here, true)) << key << "=" << other;
      EXPECT_EQ(named(base, here, true), std::set<std::string>{}) << key << "=" << other;
    }
    const bool elsewhere = kShaping.contains(key) || key == "observation.type" || key.ends_with("flipped_of");
    EXPECT_TRUE(changes || elsewhere) << key << " was not changed";
  }
}

// What follows from a key counts, not the key.
TEST(PlayedGame, KeysThatComeToTheSameAreNotNamed) {
  const Scenario base = changed({});
  const std::string more = "team_0=[{type: a, count: 4}]", blind = "observation.egocentric_view=false";
  EXPECT_EQ(named(base, changed({"observation.max_agents=9"}), false), std::set<std::string>{}) << "there are but four";
  EXPECT_EQ(named(base, changed({more}), false), std::set<std::string>{"team_0"}) << "the view has room for more";
  EXPECT_EQ(named(changed({blind}), changed({blind, more}), false), std::set<std::string>{}) << "four rows as before";
  EXPECT_TRUE(fits(changed({blind}), changed({blind, more}), false));
  EXPECT_EQ(named(base, changed({"maps=empty"}), true), std::set<std::string>{}) << "images are as large as ever";
}

}  // namespace
}  // namespace giga::test
