#include "eval/played_game.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "config/settings.hpp"
#include "core/error.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "scenario/policy_shape.hpp"

namespace giga {
namespace {

/// What `--set` may change here.
struct GameChanges {
  Node environment;
};
template <class V>
void visit_fields(V& v, GameChanges& c) {
  v.tree("environment", c.environment, "changes to the scenario: any of its keys", fields_of_default<Scenario>);
}

bool is_of(const std::string& key, std::initializer_list<std::string_view> groups) {
  return std::any_of(groups.begin(), groups.end(), [&key](std::string_view group) {
    return key == group || (key.starts_with(group) && key[group.size()] == '.');
  });
}

/// Rewards are for learning; what is observed belongs to the policy; a description is for people.
bool makes_another_game(const std::string& key) {
  const bool of_map = is_of(key, {"map_definitions"}) && key.ends_with(".description");
  return !of_map && !is_of(key, {"rewards", "observation", "action", "description"});
}

/// "sight.cone_depth: 3 there, 5 here", one for each key that makes another game. Maps and kinds of agents that only
/// one of them has are told by `maps` and the teams.
std::vector<std::string> differences(const Scenario& there, const Scenario& here, const std::string& name_there,
                                     const std::string& name_here) {
  std::vector<std::string> all;
  for (const auto& [key, before, now] : compare_settings(settings_of(there), settings_of(here)))
    if (makes_another_game(key) && !((before.empty() || now.empty()) && is_of(key, {"map_definitions", "agent_types"})))
      all.push_back(cat(key, ": ", before.empty() ? "-" : before, " ", name_there, ", ", now.empty() ? "-" : now, " ",
                        name_here));
  return all;
}

void expect_one_game(const std::vector<const Player*>& players, const Player& first) {
  for (const Player* player : players) {
    if (!player->origin()) continue;
    const std::vector<std::string> all = differences(first.origin()->run.scenario, player->origin()->run.scenario,
                                                     "in " + first.name(), "in " + player->name());
    if (!all.empty())
      throw InputError(
          cat(first.name(), " and ", player->name(),
              " were trained in different games: say with --scenario which one is played; what differs:\n  ",
              join(all, "\n  ")));
  }
}

/// What the policies observe, and how they act: images and numbers where some learned from these and some from those. A
/// policy without the egocentric view is not given it.
void carry_over(const std::vector<const Player*>& players, const Player& first, Scenario& scenario) {
  const Scenario& own = first.origin()->run.scenario;
  scenario.observation = own.observation;
  scenario.action = own.action;
  ObservationConfig& seen = scenario.observation;
  for (const Player* player : players) {
    if (!player->origin()) continue;
    const ObservationConfig& there = player->origin()->run.scenario.observation;
    if (there.egocentric_view) seen.egocentric_view = true;
    if (there.type != seen.type) seen.type = ObservationType::rgb_vector;
    if (player->reads_image()) seen.resolution = there.resolution;
  }
}

void change(const std::vector<std::string>& assignments, Scenario& scenario) {
  Errors errors;
  Document document{"--set", {}};
  for (const std::string& assignment : assignments) set_override(document, assignment, errors);
  GameChanges changes;
  if (!document.root.is_null()) read_fields(document.root, changes, errors);
  errors.throw_if_any();
  if (!changes.environment.is_null())
    change_scenario(changes.environment, "environment", data_dirs(), scenario, errors);
  errors.throw_if_any();
}

}  // namespace

PlayedGame choose_game(const GameRequest& request, const std::vector<const Player*>& teams, OtherGames others) {
  std::vector<const Player*> players;  // in mixed teams those who play in them
  for (const Player* team : teams)
    for (const Player* member : team->members()) players.push_back(member);
  const auto found = std::find_if(players.begin(), players.end(), [](const Player* p) { return p->origin(); });
  const Player* first = found == players.end() ? nullptr : *found;
  PlayedGame game;
  if (!request.scenario.empty()) {
    game.scenario = load_scenario(request.scenario, data_dirs());
  } else if (first) {
    if (others == OtherGames::refused) expect_one_game(players, *first);
    game.scenario = first->origin()->run.scenario;
    game.scenario.name = first->origin()->scenario_name;
  } else {
    std::vector<std::string> names;
    for (const Player* player : players) names.push_back(player->name());
    throw InputError(cat("no checkpoint or manifest says which scenario is played by ", join(names, " and "),
                         ": name one with --scenario"));
  }
  if (first && first->origin()->run.scenario.action != game.scenario.action)
    game.notes.push_back(cat("actions stay ", FieldCodec<ActionKind>::print(first->origin()->run.scenario.action),
                             ", as ", first->name(), " was trained"));
  if (first) carry_over(players, *first, game.scenario);
  change(request.changes, game.scenario);
  game.spec = compile(game.scenario);

  for (const Player* player : players) {
    if (!player->origin()) continue;
    const Scenario& trained = player->origin()->run.scenario;
    const std::vector<std::string> all = differences(trained, game.scenario, "in training", "here");
    player->check_plays(game.spec, &game.scenario);
    if (!all.empty() && request.scenario.empty() && request.changes.empty())
      game.notes.push_back(cat(player->name(), " was trained in another game: ", join(all, "; ")));
  }
  return game;
}

}  // namespace giga
