// What the original's recordings say about its contents: scenarios, defaults, agents, maps, action table, policies.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <hdf5.h>
#include <stdlib.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "golden/comparison.hpp"
#include "golden/recording.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "scripted/actions.hpp"
#include "sim/movement.hpp"

namespace giga::golden {
namespace {

/// The recordings that hold every one of `kinds`. Our own folder must have one.
std::vector<Recording> recordings_with(std::initializer_list<const char*> kinds) {
  std::vector<Recording> found;
  for (const Recording& recording : recordings())
    if (std::all_of(kinds.begin(), kinds.end(), [&recording](const char* kind) {
          return recording.root.has(kind) || recording.root.has_attribute(kind);
        }))
      found.push_back(recording);
  GIGA_CHECK(!found.empty() || foreign_folder(), "no recording of ", *kinds.begin());
  return found;
}

#define SKIP_IF_NOTHING(found) \
  if ((found).empty()) GTEST_SKIP() << "nothing of this kind in GIGASTEP_GOLDEN_DIR"
/// The same where there are recordings, but of no case: a list without entries.
#define SKIP_IF_NONE(n) \
  if ((n) == 0 && foreign_folder()) GTEST_SKIP() << "nothing of this kind in GIGASTEP_GOLDEN_DIR"

float weight(const Scenario& s, RewardTerm term) { return s.rewards[term]; }

/// The original's scalar parameters and where they are in a Scenario.
const std::map<std::string, std::function<double(const Scenario&)>>& parameters() {
  using S = const Scenario&;
  static const std::map<std::string, std::function<double(S)>> all = {
      {"very_close_cone_depth", [](S s) { return s.sight.very_close_cone_depth; }},
      {"cone_depth", [](S s) { return s.sight.cone_depth; }},
      {"cone_angle", [](S s) { return s.sight.cone_angle; }},
      {"use_stochastic_obs", [](S s) { return s.sight.use_stochastic_obs; }},
      {"damage_cone_depth", [](S s) { return s.damage.damage_cone_depth; }},
      {"damage_cone_angle", [](S s) { return s.damage.damage_cone_angle; }},
      {"damage_per_second", [](S s) { return s.damage.damage_per_second; }},
      {"healing_per_second", [](S s) { return s.damage.healing_per_second; }},
      {"min_tracking_time", [](S s) { return s.damage.min_tracking_time; }},
      {"max_tracking_time", [](S s) { return s.damage.max_tracking_time; }},
      {"communication_range", [](S s) { return s.communication.communication_range; }},
      {"use_stochastic_comm", [](S s) { return s.communication.use_stochastic_comm; }},
      {"enable_waypoints", [](S s) { return s.waypoints.enable_waypoints; }},
      {"waypoint_size", [](S s) { return s.waypoints.waypoint_size; }},
      {"collision_range", [](S s) { return s.collision.collision_range; }},
      {"collision_altitude", [](S s) { return s.collision.collision_altitude; }},
      {"limit_x", [](S s) { return s.limit_x; }},
      {"limit_y", [](S s) { return s.limit_y; }},
      {"max_agent_in_vec_obs", [](S s) { return s.observation.max_agents; }},
      {"max_episode_length", [](S s) { return s.max_episode_length.value_or(0); }},
      {"episode_ends_one_team_dead", [](S s) { return s.episode_ends_one_team_dead; }},
      {"divide_reward_by_team_size", [](S s) { return s.rewards.divide_reward_by_team_size; }},
      {"reward_game_won", [](S s) { return weight(s, RewardTerm::game_won); }},
      {"reward_defeat_one_opponent", [](S s) { return weight(s, RewardTerm::defeat_one_opponent); }},
      {"reward_detection", [](S s) { return weight(s, RewardTerm::detection); }},
      {"reward_damage", [](S s) { return weight(s, RewardTerm::damage); }},
      {"reward_idle", [](S s) { return weight(s, RewardTerm::idle); }},
      {"reward_agent_disabled", [](S s) { return weight(s, RewardTerm::agent_disabled); }},
      {"reward_collision_agent", [](S s) { return weight(s, RewardTerm::collision_agent); }},
      {"reward_collision_obstacle", [](S s) { return weight(s, RewardTerm::collision_obstacle); }},
      {"reward_hit_waypoint", [](S s) { return weight(s, RewardTerm::hit_waypoint); }},
  };
  return all;
}

/// Handled by the tests themselves, or of images, which are not built yet.
const std::set<std::string> kOtherKeys = {"maps", "obs_type", "discrete_actions", "resolution_x", "resolution_y"};

double number_of(const Params& params, const std::string& key) {
  if (params.is_null(key)) return 0;  // max_episode_length: none
  const std::string text = params.text(key);
  return text == "true" || text == "false" ? params.flag(key) : params.number(key);
}

/// The parameters of a scenario: `given` over `defaults`.
void compare_parameters(Comparison& c, const Scenario& scenario, const Params& given, const Params& defaults) {
  for (const auto& [key, value] : parameters())
    c.near(key, -1, -1, value(scenario), number_of(given.has(key) ? given : defaults, key), 1e-7);
  for (const Node::Entry& entry : given.root().entries)
    GIGA_CHECK(parameters().count(entry.key) || kOtherKeys.count(entry.key), "unknown recorded parameter ", entry.key);
}

Params defaults_of(const Recording& r) {
  return Params(r.root.text_attribute("constructor_defaults"), r.file + " constructor_defaults");
}

TEST(GoldenContents, ConstructorDefaults) {
  const auto found = recordings_with({"constructor_defaults"});
  SKIP_IF_NOTHING(found);
  for (const Recording& r : found) {
    const Params defaults = defaults_of(r);
    Comparison c;
    compare_parameters(c, Scenario{}, defaults, defaults);
    EXPECT_TRUE(c.passed()) << c.describe(r.file + " constructor_defaults");
    for (const auto& [key, value] : parameters()) EXPECT_TRUE(defaults.has(key)) << key;
    // Where our defaults are others: those of the original's scenario builder, vectors, and discrete actions.
    EXPECT_EQ(defaults.text("maps"), "empty");
    EXPECT_EQ(Scenario{}.maps, MapSelection::all());
    EXPECT_EQ(defaults.text("obs_type"), "rgb");
    EXPECT_FALSE(defaults.flag("discrete_actions"));
    EXPECT_EQ(Scenario{}.action, ActionKind::discrete);
    std::printf("constructor defaults: %ld parameters of %s\n", c.n_compared(), r.file.c_str());
  }
}

TEST(GoldenContents, EveryScenarioName) {
  const auto found = recordings_with({"scenario_params_json", "constructor_defaults"});
  SKIP_IF_NOTHING(found);
  long n_names = 0, n_values = 0;
  for (const Recording& r : found) {
    const Params defaults = defaults_of(r);
    const Document all = parse_yaml_text(r.root.text("scenario_params_json"), r.file + " scenario_params_json");
    for (const Node::Entry& entry : all.root.entries) {
      const std::string& name = entry.key;
      const Params given(print_node(entry.value), name);
      const Scenario scenario = load_scenario(name, data_dirs());
      Comparison c;
      compare_parameters(c, scenario, given, defaults);
      const bool vector = given.has("obs_type") && given.text("obs_type") == "vector";
      const bool discrete = given.has("discrete_actions") && given.flag("discrete_actions");
      c.same("obs_type is vector", -1, -1, scenario.observation.type == ObservationType::vector, vector);
      c.same("obs_type is rgb", -1, -1, scenario.observation.type == ObservationType::rgb, !vector);
      c.same("discrete_actions", -1, -1, scenario.action == ActionKind::discrete, discrete);
      EXPECT_TRUE(c.passed()) << c.describe(name);
      // Q1: in the original `void` has obstacles like `maps`; here it means what it says, under both rules.
      EXPECT_EQ(given.text("maps"), "all") << name;
      const bool is_void = name.find("_void_") != std::string::npos;
      EXPECT_EQ(scenario.maps, is_void ? MapSelection::empty() : MapSelection::all()) << name;
      ++n_names;
      n_values += c.n_compared();
    }
  }
  std::printf("scenario names: %ld, %ld values\n", n_names, n_values);
  SKIP_IF_NONE(n_names);
  EXPECT_GE(n_names, foreign_folder() ? 1 : 288);
}

std::vector<double> numbers_of(const Params& agents, const std::string& key) {
  const Node* list = agents.root().find(key);
  GIGA_CHECK(list, "no ", key);
  std::vector<double> values;
  for (const Node& item : list->items) values.push_back(std::stod(item.text));
  return values;
}

TEST(GoldenContents, AgentsOfEveryBaseScenario) {
  const auto found = recordings_with({"base_scenario_agents_json"});
  SKIP_IF_NOTHING(found);
  long n_scenarios = 0, n_agents = 0;
  for (const Recording& r : found) {
    const Document all =
        parse_yaml_text(r.root.text("base_scenario_agents_json"), r.file + " base_scenario_agents_json");
    for (const Node::Entry& entry : all.root.entries) {
      const Params recorded(print_node(entry.value), entry.key);
      const SimSpec spec = compile(load_scenario(entry.key, data_dirs()));
      const std::vector<std::pair<const char*, std::function<double(const AgentSpec&)>>> columns = {
          {"per_agent_team", [](const AgentSpec& a) { return a.team; }},
          {"per_agent_sprites", [](const AgentSpec& a) { return a.sprite; }},
          {"per_agent_max_health", [](const AgentSpec& a) { return a.max_health; }},
          {"per_agent_range", [](const AgentSpec& a) { return a.range; }},
          {"per_agent_damage_range", [](const AgentSpec& a) { return a.damage_range; }},
          {"per_agent_thrust", [](const AgentSpec& a) { return a.thrust; }},
          {"per_agent_idle_reward", [](const AgentSpec& a) { return a.idle_reward; }},
      };
      EXPECT_EQ(recorded.root().entries.size(), columns.size() + 1) << entry.key;
      Comparison c;
      for (const auto& [column, value] : columns) {
        const auto want = numbers_of(recorded, column);
        ASSERT_EQ(want.size(), spec.agents.size()) << entry.key;
        for (size_t i = 0; i < want.size(); ++i)
          c.near(column, static_cast<int>(i), -1, value(spec.agents[i]), want[i], 1e-7);
      }
      const auto size = numbers_of(recorded, "map_size");
      ASSERT_EQ(size.size(), 2u) << entry.key;
      c.near("map_size", -1, 0, spec.params.limit_x, size[0], 0);
      c.near("map_size", -1, 1, spec.params.limit_y, size[1], 0);
      EXPECT_TRUE(c.passed()) << c.describe(entry.key);
      ++n_scenarios;
      n_agents += static_cast<long>(spec.agents.size());
    }
  }
  std::printf("base scenarios: %ld with %ld agents\n", n_scenarios, n_agents);
  SKIP_IF_NONE(n_scenarios);
  EXPECT_GE(n_scenarios, foreign_folder() ? 1 : 18);
}

void compare_map(Comparison& c, int index, const MapSpec& got, const MapSpec& want, double tolerance) {
  for (size_t b = 0; b < want.boxes.size(); ++b) {
    const Box ours = b < got.boxes.size() ? got.boxes[b] : Box{}, &theirs = want.boxes[b];  // padding is zeros
    const float pairs[4][2] = {{ours.x1, theirs.x1}, {ours.y1, theirs.y1}, {ours.x2, theirs.x2}, {ours.y2, theirs.y2}};
    for (const auto& [a, z] : pairs) c.near("boxes", index, static_cast<int>(b), a, z, tolerance);
  }
  for (int team = 0; team < kNTeams; ++team) {
    const StartArea &a = got.start[team], &z = want.start[team];
    const float pairs[8][2] = {{a.x1, z.x1},
                               {a.y1, z.y1},
                               {a.x2, z.x2},
                               {a.y2, z.y2},
                               {a.z_lo, z.z_lo},
                               {a.z_hi, z.z_hi},
                               {a.heading_lo, z.heading_lo},
                               {a.heading_hi, z.heading_hi}};
    for (int k = 0; k < 8; ++k) c.near("start", index, team * 8 + k, pairs[k][0], pairs[k][1], tolerance);
  }
}

TEST(GoldenContents, EveryMap) {
  const auto found = recordings_with({"maps"});
  SKIP_IF_NOTHING(found);
  long n_sets = 0, n_maps = 0;
  WorstDifferences worst;
  for (const Recording& r : found) {
    const H5Group sets = r.root.group("maps");
    for (const std::string& name : sets.children()) {  // SET_WxH
      const size_t size_at = name.rfind('_') + 1, x_at = name.find('x', size_at);
      ASSERT_NE(x_at, std::string::npos) << name;
      const std::string text =
          cat("{maps: ", name.substr(0, size_at - 1), ", limit_x: ", name.substr(size_at, x_at - size_at),
              ", limit_y: ", name.substr(x_at + 1), ", team_0: [{type: default}], team_1: [{type: default}]}");
      const SimSpec spec = compile(parse_scenario(text, name, data_dirs()));
      const auto want = recorded_maps(sets.group(name), "");
      ASSERT_EQ(spec.maps.size(), want.size()) << name;
      ASSERT_FALSE(want.empty()) << name;
      EXPECT_EQ(static_cast<size_t>(spec.params.n_boxes), want[0].boxes.size()) << name;
      Comparison c;
      for (size_t m = 0; m < want.size(); ++m)
        compare_map(c, static_cast<int>(m), spec.maps[m], want[m], 0);  // to kTolerance of the value
      EXPECT_TRUE(c.passed()) << c.describe("maps/" + name + " (agent = map)");
      c.merge_into(worst);
      ++n_sets;
      n_maps += static_cast<long>(want.size());
    }
  }
  std::printf("maps: %ld sets, %ld maps; worst difference:\n%s", n_sets, n_maps, table_of(worst).c_str());
  SKIP_IF_NONE(n_sets);
  EXPECT_GE(n_sets, foreign_folder() ? 1 : 15);
}

TEST(GoldenContents, ActionTable) {
  const auto found = recordings_with({"action_lut"});
  SKIP_IF_NOTHING(found);
  for (const Recording& r : found) {
    const Array<float> table = r.root.floats("action_lut");
    ASSERT_EQ(table.shape, (std::vector<size_t>{kNDiscreteActions, kActionSize}));
    for (int a = 0; a < kNDiscreteActions; ++a) {
      const Controls c = discrete_controls(a);
      const float* want = table.row(static_cast<size_t>(a));
      EXPECT_EQ(c.heading, want[0]) << "action " << a;
      EXPECT_EQ(c.dive, want[1]) << "action " << a;
      EXPECT_EQ(c.throttle, want[2]) << "action " << a;
    }
  }
}

/// What our scripted policy does, for one agent.
int32_t scripted_discrete(Scripted kind) {
  const uint32_t draw_step = 0;
  const int32_t age = 0;
  int32_t action = -1;
  ScriptedActions{kind, ActionKind::discrete, {&draw_step, 7, 0, 1, 0}, &age, &action}(0);
  return action;
}
std::vector<float> scripted_continuous(Scripted kind) {
  const uint32_t draw_step = 0;
  const int32_t age = 0;
  std::vector<float> action(kActionSize, 9.0f);
  ScriptedActions{kind, ActionKind::continuous, {&draw_step, 7, 0, 1, 0}, &age, action.data()}(0);
  return action;
}

TEST(GoldenContents, ScriptedPolicies) {
  const auto found = recordings_with({"policies"});
  SKIP_IF_NOTHING(found);
  for (const Recording& r : found) {
    const H5Group policies = r.root.group("policies");
    EXPECT_EQ(policies.ints("circle_plus_disc").data.at(0), 16);
    EXPECT_EQ(policies.ints("circle_minus_disc").data.at(0), 10);
    EXPECT_EQ(scripted_discrete(Scripted::circle), policies.ints("circle_plus_disc").data.at(0));
    EXPECT_EQ(scripted_discrete(Scripted::reverse_circle), policies.ints("circle_minus_disc").data.at(0));
    EXPECT_EQ(scripted_continuous(Scripted::circle), policies.floats("circle_plus_cont").data);
    EXPECT_EQ(scripted_continuous(Scripted::reverse_circle), policies.floats("circle_minus_cont").data);
    // circle_random is mended under both rules (Q27), so only the kind of its actions is compared.
    for (const std::string& name : policies.children()) {
      if (name.rfind("circle_random_", 0) != 0 || name.find("_disc") == std::string::npos) continue;
      for (const int32_t action : policies.ints(name).data) EXPECT_TRUE(action == 10 || action == 16) << name;
    }
    const int32_t ours = scripted_discrete(Scripted::circle_random);
    EXPECT_TRUE(ours == 10 || ours == 16);
  }
}

/// A recording in a folder of its own, with these texts as datasets; removed at the end.
class ForeignFolder {
 public:
  explicit ForeignFolder(const std::map<std::string, std::string>& texts) {
    GIGA_CHECK(::mkdtemp(path_.data()), "no temporary folder ", path_);
    const hid_t file = H5Fcreate((path_ + "/some.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    for (const auto& [name, text] : texts) {
      const hsize_t size = text.size();
      const hid_t space = H5Screate_simple(1, &size, nullptr);
      const hid_t data = H5Dcreate2(file, name.c_str(), H5T_STD_U8LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
      GIGA_CHECK(H5Dwrite(data, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()) >= 0, name);
      H5Dclose(data);
      H5Sclose(space);
    }
    H5Fclose(file);
  }
  ~ForeignFolder() { std::filesystem::remove_all(path_); }
  ForeignFolder(const ForeignFolder&) = delete;
  ForeignFolder& operator=(const ForeignFolder&) = delete;

  /// Wait status of this program's own tests of contents with this folder in GIGASTEP_GOLDEN_DIR.
  int run_tests() const {
    const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
    const std::string command = "GIGASTEP_GOLDEN_DIR='" + path_ + "' '" + self +
                                "' --gtest_filter='GoldenContents.*' >'" + path_ + "/log' 2>&1";
    return std::system(command.c_str());
  }

 private:
  std::string path_ = (std::filesystem::temp_directory_path() / "gigastep_golden_XXXXXX").string();
};

TEST(GoldenForeignFolder, WhatARecordingLacksIsSkipped) {
  const std::map<std::string, std::string> foreign[] = {
      {{"scenario_params_json", "{}"}},                               // a list without names
      {{"scenario_params_json", "{identical_5_vs_5: {maps: all}}"}},  // names without the defaults
      {{"base_scenario_agents_json", "{}"}},                          // no names at all
  };
  for (const auto& texts : foreign) {
    const int status = ForeignFolder(texts).run_tests(), code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    EXPECT_TRUE(code == 0 || code == 77) << code << ": " << texts.begin()->second;  // 77: all were skipped
  }
}

}  // namespace
}  // namespace giga::golden
