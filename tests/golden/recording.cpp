// Finding recordings and reading a recorded configuration.
#include "golden/recording.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "core/error.hpp"
#include "core/geometry.hpp"
#include "support/source.hpp"

namespace giga::golden {
namespace {

float f32(double value) { return static_cast<float>(value); }
float squared(double value) { return f32(value) * f32(value); }

}  // namespace

bool foreign_folder() {
  const char* folder = std::getenv("GIGASTEP_GOLDEN_DIR");
  return folder && *folder;
}

std::vector<Recording> recordings() {
  const std::filesystem::path folder = foreign_folder() ? std::filesystem::path(std::getenv("GIGASTEP_GOLDEN_DIR"))
                                                        : std::filesystem::path(test::source_path("tests/golden/data"));
  GIGA_CHECK(std::filesystem::is_directory(folder), "no folder ", folder.string());
  std::vector<Recording> found;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".h5") continue;
    Recording recording{entry.path().filename().string(), H5Group::open(entry.path().string())};
    bool known = !step_cases(recording.root).empty();
    for (const char* kind : {"reset", "maps", "action_lut", "policies", "rollout_stats", "reset_stats",
                             "scenario_params_json", "base_scenario_agents_json"})
      known = known || recording.root.has(kind);
    GIGA_CHECK(known, recording.file, " holds nothing that these tests know");
    found.push_back(std::move(recording));
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.file < b.file; });
  GIGA_CHECK(!found.empty(), "no *.h5 in ", folder.string());
  return found;
}

std::vector<std::string> step_cases(const H5Group& root) {
  std::vector<std::string> cases;
  for (const std::string& name : root.children())
    if (root.has(name + "/before") && root.has(name + "/after")) cases.push_back(name);
  return cases;
}

Params::Params(const std::string& json, const std::string& name) : document_(parse_yaml_text(json, name)) {}

const Node& Params::node(const std::string& key) const {
  const Node* found = document_.root.find(key);
  GIGA_CHECK(found, document_.name, " has no key ", key);
  return *found;
}

double Params::number(const std::string& key) const {
  const std::string& text = node(key).text;
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  GIGA_CHECK(!text.empty() && *end == '\0', document_.name, ": ", key, " is '", text, "', no number");
  return value;
}

bool Params::flag(const std::string& key) const {
  const std::string& text = node(key).text;
  GIGA_CHECK(text == "true" || text == "false", document_.name, ": ", key, " is '", text, "', no flag");
  return text == "true";
}

bool Params::is_null(const std::string& key) const {
  const Node& value = node(key);
  return value.is_null() || value.text == "null";
}

SimParams recorded_params(const Params& params) {
  SimParams p;
  p.rules = Rules::original;
  p.actions = params.flag("discrete_actions") ? ActionKind::discrete : ActionKind::continuous;
  p.limit_x = f32(params.number("limit_x"));
  p.limit_y = f32(params.number("limit_y"));
  p.very_close_depth2 = squared(params.number("very_close_cone_depth"));
  p.cone_depth2 = squared(params.number("cone_depth"));
  p.cone_cos = f32(std::cos(params.number("cone_angle")));
  p.cone_is_full = f32(params.number("cone_angle")) >= kPi;
  p.damage_cone_depth2 = squared(params.number("damage_cone_depth"));
  p.damage_cone_cos = f32(std::cos(params.number("damage_cone_angle")));
  p.damage_cone_is_full = f32(params.number("damage_cone_angle")) >= kPi;
  p.stochastic_detection = params.flag("use_stochastic_obs");
  p.stochastic_communication = params.flag("use_stochastic_comm");
  p.communication_range = f32(params.number("communication_range"));
  p.damage_per_second = f32(params.number("damage_per_second"));
  p.healing_per_second = f32(params.number("healing_per_second"));
  p.min_tracking_time = static_cast<int>(params.number("min_tracking_time"));
  p.max_tracking_time = static_cast<int>(params.number("max_tracking_time"));
  p.collision_range2 = squared(params.number("collision_range"));
  p.collision_altitude = f32(params.number("collision_altitude"));
  p.waypoints = params.flag("enable_waypoints");
  p.waypoint_size = f32(params.number("waypoint_size"));
  p.max_episode_length =
      params.is_null("max_episode_length") ? 0 : static_cast<int>(params.number("max_episode_length"));
  p.episode_ends_one_team_dead = params.flag("episode_ends_one_team_dead");
  for (int t = 0; t < kNOriginalRewardTerms; ++t)
    if (static_cast<RewardTerm>(t) != RewardTerm::idle_reward)
      p.reward_weight[t] = f32(params.number(std::string("reward_") + kRewardTermNames[t]));
  p.divide_reward_by_team_size = params.flag("divide_reward_by_team_size");
  return p;
}

