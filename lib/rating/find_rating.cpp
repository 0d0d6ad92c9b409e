#include "rating/find_rating.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <system_error>

#include "config/document.hpp"
#include "rating/sheet.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

const std::vector<Node>& items_of(const Node& map, const char* key) {
  static const std::vector<Node> kNone;
  const Node* list = map.find(key);
  return list ? list->items : kNone;
}

std::string text_of(const Node& map, const char* key) {
  const Node* value = map.find(key);
  return value && value->is_scalar() ? value->text : "";
}

void copy(const Node& from, const char* key, Json& to) {
  if (const Node* value = from.find(key)) to[key] = json_of(*value);
}

/// Whether the run of a player, whose folder is told relative to that of the ratings, is in `run`.
bool is_of_run(const Node& player, const fs::path& ratings_folder, const fs::path& run) {
  std::error_code code;
  return fs::equivalent(ratings_folder / text_of(player, "folder"), run, code);
}

}  // namespace

Json find_rating(const fs::path& ratings_file, const RatedPolicy& policy) {
  const Document document = parse_yaml_file(ratings_file);  // JSON is YAML
  const auto is_player = [&](const Node& player) {
    return text_of(player, "kind") == name_of(PlayerKind::checkpoint) &&
           text_of(player, "updates") == std::to_string(policy.updates) &&
           is_of_run(player, ratings_file.parent_path(), policy.run);
  };
  const auto& players = items_of(document.root, "players");
  const auto player = std::find_if(players.begin(), players.end(), is_player);
  Json found = Json::object();
  if (player == players.end()) return found;
  const auto take = [&](const std::string& side) {
    for (const Node& rating : items_of(document.root, "ratings")) {
      if (text_of(rating, "player") != text_of(*player, "name") || text_of(rating, "side") != side) continue;
      for (const char* key : {"scenario", "changes", "greedy", "anchor", "episodes"}) copy(document.root, key, found);
      for (const char* key : {"side", "standing", "rating", "standard_error", "ci95", "games", "wins", "ties", "losses",
                              "score", "paper_elo"})
        copy(rating, key, found);
      return true;
    }
    return false;
  };
  if (take("both")) return found;
  for (const int team : {0, 1})
    if (policy.team.value_or(team) == team && take(std::to_string(team))) break;
  return found;
}

}  // namespace giga
