// Defaults and codecs of a scenario that need more than a line.
#include "scenario/scenario.hpp"

#include "core/error.hpp"

namespace giga {

RewardConfig::RewardConfig() : weight{} {
  (*this)[RewardTerm::game_won] = 10;
  (*this)[RewardTerm::defeat_one_opponent] = 100;
}

const char* reward_doc(RewardTerm term) {
  switch (term) {
    case RewardTerm::hit_waypoint:
      return "for being inside a waypoint";
    case RewardTerm::defeat_one_opponent:
      return "for each opponent lost, less each team mate lost, over the team's living + 1";
    case RewardTerm::detection:
      return "a second, for each opponent detected (0.5), less for each that detects the agent (0.2)";
    case RewardTerm::damage:
      return "a second, for damage dealt, less half of that taken";
    case RewardTerm::idle:
      return "penalty for being alive, in thousandths a step";
    case RewardTerm::collision_agent:
      return "penalty for colliding with an agent";
    case RewardTerm::collision_obstacle:
      return "penalty for hitting an obstacle or leaving the world";
    case RewardTerm::agent_disabled:
      return "penalty for dying";
    case RewardTerm::game_won:
      return "for the living when the opposing team is wiped out";
    case RewardTerm::approach:
      return "for each map unit by which the agent has shortened its way to the nearest living opponent, round "
             "obstacles";
    case RewardTerm::idle_reward:
      break;  // belongs to the agent type
  }
  return "weight of this term";
}

MapSelection MapSelection::all() {
  return {{"empty", "empty_flipped", "two_rooms1", "two_rooms2_flipped", "four_rooms", "four_rooms_flipped",
           "center_block", "center_block_flipped"}};
}

MapSelection MapSelection::empty() { return {{"empty", "empty_flipped"}}; }

bool FieldCodec<MapSelection>::read(const Node& node, MapSelection& maps, const Allowed& allowed,
                                    const ReadSite& site) {
  if (node.is_sequence()) return FieldCodec<std::vector<std::string>>::read(node, maps.names, allowed.items(1), site);
  if (!node.is_scalar()) return site.fail(node, expected(allowed));
  if (node.text == "all")
    maps = MapSelection::all();
  else if (node.text == "empty")
    maps = MapSelection::empty();
  else
    maps.names = {node.text};
  return true;
}

ValueShape FieldCodec<MapSelection>::shape(const Allowed&) {
  const ValueShape text{ValueShape::Kind::text};
  return {ValueShape::Kind::either, {}, {text, {ValueShape::Kind::list, Allowed{}.items(1), {text}}}};
}

std::string FieldCodec<MapSelection>::print(const MapSelection& maps) {
  if (maps == MapSelection::all()) return "all";
  if (maps == MapSelection::empty()) return "empty";
  return FieldCodec<std::vector<std::string>>::print(maps.names);
}

bool FieldCodec<MapBox>::read(const Node& node, MapBox& box, const Allowed& allowed, const ReadSite& site) {
  const size_t n = node.items.size();
  if (!node.is_sequence() || (n != 4 && n != 6)) return site.fail(node, expected(allowed));
  std::vector<float> values;
  if (!FieldCodec<std::vector<float>>::read(node, values, {}, site)) return false;
  MapBox result;
  for (size_t k = 0; k < 4; ++k) result.area[k] = values[k];
  if (n == 6) result.height = {values[4], values[5]};
  const bool ordered =
      result.area[0] < result.area[2] && result.area[1] < result.area[3] && result.height[0] < result.height[1];
  if (!ordered) {
    site.errors.add(node.at, site.path + ": a box needs x1 < x2, y1 < y2 and z1 < z2, got " + print(result));
    return false;
  }
  box = result;
  return true;
}

ValueShape FieldCodec<MapBox>::shape(const Allowed&) {
  const auto list_of = [](size_t n) {
    return ValueShape{ValueShape::Kind::list, Allowed{}.items(n, n), {{ValueShape::Kind::real}}};
  };
  return {ValueShape::Kind::either, {}, {list_of(4), list_of(6)}};
}

std::string FieldCodec<MapBox>::print(const MapBox& box) {
  std::vector<float> values(box.area.begin(), box.area.end());
  if (box.height != MapBox{}.height) values.insert(values.end(), box.height.begin(), box.height.end());
  return FieldCodec<std::vector<float>>::print(values);
}

Position Scenario::position_of(const std::vector<std::string>& keys) const {
  for (const std::string& key : keys)
    if (const auto found = where.find(key); found != where.end()) return found->second;
  return file_start.value_or(Position{std::make_shared<const std::string>("scenario " + name)});
}

std::string describe_win(const WinRule& win, int time_limit) {
  const bool by_waypoints = win.by == WinBy::waypoints;
  const std::string at_limit = cat(by_waypoints ? "as many" : "both live", " after ", time_limit, " steps");
  const bool limit_wins = time_limit > 0 && win.at_time_limit != LimitWinner::tie;
  std::string text = by_waypoints ? "A win: more waypoints than the other team when the episode ends"
                                  : "A win: the other team is wiped out first";
  if (limit_wins) text += cat("; for team ", win.at_time_limit == LimitWinner::team_0 ? 0 : 1, " also: ", at_limit);
  text += by_waypoints ? ". A tie: as many" : ". A tie: both are wiped out in the same step";
  if (limit_wins && by_waypoints) return text + " in an episode that ends earlier.";
  if (time_limit > 0 && !limit_wins && !by_waypoints) text += ", or " + at_limit;
  return text + ".";
}

std::string print_scenario(const Scenario& scenario) {
  return cat("# Scenario ", scenario.name, " with all its keys.\n# ",
             describe_win(scenario.win, scenario.max_episode_length.value_or(0)), "\n", print_yaml(scenario, true));
}

}  // namespace giga