std::vector<MapSpec> recorded_maps(const H5Group& recorded, const std::string& prefix) {
  const Array<float> boxes = recorded.floats(prefix + "boxes");
  const Array<float> height = recorded.floats(prefix + "start_height");
  // Team 1 starts in area a, team 0 in area b.
  const Array<float> area[kNTeams] = {recorded.floats(prefix + "start_pos_team_b"),
                                      recorded.floats(prefix + "start_pos_team_a")};
  const Array<float> heading[kNTeams] = {recorded.floats(prefix + "start_heading_b"),
                                         recorded.floats(prefix + "start_heading_a")};
  std::vector<MapSpec> maps(height.rows());
  for (size_t m = 0; m < maps.size(); ++m) {
    maps[m].name = cat("recorded map ", m);
    for (size_t b = 0; b < boxes.shape[1]; ++b) {
      const float* at = boxes.data.data() + (m * boxes.shape[1] + b) * 4;
      maps[m].boxes.push_back({at[0], at[1], at[2], at[3], 0, kAltitudeLimit});
    }
    for (int team = 0; team < kNTeams; ++team) {
      const float *where = area[team].row(m), *z = height.row(m), *h = heading[team].row(m);
      maps[m].start[team] = {where[0], where[1], where[2], where[3], z[0], z[1], h[0], h[1]};
    }
  }
  return maps;
}

SimSpec recorded_spec(const H5Group& recorded, const std::string& name) {
  const Params params(recorded.text_attribute("params"), name + " params");
  const H5Group config = recorded.group("config");
  SimSpec spec;
  spec.name = name;
  spec.params = recorded_params(params);
  spec.neighbor_limit = static_cast<int>(params.number("max_agent_in_vec_obs"));
  const Array<int32_t> team = config.ints("team"), sprite = config.ints("sprite");
  const Array<float> thrust = config.floats("thrust"), max_health = config.floats("max_health"),
                     range = config.floats("range"), damage_range = config.floats("damage_range"),
                     idle_reward = config.floats("idle_reward");
  for (size_t i = 0; i < team.data.size(); ++i)
    spec.agents.push_back({team.data[i], sprite.data[i], thrust.data[i], max_health.data[i], range.data[i],
                           damage_range.data[i], idle_reward.data[i]});
  spec.maps = recorded_maps(config, "maps_");
  spec.finish();
  return spec;
}

const float* RecordedDraws::checked(const float* p, const char* name) {
  GIGA_CHECK(p, "the simulator asks for a draw that was not recorded: ", name);
  return p;
}

int RecordedDraws::map(int n_maps) const {
  GIGA_CHECK(map_index >= 0, "the simulator asks for a map, which was not recorded");
  return std::min(map_index, n_maps - 1);
}

float RecordedDraws::start(int agent, int round, StartDraw what) const {
  const int k = static_cast<int>(what);
  if (round == 0) return checked(start_at[k], "start")[agent];
  return checked(retry_at[k], "start retry")[(round - 1) * n_agents + agent];
}

}  // namespace giga::golden
