// Scenarios that come with the program: all load, under all their names, and compile to what the specification says.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <map>

#include "core/error.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "sim/vector_observation.hpp"
#include "support/source.hpp"

namespace giga {
namespace {

DataDirs source_data() { return {test::source_path()}; }
Scenario load(const std::string& name) { return load_scenario(name, source_data()); }

/// Agents per team and side of the world.
struct Expected {
  int n_team_0, n_team_1;
  float size;
};

const std::map<std::string, Expected> kOriginal = {
    {"hide_and_seek_5_vs_5", {5, 5, 10}}, {"hide_and_seek_10_vs_5", {5, 10, 10}}, {"waypoint_5_vs_5", {5, 5, 10}},
    {"waypoint_5_vs_3", {5, 3, 10}},      {"identical_20_vs_20", {20, 20, 20}},   {"special_20_vs_20", {20, 20, 20}},
    {"identical_10_vs_10", {10, 10, 10}}, {"special_10_vs_10", {10, 10, 10}},     {"identical_5_vs_5", {5, 5, 10}},
    {"special_5_vs_5", {5, 5, 10}},       {"identical_1_vs_1", {1, 1, 10}},       {"identical_2_vs_2", {2, 2, 10}},
    {"identical_5_vs_1", {5, 1, 10}},     {"special_5_vs_1", {5, 1, 10}},         {"identical_10_vs_3", {10, 3, 10}},
    {"special_10_vs_3", {10, 3, 10}},     {"identical_20_vs_5", {20, 5, 10}},     {"special_20_vs_5", {20, 5, 10}},
};

void expect_teams(const SimSpec& spec, const Expected& expected) {
  EXPECT_EQ(spec.params.n_team[0], expected.n_team_0) << spec.name;
  EXPECT_EQ(spec.params.n_team[1], expected.n_team_1) << spec.name;
  EXPECT_EQ(spec.params.limit_x, expected.size) << spec.name;
  EXPECT_EQ(spec.params.limit_y, expected.size) << spec.name;
}

TEST(ScenarioLoad, TheOriginals288Names) {
  int n_names = 0;
  for (const auto& [base, expected] : kOriginal)
    for (const char* sight : {"_fobs", "_pobs"})
      for (const char* observation : {"_rgb", "_vec"})
        for (const char* maps : {"_maps", "_void"})
          for (const char* action : {"_cont", "_disc"}) {
            const std::string name = base + sight + observation + maps + action;
            ++n_names;
            const Scenario scenario = load(name);
            EXPECT_EQ(scenario.name, name);
            const bool images = observation == std::string("_rgb");
            EXPECT_EQ(scenario.observation.type, images ? ObservationType::rgb : ObservationType::vector);
            EXPECT_EQ(compile(scenario).params.resolution, images ? 84 : 0);
            EXPECT_EQ(scenario.sight.use_stochastic_obs, sight == std::string("_pobs"));
            EXPECT_EQ(scenario.communication.use_stochastic_comm, sight == std::string("_pobs"));
            EXPECT_EQ(scenario.sight.cone_depth, sight == std::string("_fobs") ? 100 : 3);
            EXPECT_EQ(scenario.action, action == std::string("_cont") ? ActionKind::continuous : ActionKind::discrete);
            EXPECT_EQ(scenario.maps.names.size(), maps == std::string("_void") ? 2u : 8u);
            EXPECT_EQ(scenario.map_definitions.size(), scenario.maps.names.size());
            expect_teams(compile(scenario), expected);
          }
  EXPECT_EQ(n_names, 288);
}

TEST(ScenarioLoad, SuffixesStandInAnyOrder) {
  Scenario sorted = load("identical_2_vs_2_fobs_void_cont");
  for (const char* name : {"identical_2_vs_2_void_fobs_cont", "identical_2_vs_2_cont_vec_void_fobs"}) {
    const Scenario scenario = load(name);
    EXPECT_EQ(scenario.name, name);
    sorted.name = name;  // which the text begins with
    EXPECT_TRUE(print_scenario(scenario) == print_scenario(sorted)) << name;
  }
  EXPECT_THROW(load("identical_2_vs_2_void_maps"), InputError) << "two of a pair";
  EXPECT_THROW(load("identical_2_vs_2_void_void"), InputError);
}

TEST(ScenarioLoad, BareNamesMeanVectorsAndDiscreteActions) {
  for (const auto& [base, expected] : kOriginal) {
    const SimSpec spec = compile(load(base));
    expect_teams(spec, expected);
    EXPECT_EQ(spec.params.actions, ActionKind::discrete);
    EXPECT_EQ(spec.params.n_maps, 8);
    EXPECT_EQ(spec.params.n_boxes, 4);
  }
}

TEST(ScenarioLoad, BeyondTheOriginal) {
  expect_teams(compile(load("waypoint_3_vs_3")), {3, 3, 10});
  expect_teams(compile(load("hide_and_seek_5_vs_10")), {5, 10, 10});
  expect_teams(compile(load("identical_5_vs_3")), {5, 3, 10});
  expect_teams(compile(load("identical_50_vs_50")), {50, 50, 40});
  expect_teams(compile(load("identical_100_vs_100_fobs")), {100, 100, 100});
  for (const int n : {1000, 10000}) {
    const std::string name = "identical_" + std::to_string(n) + "_vs_" + std::to_string(n);
    const Scenario scenario = load(name);
    EXPECT_EQ(scenario.team_0[0].count, n);
    EXPECT_EQ(scenario.maps, MapSelection::empty());
    expect_teams(compile(scenario), {n, n, static_cast<float>(n)});
  }
}

// As dense: 2,000 / 40^2 = 1.25 agents a unit^2, 1,000,000 / 900^2 = 1.23.
TEST(ScenarioLoad, Swarms) {
  expect_teams(compile(load("swarm_1000_vs_1000")), {1000, 1000, 40});
  expect_teams(compile(load("swarm_million")), {500000, 500000, 900});
}

TEST(ScenarioLoad, AnySubsetOfTheSuffixes) {
  EXPECT_EQ(load("identical_5_vs_5_cont").action, ActionKind::continuous);
  const Scenario scenario = load("identical_5_vs_5_fobs_void");
  EXPECT_EQ(scenario.maps, MapSelection::empty());
  EXPECT_EQ(scenario.sight.cone_depth, 100);
  EXPECT_THROW(load("identical_5_vs_5_void_maps"), InputError);  // two of a pair
  EXPECT_THROW(load("identical_5_vs_5_cont_disc"), InputError);
}

TEST(ScenarioLoad, TheOriginalsDefaults) {
  const SimSpec spec = compile(load("identical_5_vs_5"));
  const SimParams& p = spec.params;
  EXPECT_EQ(p.rules, Rules::corrected);
  EXPECT_EQ(p.very_close_depth2, 1.0f);
  EXPECT_EQ(p.cone_depth2, 9.0f);
  EXPECT_FLOAT_EQ(p.cone_cos, -std::sqrt(0.5f));  // cos(3/4 pi)
  EXPECT_FALSE(p.cone_is_full);
  EXPECT_EQ(p.damage_cone_depth2, 2.05f * 2.05f);
  EXPECT_FLOAT_EQ(p.damage_cone_cos, std::sqrt(0.5f));
  EXPECT_TRUE(p.stochastic_detection && p.stochastic_communication);
  EXPECT_EQ(p.communication_range, 8.0f);
  EXPECT_EQ(p.damage_per_second, 1.0f);
  EXPECT_EQ(p.healing_per_second, 0.1f);
  EXPECT_EQ(p.min_tracking_time, 3);
  EXPECT_EQ(p.max_tracking_time, 10);
  EXPECT_EQ(p.collision_range2, 0.4f * 0.4f);
  EXPECT_EQ(p.collision_altitude, 0.5f);
  EXPECT_FALSE(p.waypoints);
  EXPECT_EQ(p.waypoint_size, 0.6f);
  EXPECT_EQ(p.max_episode_length, 500);
  EXPECT_TRUE(p.episode_ends_one_team_dead && p.divide_reward_by_team_size);
  EXPECT_FALSE(p.obstacle_heights || p.obstacles_block_sight || p.sight_3d);
  EXPECT_EQ(spec.neighbor_limit, 15);
  for (int t = 0; t < kNRewardTerms; ++t) {
    const RewardTerm term = static_cast<RewardTerm>(t);
    const float weight = term == RewardTerm::game_won ? 10 : term == RewardTerm::defeat_one_opponent ? 100 : 0;
    EXPECT_EQ(p.reward_weight[t], weight) << kRewardTermNames[t];
  }
}

TEST(ScenarioLoad, HideAndSeekAndWaypoints) {
  const SimSpec hide = compile(load("hide_and_seek_10_vs_5"));
  EXPECT_EQ(hide.params.damage_cone_depth2, 1.0f);
  EXPECT_TRUE(hide.params.damage_cone_is_full);  // half angle pi
  EXPECT_EQ(hide.params.damage_per_second, 10.0f);
  EXPECT_EQ(hide.params.collision_range2, 0.0f);
  EXPECT_EQ(hide.params.reward_weight[static_cast<int>(RewardTerm::damage)], 10.0f);
  EXPECT_TRUE(hide.params.has_idle_reward);
  EXPECT_EQ(hide.agents[14].team, 1);
  EXPECT_EQ(hide.agents[14].damage_range, 0.0f);  // a hider
  EXPECT_EQ(hide.agents[14].idle_reward, 1.0f);
  EXPECT_EQ(hide.params.win.by, WinBy::elimination);
  EXPECT_EQ(hide.params.win.at_time_limit, LimitWinner::team_1);  // of the hiders

  const SimSpec waypoint = compile(load("waypoint_5_vs_3"));
  EXPECT_TRUE(waypoint.params.waypoints);
  EXPECT_FALSE(waypoint.params.episode_ends_one_team_dead);
  EXPECT_EQ(waypoint.params.damage_cone_depth2, 0.0f);
  EXPECT_EQ(waypoint.agents[7].thrust, 2.0f);
  EXPECT_EQ(waypoint.params.win.by, WinBy::waypoints);
  EXPECT_EQ(waypoint.params.win.at_time_limit, LimitWinner::tie);
  for (int t = 0; t < kNRewardTerms; ++t)
    EXPECT_EQ(waypoint.params.reward_weight[t], t == static_cast<int>(RewardTerm::hit_waypoint) ? 50.0f : 0.0f);
}

TEST(ScenarioLoad, ThePublishedSetting) {
  const Scenario scenario = load("identical_5_vs_5_published");
  EXPECT_EQ(scenario.sight.cone_depth, 15.0f);
  EXPECT_FLOAT_EQ(scenario.sight.cone_angle, 1.99f * kPi);
  EXPECT_FALSE(scenario.sight.use_stochastic_obs || scenario.communication.use_stochastic_comm);
  EXPECT_EQ(scenario.max_episode_length, 256);
  EXPECT_EQ(scenario.rewards[RewardTerm::game_won], 100.0f);
  EXPECT_EQ(scenario.rewards[RewardTerm::collision_obstacle], 100.0f);
  const SimSpec spec = compile(scenario);
  EXPECT_EQ(spec.params.n_neighbors, 10);
  EXPECT_TRUE(spec.params.cone_is_full);
  EXPECT_EQ(VectorObservation::shape(spec.params).size(), 90);
}

TEST(ScenarioLoad, AgentTypes) {
  // team 0 and 1: more_health, more_range, faster, super, default
  const SimSpec spec = compile(load("special_5_vs_5"));
  const float expected[5][6] = {// sprite, max_health, range, damage_range, thrust, idle_reward
                                {7, 3, 1, 1, 1, 0},
                                {3, 0.5f, 2, 1, 1, 0},
                                {5, 1, 1, 1, 2, 0},
                                {6, 3, 1, 1, 0.8f, 0},
                                {1, 1, 1, 1, 1, 0}};
  ASSERT_EQ(spec.agents.size(), 10u);
  for (size_t k = 0; k < 10; ++k) {
    const AgentSpec& agent = spec.agents[k];
    const float* e = expected[k % 5];
    EXPECT_EQ(agent.team, k < 5 ? 0 : 1);
    EXPECT_EQ(static_cast<float>(agent.sprite), e[0]);
    EXPECT_EQ(agent.max_health, e[1]);
    EXPECT_EQ(agent.range, e[2]);
    EXPECT_EQ(agent.damage_range, e[3]);
    EXPECT_EQ(agent.thrust, e[4]);
    EXPECT_EQ(agent.idle_reward, e[5]);
  }
}

TEST(ScenarioLoad, MapsInTheOriginalsOrderAndStretched) {
  const char* names[] = {"empty",      "empty_flipped",      "two_rooms1",   "two_rooms2_flipped",
                         "four_rooms", "four_rooms_flipped", "center_block", "center_block_flipped"};
  const SimSpec spec = compile(load("identical_20_vs_20"));  // 20 x 20: twice the size of the maps
  ASSERT_EQ(spec.maps.size(), 8u);
  for (size_t k = 0; k < 8; ++k) {
    EXPECT_EQ(spec.maps[k].name, names[k]);
    EXPECT_EQ(spec.maps[k].boxes.size(), k < 2 ? 0u : k < 4 ? 2u : k < 6 ? 4u : 1u);
    const MapSpec& straight = spec.maps[k & ~size_t{1}];
    for (int team = 0; team < kNTeams; ++team) {
      const StartArea& start = spec.maps[k].start[team];
      EXPECT_EQ(start.x1, straight.start[k % 2 ? 1 - team : team].x1);
      EXPECT_EQ(start.heading_lo, (team == 0) == (k % 2 == 0) ? kPi : 0.0f);
    }
  }
  const Box& block = spec.maps[6].boxes[0];
  EXPECT_EQ(block.x1, 7.6f);
  EXPECT_EQ(block.y2, 12.4f);
  EXPECT_EQ(spec.maps[0].start[1].x2, 8.0f);  // area a, (1, 1, 4, 9), is team 1's
  EXPECT_EQ(spec.maps[0].start[0].x1, 12.0f);
}

TEST(ScenarioLoad, EveryScenarioIsListedWithADescription) {
  const std::vector<ScenarioInfo> list = list_scenarios(source_data());
  EXPECT_GE(list.size(), kOriginal.size() + 8);
  for (const ScenarioInfo& info : list) {
    EXPECT_FALSE(info.description.empty()) << info.name;
    EXPECT_NE(info.description[0], '(') << info.name << " " << info.description;
    EXPECT_NO_THROW(load(info.name)) << info.name;
  }
}

TEST(ScenarioLoad, EveryScenarioSaysWhatAWinIs) {
  for (const ScenarioInfo& info : list_scenarios(source_data())) {
    std::string expected = "A win: the other team is wiped out first";
    if (info.name.starts_with("waypoint_"))
      expected = "A win: more waypoints than the other team when the episode ends. A tie: as many.";
    else if (info.name.starts_with("hide_and_seek_"))  // team 1 hides
      expected += "; for team 1 also: both live after 500 steps. A tie: both are wiped out in the same step.";
    else
      expected += cat(". A tie: both are wiped out in the same step, or both live after ",
                      info.name == "identical_5_vs_5_published" ? 256 : 500, " steps.");
    EXPECT_TRUE(print_scenario(load(info.name))
                    .starts_with(cat("# Scenario ", info.name, " with all its keys.\n# ", expected, "\n")))
        << info.name;
  }
}

TEST(ScenarioLoad, WinsInWords) {
  const auto words = [](const char* keys) {
    const Scenario s = parse_scenario(cat("team_0: [{}]\nteam_1: [{}]\n", keys), "mine", source_data());
    return describe_win(s.win, s.max_episode_length.value_or(0));
  };
  EXPECT_EQ(words("max_episode_length: none\n"),
            "A win: the other team is wiped out first. A tie: both are wiped out in the same step.");
  EXPECT_EQ(words("win: {at_time_limit: team_0}\nmax_episode_length: 9\n"),
            "A win: the other team is wiped out first; for team 0 also: both live after 9 steps. A tie: both are wiped "
            "out in the same step.");
  EXPECT_EQ(words("win: {by: waypoints, at_time_limit: team_1}\n"),
            "A win: more waypoints than the other team when the episode ends; for team 1 also: as many after 500 "
            "steps. A tie: as many in an episode that ends earlier.");
}

// As a checkpoint or manifest keeps it that is older than the key.
TEST(ScenarioLoad, AStoredScenarioWithoutTheKeyIsByElimination) {
  std::string text = print_scenario(load("waypoint_5_vs_5"));
  const size_t begin = text.find("\nwin:"), end = text.find("\nrewards:");
  ASSERT_LT(begin, end);
  EXPECT_EQ(compile(parse_scenario(text, "stored", {})).params.win.by, WinBy::waypoints);
  text.erase(begin, end - begin);
  const SimSpec spec = compile(parse_scenario(text, "stored", {}));
  EXPECT_EQ(spec.params.win.by, WinBy::elimination);
  EXPECT_EQ(spec.params.win.at_time_limit, LimitWinner::tie);
}

TEST(ScenarioLoad, AResolvedScenarioStandsAlone) {
  for (const ScenarioInfo& info : list_scenarios(source_data())) {
    const Scenario scenario = load(info.name);
    const std::string text = print_scenario(scenario);
    const Scenario back = parse_scenario(text, info.name, {});  // no data folder
    EXPECT_EQ(print_scenario(back), text) << info.name;
    const SimSpec a = compile(scenario), b = compile(back);
    EXPECT_EQ(a.params.cone_cos, b.params.cone_cos);
    EXPECT_EQ(a.params.damage_cone_depth2, b.params.damage_cone_depth2);
    EXPECT_EQ(a.params.win.by, b.params.win.by);
    EXPECT_EQ(a.params.win.at_time_limit, b.params.win.at_time_limit);
    EXPECT_EQ(a.agents.size(), b.agents.size());
    ASSERT_EQ(a.maps.size(), b.maps.size());
    for (size_t k = 0; k < a.maps.size(); ++k) {
      EXPECT_EQ(a.maps[k].start[0].x2, b.maps[k].start[0].x2);
      EXPECT_EQ(a.maps[k].start[0].heading_lo, b.maps[k].start[0].heading_lo);
    }
  }
}

TEST(ScenarioData, FoldersAreFound) {
  unsetenv("GIGASTEP_DATA_DIR");
  const DataDirs dirs = data_dirs();
  ASSERT_FALSE(dirs.empty());
  EXPECT_TRUE(find_data_file(dirs, "scenarios/identical_5_vs_5.yaml"));
  EXPECT_FALSE(find_data_file(dirs, "scenarios/nothing.yaml"));
  setenv("GIGASTEP_DATA_DIR", "/nowhere", 1);
  EXPECT_THROW(data_dirs(), InputError);
  setenv("GIGASTEP_DATA_DIR", test::source_path().c_str(), 1);
  EXPECT_EQ(data_dirs().front(), test::source_path());
  unsetenv("GIGASTEP_DATA_DIR");
}

TEST(ScenarioFields, AllHaveDocumentation) {
  for (const FieldInfo& info : list_fields(scenario_file_fields())) EXPECT_FALSE(info.doc.empty()) << info.path;
}

}  // namespace
}  // namespace giga
