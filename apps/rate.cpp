// gigastep rate: a round robin of checkpoints, exported policies and scripts, and everybody's rating.
#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/players.hpp"
#include "apps/program_info.hpp"
#include "cuda/runtime.hpp"
#include "eval/round_robin.hpp"
#include "export/export.hpp"
#include "rating/sheet.hpp"
#include "report/report.hpp"

namespace giga {
namespace {

namespace fs = std::filesystem;

struct RateOptions {
  std::vector<std::string> runs;
  std::string scripted = "all", scenario, sides = "auto", out, device = "auto", json;
  int checkpoints = 0, episodes = 256;
  uint64_t seed = 0;
  bool greedy = false, trust = false;
};

/// `auto`: apart where the teams are made of different agents, or one of them wins at the time limit.
Sides sides_of(const RateOptions& o, const Scenario& scenario) {
  const bool alike = scenario.team_0 == scenario.team_1 && scenario.win.at_time_limit == LimitWinner::tie;
  if (o.sides == "auto") return alike ? Sides::alike : Sides::apart;
  return o.sides == "alike" ? Sides::alike : Sides::apart;
}

/// random, or without it the first player that has games on both sides.
std::string choose_anchor(const RoundRobin& all) {
  for (const Player& c : all.players)
    if (c.name() == RatingOptions().anchor) return c.name();
  for (const Player& c : all.players)
    if (c.can_play(0) && c.can_play(1)) return c.name();
  throw InputError("no player plays both sides, so that none can be at rating 0: add --scripted random");
}

/// A line at the first pair, then one every few seconds.
class ProgressLines {
 public:
  void operator()(int done, int all, const Player& side_0, const Player& side_1) {
    const auto now = std::chrono::steady_clock::now();
    if (done > 0 && now - last_ < kPause) return;
    last_ = now;
    std::cerr << "pair " << done + 1 << " of " << all << ": " << side_0.name() << " against " << side_1.name()
              << std::endl;
  }

 private:
  static constexpr std::chrono::seconds kPause{5};
  std::chrono::steady_clock::time_point last_;
};

/// For one run in its folder, for several in the current one.
fs::path default_folder(const RateOptions& o) {
  std::error_code code;
  const bool one_run = o.runs.size() == 1 && fs::is_directory(o.runs[0], code) && !is_exported_policy(o.runs[0]);
  return (one_run ? fs::path(o.runs[0]) : fs::path()) / RatingFiles::kFolder;
}

/// A run's report shows the ratings in its folder.
void renew_report(const RateOptions& o, const fs::path& folder) {
  const fs::path run = folder.parent_path(), report = run / "report.html";
  std::error_code code;
  if (!o.out.empty() || run.empty() || !fs::exists(report, code)) return;
  write_report({run}, report, list_fields<RunConfig>());
}

RatingSheet play_and_rate(const RateOptions& o, RoundRobin& all, Device device) {
  RatingSheet sheet;
  sheet.scenario = all.scenario.name;
  sheet.infos = all.infos;
  RatingOptions rating;
  rating.anchor = choose_anchor(all);
  rating.sides = sides_of(o, all.scenario);
  const MatchOptions match{o.episodes, o.seed, device, all.n_threads};
  sheet.table = play_table(all.players, all.spec, match, ProgressLines());
  sheet.ratings = rate(sheet.table, rating);
  return sheet;
}

void rate_runs(const RateOptions& o) {
  const Device device = parse_device(o.device);
  RoundRobin all = find_players({o.runs, o.scripted, o.scenario, o.checkpoints}, {device, o.trust, o.greedy});
  const RatingSheet sheet = play_and_rate(o, all, device);
  const fs::path folder = o.out.empty() ? default_folder(o) : fs::path(o.out);
  const SimParams& params = all.spec.params;
  const std::string win = describe_win(params.win, params.max_episode_length);
  Json json = ratings_json(sheet, folder);
  json.update(
      {{"win", win}, {"episodes", o.episodes}, {"seed", o.seed}, {"greedy", o.greedy}, {"versions", version_info()}});
  write_ratings(folder, sheet, json);
  renew_report(o, folder);
  if (!o.json.empty()) write_json(json, o.json);
  if (o.json != "-")
    std::cout << sheet.scenario << ", " << o.episodes << " episodes of each pair on each side\n"
              << win << '\n'
              << ratings_table(sheet) << "Written: " << folder.string() << "\n";
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
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str()
      ->type_name("N");
  command.add_option("--episodes", o.episodes, "episodes of each pair on each side")
      ->check(CLI::Range(1, 10'000'000))
      ->capture_default_str()
      ->type_name("N");
  command.add_option("--scenario", o.scenario, "what is played; default: the scenario of the runs")->type_name("S");
  command
      .add_option(
          "--sides", o.sides,
          "alike: one rating per player; apart: one for each team; auto: apart where the teams differ, or one of "
          "them wins at the time limit")
      ->check(CLI::IsMember({"auto", "alike", "apart"}))
      ->capture_default_str()
      ->type_name("auto|alike|apart");
  command
      .add_option("--out", o.out, "folder of the results; default: `ratings` in the run folder, of several runs here")
      ->type_name("DIR");
  add_json_option(command, o.json);
  add_device_option(command, o.device)->capture_default_str();
  command.add_option("--seed", o.seed, "seed of the episodes: same seed, same result")
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
      "Everybody plays everybody on both sides, a checkpoint with its policy of team 0 on side 0 and that of team 1\n"
      "on side 1, an exported policy on either. Ratings are on the Elo scale (400 points = odds of ten to one) by\n"
      "Bradley-Terry maximum likelihood, a tie being half a win, with random at 0 and 95 % intervals; who never lost\n"
      "or never won has none that is finite, and is told apart. The paper's sequential Elo (K 32, start 1200, pair by\n"
      "pair in the order of the table, on which it depends) stands beside. What a win is, the scenario says (its "
      "group\n"
      "win; scenarios show NAME), and the table repeats it.\n"
      "The folder gets:\n"
      "  ratings.csv, ratings.json   everybody's rating, of checkpoints with updates, agent-steps and seconds of "
      "training\n"
      "  matrix.csv, matrix.svg      who takes which share of the points from whom\n"
      "  rating.svg, win_rate.svg    where checkpoints play: over agent-steps, the rating and the win rate against\n"
      "                              baselines\n"
      "  rating_seconds.svg, win_rate_seconds.svg\n"
      "                              the same over the wall-clock time of training\n"
      "A run's report shows the pictures, and export writes a checkpoint's rating into the manifest.\n"
      "Examples:\n"
      "  gigastep rate runs/identical_5_vs_5-mappo-seed1-001\n"
      "  gigastep rate runs/a runs/b --checkpoints 5 --scripted random,circle --episodes 1024 --out a_and_b\n"
      "  gigastep rate runs/a exported/pursuer --sides apart --json -");
  command->callback([options, &dispatch] { dispatch.run = [options] { rate_runs(*options); }; });
}

}  // namespace giga
