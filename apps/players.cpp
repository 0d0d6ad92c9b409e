// Finding and loading players.
#include "apps/players.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <system_error>

#include "apps/load_player.hpp"
#include "config/fields.hpp"
#include "config/names.hpp"
#include "config/settings.hpp"
#include "core/error.hpp"
#include "export/export.hpp"
#include "io/files.hpp"
#include "io/run_folder.hpp"
#include "learn/mixed_team.hpp"
#include "learn/registry.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

std::vector<std::string> script_names(const std::string& scripted) {
  const std::vector<std::string> known = FieldCodec<Scripted>::names();
  if (scripted == "all") return known;
  std::vector<std::string> names;
  if (scripted == "none") return names;
  std::istringstream list(scripted);
  for (std::string name; std::getline(list, name, ',');) {
    if (!find_script(name))
      throw InputError(cat("--scripted ", scripted, ": '", name, "' is no scripted team", nearest_hint(name, known),
                           "; allowed: all, none, or out of ", join(known)));
    if (std::find(names.begin(), names.end(), name) != names.end())
      throw InputError(cat("--scripted ", scripted, ": '", name, "' is there twice"));
    names.push_back(name);
  }
  if (names.empty()) throw InputError("--scripted: no name is given; allowed: all, none, or names");
  return names;
}

/// Who takes part beside the scripts.
struct Candidate {
  Player player;
  PlayerInfo info;
  fs::path folder = {};  ///< of its run, absolute, by the name that it was asked for
};

int64_t updates_of(const Candidate& candidate) { return candidate.info.updates; }

/// name_runs() gives the names.
Candidate candidate_of(const fs::path& file, Checkpoint checkpoint, const fs::path& run, const PlayerOptions& options) {
  Candidate candidate{Player::of_checkpoint({file, std::move(checkpoint), {}, {}}, options), {}, absolute_path(run)};
  const Player::Origin& origin = *candidate.player.origin();
  candidate.info.kind = PlayerKind::checkpoint;
  candidate.info.updates = origin.updates;
  candidate.info.agent_steps = static_cast<double>(origin.agent_steps);
  candidate.info.seconds = origin.seconds;
  candidate.info.folder = fs::weakly_canonical(candidate.folder);
  return candidate;
}

/// Names runs after their folders. Checkpoints are called "RUN@UPDATES".
void name_runs(std::vector<Candidate>& all) {
  std::vector<fs::path> folders;
  for (const Candidate& c : all)
    if (!c.info.is_baseline()) folders.push_back(c.folder);
  const std::vector<std::string> names = names_of_folders(folders);
  auto name = names.begin();
  for (Candidate& c : all) {
    if (c.info.is_baseline()) continue;
    c.info.run = *name++;
    c.player.rename(cat(c.info.run, "@", c.info.updates));
  }
}

/// Those of the files that are whole.
std::vector<Candidate> read_whole(const std::vector<fs::path>& files, const fs::path& run,
                                  const PlayerOptions& options) {
  std::vector<Candidate> whole;
  for (const fs::path& file : files)
    if (std::optional<Checkpoint> checkpoint = read_if_whole(file))
      whole.push_back(candidate_of(file, std::move(*checkpoint), run, options));
  return whole;
}

/// The kept checkpoints of a run in order; the best one is one of them or beside them.
std::vector<Candidate> candidates_of_run(const fs::path& folder, int most, const PlayerOptions& options) {
  const std::vector<fs::path> files = list_checkpoints(folder);
  std::vector<fs::path> chosen;
  for (const size_t k : spread(files.size(), static_cast<size_t>(most))) chosen.push_back(files[k]);
  std::vector<Candidate> all = read_whole(chosen, folder, options);
  // Where all of those are damaged, the newest that is whole.
  for (size_t k = files.size(); all.empty() && k-- > 0;)
    if (std::find(chosen.begin(), chosen.end(), files[k]) == chosen.end())
      all = read_whole({files[k]}, folder, options);
  const fs::path best_file = folder / "checkpoints/best.h5";
  std::error_code code;
  if (fs::exists(best_file, code)) {
    for (Candidate& best : read_whole({best_file}, folder, options)) {
      const int64_t updates = updates_of(best);
      auto at = std::find_if(all.begin(), all.end(), [&](const Candidate& c) { return updates_of(c) >= updates; });
      if (at == all.end() || updates_of(*at) != updates) at = all.insert(at, std::move(best));
      at->info.best = true;
    }
  }
  if (all.empty())
    throw InputError(
        cat("the folder ", folder.string(), " holds no whole checkpoint (checkpoints/update_NNNNNNNN.h5)"));
  return all;
}

/// Named after its folder; a module from elsewhere and a mixed team after their file.
Candidate exported_candidate(const fs::path& path, const PlayerOptions& options) {
  Candidate candidate{Player::load(path.string(), options), {}};
  std::error_code code;
  const bool named_after_file = !fs::is_directory(path, code) && !candidate.player.origin();
  candidate.player.rename(named_after_file               ? path.stem().string()
                          : fs::is_directory(path, code) ? name_of_folder(path)
                                                         : name_of_folder(fs::absolute(path).parent_path()));
  candidate.info.kind = candidate.player.is_mixed() ? PlayerKind::mixed : PlayerKind::exported;
  return candidate;
}

