// gigastep rate: a round robin of checkpoints, exported policies and scripts, and everybody's rating.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/load_player.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/players.hpp"
#include "apps/program_info.hpp"
#include "apps/stopwatch.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "eval/round_robin.hpp"
#include "export/export.hpp"
#include "io/files.hpp"
#include "io/number.hpp"
#include "io/run_folder.hpp"
#include "learn/alike_teams.hpp"
#include "rating/groups.hpp"
#include "rating/sheet.hpp"
#include "report/report.hpp"

namespace giga {
namespace {

namespace fs = std::filesystem;

struct RateOptions {
  std::vector<std::string> runs;
  std::string scripted = "all", scenario, sides = "auto", out, device = "auto", json;
  std::optional<std::string> anchor;
  std::vector<std::string> changes;
  int checkpoints = 1, episodes = 64;
  uint64_t seed = 0;
  bool greedy = false, trust = false, group = false;
};

/// `auto`: apart where the teams are made of different agents, or one of them wins at the time limit.
Sides sides_of(const RateOptions& o, const SimSpec& spec) {
  if (o.sides == "auto") return teams_are_alike(spec) ? Sides::alike : Sides::apart;
  return o.sides == "alike" ? Sides::alike : Sides::apart;
}

/// Who can be at 0: all players, or where the sides are apart those that play both.
std::vector<std::string> possible_anchors(const RoundRobin& all, Sides sides) {
  std::map<std::string, std::set<int>> played;  // sides by name
  for (size_t k = 0; k < all.players.size(); ++k)
    for (int side = 0; side < kNSides; ++side)
      if (all.players[k].can_play(side)) played[all.pools[k]].insert(side);
  std::vector<std::string> names;
  for (const std::string& name : all.pools) {
    const bool is_new = std::find(names.begin(), names.end(), name) == names.end();
    if (is_new && (sides == Sides::alike || played[name].size() == kNSides)) names.push_back(name);
  }
  return names;
}

/// The one asked for; else random, or without it the first player that has games on both sides.
std::string choose_anchor(const RateOptions& o, const RoundRobin& all, Sides sides) {
  if (o.anchor) {
    const std::vector<std::string> names = possible_anchors(all, sides);
    if (std::find(names.begin(), names.end(), *o.anchor) != names.end()) return *o.anchor;
    const bool plays = std::find(all.pools.begin(), all.pools.end(), *o.anchor) != all.pools.end();
    if (!names.empty())
      throw InputError(cat("--anchor: '", *o.anchor, plays ? "' does not play both sides" : "' is none of the players",
                           plays ? "" : nearest_hint(*o.anchor, names), "; allowed: ", join(names)));
  }
  for (const Player& c : all.players)
    if (c.name() == RatingOptions().anchor) return c.name();
  for (size_t k = 0; k < all.players.size(); ++k)
    if (all.players[k].can_play(0) && all.players[k].can_play(1)) return all.pools[k];
  throw InputError("no player plays both sides, so that none can be at rating 0: add --scripted random");
}

std::string seconds_text(double seconds) {
  return seconds < 60 ? cat(std::ceil(seconds), " s") : print_duration(seconds);
}

/// "169 matches of 64 episodes, about 8 s", as soon as the time is known by some of them; then a line every few
/// seconds. A match has its sides: a pair plays two, and a player one against itself.
class ProgressLines {
 public:
  explicit ProgressLines(int episodes) : episodes_(episodes) {}

  /// Before each match.
  void operator()(int done, int all, const Player& side_0, const Player& side_1) {
    if (done == 0)
      std::cerr << all << (all == 1 ? " match of " : " matches of ") << counted(episodes_, "episodes") << std::flush;
    const double elapsed = watch_.seconds();
    if (done == 1) first_ = elapsed;
    if (!announced_) {
      const bool slow = elapsed > kPause && done >= std::min(4, all - 1);
      if (done == 0 || (done < pairs_for_estimate(all) && !slow)) return;
      std::cerr << ", about " << seconds_text(expected_seconds(first_, elapsed, done, all)) << std::endl;
      announced_ = true;
      told_ = elapsed;
    } else if (elapsed - told_ > kPause) {
      told_ = elapsed;
      std::cerr << "match " << done + 1 << " of " << all << ": " << side_0.name() << " against " << side_1.name()
                << "; about " << seconds_text(expected_seconds(first_, elapsed, done, all) - elapsed) << " left"
                << std::endl;
    }
  }
  void finish() const {
    std::cerr << (announced_ ? "" : "\n") << "played in " << seconds_text(watch_.seconds()) << std::endl;
  }

