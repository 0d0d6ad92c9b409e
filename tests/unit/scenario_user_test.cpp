// A user's own scenario files: in-place and referenced maps and agent types, derivation, changes, and every mistake.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "core/error.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "support/source.hpp"

namespace giga {
namespace {

namespace fs = std::filesystem;

/// A folder of the user's files.
class ScenarioUser : public testing::Test {
 protected:
  void SetUp() override {
    // A folder per test: ctest runs them side by side.
    folder_ = fs::path(testing::TempDir()) /
              (std::string("scenario_user_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "parts");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }
  static Scenario load(const std::string& name, const Node* changes = nullptr) {
    return load_scenario(name, {test::source_path()}, changes, changes ? "environment" : "");
  }
  /// Message of loading and compiling this text as f.yaml, without the folder.
  std::string error_of(const std::string& text) const {
    const std::string path = write("f.yaml", text);
    try {
      compile(load(path));
    } catch (const InputError& e) {
      std::string message = e.what();
      const std::string prefix = folder_.string() + "/";
      for (size_t at; (at = message.find(prefix)) != std::string::npos;) message.erase(at, prefix.size());
      return message;
    }
    return "";
  }

  fs::path folder_;
};

TEST_F(ScenarioUser, DefinesTypesAndMapsInPlace) {
  const std::string path = write("mine.yaml", R"(
description: two fast ones against one
limit_x: 30
limit_y: 20
team_0:
  - {type: fast, count: 2}
team_1:
  - {type: super, count: 1}
agent_types:
  fast: {thrust: 3, range: 1.5}
  unused: {thrust: 9}
maps: [wall, wall_flipped, center_block]
map_definitions:
  wall:
    size: [15, 20]
    boxes: [[7, 0, 8, 15], [1, 16, 2, 17, 3, 4.5]]
    team_0: {area: [1, 1, 5, 5], heading: [-1, 1]}
    team_1: {area: [10, 1, 14, 5], height: [2, 3]}
  wall_flipped:
    flipped_of: wall
)");
  const Scenario scenario = load(path);
  EXPECT_EQ(scenario.name, "mine");
  EXPECT_FALSE(scenario.agent_types.contains("unused"));
  const SimSpec spec = compile(scenario);
  ASSERT_EQ(spec.agents.size(), 3u);
  EXPECT_EQ(spec.agents[0].thrust, 3.0f);
  EXPECT_EQ(spec.agents[0].range, 1.5f);
  EXPECT_EQ(spec.agents[2].max_health, 3.0f);
  ASSERT_EQ(spec.maps.size(), 3u);
  const MapSpec& wall = spec.maps[0];
  EXPECT_FLOAT_EQ(wall.boxes[0].x1, 14);  // 7 of 15 -> of 30
  EXPECT_FLOAT_EQ(wall.boxes[0].y2, 15);
  EXPECT_EQ(wall.boxes[0].z2, 10.0f);
  EXPECT_EQ(wall.boxes[1].z1, 3.0f);  // heights are not stretched
  EXPECT_EQ(wall.boxes[1].z2, 4.5f);
  EXPECT_FLOAT_EQ(wall.start[1].x2, 28);
  EXPECT_EQ(wall.start[0].heading_hi, 1.0f);
  EXPECT_EQ(wall.start[1].z_hi, 3.0f);
  EXPECT_EQ(spec.maps[1].start[0].x2, wall.start[1].x2);
  EXPECT_EQ(spec.maps[1].boxes.size(), 2u);
  EXPECT_EQ(spec.maps[2].name, "center_block");
}

// A base has made its flipped maps already; they follow the map that they stand for, unless they are changed
// themselves.
TEST_F(ScenarioUser, AFlippedMapFollowsTheMapThatIsChanged) {
  write("parts/start.yaml",
        "base: identical_2_vs_2\nmaps: [center_block, center_block_flipped, four_rooms, four_rooms_flipped]\n");
  const Scenario scenario = load(write("mine.yaml", R"(
base: parts/start.yaml
map_definitions:
  center_block: {boxes: [[1, 2, 3, 4]], team_0: {area: [0, 0, 1, 1]}}
  four_rooms: {boxes: []}
  four_rooms_flipped: {boxes: [[5, 5, 6, 6]]}
)"));
  const SimSpec spec = compile(scenario);
  ASSERT_EQ(spec.maps.size(), 4u);
  ASSERT_EQ(spec.maps[1].boxes.size(), 1u);
  EXPECT_EQ(spec.maps[1].boxes[0].y2, 4.0f);
  EXPECT_EQ(spec.maps[1].start[1].x2, 1.0f);
  EXPECT_EQ(spec.maps[1].start[0].x2, spec.maps[0].start[1].x2);
  EXPECT_EQ(spec.maps[2].boxes.size(), 0u);
  ASSERT_EQ(spec.maps[3].boxes.size(), 1u);
  EXPECT_EQ(spec.maps[3].boxes[0].x2, 6.0f);
}

// Whatever the names, whose order is that in which forms are looked at.
TEST_F(ScenarioUser, AChainOfFlippedMapsFollowsTheMapThatIsChanged) {
  write("parts/start.yaml",
        "base: identical_2_vs_2\nmaps: [a, b, z]\n"
        "map_definitions: {a: {flipped_of: b}, b: {flipped_of: z}, z: {flipped_of: c}, c: {boxes: [[1, 1, 2, 2]]}}\n");
  const SimSpec spec = compile(load(write("mine.yaml",
                                          "base: parts/start.yaml\nmaps: [a, b, z, c]\n"
                                          "map_definitions: {c: {boxes: [[5, 5, 6, 6]]}}\n")));
  ASSERT_EQ(spec.maps.size(), 4u);
  for (const MapSpec& map : spec.maps) {
    ASSERT_EQ(map.boxes.size(), 1u) << map.name;
    EXPECT_EQ(map.boxes[0].x2, 6.0f) << map.name;
  }
  EXPECT_EQ(spec.maps[0].start[0].x2, spec.maps[3].start[1].x2);  // exchanged three times
}

TEST_F(ScenarioUser, LimitsThemselvesAreAllowed) {
  const Scenario scenario =
      load(write("mine.yaml", "base: identical_2_vs_2\nlimit_x: 0.01\nsight: {cone_angle: 6.3}\n"));
  EXPECT_EQ(scenario.limit_x, 0.01f);          // 0.0099999998 as a float
  EXPECT_EQ(scenario.sight.cone_angle, 6.3f);  // 6.3000002
  EXPECT_EQ(error_of("sight: {cone_angle: 6.300001}\n"),
            "f.yaml:1:21: sight.cone_angle: '6.300001' is not a number in [0, 6.3]");
}

TEST_F(ScenarioUser, RefersToPartsAndBaseByPath) {
  write("parts/quick.yaml", "thrust: 4\n");
  write("parts/hall.yaml", "boxes: [[4, 4, 6, 6]]\n");
  write("parts/hall_flipped.yaml", "flipped_of: empty\n");
  write("parts/start.yaml", "base: special_5_vs_1_fobs\nteam_0: [{type: ./quick.yaml, count: 2}]\nlimit_x: 12\n");
  const std::string path =
      write("mine.yaml", "base: parts/start.yaml\nmaps: [parts/hall.yaml, ./parts/hall_flipped.yaml]\n");
  const Scenario scenario = load(path);
  EXPECT_EQ(scenario.sight.cone_depth, 100.0f);
  EXPECT_TRUE(scenario.description.empty());  // that of the base is not this one's
  const SimSpec spec = compile(scenario);
  EXPECT_EQ(spec.params.n_team[0], 2);
  EXPECT_EQ(spec.agents[0].thrust, 4.0f);
  EXPECT_EQ(spec.params.limit_x, 12.0f);
  EXPECT_EQ(spec.maps[0].name, "hall");
  EXPECT_EQ(spec.maps[1].start[0].x1, spec.maps[0].start[1].x1);
  // Resolved, it needs none of these files.
  fs::remove_all(folder_ / "parts");
  EXPECT_EQ(compile(parse_scenario(print_scenario(scenario), "mine", {})).maps[0].boxes[0].x2,
            spec.maps[0].boxes[0].x2);
}

TEST_F(ScenarioUser, ChangesComeLast) {
  Document document = parse_yaml_text("environment: {rewards: {damage: 50}, maps: center_block}\n", "run.yaml");
  set_override(document, "environment.rules=original");
  const Scenario scenario = load("identical_5_vs_5_void", document.root.find("environment"));
  EXPECT_EQ(scenario.rewards[RewardTerm::damage], 50.0f);
  EXPECT_EQ(scenario.rewards[RewardTerm::game_won], 10.0f);
  EXPECT_EQ(scenario.rules, Rules::original);
  EXPECT_EQ(compile(scenario).maps.size(), 1u);

  document = parse_yaml_text("environment: {rewards: {damge: 50}, base: x, team_0: [{type: supper}]}\n", "run.yaml");
  try {
    load("identical_5_vs_5", document.root.find("environment"));
    FAIL() << "no error";
  } catch (const InputError& e) {
    const std::string message = e.what();
    EXPECT_NE(message.find("run.yaml:1:25: environment.rewards.damge: unknown key; nearest: 'damage'"),
              std::string::npos);
    EXPECT_NE(message.find("run.yaml:1:37: environment.base: unknown key"), std::string::npos) << message;
    EXPECT_NE(message.find("run.yaml:1:62: team_0[0].type: unknown agent type 'supper'; nearest: 'super'"),
              std::string::npos)
        << message;
  }
}

TEST_F(ScenarioUser, TypesMayStandSideBySide) {
  const Document document = parse_yaml_text(
      "environment: {agent_types: {fast_1: {thrust: 2}, fast_2: {thrust: 3}}, team_0: [{type: fast_2}]}\n", "run.yaml");
  const Scenario scenario = load("identical_5_vs_5", document.root.find("environment"));
  EXPECT_EQ(scenario.agent_types.at("fast_2").thrust, 3);
  EXPECT_FALSE(scenario.agent_types.contains("fast_1")) << "not used, and not taken for a misspelt fast_2";
}

TEST_F(ScenarioUser, AnUnknownNameGetsTheNearest) {
  try {
    load("identical_5_vs5_fobs");
    FAIL() << "no error";
  } catch (const InputError& e) {
    EXPECT_EQ(std::string(e.what()).substr(0, 76),
              "unknown scenario 'identical_5_vs5_fobs'; nearest: 'identical_5_vs_5', 'ident");
  }
}

TEST_F(ScenarioUser, SaysWhatIsWrongWithAFile) {
  const std::string head = "base: identical_5_vs_5\n";
  const std::string types = "default, faster, hider, more_health, more_range, seeker, super";
  const std::string maps =
      "center_block, center_block_flipped, empty, empty_flipped, four_rooms, four_rooms_flipped, two_rooms1, "
      "two_rooms2_flipped";
  write("a.yaml", "base: f.yaml\n");
  write("center_block.yaml", "boxes: []\n");
  write("parts/super.yaml", "thrust: 4\n");
  const std::pair<std::string, std::string> cases[] = {
      {head + "team_1: []\n",
       "f.yaml:2:9: team_1: the team is empty; it needs at least one entry such as {type: default, count: 5}"},
      {head + "team_0: [{type: seekr}]\n",
       "f.yaml:2:17: team_0[0].type: unknown agent type 'seekr'; nearest: 'seeker'; known: " + types},
      {head + "team_0: [{type: default, count: 0}]\n",
       "f.yaml:2:33: team_0[0].count: '0' is not an integer in [1, 1000000]"},
      {head + "team_0: [{type: default, count: 999999}, {type: default, count: 999999}, "
              "{type: default, count: 999999}, {type: default, count: 999999}, {type: default, count: 999999}]\n",
       "f.yaml:2:9: team_0, team_1: 5000000 agents in a world; allowed: at most 4194304"},
      {head + "team_0: [{type: default, count: 1020}]\nobservation: {type: rgb}\nrewards: {approach: 1}\n",
       "f.yaml:3:21: observation.type: 1025 agents in a world; above 1024 there are no images; allowed: vector\n"
       "f.yaml:4:21: rewards.approach: 1025 agents in a world; above 1024 ways are straight; allowed: 0, or maps "
       "without "
       "obstacles"},
      {head + "limit_x: 40000\nmaps: empty\n",
       "f.yaml:2:10: limit_x: in a world of 40000 units places are too coarse for the slowest step; allowed: at most "
       "32768"},
      // It stands after 1 - 0.15 * 6.67 < 0.
      {head + "team_0: [{type: stops}]\nagent_types: {stops: {thrust: 8.6667}}\nlimit_x: 32768\nmaps: empty\n",
       "f.yaml:3:31: agent_types.stops.thrust: with 8.6667 the slowest step is 0 units, and in a world of 32768 units "
       "places are 0.00195312 apart, more than 1 / 32 of that; allowed: at most 2.39 in this world, or sides of at "
       "most 1024"},
      {head + "maps: two_room\n", "f.yaml:2:7: maps: unknown map 'two_room'; nearest: 'two_rooms1'; known: " + maps},
      {head + "maps: [empty, x, empty]\n",
       "f.yaml:2:15: maps: unknown map 'x'; known: " + maps + "\nf.yaml:2:18: maps: 'empty' is named twice"},
      {head + "maps: []\n", "f.yaml:2:7: maps: has 0 items, expected a list of at least 1 item, each a text"},
      {head + "maps: nowhere.yaml\n", "f.yaml:2:7: no such file: nowhere.yaml"},
      {head + "maps: [center_block, center_block.yaml]\n",
       "f.yaml:2:22: maps: there are two maps named 'center_block'\nf.yaml:2:22: maps: 'center_block' is named twice"},
      {head + "maps: m\nmap_definitions:\n  m:\n    team_0: {area: [6, 1, 11, 9]}\n",
       "f.yaml:5:20: map 'm': the start area of team 0, [6, 1, 11, 9], reaches outside the world of 10 x 10"},
      {head + "maps: m\nmap_definitions:\n  m:\n    boxes: [[0, 0, 5, 10]]\n",
       "f.yaml:4:3: map 'm': the start area of team 1, [1, 1, 4, 9], lies inside an obstacle"},
      // Neither alone.
      {head + "maps: m\nmap_definitions: {m: {boxes: [[0, 0, 5, 5], [0, 5, 5, 10]]}}\n",
       "f.yaml:3:19: map 'm': the start area of team 1, [1, 1, 4, 9], lies inside obstacles"},
      {head + "maps: m\nmap_definitions: {m: {boxes: [[4, 4, 5, 5], [10, 0, 12, 5]]}}\n",
       "f.yaml:3:45: map 'm': the box [10, 0, 12, 5], lies outside the map, whose size is [10, 10]"},
      {head + "maps: m\nmap_definitions: {m: {boxes: [[3, 3, 7, 7, 11, 12]]}}\ncollision: {obstacle_heights: true}\n",
       "f.yaml:3:31: map 'm': the box [3, 3, 7, 7, 11, 12], lies outside the altitudes, 0 to 10"},
      {head + "agent_types: {defualt: {thrust: 2}}\n",
       "f.yaml:2:24: agent_types.defualt: the game has no 'defualt'; nearest: 'default'"},
      {head + "maps: m\nmap_definitions: {m: {team_1: {heading: [0, 90]}}}\n",
       "f.yaml:3:45: map_definitions.m.team_1.heading[1]: '90' is not a number in [-6.3, 6.3]"},
      {head + "rewards: {agent_disabled: -10}\n", "f.yaml:2:27: rewards.agent_disabled: '-10' is not a number >= 0"},
      {"team_0: [{type: default}]\n",
       "f.yaml:1:1: team_1: the team is empty; it needs at least one entry such as {type: default, count: 5}"},
      {"base: identical_5_vs_5_maps_void\n",
       "f.yaml:1:7: unknown scenario 'identical_5_vs_5_maps_void'; a name has one of _maps and _void, once; allowed: "
       "the "
       "names that `gigastep scenarios` lists, with suffixes in any order (_fobs|_pobs, _rgb|_vec, _maps|_void, "
       "_cont|_disc), or the path of a YAML file"},
      {"base: ./f.yaml_void\n",
       "f.yaml:1:7: no such file: f.yaml_void; suffixes follow names; a file states their keys"},
      {head + "maps: m\nmap_definitions: {m: {team_1: {area: [4, 1, 1, 9]}}}\n",
       "f.yaml:3:38: map 'm': the start area of team 1, [4, 1, 1, 9], needs x1 <= x2 and y1 <= y2"},
      {head + "maps: m\nmap_definitions: {m: {team_1: {area: [4, 1, 1, 9], height: [5, 2]}}}\n",
       "f.yaml:3:38: map 'm': the start area of team 1, [4, 1, 1, 9], needs x1 <= x2 and y1 <= y2\n"
       "f.yaml:3:60: map 'm': the start area of team 1, [4, 1, 1, 9]: the height goes from low to high, and is [5, 2]"},
      {head + "team_0: [{type: ./parts/super.yaml}]\n",
       "f.yaml:2:17: team_0[0].type: ./parts/super.yaml has the name of the agent type 'super', which gigastep brings: "
       "give "
       "the "
       "file another name"},
      {head + "team_0: [{type: scot}]\nagent_types: {scout: {thrust: 2}}\n",
       "f.yaml:2:17: team_0[0].type: unknown agent type 'scot'; nearest: 'scout'; known: default, scout" +
           types.substr(7)},
      {head + "map_definitions: {m: {boxes: [[1, 2, 3], [2, 2, 1, 3]]}}\n",
       "f.yaml:2:31: map_definitions.m.boxes[0]: a list is not a box [x1, y1, x2, y2] or [x1, y1, x2, y2, z1, z2]\n"
       "f.yaml:2:42: map_definitions.m.boxes[1]: a box needs x1 < x2, y1 < y2 and z1 < z2, got [2, 2, 1, 3]"},
      {head + "maps: m\nmap_definitions: {m: {flipped_of: n}, n: {flipped_of: m}}\n",
       "f.yaml:3:35: map_definitions.m.flipped_of: 'n' leads back to this map"},
      // Rings of an odd number, whose starts never come to rest.
      {head + "maps: m\nmap_definitions: {m: {flipped_of: m}}\n",
       "f.yaml:3:35: map_definitions.m.flipped_of: 'm' leads back to this map"},
      {head + "maps: m\nmap_definitions: {m: {flipped_of: n}, n: {flipped_of: o}, o: {flipped_of: m}}\n",
       "f.yaml:3:75: map_definitions.o.flipped_of: 'm' leads back to this map"},
      {head + "maps: m\nmap_definitions: {m: {flipped_of: empty, boxes: [[1, 1, 2, 2]]}}\n",
       "f.yaml:3:35: map_definitions.m.flipped_of: takes the whole map from 'empty'; drop the other keys"},
      {head + "damage: {min_tracking_time: 11}\n",
       "f.yaml:2:29: damage.min_tracking_time: 11 is more than max_tracking_time, 10"},
      {head + "damage: {max_tracking_time: 256}\n",
       "f.yaml:2:29: damage.max_tracking_time: '256' is not an integer in [0, 255]"},
      {head + "waypoints: {enable_waypoints: true, waypoint_size: 11}\n",
       "f.yaml:2:52: waypoints.waypoint_size: 11 does not fit into a world of 10 x 10"},
      {head + "waypoints: {shown_steps: 1}\n",
       "f.yaml:2:26: waypoints.shown_steps: this means nothing without waypoints.enable_waypoints: true"},
      {head + "waypoints: {enable_waypoints: true, shown_steps: 1}\nrules: original\n",
       "f.yaml:2:50: waypoints.shown_steps: the original shows waypoints as long as they stay; it needs rules: "
       "corrected"},
      {head + "waypoints: {enable_waypoints: true, shown_steps: 100}\n",
       "f.yaml:2:50: waypoints.shown_steps: '100' is not an integer in [1, 99] or none"},
      {head + "win: {by: waypoints}\n", "f.yaml:2:11: win.by: waypoints needs waypoints.enable_waypoints: true"},
      {head + "win: {at_time_limit: team_1}\nmax_episode_length: none\n",
       "f.yaml:2:22: win.at_time_limit: team_1 needs a time limit, and max_episode_length is none"},
      {head + "win: {by: score}\n", "f.yaml:2:11: win.by: 'score' is not one of: elimination, waypoints"},
      {head + "observation: {type: pixels}\n",
       "f.yaml:2:21: observation.type: 'pixels' is not one of: vector, rgb, rgb_vector"},
      {head + "observation: {type: rgb, resolution: 4}\n",
       "f.yaml:2:38: observation.resolution: '4' is not an integer in [8, 512]"},
      {head + "observation: {resolution: 64}\n",
       "f.yaml:2:27: observation.resolution: there are no images with observation.type vector; rgb and "
       "rgb_vector have them"},
      {head + "observation: {type: rgb, egocentric_view: true}\n",
       "f.yaml:2:43: observation.egocentric_view: these are numbers, and observation.type rgb gives images alone; "
       "rgb_vector gives both"},
      {head + "rules: orignal\n",
       "f.yaml:2:8: rules: 'orignal' is not one of: corrected, original; nearest: 'original'"},
      {"base: a.yaml\n", "a.yaml:1:7: base: 'f.yaml' leads back to this file"},
      {"base: nowhere.yaml\n", "f.yaml:1:7: no such file: nowhere.yaml"},
  };
  for (const auto& [text, expected] : cases) EXPECT_EQ(error_of(text), expected) << text;
}

// What a file gives stands for all that its base gave for the key, its place too: a path counts from there.
TEST_F(ScenarioUser, PathsCountFromTheFileThatNamesThem) {
  write("parts/a.yaml", "boxes: [[4, 4, 5, 5]]\n");
  write("parts/b.yaml", "base: identical_5_vs_5\nmaps: [a.yaml]\n");
  write("mine.yaml", "boxes: []\n");
  EXPECT_EQ(error_of("base: parts/b.yaml\nmaps: mine.yaml\n"), "");
  EXPECT_EQ(load(folder_ / "f.yaml").maps.names, std::vector<std::string>{"mine"});
  EXPECT_EQ(error_of("base: parts/b.yaml\nmaps: a.yaml\n"), "f.yaml:2:7: no such file: a.yaml; nearest: 'f.yaml'");

  // Behind a link to a folder `..` is where that folder lies.
  fs::create_directories(folder_ / "real/deep");
  fs::create_directory_symlink("real/deep", folder_ / "link");
  write("real/b.yaml", "base: identical_2_vs_2\n");
  write("link/e.yaml", "base: ../b.yaml\n");
  EXPECT_EQ(load(folder_ / "link/e.yaml").team_0.front().count, 2);
}

// The slowest step is the first, with full brakes: v1 = 1 - 0.15 thrust, v2 = v1 - 0.04 v1^2, and v2 / 10 units.
TEST_F(ScenarioUser, TheSlowestStepIsFarAboveTheResolutionOfPlaces) {
  const auto error = [&](float thrust, float limit_x, float limit_y) {
    return error_of(cat("base: identical_5_vs_5\nteam_1: [{type: own}]\nmaps: empty\nlimit_x: ", limit_x,
                        "\nlimit_y: ", limit_y, "\nagent_types: {own: {thrust: ", thrust, "}}\n"));
  };
  const auto refusal = [](float thrust, const char* step, float side, const char* apart, const char* allowed) {
    return cat("f.yaml:6:29: agent_types.own.thrust: with ", thrust, " the slowest step is ", step,
               " units, and in a world of ", side, " units places are ", apart, " apart, more than 1 / 32 of that; ",
               "allowed: at most ", allowed);
  };
  // Of 32,768: places are 1 / 512 apart, and 32 / 512 = 0.0625. 2.39: v1 = 0.6415, v2 = 0.6415 - 0.016461 = 0.625039.
  // 2.4: v1 = 0.64, v2 = 0.64 - 0.016384 = 0.623616. One place in 16,384 is 1 / 1,024, and 32 of them 0.03125.
  EXPECT_EQ(error(2.39f, 32768, 10), "");
  EXPECT_EQ(error(2.4f, 32768, 10),
            refusal(2.4f, "0.0623616", 32768, "0.00195312", "2.39 in this world, or sides of at most 16384"));
  EXPECT_EQ(error(2.4f, 16384, 16384), "");
  // The longer side counts: 22,361 units are above 16,384, where it is 1 / 512 again.
  EXPECT_EQ(error(2.4f, 10, 22361),
            refusal(2.4f, "0.0623616", 22361, "0.00195312", "2.39 in this world, or sides of at most 16384"));
  // Of 2,000: 1 / 8,192 apart, and 32 of them are 0.00390625: v2 = 0.0390625, v1 = 0.0391238, thrust = 6.405841.
  EXPECT_EQ(error(6.4f, 2000, 2000), "");  // v1 = 0.04, v2 = 0.039936
  EXPECT_EQ(error(7, 2000, 10),            // v1 = -0.05: with a little less throttle it stands
            refusal(7, "0", 2000, "0.00012207", "6.4 in this world, or sides of at most 1024"));
  // Up to 1,024 units, 1 / 16,384 apart, it may stand.
  EXPECT_EQ(error(100, 1024, 1024), "");
  // What ships flies anywhere: `faster` brakes to v1 = 0.7, v2 = 0.7 - 0.0196 = 0.6804.
  for (const char* type : {"default", "more_health", "more_range", "faster", "super", "hider", "seeker"})
    EXPECT_EQ(error_of(cat("base: identical_5_vs_5\nteam_0: [{type: ", type,
                           "}]\nlimit_x: 32768\nlimit_y: 32768\nmaps: empty\n")),
              "")
        << type;
}

TEST_F(ScenarioUser, StartAreasMayTouchObstaclesAndBorders) {
  EXPECT_EQ(
      error_of("base: identical_5_vs_5\nlimit_x: 13\nmaps: m\nmap_definitions:\n  m:\n    size: [7, 7]\n"
               "    boxes: [[0, 0, 6.5, 7]]\n    team_0: {area: [0, 0, 7, 7]}\n    team_1: {area: [6, 0, 7, 7]}\n"),
      "");
}

}  // namespace
}  // namespace giga