std::vector<Candidate> find_candidates(const PlayerRequest& request, const PlayerOptions& options) {
  std::vector<Candidate> all;
  for (size_t k = 0; k < request.runs.size(); ++k) {
    const fs::path path = request.runs[k];
    std::error_code code;
    for (size_t j = 0; j < k; ++j)
      if (fs::equivalent(path, request.runs[j], code))
        throw InputError(cat("the run ", path.string(), " is given twice"));
    if (!fs::exists(path, code)) fail_no_such_run(path);
    if (is_exported_policy(path) || names_mixed_team(path)) {
      all.push_back(exported_candidate(path, options));
    } else if (fs::is_directory(path, code)) {
      std::vector<Candidate> own = candidates_of_run(path, request.group ? 1 : request.checkpoints, options);
      const auto best = std::find_if(own.begin(), own.end(), [](const Candidate& c) { return c.info.best; });
      if (request.group) own = {best == own.end() ? own.back() : *best};
      for (Candidate& c : own) all.push_back(std::move(c));
    } else {
      // A copy that lies elsewhere is a run of its own, named after the file.
      const fs::path file = absolute_path(path), folder = file.parent_path();
      const bool in_run = folder.filename() == "checkpoints";
      all.push_back(candidate_of(path, read_checkpoint(path), in_run ? folder.parent_path() : file, options));
    }
  }
  name_runs(all);
  return all;
}

void choose_game(const PlayerRequest& request, const std::vector<Candidate>& candidates, RoundRobin& result) {
  std::vector<const Player*> players;
  for (const Candidate& c : candidates) players.push_back(&c.player);
  PlayedGame game = choose_game(request.game, players, OtherGames::refused);
  result.scenario = std::move(game.scenario);
  result.spec = std::move(game.spec);
  for (const Player* player : players)
    if (player->origin() && result.n_threads == 0) result.n_threads = player->origin()->run.config.train.n_threads;
}

/// A run's config and scenario without what seeds of one configuration do not share.
Settings configuration_of(const Player::Origin& origin) {
  Settings all = flatten(parse_yaml_text(print_yaml(origin.run.config, false), "config").root);
  std::erase_if(all, [](const auto& entry) { return is_run_time_setting(entry.first); });
  const Settings game = game_settings(parse_yaml_text(print_scenario(origin.run.scenario), "scenario").root);
  all.insert(all.end(), game.begin(), game.end());
  return all;
}

/// What the names of runs begin with, without the "-seed" behind it: "duel-mappo" of "duel-mappo-seed1" and "-seed2".
std::string common_name(const std::vector<std::string>& names) {
  std::string common = names.front();
  for (const std::string& name : names) {
    size_t same = 0;
    while (same < std::min(common.size(), name.size()) && common[same] == name[same]) ++same;
    common.resize(same);
  }
  if (const size_t seed = common.rfind("seed"); seed != std::string::npos) common.resize(seed);
  while (!common.empty() && std::string_view("-_./ ").find(common.back()) != std::string_view::npos) common.pop_back();
  return common.empty() ? names.front() + " and others" : common;
}

/// Gives the seeds of one configuration a name together.
void pool_seeds(RoundRobin& all) {
  std::map<Settings, std::vector<size_t>> groups;
  for (size_t k = 0; k < all.players.size(); ++k)
    if (!all.infos[k].is_baseline()) groups[configuration_of(*all.players[k].origin())].push_back(k);
  for (const auto& [configuration, members] : groups) {
    if (members.size() < 2) continue;
    std::vector<std::string> names;
    std::set<uint64_t> seeds;
    for (const size_t k : members) {
      names.push_back(all.infos[k].run);
      seeds.insert(all.players[k].origin()->run.config.seed);
    }
    std::string name = cat(common_name(names), " (", counted_seeds(members.size(), seeds.size()), ")");
    while (std::find(all.pools.begin(), all.pools.end(), name) != all.pools.end()) name += "'";
    for (const size_t k : members) all.pools[k] = name;
  }
}

/// Adds "#2" to a name that another has too.
void add(Candidate candidate, RoundRobin& result) {
  const std::string wanted = candidate.player.name();
  const auto is_taken = [&](const std::string& name) {
    return std::any_of(result.players.begin(), result.players.end(), [&](const auto& c) { return c.name() == name; });
  };
  for (int number = 2; is_taken(candidate.player.name()); ++number) candidate.player.rename(cat(wanted, "#", number));
  for (int side = 0; side < kNTeams; ++side)
    if (candidate.player.can_play(side))
      candidate.player.controller(side, result.spec);  // throws where it does not fit
  result.players.push_back(std::move(candidate.player));
  result.infos.push_back(std::move(candidate.info));
}

}  // namespace

std::vector<size_t> spread(size_t n, size_t count) {
  if (count == 0 || count > n) count = n;
  std::vector<size_t> indices;
  for (size_t k = 1; k <= count; ++k) indices.push_back((k * n + count - 1) / count - 1);
  return indices;
}

RoundRobin find_players(const PlayerRequest& request, const PlayerOptions& options) {
  const std::vector<std::string> scripts =
      script_names(request.scripted);  // wrong names are told before files are read
  const std::vector<std::string> known = FieldCodec<Scripted>::names();
  for (const std::string& run : request.runs) {
    std::error_code code;
    if (std::find(known.begin(), known.end(), run) != known.end() && !fs::exists(run, code))
      throw InputError(cat("'", run, "' is a scripted team: it plays with --scripted ", run));
  }
  std::vector<Candidate> candidates = find_candidates(request, options);
  RoundRobin result;
  choose_game(request, candidates, result);
  for (const std::string& name : scripts) add({Player::load(name, options), {}}, result);
  for (Candidate& candidate : candidates) add(std::move(candidate), result);
  for (const Player& player : result.players) result.pools.push_back(player.name());
  if (request.group) pool_seeds(result);
  return result;
}

}  // namespace giga