 private:
  static constexpr double kPause = 5;  // seconds

  const int episodes_;
  const Stopwatch watch_;
  double first_ = 0, told_ = 0;
  bool announced_ = false;
};

/// In the folder of a run that is rated alone; else beside the first of them.
fs::path default_folder(const RateOptions& o) {
  std::error_code code;
  const bool is_relative = fs::path(o.runs[0]).is_relative();
  const fs::path first = absolute_path(o.runs[0]);  // one that is named from within has its parents too
  fs::path folder = first.parent_path();
  if (o.runs.size() == 1 && fs::is_directory(first, code) && !is_exported_policy(first))
    folder = first;
  else if (folder.filename() == "checkpoints" && !fs::is_directory(first, code))  // of a checkpoint file
    folder = folder.parent_path().parent_path();
  folder /= RatingFiles::kFolder;
  return is_relative ? fs::proximate(folder) : folder;
}

/// What stands there, whatever it is; `otherwise` where nothing does. A file may hold anything.
Json found(const Json& there, const char* key, Json otherwise) {
  const auto at = there.find(key);
  return at == there.end() ? otherwise : *at;
}

/// The run folders of those that were rated, and who has none: a group of runs, an exported policy.
std::set<Json> rated_runs(const Json& ratings) {
  std::set<Json> runs;
  for (const Json& player : found(ratings, "players", Json::array())) {
    if (found(player, "kind", "") == name_of(PlayerKind::script)) continue;
    const Json folder = found(player, "folder", "");
    runs.insert(folder == "" ? found(player, "name", "") : folder);
  }
  return runs;
}

/// The folder, or the first of "ratings-2", "ratings-3" and so on that holds no ratings of other runs, of another game
/// or of policies that play otherwise. A run's own, which its report shows, is left to its own game.
fs::path without_others(const fs::path& wanted, const RatingSheet& sheet, const RateOptions& o) {
  const bool own = o.runs.size() > 1 || (o.scenario.empty() && o.changes.empty() && !o.greedy);
  fs::path folder = own ? wanted : fs::path(wanted) += "-2";
  std::error_code code;
  for (int k = own ? 2 : 3; fs::exists(folder / RatingFiles::kJson, code); ++k) {
    const Json there = Json::parse(read_file(folder / RatingFiles::kJson), nullptr, false);
    const auto same_game = [&] {
      return found(there, "scenario", "") == sheet.scenario && found(there, "greedy", false) == o.greedy &&
             found(there, "changes", Json::array()) == Json(o.changes);
    };
    if (there.is_object() && rated_runs(there) == rated_runs(ratings_json(sheet, folder)) && same_game()) break;
    folder = fs::path(wanted) += cat("-", k);
  }
  return folder;
}

/// Players of one pool as one: games and what is known of them.
void pool(const std::vector<std::string>& pools, RatingSheet& sheet) {
  if (pools == sheet.table.players) return;
  sheet.table = pooled(sheet.table, pools);
  std::vector<PlayerInfo> infos;
  for (const std::string& name : sheet.table.players) {
    PlayerInfo info;
    int n = 0;
    for (size_t k = 0; k < pools.size(); ++k) {
      if (pools[k] != name) continue;
      const PlayerInfo& one = sheet.infos[k];
      if (n++ == 0) info = one;
      info.agent_steps += (one.agent_steps - info.agent_steps) / n;  // the mean
      info.seconds += (one.seconds - info.seconds) / n;
      info.updates = std::max(info.updates, one.updates);
    }
    if (n > 1) info.run = name, info.folder.clear();  // of no single run
    infos.push_back(std::move(info));
  }
  sheet.infos = std::move(infos);
}

/// A run's report shows the ratings in its folder.
void renew_report(const RateOptions& o, const fs::path& folder) {
  const fs::path run = folder.parent_path(), report = run / "report.html";
  std::error_code code;
  if (!o.out.empty() || run.empty() || !fs::exists(report, code)) return;
  if (!is_run_folder(run)) return;  // of several runs: it is theirs, and not in ours to renew
  for (const char* needed : {"config.yaml", "scenario.yaml", "run.json", "metrics.csv"})
    if (!fs::exists(run / needed, code)) {
      std::cerr << "warning: " << report.string() << " does not show these ratings: " << run.string() << " has no "
                << needed << '\n';
      return;
    }
  try {
    write_report({run}, report, list_fields<RunConfig>());
  } catch (const InputError& e) {
    std::cerr << "warning: " << report.string() << " does not show these ratings: " << e.what() << '\n';
  }
}

/// One alone has nobody to be rated against, but its teams where they are rated apart.
void expect_opponents(const RoundRobin& all, Sides sides) {
  const std::set<std::string> pools(all.pools.begin(), all.pools.end());
  if (sides == Sides::alike && pools.size() == 1)
    throw InputError(
        cat(*pools.begin(), " alone has nobody to play against: name another run, --checkpoints 0, or --scripted all"));
}

RatingSheet play_and_rate(const RateOptions& o, RoundRobin& all, Device device) {
  RatingSheet sheet;
  sheet.scenario = all.scenario.name;
  sheet.infos = all.infos;
  RatingOptions rating;
  rating.sides = sides_of(o, all.spec);
  rating.anchor = choose_anchor(o, all, rating.sides);
  expect_opponents(all, rating.sides);
  check_episodes(o.episodes, all.players);
  std::string note;  // told behind the lines of progress, which it would break
  const auto keep_note = [&note](const std::string& text) { note = text; };
  const MatchOptions match{o.episodes, o.seed, device, all.n_threads, keep_note};
  ProgressLines progress(o.episodes);
  sheet.table = play_table(all.players, all.spec, match, std::ref(progress));
  progress.finish();
  if (!note.empty()) std::cerr << "note: " << note << '\n';
  pool(all.pools, sheet);
  sheet.ratings = rate(sheet.table, rating);
  return sheet;
}

void rate_runs(const RateOptions& o) {
  const Device device = parse_device(o.device);
  RoundRobin all =
      find_players({o.runs, o.scripted, {o.scenario, o.changes}, o.checkpoints, o.group}, {device, o.trust, o.greedy});
  // Before the games: those of --out are looked at with the options.
  if (o.out.empty()) expect_output(Output::folder, default_folder(o), "--out takes another folder");
  const RatingSheet sheet = play_and_rate(o, all, device);
  const fs::path folder = o.out.empty() ? without_others(default_folder(o), sheet, o) : fs::path(o.out);
  const SimParams params = all.spec.with_time_limit().params;
  const std::string win = describe_win(params.win, params.max_episode_length);
  Json json = ratings_json(sheet, folder);
  json.update({{"win", win},
               {"changes", o.changes},
               {"episodes", o.episodes},
               {"seed", o.seed},
               {"greedy", o.greedy},
               {"versions", version_info()}});
  if (o.json != "-")  // before the files, which it may not be possible to write
    std::cout << sheet.scenario << ", " << o.episodes << " episodes of each pair on each side\n"
              << (o.changes.empty() ? "" : cat("changed: ", join(o.changes), "\n"))
              << (o.greedy ? "policies take their most likely actions\n" : "") << win << '\n'
              << ratings_table(sheet) << std::flush;
  write_ratings(folder, sheet, json);
  if (!o.json.empty()) write_json(json, o.json);
  if (o.json != "-") std::cout << "Written: " << folder.string() << std::endl;
  renew_report(o, folder);
}

void add_options(CLI::App& command, RateOptions& o) {
  command
      .add_option("RUN", o.runs,
                  "run folders (all checkpoints that checkpoint.keep left there), checkpoint files, exported policies")
      ->required()
      ->type_name("");
  command.add_option("--scripted", o.scripted, "scripts that play too: all, none, or names with commas between them")
      ->capture_default_str()
      ->type_name("all|none|NAME,...");
  command
      .add_option("--checkpoints", o.checkpoints,
                  "at most so many of each run, at equal distances, the newest among them, and the best beside them; "
                  "0 = all")
      ->transform(value_of<int>(range(0, 1'000'000)))
      ->capture_default_str()
      ->type_name("N");
  command.add_option("--episodes", o.episodes, "episodes of each pair on each side")
      ->transform(value_of<int>(range(1, 10'000'000)))
      ->capture_default_str()
      ->type_name("N");
  command.add_flag("--group", o.group,
                   "runs that differ only in their seed are one player: their games are added up; of each run its best "
                   "checkpoint plays, or the newest. Intervals are those of the games of these runs: how much seeds "
                   "differ is told where they are rated one by one");
  command.add_option("--scenario", o.scenario, "what is played; default: the scenario of the runs")
      ->check(some_name())
      ->type_name("S");
  add_game_changes(command, o.changes);
  command
      .add_option(
          "--sides", o.sides,
          "alike: one rating per player; apart: one for each team; auto: apart where the teams differ, or one of "
          "them wins at the time limit")
      ->transform(value_of<std::string>(one_of({"auto", "alike", "apart"})))
      ->capture_default_str()
      ->type_name("auto|alike|apart");
  command
      .add_option("--anchor", o.anchor,
                  "the player at 0, by its name in the table (circle, RUN@UPDATES): ratings and their intervals are "
                  "differences to it; default: random, or without it the first player of both sides")
      ->type_name("NAME");
  command
      .add_option("--out", o.out,
                  "folder of the results; default: `ratings` in the run folder, of several beside the first, with a "
                  "number behind it where those of other runs lie there")
      ->check(output(Output::folder))
      ->type_name("DIR");
  add_json_option(command, o.json);
  add_device_option(command, o.device)->capture_default_str();
  command.add_option("--seed", o.seed, "seed of the episodes: same seed, same result")
      ->transform(value_of<uint64_t>(anything()))
      ->capture_default_str()
      ->type_name("S");
  command.add_flag("--greedy", o.greedy, "policies take the most likely action instead of drawing one");
  command.add_flag("--trust", o.trust, "open TorchScript modules, which can run any code");
}

}  // namespace

void add_rate_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command =
      app.add_subcommand("rate", "let checkpoints, exported policies and scripts play a round robin, and rate them");
  auto options = std::make_shared<RateOptions>();
  add_options(*command, *options);
  command->footer(
      "By default of each run the newest checkpoint and the best one, 64 episodes of each pair: a first impression.\n"
      "Everybody plays everybody on both sides, a checkpoint with its policy of team 0 on side 0 and that of team 1\n"
      "on side 1, an exported policy on either. Ratings are on the Elo scale (400 points = odds of ten to one) by\n"
      "Bradley-Terry maximum likelihood, a tie being half a win, with random (or --anchor) at 0 and 95 % intervals\n"
      "of the difference to it; who never lost or never won has none that is finite, and is told apart. Two lines\n"
      "below say how well ratings explain the games: the deviance of the fit, and how much of who beats whom is\n"
      "cyclic, as in rock, paper, scissors. The paper's sequential Elo (K 32, start 1200, pair by pair in the order\n"
      "of the table, on which it depends) stands beside. What a win is, the scenario says (its group win; scenarios\n"
      "show NAME), and the table repeats it.\n"
      "The folder gets:\n"
      "  ratings.csv, ratings.json   everybody's rating, of checkpoints with updates, agent-steps and seconds of "
      "training\n"
      "  matrix.csv, matrix.svg      who takes which share of the points from whom\n"
      "  rating.svg, win_rate.svg    where checkpoints play: over agent-steps, the rating and the win rate against\n"
      "                              baselines\n"
      "  rating_seconds.svg, win_rate_seconds.svg\n"
      "                              the same over the wall-clock time of training\n"
      "Of one run alone its report shows the pictures, and export writes a checkpoint's rating into the manifest.\n"
      "Examples:\n"
      "  gigastep rate runs/identical_5_vs_5-mappo-seed1\n"
      "  gigastep rate runs/a-seed* runs/b-seed* --group\n"
      "  gigastep rate runs/a --checkpoints 0 --episodes 256         all checkpoints, more precisely\n"
      "  gigastep rate runs/a runs/b --checkpoints 5 --scripted random,circle --episodes 1024 --out a_and_b\n"
      "  gigastep rate runs/a runs/b --anchor pursuer                leads over pursuer, with their intervals\n"
      "  gigastep rate runs/a exported/pursuer --sides apart --json -");
  command->callback([options, &dispatch] { dispatch.run = [options] { rate_runs(*options); }; });
}

}  // namespace giga
